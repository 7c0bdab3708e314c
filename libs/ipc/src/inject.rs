//! Fault injection into the messages that a process sends.

use crate::bus::Wait;
use crate::context::Context;
use crate::error::IpcError;
use crate::ports::{Input, Output};
use crate::{clock, topic};
use hapfic_messages::{Injection, MAX_JOINTS, Message, MessageFault, Process, Reference, Request, State};

/// Most faults that wait for their tick.
const WAITING: usize = 32;
/// Delay of a stale message [ticks].
const STALE: i64 = 100;

/// Message that fault injection can corrupt.
pub trait Corruptible: Copy {
    /// Writes a NaN.
    fn nan(&mut self);
    /// Writes invalid codes and counts.
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
        // No codes to corrupt: numbers that no robot can follow.
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

/// Sender of a process with fault injection.
#[derive(Debug)]
pub struct Injector<T> {
    input: Input<Injection>,
    process: Process,
    waiting: [Option<Injection>; WAITING],
    taken: u64,
    last: Option<T>,
}

impl<T: Corruptible + Message> Injector<T> {
    /// Opens fault injection for the messages of a process.
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

    /// Takes the requested faults. Idle-time work.
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
        let ours =
            new.process == self.process.code() && new.number > self.taken && MessageFault::from_code(new.message_fault).is_some();
        if !ours || new.ticks == 0 {
            return;
        }
        self.taken = new.number;
        // A fault beyond the capacity is dropped; the count of rejected messages shows it.
        if let Some(place) = self.waiting.iter_mut().find(|w| w.is_none()) {
            *place = Some(new);
        }
    }

    /// Fault that is due at a tick, and its delay [us]. A fault that came too late starts now.
    fn due(&mut self, tick: i64) -> Option<(MessageFault, u32)> {
        for place in &mut self.waiting {
            let Some(fault) = place else { continue };
            if tick < fault.tick {
                continue;
            }
            let found = MessageFault::from_code(fault.message_fault).map(|t| (t, fault.by_us));
            fault.ticks -= 1;
            // At most one fault for each message.
            if fault.ticks == 0 {
                *place = None;
            }
            return found;
        }
        None
    }

    /// Sends a message, with the fault that is due, if any. Returns the time of sending [ns]; 0 if dropped.
    ///
    /// # Errors
    /// [`IpcError`] if the message cannot be sent.
    pub fn send(&mut self, output: &mut Output<T>, message: &T, tick: i64) -> Result<u64, IpcError> {
        let fault = self.due(tick);
        let last = self.last.replace(*message);
        let mut corrupted = *message;
        match fault {
            None => {}
            Some((MessageFault::Slow, by_us)) => clock::sleep_until(clock::now_ns() + u64::from(by_us) * 1000),
            Some((MessageFault::Drop, _)) => return Ok(0),
            Some((MessageFault::Repeat, _)) => corrupted = last.unwrap_or(*message),
            Some((MessageFault::Corrupt, _)) => corrupted.corrupt(),
            Some((MessageFault::Nan, _)) => corrupted.nan(),
            Some((MessageFault::Stale, _)) => *corrupted.tick_mut() -= STALE,
        }
        output.send(&corrupted)
    }
}
