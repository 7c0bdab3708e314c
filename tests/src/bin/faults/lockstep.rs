//! The lockstep runs of the matrix: a kill changes nothing of the torque.

use crate::part::table;
use crate::realtime::{DURATION_S, PHASES, TICKS, Who, setting, settings};
use crate::runs::{LOG, Place};
use crate::trace::{Command, Trace};
use std::time::Duration;

/// How long a run may take: a tick may have to wait for a process that is being started, and the host for others.
const LIMIT: Duration = Duration::from_secs(120);
/// Ticks before the first contact at which the impact's fault happens.
const BEFORE_IMPACT: usize = 2;

/// What came of a kill.
pub(crate) struct Row {
    who: Who,
    phase: &'static str,
    at: usize,
    /// How the run ended, in a word.
    end: String,
    pub(crate) completed: bool,
    without: usize,
    missing: usize,
    same: bool,
}

/// An undisturbed run, and the ticks of the phases.
pub(crate) struct Undisturbed {
    trace: Trace,
    pub(crate) phases: [usize; 4],
}

/// Runs the floor undisturbed and looks for its impact. The error says why there is none.
pub(crate) fn undisturbed(place: &Place) -> Result<Undisturbed, String> {
    let end = place.floor("lockstep", DURATION_S, &settings(), LIMIT);
    let trace = Trace::read(&place.path(LOG));
    let touched = trace.ticks.iter().position(|tick| tick.touches);
    match touched {
        Some(impact) if end.completed() && impact > BEFORE_IMPACT => {
            Ok(Undisturbed { trace, phases: [800, impact - BEFORE_IMPACT, 4200, 5000] })
        }
        _ => Err(format!("completed: {}, first contact at tick {touched:?}, log: {:?}", end.word(), trace.error)),
    }
}

/// Kills each process in each phase.
pub(crate) fn rows(place: &Place, undisturbed: &Undisturbed) -> Vec<Row> {
    let expected = torques(&undisturbed.trace);
    let mut rows = Vec::new();
    for who in Who::ALL {
        for (phase, at) in PHASES.into_iter().zip(undisturbed.phases) {
            eprintln!("lockstep: {}, {phase}", who.name());
            let mut all = settings();
            // One kill in a run: the first target is meant.
            all.push(setting("kill", "", &[(who.targets(false)[0], at)]));
            let end = place.floor("lockstep", DURATION_S, &all, LIMIT);
            let trace = Trace::read(&place.path(LOG));
            rows.push(Row {
                who,
                phase,
                at,
                end: end.word(),
                completed: end.completed(),
                without: trace.outages().iter().map(ExactSizeIterator::len).sum(),
                missing: trace.missing(TICKS),
                same: torques(&trace) == expected,
            });
        }
    }
    rows
}

/// All torques, bit by bit, with what the drive is asked to do.
fn torques(trace: &Trace) -> Vec<Option<(Option<u32>, Vec<u64>)>> {
    let bits = |command: &Command| {
        let all = command.torque.iter().chain(&command.raw).map(|torque| torque.to_bits());
        (command.mode.map(hapfic_messages::Mode::code), all.collect())
    };
    (0..TICKS).map(|tick| trace.command(tick).map(bits)).collect()
}

impl Row {
    /// Nothing of the torque differs, and nothing is missing.
    pub(crate) fn is_the_same(&self) -> bool {
        self.same && self.without == 0 && self.missing == 0
    }
}

/// As a table.
pub(crate) fn as_table(rows: &[Row]) -> String {
    let head = ["killed", "phase", "at, s", "completed", "ticks without fresh torque", "same bytes", "log complete"];
    let yes = |yes: bool| if yes { "yes" } else { "**no**" }.to_owned();
    let row = |row: &Row| {
        vec![
            row.who.name().to_owned(),
            row.phase.to_owned(),
            format!("{:.3}", row.at as f64 * 1e-3),
            row.end.clone(),
            row.without.to_string(),
            yes(row.same),
            yes(row.missing == 0),
        ]
    };
    table(&head, &rows.iter().map(row).collect::<Vec<_>>())
}
