//! `hapfic report`: figures, page and JSON from a log.

use crate::cli::ReportArgs;
use crate::{Outcome, print};
use anyhow::Result;
use hapfic_report::{Places, Report, ReportError};

/// Reads the log, and writes what was asked for; the page and a summary if nothing was.
pub fn report(args: &ReportArgs) -> Result<Outcome> {
    match make(args) {
        Ok(()) => Ok(Outcome::Done),
        Err(e) if e.is_refusal() => Ok(Outcome::Refused(e.into())),
        Err(e) => Err(e.into()),
    }
}

/// Does it, and says what was written, as soon as it is.
fn make(args: &ReportArgs) -> Result<(), ReportError> {
    let mut places = Places { page: args.html.clone(), pictures: args.png.clone(), json: args.json.clone() };
    let nothing_asked = places == Places::default();
    if nothing_asked {
        places.page = Some(args.log.with_extension("html"));
    }
    let report = Report::read(&args.log)?;
    let mut first = true;
    let about = if nothing_asked {
        report.text()
    } else {
        report.run().cut_off.as_ref().map_or_else(String::new, |cause| format!("the report is made from what is whole: {cause}"))
    };
    report.write(&places, |what, path| {
        // Not before the first part is there: a refusal stands alone.
        if std::mem::take(&mut first) && !about.is_empty() {
            print(about.trim_end());
        }
        print(&format!("{what}: {}", path.display()));
    })
}
