//! Interface of the transports: kinds of chains, and their links.

use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// Number of processes of a chain: the driver at stage 0, and two relays.
pub const STAGES: usize = 3;

/// Link of one process of a chain: receives from the previous stage, and sends to the next one.
pub trait Link {
    /// Sends a message to the next stage, and wakes its process.
    ///
    /// # Errors
    /// If the message cannot be sent.
    fn send(&mut self, message: &[u8]) -> io::Result<()>;

    /// Waits for a message from the previous stage, without spinning, and copies it.
    ///
    /// Returns its length; 0 if none came in time. Of several messages a link may take one after the other, or only the
    /// newest. Timeout `None`: waits without limit.
    ///
    /// # Errors
    /// If the connection is broken, or `into` is too short.
    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize>;
}

/// Kind of chain: the transport of its messages.
pub trait Kind: Sync {
    /// Name on the command line and in tables.
    fn name(&self) -> &'static str;

    /// Makes the files that all three processes share, in the driver, before it starts the relays, which inherit them.
    ///
    /// # Errors
    /// If a file cannot be made.
    fn prepare(&self, sizes: &[usize; STAGES]) -> io::Result<Vec<OwnedFd>> {
        let _ = sizes;
        Ok(Vec::new())
    }

    /// Joins a chain at a stage.
    ///
    /// The calling thread already has its priority and core, which threads started here inherit. The other stages join
    /// at the same time, so an implementation may have to wait for them.
    ///
    /// # Errors
    /// If the chain cannot be joined.
    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>>;
}

/// Stage of a process in a chain, with what it needs to join.
#[derive(Debug)]
pub struct Seat {
    /// Stage: 0 is the driver.
    pub stage: usize,
    /// Length of the message that each stage sends [bytes].
    pub sizes: [usize; STAGES],
    /// Name of the chain, unique on this machine, of letters, digits and `-`.
    pub chain: String,
    /// Files that [`Kind::prepare`] has made.
    pub shared: Vec<OwnedFd>,
}

impl Seat {
    /// Stage that this one sends to.
    #[must_use]
    pub const fn next(&self) -> usize {
        (self.stage + 1) % STAGES
    }

    /// Stage that this one receives from.
    #[must_use]
    pub const fn before(&self) -> usize {
        (self.stage + STAGES - 1) % STAGES
    }

    /// Unique name of a stage of this chain.
    #[must_use]
    pub fn name_of(&self, stage: usize) -> String {
        format!("{}-{stage}", self.chain)
    }

    /// Length of the longest message [bytes].
    #[must_use]
    pub fn longest(&self) -> usize {
        self.sizes.into_iter().max().unwrap_or(0)
    }
}
