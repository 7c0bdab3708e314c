//! Changes of parameters: what they would do, whether they are dangerous, and the change itself.

use super::serve::{GATE_TIMEOUT, RequestHandler};
use hapfic_config::{OperatorChange, ParameterSettings, RequestedChange, differences, parameter_lines};
use hapfic_gate::parameter_settings;
use hapfic_gate_process::change_exchange::{ChangeOutcome, ChangeReply};
use hapfic_messages::{OperatorReply, ReplyCode};
use hapfic_simulation::findings::{Finding, FreeAir, Scene, Source};
use std::fmt::Write;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Attempts to apply a change while the script changes parameters too.
const CHANGE_ATTEMPTS: usize = 8;
/// Wall-clock time for trying new gains in free air: the client waits for its reply meanwhile.
const FREE_AIR_TIMEOUT: Duration = Duration::from_millis(500);

/// Whether the operator consents to a dangerous change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Consent {
    /// A dangerous change is rejected.
    Asked,
    /// `--force`: it is made.
    Given,
}

/// Findings of a change, and what could not be found out.
#[derive(Default)]
struct Advice {
    findings: Vec<Finding>,
    note: Option<&'static str>,
}

impl Advice {
    fn is_dangerous(&self) -> bool {
        self.findings.iter().any(|finding| finding.dangerous)
    }

    fn append_to(&self, text: &mut String) {
        // Writing to a string cannot fail.
        for finding in &self.findings {
            let _ = write!(text, "\n  {finding}");
        }
        if let Some(note) = self.note {
            let _ = write!(text, "\n  {note}");
        }
    }
}

fn rejected(text: &str) -> OperatorReply {
    OperatorReply::new(ReplyCode::Rejected, text)
}

fn pairs_of(text: &str) -> Vec<&str> {
    text.split('\0').filter(|pair| !pair.is_empty()).collect()
}

impl RequestHandler {
    /// Applies all pairs at one tick, or none. A dangerous change needs consent.
    pub(super) fn set(&mut self, text: &str, consent: Consent) -> OperatorReply {
        if let Some(reply) = self.not_started() {
            return reply;
        }
        let arrived = self.due_tick();
        let pairs = pairs_of(text);
        self.catch_up();
        for _ in 0..CHANGE_ATTEMPTS {
            let request = match OperatorChange::from_pairs(&pairs, &self.base) {
                Ok(request) => request,
                Err(e) => return rejected(&e.to_string()),
            };
            let known = self.base;
            let advice = self.advise(&known, &request.change, &pairs);
            if consent == Consent::Asked && advice.is_dangerous() {
                let mut text = "nothing changed: found a dangerous change, expected --force with it".to_owned();
                advice.append_to(&mut text);
                text.push_str("\n  Hint: `hapfic set --force` makes it all the same, `--dry-run` shows what it would change");
                return rejected(&text);
            }
            let base_version = request.relative.then_some(self.version);
            let Some(reply) = self.start.change_client.ask(base_version, &request.change, &known, GATE_TIMEOUT) else {
                return rejected(
                    "nothing changed: the gate has accepted no change in time, expected a poll every tick. \
                     Hint: see `hapfic status`",
                );
            };
            let before = self.base_of(&reply);
            match reply.outcome {
                ChangeOutcome::Placed => return self.placed(&reply, arrived, (&known, advice), &request, &pairs),
                ChangeOutcome::Stale => (self.base, self.version) = (before, reply.version.saturating_sub(1)),
                ChangeOutcome::TooLate => {
                    return rejected(&format!(
                        "nothing changed: the run ends at tick {}, and the change could take effect at tick {} at the earliest",
                        self.start.ticks, reply.effective_tick
                    ));
                }
                ChangeOutcome::Full => {
                    return rejected("nothing changed: too many changes are waiting for their tick. Hint: try again in a moment");
                }
            }
        }
        rejected("nothing changed: the script changes parameters faster than single axes can be set. Hint: give the whole vector")
    }

    /// Reply to a change that the gate has placed.
    fn placed(
        &mut self,
        reply: &ChangeReply,
        arrived: i64,
        (known, advice): (&ParameterSettings, Advice),
        request: &RequestedChange,
        pairs: &[&str],
    ) -> OperatorReply {
        let before = self.base_of(reply);
        let after = before.with(&request.change);
        (self.base, self.version) = (after, reply.version);
        let mut text = format!(
            "parameters {} in force from tick {} (asked at tick {arrived}, taken at tick {})",
            reply.version, reply.effective_tick, reply.taken_tick
        );
        append_differences(&mut text, &before, &after);
        // The script may have changed something meanwhile.
        let advice = if before == *known { advice } else { self.advise(&before, &request.change, pairs) };
        advice.append_to(&mut text);
        OperatorReply {
            version: reply.version,
            tick: reply.effective_tick,
            taken_tick: reply.taken_tick,
            ..OperatorReply::new(ReplyCode::Done, &text)
        }
    }

