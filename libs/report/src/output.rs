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

/// Where the parts of a report go; those without a place are not made.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Places {
    /// File of the interactive page.
    pub page: Option<PathBuf>,
    /// Folder of the figures for print; made if there is none.
    pub pictures: Option<PathBuf>,
    /// File of what programs read.
    pub json: Option<PathBuf>,
}

/// What errors call the parts.
pub(crate) const PAGE: &str = "page";
pub(crate) const JSON: &str = "JSON";
const PICTURES: &str = "pictures";

impl Places {
    /// Whether every part can go where it is to, as far as that can be told before writing.
    ///
    /// # Errors
    /// [`ReportError::SameFile`] and [`ReportError::Place`].
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
            return Err(no_place(json, JSON, "the place of the page", "a file of its own"));
        }
        if let Some(folder) = &self.pictures {
            if folder.exists() && !folder.is_dir() {
                return Err(no_place(folder, PICTURES, "a file", "a folder, or nothing yet"));
            }
            // A log that is called like a picture.
            if let Some(name) = log.file_name().filter(|_| log.extension().is_some_and(|extension| extension == "png")) {
                check(&folder.join(name), log, PICTURES)?;
            }
        }
        Ok(())
    }
}

fn no_place(path: &Path, what: &'static str, found: &'static str, expected: &'static str) -> ReportError {
    ReportError::Place { path: path.to_owned(), what, found, expected }
}

/// Refuses a path at which no file can be.
fn check_file(path: &Path, what: &'static str) -> Result<(), ReportError> {
    if path.is_dir() {
        return Err(no_place(path, what, "a folder", "the name of a file"));
    }
    if path.file_name().is_none() {
        return Err(no_place(path, what, "no name of a file", "one"));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if folder.is_some_and(|folder| !folder.is_dir()) {
        return Err(no_place(path, what, "no folder of this name", "a path in a folder that exists"));
    }
    Ok(())
}

/// Whether two paths name one file, which need not exist yet.
fn is_same(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::canonicalize(path).ok().or_else(|| Some(fs::canonicalize(folder).ok()?.join(path.file_name()?)))
    };
    a == b || whole(a).is_some_and(|a| whole(b) == Some(a))
}

/// Draws a figure; `height`, px, is as much as it takes if not given.
pub(crate) fn picture(figure: &Figure, height: Option<u32>) -> Result<Picture, ReportError> {
    Ok(Picture { name: figure.name.to_owned(), png: chart::draw(figure, height)? })
}

/// Refuses to write over the log; `what` is what would be written.
pub(crate) fn check(path: &Path, log: &Path, what: &'static str) -> Result<(), ReportError> {
    if is_same(path, log) { Err(ReportError::SameFile { path: path.to_owned(), what }) } else { Ok(()) }
}

/// Writes pictures into a folder, which is made if there is none.
pub(crate) fn pictures(folder: &Path, pictures: &[Picture]) -> Result<(), ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Write { path: folder.to_owned(), cause })?;
    pictures.iter().try_for_each(|picture| write(&folder.join(format!("{}.png", picture.name)), &picture.png))
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

    #[test]
    fn places_are_refused_before_anything_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| Some(folder.path().join(name));
        let log = folder.path().join("run.mcap");
        fs::write(&log, b"log").unwrap();
        fs::write(folder.path().join("file"), b"").unwrap();
        let good = Places { page: at("a.html"), pictures: at("deep/figures"), json: at("a.json") };
        assert!(good.check(&log).is_ok());
        for bad in [
            Places { page: at("missing/a.html"), ..good.clone() },
            Places { page: Some(folder.path().to_owned()), ..good.clone() },
            Places { page: at("./a.json"), ..good.clone() },
            Places { pictures: at("file"), ..good.clone() },
        ] {
            let error = bad.check(&log).unwrap_err();
            assert!(matches!(error, ReportError::Place { .. }) && error.is_refusal(), "{bad:?}: {error}");
        }
        let same = Places { json: at("run.mcap"), ..good };
        assert!(matches!(same.check(&log), Err(ReportError::SameFile { .. })));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
