//! The files of a measurement: its temporary folder, and the paths of the results.

use anyhow::{Context, Result, ensure};
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// Temporary folder of this process; dropping it removes everything in it.
#[derive(Debug)]
pub(super) struct TemporaryFolder(PathBuf);

impl TemporaryFolder {
    /// Makes a folder with a unique name, accessible only to this user.
    pub(super) fn make() -> Result<Self> {
        let stamp = hapfic_ipc::clock::unix_ns() % 1_000_000_000;
        let path = std::env::temp_dir().join(format!("hapfic-bench-{}-{stamp}", std::process::id()));
        DirBuilder::new()
            .mode(0o700)
            .create(&path)
            .with_context(|| format!("cannot make {}, the temporary folder of the measurement", path.display()))?;
        Ok(Self(path))
    }

    /// Path of a file in the folder.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        // Files that cannot be removed stay in the system's temporary folder.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Checks that a result can be written, before a measurement that may take hours.
pub(super) fn check(option: &str, path: &Path, ending: Option<&str>) -> Result<()> {
    if let Some(ending) = ending {
        let found = path.extension().and_then(|e| e.to_str()).unwrap_or("none");
        ensure!(found == ending, "{option} {}: found the ending '{found}', expected '{ending}'", path.display());
    }
    ensure!(!path.is_dir(), "{option} {}: found a folder, expected the name of a file", path.display());
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    ensure!(folder.is_dir(), "{option} {}: found no folder {}, expected one that exists", path.display(), folder.display());
    let writable = rustix::fs::access(folder, rustix::fs::Access::WRITE_OK).is_ok();
    ensure!(writable, "{option} {}: the folder {} cannot be written to", path.display(), folder.display());
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn folder_drop_removes_files() {
        let folder = TemporaryFolder::make().unwrap();
        let file = folder.file("x");
        std::fs::write(&file, "x").unwrap();
        drop(folder);
        assert!(!file.exists() && !file.parent().unwrap().exists());
    }

    #[test]
    fn check_unwritable_path_is_rejected() {
        let folder = TemporaryFolder::make().unwrap();
        assert!(check("--plot", &folder.file("a.png"), Some("png")).is_ok());
        for (bad, message) in
            [(folder.file("a.svg"), "found the ending 'svg', expected 'png'"), (folder.file("none/a.png"), "found no folder")]
        {
            let error = check("--plot", &bad, Some("png")).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        assert!(check("--json", &folder.0, None).is_err());
    }
}
