//! Summary of the metrics. Every number is finite; a metric without data is `None`, `null` in JSON.

use super::moments::{IntegrationSummary, MomentsSummary};
use serde::{Deserialize, Serialize};

/// Metrics of a run. Arrays are the axes x, y and z of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MetricsSummary {
    /// Position error of the foot against the reference.
    pub tracking: TrackingSummary,
    /// Error of the contact force.
    pub force: ForceSummary,
    /// Force of the controller against its limit.
    pub force_command: ForceCommandSummary,
    /// Metrics of the scene.
    pub moments: MomentsSummary,
    /// Metrics of the plant's integrator.
    pub integration: IntegrationSummary,
    /// Wall-clock timing.
    pub timing: TimingSummary,
    /// Ticks behind the metrics.
    pub ticks: TickSummary,
}

/// Error x - x_d, over all ticks with a state and a reference; the searched offset dx does not count as reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackingSummary {
    /// Largest error [m].
    pub max_m: [f64; 3],
    /// Root mean square of the error [m].
    pub rms_m: [f64; 3],
    /// Largest position bound x_b in force [m].
    pub bound_m: [f64; 3],
    /// Largest |x - x_d| / x_b, with x_b of that tick.
    pub max_ratio: [f64; 3],
    /// Root mean square of that ratio.
    pub rms_ratio: [f64; 3],
    /// Ticks at which the error of any axis exceeded x_b of that tick.
    pub outside_ticks: u64,
    /// Angle between the tip and its reference, in active ticks; `None` in a position task.
    pub orientation: Option<OrientationSummary>,
    /// The same per axis, with causes.
    pub outside: OutsideSummary,
}

/// Angle between the tip and its reference orientation; the searched offset does not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OrientationSummary {
    /// Largest [rad].
    pub max_rad: f64,
    /// Root mean square [rad].
    pub rms_rad: f64,
    /// In the last active tick [rad].
    pub last_rad: f64,
}

/// Ticks at which the error of an axis exceeded x_b, each counted once: with the first cause that applies.
///
/// Contact is a cause only with a desired force. Against any other contact the law has all of F_max. An error beyond
/// x_b with less than F_max is unexplained there, unless the axis converges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OutsideSummary {
    /// All such ticks.
    pub ticks: [u64; 3],
    /// |F_c| was at least 0.999 of the profile's largest force, F_max or K0 x_b: the law was at its limit.
    pub force_limited_ticks: [u64; 3],
    /// The torque of a joint was limited, by its peak or by the rate limit of normal operation.
    pub torque_limited_ticks: [u64; 3],
    /// F_d is not zero and the foot has contact on that axis: dx compensates the distance, force precedes position.
    pub force_held_ticks: [u64; 3],
    /// The axis converges, or its force rises again after a convergence: the law gives less than its profile (eq. 1).
    pub converging_ticks: [u64; 3],
    /// The axis converges at less than 1 mm/s: it is at rest far from the reference. Counted beside any cause.
    pub standing_ticks: [u64; 3],
    /// There was no active command.
    pub inactive_ticks: [u64; 3],
    /// Ticks without any of these causes.
    pub unexplained_ticks: [u64; 3],
}

