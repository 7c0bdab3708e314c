//! Recovery of truncated and altered logs, with everything before the damage.

use crate::samples::{attachments, header, log, names, read, write_tick};
use hapfic_log::{LogError, RecoverError, Recovery, Topic, Writer, WriterOptions, recover};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Topic, number, times and content.
type LoggedMessage = (String, u32, u64, u64, Vec<u8>);

/// Log of several chunks, and its content.
struct SampleLog {
    bytes: Vec<u8>,
    messages: Vec<LoggedMessage>,
    /// Of each chunk: first byte, end, and number of messages up to its end.
    chunks: Vec<(usize, usize, usize)>,
}

fn sample() -> &'static SampleLog {
    static SAMPLE: OnceLock<SampleLog> = OnceLock::new();
    SAMPLE.get_or_init(|| {
        let bytes = log(
            80,
            &WriterOptions { start_unix_ns: 1_760_000_000_000_000_000, chunk_bytes: 16 * 1024, ..WriterOptions::default() },
        );
        let mut ranges: Vec<_> = mcap::Summary::read(&bytes)
            .unwrap()
            .unwrap()
            .chunk_indexes
            .iter()
            .map(|index| (index.chunk_start_offset as usize, (index.chunk_start_offset + index.chunk_length) as usize))
            .collect();
        ranges.sort_unstable();
        let chunks: Vec<_> = ranges.iter().map(|&(start, end)| (start, end, read(&bytes[..end]).0.len())).collect();
        assert!(chunks.len() > 5, "{} chunks", chunks.len());
        let messages = messages(&bytes);
        SampleLog { bytes, messages, chunks }
    })
}

fn messages(bytes: &[u8]) -> Vec<LoggedMessage> {
    mcap::MessageStream::new(bytes)
        .unwrap()
        .map(|message| message.unwrap())
        .map(|m| (m.channel.topic.clone(), m.sequence, m.log_time, m.publish_time, m.data.to_vec()))
        .collect()
}

/// Creates an empty folder for a test.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("recover").join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Recovers damaged bytes; returns the findings and the messages of the new log.
fn recovered(folder: &Path, damaged: &[u8]) -> Result<(Recovery, Vec<LoggedMessage>), RecoverError> {
    let (original, new) = (folder.join("run.mcap"), folder.join("new.mcap"));
    let _ = fs::remove_file(&new);
    fs::write(&original, damaged).unwrap();
    let result = recover(&original, Some(&new));
    assert_eq!(fs::read(&original).unwrap(), damaged, "the original was changed");
    let files = fs::read_dir(folder).unwrap().count();
    let found = match result {
        Ok(found) => found,
        Err(error) => {
            assert_eq!(files, 1, "a file is left after {error}");
            return Err(error);
        }
    };
    assert_eq!(files, 2);
    assert_eq!(found.output.as_deref(), Some(new.as_path()));
    let bytes = fs::read(&new).unwrap();
    let messages = messages(&bytes);
    let stats = mcap::Summary::read(&bytes).unwrap().expect("a summary").stats.expect("statistics");
    assert_eq!(stats.message_count, messages.len() as u64);
    assert_eq!(found.message_count(), messages.len() as u64);
    assert!(found.loss_count > 0, "the damage is not reported");
    assert_eq!(messages.iter().collect::<BTreeSet<_>>().len(), messages.len(), "a message was kept twice");
    let (entries, error) = read(&bytes);
    assert!(error.is_none() && entries.len() == messages.len(), "{error:?}");
    Ok((found, messages))
}

/// Asserts that all messages of chunks before and after the damaged bytes are kept, in order.
fn assert_kept(damage: std::ops::Range<usize>, kept: &[LoggedMessage], what: &str) {
    let sample = sample();
    let before = sample.chunks.iter().filter(|chunk| chunk.1 <= damage.start).map(|chunk| chunk.2).max().unwrap_or(0);
    let hit = sample.chunks.iter().filter(|chunk| chunk.0 < damage.end).map(|chunk| chunk.2).max().unwrap_or(0);
    let (first, last) = (&sample.messages[..before], &sample.messages[hit.max(before)..]);
    assert!(kept.starts_with(first), "{what}: of {} messages before the damage some are missing", first.len());
    assert!(kept.ends_with(last), "{what}: of {} messages after the damage some are missing", last.len());
    assert!(kept.len() >= first.len() + last.len() && kept.len() <= sample.messages.len(), "{what}: {} messages", kept.len());
}

