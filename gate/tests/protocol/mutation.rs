//! The pure functions under test, and their mutants that each break a rule.

use crate::slot::{NOW_MS, POLICY};
use hapfic_gate::protocol::{Choice, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use hapfic_gate::restart_policy::{RestartAction, RestartSignal, RestartStage, RestartState};
use hapfic_messages::Severity;

/// Defect of a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mutation {
    /// Takes the primary's request although only the other controller has answered.
    TakesUnanswered,
    /// Ignores the other controller's request when the primary is late.
    IgnoresStandby,
    /// Has a deadline in lockstep.
    LockstepWithDeadline,
    /// Brakes at the first missed tick.
    BrakesAtFirstMiss,
    /// Repeats without end.
    NeverBrakes,
    /// Leaves a stop by itself.
    Unlatched,
    /// Ignores a stop.
    IgnoresStop,
    /// Ignores a re-arm.
    IgnoresRearm,
    /// Keeps the primary.
    NeverPromotes,
    /// Promotes the other controller at its first answer.
    PromotesAtFirstMiss,
    /// Clears a brake at the first good tick.
    ClearsAtFirstGoodTick,
    /// Clears no brake.
    NeverClears,
    /// Restarts without end.
    NoBudget,
    /// Restarts a process whose budget is spent.
    RestartsWhenSpent,
    /// Spends a budget without a stop.
    SpentWithoutStop,
    /// Keeps the restarts of a slot when the operator re-arms.
    RestartIgnoresRearm,
}

/// [`Protocol::choose`].
pub fn choose(mutation: Option<Mutation>, protocol: &Protocol, seen: &Observation, policy: WaitPolicy) -> Choice {
    let policy = match mutation {
        Some(Mutation::LockstepWithDeadline) => WaitPolicy::Deadline,
        _ => policy,
    };
    match (mutation, protocol.choose(seen, policy)) {
        (Some(Mutation::TakesUnanswered), Choice::Take(slot)) if slot != protocol.primary => Choice::Take(protocol.primary),
        (Some(Mutation::IgnoresStandby), Choice::Take(slot)) if slot != protocol.primary && seen.overdue => Choice::Miss,
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
        Some(Mutation::IgnoresStop) => inputs.stop = false,
        Some(Mutation::IgnoresRearm) => inputs.rearm = false,
        _ => {}
    }
    let (mut next, mut action) = protocol.step(choice, seen, &inputs);
    match mutation {
        Some(Mutation::BrakesAtFirstMiss) if choice == Choice::Miss && next.severity == Severity::Degraded => {
            next.severity = Severity::Brake;
            action = Some(TickAction::Brake);
        }
        Some(Mutation::NeverBrakes) if next.severity == Severity::Brake && choice == Choice::Miss => {
            next.severity = Severity::Degraded;
            action = Some(TickAction::Repeat);
        }
        Some(Mutation::Unlatched) if protocol.severity == Severity::Stopped && !inputs.stop => next.severity = Severity::Brake,
        Some(Mutation::NeverPromotes) => next.primary = protocol.primary,
        Some(Mutation::PromotesAtFirstMiss) => {
            if let Choice::Take(slot) = choice {
                next.primary = slot;
            }
        }
        Some(Mutation::ClearsAtFirstGoodTick) => {
            if let (Severity::Brake, Choice::Take(slot)) = (next.severity, choice) {
                next.severity = Severity::Nominal;
                action = Some(TickAction::Pass(slot));
            }
        }
        Some(Mutation::NeverClears) if protocol.severity == Severity::Brake && next.severity < Severity::Brake => {
            next.severity = Severity::Brake;
            if let Choice::Take(slot) = choice {
                action = Some(TickAction::Suppress(slot));
            }
        }
        _ => {}
    }
    (next, action)
}

/// [`RestartState::after`] at [`NOW_MS`].
pub fn restart_after(
    mutation: Option<Mutation>,
    restart: RestartState,
    signal: RestartSignal,
) -> (RestartState, Option<RestartAction>) {
    if mutation == Some(Mutation::RestartIgnoresRearm) && signal == RestartSignal::Rearmed {
        return (restart, None);
    }
    let before = restart.stage;
    let (mut after, mut action) = restart.after(signal, NOW_MS, &POLICY);
    match mutation {
        Some(Mutation::NoBudget) if action == Some(RestartAction::Stop) => {
            after.stage = RestartStage::BackOff(NOW_MS);
            action = None;
        }
        Some(Mutation::RestartsWhenSpent) if before == RestartStage::BudgetSpent && signal == RestartSignal::Time => {
            after.stage = RestartStage::Starting;
            action = Some(RestartAction::Start);
        }
        Some(Mutation::SpentWithoutStop) if action == Some(RestartAction::Stop) => action = None,
        _ => {}
    }
    (after, action)
}
