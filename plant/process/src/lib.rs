//! Plant process: the clock of the stack.
//!
//! At tick k the plant publishes state(k), accepts command(k - 1), and advances under it, while controller and gate
//! already work on state(k). The first tick waits for the gate's command(-1).

mod error;

pub use error::PlantProcessError;
use hapfic_config::{OnLoss, Settings};
use hapfic_ipc::inject::Injector;
use hapfic_ipc::realtime::SchedRequest;
use hapfic_ipc::{Context, DeadlineTimer, Input, IpcError, Output, PlantMemory, TickTimes, Wait, clock, poll, topic, wait};
use hapfic_messages::{Clock, Command, Credit, PERIOD_NS, State, TickBuffer};
use hapfic_plant::Plant;
use std::time::Duration;

/// Wait for the answer to a state before the simulation starts.
///
/// The plant has the highest priority: on a shared core it would otherwise delay controller and gate.
const ANSWER_TIMEOUT: Duration = Duration::from_micros(300);

/// Busy-poll window for a command after the controller has woken the plant [ns]; the gate works on the request by then.
const BUSY_POLL_NS: u64 = 30_000;

struct PlantPorts {
    state: Output<State>,
    injector: Injector<State>,
    command: Input<Command>,
    credit: Input<Credit>,
    commands: TickBuffer<Command>,
    /// What the engine remembers beside a state, for a successor.
    memory: Option<PlantMemory>,
}

impl PlantPorts {
    /// Receives all pending commands.
    fn read(&mut self, context: &mut Context) -> Result<(), IpcError> {
        let commands = &mut self.commands;
        context.drain(&mut self.command, |new| insert_first(commands, new))
    }

    /// Receives commands up to the one that answers `tick`.
    fn read_answer(&mut self, context: &mut Context, tick: i64) -> Result<(), IpcError> {
        let commands = &mut self.commands;
        context.take_until(&mut self.command, |new| {
            insert_first(commands, new);
            new.tick >= tick
        })
    }

    /// Work of the idle time after a tick.
    fn idle_work(&mut self) -> Result<(), IpcError> {
        self.state.preloan();
        self.command.update_connections();
        self.injector.listen()
    }

    /// Keeps what a successor needs beside the state of a tick.
    fn keep_memory(&self, plant: &Plant, tick: i64) {
        if let Some(memory) = &self.memory
            && let Some(bytes) = plant.memory()
        {
            memory.keep(tick, &bytes);
        }
    }

    /// Passes the command that is due at `tick` to the drive. A command that answers the state of `tick` is not due
    /// yet.
    fn pass_command(&self, plant: &mut Plant, tick: i64) {
        if let Some(command) = self.commands.before(tick) {
            plant.take(command);
        }
    }
}

/// Inserts a command, unless one of its tick is there: of two gates the first counts.
fn insert_first(commands: &mut TickBuffer<Command>, new: Command) {
    if commands.at(new.tick).is_none() {
        commands.insert(new);
    }
}

/// Runs the plant until its last tick or a request to end.
///
/// # Errors
/// [`PlantProcessError`] if the world cannot be built, messaging fails or the simulation leaves the finite numbers.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), PlantProcessError> {
    let mut ports = PlantPorts {
        state: context.output(&topic::STATE)?,
        injector: Injector::open(context)?,
        command: context.bus.input(&topic::COMMAND, Wait::Yes)?,
        credit: context.bus.input(&topic::CREDIT, Wait::Yes)?,
        commands: TickBuffer::default(),
        memory: None,
    };
    let mut plant = Plant::new(settings)?;
    if settings.plant.on_loss == OnLoss::Restart && plant.memory().is_some() {
        ports.memory = Some(context.bus.plant_memory()?);
    }
    context.ready(SchedRequest::new(settings.realtime.priority_plant, settings.realtime.core_plant))?;
    while ports.commands.newest().is_none() {
        if !context.wait(&[&ports.command], -1)? {
            return Ok(());
        }
        ports.read(context)?;
        // All processes have started: connect before the first tick.
        ports.state.preloan();
    }
    let resumed = context.continue_behind_predecessor(&topic::STATE, &mut ports.state)?;
    if resumed.is_none() {
        ports.keep_memory(&plant, 0);
    }
    if let Some(state) = &resumed {
        let memory = ports.memory.as_ref().and_then(|memory| memory.of(state.tick));
        plant.resume(state, memory.as_deref())?;
    }
    let ticks = settings.duration_ticks as i64;
    match context.clock {
        Clock::Realtime => realtime(context, settings, &mut plant, &mut ports, resumed)?,
        Clock::Lockstep => lockstep(context, &mut plant, &mut ports, resumed, ticks)?,
    }
    context.finish(ticks - 1)?;
    Ok(())
}

