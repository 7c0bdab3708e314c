//! The plant as a process: the clock of the stack.
//!
//! At tick k it publishes state(k), takes command(k - 1), and advances under it, while controller and gate already work on
//! state(k). Everything starts with the gate's command(-1).

use crate::error::PlantError;
use crate::plant::Plant;
use hapfic_config::Settings;
use hapfic_ipc::message::{Command, Credit, State};
use hapfic_ipc::realtime::Wish;
use hapfic_ipc::{Check, Clock, Context, Input, Output, Wait, clock, topic};

/// The period in nanoseconds.
const PERIOD_NS: u64 = 1_000_000;

struct Ports {
    state: Output<State>,
    command: Input<Command>,
    credit: Input<Credit>,
}

/// Runs the plant until its last tick or its end.
///
/// # Errors
/// [`PlantError`] if the world cannot be built, messaging fails or the simulation leaves the numbers.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), PlantError> {
    let mut ports = Ports {
        state: context.bus.output(&topic::STATE)?,
        command: context.bus.input(&topic::COMMAND, Wait::Yes)?,
        credit: context.bus.input(&topic::CREDIT, Wait::Yes)?,
    };
    let mut plant = Plant::new(settings)?;
    context.ready(Wish::new(settings.realtime.priority_plant, settings.realtime.core_plant))?;
    while plant_take(&mut plant, &mut ports, context)? == 0 {
        if !context.wait(&[&ports.command], -1)? {
            return Ok(());
        }
    }
    let ticks = settings.duration_ticks as i64;
    match context.clock {
        Clock::Realtime => realtime(context, &mut plant, &mut ports, ticks)?,
        Clock::Lockstep => lockstep(context, &mut plant, &mut ports, ticks)?,
    }
    context.finish(ticks - 1)?;
    Ok(())
}

/// Takes what has come in. Returns how many commands were used.
fn plant_take(plant: &mut Plant, ports: &mut Ports, context: &mut Context) -> Result<usize, PlantError> {
    let mut taken = 0;
    while let Some(command) = ports.command.next()? {
        if command.check().is_ok() && (plant.take(&command) || command.tick < 0) {
            taken += 1;
        } else {
            context.refuse();
        }
    }
    Ok(taken)
}

fn realtime(context: &mut Context, plant: &mut Plant, ports: &mut Ports, ticks: i64) -> Result<(), PlantError> {
    // Two periods to get everyone's first steps out of the way.
    let start = clock::now_ns() + 2 * PERIOD_NS;
    let mut slipped = 0_u64;
    for tick in 0..ticks {
        let due = start + (tick as u64 + slipped) * PERIOD_NS;
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
        ports.state.send(&state)?;
        let published = clock::now_ns();
        plant_take(plant, ports, context)?;
        plant.advance()?;
        context.account(tick, due, wake, published)?;
        ports.state.prepare();
        if !context.running() {
            return Ok(());
        }
    }
    Ok(())
}

fn lockstep(context: &mut Context, plant: &mut Plant, ports: &mut Ports, ticks: i64) -> Result<(), PlantError> {
    let mut credit = -1;
    for tick in 0..ticks {
        while credit < tick {
            if let Some(new) = ports.credit.newest()? {
                credit = credit.max(new.tick);
            } else if !context.wait(&[&ports.credit], tick)? {
                return Ok(());
            } else {
                ports.state.prepare();
            }
        }
        context.begin();
        let due = clock::now_ns();
        ports.state.send(&plant.sample())?;
        let published = clock::now_ns();
        loop {
            plant_take(plant, ports, context)?;
            if plant.command_tick() >= tick - 1 {
                break;
            }
            // Whoever joins late gets the last state handed over here.
            ports.state.prepare();
            if !context.wait(&[&ports.command], tick)? {
                return Ok(());
            }
        }
        plant.advance()?;
        context.account(tick, due, due, published)?;
        ports.state.prepare();
    }
    Ok(())
}
