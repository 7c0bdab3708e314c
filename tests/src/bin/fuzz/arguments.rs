//! Command line of `fuzz`.

use hapfic_tests::fuzz::{ALL_TARGETS, CORPUS_FOLDER, FuzzTarget, target_named};
use std::path::PathBuf;

/// Arguments of the command line.
#[derive(Debug)]
pub struct Arguments {
    /// Targets, in their order.
    pub targets: Vec<&'static FuzzTarget>,
    /// Duration for each target [s].
    pub seconds: u64,
    /// Seed of the first job; each further job has the next one.
    pub seed: u64,
    /// Folder of the corpus.
    pub corpus: PathBuf,
    /// Simultaneous campaigns of a target.
    pub jobs: usize,
}

impl Arguments {
    /// Reads the command line. The error has the pattern of all messages: place, found, expected, hint.
    pub fn read(arguments: &[String]) -> Result<Self, String> {
        let names: Vec<&str> = ALL_TARGETS.iter().map(|target| target.name).collect();
        let usage =
            format!("usage: fuzz TARGET|all --seconds N [--seed S] [--corpus DIR] [--jobs N]; targets are {}", names.join(", "));
        let mut targets: Option<Vec<&'static FuzzTarget>> = None;
        let (mut seconds, mut seed, mut jobs, mut corpus) = (None, 1, 1, PathBuf::from(CORPUS_FOLDER));
        let mut rest = arguments.iter();
        while let Some(argument) = rest.next() {
            let mut value =
                || rest.next().ok_or_else(|| format!("fuzz: {argument}: found nothing after it, expected a value; {usage}"));
            match argument.as_str() {
                "--seconds" => seconds = Some(whole(argument, value()?, 0)?),
                "--seed" => seed = whole(argument, value()?, 0)?,
                "--jobs" => jobs = whole(argument, value()?, 1)?,
                "--corpus" => corpus = PathBuf::from(value()?),
                "all" if targets.is_none() => targets = Some(ALL_TARGETS.iter().collect()),
                name if targets.is_none() && target_named(name).is_some() => {
                    targets = Some(target_named(name).into_iter().collect())
                }
                other => return Err(format!("fuzz: found {other:?}, expected one target or an option; {usage}")),
            }
        }
        let (Some(targets), Some(seconds)) = (targets, seconds) else {
            return Err(format!("fuzz: found no {}; {usage}", if seconds.is_none() { "--seconds" } else { "target" }));
        };
        Ok(Self { targets, seconds, seed, corpus, jobs: usize::try_from(jobs).map_err(|e| e.to_string())? })
    }
}

fn whole(option: &str, text: &str, least: u64) -> Result<u64, String> {
    match text.parse() {
        Ok(number) if number >= least => Ok(number),
        _ => Err(format!("fuzz: {option}: found {text:?}, expected a whole number from {least} on; change it")),
    }
}
