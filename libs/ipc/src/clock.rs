//! `CLOCK_MONOTONIC`: reading it and waiting on it; the date.

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

/// Year, month and day of a day since 1970-01-01 in the Gregorian calendar (UTC).
#[must_use]
pub const fn date(days: u64) -> (u64, u64, u64) {
    // Years begin in March, so a leap day is the last day of a year; 400 years have 146097 days.
    let shifted = days + 719_468;
    let (era, day) = (shifted / 146_097, shifted % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    (era * 400 + year + (month <= 2) as u64, month, day)
}

/// Steal time of a processor (`cpu1`) or of all together (`cpu`) since boot, from the text of `/proc/stat` [ms].
#[must_use]
pub fn steal_ms(stat: &str, processor: &str) -> Option<u64> {
    let mut words =
        stat.lines().map(str::split_whitespace).find_map(|mut words| (words.next()? == processor).then_some(words))?;
    // USER_HZ is 100 on every Linux.
    Some(words.nth(7)?.parse::<u64>().ok()? * 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn date_leap_days_converted() {
        assert_eq!(date(0), (1970, 1, 1));
        assert_eq!(date(11_016), (2000, 2, 29));
        assert_eq!(date(11_017), (2000, 3, 1));
        assert_eq!(date(19_723), (2024, 1, 1));
        assert_eq!(date(20_453), (2025, 12, 31));
    }

    #[test]
    fn steal_ms_reads_eighth_number_of_processor() {
        let stat = "cpu  1 2 3 4 5 6 7 80 9 10\ncpu0 1 2 3 4 5 6 7 30 9 10\ncpu1 1 2 3 4 5 6 7 50\nintr 1\n";
        assert_eq!(["cpu", "cpu0", "cpu1", "cpu2"].map(|p| steal_ms(stat, p)), [Some(800), Some(300), Some(500), None]);
        assert_eq!(steal_ms("cpu 1 2", "cpu"), None);
    }
}
