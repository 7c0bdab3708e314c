//! Output of the parts of a report, each written completely or not at all.

use crate::chart;
use crate::error::ReportError;
use crate::figure::Figure;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Figure as an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FigureImage {
    /// Name of the file, without the extension.
    pub name: String,
    /// Content of the file.
    pub png: Vec<u8>,
}

/// Output paths of the parts of a report. A part without a path is omitted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OutputPaths {
    /// File of the interactive page.
    pub page: Option<PathBuf>,
    /// Folder of the figures for print; created if necessary.
    pub pictures: Option<PathBuf>,
    /// File of the JSON for programs.
    pub json: Option<PathBuf>,
}

/// Names of the parts in errors.
pub(crate) const PAGE: &str = "page";
pub(crate) const JSON: &str = "JSON";
const PICTURES: &str = "pictures";

impl OutputPaths {
    /// Checks all paths before the first is written.
    ///
    /// # Errors
    /// [`ReportError::SameFile`] and [`ReportError::OutputPath`].
    pub(crate) fn check(&self, log: &Path) -> Result<(), ReportError> {
        for (path, what) in [(&self.page, PAGE), (&self.json, JSON)] {
            if let Some(path) = path {
                check(path, log, what)?;
                check_file(path, what)?;
            }
        }
        if let (Some(page), Some(json)) = (&self.page, &self.json)
            && is_same(page, json)
        {
            return Err(invalid_path(json, JSON, "the path of the page", "another file"));
        }
        if let Some(folder) = &self.pictures {
            if folder.exists() && !folder.is_dir() {
                return Err(invalid_path(folder, PICTURES, "a file", "a folder, or nothing yet"));
            }
            // A log with the name of a picture.
            if let Some(name) = log.file_name().filter(|_| log.extension().is_some_and(|extension| extension == "png")) {
                check(&folder.join(name), log, PICTURES)?;
            }
        }
        Ok(())
    }
}

fn invalid_path(path: &Path, what: &'static str, found: &'static str, expected: &'static str) -> ReportError {
    ReportError::OutputPath { path: path.to_owned(), what, found, expected }
}

/// Rejects a path that cannot be a file.
fn check_file(path: &Path, what: &'static str) -> Result<(), ReportError> {
    if path.is_dir() {
        return Err(invalid_path(path, what, "a folder", "the name of a file"));
    }
    if path.file_name().is_none() {
        return Err(invalid_path(path, what, "no file name", "the name of a file"));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if folder.is_some_and(|folder| !folder.is_dir()) {
        return Err(invalid_path(path, what, "no folder of this name", "a path in a folder that exists"));
    }
    Ok(())
}

/// Whether two paths name the same file, which need not exist yet.
fn is_same(a: &Path, b: &Path) -> bool {
    let absolute = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::canonicalize(path).ok().or_else(|| Some(fs::canonicalize(folder).ok()?.join(path.file_name()?)))
    };
    a == b || absolute(a).is_some_and(|a| absolute(b) == Some(a))
}

/// Draws a figure with the given or natural `height` [px].
pub(crate) fn picture(figure: &Figure, height: Option<u32>) -> Result<FigureImage, ReportError> {
    Ok(FigureImage { name: figure.name.to_owned(), png: chart::draw(figure, height)? })
}

/// Rejects the path of the log as output of the part `what`.
pub(crate) fn check(path: &Path, log: &Path, what: &'static str) -> Result<(), ReportError> {
    if is_same(path, log) { Err(ReportError::SameFile { path: path.to_owned(), what }) } else { Ok(()) }
}

/// Writes pictures into a folder, which is created if necessary.
pub(crate) fn pictures(folder: &Path, pictures: &[FigureImage]) -> Result<(), ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Write { path: folder.to_owned(), cause })?;
    pictures.iter().try_for_each(|picture| write(&folder.join(format!("{}.png", picture.name)), &picture.png))
}

/// Writes a file atomically: the old content remains until the new one is complete.
pub(crate) fn write(path: &Path, content: &[u8]) -> Result<(), ReportError> {
    let failed = |cause: io::Error| ReportError::Write { path: path.to_owned(), cause };
    let Some(name) = path.file_name() else {
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it has no file name")));
    };
    // A device or a pipe cannot be replaced.
    if fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        return fs::write(path, content).map_err(failed);
    }
    let mut part_name = name.to_owned();
    part_name.push(format!(".{}.part", std::process::id()));
    let part: PathBuf = path.with_file_name(part_name);
    let written = fs::write(&part, content).and_then(|()| fs::rename(&part, path));
    written.map_err(|cause| {
        let _ = fs::remove_file(&part);
        failed(cause)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn write_existing_file_is_replaced_without_remains() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        write(&path, b"old").unwrap();
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let missing = folder.path().join("missing/report.json");
        assert!(matches!(write(&missing, b"x"), Err(ReportError::Write { path, .. }) if path == missing));
    }

    #[test]
    fn check_path_of_log_is_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("run.mcap");
        fs::write(&log, b"log").unwrap();
        let other_name = folder.path().join(".").join("run.mcap");
        assert!(matches!(check(&other_name, &log, "page"), Err(ReportError::SameFile { .. })));
        assert!(check(&folder.path().join("run.html"), &log, "page").is_ok());
    }

    #[test]
    fn paths_invalid_path_is_rejected_before_writing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| Some(folder.path().join(name));
        let log = folder.path().join("run.mcap");
        fs::write(&log, b"log").unwrap();
        fs::write(folder.path().join("file"), b"").unwrap();
        let valid = OutputPaths { page: at("a.html"), pictures: at("deep/figures"), json: at("a.json") };
        assert!(valid.check(&log).is_ok());
        for invalid in [
            OutputPaths { page: at("missing/a.html"), ..valid.clone() },
            OutputPaths { page: Some(folder.path().to_owned()), ..valid.clone() },
            OutputPaths { page: at("./a.json"), ..valid.clone() },
            OutputPaths { pictures: at("file"), ..valid.clone() },
        ] {
            let error = invalid.check(&log).unwrap_err();
            assert!(matches!(error, ReportError::OutputPath { .. }) && error.is_invalid_request(), "{invalid:?}: {error}");
        }
        let same = OutputPaths { json: at("run.mcap"), ..valid };
        assert!(matches!(same.check(&log), Err(ReportError::SameFile { .. })));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
