//! Modes of a run: its clock, and its request for real-time privileges.

use serde::{Deserialize, Serialize};

/// Clock of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// An absolute timer, 1 ms.
    Realtime,
    /// As fast as possible: each process waits for exactly its inputs.
    Lockstep,
}

impl Clock {
    /// Name on the command line and in logs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Realtime => "realtime",
            Self::Lockstep => "lockstep",
        }
    }
}

/// Request for real-time privileges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RealtimeMode {
    /// Takes the granted privileges.
    Auto,
    /// Does not start without all of them.
    Require,
    /// Requests none.
    Off,
}
