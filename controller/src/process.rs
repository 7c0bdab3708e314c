//! The controller as a process: state(k), reference(k) and command(k - 1) in, request(k) out.
//!
//! It keeps nothing from tick to tick: the controller's state comes with the command, as the gate accepted it. So any number of
//! controllers compute the same, and one that starts late needs no seeding.

use crate::answer::{Known, answer};
use crate::error::ControllerError;
use hapfic_config::Settings;
use hapfic_ipc::message::{Command, Operator, Process, Reference, Request, State};
use hapfic_ipc::realtime::Wish;
use hapfic_ipc::{Clock, Context, Input, IpcError, Output, Recent, Tick, Wait, clock, topic};
use hapfic_robot::Chain;
use nalgebra::Vector3;

struct Ports {
    state: Input<State>,
    reference: Input<Reference>,
    command: Input<Command>,
    operator: Input<Operator>,
    request: Output<Request>,
}

/// What has come in.
#[derive(Clone, Copy, Debug, Default)]
struct Inbox {
    /// The planner is one tick ahead, so the newest is not the one to follow.
    references: Recent<Reference>,
    commands: Recent<Command>,
    operator: Option<Operator>,
}

impl Inbox {
    /// The reference to follow at a tick: its own, or the last one held at rest, or (before any) where the foot is.
    fn setpoint(&self, state: &State) -> ([f64; 3], [f64; 3]) {
        if let Some(r) = self.references.at(state.tick) {
            return (r.position, r.velocity);
        }
        let held = self.references.before(state.tick).map_or(state.foot_position, |r| r.position);
        (held, [0.0; 3])
    }

    /// What there is to answer a state with; `None` if something is missing.
    fn known<'a>(&'a self, state: &'a State) -> Option<Known<'a>> {
        let parameters = self.operator.as_ref()?.at(state.tick);
        let command = self.commands.before(state.tick)?;
        let (reference_position, reference_velocity) = self.setpoint(state);
        Some(Known { state, reference_position, reference_velocity, parameters, carried: command.request.state })
    }
}

/// Runs a controller until its last tick or its end.
///
/// # Errors
/// [`ControllerError`] if the robot description is no good or messaging fails.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), ControllerError> {
    let in_step = if context.clock == Clock::Lockstep { Wait::Yes } else { Wait::No };
    let mut ports = Ports {
        state: context.bus.input(&topic::STATE, Wait::Yes)?,
        reference: context.bus.input(&topic::REFERENCE, in_step)?,
        command: context.bus.input(&topic::COMMAND, in_step)?,
        operator: context.bus.input(&topic::OPERATOR, Wait::No)?,
        request: context.bus.output(&topic::REQUEST)?,
    };
    let chain = Chain::from_settings(&settings.robot)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    // The standby gives way to the primary.
    let priority = settings.realtime.priority_controller - u32::from(context.process == Process::Standby);
    context.ready(Wish::new(priority, settings.realtime.core_controller))?;

    let last_tick = settings.duration_ticks as i64 - 1;
    let mut inbox = Inbox::default();
    let mut seen = -1;
    while let Some(state) = context.next_state(&mut ports.state, seen, || ports.request.prepare())? {
        let wake = clock::now_ns();
        context.begin();
        seen = state.tick;
        if !fill(context, &mut ports, &mut inbox, state.tick)? {
            break;
        }
        let mut published = 0;
        match inbox.known(&state).and_then(|known| answer(&chain, &gravity, &known, context.process)) {
            Some(request) => published = ports.request.send(&Request { stamp_ns: context.stamp(), ..request })?,
            None => context.refuse(),
        }
        context.account(Tick {
            tick: state.tick,
            due_ns: state.stamp_ns,
            wake_ns: wake,
            publish_ns: published,
            latency_ns: 0,
        })?;
        ports.request.prepare();
        if state.tick >= last_tick {
            context.finish(state.tick)?;
            break;
        }
    }
    Ok(())
}

/// Takes what there is; in lockstep waits for reference(k) and command(k - 1). Says whether to go on.
fn fill(context: &mut Context, ports: &mut Ports, inbox: &mut Inbox, tick: i64) -> Result<bool, IpcError> {
    loop {
        context.drain(&mut ports.reference, |new| inbox.references.keep(new))?;
        context.drain(&mut ports.command, |new| inbox.commands.keep(new))?;
        context.drain(&mut ports.operator, |new| inbox.operator = Some(new))?;
        let complete = inbox.references.at(tick).is_some() && inbox.commands.at(tick - 1).is_some() && inbox.operator.is_some();
        if context.clock == Clock::Realtime || complete {
            return Ok(true);
        }
        ports.request.prepare();
        if !context.wait(&[&ports.reference, &ports.command], tick)? {
            return Ok(false);
        }
    }
}
