//! Rules that hold at every step, from what is visible outside: they keep their own counts, and share no constant with
//! the code under test.

use crate::stack::{StackModel, StackState};
use hapfic_gate::protocol::{Choice, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use hapfic_messages::Severity;
use stateright::Property;

/// Missed ticks in a row at which the drive brakes.
const BRAKE_MISSES: u8 = 2;
/// Good ticks in a row after which degraded and brake clear.
const GOOD: u8 = 20;
/// Ticks in a row answered by the other controller only, after which it is the primary.
const PRIMARY_MISSES: u8 = 3;

macro_rules! rules {
    ($($(#[$doc:meta])* $rule:ident = $name:literal;)+) => {
        /// Rule; its number is its bit in [`BrokenRules`].
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Rule {
            $($(#[$doc])* $rule,)+
        }

        impl Rule {
            /// Name of the property.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$rule => $name,)+
                }
            }

            /// All rules as properties: no step breaks them.
            pub fn properties() -> Vec<Property<StackModel>> {
                vec![$(Property::always($name, |_: &StackModel, state: &StackState| state.broken.held(Rule::$rule)),)+]
            }
        }
    };
}

rules! {
    /// Each tick has one action, and torque only from a slot whose request for that tick was valid.
    OneSource = "one source for a tick";
    /// A tick gets torque if at least one request is valid, unless the drive already brakes.
    Torque = "torque while one answers";
    /// In lockstep no tick goes without a request.
    NeverWithout = "lockstep never goes without";
    /// Only two missed ticks in a row, or a stop, lead to brake or worse; the first missed tick repeats.
    BrakeCause = "a brake has its cause";
    /// At the second missed tick in a row the drive brakes.
    BrakeAtSecond = "the second miss brakes";
    /// Restarts of a slot within the window stay within the budget.
    Budget = "no restart storm";
    /// After the budget is spent, no process starts in the slot until the operator re-arms.
    Spent = "a spent budget starts nothing";
    /// A spent budget leads to a stop at the next tick.
    SpentStops = "a spent budget stops";
    /// A stop takes effect immediately and has its cause; only the operator leaves it, for brake.
    Latch = "a stop is latched";
    /// If the primary is gone, or missed three ticks, the other slot is primary from the next tick that it answers.
    HandOver = "hand-over when the primary is gone";
    /// The primary changes only then.
    PromotionCause = "no hand-over without cause";
    /// Degraded and brake clear only after twenty good ticks in a row.
    ClearCause = "nothing clears early";
    /// Twenty good ticks in a row clear them, down to the remaining cause.
    Clears = "twenty good ticks clear";
    /// The model, which keeps ages instead of times, has the same restarts as the code.
    Ages = "ages stand for times";
}

/// Rules that the last step broke, a bit for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct BrokenRules(u16);

impl BrokenRules {
    pub fn expect(&mut self, rule: Rule, held: bool) {
        if !held {
            self.0 |= 1 << (rule as u16);
        }
    }

    pub const fn held(self, rule: Rule) -> bool {
        self.0 & (1 << (rule as u16)) == 0
    }
}

/// The rules' own counts of the ticks so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct TickCounts {
    /// Whether any request has been used.
    opened: bool,
    /// Ticks missed in a row since then, up to [`BRAKE_MISSES`].
    misses: u8,
    /// Good ticks in a row, up to [`GOOD`]; restarts at the end of a stop.
    good: u8,
    /// Ticks of the other controller since the primary's last answer, up to [`PRIMARY_MISSES`].
    primary_misses: u8,
}

const fn implies(cause: bool, effect: bool) -> bool {
    !cause || effect
}

/// Gated tick.
#[derive(Clone, Copy, Debug)]
pub struct GatedTick {
    pub policy: WaitPolicy,
    pub before: Protocol,
    pub after: Protocol,
    pub seen: Observation,
    pub inputs: GateInputs,
    pub choice: Choice,
    pub action: Option<TickAction>,
}

impl TickCounts {
    /// Counts after a tick; writes the broken rules into `broken`.
    pub fn after(self, tick: &GatedTick, broken: &mut BrokenRules) -> Self {
        let mut now = self;
        match tick.choice {
            Choice::Take(slot) => {
                now.opened = true;
                now.misses = 0;
                now.good = (self.good + 1).min(GOOD);
                now.primary_misses = if slot == tick.before.primary { 0 } else { (self.primary_misses + 1).min(PRIMARY_MISSES) };
            }
            _ => {
                now.misses = if self.opened { (self.misses + 1).min(BRAKE_MISSES) } else { 0 };
                now.good = 0;
            }
        }
        now.validate(tick, broken);
        if tick.before.severity == Severity::Stopped && tick.after.severity < Severity::Stopped {
            now.good = 0;
        }
        if tick.before.primary != tick.after.primary {
            now.primary_misses = 0;
        }
        now
    }

    fn validate(&self, tick: &GatedTick, broken: &mut BrokenRules) {
        let GatedTick { before, after, seen, inputs, choice, action, .. } = *tick;
        let answered = seen.valid.contains(&true);
        let braked = before.severity >= Severity::Brake;
        broken.expect(
            Rule::OneSource,
            match action {
                Some(TickAction::Pass(slot) | TickAction::Suppress(slot)) => {
                    choice == Choice::Take(slot) && seen.valid[slot as usize]
                }
                Some(TickAction::Repeat | TickAction::Brake | TickAction::Hold) => choice == Choice::Miss,
                None => false,
            },
        );
        let passed = matches!(action, Some(TickAction::Pass(_)));
        broken.expect(Rule::Torque, implies(answered && !braked && !inputs.stop, passed));
        let used = matches!(action, Some(TickAction::Pass(_) | TickAction::Suppress(_)));
        broken.expect(Rule::NeverWithout, implies(tick.policy == WaitPolicy::Lockstep, used));

        let brakes = after.severity >= Severity::Brake;
        let second = self.misses >= BRAKE_MISSES;
        let first = self.misses == 1 && !braked && !inputs.stop;
        let off = matches!(action, Some(TickAction::Brake | TickAction::Suppress(_)));
        broken.expect(Rule::BrakeCause, implies(!braked && brakes, second || inputs.stop));
        broken.expect(Rule::BrakeCause, implies(first, action == Some(TickAction::Repeat)));
        broken.expect(Rule::BrakeCause, implies(off, brakes));
        broken.expect(Rule::BrakeAtSecond, implies(second, brakes && action == Some(TickAction::Brake)));

        let (was_stopped, stopped) = (before.severity == Severity::Stopped, after.severity == Severity::Stopped);
        broken.expect(Rule::Latch, implies(inputs.stop, stopped));
        broken.expect(Rule::Latch, implies(stopped && !was_stopped, inputs.stop));
        let to_brake = inputs.rearm && after.severity == Severity::Brake;
        broken.expect(Rule::Latch, implies(was_stopped && !stopped, to_brake));
        self.validate_primary(tick, broken);

        let clearable = matches!(before.severity, Severity::Degraded | Severity::Brake);
        let good = self.good >= GOOD;
        broken.expect(Rule::ClearCause, implies(clearable && after.severity < before.severity, good));
        let left = if inputs.missing { Severity::Degraded } else { Severity::Nominal };
        broken.expect(Rule::Clears, implies(clearable && good && !inputs.stop, after.severity == left));
    }

    fn validate_primary(&self, tick: &GatedTick, broken: &mut BrokenRules) {
        let (old, new) = (tick.before.primary, tick.after.primary);
        let other_taken = tick.choice == Choice::Take(old.other());
        let due = other_taken && (!tick.seen.present[old as usize] || self.primary_misses >= PRIMARY_MISSES);
        broken.expect(Rule::HandOver, implies(due, new == old.other()));
        broken.expect(Rule::PromotionCause, implies(new != old, due));
    }
}
