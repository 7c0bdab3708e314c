//! Writes what a report is made of, whole or not at all.

use crate::chart;
use crate::error::ReportError;
use crate::figure::Figure;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A figure as a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Name of its file, without the extension.
    pub name: String,
    /// The file's content.
    pub png: Vec<u8>,
}

/// Draws a figure; `height`, px, is as much as it takes if not given.
pub(crate) fn picture(figure: &Figure, height: Option<u32>) -> Result<Picture, ReportError> {
    Ok(Picture { name: figure.name.to_owned(), png: chart::draw(figure, height)? })
}

/// Refuses to write over the log; `what` is what would be written.
pub(crate) fn check(path: &Path, log: &Path, what: &'static str) -> Result<(), ReportError> {
    let same = path == log
        || match (fs::canonicalize(path), fs::canonicalize(log)) {
            (Ok(path), Ok(log)) => path == log,
            _ => false,
        };
    if same { Err(ReportError::SameFile { path: path.to_owned(), what }) } else { Ok(()) }
}

/// Makes a folder, if there is none.
pub(crate) fn folder(path: &Path) -> Result<(), ReportError> {
    fs::create_dir_all(path).map_err(|cause| ReportError::Write { path: path.to_owned(), cause })
}

/// Writes a file. It is complete at once: what is there before stays until then.
pub(crate) fn write(path: &Path, content: &[u8]) -> Result<(), ReportError> {
    let failed = |cause: io::Error| ReportError::Write { path: path.to_owned(), cause };
    let Some(name) = path.file_name() else {
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it names no file")));
    };
    // A device or a pipe cannot be replaced, nor should it be.
    if fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        return fs::write(path, content).map_err(failed);
    }
    let mut beside = name.to_owned();
    beside.push(format!(".{}.part", std::process::id()));
    let part: PathBuf = path.with_file_name(beside);
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
    fn a_file_is_replaced_whole_and_nothing_is_left_beside_it() {
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
    fn the_log_itself_is_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("run.mcap");
        fs::write(&log, b"log").unwrap();
        let other_name = folder.path().join(".").join("run.mcap");
        assert!(matches!(check(&other_name, &log, "page"), Err(ReportError::SameFile { .. })));
        assert!(check(&folder.path().join("run.html"), &log, "page").is_ok());
    }
}
