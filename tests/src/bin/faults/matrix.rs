//! Process, fault and phase: the tables, and what is expected of them.

use crate::lockstep;
use crate::moment::Moment;
use crate::part::{Expectation, Part, digits, largest, mean, median, spread, table, verdict};
use crate::realtime::{self, Cell, DURATION_S, KINDS, Key, LIMIT, PHASES, Who};
use crate::runs::{LOG, Place};
use crate::trace::Trace;
use std::collections::BTreeMap;

/// Place of the kill in the list of faults.
const KILL: usize = 0;
/// Most that rounding may add to a step, N m.
const ROUNDING: f64 = 1e-9;
/// In a median or mean of ticks: none.
const NONE: f64 = 0.5;
/// Longest median until a controller answers again after both were killed, ms.
const BACK_MS: f64 = 30.0;

/// Makes the part.
pub(crate) fn make(quick: bool) -> Part {
    let place = Place::new();
    let mut expectations = Vec::new();
    let undisturbed = match lockstep::undisturbed(&place) {
        Ok(undisturbed) => undisturbed,
        Err(found) => {
            expectations.push(Expectation::new("an undisturbed lockstep run", "completes, with an impact", found, false));
            let tables = vec![("matrix", verdict(&expectations)), ("lockstep", String::new()), ("realtime", String::new())];
            return Part { tables, expectations };
        }
    };
    let rows = lockstep::rows(&place, &undisturbed);
    let same = rows.iter().filter(|row| row.completed && row.is_the_same()).count();
    let cells = realtime::matrix(&place, undisturbed.phases, quick);
    expect(&cells, &mut expectations);
    let figure = format!("{same} of {}", rows.len());
    let what = "kills in lockstep: no tick without fresh torque, torques the same bytes, log complete";
    expectations.push(Expectation::new(what, "all", figure, same == rows.len()));
    expectations.push(fails(&place, undisturbed.phases[2]));
    let tables =
        vec![("matrix", verdict(&expectations)), ("lockstep", lockstep::as_table(&rows)), ("realtime", as_table(&cells))];
    Part { tables, expectations }
}

/// A plant that is killed and must not be started again ends the run.
fn fails(place: &Place, at: usize) -> Expectation {
    let settings = ["plant.on_loss=fail".to_owned(), realtime::setting("kill", "", &[("plant", at)])];
    let end = place.floor("realtime", DURATION_S, &settings, LIMIT);
    let trace = Trace::read(&place.path(LOG));
    let last = trace.last();
    let missing = last.map_or(0, |last| trace.missing(last + 1));
    let told = end.out.contains("FAULT              plant");
    let found = format!(
        "exit code {:?}, plant named: {told}, last tick {last:?}, {missing} missing before it, log readable to its end: {}",
        end.code,
        trace.error.is_none()
    );
    // The last state may have had no command any more.
    let reached = end.code == Some(3) && told && missing == 0 && trace.error.is_none() && last >= Some(at.saturating_sub(5));
    let what = format!("plant killed at {:.3} s with `plant.on_loss = \"fail\"`", at as f64 * 1e-3);
    Expectation::new(&what, "exit code 3 with the plant named, log complete up to there", found, reached)
}

fn values(moments: &[Moment], figure: impl Fn(&Moment) -> Option<f64>) -> Vec<f64> {
    moments.iter().filter_map(figure).collect()
}

/// All moments of a cell.
fn all(phases: &[Vec<Moment>; 4]) -> Vec<Moment> {
    phases.iter().flatten().cloned().collect()
}

