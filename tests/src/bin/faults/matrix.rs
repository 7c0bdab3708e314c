//! Matrix of processes, faults and phases: tables and expectations.

use crate::lockstep;
use crate::moment::FaultEffect;
use crate::part::{DocumentPart, Expectation, digits, largest, mean, median, spread, table, verdict};
use crate::realtime::{self, CellKey, CellResult, DURATION_S, FAULTS, LIMIT, MatrixProcess, PHASES};
use crate::runs::{LOG, RunFolder};
use crate::trace::Trace;
use std::collections::BTreeMap;

/// Index of the kill in [`FAULTS`].
const KILL: usize = 0;
/// Largest rounding error of a step [N m].
const ROUNDING: f64 = 1e-9;
/// Median excess below which a fault costs no tick [ticks].
const NO_EXCESS: f64 = 0.5;
/// Largest median time until the next answered tick after a kill of both controllers [ms].
const ANSWERED_AGAIN_MS: f64 = 30.0;

/// Makes the part.
pub(crate) fn make(quick: bool) -> DocumentPart {
    let folder = RunFolder::new();
    let mut expectations = Vec::new();
    let undisturbed = match lockstep::undisturbed(&folder) {
        Ok(undisturbed) => undisturbed,
        Err(found) => {
            expectations.push(Expectation::new("an undisturbed lockstep run", "completes, with an impact", found, false));
            let tables = vec![("matrix", verdict(&expectations)), ("lockstep", String::new()), ("realtime", String::new())];
            return DocumentPart { tables, expectations };
        }
    };
    let rows = lockstep::rows(&folder, &undisturbed);
    let same = rows.iter().filter(|row| row.completed && row.is_unchanged()).count();
    let cells = realtime::matrix(&folder, undisturbed.phases, quick);
    expect(&cells, &mut expectations);
    let figure = format!("{same} of {}", rows.len());
    let what = "kills in lockstep: no tick without fresh torque, torques the same bytes, log complete";
    expectations.push(Expectation::new(what, "all", figure, same == rows.len()));
    expectations.push(plant_loss(&folder, undisturbed.phases[2]));
    let tables =
        vec![("matrix", verdict(&expectations)), ("lockstep", lockstep::as_table(&rows)), ("realtime", as_table(&cells))];
    DocumentPart { tables, expectations }
}

/// The loss of a plant without a restart ends the run.
fn plant_loss(folder: &RunFolder, at: usize) -> Expectation {
    let settings = ["plant.on_loss=fail".to_owned(), realtime::setting("kill", "", &[("plant", at)])];
    let end = folder.floor("realtime", DURATION_S, &settings, LIMIT);
    let trace = Trace::read(&folder.path(LOG));
    let last = trace.last();
    let missing = last.map_or(0, |last| trace.missing(last + 1));
    let named = end.out.contains("FAULT              plant");
    let found = format!(
        "exit code {:?}, plant named: {named}, last tick {last:?}, {missing} missing before it, log readable to its end: {}",
        end.code,
        trace.error.is_none()
    );
    // The last state may have no command.
    let reached = end.code == Some(3) && named && missing == 0 && trace.error.is_none() && last >= Some(at.saturating_sub(5));
    let what = format!("plant killed at {:.3} s with `plant.on_loss = \"fail\"`", at as f64 * 1e-3);
    Expectation::new(&what, "exit code 3 with the plant named, log complete up to there", found, reached)
}

fn values(effects: &[FaultEffect], figure: impl Fn(&FaultEffect) -> Option<f64>) -> Vec<f64> {
    effects.iter().filter_map(figure).collect()
}

/// Effects of all phases.
fn all(phases: &[Vec<FaultEffect>; 4]) -> Vec<FaultEffect> {
    phases.iter().flatten().cloned().collect()
}

