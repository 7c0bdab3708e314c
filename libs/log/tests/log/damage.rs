//! Truncated, altered and foreign files: one clear error, never a panic.

use crate::samples::{event, log, read};
use hapfic_log::{LogError, LogMessage, WriterOptions, convert};
use mcap::records::{MessageHeader, Metadata};
use proptest::prelude::*;
use prost::Message;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::OnceLock;

const EVENTS: usize = 5;

/// Log of two kilobytes with every kind of record, written by `mcap` itself.
fn small_log(compression: Option<mcap::Compression>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(100));
    let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
    let metadata = BTreeMap::from([("joint.0".to_owned(), "hip".to_owned())]);
    writer.write_metadata(&Metadata { name: "names".into(), metadata }).unwrap();
    writer
        .attach(&mcap::Attachment {
            log_time: 1,
            create_time: 2,
            name: "scenario.toml".into(),
            media_type: "application/toml".into(),
            data: Cow::Borrowed(b"seed = 1"),
        })
        .unwrap();
    let schema = writer.add_schema("hapfic.Event", "protobuf", b"not read").unwrap();
    let channel_id = writer.add_channel(schema, "/event", "protobuf", &BTreeMap::new()).unwrap();
    for tick in 0..EVENTS as i64 {
        let time = tick as u64;
        let header = MessageHeader { channel_id, sequence: tick as u32, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &convert::event(&event(tick, "it happened")).encode_to_vec()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

fn small_logs() -> [Vec<u8>; 2] {
    [small_log(Some(mcap::Compression::Lz4)), small_log(None)]
}

/// Log of the writer, and its messages.
fn real_log() -> &'static (Vec<u8>, Vec<LogMessage>) {
    static LOG: OnceLock<(Vec<u8>, Vec<LogMessage>)> = OnceLock::new();
    LOG.get_or_init(|| {
        let bytes = log(6, &WriterOptions { chunk_bytes: 4096, ..WriterOptions::default() });
        let entries = read(&bytes).0;
        (bytes, entries)
    })
}

fn assert_truncated(bytes: &[u8], length: usize, whole: &[LogMessage]) {
    let (entries, error) = read(&bytes[..length]);
    let reported = matches!(error, Some(LogError::Truncated { byte, .. }) if byte == length as u64);
    assert!(reported, "cut off at {length}: {error:?}");
    assert_eq!(entries, whole[..entries.len()], "cut off at {length}");
}

#[test]
fn reader_truncated_log_gives_beginning_and_end_position() {
    for bytes in small_logs() {
        let (whole, error) = read(&bytes);
        assert!(error.is_none() && whole.len() == EVENTS, "{error:?}");
        for length in 0..bytes.len() {
            assert_truncated(&bytes, length, &whole);
        }
    }
    let (bytes, whole) = real_log();
    for length in (0..bytes.len()).step_by(211).chain(bytes.len() - 40..bytes.len()) {
        assert_truncated(bytes, length, whole);
    }
}

#[test]
fn reader_altered_byte_gives_at_most_one_error() {
    for bytes in small_logs() {
        for index in 0..bytes.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut altered = bytes.clone();
                altered[index] ^= flip;
                let (entries, _) = read(&altered);
                assert!(entries.len() <= EVENTS, "byte {index} altered by {flip:#x} adds messages");
            }
        }
    }
}

#[test]
fn reader_altered_chunk_is_rejected_as_whole_and_located() {
    let (bytes, whole) = real_log();
    let chunk = mcap::Summary::read(bytes).unwrap().unwrap().chunk_indexes.last().unwrap().clone();
    let mut altered = bytes.clone();
    altered[(chunk.compressed_data_offset().unwrap() + chunk.compressed_size / 2) as usize] ^= 0x10;
    let (entries, error) = read(&altered);
    let located = matches!(error, Some(LogError::Damaged { byte, .. }) if byte == chunk.chunk_start_offset);
    assert!(located, "{error:?}");
    assert!(!entries.is_empty() && entries.len() < whole.len());
    assert_eq!(entries, whole[..entries.len()]);
}

#[test]
fn reader_foreign_file_is_not_mcap() {
    for bytes in [&b"<?xml version='1.0'?>"[..], b"PK", &[0; 100]] {
        let (entries, error) = read(bytes);
        assert!(entries.is_empty());
        assert!(matches!(error, Some(LogError::NotMcap { .. })), "{error:?}");
    }
    let message = read(b"PK").1.map(|error| error.to_string()).unwrap_or_default();
    assert!(message.starts_with("memory: not a log: it starts with 50 4b, expected"), "{message}");
}

#[test]
fn reader_record_over_chunk_end_is_rejected() {
    let bytes = small_log(None);
    let chunk = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes[0].clone();
    let data = chunk.compressed_data_offset().unwrap() as usize;
    let mut altered = bytes.clone();
    // Length of the first record in the chunk; then no checksum, as some writers leave it.
    altered[data + 1] = altered[data + 1].wrapping_add(200);
    let checksum = chunk.chunk_start_offset as usize + 9 + 24;
    altered[checksum..checksum + 4].fill(0);
    let error = read(&altered).1;
    assert!(matches!(error, Some(LogError::Damaged { .. })), "{error:?}");
}

#[test]
fn reader_attachment_shorter_than_header_is_rejected() {
    let mut bytes = mcap::MAGIC.to_vec();
    let mut record = |opcode: u8, body: &[u8]| {
        bytes.push(opcode);
        bytes.extend_from_slice(&(body.len() as u64).to_le_bytes());
        bytes.extend_from_slice(body);
    };
    record(mcap::records::op::HEADER, &[0; 8]);
    // Times, two empty names and a length: the checksum is missing.
    record(mcap::records::op::ATTACHMENT, &[0; 32]);
    let error = read(&bytes).1;
    assert!(matches!(error, Some(LogError::Damaged { .. })), "{error:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn reader_random_damage_never_panics(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 1_u8..), 1..20),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let (bytes, whole) = real_log();
        let mut altered = bytes.clone();
        for (position, flip) in flips {
            altered[position.index(bytes.len())] ^= flip;
        }
        if let Some(cut) = cut {
            altered.truncate(cut.index(bytes.len()));
        }
        let (entries, _) = read(&altered);
        prop_assert!(entries.len() <= whole.len());
    }

    #[test]
    fn reader_random_bytes_after_magic_never_panic(tail in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.extend_from_slice(&tail);
        let (entries, error) = read(&bytes);
        prop_assert!(entries.is_empty());
        prop_assert!(error.is_some());
    }
}
