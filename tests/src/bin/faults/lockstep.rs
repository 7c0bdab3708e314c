//! Lockstep runs of the matrix: a kill does not change the torque.

use crate::part::table;
use crate::realtime::{DURATION_S, MatrixProcess, PHASES, TICKS, setting, settings};
use crate::runs::{LOG, RunFolder};
use crate::trace::{Trace, TraceCommand};
use std::time::Duration;

/// Time limit of a run: a tick may wait for a starting process, and steal time adds to it.
const LIMIT: Duration = Duration::from_secs(120);
/// Ticks from the fault of the phase `impact` to the first contact.
const BEFORE_IMPACT: usize = 2;

/// Result of a kill.
pub(crate) struct KillResult {
    process: MatrixProcess,
    phase: &'static str,
    at: usize,
    /// Result of the run in a few words.
    end: String,
    pub(crate) completed: bool,
    /// Ticks without fresh torque.
    without_fresh: usize,
    /// Ticks missing in the log.
    missing: usize,
    /// Whether all torques have the same bits as in the undisturbed run.
    same: bool,
}

/// Undisturbed run, and the ticks of the phases.
pub(crate) struct Undisturbed {
    trace: Trace,
    pub(crate) phases: [usize; 4],
}

/// Runs the floor scenario undisturbed and finds its impact. The error names the cause of a failure.
pub(crate) fn undisturbed(folder: &RunFolder) -> Result<Undisturbed, String> {
    let end = folder.floor("lockstep", DURATION_S, &settings(), LIMIT);
    let trace = Trace::read(&folder.path(LOG));
    let first_contact = trace.ticks.iter().position(|tick| tick.in_contact);
    match first_contact {
        Some(impact) if end.completed() && impact > BEFORE_IMPACT => {
            Ok(Undisturbed { trace, phases: [800, impact - BEFORE_IMPACT, 4200, 5000] })
        }
        _ => Err(format!("completed: {}, first contact at tick {first_contact:?}, log: {:?}", end.outcome_text(), trace.error)),
    }
}

/// Kills each process in each phase.
pub(crate) fn rows(folder: &RunFolder, undisturbed: &Undisturbed) -> Vec<KillResult> {
    let expected = torques(&undisturbed.trace);
    let mut rows = Vec::new();
    for process in MatrixProcess::ALL {
        for (phase, at) in PHASES.into_iter().zip(undisturbed.phases) {
            eprintln!("lockstep: {}, {phase}", process.name());
            let mut all = settings();
            // One kill in a run: the first target.
            all.push(setting("kill", "", &[(process.targets(false)[0], at)]));
            let end = folder.floor("lockstep", DURATION_S, &all, LIMIT);
            let trace = Trace::read(&folder.path(LOG));
            rows.push(KillResult {
                process,
                phase,
                at,
                end: end.outcome_text(),
                completed: end.completed(),
                without_fresh: trace.outages().iter().map(ExactSizeIterator::len).sum(),
                missing: trace.missing(TICKS),
                same: torques(&trace) == expected,
            });
        }
    }
    rows
}

/// Bits of all torques, with the mode of the drive.
fn torques(trace: &Trace) -> Vec<Option<(Option<u32>, Vec<u64>)>> {
    let bits = |command: &TraceCommand| {
        let all = command.torque.iter().chain(&command.raw).map(|torque| torque.to_bits());
        (command.mode.map(hapfic_messages::Mode::code), all.collect())
    };
    (0..TICKS).map(|tick| trace.command(tick).map(bits)).collect()
}

impl KillResult {
    /// Whether the torques are the same, and no tick is missing.
    pub(crate) fn is_unchanged(&self) -> bool {
        self.same && self.without_fresh == 0 && self.missing == 0
    }
}

/// Formats the results as a table.
pub(crate) fn as_table(rows: &[KillResult]) -> String {
    let head = ["killed", "phase", "at, s", "completed", "ticks without fresh torque", "same bytes", "log complete"];
    let yes = |yes: bool| if yes { "yes" } else { "**no**" }.to_owned();
    let row = |row: &KillResult| {
        vec![
            row.process.name().to_owned(),
            row.phase.to_owned(),
            format!("{:.3}", row.at as f64 * 1e-3),
            row.end.clone(),
            row.without_fresh.to_string(),
            yes(row.same),
            yes(row.missing == 0),
        ]
    };
    table(&head, &rows.iter().map(row).collect::<Vec<_>>())
}
