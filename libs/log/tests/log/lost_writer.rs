//! A writer is lost: its part is ended, and another writer continues the log.

use crate::samples::{attachments, header, names, write_tick};
use hapfic_log::{LogFigures, LogParts, Record, Remainder, Topic, Writer, WriterOptions, close_last_part, recover};
use std::path::{Path, PathBuf};

const OPTIONS: WriterOptions =
    WriterOptions { start_unix_ns: 0, chunk_bytes: 4096, in_parts: true, part_bytes: None, keep_bytes: None };

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()))
}

/// Loses a writer, and the lock that its process would have lost with it.
fn lose(writer: Writer, part: &Path) {
    // Neither the rest nor an end.
    std::mem::forget(writer);
    let copy = part.with_extension("copy");
    std::fs::copy(part, &copy).unwrap();
    std::fs::rename(copy, part).unwrap();
}

/// A log whose writer is lost after 150 ticks, of which 100 are flushed; with its size at the flush.
fn lost(name: &str) -> (PathBuf, u64) {
    let folder = path(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let log = folder.join("run.mcap");
    let mut writer = Writer::create(&log, &names(), &header(), &attachments(), &OPTIONS).unwrap();
    (0..100).for_each(|tick| write_tick(&mut writer, tick).unwrap());
    writer.flush().unwrap();
    let (part, flushed) = writer.part();
    assert_eq!(part, 1);
    (100..150).for_each(|tick| write_tick(&mut writer, tick).unwrap());
    assert!(writer.part().1 > flushed, "chunks behind the flush have reached the file");
    lose(writer, &log);
    (log, flushed)
}

fn state_ticks(log: &Path) -> Vec<i64> {
    let records = LogParts::open(log).unwrap().map(|message| message.unwrap().record);
    records.filter_map(|record| if let Record::State(state) = record { Some(state.tick) } else { None }).collect()
}

fn is_whole(part: &Path) -> bool {
    let bytes = std::fs::read(part).unwrap();
    mcap::MessageStream::new(&bytes).unwrap().all(|message| message.is_ok()) && recover(part, None).unwrap().output.is_none()
}

#[test]
fn lost_part_ends_where_it_was_flushed_and_next_continues() {
    let (log, flushed) = lost("lost-removed");
    close_last_part(&log, 1, flushed, Remainder::Removed).unwrap();
    assert!(is_whole(&log));
    assert_eq!(state_ticks(&log), (0..100).collect::<Vec<_>>());
    let mut writer = Writer::resume(&log, &names(), &header(), &attachments(), &OPTIONS).unwrap();
    assert_eq!(writer.part().0, 2);
    (100..150).for_each(|tick| write_tick(&mut writer, tick).unwrap());
    assert_eq!(writer.finish().unwrap().messages(Topic::State), 50);
    assert_eq!(state_ticks(&log), (0..150).collect::<Vec<_>>());
    let figures = LogFigures::of_log(&log).unwrap();
    assert_eq!((figures.ticks, figures.parts), ([150; 2], [2, 0]));
    let sizes = hapfic_log::parts(&log).iter().map(|part| std::fs::metadata(part).unwrap().len()).sum::<u64>();
    assert_eq!(figures.file_bytes, sizes);
}

#[test]
fn lost_part_keeps_whole_chunks_behind_the_flush() {
    let (log, flushed) = lost("lost-kept");
    close_last_part(&log, 1, flushed, Remainder::Kept).unwrap();
    assert!(is_whole(&log));
    let ticks = state_ticks(&log);
    assert!(ticks.len() > 100 && ticks.len() < 150, "{}", ticks.len());
    assert!(ticks.iter().copied().eq(0..ticks.len() as i64));
    // Ended once: a second call changes nothing.
    let before = std::fs::read(&log).unwrap();
    close_last_part(&log, 1, flushed, Remainder::Kept).unwrap();
    assert_eq!(std::fs::read(&log).unwrap(), before);
}

#[test]
fn lost_part_without_message_makes_room() {
    let (log, flushed) = lost("lost-empty");
    close_last_part(&log, 1, flushed, Remainder::Removed).unwrap();
    let mut writer = Writer::resume(&log, &names(), &header(), &attachments(), &OPTIONS).unwrap();
    let (part, beginning) = writer.part();
    (100..101).for_each(|tick| write_tick(&mut writer, tick).unwrap());
    lose(writer, &hapfic_log::part_path(&log, part));
    close_last_part(&log, part, beginning, Remainder::Removed).unwrap();
    assert_eq!(hapfic_log::parts(&log), std::slice::from_ref(&log));
    // A part that began behind the last flush goes, too.
    let writer = Writer::resume(&log, &names(), &header(), &attachments(), &OPTIONS).unwrap();
    lose(writer, &hapfic_log::part_path(&log, 2));
    close_last_part(&log, 1, flushed, Remainder::Removed).unwrap();
    assert_eq!(hapfic_log::parts(&log), std::slice::from_ref(&log));
    assert!(is_whole(&log));
    let error = close_last_part(&log, 1, 1 << 40, Remainder::Removed).unwrap_err();
    assert!(error.to_string().contains("shorter"), "{error}");
}

#[test]
fn first_part_unreadable_or_missing_others_are_read() {
    let (log, flushed) = lost("lost-first");
    close_last_part(&log, 1, flushed, Remainder::Removed).unwrap();
    let mut writer = Writer::resume(&log, &names(), &header(), &attachments(), &OPTIONS).unwrap();
    (100..150).for_each(|tick| write_tick(&mut writer, tick).unwrap());
    writer.finish().unwrap();
    let second = hapfic_log::part_path(&log, 2);
    let read = || {
        let (records, errors): (Vec<_>, Vec<_>) = LogParts::open(&log).unwrap().partition(Result::is_ok);
        let states = records.into_iter().filter(|entry| matches!(entry.as_ref().unwrap().record, Record::State(_))).count();
        (states, errors.len())
    };
    let mut bytes = std::fs::read(&log).unwrap();
    bytes[..64].fill(0);
    std::fs::write(&log, bytes).unwrap();
    assert_eq!(read(), (50, 1), "an error, then the second part");
    std::fs::remove_file(&log).unwrap();
    assert_eq!(read(), (50, 1));
    assert_eq!(hapfic_log::parts(&log), std::slice::from_ref(&second));
    std::fs::remove_file(second).unwrap();
    assert!(LogParts::open(&log).is_err());
    assert_eq!(hapfic_log::parts(&log), std::slice::from_ref(&log));
}
