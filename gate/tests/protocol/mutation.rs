//! The pure functions, and what they would be if one rule were broken.

use crate::seat::{NOW_MS, POLICY};
use hapfic_gate::protocol::{Action, Choice, Observed, Patience, Protocol, Wishes};
use hapfic_gate::restart::{Life, Order, Sign, Stage};
use hapfic_messages::Severity;

/// What is wrong with a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mutation {
    /// Takes the primary's request although only the other one has answered.
    TakesUnasked,
    /// Does not look at the other one's request when the primary is late.
    IgnoresStandby,
    /// Has a deadline in lockstep.
    LockstepWithDeadline,
    /// Brakes at the first missed tick.
    BrakesAtOnce,
    /// Repeats for ever.
    NeverBrakes,
    /// Leaves a stop by itself.
    Unlatched,
    /// Does not hear a stop.
    DeafToStop,
    /// Does not hear the operator re-arm.
    DeafToRearm,
    /// Keeps the primary.
    NeverPromotes,
    /// Makes everyone primary who is taken once.
    PromotesAtOnce,
    /// Clears a brake at the first good tick.
    ClearsAtOnce,
    /// Clears no brake.
    NeverClears,
    /// Restarts without end.
    NoBudget,
    /// Starts a process again whose budget is spent.
    RisesAgain,
    /// Does not tell that a budget is spent.
    SpentInSilence,
    /// A life that forgets nothing when the operator re-arms.
    LifeDeafToRearm,
}

/// [`Protocol::choose`].
pub fn choose(mutation: Option<Mutation>, protocol: &Protocol, seen: &Observed, patience: Patience) -> Choice {
    let patience = match mutation {
        Some(Mutation::LockstepWithDeadline) => Patience::Deadline,
        _ => patience,
    };
    match (mutation, protocol.choose(seen, patience)) {
        (Some(Mutation::TakesUnasked), Choice::Take(place)) if place != protocol.primary => Choice::Take(protocol.primary),
        (Some(Mutation::IgnoresStandby), Choice::Take(place)) if place != protocol.primary && seen.overdue => Choice::Miss,
        (_, choice) => choice,
    }
}

/// [`Protocol::step`].
pub fn step(
    mutation: Option<Mutation>,
    protocol: Protocol,
    choice: Choice,
    seen: &Observed,
    wishes: &Wishes,
) -> (Protocol, Option<Action>) {
    let mut wishes = *wishes;
    match mutation {
        Some(Mutation::DeafToStop) => wishes.stop = false,
        Some(Mutation::DeafToRearm) => wishes.rearm = false,
        _ => {}
    }
    let (mut next, mut action) = protocol.step(choice, seen, &wishes);
    match mutation {
        Some(Mutation::BrakesAtOnce) if choice == Choice::Miss && next.severity == Severity::Degraded => {
            next.severity = Severity::Brake;
            action = Some(Action::Brake);
        }
        Some(Mutation::NeverBrakes) if next.severity == Severity::Brake && choice == Choice::Miss => {
            next.severity = Severity::Degraded;
            action = Some(Action::Repeat);
        }
        Some(Mutation::Unlatched) if protocol.severity == Severity::Stopped && !wishes.stop => next.severity = Severity::Brake,
        Some(Mutation::NeverPromotes) => next.primary = protocol.primary,
        Some(Mutation::PromotesAtOnce) => {
            if let Choice::Take(place) = choice {
                next.primary = place;
            }
        }
        Some(Mutation::ClearsAtOnce) => {
            if let (Severity::Brake, Choice::Take(place)) = (next.severity, choice) {
                next.severity = Severity::Nominal;
                action = Some(Action::Pass(place));
            }
        }
        Some(Mutation::NeverClears) if protocol.severity == Severity::Brake && next.severity < Severity::Brake => {
            next.severity = Severity::Brake;
            if let Choice::Take(place) = choice {
                action = Some(Action::Withhold(place));
            }
        }
        _ => {}
    }
    (next, action)
}

/// [`Life::after`], now.
pub fn live(mutation: Option<Mutation>, life: Life, sign: Sign) -> (Life, Option<Order>) {
    if mutation == Some(Mutation::LifeDeafToRearm) && sign == Sign::Rearmed {
        return (life, None);
    }
    let before = life.stage;
    let (mut after, mut order) = life.after(sign, NOW_MS, &POLICY);
    match mutation {
        Some(Mutation::NoBudget) if order == Some(Order::Stop) => {
            after.stage = Stage::Due(NOW_MS);
            order = None;
        }
        Some(Mutation::RisesAgain) if before == Stage::GivenUp && sign == Sign::Time => {
            after.stage = Stage::Starting;
            order = Some(Order::Start);
        }
        Some(Mutation::SpentInSilence) if order == Some(Order::Stop) => order = None,
        _ => {}
    }
    (after, order)
}
