//! `hapfic report`: figures, page and JSON from a log.

use crate::output::{OutputKind, check_output};
use crate::{CommandOutcome, print};
use anyhow::Result;
use clap::Args;
use hapfic_report::{OutputPaths, Report, ReportError};
use std::path::PathBuf;

/// Arguments of `hapfic report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// Log of `hapfic run`.
    pub log: PathBuf,
    /// File for the self-contained interactive page; `LOG` with the ending `.html` if no output is given.
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Folder for the figures as PNG, for print.
    #[arg(long, value_name = "DIR")]
    pub png: Option<PathBuf>,
    /// File for the summary, the events and the times of the snapshots as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Replace output files of another kind.
    #[arg(long)]
    pub force: bool,
}

/// Reads the log, and writes the requested outputs; by default the page, and a summary to standard output.
pub fn report(args: &ReportArgs) -> Result<CommandOutcome> {
    let page = args.html.clone().or_else(|| no_output_given(args).then(|| args.log.with_extension("html")));
    for (option, path, kind) in [("--html", &page, OutputKind::Page), ("--json", &args.json, OutputKind::Json("events"))] {
        if let Some(path) = path
            && let Err(e) = check_output(option, path, kind, &[&args.log], args.force)
        {
            return Ok(CommandOutcome::Rejected(e));
        }
    }
    match make(args) {
        Ok(()) => Ok(CommandOutcome::Done),
        Err(e) if e.is_invalid_request() => Ok(CommandOutcome::Rejected(e.into())),
        Err(e) => Err(e.into()),
    }
}

fn no_output_given(args: &ReportArgs) -> bool {
    args.html.is_none() && args.png.is_none() && args.json.is_none()
}

/// Writes the outputs, and prints the path of each once it is written.
fn make(args: &ReportArgs) -> Result<(), ReportError> {
    let mut paths = OutputPaths { page: args.html.clone(), pictures: args.png.clone(), json: args.json.clone() };
    let no_output_given = no_output_given(args);
    if no_output_given {
        paths.page = Some(args.log.with_extension("html"));
    }
    let report = Report::read(&args.log)?;
    let mut first = true;
    let about = if no_output_given {
        report.text()
    } else {
        report
            .run()
            .cut_off
            .as_ref()
            .map_or_else(String::new, |cause| format!("the report covers the intact part of the log: {cause}"))
    };
    report.write(&paths, |what, path| {
        // Printed after the first output exists, so that an error stands alone.
        if std::mem::take(&mut first) && !about.is_empty() {
            print(about.trim_end());
        }
        print(&format!("{what}: {}", path.display()));
    })
}
