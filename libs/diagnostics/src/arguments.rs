//! Command line of a program that measures chains.

use crate::link::STAGES;
use clap::{Args, Parser, Subcommand};
use hapfic_ipc::realtime::SchedRequest;
use std::str::FromStr;

/// Measures the round trip of a message through a chain of three processes.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
pub(crate) struct ChainArguments {
    #[command(subcommand)]
    pub(crate) command: ChainCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum ChainCommand {
    /// Print the kinds of chain, one a line.
    Kinds,
    /// Measure a chain; the kind `timer` measures the lateness of a timer of this process.
    Chain(MeasurementPlan),
    /// Serve as stage 1 or 2 of a chain; the driver starts this.
    #[command(hide = true)]
    Relay(RelayArguments),
}

/// Plan of a measurement: chain, placement and schedule.
#[derive(Args, Clone, Debug)]
pub struct MeasurementPlan {
    /// Kind of chain.
    #[arg(long)]
    pub kind: String,
    /// Core to be pinned to, or `any`; one value for all stages, or one for each.
    #[arg(long, value_delimiter = ',', default_value = "any")]
    pub core: Vec<Core>,
    /// Priority of SCHED_FIFO, or 0 for none; one value for all stages, or one for each.
    #[arg(long, value_delimiter = ',', default_value = "0")]
    pub priority: Vec<u32>,
    /// Due time of the first message, `CLOCK_MONOTONIC` [ns].
    #[arg(long)]
    pub start_ns: u64,
    /// Period of the messages [ns].
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=3_600_000_000_000))]
    pub period_ns: u64,
    /// Number of messages.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub count: u64,
    /// Length of the message of each stage, at least 8 [bytes].
    #[arg(long, value_delimiter = ',', default_value = "1024", value_parser = clap::value_parser!(u32).range(8..=1_000_000))]
    pub sizes: Vec<u32>,
    /// Timer: least lateness of a reported sample [ns].
    #[arg(long, default_value_t = 0)]
    pub above_ns: u64,
}

/// Arguments that the driver gives to a relay.
#[derive(Args, Clone, Debug)]
pub(crate) struct RelayArguments {
    #[arg(long)]
    pub(crate) kind: String,
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..STAGES as u64))]
    pub(crate) stage: u64,
    #[arg(long)]
    pub(crate) driver: i32,
    #[arg(long)]
    pub(crate) chain: String,
    #[arg(long)]
    pub(crate) core: Core,
    #[arg(long)]
    pub(crate) priority: u32,
    #[arg(long, value_delimiter = ',', required = true)]
    pub(crate) sizes: Vec<u32>,
    /// Inherited file descriptors.
    #[arg(long, value_delimiter = ',')]
    pub(crate) shared: Vec<i32>,
}

/// Core to be pinned to; `None`: any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Core(pub Option<u32>);

impl FromStr for Core {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "any" => Ok(Self(None)),
            number => {
                number.parse().map(|core| Self(Some(core))).map_err(|_| "expected the number of a core, or `any`".to_owned())
            }
        }
    }
}

impl std::fmt::Display for Core {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(core) => write!(f, "{core}"),
            None => f.write_str("any"),
        }
    }
}

impl MeasurementPlan {
    /// Returns the plan as arguments of a command line.
    #[must_use]
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = vec!["chain".to_owned()];
        for (name, value) in [
            ("--kind", self.kind.clone()),
            ("--core", list(&self.core)),
            ("--priority", list(&self.priority)),
            ("--start-ns", self.start_ns.to_string()),
            ("--period-ns", self.period_ns.to_string()),
            ("--count", self.count.to_string()),
            ("--sizes", list(&self.sizes)),
        ] {
            arguments.extend([name.to_owned(), value]);
        }
        if self.above_ns > 0 {
            arguments.extend(["--above-ns".to_owned(), self.above_ns.to_string()]);
        }
        arguments
    }

    /// Returns the scheduling that each stage requests; `None`: not real-time.
    ///
    /// # Errors
    /// If a list has neither one nor three entries, or a priority is out of range.
    pub fn sched_requests(&self) -> Result<[Option<SchedRequest>; STAGES], String> {
        let cores = per_stage("core", &self.core)?;
        let priorities = per_stage("priority", &self.priority)?;
        if let Some(bad) = priorities.iter().find(|p| **p > 98) {
            return Err(format!("--priority {bad}: expected 1 to 98, or 0 for none"));
        }
        Ok(std::array::from_fn(|i| (priorities[i] > 0).then(|| SchedRequest::new(priorities[i], cores[i].0))))
    }

    /// Returns the length of each stage's message [bytes].
    ///
    /// # Errors
    /// If the list has neither one nor three entries.
    pub fn sizes(&self) -> Result<[usize; STAGES], String> {
        Ok(per_stage("sizes", &self.sizes)?.map(|bytes| bytes as usize))
    }
}

fn per_stage<T: Copy>(name: &str, given: &[T]) -> Result<[T; STAGES], String> {
    match *given {
        [one] => Ok([one; STAGES]),
        [a, b, c] => Ok([a, b, c]),
        _ => Err(format!("--{name}: found {} values, expected one for all, or one for each of the {STAGES} stages", given.len())),
    }
}

/// Joins values by commas, as the command line takes them.
pub(crate) fn list<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn plan(arguments: &str) -> Result<MeasurementPlan, String> {
        match ChainArguments::try_parse_from(arguments.split_whitespace()).map_err(|e| e.to_string())?.command {
            ChainCommand::Chain(plan) => Ok(plan),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn plan_chain_arguments_are_parsed() {
        let plan =
            plan("chain --kind futex --core 1 --priority 80 --start-ns 5 --period-ns 4000000 --count 9 --sizes 8,16,24").unwrap();
        assert_eq!(plan.sizes().unwrap(), [8, 16, 24]);
        assert_eq!(plan.sched_requests().unwrap(), [Some(SchedRequest { priority: 80, core: Some(1) }); 3]);
    }

    #[test]
    fn plan_arguments_round_trip() {
        let arguments =
            "chain --kind x --core 1,any,0 --priority 80,76,0 --start-ns 5 --period-ns 4 --count 9 --sizes 8 --above-ns 7";
        let first = plan(arguments).unwrap();
        let again = plan(&first.arguments().join(" ")).unwrap();
        assert_eq!(format!("{first:?}"), format!("{again:?}"));
        let requests = again.sched_requests().unwrap();
        assert_eq!(requests[1], Some(SchedRequest { priority: 76, core: None }));
        assert_eq!(requests[2], None);
    }

    #[test]
    fn plan_invalid_arguments_are_rejected() {
        let valid = "chain --kind x --start-ns 5 --period-ns 4 --count 9";
        assert!(plan(valid).is_ok());
        for bad in ["--sizes 7", "--period-ns 0", "--count 0", "--core first", "--priority -1"] {
            assert!(plan(&format!("chain --kind x --start-ns 5 {bad}")).is_err(), "{bad}");
        }
        assert!(plan(&format!("{valid} --priority 99")).unwrap().sched_requests().is_err());
        assert!(plan(&format!("{valid} --core 0,1")).unwrap().sched_requests().is_err());
        assert!(plan(&format!("{valid} --sizes 8,8")).unwrap().sizes().is_err());
    }
}
