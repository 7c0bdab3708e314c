//! Content of a log, read by the `mcap` crate alone.

use std::collections::BTreeMap;
use std::path::Path;

/// Messages of each topic: log time [ns] and bytes, in the order of the file.
pub type Streams = BTreeMap<String, Vec<(u64, Vec<u8>)>>;

/// Reads every message of a finished log in all its parts, each of which has to be whole.
pub fn streams(path: &Path) -> Streams {
    let mut streams = Streams::new();
    for part in hapfic_log::parts(path) {
        for (topic, messages) in part_streams(&part) {
            streams.entry(topic).or_default().extend(messages);
        }
    }
    streams
}

/// Reads every message of one part.
pub fn part_streams(part: &Path) -> Streams {
    let bytes = std::fs::read(part).unwrap();
    let mut streams = Streams::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        streams.entry(message.channel.topic.clone()).or_default().push((message.log_time, message.data.into_owned()));
    }
    streams
}

/// Asserts that a log has a summary, and state and command of every tick from 0 on; returns the number of ticks.
pub fn expect_complete(path: &Path) -> usize {
    let bytes = std::fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a log that was closed has a summary");
    assert!(summary.stats.is_some());
    let ticks = |topic: &str| -> Vec<i64> {
        hapfic_log::Reader::open(path)
            .unwrap()
            .filter_map(|entry| match (entry.unwrap().record, topic) {
                (hapfic_log::Record::State(s), "/state") => Some(s.tick),
                (hapfic_log::Record::Command(c), "/command") => Some(c.tick),
                _ => None,
            })
            .collect()
    };
    let (states, commands) = (ticks("/state"), ticks("/command"));
    let expected: Vec<i64> = (0..states.len() as i64).collect();
    assert_eq!(states, expected, "a tick is missing in /state, or out of order");
    // At the end of an interrupted run the plant may be two states ahead of the last command.
    let ahead = states.len() - commands.len();
    assert!(ahead <= 2, "{} states, {} commands", states.len(), commands.len());
    assert_eq!(commands, expected[..commands.len().min(expected.len())], "a tick is missing in /command");
    states.len()
}
