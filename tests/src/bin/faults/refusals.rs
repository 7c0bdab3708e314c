//! Invalid messages: the stack rejects them, and the run continues.

use crate::part::{DocumentPart, Expectation, table, verdict};
use crate::realtime::{setting, settings};
use crate::runs::{LOG, RunFolder};
use crate::trace::Trace;
use hapfic_messages::EventKind;
use std::time::Duration;

const DURATION_S: f64 = 2.0;
const TICKS: usize = 2000;
/// First tick of the fault.
const FAULT_TICK: usize = 900;
/// Duration of the fault.
const FAULT_DURATION: &str = ",for_ms=3";
/// Time limit of a run: in lockstep the clock stands still until a process detects the missing message.
const LIMIT: Duration = Duration::from_secs(120);
/// Faults, and whether receivers must reject the messages. A receiver may also skip an old tick.
const FAULTS: [(&str, bool); 5] = [("nan", true), ("stale", false), ("corrupt", true), ("repeat", false), ("drop", false)];
/// Clocks, and the senders of invalid messages. In lockstep an invalid message of the plant would stop the clock.
const CLOCKS: [(&str, &[&str]); 2] =
    [("realtime", &["controller", "planner", "plant"]), ("lockstep", &["controller", "planner"])];

/// Corrupted messages in a run.
const CORRUPTED: usize = 3;

/// Makes the part.
pub(crate) fn make() -> DocumentPart {
    let folder = RunFolder::new();
    let head = ["clock", "sender", "messages", "rejected", "events `rejected`", "lost", "completed", "log complete"];
    let (mut rows, mut incomplete, mut unnoticed) = (Vec::new(), Vec::new(), Vec::new());
    for (clock, senders) in CLOCKS {
        for sender in senders {
            for (kind, rejected) in FAULTS {
                eprintln!("{clock}: {kind} by the {sender}");
                let mut all = settings();
                all.push(setting(kind, FAULT_DURATION, &[(*sender, FAULT_TICK)]));
                let end = folder.floor(clock, DURATION_S, &all, LIMIT);
                let trace = Trace::read(&folder.path(LOG));
                let name = format!("{kind} by {sender} in {clock}");
                // The recorder rejects corrupted states too.
                let missing = trace.missing(TICKS).saturating_sub(if *sender == "plant" { CORRUPTED } else { 0 });
                let events = trace.events(EventKind::Rejected).count();
                if !end.completed() || missing > 0 {
                    incomplete.push(name.clone());
                }
                if rejected && trace.rejected() == 0 {
                    unnoticed.push(name);
                }
                rows.push(vec![
                    clock.to_owned(),
                    (*sender).to_owned(),
                    kind.to_owned(),
                    trace.rejected().to_string(),
                    events.to_string(),
                    trace.events(EventKind::Lost).count().to_string(),
                    end.outcome_text(),
                    if missing == 0 { "yes".to_owned() } else { format!("**no**, {missing} ticks missing") },
                ]);
            }
        }
    }
    let listed = |names: &[String]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let expectations = vec![
        Expectation::new(
            "runs with bad messages that do not complete, or without a whole log",
            "none",
            listed(&incomplete),
            incomplete.is_empty(),
        ),
        Expectation::new("bad messages that no process rejects", "none", listed(&unnoticed), unnoticed.is_empty()),
    ];
    DocumentPart { tables: vec![("refusals", format!("{}\n{}", verdict(&expectations), table(&head, &rows)))], expectations }
}
