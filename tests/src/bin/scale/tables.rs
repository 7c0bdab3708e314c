//! Tables of `scale`.

use crate::arguments::Arguments;
use crate::legs::{LegCount, LegResult};
use crate::part::{digits, largest, mean, median, spread, table};
use crate::speed::SpeedResult;
use crate::usage::GROUPS;

/// Text between the markers.
pub(crate) fn section(arguments: &Arguments, counts: &[LegCount], speeds: &[SpeedResult]) -> String {
    format!(
        "Simultaneous legs, each an independent `hapfic run floor` in realtime, {} s measured in each of {} rounds, over all legs of all \
         rounds. CPU in per cent of one core; latency from state to command.\n\n{}\nMean CPU by process and by thread of the \
         supervisor, in per cent of one core:\n\n{}\nSimulated seconds per wall-clock second in lockstep, `floor`, over all cores:\n\n{}",
        arguments.seconds,
        arguments.rounds,
        legs(counts),
        groups(counts),
        speed(speeds)
    )
}

fn legs(counts: &[LegCount]) -> String {
    let head = [
        "legs",
        "CPU of a leg, %: median / worst",
        "CPU of all, %",
        "ticks",
        "missed: sum / worst leg",
        "braked: sum / worst leg",
        "slipped: sum / worst leg",
        "p50, us: median / worst",
        "p99, us: median / worst",
        "p99.9, us: median / worst",
        "PSS of a leg, MB",
        "shared memory of a leg, MB",
    ];
    let rows: Vec<_> = counts.iter().map(|count| row(count.legs, &count.results)).collect();
    table(&head, &rows)
}

fn row(count: usize, legs: &[LegResult]) -> Vec<String> {
    let cpu: Vec<f64> = legs.iter().filter_map(total_cpu).collect();
    let latency = |index: usize| -> Vec<f64> { legs.iter().filter_map(|leg| Some(leg.latency_us?[index])).collect() };
    let sum_and_worst = |figure: fn(&LegResult) -> u64| {
        let all = || legs.iter().map(figure);
        format!("{} / {}", all().sum::<u64>(), all().max().unwrap_or(0))
    };
    let memory = |figure: fn(&crate::usage::MemoryUse) -> f64| {
        let all: Vec<f64> = legs.iter().filter_map(|leg| leg.memory.as_ref().map(figure)).collect();
        digits(median(&all), 1)
    };
    vec![
        count.to_string(),
        spread(&cpu, 1),
        digits((!cpu.is_empty()).then(|| mean(&cpu) * count as f64), 0),
        legs.iter().map(|leg| leg.ticks).sum::<u64>().to_string(),
        sum_and_worst(|leg| leg.missed),
        sum_and_worst(|leg| leg.braked),
        sum_and_worst(|leg| leg.slipped),
        spread(&latency(0), 0),
        spread(&latency(1), 0),
        spread(&latency(2), 0),
        memory(|memory| memory.proportional),
        memory(|memory| memory.shared),
    ]
}

fn total_cpu(leg: &LegResult) -> Option<f64> {
    Some(leg.cpu.as_ref()?.values().sum())
}

fn groups(counts: &[LegCount]) -> String {
    let head: Vec<&str> = ["legs"].into_iter().chain(GROUPS).collect();
    let share = |count: &LegCount, group: &str| -> String {
        let all: Vec<f64> = count.results.iter().filter_map(|leg| leg.cpu.as_ref()?.get(group).copied()).collect();
        digits((!all.is_empty()).then(|| mean(&all)), 1)
    };
    let row = |count: &LegCount| [count.legs.to_string()].into_iter().chain(GROUPS.map(|group| share(count, group))).collect();
    table(&head, &counts.iter().map(row).collect::<Vec<_>>())
}

fn speed(speeds: &[SpeedResult]) -> String {
    let smallest = |values: &[f64]| values.iter().copied().reduce(f64::min);
    let row = |speed: &SpeedResult| {
        let totals = &speed.totals;
        let range = format!("{} to {}", digits(smallest(totals), 1), digits(largest(totals), 1));
        vec![speed.mode.name.to_owned(), digits(median(totals), 1), range]
    };
    table(&["mode", "median", "range"], &speeds.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::speed::MODES;
    use crate::usage::MemoryUse;
    use std::collections::BTreeMap;

    fn leg(missed: u64, plant: f64) -> LegResult {
        LegResult {
            ticks: 1000,
            missed,
            latency_us: Some([50.0 + plant, 90.0, 100.0, 200.0]),
            cpu: Some(BTreeMap::from([("plant", plant), ("gate", 1.0)])),
            memory: Some(MemoryUse { proportional: 40.0, shared: 20.0 }),
            ..LegResult::default()
        }
    }

    #[test]
    fn row_two_legs_pooled() {
        let cells = row(2, &[leg(3, 10.0), leg(0, 20.0)]);
        let expected =
            ["2", "16.0 / 21.0", "32", "2000", "3 / 3", "0 / 0", "0 / 0", "65 / 70", "90 / 90", "100 / 100", "40.0", "20.0"];
        assert_eq!(cells, expected);
        let nothing = row(8, &[LegResult::default()]);
        assert_eq!((nothing[1].as_str(), nothing[2].as_str(), nothing[7].as_str(), nothing[10].as_str()), ("-", "-", "-", "-"));
    }

    #[test]
    fn section_three_tables_present() {
        let mut count = LegCount::new(2);
        count.results = vec![leg(0, 10.0), leg(0, 20.0)];
        let mut speed = SpeedResult::new(MODES[2]);
        speed.totals = vec![3.0, 1.0, 2.0];
        let arguments = Arguments { file: "a.md".to_owned(), seconds: 7, rounds: 3 };
        let text = section(&arguments, &[count], &[speed]);
        assert!(text.contains("7 s measured in each of 3 rounds"), "{text}");
        assert!(text.contains("| 2 | 15.0 | - | - | - | 1.0 | - | - |\n"), "{text}");
        assert!(text.contains("| `hapfic simulate`, 1 job | 2.0 | 1.0 to 3.0 |\n") && text.ends_with('\n'), "{text}");
    }
}
