//! `hapfic report`: figures, page and JSON from a log.

use crate::{Outcome, print};
use anyhow::Result;
use clap::Args;
use hapfic_report::{Places, Report, ReportError};
use std::path::PathBuf;

/// What to make of a log.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// A log of `hapfic run`.
    pub log: PathBuf,
    /// One self-contained interactive page; `LOG` with the ending `.html` if nothing is asked for.
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// A folder for the figures as PNG, for print.
    #[arg(long, value_name = "DIR")]
    pub png: Option<PathBuf>,
    /// The summary, the events and the moments of the pictures as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

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
