//! `hapfic report`: figures, page and JSON from a log.

use crate::cli::ReportArgs;
use crate::{Outcome, print};
use anyhow::Result;
use hapfic_report::{Report, ReportError};

/// Reads the log, and writes what was asked for; the page and a summary if nothing was.
pub fn report(args: &ReportArgs) -> Result<Outcome> {
    Ok(match make(args) {
        Ok(text) => {
            print(text.trim_end());
            Outcome::Done
        }
        Err(e) => Outcome::Refused(e.into()),
    })
}

/// Does it; returns what to say.
fn make(args: &ReportArgs) -> Result<String, ReportError> {
    let report = Report::read(&args.log)?;
    let mut said = String::new();
    let mut html = args.html.clone();
    if args.html.is_none() && args.png.is_none() && args.json.is_none() {
        said = report.text();
        html = Some(args.log.with_extension("html"));
    } else if let Some(cause) = &report.run().cut_off {
        said = format!("the report is made from what is whole: {cause}\n");
    }
    if let Some(path) = html {
        report.write_html(&path)?;
        said.push_str(&format!("page: {}\n", path.display()));
    }
    if let Some(folder) = &args.png {
        let count = report.write_pictures(folder)?;
        said.push_str(&format!("{count} pictures: {}\n", folder.display()));
    }
    if let Some(path) = &args.json {
        report.write_json(path)?;
        said.push_str(&format!("JSON: {}\n", path.display()));
    }
    Ok(said)
}
