//! Report of a run.

use crate::collect::Collected;
use crate::error::ReportError;
use crate::figure::Figure;
use crate::output::{self, FigureImage, OutputPaths};
use crate::run::RunInfo;
use crate::tasks::TaskSummary;
use crate::{Incident, LoggedEvent, figures, html, snapshots, table};
use hapfic_log::{LogError, LogMessage, LogParts, Names, Reader};
use serde_json::{Value, json};
use std::io::Read;
use std::path::Path;

/// Content of a report.
#[derive(Clone, Debug)]
pub struct Report {
    run: RunInfo,
    names: Names,
    metrics: Value,
    collected: Collected,
}

impl Report {
    /// Reads a log with all its parts, once from its start to its end.
    ///
    /// For a truncated or damaged log, the report covers the part before the damage. [`RunInfo::cut_off`] holds the
    /// cause.
    ///
    /// # Errors
    /// [`ReportError::Log`] if the file cannot be opened or is no log, [`ReportError::Empty`] if it holds no state.
    pub fn read(log: &Path) -> Result<Self, ReportError> {
        let log_parts = LogParts::open(log)?;
        let (run, names) = (RunInfo::new(log.to_owned(), log_parts.metadata()), log_parts.names());
        Self::collect(log_parts, run, names)
    }

    /// Reads an open log, as [`Report::read`]; the report names it `log`.
    ///
    /// # Errors
    /// [`ReportError::Empty`].
    pub fn from_reader<R: Read>(reader: Reader<R>, log: &Path) -> Result<Self, ReportError> {
        let (run, names) = (RunInfo::new(log.to_owned(), reader.metadata()), reader.names());
        Self::collect(reader, run, names)
    }

    fn collect(
        messages: impl Iterator<Item = Result<LogMessage, LogError>>,
        mut run: RunInfo,
        names: Names,
    ) -> Result<Self, ReportError> {
        let mut collected = Collected::default();
        let mut cut_off = None;
        for entry in messages {
            match entry {
                Ok(entry) => collected.push(&entry),
                // Of several damaged parts the first is named.
                Err(error) => cut_off = cut_off.or_else(|| Some(error.to_string())),
            }
        }
        if collected.states == 0 {
            let others = format!("{} messages of other topics", collected.messages);
            let found = cut_off.map_or_else(|| others.clone(), |cause| format!("{others} ({cause})"));
            return Err(ReportError::Empty { path: run.log, found });
        }
        run.end(collected.last_tick, collected.messages, cut_off);
        collected.events.sort();
        collected.tasks.end(collected.last_tick);
        // Every metric is finite, so the conversion to JSON cannot fail.
        let metrics = serde_json::to_value(collected.metrics.summary()).unwrap_or(Value::Null);
        Ok(Self { run, names, metrics, collected })
    }

    /// Description of the run, from the log.
    #[must_use]
    pub const fn run(&self) -> &RunInfo {
        &self.run
    }

    /// Metrics, in the form of `hapfic_log::MetricsSummary`.
    #[must_use]
    pub const fn metrics(&self) -> &Value {
        &self.metrics
    }

    /// Listed events, in the order of time: at most [`crate::MAX_EVENTS`] faults, changes by the operator, actions of
    /// the supervisor and others each.
    #[must_use]
    pub fn events(&self) -> &[LoggedEvent] {
        self.collected.events.kept()
    }

    /// Periods with a braking or stopped drive, in the order of time; the first [`crate::MAX_INCIDENTS`].
    #[must_use]
    pub fn incidents(&self) -> Vec<Incident> {
        self.collected.incidents.listed(self.events())
    }

    /// Makes the figures of the page.
    #[must_use]
    pub fn figures(&self) -> Vec<Figure> {
        figures::all(&self.collected, &self.run, &self.names)
    }

    /// Makes the overview: height and force of the foot and contact pairs, in one figure.
    #[must_use]
    pub fn overview(&self) -> Figure {
        figures::overview(&self.collected, &self.run)
    }

    /// Times of the snapshots [s] and their reasons.
    #[must_use]
    pub fn snapshot_times(&self) -> Vec<(f64, String)> {
        snapshots::times(&self.collected.frames)
    }

    /// Draws the figures for print, as PNG.
    ///
    /// # Errors
    /// [`ReportError::Draw`].
    pub fn pictures(&self) -> Result<Vec<FigureImage>, ReportError> {
        let mut pictures = Vec::new();
        for figure in self.figures() {
            pictures.push(output::picture(&figure, None)?);
        }
        pictures.push(output::picture(&self.overview(), Some(1000))?);
        if let Some(png) = self.snapshots()? {
            pictures.push(FigureImage { name: "snapshots".to_owned(), png });
        }
        Ok(pictures)
    }

