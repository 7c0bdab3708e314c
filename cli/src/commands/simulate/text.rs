//! Text output of a study.

use hapfic_simulation::study::{Done, End};
use hapfic_simulation::sweep::Grid;
use std::fmt::Write;

/// Name and width of the columns after the swept values.
const COLUMNS: [(&str, usize); 7] = [
    ("|x - x_d| mm", 12),
    ("contact N", 10),
    ("settled %", 11),
    ("missed N", 9),
    ("sliding %", 9),
    ("torque N m", 10),
    ("work J", 9),
];
/// Last column, of any width.
const ENDED: &str = "ended";

/// Table of a sweep, printed line by line as the runs end.
pub struct SweepTable {
    widths: Vec<usize>,
}

impl SweepTable {
    /// Makes a table with columns wide enough for all values.
    #[must_use]
    pub fn new(grid: &Grid) -> Self {
        let longest = |texts: &[String]| texts.iter().map(|text| text.chars().count()).max().unwrap_or(0);
        let width = |key: &str, values: &[String]| longest(values).max(key.chars().count());
        Self { widths: grid.sweeps().iter().map(|sweep| width(&sweep.key, &sweep.values)).collect() }
    }

    /// Formats the head.
    #[must_use]
    pub fn head(&self, grid: &Grid) -> String {
        let keys: Vec<&str> = grid.sweeps().iter().map(|sweep| sweep.key.as_str()).collect();
        self.line(&keys, &COLUMNS.map(|(name, _)| name.to_owned()), ENDED)
    }

    /// Formats the line of a run, with the largest value of the three axes.
    #[must_use]
    pub fn row(&self, values: &[&str], done: &Done) -> String {
        let force = &done.metrics.force;
        let cells = [
            format!("{:.3}", largest(&done.metrics.tracking.max_m.map(Some)).unwrap_or(0.0) * 1e3),
            format!("{:.2}", done.extremes.contact_force_n),
            settled(largest(&force.settled_rms_percent), force.not_reached.iter().sum()),
            some(worst(&force.not_reached_error_n)),
            some(largest(&force.sliding_rms_percent)),
            format!("{:.2}", done.extremes.largest_torque()),
            format!("{:.3}", done.extremes.work_j),
        ];
        self.line(values, &cells, &ended(done))
    }

    fn line(&self, values: &[&str], cells: &[String; COLUMNS.len()], ended: &str) -> String {
        let mut line = String::new();
        // Writing to a string cannot fail.
        for (value, width) in values.iter().zip(&self.widths) {
            let _ = write!(line, "{value:<width$}  ");
        }
        for (cell, (_, width)) in cells.iter().zip(COLUMNS) {
            let _ = write!(line, "{cell:>width$}  ");
        }
        line + ended
    }
}

/// Formats the result of a single run.
#[must_use]
pub fn single(scenario: &str, done: &Done) -> String {
    let mut out = format!("{scenario} (in one process): {}, {:.3} s simulated\n", ended(done), done.simulated_s());
    let mut line = |name: &str, text: String| {
        let _ = writeln!(out, "  {name:<18} {text}");
    };
    let axes = |values: [String; 3]| format!("x {}  y {}  z {}", values[0], values[1], values[2]);
    let (tracking, force) = (&done.metrics.tracking, &done.metrics.force);
    line("|x - x_d| max", axes(tracking.max_m.map(|v| format!("{:.3}", v * 1e3))) + " mm");
    line("          rms", axes(tracking.rms_m.map(|v| format!("{:.3}", v * 1e3))) + " mm");
    line("outside x_b", format!("{} ticks", tracking.outside_ticks));
    line("|F_c| max", axes(done.metrics.force_command.max_n.map(|v| format!("{v:.1}"))) + " N");
    line(
        "contact force max",
        format!("{:.2} N at one contact, {:.2} N on the foot", done.extremes.contact_force_n, done.extremes.foot_force_n),
    );
    let held = std::array::from_fn(|axis| settled(force.settled_rms_percent[axis], force.not_reached[axis]));
    line("settled rms", axes(held) + " % of F_d");
    if force.not_reached.iter().any(|segments| *segments > 0) {
        line("F_d missed by", axes(force.not_reached_error_n.map(some)) + " N");
    }
    line("sliding rms", axes(force.sliding_rms_percent.map(some)) + " % of F_d");
    let limited = done.extremes.limited_ticks;
    line("torque max", format!("{:.2} N m, limited in {limited} ticks", done.extremes.largest_torque()));
    if let Some(orientation) = &tracking.orientation {
        let [most, last] = [orientation.max_rad, orientation.last_rad].map(f64::to_degrees);
        line("|e_R|", format!("at most {most:.3}, at the end {last:.4} degrees"));
    }
    line("work of the joints", format!("{:.3} J", done.extremes.work_j));
    for task in &done.tasks {
        let place = if task.place.is_empty() { String::new() } else { format!(" on {}", task.place) };
        line("task", format!("{}{place} {} times, {:.3} s: {}", task.condition, task.times, task.total_s, task.found));
    }
    let integration = &done.metrics.integration;
    line("energy", format!("balance off by {:.1e} J of {:.4} J", integration.energy_error_j, integration.energy_range_j));
    line("contacts", format!("created {:.1e} J", integration.contact_energy_created_j));
    line("sub-steps", format!("{} cut, {} unconverged", integration.cut, integration.unconverged));
    if integration.passages > 0 {
        line("PASSAGES", format!("{}: a body went through another one", integration.passages));
    }
    out
}

