//! A short campaign for every target, the same each time, and every file of the corpus: what once found something does not again.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_tests::fuzz::{ALL, Budget, FOLDER, FuzzOutcome, Options, Tally, Target, campaign, load, named};
use std::path::Path;

/// Mutated inputs a target.
const EXECUTIONS: u64 = 300;
const SEED: u64 = 20_240_601;

fn options(scratch: &Path, corpus: &Path) -> Options {
    Options {
        budget: Budget::Executions(EXECUTIONS),
        seed: SEED,
        corpus: corpus.to_owned(),
        scratch: scratch.to_owned(),
        findings: Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz-findings"),
        notebook: None,
    }
}

fn run(target: &'static Target, corpus: &Path) -> Tally {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let scratch = tempfile::Builder::new().prefix("fuzz-").tempdir_in(folder).unwrap();
    campaign(target, &options(scratch.path(), corpus)).unwrap()
}

/// Nothing is found, and the campaign is not an idle one: inputs are accepted, and rejected for several reasons.
fn finds_nothing(name: &str) {
    let target = named(name).unwrap();
    let tally = run(target, Path::new(FOLDER));
    let findings: Vec<_> = tally.findings.iter().map(|f| format!("{}: {}", f.file.display(), f.what)).collect();
    assert!(findings.is_empty(), "{}", findings.join("\n"));
    let from_files = load(Path::new(FOLDER), name).unwrap().len() as u64;
    assert_eq!(tally.executions, (target.seeds)().len() as u64 + from_files + EXECUTIONS);
    assert!(from_files > 0, "the corpus has nothing for {name}");
    assert!(tally.accepted > 0, "nothing is accepted");
    assert!(tally.shapes.len() > 3, "rejected: {:?}", tally.shapes);
}

#[test]
fn scenarios() {
    finds_nothing("config");
}

#[test]
fn changes() {
    finds_nothing("change");
}

#[test]
fn robot_descriptions() {
    finds_nothing("urdf");
}

#[test]
fn logs() {
    finds_nothing("log");
}

#[test]
fn messages() {
    finds_nothing("message");
}

#[test]
fn run_files() {
    finds_nothing("runfile");
}

#[test]
fn the_corpus_has_a_folder_for_each_target_and_stays_small() {
    for target in &ALL {
        let files = load(Path::new(FOLDER), target.name).unwrap();
        let bytes: usize = files.iter().map(|(_, input)| input.len()).sum();
        assert!(bytes < 60_000, "{} has {bytes} bytes", target.name);
    }
    for entry in std::fs::read_dir(FOLDER).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(named(&name).is_some(), "no target is called {name}");
    }
}

/// Panics where an input has a certain byte, in one of two places.
fn fragile(input: &[u8], _: &Path) -> FuzzOutcome {
    assert!(!input.contains(&b'!'), "an exclamation mark");
    assert!(!input.contains(&b'?'), "a question mark");
    match input.len() {
        0..=8 => FuzzOutcome::Accepted,
        length => FuzzOutcome::Refused(format!("{length} bytes")),
    }
}

static FRAGILE: Target = Target {
    name: "fragile",
    seeds: || vec![b"a sound start".to_vec(), b"short".to_vec()],
    dictionary: &["!", "?"],
    text: true,
    longest: 64,
    execute: fragile,
};

#[test]
fn a_panic_is_found_saved_and_told_from_others() {
    let nowhere = tempfile::tempdir().unwrap();
    let tally = run(&FRAGILE, nowhere.path());
    assert_eq!(tally.findings.len(), 2, "{:?}", tally.findings);
    assert!(tally.finding_count > 2 && tally.accepted > 0);
    assert_eq!(tally.shapes.iter().collect::<Vec<_>>(), ["# bytes"]);
    for (finding, mark) in tally.findings.iter().map(|f| (f, if f.what.contains("an exclamation") { b'!' } else { b'?' })) {
        assert!(finding.what.contains("fuzz/main.rs"), "{}", finding.what);
        let input = std::fs::read(&finding.file).unwrap();
        assert!(input.contains(&mark));
        std::fs::remove_file(&finding.file).unwrap();
    }
}

#[test]
fn the_same_seed_gives_the_same_campaign() {
    let nowhere = tempfile::tempdir().unwrap();
    let tally = || {
        let tally = run(named("change").unwrap(), nowhere.path());
        (tally.executions, tally.accepted, tally.shapes, tally.findings)
    };
    assert_eq!(tally(), tally());
}
