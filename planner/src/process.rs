//! The planner as a process: state(k) in, reference(k + 1) out, one tick ahead, so that the controller never waits for it.
//!
//! While the drive is not under torque (before the first command, and braking) the reference is where the foot is.

use crate::{PlannerParameters, hold, setpoint, step};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_ipc::message::{Command, Mode, Operator, PlannerState, Reference, State};
use hapfic_ipc::realtime::Wish;
use hapfic_ipc::{Clock, Context, Input, IpcError, Output, Recent, Tick, Wait, clock, topic};

/// Ticks by which a plan may lag behind and still be stepped through; beyond, the motion starts anew from where it is held.
const CATCH_UP: i64 = 4;

struct Ports {
    state: Input<State>,
    command: Input<Command>,
    operator: Input<Operator>,
    reference: Output<Reference>,
}

/// A plan and the tick it is for.
#[derive(Clone, Copy, Debug)]
struct Plan {
    tick: i64,
    state: PlannerState,
}

/// Runs the planner until its last tick or its end.
///
/// # Errors
/// [`IpcError`] if messaging fails.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), IpcError> {
    let mut ports = Ports {
        state: context.bus.input(&topic::STATE, Wait::Yes)?,
        command: context.bus.input(&topic::COMMAND, if context.clock == Clock::Lockstep { Wait::Yes } else { Wait::No })?,
        operator: context.bus.input(&topic::OPERATOR, Wait::No)?,
        reference: context.bus.output(&topic::REFERENCE)?,
    };
    context.ready(Wish::new(settings.realtime.priority_planner, settings.realtime.core_planner))?;
    let last_tick = settings.duration_ticks as i64 - 1;
    let mut plan: Option<Plan> = None;
    let mut commands = Recent::<Command>::default();
    let mut operator: Option<Operator> = None;
    let mut seen = -1;

    while let Some(state) = context.next_state(&mut ports.state, seen, || ports.reference.prepare())? {
        let wake = clock::now_ns();
        context.begin();
        seen = state.tick;
        if !take_command(context, &mut ports, &mut commands, state.tick - 1)? {
            break;
        }
        context.drain(&mut ports.operator, |new| operator = Some(new))?;
        let Some(parameters) = operator.map(|o| *o.at(state.tick + 1)) else {
            // Nobody has said what to do yet.
            context.refuse();
            continue;
        };
        let active = commands.before(state.tick).is_some_and(|c| c.mode == Mode::Active.code());
        if state.tick == 0 {
            // Tick 0 has no tick before it in which its reference could have been made.
            let first = Plan { tick: 0, state: hold(state.foot_position) };
            plan = Some(first);
            send(context, &mut ports, &first, parameters.version)?;
        }
        let next = match plan {
            Some(p) if active && state.tick + 1 - p.tick <= CATCH_UP => advance(p, state.tick + 1, operator),
            Some(p) if active => {
                // Long away: the controllers have held the last position since.
                let held = Plan { tick: state.tick, state: hold(setpoint(&p.state, PERIOD_S).position_m) };
                advance(held, state.tick + 1, operator)
            }
            _ => Plan { tick: state.tick + 1, state: hold(state.foot_position) },
        };
        plan = Some(next);
        let mut published = 0;
        if next.tick <= last_tick {
            published = send(context, &mut ports, &next, parameters.version)?;
        }
        context.account(Tick {
            tick: state.tick,
            due_ns: state.stamp_ns,
            wake_ns: wake,
            publish_ns: published,
            latency_ns: 0,
        })?;
        ports.reference.prepare();
        if state.tick >= last_tick {
            context.finish(state.tick)?;
            break;
        }
    }
    Ok(())
}

fn send(context: &Context, ports: &mut Ports, plan: &Plan, parameters_version: u64) -> Result<u64, IpcError> {
    let out = setpoint(&plan.state, PERIOD_S);
    ports.reference.send(&Reference {
        stamp_ns: context.stamp(),
        tick: plan.tick,
        parameters_version,
        position: out.position_m,
        velocity: out.velocity_m_per_s,
        planner: plan.state,
    })
}

/// Steps a plan up to a tick, each tick with the parameters in force at it.
fn advance(mut plan: Plan, tick: i64, operator: Option<Operator>) -> Plan {
    while let Some(operator) = operator.filter(|_| plan.tick < tick) {
        let p = operator.at(plan.tick + 1);
        let parameters = PlannerParameters { mean_speed_m_per_s: p.mean_speed, max_acceleration_m_per_s2: p.max_acceleration };
        plan.state = step(plan.state, p.target_position, &parameters, PERIOD_S).0;
        plan.tick += 1;
    }
    plan
}

/// Takes the commands there are; in lockstep waits for the one of `tick`. Says whether to go on.
fn take_command(context: &mut Context, ports: &mut Ports, commands: &mut Recent<Command>, tick: i64) -> Result<bool, IpcError> {
    loop {
        context.drain(&mut ports.command, |new| commands.keep(new))?;
        if context.clock == Clock::Realtime || commands.at(tick).is_some() {
            return Ok(true);
        }
        ports.reference.prepare();
        if !context.wait(&[&ports.command], tick)? {
            return Ok(false);
        }
    }
}
