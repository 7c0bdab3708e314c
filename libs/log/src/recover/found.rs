//! Findings of a recovery.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Most gaps and losses in a list; all are counted.
const MAX_LISTED: usize = 32;

/// Findings of a recovery.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovery {
    /// Path of the new log; `None` if the log is complete and no copy was made.
    pub output: Option<PathBuf>,
    /// Length of the original [bytes].
    pub file_bytes: u64,
    /// Messages kept, by topic.
    pub messages: BTreeMap<String, u64>,
    /// Of these, messages of damaged chunks: without a checksum.
    pub unchecked: u64,
    /// Ticks of `/state`.
    pub states: TickGaps,
    /// Ticks of `/command`.
    pub commands: TickGaps,
    /// Damaged places, in the order of the file; the first 32.
    pub losses: Vec<DamagedRange>,
    /// Number of damaged places.
    pub loss_count: u64,
    /// Size of the damaged places, rescued messages included [bytes].
    pub lost_bytes: u64,
    /// Names of the attachments kept.
    pub attachments: Vec<String>,
    /// Names of the metadata records kept.
    pub metadata: Vec<String>,
    /// Topics with a damaged channel or schema, which the channel and schema of this program replace.
    pub rebuilt: BTreeSet<String>,
}

/// Damaged place of the original.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedRange {
    /// First byte.
    pub byte: u64,
    /// Length [bytes]; zero if bytes are missing there.
    pub bytes: u64,
    /// Messages rescued from it, without a checksum.
    pub rescued: u64,
    /// Kind of damage.
    pub what: String,
}

/// Ticks of one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TickGaps {
    /// First tick kept.
    pub first: Option<i64>,
    /// Highest tick kept.
    pub last: Option<i64>,
    /// Missing ticks before the last, from and to, both included; the first 32 such ranges.
    pub ranges: Vec<(i64, i64)>,
    /// Number of such ranges.
    pub count: u64,
    /// Number of missing ticks.
    pub missing: u64,
    /// The log is a later part: its first tick is the first that it can have.
    pub(super) later_part: bool,
}

impl TickGaps {
    /// Adds a tick, cut to 32 bits as in the log.
    pub(super) fn add(&mut self, sequence: u32) {
        let near = self.last.unwrap_or(0);
        let tick = near.saturating_add(i64::from(sequence.wrapping_sub(near as u32) as i32));
        let begins = if self.later_part { tick } else { 0 };
        let expected = self.last.map_or(begins, |last| last.saturating_add(1));
        if tick > expected {
            self.count += 1;
            self.missing += tick.abs_diff(expected);
            if self.ranges.len() < MAX_LISTED {
                self.ranges.push((expected, tick - 1));
            }
        }
        self.first = self.first.or(Some(tick));
        self.last = Some(self.last.map_or(tick, |last| last.max(tick)));
    }

    /// Formats the ranges as `3-7, 12 and 4 more`; empty if no tick is missing.
    #[must_use]
    pub fn text(&self) -> String {
        let range = |&(from, to): &(i64, i64)| if from == to { from.to_string() } else { format!("{from}-{to}") };
        let mut text = self.ranges.iter().map(range).collect::<Vec<_>>().join(", ");
        let more = self.count.saturating_sub(self.ranges.len() as u64);
        if more > 0 {
            text += &format!(" and {more} more");
        }
        text
    }
}

impl Recovery {
    /// Whether the log has no readable record.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty() && self.attachments.is_empty() && self.metadata.is_empty()
    }

    /// Number of messages kept, of all topics.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.messages.values().sum()
    }

    /// First and last tick of `/state` and `/command` together.
    #[must_use]
    pub fn ticks(&self) -> Option<(i64, i64)> {
        let first = [self.states.first, self.commands.first].into_iter().flatten().min()?;
        let last = [self.states.last, self.commands.last].into_iter().flatten().max()?;
        Some((first, last))
    }

    /// Counts a message of a topic.
    pub(super) fn count(&mut self, topic: &str) {
        if let Some(count) = self.messages.get_mut(topic) {
            *count += 1;
        } else {
            self.messages.insert(topic.to_owned(), 1);
        }
    }

    /// Adds a damaged place.
    pub(super) fn add_loss(&mut self, byte: u64, bytes: u64, rescued: u64, what: String) {
        self.loss_count += 1;
        self.lost_bytes += bytes;
        if self.losses.len() < MAX_LISTED {
            self.losses.push(DamagedRange { byte, bytes, rescued, what });
        }
    }

    /// Converts the findings to the metadata record `recovery` of the new log.
    pub(super) fn to_metadata(&self) -> BTreeMap<String, String> {
        let mut record = BTreeMap::from([
            ("original_bytes".to_owned(), self.file_bytes.to_string()),
            ("messages".to_owned(), self.message_count().to_string()),
            ("messages_unchecked".to_owned(), self.unchecked.to_string()),
            ("damaged_places".to_owned(), self.loss_count.to_string()),
            ("damaged_bytes".to_owned(), self.lost_bytes.to_string()),
            ("missing_state_ticks".to_owned(), self.states.text()),
            ("missing_command_ticks".to_owned(), self.commands.text()),
            ("rebuilt_topics".to_owned(), self.rebuilt.iter().map(String::as_str).collect::<Vec<_>>().join(" ")),
        ]);
        for (index, loss) in self.losses.iter().enumerate() {
            record.insert(format!("damage.{index:02}"), loss.text());
        }
        record
    }
}

impl DamagedRange {
    /// Formats place, length and kind of the damage.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { byte, bytes, rescued, what } = self;
        let length = if *bytes == 0 { String::new() } else { format!(", {bytes} bytes") };
        let kept = if *rescued == 0 { String::new() } else { format!(", {rescued} messages rescued without a checksum") };
        format!("byte {byte}{length}{kept}: {what}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tick_gaps_are_listed_up_to_limit() {
        let mut gaps = TickGaps::default();
        for tick in [2, 3, 3, 5, 9] {
            gaps.add(tick);
        }
        assert_eq!(gaps.text(), "0-1, 4, 6-8");
        assert_eq!((gaps.first, gaps.last, gaps.missing), (Some(2), Some(9), 6));
        for tick in 0..100 {
            gaps.add(11 + 2 * tick);
        }
        assert_eq!(gaps.ranges.len(), MAX_LISTED);
        assert!(gaps.text().ends_with(&format!("and {} more", 103 - MAX_LISTED)), "{}", gaps.text());
    }

    #[test]
    fn loss_text_names_rescued_messages() {
        let loss = |bytes, rescued| DamagedRange { byte: 10, bytes, rescued, what: "a chunk is damaged".to_owned() }.text();
        assert_eq!(loss(0, 0), "byte 10: a chunk is damaged");
        assert_eq!(loss(20, 0), "byte 10, 20 bytes: a chunk is damaged");
        assert_eq!(loss(20, 3), "byte 10, 20 bytes, 3 messages rescued without a checksum: a chunk is damaged");
    }

    #[test]
    fn tick_gaps_32_bit_overflow_continues() {
        let mut gaps = TickGaps { first: Some(0), last: Some(i64::from(u32::MAX)), ..TickGaps::default() };
        gaps.add(0);
        assert_eq!((gaps.last, gaps.count), (Some(1 << 32), 0));
        let mut early = TickGaps::default();
        early.add(u32::MAX);
        early.add(0);
        assert_eq!((early.first, early.last, early.count), (Some(-1), Some(0), 0));
    }
}