    /// Reports what a change would do; asks the gate for nothing.
    pub(super) fn dry_run(&mut self, text: &str) -> OperatorReply {
        if let Some(reply) = self.not_started() {
            return reply;
        }
        let pairs = pairs_of(text);
        self.catch_up();
        let before = self.base;
        match OperatorChange::from_pairs(&pairs, &before) {
            Ok(request) => {
                let mut text = "nothing changed (dry run); the change would make".to_owned();
                append_differences(&mut text, &before, &before.with(&request.change));
                let advice = self.advise(&before, &request.change, &pairs);
                advice.append_to(&mut text);
                if advice.is_dangerous() {
                    text.push_str("\n  it would need --force");
                }
                OperatorReply::new(ReplyCode::Done, &text)
            }
            Err(e) => rejected(&e.to_string()),
        }
    }

    /// Reports the parameters in force.
    pub(super) fn get(&self, text: &str) -> OperatorReply {
        if let Some(reply) = self.not_started() {
            return reply;
        }
        let tick = self.due_tick();
        let published = self.start.latest.operator().map(|sets| *sets.at(tick));
        let (set, version) = match published.and_then(|set| Some((parameter_settings::settings(&set)?, set.version))) {
            Some(known) => known,
            // Before the first message of the recorder: the initial set is in force.
            None => (self.start.initial, 1),
        };
        match parameter_lines(&set, &pairs_of(text)) {
            Ok(lines) => OperatorReply { version, tick, ..OperatorReply::new(ReplyCode::Done, &lines.join("\n")) },
            Err(e) => rejected(&e.to_string()),
        }
    }

    fn not_started(&self) -> Option<OperatorReply> {
        let started = self.start.shared.orders.start.load(Ordering::Acquire);
        (!started).then(|| {
            rejected("nothing changed: the run has not started yet, expected its first tick. Hint: try again in a moment")
        })
    }

    /// Takes the set that the gate has announced last, if the script has made one since.
    fn catch_up(&mut self) {
        if let Some(next) = self.start.latest.operator().map(|sets| sets.next)
            && next.version > self.version
            && let Some(set) = parameter_settings::settings(&next)
        {
            (self.base, self.version) = (set, next.version);
        }
    }

    /// Compares a change with robot and world, as they are now.
    fn advise(&self, before: &ParameterSettings, change: &OperatorChange, pairs: &[&str]) -> Advice {
        let advisor = &self.start.advisor;
        let scene = self.start.latest.state().map_or_else(|| advisor.start().clone(), |state| Scene::of_state(&state));
        let after = before.with(change);
        let source = Source::Request(pairs);
        let mut advice = Advice { findings: advisor.set(&after, change, source, &scene), note: None };
        let begun = Instant::now();
        match advisor.free_air(before, &after, change, source, &|| begun.elapsed() < FREE_AIR_TIMEOUT) {
            Ok(FreeAir::Settles) => {}
            Ok(FreeAir::Oscillates(finding)) => advice.findings.push(finding),
            Ok(FreeAir::Unknown) | Err(_) => {
                advice.note = Some("the gains were not tried in free air within half a second; `hapfic check` tries them");
            }
        }
        advice
    }

    /// Returns the parameters before a change, with the initial target until the operator sets a target.
    fn base_of(&self, reply: &ChangeReply) -> ParameterSettings {
        let target_position = reply.before.target_position.or(self.start.initial.target_position);
        ParameterSettings { target_position, joint_space: self.start.initial.joint_space, ..reply.before }
    }
}

fn append_differences(text: &mut String, before: &ParameterSettings, after: &ParameterSettings) {
    match differences(before, after) {
        Ok(list) if list.is_empty() => text.push_str("\n  no value differs"),
        Ok(list) => {
            for d in list {
                // Writing to a string cannot fail.
                let _ = write!(text, "\n  {}: {} -> {}", d.key, d.before, d.after);
            }
        }
        Err(e) => {
            let _ = write!(text, "\n  {e}");
        }
    }
}
