//! The plant as a process: the clock of the stack.
//!
//! At tick k it publishes state(k), takes command(k - 1), and advances under it, while controller and gate already work on
//! state(k). Everything starts with the gate's command(-1).

mod error;

pub use error::PlantProcessError;
use hapfic_config::Settings;
use hapfic_ipc::inject::Injector;
use hapfic_ipc::realtime::SchedRequest;
use hapfic_ipc::{Context, DeadlineTimer, Input, IpcError, Output, TickTimes, Wait, clock, poll, topic, wait};
use hapfic_messages::{Clock, Command, Credit, PERIOD_NS, State, TickBuffer};
use hapfic_plant::Plant;
use std::time::Duration;

/// How long the plant leaves the processor to those who answer its state before it simulates: on one core it would be in their
/// way, its priority being the highest.
const COURTESY: Duration = Duration::from_micros(300);

/// How long it looks out for a command once the controller has woken it, ns: the gate has the request by then, and is awake.
const ANY_MOMENT_NS: u64 = 30_000;

struct Ports {
    state: Output<State>,
    injector: Injector<State>,
    command: Input<Command>,
    credit: Input<Credit>,
    commands: TickBuffer<Command>,
}

impl Ports {
    /// Takes in the commands that have come.
    fn read(&mut self, context: &mut Context) -> Result<(), IpcError> {
        let commands = &mut self.commands;
        context.drain(&mut self.command, |new| commands.insert(new))
    }

    /// Takes in commands up to the one that answers a tick.
    fn read_answer(&mut self, context: &mut Context, tick: i64) -> Result<(), IpcError> {
        let commands = &mut self.commands;
        context.take_until(&mut self.command, |new| {
            commands.insert(new);
            new.tick >= tick
        })
    }

    /// What can be done while nobody waits for it.
    fn slack(&mut self, context: &mut Context) -> Result<(), IpcError> {
        self.state.preloan();
        self.command.preloan();
        context.report_failed_connections(
            self.state.failed_connections() + self.command.failed_connections() + self.credit.failed_connections(),
        );
        self.injector.listen()
    }

    /// Passes the command that is due at `tick` to the drive: never one that answers this tick's own state already.
    fn pass(&self, plant: &mut Plant, tick: i64) {
        if let Some(command) = self.commands.before(tick) {
            plant.take(command);
        }
    }
}

