//! Injected faults: conditions between the keys of an entry, and sampling of random faults.

use super::{ScenarioCheck, TICKS_PER_S, ticks};
use crate::error::ConfigError;
use crate::fault::{Fault, FaultKind, FaultTarget};
use crate::raw::{RawFault, RawTargets};
use crate::tree::describe_number;
use fastrand::Rng;

/// Most faults of a run, all sampled before the run starts.
const MAX_FAULTS: usize = 1_000_000;

/// Effect of an entry, without its time.
pub(super) struct FaultEffect {
    /// The fault at tick 0, on the only target or the first of several.
    pub(super) fault: Fault,
    /// Possible targets; empty: the machine.
    targets: Vec<FaultTarget>,
}

impl FaultEffect {
    fn at(&self, tick: i64, rng: &mut Rng) -> Fault {
        let target = match self.targets.as_slice() {
            several @ [_, _, ..] => several[rng.u64(..several.len() as u64) as usize],
            _ => self.fault.target,
        };
        Fault { tick, target, ..self.fault }
    }
}

/// Times at which an entry's faults begin: `count` ticks in `from..to`.
struct FaultTimes {
    count: u32,
    from: i64,
    to: i64,
}

impl ScenarioCheck<'_> {
    /// Returns all faults of a run of `run` ticks, in the order of time; at the same tick in the order of the entries.
    pub(super) fn faults(&self, raw: &[RawFault], run: i64, seed: u64) -> Result<Vec<Fault>, ConfigError> {
        let mut seeds = Rng::with_seed(seed);
        let mut faults: Vec<Fault> = Vec::new();
        for (index, entry) in raw.iter().enumerate() {
            let path = format!("fault[{index}]");
            let effect = self.effect(&path, entry)?;
            let times = self.times(&path, entry, run)?;
            // Each entry has its own generator, so that more samples of one entry leave the other entries unchanged.
            let mut rng = seeds.fork();
            let all = faults.len() + times.count as usize;
            if all > MAX_FAULTS {
                let expected = format!("at most {MAX_FAULTS} in all");
                let help = "lower the counts, or spread the faults over several runs";
                let found = format!("an entry that raises the number of faults to {all}");
                return Err(ConfigError::Combination(self.diagnostic(&path, &found, &expected, help)));
            }
            faults.extend((0..times.count).map(|_| {
                let tick = rng.i64(times.from..times.to);
                effect.at(tick, &mut rng)
            }));
        }
        faults.sort_by_key(|fault| fault.tick);
        Ok(faults)
    }

    /// Checks that kind, process, length and delay of an entry fit together.
    pub(super) fn effect(&self, path: &str, raw: &RawFault) -> Result<FaultEffect, ConfigError> {
        let kind = raw.kind;
        let targets = self.targets(path, raw)?;
        if raw.for_ms.is_some() && !kind.lasts() {
            let help = format!("{} has no length: remove for_ms", kind.name());
            return Err(self.misfit(path, "for_ms", kind, "no length", &help));
        }
        match (kind, raw.by_us) {
            (FaultKind::Slow, None) => {
                let help = "add by_us, an integer in [1, 100000]";
                return Err(self.misfit(path, "by_us", kind, "the delay of each tick, us", help));
            }
            (FaultKind::Slow, Some(_)) | (_, None) => {}
            (_, Some(_)) => {
                return Err(self.misfit(path, "by_us", kind, "no delay", "only slow has a delay: remove by_us"));
            }
        }
        let target = targets.first().copied().unwrap_or(FaultTarget::Machine);
        let length = if kind.lasts() { raw.for_ms.unwrap_or(1) } else { 0 };
        Ok(FaultEffect { fault: Fault { tick: 0, kind, target, ticks: length, by_us: raw.by_us.unwrap_or(0) }, targets })
    }

    fn misfit(&self, path: &str, key: &str, kind: FaultKind, expected: &str, help: &str) -> ConfigError {
        let key = format!("{path}.{key}");
        let found = format!("{} beside kind = \"{}\"", self.found(&key), kind.name());
        ConfigError::Combination(self.diagnostic(&key, &found, expected, help))
    }

    fn targets(&self, path: &str, raw: &RawFault) -> Result<Vec<FaultTarget>, ConfigError> {
        let kind = raw.kind;
        let allowed = kind.processes();
        let words: Vec<String> = allowed.iter().map(|target| format!("\"{}\"", target.name())).collect();
        let one_of = format!("one of {}", words.join(", "));
        match &raw.process {
            None if allowed.is_empty() => Ok(Vec::new()),
            None => Err(self.misfit(path, "process", kind, &one_of, "add process, the target of the fault")),
            Some(_) if allowed.is_empty() => {
                let help = format!("{} happens to the whole machine: remove process", kind.name());
                Err(self.misfit(path, "process", kind, "no process", &help))
            }
            Some(written) => {
                let targets = written.as_slice();
                if targets.is_empty() {
                    let key = format!("{path}.process");
                    let expected = "a process, or a list to sample from";
                    let diagnostic = self.diagnostic(&key, &self.found(&key), expected, "name at least one");
                    return Err(ConfigError::WrongLength(diagnostic));
                }
                let Some(index) = targets.iter().position(|target| !allowed.contains(target)) else {
                    return Ok(targets.to_vec());
                };
                let key = match written {
                    RawTargets::One(_) => "process".to_owned(),
                    RawTargets::Sampled(_) => format!("process[{index}]"),
                };
                Err(self.misfit(path, &key, kind, &one_of, "supervisor, gates and recorder can only be killed or halted"))
            }
        }
    }

    fn times(&self, path: &str, raw: &RawFault, run: i64) -> Result<FaultTimes, ConfigError> {
        let end = || format!("duration_s = {}", describe_number(run as f64 / TICKS_PER_S));
        let wrong = |key: &str, found: &str, expected: &str, help: &str| {
            ConfigError::Combination(self.diagnostic(key, found, expected, help))
        };
        match (raw.at_s, &raw.random) {
            (Some(at_s), None) => {
                let tick = ticks(at_s);
                if tick < run {
                    return Ok(FaultTimes { count: 1, from: tick, to: tick + 1 });
                }
                let key = format!("{path}.at_s");
                let help = "no fault occurs after the run's end: lengthen the run, or choose an earlier time";
                Err(wrong(&key, &self.found(&key), &format!("less than {}", end()), help))
            }
            (None, Some(random)) => {
                let (from, to) = (ticks(random.from_s), ticks(random.to_s));
                let (from_key, to_key) = (format!("{path}.random.from_s"), format!("{path}.random.to_s"));
                if to > run {
                    let help = "no fault occurs after the run's end: lengthen the run, or choose an earlier end";
                    return Err(wrong(&to_key, &self.found(&to_key), &format!("at most {}", end()), help));
                }
                if from >= to {
                    let expected = format!("less than {to_key} = {}", self.found(&to_key));
                    let help = "the span must contain a tick of 1 ms";
                    return Err(wrong(&from_key, &self.found(&from_key), &expected, help));
                }
                Ok(FaultTimes { count: random.count, from, to })
            }
            (None, None) => {
                let help = "write at_s = 3.0, or random = { count = 5, from_s = 1.0, to_s = 9.0 }";
                Err(wrong(path, "neither at_s nor random", "one of the two", help))
            }
            (Some(_), Some(_)) => {
                let found = format!("random beside at_s = {}", self.found(&format!("{path}.at_s")));
                Err(wrong(&format!("{path}.random"), &found, "one of the two", "remove at_s or random"))
            }
        }
    }
}
