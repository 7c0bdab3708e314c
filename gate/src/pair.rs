//! Rule of a pair of gates: what the owner of a tick does before it decides.
//!
//! The owner holds the lock of the tick. It writes its command into the page of the gates, publishes it, and notes that in
//! the page, in this order. It may die between any two of these steps; the next owner learns from the lock that it has.
//! `tests/protocol/pair.rs` explores all orders of steps, deaths and restarts.

/// What the page of the gates says, and what the owner has done itself. Ticks are -1 before the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct OwnerView {
    /// Tick of the command that the owner has made, or has followed, last.
    pub own: i64,
    /// Tick of the command in the page.
    pub written: i64,
    /// Last tick that an owner has noted as published.
    pub published: i64,
    /// Whether the owner before has died with the lock.
    pub inherited: bool,
}

/// What the owner does before it decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CatchUp {
    /// It continues behind the command in the page.
    pub follow: bool,
    /// It publishes that command again.
    pub publish: bool,
}

impl OwnerView {
    /// The owner continues behind the command in the page, if that is not its own. It publishes that command again unless
    /// every process is known to have it.
    #[must_use]
    pub fn catch_up(&self) -> CatchUp {
        let follow = self.written > self.own;
        CatchUp { follow, publish: follow && (self.inherited || self.published < self.written) }
    }
}
