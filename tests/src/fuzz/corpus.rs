//! Inputs in files: those that a campaign begins with, and those it found something with.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The corpus of this repository: a folder for each target, with small inputs, among them each that ever found something.
pub const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/corpus");

/// The inputs of a target in a corpus, by file name and in its order; none if the corpus has no folder for it.
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

/// What the file of an input that found something is called.
#[must_use]
pub fn file_name(target: &str, input: &[u8]) -> String {
    // FNV-1a: the same in every version.
    let hash =
        input.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3));
    format!("{target}-{hash:016x}")
}

/// Saves an input that found something, and says where.
///
/// # Errors
/// If the folder cannot be made or the file not be written.
pub fn save(findings: &Path, target: &str, input: &[u8]) -> io::Result<PathBuf> {
    fs::create_dir_all(findings)?;
    let path = findings.join(file_name(target, input));
    fs::write(&path, input)?;
    Ok(path)
}
