//! Vector test of the planner.
//!
//! The reference values come from the vector file `planner.csv`: three-dimensional motions (eqs. 2-3 in closed form),
//! with targets that change at rest and in motion.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_planner::{PlannerParameters, hold, setpoint, step};

const PERIOD_S: f64 = 1e-3;
const VECTORS: &str = include_str!("vectors/planner.csv");

fn assert_close(what: &str, actual: f64, expected: f64, case: &str, tick: &str) {
    let tolerance = 1e-12 + 1e-9 * expected.abs();
    assert!((actual - expected).abs() <= tolerance, "case {case}, tick {tick}: {what} is {actual}, expected {expected}");
}

#[test]
fn step_recorded_targets_match_vectors() {
    let mut state = hold([0.0; 3]);
    let mut active = "";
    let mut rows = 0;
    for line in VECTORS.lines().skip(1) {
        let mut texts = line.split(',');
        let (case, tick) = (texts.next().unwrap(), texts.next().unwrap());
        let columns: Vec<f64> = texts.map(|text| text.parse().unwrap()).collect();
        let [mean_speed, max_acceleration, target @ .., px, py, pz, vx, vy, vz] = columns.as_slice() else {
            panic!("case {case}, tick {tick}: too few columns");
        };
        let (position, velocity) = ([*px, *py, *pz], [*vx, *vy, *vz]);
        if case != active {
            state = hold(position);
            active = case;
        }
        let now = setpoint(&state, PERIOD_S);
        for axis in 0..3 {
            assert_close("position", now.position_m[axis], position[axis], case, tick);
            assert_close("velocity", now.velocity_m_per_s[axis], velocity[axis], case, tick);
        }
        let parameters = PlannerParameters { mean_speed_m_per_s: *mean_speed, max_acceleration_m_per_s2: *max_acceleration };
        (state, _) = step(state, target.try_into().unwrap(), &parameters, PERIOD_S);
        rows += 1;
    }
    assert_eq!(rows, 7000);
}
