//! Input files: the first inputs of a campaign, and those with a finding.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Corpus of this repository: a folder of small inputs for each target, with all inputs that ever had a finding.
pub const CORPUS_FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/corpus");

/// Loads the inputs of a target, sorted by file name; none if the corpus has no folder for the target.
///
/// # Errors
/// If the folder or a file in it cannot be read.
pub fn load(corpus: &Path, target: &str) -> io::Result<Vec<(String, Vec<u8>)>> {
    let folder = corpus.join(target);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut inputs = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            inputs.push((entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path())?));
        }
    }
    inputs.sort();
    Ok(inputs)
}

/// File name of an input with a finding.
#[must_use]
pub fn file_name(target: &str, input: &[u8]) -> String {
    // FNV-1a: the same in every version.
    let hash =
        input.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3));
    format!("{target}-{hash:016x}")
}

/// Saves an input with a finding, and returns its path.
///
/// # Errors
/// If the folder cannot be made, or the file cannot be written.
pub fn save(findings: &Path, target: &str, input: &[u8]) -> io::Result<PathBuf> {
    fs::create_dir_all(findings)?;
    let path = findings.join(file_name(target, input));
    fs::write(&path, input)?;
    Ok(path)
}