fn realtime(
    context: &mut Context,
    settings: &Settings,
    plant: &mut Plant,
    ports: &mut PlantPorts,
    resumed: Option<State>,
) -> Result<(), PlantProcessError> {
    let doorbell = context.bus.doorbell(topic::COMMAND_DOORBELL);
    let deadline_timer = context.deadline_timer("hapfic-plant-dl", doorbell, PERIOD_NS, settings.realtime.priority_plant)?;
    // Two periods for the start-up work of the other processes.
    let start_ns = clock::now_ns() + 2 * PERIOD_NS;
    let (first, mut slipped) = match &resumed {
        // The periods without a plant count as slipped.
        Some(last) => (last.tick, last.slipped + start_ns.saturating_sub(last.stamp_ns) / PERIOD_NS),
        None => (0, 0),
    };
    // Time at which tick 0 would have been due without slips.
    let tick_0_ns = start_ns.wrapping_sub((first as u64 + slipped) * PERIOD_NS);
    for tick in first..settings.duration_ticks as i64 {
        let due = tick_0_ns.wrapping_add((tick as u64 + slipped) * PERIOD_NS);
        let mut wake = clock::now_ns();
        while wake < due {
            clock::sleep_until(due);
            wake = clock::now_ns();
            if !context.running() {
                return Ok(());
            }
        }
        context.begin();
        let lateness = wake - due;
        // A lateness of a period or more is a slip: no burst of ticks catches up.
        slipped += lateness / PERIOD_NS;
        let mut state = plant.sample();
        state.wake_lateness_ns = lateness;
        state.slipped = slipped;
        state.stamp_ns = clock::now_ns();
        // From here on a notification may belong to the answer.
        ports.command.discard_notifications();
        let published = ports.injector.send(&mut ports.state, &state, tick)?;
        // The previous tick has usually received it. Reading here delays controller and gate on a shared core.
        if ports.commands.at(tick - 1).is_none() {
            ports.read(context)?;
        }
        // A command that arrives from here on is too late for this tick.
        let due_tick = ports.commands.before(tick).map(|command| command.tick);
        let latency_ns = await_answer(context, ports, &deadline_timer, tick, published)?;
        if let Some(command) = due_tick.and_then(|tick| ports.commands.at(tick)) {
            plant.take(command);
        }
        plant.advance()?;
        ports.keep_memory(plant, tick + 1);
        context.account(TickTimes { tick, due_ns: due, wake_ns: wake, publish_ns: published, latency_ns })?;
        ports.idle_work()?;
        if !context.running() {
            return Ok(());
        }
    }
    Ok(())
}

/// Waits for the command that answers `tick` until a timeout; returns the latency [ns], zero without an answer.
fn await_answer(
    context: &mut Context,
    ports: &mut PlantPorts,
    deadline_timer: &DeadlineTimer,
    tick: i64,
    published: u64,
) -> Result<u64, IpcError> {
    // Zero: fault injection has suppressed the state, so the timeout starts now.
    let sent = if published == 0 { clock::now_ns() } else { published };
    let end = sent + ANSWER_TIMEOUT.as_nanos() as u64;
    deadline_timer.set(end);
    loop {
        // Woken by a command, by the controller before the command, by the deadline timer, or by a signal.
        wait(&[&ports.command], Duration::MAX)?;
        let woken = clock::now_ns();
        ports.read_answer(context, tick)?;
        if ports.commands.at(tick).is_none() && woken < end && poll(&[&ports.command], woken + BUSY_POLL_NS) {
            ports.read_answer(context, tick)?;
        }
        let now = clock::now_ns();
        if ports.commands.at(tick).is_some() {
            deadline_timer.clear();
            return Ok(if published == 0 { 0 } else { now - published });
        }
        if now >= end || !context.running() {
            return Ok(0);
        }
    }
}

fn lockstep(
    context: &mut Context,
    plant: &mut Plant,
    ports: &mut PlantPorts,
    resumed: Option<State>,
    ticks: i64,
) -> Result<(), PlantProcessError> {
    let mut credit = -1;
    let mut last_published = resumed;
    for tick in last_published.map_or(0, |state| state.tick)..ticks {
        while credit < tick {
            let before = credit;
            // Of several recorders, one after the other, the largest counts: the newest message may be an old one's.
            while let Some(new) = ports.credit.next()? {
                credit = credit.max(new.tick);
            }
            if credit > before {
                continue;
            }
            if !context.wait(&[&ports.credit], tick)? {
                return Ok(());
            } else {
                ports.state.preloan();
            }
        }
        context.begin();
        let due = clock::now_ns();
        // A successor republishes the last state of its predecessor, for processes that missed it.
        let state = last_published.take().unwrap_or_else(|| plant.sample());
        let published = ports.injector.send(&mut ports.state, &state, tick)?;
        loop {
            ports.read(context)?;
            if ports.commands.at(tick - 1).is_some() {
                break;
            }
            // A process that connects late receives the last state here.
            ports.state.preloan();
            if !context.wait(&[&ports.command], tick)? {
                return Ok(());
            }
        }
        ports.pass_command(plant, tick);
        plant.advance()?;
        ports.keep_memory(plant, tick + 1);
        context.account(TickTimes { tick, due_ns: due, wake_ns: due, publish_ns: published, latency_ns: 0 })?;
        ports.idle_work()?;
    }
    Ok(())
}
