//! How a run passes time, and how hard it asks for real-time privileges.

use serde::{Deserialize, Serialize};

/// How time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// An absolute timer, 1 ms.
    Realtime,
    /// As fast as it goes: everyone waits for exactly what it needs.
    Lockstep,
}

impl Clock {
    /// Its name on the command line and in logs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Realtime => "realtime",
            Self::Lockstep => "lockstep",
        }
    }
}

/// How hard to try for real-time privileges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RealtimeMode {
    /// Takes what it can get.
    Auto,
    /// Refuses to start without all of it.
    Require,
    /// Asks for none.
    Off,
}
