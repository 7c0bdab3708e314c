//! The robot model for 3 to 8 joints.

use anyhow::Result;
use criterion::{BenchmarkId, Criterion};
use hapfic_bench_micro::limb::{arm, posture};
use hapfic_robot::MAX_JOINTS;
use nalgebra::Vector3;
use std::hint::black_box;

/// Postures in the cycle.
const POSTURES: usize = 64;

fn main() -> Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let mut group = criterion.benchmark_group("robot");
    for joints in 3..=MAX_JOINTS {
        let chain = arm(joints)?;
        let postures: Vec<_> = (0..POSTURES).map(|index| posture(joints, index)).collect();
        let kinematics: Vec<_> = postures.iter().map(|(q, qd)| (chain.kinematics(q), *qd)).collect();
        group.bench_function(BenchmarkId::new("forward kinematics", joints), |b| {
            let mut next_posture = postures.iter().cycle();
            b.iter(|| next_posture.next().map(|(q, _)| chain.kinematics(black_box(q))));
        });
        group.bench_function(BenchmarkId::new("Jacobian", joints), |b| {
            let mut next_posture = kinematics.iter().cycle();
            b.iter(|| next_posture.next().map(|(kin, _)| chain.jacobian(black_box(kin))));
        });
        group.bench_function(BenchmarkId::new("mass matrix", joints), |b| {
            let mut next_posture = kinematics.iter().cycle();
            b.iter(|| next_posture.next().map(|(kin, _)| chain.mass_matrix(black_box(kin))));
        });
        group.bench_function(BenchmarkId::new("inverse dynamics", joints), |b| {
            let mut next_posture = kinematics.iter().cycle();
            b.iter(|| next_posture.next().map(|(kin, qd)| chain.inverse_dynamics(black_box(kin), qd, qd, &gravity)));
        });
        group.bench_function(BenchmarkId::new("all of them", joints), |b| {
            let mut next_posture = postures.iter().cycle();
            b.iter(|| {
                next_posture.next().map(|(q, qd)| {
                    let kin = chain.kinematics(black_box(q));
                    (chain.jacobian(&kin), chain.mass_matrix(&kin), chain.inverse_dynamics(&kin, qd, qd, &gravity))
                })
            });
        });
    }
    group.finish();
    criterion.final_summary();
    Ok(())
}
