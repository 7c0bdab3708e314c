//! The pure functions, and what they would be if one rule were broken.

use crate::seat::{NOW_MS, POLICY};
use hapfic_gate::protocol::{Choice, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use hapfic_gate::restart::{RestartAction, RestartSignal, RestartStage, RestartState};
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
    /// A restart that forgets nothing when the operator re-arms.
    LifeDeafToRearm,
}

/// [`Protocol::choose`].
pub fn choose(mutation: Option<Mutation>, protocol: &Protocol, seen: &Observation, policy: WaitPolicy) -> Choice {
    let policy = match mutation {
        Some(Mutation::LockstepWithDeadline) => WaitPolicy::Deadline,
        _ => policy,
    };
    match (mutation, protocol.choose(seen, policy)) {
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
    seen: &Observation,
    inputs: &GateInputs,
) -> (Protocol, Option<TickAction>) {
    let mut inputs = *inputs;
    match mutation {
        Some(Mutation::DeafToStop) => inputs.stop = false,
        Some(Mutation::DeafToRearm) => inputs.rearm = false,
        _ => {}
    }
    let (mut next, mut action) = protocol.step(choice, seen, &inputs);
    match mutation {
        Some(Mutation::BrakesAtOnce) if choice == Choice::Miss && next.severity == Severity::Degraded => {
            next.severity = Severity::Brake;
            action = Some(TickAction::Brake);
        }
        Some(Mutation::NeverBrakes) if next.severity == Severity::Brake && choice == Choice::Miss => {
            next.severity = Severity::Degraded;
            action = Some(TickAction::Repeat);
        }
        Some(Mutation::Unlatched) if protocol.severity == Severity::Stopped && !inputs.stop => next.severity = Severity::Brake,
        Some(Mutation::NeverPromotes) => next.primary = protocol.primary,
        Some(Mutation::PromotesAtOnce) => {
            if let Choice::Take(place) = choice {
                next.primary = place;
            }
        }
        Some(Mutation::ClearsAtOnce) => {
            if let (Severity::Brake, Choice::Take(place)) = (next.severity, choice) {
                next.severity = Severity::Nominal;
                action = Some(TickAction::Pass(place));
            }
        }
        Some(Mutation::NeverClears) if protocol.severity == Severity::Brake && next.severity < Severity::Brake => {
            next.severity = Severity::Brake;
            if let Choice::Take(place) = choice {
                action = Some(TickAction::Withhold(place));
            }
        }
        _ => {}
    }
    (next, action)
}

/// [`RestartState::after`], now.
pub fn live(mutation: Option<Mutation>, restart: RestartState, signal: RestartSignal) -> (RestartState, Option<RestartAction>) {
    if mutation == Some(Mutation::LifeDeafToRearm) && signal == RestartSignal::Rearmed {
        return (restart, None);
    }
    let before = restart.stage;
    let (mut after, mut action) = restart.after(signal, NOW_MS, &POLICY);
    match mutation {
        Some(Mutation::NoBudget) if action == Some(RestartAction::Stop) => {
            after.stage = RestartStage::BackOff(NOW_MS);
            action = None;
        }
        Some(Mutation::RisesAgain) if before == RestartStage::GivenUp && signal == RestartSignal::Time => {
            after.stage = RestartStage::Starting;
            action = Some(RestartAction::Start);
        }
        Some(Mutation::SpentInSilence) if action == Some(RestartAction::Stop) => action = None,
        _ => {}
    }
    (after, action)
}
