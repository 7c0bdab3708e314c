//! A decoder as the fuzzer sees it.

use std::path::Path;

/// What a decoder made of an input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FuzzOutcome {
    /// It was taken, and whatever uses it did so.
    Accepted,
    /// It was rejected, in these words.
    Refused(String),
}

/// A decoder, and what to feed it.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// What it is called on the command line, and its folder in the corpus.
    pub name: &'static str,
    /// Inputs to begin with, beside those of the corpus.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Words of its format.
    pub dictionary: &'static [&'static str],
    /// Whether lines, words and numbers mean something in it.
    pub text: bool,
    /// Longest input, bytes.
    pub longest: usize,
    /// Decodes an input and uses what comes out of it; panics if a promise is broken. The folder is empty at first and its own.
    pub execute: fn(&[u8], &Path) -> FuzzOutcome,
}