/// Runs the plant until its last tick or its end.
///
/// # Errors
/// [`PlantProcessError`] if the world cannot be built, messaging fails or the simulation leaves the numbers.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), PlantProcessError> {
    let mut ports = Ports {
        state: context.bus.output(&topic::STATE)?,
        injector: Injector::open(context)?,
        command: context.bus.input(&topic::COMMAND, Wait::Yes)?,
        credit: context.bus.input(&topic::CREDIT, Wait::Yes)?,
        commands: TickBuffer::default(),
    };
    let mut plant = Plant::new(settings)?;
    let handed_over = match context.start.resume {
        Some(tick) => Some(context.bus.input(&topic::STATE, Wait::Yes)?).zip(Some(tick)),
        None => None,
    };
    context.ready(SchedRequest::new(settings.realtime.priority_plant, settings.realtime.core_plant))?;
    while ports.commands.newest().is_none() {
        if !context.wait(&[&ports.command], -1)? {
            return Ok(());
        }
        ports.read(context)?;
        // Everyone is there by now: meet them before time counts.
        ports.state.preloan();
    }
    let mut resumed = None;
    if let Some((mut input, tick)) = handed_over {
        let Some(state) = context.handed_over(&mut input, |state: &State| state.tick == tick)? else { return Ok(()) };
        plant.resume(&state)?;
        resumed = Some(state);
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
    ports: &mut Ports,
    resumed: Option<State>,
) -> Result<(), PlantProcessError> {
    let doorbell = context.bus.doorbell(topic::COMMAND_DOORBELL);
    let deadline_timer = context.deadline_timer("hapfic-plant-dl", doorbell, PERIOD_NS, settings.realtime.priority_plant)?;
    // Two periods to get everyone's first steps out of the way.
    let begun = clock::now_ns() + 2 * PERIOD_NS;
    let (first, mut slipped) = match &resumed {
        // The periods in which there was no plant have slipped, too.
        Some(last) => (last.tick, last.slipped + begun.saturating_sub(last.stamp_ns) / PERIOD_NS),
        None => (0, 0),
    };
    // When tick 0 would have been due had nothing slipped.
    let start = begun.wrapping_sub((first as u64 + slipped) * PERIOD_NS);
    for tick in first..settings.duration_ticks as i64 {
        let due = start.wrapping_add((tick as u64 + slipped) * PERIOD_NS);
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
        // A whole period or more: time slips, and is not caught up by a burst of ticks.
        slipped += lateness / PERIOD_NS;
        let mut state = plant.sample();
        state.wake_lateness_ns = lateness;
        state.slipped = slipped;
        state.stamp_ns = clock::now_ns();
        // What is rung from here on may be the answer.
        ports.command.forget();
        let published = ports.injector.send(&mut ports.state, &state, tick)?;
        // Usually it is here already, having been awaited; whatever is read now costs those who wait for this state their processor.
        if ports.commands.at(tick - 1).is_none() {
            ports.read(context)?;
        }
        // One that comes from here on is too late for this tick.
        let due_now = ports.commands.before(tick).map(|command| command.tick);
        let answered = await_answer(context, ports, &deadline_timer, tick, published)?;
        if let Some(command) = due_now.and_then(|tick| ports.commands.at(tick)) {
            plant.take(command);
        }
        plant.advance()?;
        context.account(TickTimes { tick, due_ns: due, wake_ns: wake, publish_ns: published, latency_ns: answered })?;
        ports.slack(context)?;
        if !context.running() {
            return Ok(());
        }
    }
    Ok(())
}

/// Waits for the command that answers `tick`, for a while. Returns how long it took, ns; zero if it did not come.
fn await_answer(
    context: &mut Context,
    ports: &mut Ports,
    deadline_timer: &DeadlineTimer,
    tick: i64,
    published: u64,
) -> Result<u64, IpcError> {
    // None was sent: then there is none to wait for.
    let sent = if published == 0 { clock::now_ns() } else { published };
    let end = sent + COURTESY.as_nanos() as u64;
    deadline_timer.set(end);
    loop {
        // Woken by a command, by the controller that is about to get it, by the deadline_timer, or by a signal.
        wait(&[&ports.command], Duration::MAX)?;
        let woken = clock::now_ns();
        ports.read_answer(context, tick)?;
        if ports.commands.at(tick).is_none() && woken < end && poll(&[&ports.command], woken + ANY_MOMENT_NS) {
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
    ports: &mut Ports,
    resumed: Option<State>,
    ticks: i64,
) -> Result<(), PlantProcessError> {
    let mut credit = -1;
    let mut said = resumed;
    for tick in said.map_or(0, |state| state.tick)..ticks {
        while credit < tick {
            if let Some(new) = ports.credit.newest()? {
                credit = credit.max(new.tick);
            } else if !context.wait(&[&ports.credit], tick)? {
                return Ok(());
            } else {
                ports.state.preloan();
            }
        }
        context.begin();
        let due = clock::now_ns();
        // A successor says once more what its forerunner said last, for those who had not heard it.
        let state = said.take().unwrap_or_else(|| plant.sample());
        let published = ports.injector.send(&mut ports.state, &state, tick)?;
        loop {
            ports.read(context)?;
            if ports.commands.at(tick - 1).is_some() {
                break;
            }
            // Whoever joins late gets the last state handed over here.
            ports.state.preloan();
            if !context.wait(&[&ports.command], tick)? {
                return Ok(());
            }
        }
        ports.pass(plant, tick);
        plant.advance()?;
        context.account(TickTimes { tick, due_ns: due, wake_ns: due, publish_ns: published, latency_ns: 0 })?;
        ports.slack(context)?;
    }
    Ok(())
}