/// Repeatable random numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }
}

#[test]
fn recover_truncated_log_keeps_beginning() {
    let (sample, folder, mut random) = (sample(), folder("cut"), Random(11));
    let mut rescued = 0;
    for _ in 0..100 {
        let length = random.below(sample.bytes.len());
        match recovered(&folder, &sample.bytes[..length]) {
            Ok((found, kept)) => {
                assert_kept(length..sample.bytes.len(), &kept, &format!("cut off at {length}"));
                assert!(sample.messages.starts_with(&kept), "cut off at {length}: the messages are others");
                rescued += found.unchecked;
            }
            Err(RecoverError::Nothing { .. }) => assert!(length < sample.chunks[0].0, "cut off at {length}"),
            Err(error) => panic!("cut off at {length}: {error}"),
        }
    }
    assert!(rescued > 0, "no message of a chunk that was cut off was rescued");
}

#[test]
fn recover_altered_bit_keeps_other_chunks() {
    let (sample, folder, mut random) = (sample(), folder("bit"), Random(12));
    for _ in 0..100 {
        let (index, bit) = (random.below(sample.bytes.len()), random.below(8));
        let mut damaged = sample.bytes.clone();
        damaged[index] ^= 1 << bit;
        let (_, kept) = recovered(&folder, &damaged).unwrap();
        assert_kept(index..index + 1, &kept, &format!("bit {bit} of byte {index}"));
    }
}

#[test]
fn recover_wrong_length_loses_no_chunk() {
    let (sample, folder) = (sample(), folder("length"));
    let (start, ..) = sample.chunks[sample.chunks.len() / 2];
    for bit in (0..64).step_by(3) {
        let mut damaged = sample.bytes.clone();
        // After the opcode.
        damaged[start + 1 + bit / 8] ^= 1 << (bit % 8);
        let (found, kept) = recovered(&folder, &damaged).unwrap();
        assert!(kept == sample.messages, "bit {bit}: {} of {} messages", kept.len(), sample.messages.len());
        assert_eq!((found.unchecked, found.loss_count, found.losses[0].byte), (0, 1, start as u64), "bit {bit}");
        assert!(found.losses[0].what.contains("length"), "bit {bit}: {}", found.losses[0].text());
    }
}

#[test]
fn recover_zeroed_range_keeps_other_chunks() {
    let (sample, folder, mut random) = (sample(), folder("hole"), Random(13));
    for _ in 0..50 {
        let start = random.below(sample.bytes.len() - 1000);
        let end = start + 100 + random.below(900);
        let mut damaged = sample.bytes.clone();
        damaged[start..end].fill(0);
        let (_, kept) = recovered(&folder, &damaged).unwrap();
        assert_kept(start..end, &kept, &format!("zeros from {start} to {end}"));
    }
}

#[test]
fn recover_truncated_chunk_keeps_its_beginning() {
    let (sample, folder) = (sample(), folder("near"));
    let index = sample.chunks.len() / 2;
    let ((start, end, until), before) = (sample.chunks[index], sample.chunks[index - 1].2);
    // Only the checksum of the frame is missing.
    let (found, kept) = recovered(&folder, &sample.bytes[..end - 4]).unwrap();
    assert_eq!(kept, sample.messages[..until]);
    assert_eq!(found.unchecked, (until - before) as u64);
    let (_, half) = recovered(&folder, &sample.bytes[..start + (end - start) / 2]).unwrap();
    assert!(half.len() > before, "nothing of half a chunk");
    assert_eq!(half, sample.messages[..half.len()]);
}

