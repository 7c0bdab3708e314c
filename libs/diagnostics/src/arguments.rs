//! The command line of a program that measures chains.

use crate::link::PLACES;
use clap::{Args, Parser, Subcommand};
use hapfic_ipc::realtime::SchedRequest;
use std::str::FromStr;

/// Measures how long a message takes round a chain of three processes.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
pub(crate) struct Words {
    #[command(subcommand)]
    pub(crate) what: What,
}

#[derive(Debug, Subcommand)]
pub(crate) enum What {
    /// Print the kinds of chain, one a line.
    Kinds,
    /// Measure a chain; or, as the kind `timer`, how late a timer wakes this process.
    Chain(Plan),
    /// The process at place 1 or 2 of a chain; started by the driver.
    #[command(hide = true)]
    Relay(RelayWords),
}

/// What to measure.
#[derive(Args, Clone, Debug)]
pub struct Plan {
    /// Kind of chain.
    #[arg(long)]
    pub kind: String,
    /// Core to stay on, or `any`; one for all, or one for each place.
    #[arg(long, value_delimiter = ',', default_value = "any")]
    pub core: Vec<Core>,
    /// Priority of SCHED_FIFO, or 0 for none; one for all, or one for each place.
    #[arg(long, value_delimiter = ',', default_value = "0")]
    pub priority: Vec<u32>,
    /// When the first message is due, ns of CLOCK_MONOTONIC.
    #[arg(long)]
    pub start_ns: u64,
    /// From one message to the next, ns.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=3_600_000_000_000))]
    pub period_ns: u64,
    /// Messages.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub count: u64,
    /// Bytes of the message that each place sends, at least 8 each.
    #[arg(long, value_delimiter = ',', default_value = "1024", value_parser = clap::value_parser!(u32).range(8..=1_000_000))]
    pub sizes: Vec<u32>,
    /// Timer: tell only of those as late as this, ns.
    #[arg(long, default_value_t = 0)]
    pub above_ns: u64,
}

/// What the driver tells a relay.
#[derive(Args, Clone, Debug)]
pub(crate) struct RelayWords {
    #[arg(long)]
    pub(crate) kind: String,
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..PLACES as u64))]
    pub(crate) place: u64,
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
    /// Descriptors that it inherits.
    #[arg(long, value_delimiter = ',')]
    pub(crate) shared: Vec<i32>,
}

/// A core to stay on, or any.
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

impl Plan {
    /// The plan as words of a command line.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let mut words = vec!["chain".to_owned()];
        for (name, value) in [
            ("--kind", self.kind.clone()),
            ("--core", list(&self.core)),
            ("--priority", list(&self.priority)),
            ("--start-ns", self.start_ns.to_string()),
            ("--period-ns", self.period_ns.to_string()),
            ("--count", self.count.to_string()),
            ("--sizes", list(&self.sizes)),
        ] {
            words.extend([name.to_owned(), value]);
        }
        if self.above_ns > 0 {
            words.extend(["--above-ns".to_owned(), self.above_ns.to_string()]);
        }
        words
    }

    /// What each place asks for; `None`: no real time.
    ///
    /// # Errors
    /// If a list has neither one nor three entries, or a priority is none.
    pub fn sched_requests(&self) -> Result<[Option<SchedRequest>; PLACES], String> {
        let cores = each("core", &self.core)?;
        let priorities = each("priority", &self.priority)?;
        if let Some(bad) = priorities.iter().find(|p| **p > 98) {
            return Err(format!("--priority {bad}: expected 1 to 98, or 0 for none"));
        }
        Ok(std::array::from_fn(|i| (priorities[i] > 0).then(|| SchedRequest::new(priorities[i], cores[i].0))))
    }

    /// Bytes of each place's message.
    ///
    /// # Errors
    /// If the list has neither one nor three entries.
    pub fn sizes(&self) -> Result<[usize; PLACES], String> {
        Ok(each("sizes", &self.sizes)?.map(|bytes| bytes as usize))
    }
}

fn each<T: Copy>(name: &str, given: &[T]) -> Result<[T; PLACES], String> {
    match *given {
        [one] => Ok([one; PLACES]),
        [a, b, c] => Ok([a, b, c]),
        _ => Err(format!("--{name}: found {} values, expected one, or one for each of the {PLACES} places", given.len())),
    }
}

/// Values as the command line takes them.
pub(crate) fn list<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn plan(words: &str) -> Result<Plan, String> {
        match Words::try_parse_from(words.split_whitespace()).map_err(|e| e.to_string())?.what {
            What::Chain(plan) => Ok(plan),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn the_protocol_s_own_words_are_understood() {
        let plan =
            plan("chain --kind futex --core 1 --priority 80 --start-ns 5 --period-ns 4000000 --count 9 --sizes 8,16,24").unwrap();
        assert_eq!(plan.sizes().unwrap(), [8, 16, 24]);
        assert_eq!(plan.sched_requests().unwrap(), [Some(SchedRequest { priority: 80, core: Some(1) }); 3]);
    }

    #[test]
    fn a_plan_survives_its_own_words() {
        let words =
            "chain --kind x --core 1,any,0 --priority 80,76,0 --start-ns 5 --period-ns 4 --count 9 --sizes 8 --above-ns 7";
        let first = plan(words).unwrap();
        let again = plan(&first.words().join(" ")).unwrap();
        assert_eq!(format!("{first:?}"), format!("{again:?}"));
        let requests = again.sched_requests().unwrap();
        assert_eq!(requests[1], Some(SchedRequest { priority: 76, core: None }));
        assert_eq!(requests[2], None);
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let good = "chain --kind x --start-ns 5 --period-ns 4 --count 9";
        assert!(plan(good).is_ok());
        for bad in ["--sizes 7", "--period-ns 0", "--count 0", "--core first", "--priority -1"] {
            assert!(plan(&format!("chain --kind x --start-ns 5 {bad}")).is_err(), "{bad}");
        }
        assert!(plan(&format!("{good} --priority 99")).unwrap().sched_requests().is_err());
        assert!(plan(&format!("{good} --core 0,1")).unwrap().sched_requests().is_err());
        assert!(plan(&format!("{good} --sizes 8,8")).unwrap().sizes().is_err());
    }
}
