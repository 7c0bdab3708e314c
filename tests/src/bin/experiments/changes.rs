//! Operator's changes in a log, and the vertical force after each.

use crate::figures::{AXES, TICK_S};
use hapfic_log::proto::Operator;
use hapfic_log::{LogError, LogMessage, Reader, Record, timeline};
use serde_json::Value;
use std::path::Path;

/// Axis of the pressing force.
const Z: usize = 2;
/// Largest relative force error at which F_d counts as reached.
const REACHED: f64 = 0.01;
/// Consecutive ticks after which F_d counts as kept.
const KEPT_TICKS: usize = 100;
/// Largest additional force with the improvements [N].
const TOLERANCE_N: f64 = 5.0;
/// Parameters with their short names, and factor and unit of the printed values.
const SHORT: [(&str, &str, f64, &str); 6] = [
    ("target_position", "target", 1.0, ""),
    ("desired_force", "F_d", 1.0, ""),
    ("stiffness", "K0", 1.0, ""),
    ("max_force", "F_max", 1.0, ""),
    ("position_bound", "x_b", 1e3, " mm"),
    ("reset_policy", "reset", 1.0, ""),
];

/// Change, and the vertical force from its effective tick until that of the next one.
pub(crate) struct MeasuredChange {
    /// Effective tick.
    pub(crate) tick: i64,
    /// Differences from the previous set, in short.
    pub(crate) what: String,
    /// F_d along z [N].
    pub(crate) desired_n: f64,
    /// Smallest force [N].
    pub(crate) smallest_n: f64,
    /// Largest force [N].
    pub(crate) largest_n: f64,
    /// Force at the last tick [N].
    pub(crate) end_n: f64,
    /// Ticks until the force stays at F_d for the rest; `None` if it does not, or if no force is desired.
    pub(crate) settled_ticks: Option<usize>,
}

impl MeasuredChange {
    /// Measures a change; `None` if the set was never in force.
    fn new(before: &Operator, set: &Operator, forces: &[f64]) -> Option<Self> {
        let desired = *set.desired_force.get(Z)?;
        let within = |force: f64| (force - desired).abs() <= REACHED * desired.abs();
        let kept = forces.iter().rev().take_while(|&&force| within(force)).count();
        Some(Self {
            tick: set.effective_tick,
            what: difference(before, set),
            desired_n: desired,
            smallest_n: forces.iter().copied().reduce(f64::min)?,
            largest_n: forces.iter().copied().reduce(f64::max)?,
            end_n: *forces.last()?,
            settled_ticks: (desired != 0.0 && kept >= KEPT_TICKS).then(|| forces.len() - kept),
        })
    }
}

/// Reads the changes of a log in the order of their versions, without the initial set.
pub(crate) fn read(log: &Path) -> Result<Vec<MeasuredChange>, LogError> {
    let mut forces = Vec::new();
    let entries = Reader::open(log)?.inspect(|entry| {
        if let Ok(LogMessage { record: Record::State(state), .. }) = entry
            && let Some(&force) = state.foot_force.get(Z)
        {
            forces.push((state.tick, force));
        }
    });
    let (sets, errors) = timeline::sets(entries);
    errors.into_iter().next().map_or_else(|| Ok(changes(&sets, &forces)), Err)
}

fn changes(sets: &[Operator], forces: &[(i64, f64)]) -> Vec<MeasuredChange> {
    let ends = sets.iter().skip(2).map(|set| set.effective_tick).chain([i64::MAX]);
    let change = |(pair, end): (&[Operator], i64)| {
        let [before, set] = pair else { return None };
        let window = set.effective_tick..end;
        let inside = forces.iter().filter(|(tick, _)| window.contains(tick));
        MeasuredChange::new(before, set, &inside.map(|&(_, force)| force).collect::<Vec<_>>())
    };
    sets.windows(2).zip(ends).filter_map(change).collect()
}

fn difference(before: &Operator, set: &Operator) -> String {
    let changed = timeline::changed(Some(before), set);
    let parts: Vec<_> = changed.iter().map(|change| part(&change.name, &change.before, &change.now)).collect();
    if parts.is_empty() { "nothing".to_owned() } else { parts.join(", ") }
}

/// Formats one changed parameter. If a vector has changed on all axes, z, the pressing axis, represents them.
fn part(name: &str, old: &Value, new: &Value) -> String {
    let short = SHORT.iter().find(|known| known.0 == name);
    let (label, factor, unit) = short.map_or((name, 1.0, ""), |&(_, label, factor, unit)| (label, factor, unit));
    let text = |value: &Value| match (value.as_f64(), value.as_str()) {
        // Nine decimals, without the rounding errors of the factor.
        (Some(number), _) => format!("{}{unit}", (number * factor * 1e9).round() / 1e9),
        (None, Some(text)) => format!("`{text}`"),
        (None, None) => format!("`{value}`"),
    };
    let Some(values) = new.as_array() else { return format!("{label} {}", text(new)) };
    let mut changed: Vec<_> =
        AXES.iter().zip(values).enumerate().filter(|(axis, (_, value))| old.get(*axis) != Some(*value)).collect();
    if changed.len() == AXES.len() {
        if values.iter().all(|value| *value == values[0]) {
            return format!("{label} {}", text(&values[0]));
        }
        changed.retain(|(axis, _)| *axis == Z);
    }
    let parts: Vec<_> = changed.iter().map(|(_, (axis, value))| format!("{label} {axis} {}", text(value))).collect();
    parts.join(", ")
}

