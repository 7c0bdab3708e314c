//! How late an absolute timer wakes a process that does nothing else, as `cyclictest` measures it: the machine's floor.

use crate::arguments::Plan;
use crate::driver::tie_to_parent;
use crate::error::LatencyError;
use crate::measured::{Measured, Sample};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{self, Prefault};

/// Most late timers that are told of one by one where only late ones are.
const MOST: usize = 1_000_000;

/// Waits for one timer after the other. After one that was later than a period, those in between are left out, as they count in
/// [`Measured::count`] alone.
///
/// # Errors
/// [`LatencyError`] if the plan makes no sense.
pub fn timer(name: &str, plan: &Plan, ready: impl FnOnce()) -> Result<Measured, LatencyError> {
    let [sched, ..] = plan.sched_requests().map_err(LatencyError::Arguments)?;
    tie_to_parent(name)?;
    if sched.is_some() {
        realtime::lock_memory(Prefault::Used);
    }
    let granted = sched.map(realtime::apply_to_current_thread).unwrap_or_default();
    let room = if plan.above_ns > 0 { MOST.min(plan.count as usize) } else { plan.count as usize };
    // Every page of it is there before it counts.
    let mut samples = vec![Sample { due_ns: 1, ..Sample::default() }; room];
    samples.clear();
    ready();
    let mut due_ns = plan.start_ns;
    let end_ns = plan.start_ns + plan.count * plan.period_ns;
    while due_ns < end_ns {
        let mut now = clock::now_ns();
        // Not waited for: it says nothing of the timer.
        if now <= due_ns {
            while now < due_ns {
                clock::sleep_until(due_ns);
                now = clock::now_ns();
            }
            if now - due_ns >= plan.above_ns && samples.len() < room {
                samples.push(Sample { due_ns, wake_ns: now, ..Sample::default() });
            }
        }
        due_ns += plan.period_ns;
    }
    Ok(Measured { kind: name.to_owned(), hops: 0, count: plan.count, granted: vec![granted.0], samples })
}