/// Formats duration and speed of a study with so many jobs on so many cores.
#[must_use]
pub fn speed(runs: usize, simulated_s: f64, wall_s: f64, [jobs, cores]: [usize; 2]) -> String {
    let rate = rate(simulated_s, wall_s);
    let runs = if runs == 1 { "1 run".to_owned() } else { format!("{runs} runs") };
    let job = if jobs == 1 { "job" } else { "jobs" };
    format!(
        "{runs}, {simulated_s:.3} s simulated in {wall_s:.2} s: {rate:.1} x real time, {:.1} x per core ({jobs} {job})",
        rate / cores as f64
    )
}

/// Simulated time per wall-clock time; zero if that is zero.
#[must_use]
pub fn rate(simulated_s: f64, wall_s: f64) -> f64 {
    if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 }
}

fn ended(done: &Done) -> String {
    match &done.end {
        End::Completed => "completed".to_owned(),
        End::Failed(error) => format!("NOT COMPLETED: {error}"),
        End::Stopped => "NOT COMPLETED: interrupted".to_owned(),
    }
}

fn largest(values: &[Option<f64>; 3]) -> Option<f64> {
    values.iter().flatten().copied().reduce(f64::max)
}

/// The value of the largest size, with its sign.
fn worst(values: &[Option<f64>; 3]) -> Option<f64> {
    values.iter().flatten().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()))
}

/// Formats a settled error; without one, tells whether a force was not reached.
fn settled(rms_percent: Option<f64>, not_reached: u64) -> String {
    if rms_percent.is_none() && not_reached > 0 { "not reached".to_owned() } else { some(rms_percent) }
}

fn some(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.3}"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn table_row_aligns_with_head() {
        let grid = Grid::read(&["controller.taper=0.1,0.25".to_owned(), "k=[0, 0, 50]".to_owned()]).unwrap();
        let table = SweepTable::new(&grid);
        let mut done = Done { ticks: 10, ..Done::default() };
        done.metrics.tracking.max_m = [0.001, 0.0075, 0.0];
        done.metrics.force.settled_rms_percent = [None, Some(0.5), Some(0.25)];
        let (head, row) = (table.head(&grid), table.row(&grid.values(1), &done));
        assert_eq!(
            head,
            "controller.taper  k           |x - x_d| mm   contact N    settled %   missed N  sliding %  torque N m     work J  ended"
        );
        assert_eq!(
            row,
            "0.25              [0, 0, 50]         7.500        0.00        0.500          -          -        0.00      0.000  completed"
        );
    }

    #[test]
    fn force_never_reached_shows_its_error() {
        let grid = Grid::read(&["a=1,2".to_owned()]).unwrap();
        let mut done = Done { ticks: 10, ..Done::default() };
        done.metrics.force.not_reached = [0, 0, 1];
        done.metrics.force.not_reached_error_n[2] = Some(-12.5);
        let row = SweepTable::new(&grid).row(&["1"], &done);
        assert!(row.contains("  not reached    -12.500          -  "), "{row}");
        let text = single("floor", &done);
        assert!(text.contains("x -  y -  z not reached % of F_d") && text.contains("x -  y -  z -12.500 N"), "{text}");
        // Another hold of the run may have been reached.
        done.metrics.force.settled_rms_percent[2] = Some(0.5);
        assert!(single("floor", &done).contains("z 0.500 % of F_d"));
    }

    #[test]
    fn speed_several_cores_gives_total_and_per_core() {
        let text = speed(12, 120.0, 3.0, [2, 2]);
        assert_eq!(text, "12 runs, 120.000 s simulated in 3.00 s: 40.0 x real time, 20.0 x per core (2 jobs)");
        assert!(speed(1, 0.0, 0.0, [1, 1]).ends_with("0.0 x real time, 0.0 x per core (1 job)"));
    }

    #[test]
    fn single_failed_run_names_cause() {
        let done = Done { end: End::Failed("tick 3: it overflowed".to_owned()), ..Done::default() };
        assert!(single("floor", &done).starts_with("floor (in one process): NOT COMPLETED: tick 3: it overflowed, 0.000 s"));
    }
}
