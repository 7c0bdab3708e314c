//! Whether a machine is good enough for 1 kHz: what it says of itself, a measurement, and one verdict.
//!
//! The facts are read through a root folder, so that a made-up machine can be looked at as well as this one. The verdict is a pure
//! function of facts and measurement.

mod change;
mod fact;
mod host;
mod kernel;
mod measure;
mod memory;
mod own;
mod ping;
mod processors;
mod root;
mod tally;
mod tell;
mod verdict;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod samples;

pub use fact::Facts;
pub use measure::{Measured, measure};
pub use own::Own;
pub use root::Root;
pub use verdict::{Grade, Verdict, judge};

use serde::Serialize;

/// All there is to say about a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Examination {
    /// The judgement, and what to change.
    pub verdict: Verdict,
    /// What was measured.
    pub measured: Measured,
    /// What the machine says of itself.
    pub facts: Facts,
}

/// Everything the machine says of itself, in the order in which it is told.
#[must_use]
pub fn facts(root: &Root, own: &Own) -> Facts {
    Facts(vec![
        kernel::version(root),
        kernel::preemption(root),
        own.priority(),
        own.memory_lock(),
        own.idle_hold(),
        kernel::throttling(root),
        kernel::clock(root),
        own.resolution(),
        processors::cores(root, own),
        processors::isolation(root, own),
        processors::siblings(root, own),
        processors::idle_states(root, own),
        processors::governor(root, own),
        processors::turbo(root),
        host::hypervisor(root),
        host::steal(root),
        host::load(root, own),
        host::quota(root),
        own.shared_memory(),
        own.open_files(),
        memory::swap(root, own),
        memory::huge_pages(root),
    ])
}
