//! The figures of a run. Every number is finite; what there was nothing to measure for is `None`, `null` in JSON.

use super::moments::{IntegrationSummary, MomentsSummary};
use serde::Serialize;

/// The figures of a run. Arrays are the axes x, y and z of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MetricsSummary {
    /// How well the foot followed the reference.
    pub tracking: TrackingSummary,
    /// How well the contact force was matched.
    pub force: ForceSummary,
    /// The controller's force against its limit.
    pub force_command: ForceCommandSummary,
    /// What happened in the scene.
    pub moments: MomentsSummary,
    /// What the plant's integrator had to do.
    pub integration: IntegrationSummary,
    /// By the wall clock.
    pub timing: TimingSummary,
    /// What the figures are from.
    pub ticks: TickSummary,
}

/// x - x_d, over all ticks that have a state and a reference; the searched offset dx does not count as reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TrackingSummary {
    /// Largest error, m.
    pub max_m: [f64; 3],
    /// Root of the mean square of the error, m.
    pub rms_m: [f64; 3],
    /// Largest position bound x_b that was in force, m.
    pub bound_m: [f64; 3],
    /// Largest |x - x_d| / x_b, with the x_b in force then.
    pub max_ratio: [f64; 3],
    /// Root of the mean square of it.
    pub rms_ratio: [f64; 3],
    /// Ticks at which any axis was further off than the x_b in force then.
    pub outside_ticks: u64,
    /// The same per axis, and why.
    pub outside: OutsideSummary,
}

/// Ticks at which an axis was further off than x_b, each counted once: with the first cause that applies.
///
/// A contact is a cause only where a force is wished. Against one that is not wished the law has all of F_max, so that an error
/// beyond x_b with less than F_max is unexplained there, unless the axis is on its way back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct OutsideSummary {
    /// All of them.
    pub ticks: [u64; 3],
    /// |F_c| was at least 0.999 F_max: the law could not do more.
    pub force_limited_ticks: [u64; 3],
    /// The torque of a joint was cut at its peak.
    pub torque_limited_ticks: [u64; 3],
    /// F_d is not zero and the foot feels a force on that axis: dx makes up for the distance, force goes before position.
    pub force_held_ticks: [u64; 3],
    /// The axis converges: on the way back the law gives less than its profile (eq. 1).
    pub converging_ticks: [u64; 3],
    /// The axis converges and stands still, at less than 1 mm/s: stuck on its way back, whatever cause it is counted with.
    pub standing_ticks: [u64; 3],
    /// There was no active command.
    pub inactive_ticks: [u64; 3],
    /// None of these.
    pub unexplained_ticks: [u64; 3],
}

/// F - F_d, in windows in which it may be expected to be small: F_d is not zero on that axis; it, and K0, F_max and x_b of the
/// axis, have not changed for 0.5 s; and it has been reached (to 1 % or the force resolution) since then. A wished force that
/// meets no contact, or that the gains do not allow, is never reached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ForceSummary {
    /// The last F_d that was not zero, N.
    pub desired_n: [Option<f64>; 3],
    /// Root of the mean square of the error while the reference has been at rest on all axes for 0.5 s, N.
    pub settled_rms_n: [Option<f64>; 3],
    /// The same of the error relative to |F_d|, %.
    pub settled_rms_percent: [Option<f64>; 3],
    /// Ticks of these two.
    pub settled_ticks: [u64; 3],
    /// Stretches of such ticks without a gap.
    pub holds: [u64; 3],
    /// `settled_rms_percent` of the worst of these, %.
    pub worst_hold_rms_percent: [Option<f64>; 3],
    /// F_d of it, N.
    pub worst_hold_desired_n: [Option<f64>; 3],
    /// `settled_rms_percent` of the last of these, %.
    pub last_hold_rms_percent: [Option<f64>; 3],
    /// As `settled_rms_percent`, while the reference moves across the axis and not along it, %.
    pub sliding_rms_percent: [Option<f64>; 3],
    /// Ticks of it.
    pub sliding_ticks: [u64; 3],
    /// The same from when the foot has moved across the axis by more than 10 mm/s for 50 ms: what breaking away from static
    /// friction sets off is over then, %.
    pub gliding_rms_percent: [Option<f64>; 3],
    /// Ticks of it.
    pub gliding_ticks: [u64; 3],
    /// Largest force beyond F_d, in its direction, once F_d has been reached since it was set; gains may change meanwhile, N.
    pub overshoot_n: [Option<f64>; 3],
    /// Changes of F_d, K0, F_max or x_b after which F_d was reached and stayed reached for 0.1 s.
    pub recoveries: [u64; 3],
    /// Such changes after which it was not, though the axis felt a contact, before the next of them or the end.
    pub unrecovered: [u64; 3],
    /// Ticks from a change to the start of these 0.1 s, in the slowest case; a way to the contact counts.
    pub slowest_recovery_ticks: [Option<u64>; 3],
}

/// F_c of the commands in mode `active`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ForceCommandSummary {
    /// Largest |F_c|, N.
    pub max_n: [f64; 3],
    /// Largest F_max that was in force, N.
    pub limit_n: [f64; 3],
    /// Largest |F_c| / F_max, with the F_max in force then.
    pub max_ratio: [f64; 3],
    /// Commands in mode `active` with known parameters.
    pub active_ticks: u64,
    /// Of these, how many have |F_c| of at least 0.999 F_max.
    pub at_limit_ticks: [u64; 3],
    /// Ticks at which |F_c| of any axis was above the F_max in force then; the law allows none.
    pub above_limit_ticks: u64,
}

/// By the wall clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TimingSummary {
    /// From state published to command published, us.
    pub latency_us: Option<Quantiles>,
    /// Periods by which simulated time slipped, because the plant's timer came late.
    pub late_ticks: u64,
    /// Commands that no valid request of their tick stands behind, after the first one in mode `active`.
    pub missed_ticks: u64,
    /// Commands in another mode than `active` after the first one in it: the drive brakes, for 20 good ticks after two misses.
    pub brake_ticks: u64,
    /// How late the plant's timer was, us; all zero in lockstep, which has no timer.
    pub wake_lateness_us: Option<Quantiles>,
    /// Heap allocations between receiving and sending, in all processes.
    pub allocations: u64,
}

/// Quantiles of a distribution, to three digits; the largest value is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99 % are no larger.
    pub p99: f64,
    /// 99.9 % are no larger.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

/// What the figures are from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TickSummary {
    /// First tick in `/state`.
    pub first: Option<i64>,
    /// Last tick in `/state`.
    pub last: Option<i64>,
    /// Ticks between the two that are missing in `/state`.
    pub missing_states: u64,
    /// Ticks from the first state to the last command that are missing in `/command`. A run that is cut short ends before the
    /// last states are answered: the plant may be two ahead.
    pub missing_commands: u64,
    /// Both together.
    pub lost: u64,
    /// Messages left out since they held no finite numbers, or the wrong number of them.
    pub invalid: u64,
}