fn expect(cells: &BTreeMap<Key, Cell>, expectations: &mut Vec<Expectation>) {
    let none = Cell::default();
    let killed = |who: Who| cells.get(&(who, KILL)).unwrap_or(&none);
    for (who, most) in [(Who::Primary, 1.0), (Who::Planner, 0.0)] {
        expectations.extend(excess_of(killed(who), &format!("{} killed", who.name()), most));
    }
    let both = all(&killed(Who::Both).disturbed);
    let braked: Vec<_> = both.iter().map(|moment| moment.braked_at_missed).collect();
    let second = braked.iter().filter(|missed| **missed == Some(2)).count();
    let what = "both controllers killed: the drive brakes at the second missed tick";
    let found = format!("{second} of {}", braked.len());
    expectations.push(Expectation::new(what, "always", found, second == braked.len() && second > 0));
    let back = values(&both, |moment| moment.back_ms);
    let what = "both controllers killed: from the first missed tick to the next answered one, median";
    let reached = median(&back).is_some_and(|ms| ms < BACK_MS);
    expectations.push(Expectation::new(
        what,
        &format!("below {BACK_MS} ms"),
        format!("{} ms", digits(median(&back), 1)),
        reached,
    ));

    let limit = hapfic_config::Settings::load("floor", &[]).expect("an embedded scenario").supervisor.ramp_rate * 1e-3;
    let steps: Vec<f64> = cells.values().flat_map(|cell| values(&all(&cell.disturbed), |moment| moment.ramp_step)).collect();
    let reached = largest(&steps).is_some_and(|step| step <= limit + ROUNDING);
    let what = "largest step of a torque that ramps in after a brake, all rows";
    expectations.push(Expectation::new(
        what,
        &format!("{limit} N m at most"),
        format!("{} N m", digits(largest(&steps), 3)),
        reached,
    ));

    let missing: usize = cells.values().map(|cell| cell.missing).sum();
    expectations.push(Expectation::new(
        "ticks that the logs of all realtime runs have not, but for states that the plant was told to spoil",
        "0",
        missing.to_string(),
        missing == 0,
    ));
    let broken: Vec<&str> = cells.values().flat_map(|cell| &cell.broken).map(String::as_str).collect();
    let found = broken.first().map_or("0".to_owned(), |first| format!("{}, the first: {first}", broken.len()));
    expectations.push(Expectation::new("realtime runs that did not complete", "0", found, broken.is_empty()));
}

/// The median and the largest number of ticks that a fault costs beyond what the host costs.
fn excess_of(cell: &Cell, what: &str, most: f64) -> [Expectation; 2] {
    let (disturbed, beside) = (all(&cell.disturbed), all(&cell.beside));
    let figures: [fn(&Moment) -> Option<f64>; 2] = [|moment| Some(moment.missed), |moment| Some(moment.own)];
    let [missed, own] = figures.map(|figure| values(&disturbed, figure));
    let [other_missed, other_own] = figures.map(|figure| values(&beside, figure));
    let excess = median(&missed).map(|median| median - mean(&other_missed));
    let worst = largest(&own);
    let noise = largest(&other_own).unwrap_or(0.0);
    [
        Expectation::new(
            &format!("{what}: excess of ticks without fresh torque, median of {}", missed.len()),
            "0",
            digits(excess, 1),
            excess.is_some_and(|excess| excess < NONE),
        ),
        Expectation::new(
            &format!("{what}: largest number of them while the plant's timer was not late"),
            &format!("{} at most, {most} above the undisturbed", noise + most),
            digits(worst, 0),
            worst.is_some_and(|worst| worst <= noise + most),
        ),
    ]
}

fn as_table(cells: &BTreeMap<Key, Cell>) -> String {
    let head = [
        "process",
        "fault",
        "phase",
        "n",
        "ticks without fresh torque",
        "undisturbed: mean / max",
        "excess",
        "promoted",
        "to brake, ms",
        "answered again after, ms",
        "recovered after, ms",
        "longest wait for a command, ms",
        "torque step, N m (undisturbed)",
        "step ramping in, N m",
        "\\|x - x_d\\|, mm (undisturbed)",
        "log complete",
    ];
    let mut rows = Vec::new();
    for ((who, index), cell) in cells {
        let beside = values(&all(&cell.beside), |moment| Some(moment.missed));
        for (phase, name) in PHASES.iter().enumerate() {
            let (moments, others) = (&cell.disturbed[phase], &cell.beside[phase]);
            let list = |figure: fn(&Moment) -> Option<f64>| values(moments, figure);
            let missed = list(|moment| Some(moment.missed));
            let excess: Vec<f64> = missed.iter().map(|missed| missed - mean(&beside)).collect();
            let compared = |figure: fn(&Moment) -> f64, places| {
                let most = |moments: &[Moment]| digits(largest(&values(moments, |moment| Some(figure(moment)))), places);
                format!("{} ({})", most(moments), most(others))
            };
            rows.push(vec![
                who.name().to_owned(),
                KINDS[*index].name.to_owned(),
                (*name).to_owned(),
                moments.len().to_string(),
                spread(&missed, 0),
                format!("{:.1} / {}", mean(&beside), digits(largest(&beside), 0)),
                spread(&excess, 1),
                format!("{} of {}", moments.iter().filter(|moment| moment.promoted).count(), moments.len()),
                spread(&list(|moment| moment.to_brake_ms), 0),
                spread(&list(|moment| moment.back_ms), 0),
                spread(&list(|moment| moment.recovered_ms), 0),
                spread(&list(|moment| moment.wait_ms), 1),
                compared(|moment| moment.step, 1),
                digits(largest(&list(|moment| moment.ramp_step)), 2),
                compared(|moment| moment.error_mm, 1),
                if cell.missing == 0 { "yes".to_owned() } else { format!("**no**, {} ticks missing", cell.missing) },
            ]);
        }
    }
    table(&head, &rows)
}
