//! Examination of a machine for 1 kHz: checks of its configuration, a measurement, and one verdict.
//!
//! The checks read files below a root folder, so that tests can examine synthetic machines. The verdict is a pure
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

/// Examination of a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Examination {
    /// Verdict, and recommended changes.
    pub verdict: Evaluation,
    /// Measurement of the timer and the wake-ups.
    pub measured: Measurement,
    /// Checks of the configuration.
    pub checks: MachineChecks,
}

/// Checks the configuration of the machine, in the order of the report.
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
