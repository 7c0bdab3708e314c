//! Measurement of a chain, as its driver prints it: one line of JSON.

use crate::error::LatencyError;
use hapfic_ipc::realtime::SchedGrants;
use serde::{Deserialize, Serialize};

/// One round trip or timer, times of `CLOCK_MONOTONIC` [ns]; in JSON `[due, wake, sent, end]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[u64; 4]", into = "[u64; 4]")]
pub struct ChainSample {
    /// Due time.
    pub due_ns: u64,
    /// Wake-up of the driver; 0 if the previous round trip outlasted the due time, so that no message was sent.
    pub wake_ns: u64,
    /// Time before sending; 0 if no message was sent, and for a timer.
    pub sent_ns: u64,
    /// Arrival of the answer; 0 if none came in time, and for a timer.
    pub end_ns: u64,
}

impl From<[u64; 4]> for ChainSample {
    fn from([due_ns, wake_ns, sent_ns, end_ns]: [u64; 4]) -> Self {
        Self { due_ns, wake_ns, sent_ns, end_ns }
    }
}

impl From<ChainSample> for [u64; 4] {
    fn from(s: ChainSample) -> Self {
        [s.due_ns, s.wake_ns, s.sent_ns, s.end_ns]
    }
}

impl ChainSample {
    /// Lateness of the driver's timer [ns]; `None` if the driver did not wait for it.
    #[must_use]
    pub fn lateness_ns(&self) -> Option<u64> {
        (self.wake_ns > 0).then(|| self.wake_ns.saturating_sub(self.due_ns))
    }

    /// Round-trip time [ns]; `None` if no answer came.
    #[must_use]
    pub fn round_ns(&self) -> Option<u64> {
        (self.end_ns > 0).then(|| self.end_ns - self.sent_ns)
    }
}

/// Measurement of a chain or a timer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChainMeasurement {
    /// Kind of chain.
    pub kind: String,
    /// Number of hops: 3, or 0 for a timer.
    pub hops: u32,
    /// Number of messages that were due.
    pub count: u64,
    /// Grants of each stage, bits of [`SchedGrants`].
    pub granted: Vec<u32>,
    /// Round trips or timers in the order of time; of timers only those with the lateness that the plan reports.
    pub samples: Vec<ChainSample>,
}

impl ChainMeasurement {
    /// Parses a driver's line, and checks that it is consistent.
    ///
    /// # Errors
    /// [`LatencyError::Output`] with the cause and the place.
    pub fn parse(line: &str) -> Result<Self, LatencyError> {
        let read: Self =
            serde_json::from_str(line).map_err(|e| LatencyError::Output(format!("{e}; expected one line of JSON")))?;
        if read.samples.len() as u64 > read.count || (read.hops > 0 && read.samples.len() as u64 != read.count) {
            let found = read.samples.len();
            return Err(LatencyError::Output(format!("{}: found {found} samples, expected {}", read.kind, read.count)));
        }
        let mut last = 0;
        for (i, s) in read.samples.iter().enumerate() {
            let skipped = s.wake_ns == 0 && s.sent_ns == 0 && s.end_ns == 0;
            let in_order = s.wake_ns >= s.due_ns
                && (if s.sent_ns == 0 {
                    s.end_ns == 0
                } else {
                    s.sent_ns >= s.wake_ns && (s.end_ns == 0 || s.end_ns >= s.sent_ns)
                });
            if s.due_ns < last || !(skipped || in_order) {
                let found: [u64; 4] = (*s).into();
                return Err(LatencyError::Output(format!(
                    "{}: sample {i} is {found:?}, expected [due, wake, sent, end] in the order of time, 0 for a missing time",
                    read.kind
                )));
            }
            last = s.due_ns;
        }
        Ok(read)
    }

    /// Grants of a stage.
    #[must_use]
    pub fn granted(&self, stage: usize) -> SchedGrants {
        SchedGrants(self.granted.get(stage).copied().unwrap_or(0))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn line(samples: &str) -> String {
        let count = serde_json::from_str::<Vec<serde_json::Value>>(samples).map_or(0, |list| list.len());
        format!(r#"{{"kind":"x","hops":3,"count":{count},"granted":[7,7,3],"samples":{samples}}}"#)
    }

    #[test]
    fn parse_valid_line_gives_samples() {
        let read = ChainMeasurement::parse(&line("[[1000,1010,1015,1075],[2000,2004,2005,0],[3000,0,0,0]]")).unwrap();
        assert_eq!(read.samples.iter().map(ChainSample::round_ns).collect::<Vec<_>>(), [Some(60), None, None]);
        assert_eq!(read.samples.iter().map(ChainSample::lateness_ns).collect::<Vec<_>>(), [Some(10), Some(4), None]);
        assert!(read.granted(0).has(SchedGrants::PINNED) && !read.granted(2).has(SchedGrants::PINNED));
        assert_eq!(ChainMeasurement::parse(&serde_json::to_string(&read).unwrap()).unwrap(), read);
    }

    #[test]
    fn parse_inconsistent_samples_are_rejected() {
        for bad in [
            "[[1000,999,1015,1075]]",
            "[[1000,1010,1009,1075]]",
            "[[1000,1010,1015,1014]]",
            "[[1000,1010,0,1075]]",
            "[[1000,0,1015,1075]]",
            "[[2000,2010,2015,2075],[1000,1010,1015,1075]]",
            "[[1000,1010,1015]]",
        ] {
            assert!(ChainMeasurement::parse(&line(bad)).is_err(), "{bad}");
        }
        let short = r#"{"kind":"x","hops":3,"count":2,"granted":[],"samples":[[1,1,1,1]]}"#;
        assert!(ChainMeasurement::parse(short).unwrap_err().to_string().contains("found 1 samples, expected 2"));
        assert!(ChainMeasurement::parse("ready").is_err());
    }
}
