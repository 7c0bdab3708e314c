//! The operator's changes in a log, and what the vertical force did after each.

use crate::figures::{AXES, TICK_S};
use hapfic_log::proto::Operator;
use hapfic_log::{Entry, LogError, Reader, Record, timeline};
use serde_json::Value;
use std::path::Path;

/// The axis that presses.
const Z: usize = 2;
/// F_d counts as reached within this share of it.
const REACHED: f64 = 0.01;
/// F_d counts as kept if it was reached for so many ticks in a row.
const KEPT: usize = 100;
/// How much harder the foot may press with the improvements than without, N.
const SURPLUS_N: f64 = 5.0;
/// Short names of parameters, with the factor and the unit that they are written with.
const SHORT: [(&str, &str, f64, &str); 6] = [
    ("target_position", "target", 1.0, ""),
    ("desired_force", "F_d", 1.0, ""),
    ("stiffness", "K0", 1.0, ""),
    ("max_force", "F_max", 1.0, ""),
    ("position_bound", "x_b", 1e3, " mm"),
    ("reset_policy", "reset", 1.0, ""),
];

/// A change, and the vertical force from the tick at which it takes effect until the next one does.
pub(crate) struct Change {
    /// First tick at which it is in force.
    pub(crate) tick: i64,
    /// What differs from the set before, in short.
    pub(crate) what: String,
    /// F_d along z, N.
    pub(crate) desired_n: f64,
    /// The smallest force, N.
    pub(crate) least_n: f64,
    /// The largest force, N.
    pub(crate) largest_n: f64,
    /// The force at the last tick, N.
    pub(crate) end_n: f64,
    /// Ticks until the force stays within reach of F_d for the rest; `None` if it does not, or if no force is wished.
    pub(crate) settled_ticks: Option<usize>,
}

impl Change {
    /// `None` if the set was never in force.
    fn new(before: &Operator, set: &Operator, forces: &[f64]) -> Option<Self> {
        let desired = *set.desired_force.get(Z)?;
        let within = |force: f64| (force - desired).abs() <= REACHED * desired.abs();
        let kept = forces.iter().rev().take_while(|&&force| within(force)).count();
        Some(Self {
            tick: set.effective_tick,
            what: difference(before, set),
            desired_n: desired,
            least_n: forces.iter().copied().reduce(f64::min)?,
            largest_n: forces.iter().copied().reduce(f64::max)?,
            end_n: *forces.last()?,
            settled_ticks: (desired != 0.0 && kept >= KEPT).then(|| forces.len() - kept),
        })
    }
}

/// The changes of a log in the order of their versions; the set it starts with is none.
pub(crate) fn read(log: &Path) -> Result<Vec<Change>, LogError> {
    let mut forces = Vec::new();
    let entries = Reader::open(log)?.inspect(|entry| {
        if let Ok(Entry { record: Record::State(state), .. }) = entry
            && let Some(&force) = state.foot_force.get(Z)
        {
            forces.push((state.tick, force));
        }
    });
    let (sets, error) = timeline::sets(entries);
    error.map_or_else(|| Ok(changes(&sets, &forces)), Err)
}

fn changes(sets: &[Operator], forces: &[(i64, f64)]) -> Vec<Change> {
    let ends = sets.iter().skip(2).map(|set| set.effective_tick).chain([i64::MAX]);
    let change = |(pair, end): (&[Operator], i64)| {
        let [before, set] = pair else { return None };
        let window = set.effective_tick..end;
        let inside = forces.iter().filter(|(tick, _)| window.contains(tick));
        Change::new(before, set, &inside.map(|&(_, force)| force).collect::<Vec<_>>())
    };
    sets.windows(2).zip(ends).filter_map(change).collect()
}

fn difference(before: &Operator, set: &Operator) -> String {
    let changed = timeline::changed(Some(before), set);
    let parts: Vec<_> = changed.iter().map(|change| part(&change.name, &change.before, &change.now)).collect();
    if parts.is_empty() { "nothing".to_owned() } else { parts.join(", ") }
}

