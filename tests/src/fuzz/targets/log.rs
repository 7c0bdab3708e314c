//! Target `log`: MCAP logs, read, recovered and reported.

use super::stage::StackFixture;
use crate::fuzz::target::{FuzzOutcome, FuzzTarget};
use hapfic_log::{Attachment, LogError, Metrics, Names, Reader, Writer, WriterOptions, recover};
use hapfic_messages::{Detector, Event, EventKind, Phase, Process, Severity, Timing};
use hapfic_report::Report;
use hapfic_simulation::Snapshot;
use mcap::records::{MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::Path;

pub(super) const TARGET: FuzzTarget = FuzzTarget {
    name: "log",
    seeds,
    dictionary: &[
        "/state",
        "/reference",
        "/request",
        "/request/standby",
        "/command",
        "/operator",
        "/event",
        "/timing",
        "/tf",
        "/scene",
        "/log",
        "hapfic.State",
        "hapfic.Request",
        "hapfic.Command",
        "hapfic.Event",
        "foxglove.SceneUpdate",
        "protobuf",
        "json",
        "lz4",
        "zstd",
        "names",
        "hapfic",
        "joint.0",
        "body.0",
        "object.0",
        "duration_ticks",
        "lockstep",
        "active",
        "brake",
        "nominal",
        "transition",
        "MCAP0\r\n",
    ],
    text: false,
    max_bytes: 256 * 1024,
    execute,
};

/// Name of the log in error messages.
const NAME: &str = "fuzz.mcap";
/// Mean interval of the rendered inputs; rendering takes a hundred times as long as the rest.
const RENDER_INTERVAL: u8 = 32;
/// Ticks of a seed.
const TICKS: i64 = 5;

/// Returns a log as the recorder writes it, and a copy without compression and checksums: mutations reach its content.
fn seeds() -> Vec<Vec<u8>> {
    let log = StackFixture::with(written);
    let plain = plain(&log);
    vec![log, plain]
}

fn written(fixture: &StackFixture) -> Vec<u8> {
    let record = [("scenario", "floor"), ("clock", "lockstep"), ("duration_ticks", "5")];
    let record = record.map(|(key, value)| (key.to_owned(), value.to_owned()));
    let header = [("hapfic".to_owned(), BTreeMap::from(record))];
    let media_type = "application/toml".to_owned();
    let attachments = [Attachment { name: "scenario.toml".to_owned(), media_type, bytes: b"seed = 1".to_vec() }];
    let options = WriterOptions { start_unix_ns: 0, chunk_bytes: 4096, ..WriterOptions::default() };
    let mut bytes = Vec::new();
    let mut writer =
        Writer::new(&mut bytes, Path::new(NAME), &fixture.names, &header, &attachments, &options).expect("a log in memory");
    for tick in 0..TICKS {
        let mut snapshot = fixture.snapshots[tick as usize % fixture.snapshots.len()].messages;
        snapshot.state.tick = tick;
        snapshot.reference.tick = tick;
        snapshot.command.tick = tick;
        snapshot.command.request.tick = tick;
        snapshot.operator.current.effective_tick = tick;
        write_tick(&mut writer, tick, &snapshot).expect("a log in memory");
    }
    writer.finish().expect("a log in memory");
    bytes
}

fn write_tick<W: Write>(writer: &mut Writer<W>, tick: i64, snapshot: &Snapshot) -> Result<(), LogError> {
    const TEXT: &str = "severity nominal -> brake";
    let event = Event::new(tick, Process::Planner, EventKind::Transition, Severity::Brake, Detector::Deadline, TEXT);
    let (process, phase) = (Process::Supervisor.code(), Phase::Running.code());
    let timing = Timing { process, phase, tick, publish_ns: 9, latency_ns: 50_000, ..Timing::default() };
    writer.operator(&snapshot.operator.current)?;
    writer.state(&snapshot.state)?;
    writer.reference(&snapshot.reference)?;
    writer.request(&snapshot.command.request)?;
    writer.command(&snapshot.command)?;
    writer.event(&event)?;
    writer.timing(&timing, 1)?;
    Ok(())
}

fn plain(log: &[u8]) -> Vec<u8> {
    let options = mcap::WriteOptions::new()
        .compression(None)
        .chunk_size(Some(2048))
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false)
        .calculate_summary_section_crc(false)
        .calculate_attachment_crcs(false);
    let mut bytes = Vec::new();
    let mut writer = options.create(Cursor::new(&mut bytes)).expect("a log in memory");
    let names = StackFixture::with(|fixture| fixture.names.to_metadata());
    writer.write_metadata(&Metadata { name: Names::METADATA.to_owned(), metadata: names }).expect("a log in memory");
    for message in mcap::MessageStream::new(log).expect("a log") {
        let message = message.expect("a whole log");
        let schema = message.channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
        let schema = writer.add_schema(schema, "protobuf", b"not read").expect("a log in memory");
        let channel_id =
            writer.add_channel(schema, &message.channel.topic, "protobuf", &BTreeMap::new()).expect("a log in memory");
        let (sequence, log_time, publish_time) = (message.sequence, message.log_time, message.publish_time);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        writer.write_to_known_channel(&header, &message.data).expect("a log in memory");
    }
    writer.finish().expect("a log in memory");
    drop(writer);
    bytes
}