/// Lists the changes after which the foot presses harder with the improvements than without.
///
/// A change counts if the force settles in one of the two runs: where F_d is out of reach, there is no reference. A
/// change after which only the unimproved run settles counts too.
pub(crate) fn regressions(with: &[MeasuredChange], without: &[MeasuredChange]) -> Vec<String> {
    if with.is_empty() || with.len() != without.len() {
        let (found, others) = (with.len(), without.len());
        return vec![format!(
            "tuning: found {found} changes with the improvements and {others} without, expected equal numbers above 0"
        )];
    }
    let mut worse = Vec::new();
    for (a, b) in with.iter().zip(without) {
        let change = format!("tuning, {} at {:.3} s", a.what, a.tick as f64 * TICK_S);
        if (a.settled_ticks.is_some() || b.settled_ticks.is_some()) && a.largest_n > b.largest_n + TOLERANCE_N {
            let most = b.largest_n + TOLERANCE_N;
            let largest = a.largest_n;
            worse.push(format!(
                "{change}: largest F_z {largest:.1} N, expected {most:.1} at most: {TOLERANCE_N} above the unimproved run"
            ));
        }
        if a.settled_ticks.is_none() && b.settled_ticks.is_some() {
            worse.push(format!("{change}: does not settle, the unimproved run does"));
        }
    }
    worse
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(version: u64, tick: i64, desired: f64) -> Operator {
        Operator {
            version,
            effective_tick: tick,
            target_position: vec![-0.1, 0.05, 0.012],
            desired_force: vec![0.0, 0.0, desired],
            stiffness: vec![6000.0, 6000.0, 12000.0],
            position_bound: vec![0.025; 3],
            reset_policy: "contact_loss".to_owned(),
            ..Operator::default()
        }
    }

    #[test]
    fn difference_changed_parameters_only() {
        let old = set(1, 0, 50.0);
        assert_eq!(difference(&old, &set(2, 5, 50.0)), "nothing");
        assert_eq!(difference(&old, &set(2, 5, 80.0)), "F_d z 80");
        let mut new = old.clone();
        new.stiffness = vec![18000.0, 18000.0, 36000.0];
        assert_eq!(difference(&old, &new), "K0 z 36000");
        let mut new = old.clone();
        new.position_bound = vec![0.0025; 3];
        assert_eq!(difference(&old, &new), "x_b 2.5 mm");
        let mut new = old.clone();
        new.reset_policy = "as_printed".to_owned();
        assert_eq!(difference(&old, &new), "reset `as_printed`");
        let mut new = old.clone();
        new.target_position = vec![-0.04, 0.06, 0.012];
        assert_eq!(difference(&old, &new), "target x -0.04, target y 0.06");
        let mut new = old.clone();
        new.gravity_compensation = true;
        assert_eq!(difference(&old, &new), "gravity_compensation `true`");
    }

    #[test]
    fn changes_window_ends_at_next_change() {
        let force = |tick: i64| match tick {
            0..100 => 7.0,
            // 300 ticks to 50 N, with one peak; then 20 N is desired and not reached.
            100..400 => 10.0 + f64::from(u8::from(tick == 250)) * 90.0,
            _ => 50.4,
        };
        let forces: Vec<_> = (0..1000).map(|tick| (tick, force(tick))).collect();
        let found = changes(&[set(1, 0, 0.0), set(2, 100, 50.0), set(3, 600, 20.0)], &forces);
        let [first, second] = found.as_slice() else { panic!("found {} changes, expected 2", found.len()) };
        assert_eq!((first.tick, first.desired_n, first.what.as_str()), (100, 50.0, "F_d z 50"));
        assert_eq!((first.smallest_n, first.largest_n, first.end_n), (10.0, 100.0, 50.4));
        assert_eq!(first.settled_ticks, Some(300));
        assert_eq!((second.tick, second.desired_n), (600, 20.0));
        assert_eq!((second.smallest_n, second.largest_n, second.end_n), (50.4, 50.4, 50.4));
        assert_eq!(second.settled_ticks, None);
        // A change after the end of the log is never in force. A force within reach for too short a time is not
        // settled.
        assert!(changes(&[set(1, 0, 0.0), set(2, 5000, 50.0)], &forces).is_empty());
        let short = changes(&[set(1, 0, 0.0), set(2, 100, 50.0)], &forces[..450]);
        assert_eq!((short.len(), short[0].settled_ticks), (1, None));
    }

    #[test]
    fn regressions_larger_peak_reported_if_settled() {
        let run = |force: f64| {
            let forces: Vec<_> = (0..500).map(|tick| (tick, if tick == 150 { force } else { 50.0 })).collect();
            changes(&[set(1, 0, 0.0), set(2, 100, 50.0), set(3, 300, 80.0)], &forces)
        };
        assert_eq!(regressions(&run(104.0), &run(100.0)), Vec::<String>::new());
        let found = regressions(&run(106.0), &run(100.0));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].contains("F_d z 50 at 0.100 s") && found[0].contains("106.0") && found[0].contains("105.0"),
            "{found:?}"
        );
        // The second window never reaches 80 N, so more force there is no shortfall.
        let mut unreached = run(100.0);
        unreached[1].largest_n = 500.0;
        assert_eq!(regressions(&unreached, &run(100.0)), Vec::<String>::new());
        assert_eq!(regressions(&[], &[]).len(), 1);
        assert_eq!(regressions(&run(100.0), &run(100.0)[..1]).len(), 1);
    }
}
