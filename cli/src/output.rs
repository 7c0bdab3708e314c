//! Guard of output files: a command replaces only files of the kind that it writes, and never its own input.

use anyhow::{Result, bail, ensure};
use std::fs::{File, metadata};
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Kind of an output file, by which a command recognises a file of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// MCAP log.
    Log,
    /// JSON object with this key in its first 4 KiB.
    Json(&'static str),
    /// Table whose first line has this column.
    Csv(&'static str),
    /// Page of a report.
    Page,
    /// PNG picture.
    Picture,
}

impl OutputKind {
    fn name(self) -> &'static str {
        match self {
            Self::Log => "MCAP log",
            Self::Json(_) => "JSON of this command",
            Self::Csv(_) => "table of this command",
            Self::Page => "report page",
            Self::Picture => "PNG picture",
        }
    }

    fn matches(self, start: &[u8]) -> bool {
        let text = String::from_utf8_lossy(start);
        match self {
            Self::Log => start.starts_with(b"\x89MCAP0\r\n"),
            Self::Json(key) => text.starts_with('{') && text.contains(&format!("\"{key}\"")),
            Self::Csv(column) => text.lines().next().is_some_and(|head| head.split(',').any(|name| name == column)),
            Self::Page => text.starts_with("<!DOCTYPE html>"),
            Self::Picture => start.starts_with(b"\x89PNG\r\n"),
        }
    }
}

/// Checks that a command may write `path`, before it starts anything. `inputs` are files that the command reads.
///
/// # Errors
/// If the path is an input, or (without `force`) a file with content of another kind.
pub fn check_output(option: &str, path: &Path, kind: OutputKind, inputs: &[&Path], force: bool) -> Result<()> {
    let Ok(found) = metadata(path) else { return Ok(()) };
    ensure!(!found.is_dir(), "{option} {}: found a folder, expected the name of a file", path.display());
    for input in inputs {
        let same = metadata(input).is_ok_and(|input| (input.dev(), input.ino()) == (found.dev(), found.ino()));
        ensure!(!same, "{option} {}: found the input file itself, expected another file", path.display());
    }
    // A device or a pipe cannot be replaced.
    if force || !found.is_file() || found.len() == 0 {
        return Ok(());
    }
    let mut start = Vec::new();
    if let Err(e) = File::open(path).and_then(|file| file.take(4096).read_to_end(&mut start)) {
        bail!("{option} {}: cannot read the file that is there: {e}. Hint: give another path", path.display());
    }
    ensure!(
        kind.matches(&start),
        "{option} {}: found a file that is no {}, expected no file or one that may be replaced. Hint: give another path, or \
         --force",
        path.display(),
        kind.name()
    );
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn output_foreign_file_is_rejected_unless_forced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let cases: [(OutputKind, &[u8]); 5] = [
            (OutputKind::Log, b"\x89MCAP0\r\nabc"),
            (OutputKind::Json("scenario"), b"{\n  \"scenario\": \"floor\"}"),
            (OutputKind::Csv("simulated_s"), b"a,simulated_s\n1,2\n"),
            (OutputKind::Page, b"<!DOCTYPE html>\n<html>"),
            (OutputKind::Picture, b"\x89PNG\r\n\x1a\n"),
        ];
        for (kind, own) in cases {
            let _ = std::fs::remove_file(&path);
            assert!(check_output("--out", &path, kind, &[], false).is_ok(), "no file yet");
            for (content, ok) in [(own, true), (b"".as_slice(), true), (b"precious".as_slice(), false)] {
                std::fs::write(&path, content).unwrap();
                assert_eq!(check_output("--out", &path, kind, &[], false).is_ok(), ok, "{kind:?}: {content:?}");
                assert!(check_output("--out", &path, kind, &[], true).is_ok());
            }
        }
        for (kind, foreign) in [(OutputKind::Json("scenario"), "{\"name\": 1}"), (OutputKind::Csv("simulated_s"), "a,b\n")] {
            std::fs::write(&path, foreign).unwrap();
            let error = check_output("--out", &path, kind, &[], false).unwrap_err().to_string();
            assert!(error.contains("--out") && error.contains("Hint"), "{error}");
        }
    }

    #[test]
    fn output_input_is_rejected_even_if_forced() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("m.toml");
        std::fs::write(&input, "x = 1").unwrap();
        let link = folder.path().join("link");
        std::fs::hard_link(&input, &link).unwrap();
        for path in [&input, &link] {
            assert!(check_output("--log", path, OutputKind::Log, &[&input], true).is_err());
        }
        assert!(check_output("--log", folder.path(), OutputKind::Log, &[], true).is_err(), "a folder");
    }
}