fn execute(input: &[u8], scratch: &Path) -> FuzzOutcome {
    recovered(input, scratch);
    reported(input);
    let read = Reader::new(input, Path::new(NAME)).and_then(|mut reader| read_all(&mut reader));
    match read {
        Ok(()) => FuzzOutcome::Accepted,
        Err(error) => FuzzOutcome::Rejected(error.to_string()),
    }
}

/// Reads until the end or the first error, which must be the last item; computes the metrics of the entries before.
fn read_all<R: Read>(reader: &mut Reader<R>) -> Result<(), LogError> {
    let mut metrics = Metrics::new();
    let mut error = None;
    for item in &mut *reader {
        assert!(error.is_none(), "found an item after the error {error:?}");
        match item {
            Ok(entry) => metrics.push(&entry.record),
            Err(found) => error = Some(found),
        }
    }
    let _ = (reader.names(), metrics.summary());
    error.map_or(Ok(()), Err)
}

/// Asserts that a recovery keeps the original, and writes a log that opens or nothing.
fn recovered(input: &[u8], scratch: &Path) {
    let (original, new) = (scratch.join("run.mcap"), scratch.join("new.mcap"));
    let _ = fs::remove_file(&new);
    fs::write(&original, input).expect("scratch can be written");
    let result = recover(&original, Some(&new));
    assert_eq!(fs::read(&original).expect("the original"), input, "the original was changed");
    let output = match result {
        Ok(found) => found.output,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            None
        }
    };
    let files = fs::read_dir(scratch).expect("scratch can be read").count();
    assert_eq!(files, 1 + usize::from(output.is_some()), "files beside the original");
    if let Some(path) = output {
        let read = Reader::open(&path).and_then(|mut reader| read_all(&mut reader));
        match read {
            Ok(()) => {}
            // A chunk with a valid checksum, or none, is kept bit for bit, also if another program wrote its content.
            Err(LogError::Damaged { what, .. }) if what.contains("does not decode") => {}
            Err(error) => panic!("the recovered log is damaged: {error}"),
        }
    }
}

/// Asserts that a report of all readable entries succeeds.
fn reported(input: &[u8]) {
    let path = Path::new(NAME);
    let Ok(reader) = Reader::new(input, path) else { return };
    let Ok(report) = Report::from_reader(reader, path) else { return };
    assert!(report.metrics().is_object(), "found no metrics");
    let _ = (report.text(), report.json());
    if input.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) % RENDER_INTERVAL == 0 {
        let page = report.html().expect("a page");
        assert!(page.ends_with("</html>\n") || page.ends_with("</html>"), "the page has no end");
        assert!(!report.pictures().expect("pictures").is_empty());
    }
}
