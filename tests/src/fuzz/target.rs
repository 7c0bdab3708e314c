//! Fuzz target: a decoder, its seeds and its dictionary.

use std::path::Path;

/// Result of an execution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FuzzOutcome {
    /// The decoder accepted the input, and all its users processed it.
    Accepted,
    /// The decoder rejected the input, with this message.
    Rejected(String),
}

/// Decoder with its inputs.
#[derive(Clone, Copy, Debug)]
pub struct FuzzTarget {
    /// Name on the command line, and of its folder in the corpus.
    pub name: &'static str,
    /// First inputs, beside those of the corpus.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Words of the format.
    pub dictionary: &'static [&'static str],
    /// Whether the format is text, so that lines, words and numbers are mutated.
    pub text: bool,
    /// Largest input [bytes].
    pub max_bytes: usize,
    /// Decodes an input and uses the result; panics if a property does not hold. The folder, empty at first, is for its
    /// files.
    pub execute: fn(&[u8], &Path) -> FuzzOutcome,
}
