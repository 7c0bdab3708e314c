//! Error of a run against its own converged reference.

use crate::BenchScene;
use crate::plan::TICKS;
use crate::run::{FootSample, SUBSTEP_US, SceneRun, run};
use anyhow::Result;
use nalgebra::Vector3;
use serde::Serialize;

/// Sub-step of the reference [us]: the shortest one, since the plant counts whole microseconds.
const REFERENCE_US: u32 = 1;
/// Sub-step whose distance from the reference bounds the error of the reference [us].
const COARSER_US: u32 = 2;

/// Largest and root mean square distance between two runs, over the ticks.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RunDistance {
    /// Largest distance of the foot [m].
    pub foot_max_m: f64,
    /// Root mean square distance of the foot [m].
    pub foot_rms_m: f64,
    /// Largest difference of the force on the foot [N].
    pub force_max_n: f64,
    /// Root mean square difference of the force on the foot [N].
    pub force_rms_n: f64,
}

/// Error of the plant in a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Accuracy {
    scene: BenchScene,
    substep_us: f64,
    reference_us: f64,
    /// Distance from the reference.
    error: RunDistance,
    /// Distance of the reference from the next coarser run: an upper bound of the reference's own error.
    reference_change: RunDistance,
    /// Sub-steps that ended above Newton's tolerance.
    unconverged: u32,
    /// Largest normal force of a sub-step at any contact point [N].
    peak_n: f64,
    /// Largest normal force in the reference [N].
    reference_peak_n: f64,
    /// Mean force on the foot along z over the last tenth [N].
    settled_n: f64,
    /// Final position of the foot [m].
    end_m: [f64; 3],
}

fn max_and_rms(a: &SceneRun, b: &SceneRun, of: impl Fn(&FootSample) -> Vector3<f64>) -> (f64, f64) {
    let squares = a.samples.iter().zip(&b.samples).map(|(a, b)| (of(a) - of(b)).norm_squared());
    let (max, sum) = squares.fold((0.0_f64, 0.0), |(max, sum), square| (max.max(square), sum + square));
    (max.sqrt(), (sum / a.samples.len() as f64).sqrt())
}

fn distance(a: &SceneRun, b: &SceneRun) -> RunDistance {
    let (foot_max_m, foot_rms_m) = max_and_rms(a, b, |sample| sample.foot);
    let (force_max_n, force_rms_n) = max_and_rms(a, b, |sample| sample.force);
    RunDistance { foot_max_m, foot_rms_m, force_max_n, force_rms_n }
}

/// Measures the error of a scene.
///
/// # Errors
/// If a run fails.
pub fn measure(scene: BenchScene) -> Result<Accuracy> {
    let compared = run(scene, SUBSTEP_US, TICKS)?;
    let reference = run(scene, REFERENCE_US, TICKS)?;
    let coarser = run(scene, COARSER_US, TICKS)?;
    let tail = &compared.samples[TICKS - TICKS / 10..];
    Ok(Accuracy {
        scene,
        substep_us: f64::from(SUBSTEP_US),
        reference_us: f64::from(REFERENCE_US),
        error: distance(&compared, &reference),
        reference_change: distance(&coarser, &reference),
        unconverged: compared.unconverged,
        peak_n: compared.peak_n,
        reference_peak_n: reference.peak_n,
        settled_n: tail.iter().map(|sample| sample.force.z).sum::<f64>() / tail.len() as f64,
        end_m: compared.samples[TICKS - 1].foot.into(),
    })
}
