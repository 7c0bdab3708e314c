//! `CLOCK_MONOTONIC`: reading it and waiting on it.

use rustix::time::{ClockId, Timespec, clock_gettime};

/// Nanoseconds of `CLOCK_MONOTONIC`.
#[must_use]
pub fn now_ns() -> u64 {
    let t = clock_gettime(ClockId::Monotonic);
    (t.tv_sec as u64) * 1_000_000_000 + t.tv_nsec as u64
}

/// Nanoseconds since the Unix epoch.
#[must_use]
pub fn unix_ns() -> u64 {
    let t = clock_gettime(ClockId::Realtime);
    (t.tv_sec as u64) * 1_000_000_000 + t.tv_nsec as u64
}

/// A time span or instant of the monotonic clock as the system's type.
#[must_use]
pub fn timespec(ns: u64) -> Timespec {
    Timespec { tv_sec: (ns / 1_000_000_000) as i64, tv_nsec: (ns % 1_000_000_000) as i64 }
}

/// Sleeps until the monotonic clock reads `deadline_ns`. Returns early if a signal comes.
pub fn sleep_until(deadline_ns: u64) {
    // Interrupted or not: the caller checks the clock and its stop flag.
    let _ = rustix::thread::clock_nanosleep_absolute(rustix::thread::ClockId::Monotonic, &timespec(deadline_ns));
}
