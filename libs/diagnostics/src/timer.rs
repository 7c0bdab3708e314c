//! Lateness of an absolute timer that wakes an otherwise idle process, as in `cyclictest`: the machine's lower bound.

use crate::arguments::MeasurementPlan;
use crate::driver::tie_to_parent;
use crate::error::LatencyError;
use crate::measured::{ChainMeasurement, ChainSample};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{self, Prefault};

/// Maximum number of samples if only late ones are reported.
const MAX_LATE_SAMPLES: usize = 1_000_000;

/// Waits for one timer after the other, and records its lateness.
///
/// After a lateness above one period the timers in between give no samples; only [`ChainMeasurement::count`] includes
/// them.
///
/// # Errors
/// [`LatencyError`] if the plan is invalid.
pub fn timer(name: &str, plan: &MeasurementPlan, ready: impl FnOnce()) -> Result<ChainMeasurement, LatencyError> {
    let [sched, ..] = plan.sched_requests().map_err(LatencyError::Arguments)?;
    tie_to_parent(name)?;
    if sched.is_some() {
        realtime::lock_memory(Prefault::Used);
    }
    let granted = sched.map(realtime::apply_to_current_thread).unwrap_or_default();
    let capacity = if plan.above_ns > 0 { MAX_LATE_SAMPLES.min(plan.count as usize) } else { plan.count as usize };
    // Nonzero values, so that every page is mapped before the measurement.
    let mut samples = vec![ChainSample { due_ns: 1, ..ChainSample::default() }; capacity];
    samples.clear();
    ready();
    let mut due_ns = plan.start_ns;
    let end_ns = plan.start_ns + plan.count * plan.period_ns;
    while due_ns < end_ns {
        let mut now = clock::now_ns();
        // A due time in the past is no measurement of the timer.
        if now <= due_ns {
            while now < due_ns {
                clock::sleep_until(due_ns);
                now = clock::now_ns();
            }
            if now - due_ns >= plan.above_ns && samples.len() < capacity {
                samples.push(ChainSample { due_ns, wake_ns: now, ..ChainSample::default() });
            }
        }
        due_ns += plan.period_ns;
    }
    Ok(ChainMeasurement { kind: name.to_owned(), hops: 0, count: plan.count, granted: vec![granted.0], samples })
}
