//! Process of the planner: state(k) in, reference(k + 1) out, one tick ahead, so that the controller never waits for
//! it.
//!
//! While the drive is not under torque (before the first command, and while braking) the reference is the position of
//! the foot.

use hapfic_config::Settings;
use hapfic_ipc::inject::Injector;
use hapfic_ipc::realtime::SchedRequest;
use hapfic_ipc::{Context, Gaps, Input, IpcError, Output, TickTimes, Wait, Wakes, clock, topic};
use hapfic_messages::{Clock, Command, Mode, Operator, Reference, State, TickBuffer};
use hapfic_planner::TickPlan;

struct PlannerPorts {
    state: Input<State>,
    command: Input<Command>,
    operator: Input<Operator>,
    reference: Output<Reference>,
    injector: Injector<Reference>,
}

/// Runs the planner until the last tick or the end of the process.
///
/// # Errors
/// [`IpcError`] if messaging fails.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), IpcError> {
    let mut ports = PlannerPorts {
        state: context.bus.input(&topic::STATE, Wait::Yes)?,
        command: context.bus.input(&topic::COMMAND, if context.clock == Clock::Lockstep { Wait::Yes } else { Wait::No })?,
        operator: context.bus.input(&topic::OPERATOR, Wait::No)?,
        reference: context.output(&topic::REFERENCE)?,
        injector: Injector::open(context)?,
    };
    context.ready(SchedRequest::new(settings.realtime.priority_planner, settings.realtime.core_planner))?;
    let last_tick = settings.duration_ticks as i64 - 1;
    let mut plan: Option<TickPlan> = None;
    let mut commands = TickBuffer::<Command>::default();
    let mut operator: Option<Operator> = None;
    let mut seen = -1;
    if let Some(last) = context.continue_behind_predecessor(&topic::REFERENCE, &mut ports.reference)? {
        plan = Some(TickPlan::resumed(&last));
        // Its state was that of the previous tick.
        seen = last.tick - 1;
    }

    let command_sent = (context.clock == Clock::Realtime).then(|| context.bus.listener(topic::COMMAND_SENT));
    let instead = command_sent.as_ref().map(|listener| listener as &dyn Wakes);
    while let Some(state) = context.next_state(&mut ports.state, seen, Gaps::Never, instead, || {
        ports.reference.preloan();
        ports.command.update_connections();
        ports.operator.update_connections();
    })? {
        let wake = clock::now_ns();
        context.begin();
        seen = state.tick;
        if !receive_inputs(context, &mut ports, &mut commands, &mut operator, state.tick - 1)? {
            break;
        }
        let last = commands.before(state.tick);
        let Some(operator) = operator.filter(|sets| last.is_none_or(|command| sets.includes(command))) else {
            // No parameter sets yet, or old ones of the other gate.
            context.reject();
            continue;
        };
        let parameters = operator.at(state.tick + 1);
        let active = last.is_some_and(|c| c.mode == Mode::Active.code());
        if state.tick == 0 {
            // Tick 0 has no previous tick that could plan its reference.
            let first = TickPlan::at_rest(0, &state, parameters.is_pose());
            plan = Some(first);
            send(context, &mut ports, &first, parameters.version)?;
        }
        let next = TickPlan::next(plan, &state, active, &operator);
        plan = Some(next);
        let mut published = 0;
        if next.tick <= last_tick {
            published = send(context, &mut ports, &next, parameters.version)?;
        }
        context.account(TickTimes {
            tick: state.tick,
            due_ns: state.stamp_ns,
            wake_ns: wake,
            publish_ns: published,
            latency_ns: 0,
        })?;
        ports.reference.preloan();
        ports.state.update_connections();
        ports.command.update_connections();
        ports.injector.listen()?;
        if state.tick >= last_tick {
            context.finish(state.tick)?;
            break;
        }
    }
    Ok(())
}

fn send(context: &Context, ports: &mut PlannerPorts, plan: &TickPlan, parameters_version: u64) -> Result<u64, IpcError> {
    let reference = Reference { stamp_ns: context.stamp(), ..plan.reference(parameters_version) };
    ports.injector.send(&mut ports.reference, &reference, plan.tick)
}

/// Receives all inputs; in lockstep waits for the command of `tick` and for the parameter sets that hold after it.
///
/// Returns `false` if the process must end.
fn receive_inputs(
    context: &mut Context,
    ports: &mut PlannerPorts,
    commands: &mut TickBuffer<Command>,
    operator: &mut Option<Operator>,
    tick: i64,
) -> Result<bool, IpcError> {
    loop {
        context.drain(&mut ports.command, |new| commands.insert(new))?;
        context.drain(&mut ports.operator, |new| Operator::take_newer(operator, new))?;
        let command = commands.at(tick);
        let complete = command.zip(operator.as_ref()).is_some_and(|(command, sets)| sets.includes(command));
        if context.clock == Clock::Realtime || complete {
            return Ok(true);
        }
        ports.reference.preloan();
        if !context.wait(&[&ports.command], tick)? {
            return Ok(false);
        }
    }
}
