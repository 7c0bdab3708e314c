//! How the messages of a chain travel.

use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// Processes of a chain: the driver at place 0, and two relays.
pub const PLACES: usize = 3;

/// One process's part in a chain: it receives from the place before its own and sends to the next one.
pub trait Link {
    /// Sends a message to the next place, and wakes who waits there.
    ///
    /// # Errors
    /// If it cannot be sent.
    fn send(&mut self, message: &[u8]) -> io::Result<()>;

    /// Waits for a message from the place before, without spinning, and copies it. Returns its length; 0 if none came in time.
    /// Where more than one is there, they may be taken one after the other, or the newest alone. `None`: for ever.
    ///
    /// # Errors
    /// If the connection is broken, or `into` too short.
    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize>;
}

/// A kind of chain.
pub trait Kind: Sync {
    /// Its name on the command line and in tables.
    fn name(&self) -> &'static str;

    /// Makes what all three processes share, in the driver, before the relays are started, which inherit it.
    ///
    /// # Errors
    /// If it cannot be had.
    fn prepare(&self, sizes: &[usize; PLACES]) -> io::Result<Vec<OwnedFd>> {
        let _ = sizes;
        Ok(Vec::new())
    }

    /// Joins a chain at a place. Called on a thread that has its priority and core already: threads that it starts have them, too.
    /// The other places join at the same time, so whoever looks for them may have to wait.
    ///
    /// # Errors
    /// If it cannot.
    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>>;
}

/// A place in a chain.
#[derive(Debug)]
pub struct Seat {
    /// Which: 0 is the driver.
    pub place: usize,
    /// Bytes of the message that each place sends.
    pub sizes: [usize; PLACES],
    /// Name of the chain, of letters, digits and `-`: no other on this machine has it.
    pub chain: String,
    /// What [`Kind::prepare`] has made.
    pub shared: Vec<OwnedFd>,
}

impl Seat {
    /// The place that this one sends to.
    #[must_use]
    pub const fn next(&self) -> usize {
        (self.place + 1) % PLACES
    }

    /// The place that this one receives from.
    #[must_use]
    pub const fn before(&self) -> usize {
        (self.place + PLACES - 1) % PLACES
    }

    /// A name for a place of this chain that no other has.
    #[must_use]
    pub fn name_of(&self, place: usize) -> String {
        format!("{}-{place}", self.chain)
    }

    /// Bytes of the longest message.
    #[must_use]
    pub fn longest(&self) -> usize {
        self.sizes.into_iter().max().unwrap_or(0)
    }
}