    /// Draws the snapshots side by side, as PNG; `None` if the log has no messages for viewers.
    ///
    /// # Errors
    /// [`ReportError::Draw`].
    pub fn snapshots(&self) -> Result<Option<Vec<u8>>, ReportError> {
        snapshots::draw(&self.collected.frames)
    }

    /// Makes the interactive page, one self-contained file.
    ///
    /// # Errors
    /// [`ReportError::Draw`], for the snapshots.
    pub fn html(&self) -> Result<String, ReportError> {
        let snapshots = self.snapshots()?;
        Ok(html::page(&html::PageContent {
            run: &self.run,
            metrics: &self.shown(),
            events: &self.collected.events,
            figures: &self.figures(),
            snapshots: snapshots.as_deref(),
            snapshot_times: &self.snapshot_times(),
        }))
    }

    /// Makes the JSON for programs: run, metrics, events, conditions of the task, incidents and times of the snapshots.
    #[must_use]
    pub fn json(&self) -> Value {
        let events = &self.collected.events;
        let snapshots: Vec<_> =
            self.snapshot_times().into_iter().map(|(time_s, reason)| json!({ "time_s": time_s, "reason": reason })).collect();
        json!({
            "run": self.run,
            "metrics": self.metrics,
            "events": { "total": events.total(), "by_kind": events.counts(), "listed": events.kept() },
            "tasks": self.collected.tasks.summary(),
            "incidents": { "total": self.collected.incidents.total(), "listed": self.incidents() },
            "snapshots": snapshots,
        })
    }

    /// Metrics and conditions of the task, as pages and text show them.
    fn shown(&self) -> Value {
        let mut shown = self.metrics.clone();
        let tasks = self.collected.tasks.summary();
        if let (Value::Object(sections), false) = (&mut shown, tasks.is_empty()) {
            let of = |task: &TaskSummary| (task.condition.clone(), json!({ "times": task.times, "total_s": task.total_s }));
            let rows: serde_json::Map<_, _> = tasks.iter().map(of).collect();
            sections.insert("task".to_owned(), Value::Object(rows));
        }
        shown
    }

    /// Formats run and metrics for the terminal.
    #[must_use]
    pub fn text(&self) -> String {
        table::text(&self.run, &self.shown(), self.collected.events.total())
    }

    /// Writes the page.
    ///
    /// # Errors
    /// [`ReportError::SameFile`], [`ReportError::Write`] and those of [`Report::html`].
    pub fn write_html(&self, path: &Path) -> Result<(), ReportError> {
        output::check(path, &self.run.log, output::PAGE)?;
        output::write(path, self.html()?.as_bytes())
    }

    /// Writes all parts with a path, and calls `written` with name and path of each.
    ///
    /// All paths are checked and all parts are made before the first is written.
    ///
    /// # Errors
    /// [`ReportError::SameFile`], [`ReportError::OutputPath`], [`ReportError::Draw`], with nothing written;
    /// [`ReportError::Write`].
    pub fn write(&self, paths: &OutputPaths, mut written: impl FnMut(&str, &Path)) -> Result<(), ReportError> {
        paths.check(&self.run.log)?;
        let page = paths.page.as_deref().map(|path| Ok::<_, ReportError>((path, self.html()?))).transpose()?;
        let pictures = paths.pictures.as_deref().map(|folder| Ok::<_, ReportError>((folder, self.pictures()?))).transpose()?;
        if let Some((path, page)) = page {
            output::write(path, page.as_bytes())?;
            written("page", path);
        }
        if let Some((folder, pictures)) = pictures {
            output::pictures(folder, &pictures)?;
            written(&format!("{} pictures", pictures.len()), folder);
        }
        if let Some(path) = paths.json.as_deref() {
            output::write(path, self.json_text().as_bytes())?;
            written("JSON", path);
        }
        Ok(())
    }

    fn json_text(&self) -> String {
        format!("{:#}\n", self.json())
    }

    /// Writes the JSON for programs.
    ///
    /// # Errors
    /// [`ReportError::SameFile`] and [`ReportError::Write`].
    pub fn write_json(&self, path: &Path) -> Result<(), ReportError> {
        output::check(path, &self.run.log, output::JSON)?;
        output::write(path, self.json_text().as_bytes())
    }

    /// Writes the figures for print into a folder, which is created if necessary; returns their number.
    ///
    /// # Errors
    /// [`ReportError::Write`] and those of [`Report::pictures`].
    pub fn write_pictures(&self, folder: &Path) -> Result<usize, ReportError> {
        let pictures = self.pictures()?;
        output::pictures(folder, &pictures)?;
        Ok(pictures.len())
    }
}
