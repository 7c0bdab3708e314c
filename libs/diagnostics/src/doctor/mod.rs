//! Whether a machine is good enough for 1 kHz: what it says of itself, a measurement, and one verdict.
//!
//! The checks are read through a root folder, so that a made-up machine can be looked at as well as this one. The verdict is a pure
//! function of checks and measurement.

mod change;
mod check;
mod host;
mod kernel;
mod lateness;
mod measure;
mod memory;
mod process_info;
mod processors;
mod sysfs;
mod text;
mod verdict;
mod wakeup;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod samples;

pub use check::MachineChecks;
pub use measure::{Measurement, measure};
pub use process_info::ProcessInfo;
pub use sysfs::SysfsRoot;
pub use verdict::{Evaluation, Grade, evaluate};

use serde::Serialize;

/// All there is to say about a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Examination {
    /// The judgement, and what to change.
    pub verdict: Evaluation,
    /// What was measured.
    pub measured: Measurement,
    /// What the machine says of itself.
    pub checks: MachineChecks,
}

/// Everything the machine says of itself, in the order in which it is told.
#[must_use]
pub fn checks(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineChecks {
    MachineChecks(vec![
        kernel::version(root),
        kernel::preemption(root),
        process_info.priority(),
        process_info.memory_lock(),
        process_info.idle_hold(),
        kernel::throttling(root),
        kernel::clock(root),
        process_info.resolution(),
        processors::cores(root, process_info),
        processors::isolation(root, process_info),
        processors::siblings(root, process_info),
        processors::idle_states(root, process_info),
        processors::governor(root, process_info),
        processors::turbo(root),
        host::hypervisor(root),
        host::steal(root),
        host::load(root, process_info),
        host::quota(root),
        process_info.shared_memory(),
        process_info.open_files(),
        memory::swap(root, process_info),
        memory::huge_pages(root),
    ])
}
