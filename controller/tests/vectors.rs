//! Vector tests of the laws. All reference values come from the vector files in `vectors/`.
//!
//! Within a case the state starts at its default and carries from row to row.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_controller::{Attractor, ForceProfile, HapticParameters, HapticSearch, LowPass};
use hapfic_messages::{MAX_JOINTS, ResetPolicy, Saturation, Search};

const PERIOD_S: f64 = 1e-3;

/// Returns the rows of a file, split into columns; `expected` detects a truncated file.
fn rows(text: &str, expected: usize) -> Vec<Vec<&str>> {
    let rows: Vec<Vec<&str>> = text.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), expected);
    rows
}

/// Returns `N` columns of a row as numbers, from column `first` on.
fn numbers<const N: usize>(row: &[&str], first: usize) -> [f64; N] {
    core::array::from_fn(|i| row[first + i].parse().unwrap())
}

fn assert_close(what: &str, actual: f64, expected: f64, row: &[&str]) {
    let tolerance = 1e-12 + 1e-9 * expected.abs();
    assert!((actual - expected).abs() <= tolerance, "{what} is {actual}, expected {expected}, in row {row:?}");
}

/// Reference: `haptic_search.csv` (Algorithm 1, with the paper's sigma of 0.01 and this project's taper of 0.2).
#[test]
fn haptic_search_recorded_forces_match_vectors() {
    let mut state = HapticSearch::default();
    let mut active: Vec<&str> = Vec::new();
    for row in rows(include_str!("vectors/haptic_search.csv"), 4800) {
        if row[..3] != active[..] {
            state = HapticSearch::default();
            active = row[..3].to_vec();
        }
        let [desired, measured, stiffness, position_bound, offset] = numbers(&row, 4);
        let parameters = HapticParameters {
            stiffness,
            position_bound,
            search: Search::from_name(row[0]).unwrap(),
            reset_policy: ResetPolicy::from_name(row[1]).unwrap(),
            taper: 0.2,
            search_scale: 0.01,
            force_resolution: 0.01,
            period_s: PERIOD_S,
        };
        state = state.step(desired, measured, &parameters);
        assert_close("offset", state.offset_m, offset, &row);
    }
}

/// Reference: `force_profile.csv` (eq. 4, with the continuous and the printed S).
#[test]
fn force_profile_recorded_errors_match_vectors() {
    for row in rows(include_str!("vectors/force_profile.csv"), 200) {
        let [error, stiffness, max_force, position_bound, continuous, as_printed] = numbers(&row, 0);
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Continuous };
        assert_close("force", profile.force(error), continuous, &row);
        let profile = ForceProfile { saturation: Saturation::AsPrinted, ..profile };
        assert_close("force as printed", profile.force(error), as_printed, &row);
    }
}

/// Reference: `attractor.csv` (eqs. 1 and 4).
#[test]
fn attractor_recorded_errors_match_vectors() {
    let mut state = Attractor::default();
    let mut active = "";
    let rows = rows(include_str!("vectors/attractor.csv"), 3000);
    for row in &rows {
        if row[0] != active {
            state = Attractor::default();
            active = row[0];
        }
        let [error, error_rate, stiffness, max_force, position_bound, force, converging, x_max] = numbers(row, 2);
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Continuous };
        let (next, actual) = state.step(error, error_rate, &profile);
        state = next;
        assert_close("force", actual, force, row);
        assert_eq!(f64::from(u8::from(state.converging)), converging, "phase in row {row:?}");
        assert_close("x_max", state.x_max_m, x_max, row);
    }
}

/// Reference: `low_pass.csv` (first-order low-pass with `alpha = 1 - exp(-2 pi f T)`).
#[test]
fn low_pass_recorded_torques_match_vectors() {
    let mut state = LowPass::default();
    for row in rows(include_str!("vectors/low_pass.csv"), 200) {
        let [input, cutoff, output] = numbers(&row, 1);
        // Each joint has its own filter: one gets the negated input, the others zero.
        let mut torque = [0.0; MAX_JOINTS];
        (torque[0], torque[MAX_JOINTS - 1]) = (input, -input);
        state = state.step(&torque, Some(cutoff), PERIOD_S);
        assert_close("output", state.output[0], output, &row);
        assert_close("mirrored output", state.output[MAX_JOINTS - 1], -output, &row);
        assert_eq!(state.output[1], 0.0);
    }
}
