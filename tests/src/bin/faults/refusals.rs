//! Bad messages: that they are rejected, and that the run goes on.

use crate::part::{Expectation, Part, table, verdict};
use crate::realtime::{setting, settings};
use crate::runs::{LOG, Place};
use crate::trace::Trace;
use hapfic_messages::EventKind;
use std::time::Duration;

const DURATION_S: f64 = 2.0;
const TICKS: usize = 2000;
/// The first tick of the fault, and how many there are.
const AT: usize = 900;
const FOR: &str = ",for_ms=3";
/// How long a run may take: in lockstep the clock stands still until somebody notices that a message does not come.
const LIMIT: Duration = Duration::from_secs(120);
/// What is done to messages, and whether what is sent must be rejected: an old tick may also be passed over as known.
const KINDS: [(&str, bool); 5] = [("nan", true), ("stale", false), ("corrupt", true), ("repeat", false), ("drop", false)];
/// The clocks, and who sends bad messages. A plant that does in lockstep leaves nothing to go on with.
const CLOCKS: [(&str, &[&str]); 2] =
    [("realtime", &["controller", "planner", "plant"]), ("lockstep", &["controller", "planner"])];

/// Messages that are spoilt in a run.
const SPOILT: usize = 3;

/// Makes the part.
pub(crate) fn make() -> Part {
    let place = Place::new();
    let head = ["clock", "sender", "messages", "rejected", "events of it", "lost", "completed", "log complete"];
    let (mut rows, mut incomplete, mut silent) = (Vec::new(), Vec::new(), Vec::new());
    for (clock, senders) in CLOCKS {
        for sender in senders {
            for (kind, rejected) in KINDS {
                eprintln!("{clock}: {kind} by the {sender}");
                let mut all = settings();
                all.push(setting(kind, FOR, &[(*sender, AT)]));
                let end = place.floor(clock, DURATION_S, &all, LIMIT);
                let trace = Trace::read(&place.path(LOG));
                let name = format!("{kind} by {sender} in {clock}");
                // States that the plant itself has spoilt are rejected by the recorder, too.
                let missing = trace.missing(TICKS).saturating_sub(if *sender == "plant" { SPOILT } else { 0 });
                let events = trace.events(EventKind::Rejected).count();
                if !end.completed() || missing > 0 {
                    incomplete.push(name.clone());
                }
                if rejected && trace.rejected() == 0 {
                    silent.push(name);
                }
                rows.push(vec![
                    clock.to_owned(),
                    (*sender).to_owned(),
                    kind.to_owned(),
                    trace.rejected().to_string(),
                    events.to_string(),
                    trace.events(EventKind::Lost).count().to_string(),
                    end.word(),
                    if missing == 0 { "yes".to_owned() } else { format!("**no**, {missing} ticks missing") },
                ]);
            }
        }
    }
    let listed = |names: &[String]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let expectations = vec![
        Expectation::new(
            "runs with bad messages that do not complete, or without a whole log",
            "none",
            listed(&incomplete),
            incomplete.is_empty(),
        ),
        Expectation::new("bad messages that nobody refuses", "none", listed(&silent), silent.is_empty()),
    ];
    Part { tables: vec![("refusals", format!("{}\n{}", verdict(&expectations), table(&head, &rows)))], expectations }
}