fn expect(cells: &BTreeMap<CellKey, CellResult>, expectations: &mut Vec<Expectation>) {
    let none = CellResult::default();
    let killed = |process: MatrixProcess| cells.get(&(process, KILL)).unwrap_or(&none);
    for (process, most) in [(MatrixProcess::Primary, 1.0), (MatrixProcess::Planner, 0.0)] {
        expectations.extend(excess_of(killed(process), &format!("{} killed", process.name()), most));
    }
    let both = all(&killed(MatrixProcess::Both).disturbed);
    let braked: Vec<_> = both.iter().map(|effect| effect.braked_at_missed).collect();
    let second = braked.iter().filter(|missed| **missed == Some(2)).count();
    let what = "both controllers killed: the drive brakes at the second missed tick";
    let found = format!("{second} of {}", braked.len());
    expectations.push(Expectation::new(what, "always", found, second == braked.len() && second > 0));
    let again = values(&both, |effect| effect.answered_again_ms);
    let what = "both controllers killed: from the first missed tick to the next answered one, median";
    let reached = median(&again).is_some_and(|ms| ms < ANSWERED_AGAIN_MS);
    expectations.push(Expectation::new(
        what,
        &format!("below {ANSWERED_AGAIN_MS} ms"),
        format!("{} ms", digits(median(&again), 1)),
        reached,
    ));

    let limit = hapfic_config::Settings::load("floor", &[]).expect("an embedded scenario").supervisor.ramp_rate * 1e-3;
    let steps: Vec<f64> = cells.values().flat_map(|cell| values(&all(&cell.disturbed), |effect| effect.ramp_step)).collect();
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
        "ticks missing in the logs of all realtime runs, without states that the plant corrupts on command",
        "0",
        missing.to_string(),
        missing == 0,
    ));
    let incomplete: Vec<&str> = cells.values().flat_map(|cell| &cell.incomplete).map(String::as_str).collect();
    let found = incomplete.first().map_or("0".to_owned(), |first| format!("{}, the first: {first}", incomplete.len()));
    expectations.push(Expectation::new("realtime runs that did not complete", "0", found, incomplete.is_empty()));
}

/// Expectations of the median and the largest number of ticks that a fault costs, beyond the undisturbed runs.
fn excess_of(cell: &CellResult, what: &str, most: f64) -> [Expectation; 2] {
    let (disturbed, undisturbed) = (all(&cell.disturbed), all(&cell.undisturbed));
    let figures: [fn(&FaultEffect) -> Option<f64>; 2] = [|effect| Some(effect.missed), |effect| Some(effect.without_steal)];
    let [missed, without_steal] = figures.map(|figure| values(&disturbed, figure));
    let [base_missed, base_without_steal] = figures.map(|figure| values(&undisturbed, figure));
    let excess = median(&missed).map(|median| median - mean(&base_missed));
    let worst = largest(&without_steal);
    let noise = largest(&base_without_steal).unwrap_or(0.0);
    [
        Expectation::new(
            &format!("{what}: excess of ticks without fresh torque, median of {}", missed.len()),
            "0",
            digits(excess, 1),
            excess.is_some_and(|excess| excess < NO_EXCESS),
        ),
        Expectation::new(
            &format!("{what}: largest number of them while the plant's timer was not late"),
            &format!("{} at most, {most} above the undisturbed", noise + most),
            digits(worst, 0),
            worst.is_some_and(|worst| worst <= noise + most),
        ),
    ]
}

fn as_table(cells: &BTreeMap<CellKey, CellResult>) -> String {
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
    for ((process, index), cell) in cells {
        let undisturbed = values(&all(&cell.undisturbed), |effect| Some(effect.missed));
        for (phase, name) in PHASES.iter().enumerate() {
            let (effects, others) = (&cell.disturbed[phase], &cell.undisturbed[phase]);
            let list = |figure: fn(&FaultEffect) -> Option<f64>| values(effects, figure);
            let missed = list(|effect| Some(effect.missed));
            let excess: Vec<f64> = missed.iter().map(|missed| missed - mean(&undisturbed)).collect();
            let compared = |figure: fn(&FaultEffect) -> f64, places| {
                let most = |effects: &[FaultEffect]| digits(largest(&values(effects, |effect| Some(figure(effect)))), places);
                format!("{} ({})", most(effects), most(others))
            };
            rows.push(vec![
                process.name().to_owned(),
                FAULTS[*index].name.to_owned(),
                (*name).to_owned(),
                effects.len().to_string(),
                spread(&missed, 0),
                format!("{:.1} / {}", mean(&undisturbed), digits(largest(&undisturbed), 0)),
                spread(&excess, 1),
                format!("{} of {}", effects.iter().filter(|effect| effect.promoted).count(), effects.len()),
                spread(&list(|effect| effect.to_brake_ms), 0),
                spread(&list(|effect| effect.answered_again_ms), 0),
                spread(&list(|effect| effect.recovered_ms), 0),
                spread(&list(|effect| effect.wait_ms), 1),
                compared(|effect| effect.step, 1),
                digits(largest(&list(|effect| effect.ramp_step)), 2),
                compared(|effect| effect.error_mm, 1),
                if cell.missing == 0 { "yes".to_owned() } else { format!("**no**, {} ticks missing", cell.missing) },
            ]);
        }
    }
    table(&head, &rows)
}
