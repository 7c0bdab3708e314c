//! What has to hold at every step, told from what is seen from outside: the rules count for themselves and take no constant
//! from the code that they judge.

use crate::stack::{Stack, State};
use hapfic_gate::protocol::{Choice, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use hapfic_messages::Severity;
use stateright::Property;

/// Missed ticks in a row at which the drive brakes.
const MISSES: u8 = 2;
/// Good ticks in a row after which degraded and brake clear.
const GOOD: u8 = 20;
/// Ticks in a row in which only the other controller answered, after which it is the primary.
const ABSENT: u8 = 3;

macro_rules! rules {
    ($($(#[$doc:meta])* $rule:ident = $name:literal;)+) => {
        /// A rule, by the bit that tells that it was broken.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Rule {
            $($(#[$doc])* $rule,)+
        }

        impl Rule {
            /// The property's name.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$rule => $name,)+
                }
            }

            /// All rules as properties: none is ever broken.
            pub fn properties() -> Vec<Property<Stack>> {
                vec![$(Property::always($name, |_: &Stack, state: &State| state.broken.held(Rule::$rule)),)+]
            }
        }
    };
}

rules! {
    /// Each tick has one action, and torque only from a place whose request for that tick was valid.
    OneSource = "one source for a tick";
    /// While one controller's request is valid, and nothing brakes already, the tick gets torque.
    Torque = "torque while one answers";
    /// In lockstep no tick goes without a request.
    NeverWithout = "lockstep never goes without";
    /// Brake or worse is entered by two missed ticks in a row, or by a stop; the first missed tick repeats.
    BrakeCause = "a brake has its cause";
    /// At the second missed tick in a row the drive brakes.
    BrakeAtSecond = "the second miss brakes";
    /// Restarts of a place within the window stay within the budget.
    Budget = "no restart storm";
    /// Once the budget is spent nothing is started until the operator re-arms.
    Spent = "a spent budget starts nothing";
    /// Whoever has spent his budget is followed by a stop at the next tick.
    SpentStops = "a spent budget stops";
    /// A stop is taken in at once, has its cause, and is left only by the operator, for brake.
    Latch = "a stop is latched";
    /// If the primary is gone, or missed three ticks, the other one is primary from the next tick that it answers.
    HandOver = "hand-over when the primary is gone";
    /// The primary changes only then.
    PromotionCause = "no hand-over without cause";
    /// Degraded and brake get better only after twenty good ticks in a row.
    ClearCause = "nothing clears early";
    /// After twenty good ticks in a row they are cleared, down to what is still amiss.
    Clears = "twenty good ticks clear";
    /// The model, which keeps no time, only ages, has kept each restart as the code has.
    Ages = "ages stand for times";
}

/// Which rules the last step broke.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Broken(u16);

impl Broken {
    pub fn expect(&mut self, rule: Rule, held: bool) {
        if !held {
            self.0 |= 1 << (rule as u16);
        }
    }

    pub const fn held(self, rule: Rule) -> bool {
        self.0 & (1 << (rule as u16)) == 0
    }
}

/// The rules' own account of the ticks so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Account {
    /// Whether any request was ever used.
    opened: bool,
    /// Ticks missed in a row since then, up to [`MISSES`].
    misses: u8,
    /// Good ticks in a row, up to [`GOOD`]; anew from where a stop was left.
    good: u8,
    /// Ticks of the other controller since the primary's last one, up to [`ABSENT`].
    primary_misses: u8,
}

const fn implies(cause: bool, effect: bool) -> bool {
    !cause || effect
}

/// A tick that was gated.
#[derive(Clone, Copy, Debug)]
pub struct Gated {
    pub policy: WaitPolicy,
    pub before: Protocol,
    pub after: Protocol,
    pub seen: Observation,
    pub inputs: GateInputs,
    pub choice: Choice,
    pub action: Option<TickAction>,
}

impl Account {
    /// The account after a tick, and into `broken` what was wrong with the tick.
    pub fn after(self, tick: &Gated, broken: &mut Broken) -> Self {
        let mut now = self;
        match tick.choice {
            Choice::Take(place) => {
                now.opened = true;
                now.misses = 0;
                now.good = (self.good + 1).min(GOOD);
                now.primary_misses = if place == tick.before.primary { 0 } else { (self.primary_misses + 1).min(ABSENT) };
            }
            _ => {
                now.misses = if self.opened { (self.misses + 1).min(MISSES) } else { 0 };
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

    fn validate(&self, tick: &Gated, broken: &mut Broken) {
        let Gated { before, after, seen, inputs, choice, action, .. } = *tick;
        let answered = seen.valid.contains(&true);
        let braked = before.severity >= Severity::Brake;
        broken.expect(
            Rule::OneSource,
            match action {
                Some(TickAction::Pass(place) | TickAction::Withhold(place)) => {
                    choice == Choice::Take(place) && seen.valid[place as usize]
                }
                Some(TickAction::Repeat | TickAction::Brake | TickAction::Hold) => choice == Choice::Miss,
                None => false,
            },
        );
        let passed = matches!(action, Some(TickAction::Pass(_)));
        broken.expect(Rule::Torque, implies(answered && !braked && !inputs.stop, passed));
        let used = matches!(action, Some(TickAction::Pass(_) | TickAction::Withhold(_)));
        broken.expect(Rule::NeverWithout, implies(tick.policy == WaitPolicy::Lockstep, used));

        let brakes = after.severity >= Severity::Brake;
        let second = self.misses >= MISSES;
        let first = self.misses == 1 && !braked && !inputs.stop;
        let off = matches!(action, Some(TickAction::Brake | TickAction::Withhold(_)));
        broken.expect(Rule::BrakeCause, implies(!braked && brakes, second || inputs.stop));
        broken.expect(Rule::BrakeCause, implies(first, action == Some(TickAction::Repeat)));
        broken.expect(Rule::BrakeCause, implies(off, brakes));
        broken.expect(Rule::BrakeAtSecond, implies(second, brakes && action == Some(TickAction::Brake)));

        let (was_stopped, stopped) = (before.severity == Severity::Stopped, after.severity == Severity::Stopped);
        broken.expect(Rule::Latch, implies(inputs.stop, stopped));
        broken.expect(Rule::Latch, implies(stopped && !was_stopped, inputs.stop));
        let to_brake = inputs.rearm && after.severity == Severity::Brake;
        broken.expect(Rule::Latch, implies(was_stopped && !stopped, to_brake));
        self.judge_primary(tick, broken);

        let clearable = matches!(before.severity, Severity::Degraded | Severity::Brake);
        let good = self.good >= GOOD;
        broken.expect(Rule::ClearCause, implies(clearable && after.severity < before.severity, good));
        let left = if inputs.missing { Severity::Degraded } else { Severity::Nominal };
        broken.expect(Rule::Clears, implies(clearable && good && !inputs.stop, after.severity == left));
    }

    fn judge_primary(&self, tick: &Gated, broken: &mut Broken) {
        let (old, new) = (tick.before.primary, tick.after.primary);
        let other_taken = tick.choice == Choice::Take(old.other());
        let due = other_taken && (!tick.seen.present[old as usize] || self.primary_misses >= ABSENT);
        broken.expect(Rule::HandOver, implies(due, new == old.other()));
        broken.expect(Rule::PromotionCause, implies(new != old, due));
    }
}
