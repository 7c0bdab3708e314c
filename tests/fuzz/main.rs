//! Short campaign for every target, the same each time, with every file of the corpus, so no old finding returns.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_tests::fuzz::{
    ALL_TARGETS, CORPUS_FOLDER, CampaignBudget, CampaignOptions, CampaignResult, FuzzOutcome, FuzzTarget, campaign, load,
    target_named,
};
use std::path::Path;

/// Mutated inputs for each target.
const EXECUTIONS: u64 = 300;
const SEED: u64 = 20_240_601;

fn options(scratch: &Path, corpus: &Path) -> CampaignOptions {
    CampaignOptions {
        budget: CampaignBudget::Executions(EXECUTIONS),
        seed: SEED,
        corpus: corpus.to_owned(),
        scratch: scratch.to_owned(),
        findings: Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz-findings"),
        input_file: None,
    }
}

fn run(target: &'static FuzzTarget, corpus: &Path) -> CampaignResult {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let scratch = tempfile::Builder::new().prefix("fuzz-").tempdir_in(folder).unwrap();
    campaign(target, &options(scratch.path(), corpus)).unwrap()
}

/// Asserts that a campaign has no findings, and is not idle: it accepts inputs, and rejects others for several reasons.
fn expect_no_findings(name: &str) {
    let target = target_named(name).unwrap();
    let result = run(target, Path::new(CORPUS_FOLDER));
    let findings: Vec<_> = result.findings.iter().map(|f| format!("{}: {}", f.file.display(), f.what)).collect();
    assert!(findings.is_empty(), "{}", findings.join("\n"));
    let from_files = load(Path::new(CORPUS_FOLDER), name).unwrap().len() as u64;
    assert_eq!(result.executions, (target.seeds)().len() as u64 + from_files + EXECUTIONS);
    assert!(from_files > 0, "the corpus has nothing for {name}");
    assert!(result.accepted > 0, "no input is accepted");
    assert!(result.shapes.len() > 3, "found the rejections {:?}, expected more than 3 shapes", result.shapes);
}

#[test]
fn config_mutations_no_findings() {
    expect_no_findings("config");
}

#[test]
fn change_mutations_no_findings() {
    expect_no_findings("change");
}

#[test]
fn urdf_mutations_no_findings() {
    expect_no_findings("urdf");
}

#[test]
fn log_mutations_no_findings() {
    expect_no_findings("log");
}

#[test]
fn message_mutations_no_findings() {
    expect_no_findings("message");
}

#[test]
fn runfile_mutations_no_findings() {
    expect_no_findings("runfile");
}

#[test]
fn corpus_folders_match_targets_and_stay_small() {
    for target in &ALL_TARGETS {
        let files = load(Path::new(CORPUS_FOLDER), target.name).unwrap();
        let bytes: usize = files.iter().map(|(_, input)| input.len()).sum();
        assert!(bytes < 60_000, "{} has {bytes} bytes", target.name);
    }
    for entry in std::fs::read_dir(CORPUS_FOLDER).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(target_named(&name).is_some(), "found the folder {name}, expected the name of a target");
    }
}

/// Panics at either of two bytes, each in a line of its own.
fn fragile(input: &[u8], _: &Path) -> FuzzOutcome {
    assert!(!input.contains(&b'!'), "an exclamation mark");
    assert!(!input.contains(&b'?'), "a question mark");
    match input.len() {
        0..=8 => FuzzOutcome::Accepted,
        length => FuzzOutcome::Rejected(format!("{length} bytes")),
    }
}

static FRAGILE: FuzzTarget = FuzzTarget {
    name: "fragile",
    seeds: || vec![b"a sound start".to_vec(), b"short".to_vec()],
    dictionary: &["!", "?"],
    text: true,
    max_bytes: 64,
    execute: fragile,
};

#[test]
fn campaign_panics_saved_by_kind() {
    let empty = tempfile::tempdir().unwrap();
    let result = run(&FRAGILE, empty.path());
    assert_eq!(result.findings.len(), 2, "{:?}", result.findings);
    assert!(result.finding_count > 2 && result.accepted > 0);
    assert_eq!(result.shapes.iter().collect::<Vec<_>>(), ["# bytes"]);
    for (finding, mark) in result.findings.iter().map(|f| (f, if f.what.contains("an exclamation") { b'!' } else { b'?' })) {
        assert!(finding.what.contains("fuzz/main.rs"), "{}", finding.what);
        let input = std::fs::read(&finding.file).unwrap();
        assert!(input.contains(&mark));
        std::fs::remove_file(&finding.file).unwrap();
    }
}

#[test]
fn campaign_same_seed_same_result() {
    let empty = tempfile::tempdir().unwrap();
    let result = || {
        let result = run(target_named("change").unwrap(), empty.path());
        (result.executions, result.accepted, result.shapes, result.findings)
    };
    assert_eq!(result(), result());
}
