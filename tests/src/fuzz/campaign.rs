//! Feeds a target with mutated inputs and looks what happens.

use super::corpus;
use super::mutate::mutated;
use super::quiet::caught;
use super::shape::shape;
use super::target::{FuzzOutcome, Target};
use super::watch::Watchdog;
use fastrand::Rng;
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// An execution that takes longer is a finding.
pub const SLOW: Duration = Duration::from_secs(5);
/// Most inputs that are kept to be mutated; further ones take the place of earlier ones.
const MOST_INPUTS: usize = 2000;

/// How long a campaign goes on after every seed and every file of the corpus was executed once as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// So many executions: the same ones each time, for the same seed.
    Executions(u64),
    /// So long.
    Time(Duration),
}

/// How to run a campaign.
#[derive(Clone, Debug)]
pub struct Options {
    /// Its length.
    pub budget: Budget,
    /// Of all random draws.
    pub seed: u64,
    /// Folder of the corpus.
    pub corpus: PathBuf,
    /// An empty folder for the target's files.
    pub scratch: PathBuf,
    /// Folder for inputs that find something; made if one does.
    pub findings: PathBuf,
    /// A file that always holds the input under way, for whoever outlives this process.
    pub notebook: Option<PathBuf>,
}

/// Something that must not be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What happened.
    pub what: String,
    /// Where its input is.
    pub file: PathBuf,
}

/// What a campaign came to.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Executions.
    pub executions: u64,
    /// Of them, those whose input was accepted.
    pub accepted: u64,
    /// Refusals that differ in more than numbers and quotations.
    pub shapes: BTreeSet<String>,
    /// How long it took.
    pub elapsed: Duration,
    /// Findings, each kind once.
    pub findings: Vec<Finding>,
    /// All findings, those of a kind that was there before, too.
    pub finding_count: u64,
}

/// Runs a campaign.
///
/// # Errors
/// If the corpus cannot be read, or a finding or the notebook not be written.
pub fn campaign(target: &'static Target, options: &Options) -> io::Result<Tally> {
    let mut inputs = (target.seeds)();
    inputs.extend(corpus::load(&options.corpus, target.name)?.into_iter().map(|(_, input)| input));
    let kept = inputs.len();
    let mut bench = Bench {
        target,
        scratch: &options.scratch,
        findings: &options.findings,
        notebook: options.notebook.as_ref().map(File::create).transpose()?,
        watch: Watchdog::start(target.name, options.findings.clone()),
        kinds: BTreeSet::new(),
        tally: Tally::default(),
    };
    let start = Instant::now();
    for input in &inputs {
        bench.execute(input)?;
    }
    let mut rng = Rng::with_seed(options.seed);
    let mut executed = 0_u64;
    let goes_on = |executed: u64| match options.budget {
        Budget::Executions(most) => executed < most,
        Budget::Time(most) => start.elapsed() < most,
    };
    while goes_on(executed) {
        let input = mutated(&mut rng, target, &inputs);
        executed += 1;
        if bench.execute(&input)? {
            if inputs.len() < kept + MOST_INPUTS {
                inputs.push(input);
            } else {
                let place = rng.usize(kept..inputs.len());
                inputs[place] = input;
            }
        }
    }
    bench.tally.elapsed = start.elapsed();
    Ok(bench.tally)
}

struct Bench<'a> {
    target: &'static Target,
    scratch: &'a Path,
    findings: &'a Path,
    notebook: Option<File>,
    watch: Watchdog,
    /// Of findings.
    kinds: BTreeSet<String>,
    tally: Tally,
}

impl Bench<'_> {
    /// Executes an input; says whether the answer is a new one.
    fn execute(&mut self, input: &[u8]) -> io::Result<bool> {
        if let Some(file) = &self.notebook {
            file.set_len(input.len() as u64)?;
            file.write_all_at(input, 0)?;
        }
        self.watch.begins(input);
        let since = Instant::now();
        let verdict = caught(|| (self.target.execute)(input, self.scratch));
        let took = since.elapsed();
        self.watch.ended();
        self.tally.executions += 1;
        if took > SLOW {
            self.found(input, &format!("slow: took {:.1} s", took.as_secs_f64()))?;
        }
        match verdict {
            Ok(FuzzOutcome::Accepted) => {
                self.tally.accepted += 1;
                Ok(false)
            }
            Ok(FuzzOutcome::Refused(message)) => Ok(self.tally.shapes.insert(shape(&message))),
            Err(panic) => {
                self.found(input, &panic)?;
                Ok(false)
            }
        }
    }

    fn found(&mut self, input: &[u8], what: &str) -> io::Result<()> {
        self.tally.finding_count += 1;
        // The place of a panic is in its first line, and the line of the source tells kinds apart.
        let kind = what.lines().next().unwrap_or_default().to_owned();
        let kind = if kind.starts_with("slow") { "slow".to_owned() } else { kind };
        if self.kinds.insert(kind) {
            let file = corpus::save(self.findings, self.target.name, input)?;
            self.tally.findings.push(Finding { what: what.to_owned(), file });
        }
        Ok(())
    }
}