/// Force error F - F_d, in windows in which it can be expected to be small.
///
/// F_d is not zero on that axis. F_d, K0, F_max and x_b of the axis have not changed for 0.5 s. Since then the axis has
/// reached F_d (to 1 % or the force resolution). Without contact, or with insufficient gains, it never reaches F_d.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceSummary {
    /// Last F_d that was not zero [N].
    pub desired_n: [Option<f64>; 3],
    /// Root mean square of the error while the reference has been at rest on all axes for 0.5 s [N].
    pub settled_rms_n: [Option<f64>; 3],
    /// The same of the error relative to |F_d| [%].
    pub settled_rms_percent: [Option<f64>; 3],
    /// Number of these ticks.
    pub settled_ticks: [u64; 3],
    /// Holds: uninterrupted runs of such ticks.
    pub holds: [u64; 3],
    /// `settled_rms_percent` of the worst hold [%].
    pub worst_hold_rms_percent: [Option<f64>; 3],
    /// F_d of the worst hold [N].
    pub worst_hold_desired_n: [Option<f64>; 3],
    /// `settled_rms_percent` of the last hold [%].
    pub last_hold_rms_percent: [Option<f64>; 3],
    /// As `settled_rms_percent`, while the reference moves across the axis and not along it [%].
    pub sliding_rms_percent: [Option<f64>; 3],
    /// Number of these ticks.
    pub sliding_ticks: [u64; 3],
    /// The same in steady sliding: the foot has moved across the axis by more than 10 mm/s for 50 ms [%]. The transient
    /// of breaking away from static friction is over then.
    pub steady_sliding_rms_percent: [Option<f64>; 3],
    /// Number of these ticks.
    pub steady_sliding_ticks: [u64; 3],
    /// Largest force beyond F_d, in its direction, after F_d has been reached; gains may change meanwhile [N].
    pub overshoot_n: [Option<f64>; 3],
    /// Changes of F_d, K0, F_max or x_b after which the axis reached F_d and stayed there for 0.1 s.
    pub recoveries: [u64; 3],
    /// Such changes with contact but without recovery before the next change or the end.
    pub unrecovered: [u64; 3],
    /// Ticks from a change to the start of these 0.1 s, in the slowest case, travel to the contact included.
    pub slowest_recovery_ticks: [Option<u64>; 3],
    /// Segments of more than 0.5 s with the same F_d, K0, F_max and x_b, in which F_d was never reached.
    pub not_reached: [u64; 3],
    /// Mean of F - F_d from 0.5 s on in such a segment, the worst one [N].
    pub not_reached_error_n: [Option<f64>; 3],
}

/// Force F_c of the commands in mode `active`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceCommandSummary {
    /// Largest |F_c| [N].
    pub max_n: [f64; 3],
    /// Largest F_max in force [N].
    pub limit_n: [f64; 3],
    /// Largest |F_c| / F_max, with F_max of that tick.
    pub max_ratio: [f64; 3],
    /// Commands in mode `active` with known parameters.
    pub active_ticks: u64,
    /// Of these, commands with |F_c| of at least 0.999 F_max.
    pub at_limit_ticks: [u64; 3],
    /// Ticks at which |F_c| of any axis exceeded F_max of that tick; the law allows none.
    pub above_limit_ticks: u64,
}

/// Wall-clock timing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TimingSummary {
    /// Latency from state published to command published [us].
    pub latency_us: Option<Quantiles>,
    /// Periods by which simulated time slipped, because the plant's timer expired late.
    pub late_ticks: u64,
    /// Commands without a valid request of their tick, after the first command in mode `active`.
    pub missed_ticks: u64,
    /// Commands in another mode after the first command in mode `active`. After two misses the drive brakes for 20
    /// valid ticks.
    pub brake_ticks: u64,
    /// Lateness of the plant's timer [us]; all zero in lockstep, which has no timer.
    pub wake_lateness_us: Option<Quantiles>,
    /// Heap allocations between receiving and sending, in all processes.
    pub allocations: u64,
}

/// Quantiles of a distribution, to three digits; the maximum is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Maximum.
    pub max: f64,
}

/// Ticks behind the metrics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TickSummary {
    /// First tick in `/state`.
    pub first: Option<i64>,
    /// Last tick in `/state`.
    pub last: Option<i64>,
    /// Ticks between the two without a message in `/state`.
    pub missing_states: u64,
    /// Ticks from the first state to the last command without a message in `/command`. A run that is cut short ends
    /// before the last commands: the plant may be two ticks ahead.
    pub missing_commands: u64,
    /// Sum of missing states and commands.
    pub lost: u64,
    /// Rejected messages: their numbers are not finite, or too few or too many.
    pub invalid: u64,
}
