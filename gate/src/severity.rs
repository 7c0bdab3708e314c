//! Severity ladder: a pure function from conditions to a severity.

use hapfic_messages::Severity;

/// Good ticks after which degraded and brake clear.
pub const CLEAR_AFTER: u32 = 20;
/// Missed ticks in a row at which the drive brakes.
pub const BRAKE_AT: u32 = 2;

/// Conditions of the ladder, one for each cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Conditions {
    /// Ticks in a row without a valid request.
    pub missed: u32,
    /// Ticks in a row with a valid request.
    pub good: u32,
    /// A process is missing; clears on its return.
    pub missing: bool,
    /// The operator, or a spent restart budget, requests a latched stop.
    pub stop: bool,
    /// The operator re-arms after a latched stop.
    pub rearm: bool,
}

/// Severity after a tick, from the previous severity and the current conditions.
///
/// The severity rises immediately. Degraded and brake clear after [`CLEAR_AFTER`] good ticks. Only the operator leaves
/// stopped, for brake, which then clears as always.
#[must_use]
pub fn severity(before: Severity, now: &Conditions) -> Severity {
    let cause = if now.stop {
        Severity::Stopped
    } else if now.missed >= BRAKE_AT {
        Severity::Brake
    } else if now.missed > 0 || now.missing {
        Severity::Degraded
    } else {
        Severity::Nominal
    };
    let kept = match before {
        Severity::Stopped if now.rearm => Severity::Brake,
        Severity::Stopped => Severity::Stopped,
        Severity::Brake | Severity::Degraded if now.good >= CLEAR_AFTER => Severity::Nominal,
        other => other,
    };
    kept.max(cause)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every combination that the function distinguishes.
    fn all() -> impl Iterator<Item = (Severity, Conditions)> {
        Severity::ALL.iter().flat_map(|&before| {
            (0..4_u32).flat_map(move |missed| {
                [0, 1, CLEAR_AFTER - 1, CLEAR_AFTER, CLEAR_AFTER + 1].into_iter().flat_map(move |good| {
                    (0..8_u32).map(move |bits| {
                        let [stop, rearm, missing] = [bits & 1 > 0, bits & 2 > 0, bits & 4 > 0];
                        (before, Conditions { missed, good, missing, stop, rearm })
                    })
                })
            })
        })
    }

    #[test]
    fn severity_never_falls_below_cause() {
        for (before, now) in all() {
            let after = severity(before, &now);
            if now.stop {
                assert_eq!(after, Severity::Stopped);
            }
            if now.missed >= BRAKE_AT {
                assert!(after >= Severity::Brake);
            }
            if now.missed > 0 || now.missing {
                assert!(after >= Severity::Degraded);
            }
        }
    }

    #[test]
    fn severity_falls_only_along_ladder() {
        for (before, now) in all() {
            let after = severity(before, &now);
            if after < before {
                match before {
                    Severity::Stopped => assert!(now.rearm && after == Severity::Brake),
                    // Down to the remaining cause, and no further.
                    _ => {
                        let degraded = now.missed == 1 || now.missing;
                        assert!(now.good >= CLEAR_AFTER);
                        assert_eq!(after, if degraded { Severity::Degraded } else { Severity::Nominal });
                    }
                }
            }
        }
    }

    #[test]
    fn severity_stopped_left_only_by_rearm() {
        for (before, now) in all() {
            if before == Severity::Stopped && !now.rearm {
                assert_eq!(severity(before, &now), Severity::Stopped);
            }
        }
    }

    #[test]
    fn severity_after_miss_clears_with_twenty_good_ticks() {
        let mut s = severity(Severity::Nominal, &Conditions { missed: 1, ..Conditions::default() });
        assert_eq!(s, Severity::Degraded);
        for good in 1..=CLEAR_AFTER {
            s = severity(s, &Conditions { good, ..Conditions::default() });
            assert_eq!(s == Severity::Nominal, good == CLEAR_AFTER, "after {good}");
        }
    }
}
