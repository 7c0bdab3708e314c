//! Campaign: executes a target with mutated inputs, and collects the findings.

use super::corpus;
use super::mutate::mutated;
use super::quiet::caught;
use super::shape::shape;
use super::target::{FuzzOutcome, FuzzTarget};
use super::watch::Watchdog;
use fastrand::Rng;
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest execution that is not a finding.
pub const SLOW: Duration = Duration::from_secs(5);
/// Largest number of inputs kept for mutation; further ones replace earlier ones.
const MAX_INPUTS: usize = 2000;

/// Length of a campaign, beside one execution of every seed and corpus file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CampaignBudget {
    /// Number of executions, identical for the same seed.
    Executions(u64),
    /// Duration.
    Time(Duration),
}

/// Options of a campaign.
#[derive(Clone, Debug)]
pub struct CampaignOptions {
    /// Length.
    pub budget: CampaignBudget,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Folder of the corpus.
    pub corpus: PathBuf,
    /// Empty folder for the target's files.
    pub scratch: PathBuf,
    /// Folder for inputs with a finding; made with the first one.
    pub findings: PathBuf,
    /// File that holds the current input, for the parent process after an abort.
    pub input_file: Option<PathBuf>,
}

/// Failure of a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Cause.
    pub what: String,
    /// Path of its input.
    pub file: PathBuf,
}

/// Result of a campaign.
#[derive(Clone, Debug, Default)]
pub struct CampaignResult {
    /// Number of executions.
    pub executions: u64,
    /// Executions with an accepted input.
    pub accepted: u64,
    /// Rejections that differ in more than numbers and quotations.
    pub shapes: BTreeSet<String>,
    /// Duration.
    pub elapsed: Duration,
    /// Findings, one of each kind.
    pub findings: Vec<Finding>,
    /// Number of findings, repeated kinds included.
    pub finding_count: u64,
}

/// Runs a campaign.
///
/// # Errors
/// If the corpus cannot be read, or a finding or the input file cannot be written.
pub fn campaign(target: &'static FuzzTarget, options: &CampaignOptions) -> io::Result<CampaignResult> {
    let mut inputs = (target.seeds)();
    inputs.extend(corpus::load(&options.corpus, target.name)?.into_iter().map(|(_, input)| input));
    let kept = inputs.len();
    let mut state = CampaignState {
        target,
        scratch: &options.scratch,
        findings: &options.findings,
        input_file: options.input_file.as_ref().map(File::create).transpose()?,
        watch: Watchdog::start(target.name, options.findings.clone()),
        kinds: BTreeSet::new(),
        result: CampaignResult::default(),
    };
    let start = Instant::now();
    for input in &inputs {
        state.execute(input)?;
    }
    let mut rng = Rng::with_seed(options.seed);
    let mut executed = 0_u64;
    let continues = |executed: u64| match options.budget {
        CampaignBudget::Executions(most) => executed < most,
        CampaignBudget::Time(most) => start.elapsed() < most,
    };
    while continues(executed) {
        let input = mutated(&mut rng, target, &inputs);
        executed += 1;
        if state.execute(&input)? {
            if inputs.len() < kept + MAX_INPUTS {
                inputs.push(input);
            } else {
                let index = rng.usize(kept..inputs.len());
                inputs[index] = input;
            }
        }
    }
    state.result.elapsed = start.elapsed();
    Ok(state.result)
}

struct CampaignState<'a> {
    target: &'static FuzzTarget,
    scratch: &'a Path,
    findings: &'a Path,
    input_file: Option<File>,
    watch: Watchdog,
    /// Kinds of the findings so far.
    kinds: BTreeSet<String>,
    result: CampaignResult,
}

impl CampaignState<'_> {
    /// Executes an input; returns whether its rejection has a new shape.
    fn execute(&mut self, input: &[u8]) -> io::Result<bool> {
        if let Some(file) = &self.input_file {
            file.set_len(input.len() as u64)?;
            file.write_all_at(input, 0)?;
        }
        self.watch.begin(input);
        let since = Instant::now();
        let outcome = caught(|| (self.target.execute)(input, self.scratch));
        let took = since.elapsed();
        self.watch.end();
        self.result.executions += 1;
        if took > SLOW {
            self.found(input, &format!("slow: took {:.1} s", took.as_secs_f64()))?;
        }
        match outcome {
            Ok(FuzzOutcome::Accepted) => {
                self.result.accepted += 1;
                Ok(false)
            }
            Ok(FuzzOutcome::Rejected(message)) => Ok(self.result.shapes.insert(shape(&message))),
            Err(panic) => {
                self.found(input, &panic)?;
                Ok(false)
            }
        }
    }

    fn found(&mut self, input: &[u8], what: &str) -> io::Result<()> {
        self.result.finding_count += 1;
        // The first line of a panic has its source line, which is its kind.
        let kind = what.lines().next().unwrap_or_default().to_owned();
        let kind = if kind.starts_with("slow") { "slow".to_owned() } else { kind };
        if self.kinds.insert(kind) {
            let file = corpus::save(self.findings, self.target.name, input)?;
            self.result.findings.push(Finding { what: what.to_owned(), file });
        }
        Ok(())
    }
}
