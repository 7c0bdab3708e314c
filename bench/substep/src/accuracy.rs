//! How far a run is from its own converged reference.

use crate::Scene;
use crate::plan::TICKS;
use crate::run::{Run, SUBSTEP_US, run};
use anyhow::Result;
use nalgebra::Vector3;
use serde::Serialize;

/// Sub-step of the reference, us: the shortest there is, since the plant counts whole microseconds.
const REFERENCE_US: u32 = 1;
/// Sub-step whose distance from the reference says how far the reference itself is from the limit, us.
const COARSER_US: u32 = 2;

/// Largest and root mean square distance between two runs, over the ticks.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Distance {
    /// Of the foot, m.
    pub foot_max_m: f64,
    /// Of the foot, m.
    pub foot_rms_m: f64,
    /// Of the force on the foot, N.
    pub force_max_n: f64,
    /// Of the force on the foot, N.
    pub force_rms_n: f64,
}

/// The error of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Accuracy {
    scene: Scene,
    substep_us: f64,
    reference_us: f64,
    /// From the reference.
    error: Distance,
    /// Of the reference from the next coarser run: an upper bound of what is left between it and the limit.
    reference_change: Distance,
    /// Sub-steps that ended above Newton's tolerance.
    unconverged: u32,
    /// Largest normal force of a sub-step at any contact point, N.
    peak_n: f64,
    /// The same of the reference, N.
    reference_peak_n: f64,
    /// Mean force on the foot along z over the last tenth, N.
    settled_n: f64,
    /// Where the foot ended, m.
    end_m: [f64; 3],
}

fn spread(a: &Run, b: &Run, of: impl Fn(&crate::run::Sample) -> Vector3<f64>) -> (f64, f64) {
    let squares = a.samples.iter().zip(&b.samples).map(|(a, b)| (of(a) - of(b)).norm_squared());
    let (most, sum) = squares.fold((0.0_f64, 0.0), |(most, sum), square| (most.max(square), sum + square));
    (most.sqrt(), (sum / a.samples.len() as f64).sqrt())
}

fn distance(a: &Run, b: &Run) -> Distance {
    let (foot_max_m, foot_rms_m) = spread(a, b, |sample| sample.foot);
    let (force_max_n, force_rms_n) = spread(a, b, |sample| sample.force);
    Distance { foot_max_m, foot_rms_m, force_max_n, force_rms_n }
}

/// Measures the error of a scene.
///
/// # Errors
/// If a run cannot be made.
pub fn measure(scene: Scene) -> Result<Accuracy> {
    let found = run(scene, SUBSTEP_US, TICKS)?;
    let reference = run(scene, REFERENCE_US, TICKS)?;
    let coarser = run(scene, COARSER_US, TICKS)?;
    let tail = &found.samples[TICKS - TICKS / 10..];
    Ok(Accuracy {
        scene,
        substep_us: f64::from(SUBSTEP_US),
        reference_us: f64::from(REFERENCE_US),
        error: distance(&found, &reference),
        reference_change: distance(&coarser, &reference),
        unconverged: found.unconverged,
        peak_n: found.peak_n,
        reference_peak_n: reference.peak_n,
        settled_n: tail.iter().map(|sample| sample.force.z).sum::<f64>() / tail.len() as f64,
        end_m: found.samples[TICKS - 1].foot.into(),
    })
}
