//! Faults made on purpose in what a process sends.

use crate::bus::{Input, Output, Wait};
use crate::context::Context;
use crate::error::IpcError;
use crate::{clock, topic};
use hapfic_messages::{Injection, MAX_JOINTS, Message, Process, Reference, Request, State, Tampering};

/// Faults that may be waiting for their tick.
const WAITING: usize = 32;
/// By how much a stale message is behind.
const STALE: i64 = 100;

/// A message that can be made bad.
pub trait Corruptible: Copy {
    /// A number that is none.
    fn nan(&mut self);
    /// Codes and counts that mean nothing.
    fn corrupt(&mut self);
    /// Its tick.
    fn tick_mut(&mut self) -> &mut i64;
}

impl Corruptible for State {
    fn nan(&mut self) {
        self.joint_position[0] = f64::NAN;
    }
    fn corrupt(&mut self) {
        self.joints = MAX_JOINTS as u32 + 1;
        self.drive = u32::MAX;
    }
    fn tick_mut(&mut self) -> &mut i64 {
        &mut self.tick
    }
}

impl Corruptible for Reference {
    fn nan(&mut self) {
        self.position[0] = f64::NAN;
    }
    fn corrupt(&mut self) {
        // Has no codes: numbers no robot can follow.
        self.velocity = [f64::INFINITY; 3];
        self.planner.axes[0].rate = f64::NEG_INFINITY;
    }
    fn tick_mut(&mut self) -> &mut i64 {
        &mut self.tick
    }
}

impl Corruptible for Request {
    fn nan(&mut self) {
        self.torque[0] = f64::NAN;
    }
    fn corrupt(&mut self) {
        self.joints = MAX_JOINTS as u32 + 1;
        self.state.converging[0] = u32::MAX;
    }
    fn tick_mut(&mut self) -> &mut i64 {
        &mut self.tick
    }
}

/// A process's sender with the faults it is told to make.
#[derive(Debug)]
pub struct Injector<T> {
    input: Input<Injection>,
    process: Process,
    waiting: [Option<Injection>; WAITING],
    taken: u64,
    last: Option<T>,
}

impl<T: Corruptible + Message> Injector<T> {
    /// For the messages of a process.
    ///
    /// # Errors
    /// [`IpcError`] if the topic cannot be opened.
    pub fn open(context: &Context) -> Result<Self, IpcError> {
        Ok(Self {
            input: context.bus.input(&topic::INJECTION, Wait::No)?,
            process: context.process,
            waiting: [None; WAITING],
            taken: 0,
            last: None,
        })
    }

    /// Takes in what has been asked for. To be called in the slack.
    ///
    /// # Errors
    /// [`IpcError`] if a connection is damaged.
    pub fn listen(&mut self) -> Result<(), IpcError> {
        while let Some(new) = self.input.next()? {
            self.take(new);
        }
        Ok(())
    }

    fn take(&mut self, new: Injection) {
        let ours = new.process == self.process.code() && new.number > self.taken && Tampering::from_code(new.tampering).is_some();
        if !ours || new.ticks == 0 {
            return;
        }
        self.taken = new.number;
        // One too many is not made; who counts what was rejected sees it.
        if let Some(place) = self.waiting.iter_mut().find(|w| w.is_none()) {
            *place = Some(new);
        }
    }

    /// What is to be done wrong at a tick, if anything. A fault that came too late starts now.
    fn due(&mut self, tick: i64) -> Option<(Tampering, u32)> {
        for place in &mut self.waiting {
            let Some(fault) = place else { continue };
            if tick < fault.tick {
                continue;
            }
            let found = Tampering::from_code(fault.tampering).map(|t| (t, fault.by_us));
            fault.ticks -= 1;
            // The next one is due when the next message is.
            if fault.ticks == 0 {
                *place = None;
            }
            return found;
        }
        None
    }

    /// Sends a message as it should be, or as it was asked to be corrupted. Returns when it was sent, ns; 0 if it was not.
    ///
    /// # Errors
    /// [`IpcError`] if it cannot be sent.
    pub fn send(&mut self, output: &mut Output<T>, message: &T, tick: i64) -> Result<u64, IpcError> {
        let fault = self.due(tick);
        let last = self.last.replace(*message);
        let mut corrupted = *message;
        match fault {
            None => {}
            Some((Tampering::Slow, by_us)) => clock::sleep_until(clock::now_ns() + u64::from(by_us) * 1000),
            Some((Tampering::Drop, _)) => return Ok(0),
            Some((Tampering::Repeat, _)) => corrupted = last.unwrap_or(*message),
            Some((Tampering::Corrupt, _)) => corrupted.corrupt(),
            Some((Tampering::Nan, _)) => corrupted.nan(),
            Some((Tampering::Stale, _)) => *corrupted.tick_mut() -= STALE,
        }
        output.send(&corrupted)
    }
}
