//! What a recovery found.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Most gaps and losses that are listed one by one; all are counted.
const LISTED: usize = 32;

/// What a recovery found in a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovery {
    /// The new log; `None` if the log is whole and no copy was made.
    pub output: Option<PathBuf>,
    /// Length of the original, bytes.
    pub file_bytes: u64,
    /// Messages kept, by topic.
    pub messages: BTreeMap<String, u64>,
    /// Of them, those of damaged chunks: no checksum vouches for them.
    pub unchecked: u64,
    /// Ticks of `/state`.
    pub states: TickGaps,
    /// Ticks of `/command`.
    pub commands: TickGaps,
    /// What was damaged, in the order of the file; the first 32 of them.
    pub losses: Vec<Loss>,
    /// How many damaged places there are.
    pub loss_count: u64,
    /// Bytes of the original in them, those of rescued messages too.
    pub lost_bytes: u64,
    /// Names of the attachments kept.
    pub attachments: Vec<String>,
    /// Names of the metadata records kept.
    pub metadata: Vec<String>,
    /// Topics whose channel or schema was damaged: they have those of this program.
    pub rebuilt: BTreeSet<String>,
}

/// A place of the original that is damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loss {
    /// Where it begins.
    pub byte: u64,
    /// How long it is, bytes; zero if something is missing there.
    pub bytes: u64,
    /// Messages rescued from it, without a checksum.
    pub rescued: u64,
    /// What was found there.
    pub what: String,
}

/// The ticks of one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TickGaps {
    /// First tick kept.
    pub first: Option<i64>,
    /// Highest tick kept.
    pub last: Option<i64>,
    /// Missing ticks before the last, from and to, both included; the first 32 such ranges.
    pub ranges: Vec<(i64, i64)>,
    /// How many such ranges there are.
    pub count: u64,
    /// Ticks in them.
    pub missing: u64,
}

impl TickGaps {
    /// Takes a tick as a log keeps it, cut to 32 bits.
    pub(super) fn note(&mut self, sequence: u32) {
        let near = self.last.unwrap_or(0);
        let tick = near.saturating_add(i64::from(sequence.wrapping_sub(near as u32) as i32));
        let expected = self.last.map_or(0, |last| last.saturating_add(1));
        if tick > expected {
            self.count += 1;
            self.missing += tick.abs_diff(expected);
            if self.ranges.len() < LISTED {
                self.ranges.push((expected, tick - 1));
            }
        }
        self.first = self.first.or(Some(tick));
        self.last = Some(self.last.map_or(tick, |last| last.max(tick)));
    }

    /// `3-7, 12`, and how many more; empty if none is missing.
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
    /// Whether there is nothing to be kept.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty() && self.attachments.is_empty() && self.metadata.is_empty()
    }

    /// Messages kept, of all topics.
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

    /// Notes a damaged place.
    pub(super) fn lose(&mut self, byte: u64, bytes: u64, rescued: u64, what: String) {
        self.loss_count += 1;
        self.lost_bytes += bytes;
        if self.losses.len() < LISTED {
            self.losses.push(Loss { byte, bytes, rescued, what });
        }
    }

    /// As the new log keeps it, in the metadata record `recovery`.
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

impl Loss {
    /// Where, how long, and what it is.
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
    fn gaps_are_told_and_bounded() {
        let mut gaps = TickGaps::default();
        for tick in [2, 3, 3, 5, 9] {
            gaps.note(tick);
        }
        assert_eq!(gaps.text(), "0-1, 4, 6-8");
        assert_eq!((gaps.first, gaps.last, gaps.missing), (Some(2), Some(9), 6));
        for tick in 0..100 {
            gaps.note(11 + 2 * tick);
        }
        assert_eq!(gaps.ranges.len(), LISTED);
        assert!(gaps.text().ends_with(&format!("and {} more", 103 - LISTED)), "{}", gaps.text());
    }

    #[test]
    fn a_loss_says_what_was_rescued_of_it() {
        let loss = |bytes, rescued| Loss { byte: 10, bytes, rescued, what: "a chunk is damaged".to_owned() }.text();
        assert_eq!(loss(0, 0), "byte 10: a chunk is damaged");
        assert_eq!(loss(20, 0), "byte 10, 20 bytes: a chunk is damaged");
        assert_eq!(loss(20, 3), "byte 10, 20 bytes, 3 messages rescued without a checksum: a chunk is damaged");
    }

    #[test]
    fn a_tick_goes_on_where_its_32_bits_end() {
        let mut gaps = TickGaps { first: Some(0), last: Some(i64::from(u32::MAX)), ..TickGaps::default() };
        gaps.note(0);
        assert_eq!((gaps.last, gaps.count), (Some(1 << 32), 0));
        let mut early = TickGaps::default();
        early.note(u32::MAX);
        early.note(0);
        assert_eq!((early.first, early.last, early.count), (Some(-1), Some(0), 0));
    }
}