#[test]
fn recover_lost_first_chunk_restores_schemas() {
    let (sample, folder) = (sample(), folder("first"));
    // The first chunk holds the schemas, the second the first messages.
    let (start, (_, end, until)) = (sample.chunks[0].0, sample.chunks[1]);
    assert!(until > 0);
    let mut damaged = sample.bytes.clone();
    damaged[start..end].fill(0);
    let (found, kept) = recovered(&folder, &damaged).unwrap();
    assert_eq!(kept, sample.messages[until..]);
    assert_eq!(found.rebuilt.len(), Topic::COUNT);
    // The first message is one of the operator: the order of the messages does not number the topics.
    let new = fs::read(folder.join("new.mcap")).unwrap();
    let channels = mcap::Summary::read(&new).unwrap().unwrap().channels;
    let mut numbers: Vec<_> = channels.iter().map(|(id, channel)| (*id, channel.topic.as_str())).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, Topic::ALL.map(|topic| (topic as u16 + 1, topic.name())));
    assert_eq!(found.states.ranges.first().map(|range| range.0), Some(0), "the gap at the start");
}

#[test]
fn recover_copies_attachments_and_metadata() {
    let (sample, folder) = (sample(), folder("attachments"));
    recovered(&folder, &sample.bytes[..sample.bytes.len() - 1]).unwrap();
    let reader = hapfic_log::Reader::open(folder.join("new.mcap")).unwrap();
    assert_eq!(reader.attachments(), attachments());
    assert_eq!(reader.names(), names());
    assert_eq!(reader.metadata()["hapfic"], header()[0].1);
    let mut reader = reader;
    assert!(reader.all(|entry| entry.is_ok()));
    assert_eq!(reader.metadata()["recovery"]["messages"], sample.messages.len().to_string());
}

#[test]
fn recover_complete_log_is_not_copied() {
    let folder = folder("whole");
    let path = folder.join("run.mcap");
    fs::write(&path, &sample().bytes).unwrap();
    let found = recover(&path, None).unwrap();
    assert_eq!((found.output.as_deref(), found.loss_count), (None, 0));
    assert_eq!(found.message_count(), sample().messages.len() as u64);
    assert_eq!((found.states.count, found.ticks()), (0, Some((0, 79))));
    assert_eq!(fs::read(&path).unwrap(), sample().bytes);
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
}

#[test]
fn recover_invalid_request_is_rejected() {
    let folder = folder("rejected");
    let (path, other) = (folder.join("run.mcap"), folder.join("run.recovered.mcap"));
    fs::write(&path, &sample().bytes[..sample().bytes.len() / 2]).unwrap();
    assert!(matches!(recover(&path, Some(&path)), Err(RecoverError::SameFile { .. })));
    recover(&path, None).unwrap();
    assert!(other.exists());
    assert!(matches!(recover(&path, None), Err(RecoverError::Exists { path }) if path == other));
    fs::write(&path, b"<?xml version='1.0'?>").unwrap();
    let error = recover(&path, Some(&folder.join("a.mcap"))).unwrap_err();
    assert!(matches!(error, RecoverError::Log(LogError::NotMcap { .. })) && error.is_invalid_request(), "{error}");
    fs::write(&path, b"").unwrap();
    assert!(matches!(recover(&path, Some(&folder.join("a.mcap"))), Err(RecoverError::Nothing { .. })));
    let missing = recover(&folder.join("missing.mcap"), None);
    assert!(matches!(missing, Err(RecoverError::Log(LogError::Open { .. }))), "{missing:?}");
    assert!(!folder.join("a.mcap").exists());
}

#[test]
fn recover_log_being_written_is_rejected() {
    let path = folder("busy").join("run.mcap");
    let options = WriterOptions::default();
    let mut writer = Writer::create(&path, &names(), &header(), &attachments(), &options).unwrap();
    write_tick(&mut writer, 0).unwrap();
    writer.flush().unwrap();
    let result = recover(&path, None);
    assert!(matches!(result, Err(RecoverError::StillWritten { .. })), "{result:?}");
    writer.finish().unwrap();
    assert_eq!(recover(&path, None).unwrap().output, None);
}
