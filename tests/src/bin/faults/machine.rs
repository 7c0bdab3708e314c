//! Machine and date of a table.

use std::fs::read_to_string;
use std::time::{SystemTime, UNIX_EPOCH};

const SECONDS_OF_A_DAY: u64 = 86_400;

/// Note above a table: date, command, machine and steal time.
pub(crate) fn note(command: &str, steal_ms: u64) -> String {
    let info = read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or("an unknown processor", |(_, name)| name.trim());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let kernel = read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let (year, month, day) = date(seconds / SECONDS_OF_A_DAY);
    format!(
        "Made on {year}-{month:02}-{day:02} by `{command}`: {model}, {cores} processors, Linux {}; {:.1} s steal time over all \
         processors.\n",
        kernel.trim(),
        steal_ms as f64 * 1e-3
    )
}

/// Steal time of all processors since boot [ms]; zero if the system does not report it.
pub(crate) fn steal_ms() -> u64 {
    let text = read_to_string("/proc/stat").unwrap_or_default();
    let ticks: Option<u64> = text.lines().next().and_then(|line| line.split_whitespace().nth(8)).and_then(|v| v.parse().ok());
    // USER_HZ is 100 on every Linux there is.
    ticks.unwrap_or(0) * 10
}

/// Year, month and day of a day since 1970-01-01 in the Gregorian calendar.
fn date(days: u64) -> (u64, u64, u64) {
    // Years begin in March, so a leap day is the last day of a year; 400 years have 146097 days.
    let shifted = days + 719_468;
    let (era, day) = (shifted / 146_097, shifted % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    (era * 400 + year + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn date_days_since_epoch_converted() {
        assert_eq!(date(0), (1970, 1, 1));
        assert_eq!(date(11_016), (2000, 2, 29));
        assert_eq!(date(11_017), (2000, 3, 1));
        assert_eq!(date(19_723), (2024, 1, 1));
        assert_eq!(date(20_453), (2025, 12, 31));
    }
}
