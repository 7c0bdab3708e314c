//! What a driver says of its chain: one line of JSON.

use crate::error::LatencyError;
use hapfic_ipc::realtime::SchedGrants;
use serde::{Deserialize, Serialize};

/// One message round the chain; times of `CLOCK_MONOTONIC` in ns. In JSON: `[due, wake, sent, end]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[u64; 4]", into = "[u64; 4]")]
pub struct Sample {
    /// When it was due.
    pub due_ns: u64,
    /// When the driver woke up for it; 0 if the one before took so long that this one was not sent.
    pub wake_ns: u64,
    /// Just before it was sent; 0 if it was not, and for a timer.
    pub sent_ns: u64,
    /// When its answer was there; 0 if none came in time, and for a timer.
    pub end_ns: u64,
}

impl From<[u64; 4]> for Sample {
    fn from([due_ns, wake_ns, sent_ns, end_ns]: [u64; 4]) -> Self {
        Self { due_ns, wake_ns, sent_ns, end_ns }
    }
}

impl From<Sample> for [u64; 4] {
    fn from(s: Sample) -> Self {
        [s.due_ns, s.wake_ns, s.sent_ns, s.end_ns]
    }
}

impl Sample {
    /// How late the driver's timer was, ns; `None` if it was not waited for.
    #[must_use]
    pub fn lateness_ns(&self) -> Option<u64> {
        (self.wake_ns > 0).then(|| self.wake_ns.saturating_sub(self.due_ns))
    }

    /// Round the chain, ns; `None` if no answer came.
    #[must_use]
    pub fn round_ns(&self) -> Option<u64> {
        (self.end_ns > 0).then(|| self.end_ns - self.sent_ns)
    }
}

/// What a driver says of its chain, or of its timer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Measured {
    /// The kind of chain.
    pub kind: String,
    /// Hops: 3, or 0 for a timer.
    pub hops: u32,
    /// Messages that were due.
    pub count: u64,
    /// What each place was granted, bits of [`SchedGrants`].
    pub granted: Vec<u32>,
    /// The messages, or timers, in the order of time; of a timer only those that were late enough to be told of.
    pub samples: Vec<Sample>,
}

impl Measured {
    /// Reads a driver's line, and checks that what it says can be.
    ///
    /// # Errors
    /// [`LatencyError::Said`] with what is wrong, and where.
    pub fn parse(line: &str) -> Result<Self, LatencyError> {
        let said = |what: String| LatencyError::Said(what);
        let read: Self = serde_json::from_str(line).map_err(|e| said(format!("{e}; expected one line of JSON")))?;
        if read.samples.len() as u64 > read.count || (read.hops > 0 && read.samples.len() as u64 != read.count) {
            return Err(said(format!("{}: found {} samples, expected {}", read.kind, read.samples.len(), read.count)));
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
                return Err(said(format!(
                    "{}: sample {i} is {found:?}, expected [due, wake, sent, end] in the order of time, 0 for what did not happen",
                    read.kind
                )));
            }
            last = s.due_ns;
        }
        Ok(read)
    }

    /// What a place was granted.
    #[must_use]
    pub fn granted(&self, place: usize) -> SchedGrants {
        SchedGrants(self.granted.get(place).copied().unwrap_or(0))
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
    fn a_line_gives_its_figures() {
        let read = Measured::parse(&line("[[1000,1010,1015,1075],[2000,2004,2005,0],[3000,0,0,0]]")).unwrap();
        assert_eq!(read.samples.iter().map(Sample::round_ns).collect::<Vec<_>>(), [Some(60), None, None]);
        assert_eq!(read.samples.iter().map(Sample::lateness_ns).collect::<Vec<_>>(), [Some(10), Some(4), None]);
        assert!(read.granted(0).has(SchedGrants::PINNED) && !read.granted(2).has(SchedGrants::PINNED));
        assert_eq!(Measured::parse(&serde_json::to_string(&read).unwrap()).unwrap(), read);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        for bad in [
            "[[1000,999,1015,1075]]",
            "[[1000,1010,1009,1075]]",
            "[[1000,1010,1015,1014]]",
            "[[1000,1010,0,1075]]",
            "[[1000,0,1015,1075]]",
            "[[2000,2010,2015,2075],[1000,1010,1015,1075]]",
            "[[1000,1010,1015]]",
        ] {
            assert!(Measured::parse(&line(bad)).is_err(), "{bad}");
        }
        let short = r#"{"kind":"x","hops":3,"count":2,"granted":[],"samples":[[1,1,1,1]]}"#;
        assert!(Measured::parse(short).unwrap_err().to_string().contains("found 1 samples, expected 2"));
        assert!(Measured::parse("ready").is_err());
    }
}