/// One parameter that has changed. Of a vector that has changed on all axes, z stands for them: it is what presses.
fn part(name: &str, old: &Value, new: &Value) -> String {
    let short = SHORT.iter().find(|known| known.0 == name);
    let (label, factor, unit) = short.map_or((name, 1.0, ""), |&(_, label, factor, unit)| (label, factor, unit));
    let text = |value: &Value| match (value.as_f64(), value.as_str()) {
        // To nine digits after the point: the factor must not bring any that nobody wrote.
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

/// Changes after which the foot presses harder with the improvements than without, in words.
///
/// Only those count after which one of the two settles: where F_d cannot be met, there is no right force. One after which only the
/// unimproved run settles is worse, too.
pub(crate) fn worse(with: &[Change], without: &[Change]) -> Vec<String> {
    if with.is_empty() || with.len() != without.len() {
        let (found, others) = (with.len(), without.len());
        return vec![format!(
            "tuning: found {found} changes with the improvements and {others} without, expected as many, not 0"
        )];
    }
    let mut worse = Vec::new();
    for (a, b) in with.iter().zip(without) {
        let change = format!("tuning, {} at {:.3} s", a.what, a.tick as f64 * TICK_S);
        if (a.settled_ticks.is_some() || b.settled_ticks.is_some()) && a.largest_n > b.largest_n + SURPLUS_N {
            let most = b.largest_n + SURPLUS_N;
            let largest = a.largest_n;
            worse.push(format!(
                "{change}: largest F_z {largest:.1} N, expected {most:.1} at most: {SURPLUS_N} above the unimproved run"
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
    fn only_what_differs_is_told() {
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
    fn a_change_counts_until_the_next_one() {
        let force = |tick: i64| match tick {
            0..100 => 7.0,
            // 300 ticks to 50 N, with one peak; then 20 N is wished and not reached.
            100..400 => 10.0 + f64::from(u8::from(tick == 250)) * 90.0,
            _ => 50.4,
        };
        let forces: Vec<_> = (0..1000).map(|tick| (tick, force(tick))).collect();
        let found = changes(&[set(1, 0, 0.0), set(2, 100, 50.0), set(3, 600, 20.0)], &forces);
        let [first, second] = found.as_slice() else { panic!("found {} changes, expected 2", found.len()) };
        assert_eq!((first.tick, first.desired_n, first.what.as_str()), (100, 50.0, "F_d z 50"));
        assert_eq!((first.least_n, first.largest_n, first.end_n), (10.0, 100.0, 50.4));
        assert_eq!(first.settled_ticks, Some(300));
        assert_eq!((second.tick, second.desired_n), (600, 20.0));
        assert_eq!((second.least_n, second.largest_n, second.end_n), (50.4, 50.4, 50.4));
        assert_eq!(second.settled_ticks, None);
        // Never in force: after the log's end. Reached for less than it takes: by chance.
        assert!(changes(&[set(1, 0, 0.0), set(2, 5000, 50.0)], &forces).is_empty());
        let short = changes(&[set(1, 0, 0.0), set(2, 100, 50.0)], &forces[..450]);
        assert_eq!((short.len(), short[0].settled_ticks), (1, None));
    }

    #[test]
    fn more_force_than_without_improvements_falls_short_where_f_d_is_reached() {
        let run = |force: f64| {
            let forces: Vec<_> = (0..500).map(|tick| (tick, if tick == 150 { force } else { 50.0 })).collect();
            changes(&[set(1, 0, 0.0), set(2, 100, 50.0), set(3, 300, 80.0)], &forces)
        };
        assert_eq!(worse(&run(104.0), &run(100.0)), Vec::<String>::new());
        let found = worse(&run(106.0), &run(100.0));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].contains("F_d z 50 at 0.100 s") && found[0].contains("106.0") && found[0].contains("105.0"),
            "{found:?}"
        );
        // The second window never gets to 80 N, so more force there is no shortfall.
        let mut failed_connections = run(100.0);
        failed_connections[1].largest_n = 500.0;
        assert_eq!(worse(&failed_connections, &run(100.0)), Vec::<String>::new());
        assert_eq!(worse(&[], &[]).len(), 1);
        assert_eq!(worse(&run(100.0), &run(100.0)[..1]).len(), 1);
    }
}
