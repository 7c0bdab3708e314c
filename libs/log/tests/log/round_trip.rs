//! Round trip of written messages, with this reader and another.

use crate::samples::{
    MESSAGES_PER_TICK, attachments, command, event, header, line, log, names, parameters, read, reference, request, scene,
    standby_request, state, timing, transforms, write_tick,
};
use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use hapfic_log::{Attachment, LogError, Metrics, Reader, Record, Topic, Writer, WriterOptions, convert, time_of};
use hapfic_messages::{Command, Mode, Request, Source};
use mcap::records::MessageHeader;
use prost::Message;
use std::collections::BTreeMap;
use std::io::Read;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

fn decoded<M: Message + Default>(record: &Record, schema: &str) -> M {
    let Record::Other { schema: found, data } = record else { panic!("found {record:?}, expected {schema}") };
    assert_eq!(&**found, schema);
    M::decode(data.as_slice()).unwrap()
}

#[test]
fn round_trip_every_topic_is_identical() {
    let (entries, error) = read(&log(3, &WriterOptions::default()));
    assert!(error.is_none(), "{error:?}");
    assert_eq!(entries.len(), 3 * MESSAGES_PER_TICK);
    for (tick, records) in (0..3).zip(entries.chunks(MESSAGES_PER_TICK)) {
        assert_eq!(records[0].record, Record::Operator(convert::operator(&parameters(tick))));
        assert_eq!(records[1].record, Record::State(convert::state(&state(tick), &names())));
        assert_eq!(records[2].record, Record::Reference(convert::reference(&reference(tick))));
        assert_eq!(records[3].record, Record::Request(convert::request(&request(tick))));
        assert_eq!(records[4].record, Record::Request(convert::request(&standby_request(tick))));
        assert_eq!(records[5].record, Record::Command(convert::command(&command(tick))));
        assert_eq!(records[6].record, Record::Event(convert::event(&event(tick, "größer"))));
        assert_eq!(records[7].record, Record::Timing(convert::timing(&timing(tick))));
        assert_eq!(decoded::<FrameTransforms>(&records[8].record, "foxglove.FrameTransforms"), transforms(tick));
        assert_eq!(decoded::<SceneUpdate>(&records[9].record, "foxglove.SceneUpdate"), scene(tick));
        assert_eq!(decoded::<Log>(&records[10].record, "foxglove.Log"), line(tick));
        for (index, entry) in records.iter().enumerate() {
            let offset_ns = if index == 7 { 17 } else { 0 };
            assert_eq!((entry.sequence, entry.log_time_ns), (tick as u32, tick as u64 * 1_000_000 + offset_ns));
        }
        let topics: Vec<_> = records.iter().map(|entry| &*entry.topic).collect();
        let expected = [
            "/operator",
            "/state",
            "/reference",
            "/request",
            "/request/standby",
            "/command",
            "/event",
            "/timing",
            "/tf",
            "/scene",
            "/log",
        ];
        assert_eq!(topics, expected);
    }
}

#[test]
fn writer_requests_go_to_topic_of_their_controller() {
    let mut bytes = Vec::new();
    let options = WriterOptions::default();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names(), &[], &[], &options).unwrap();
    for tick in 0..5 {
        writer.request(&standby_request(tick)).unwrap();
    }
    writer.request(&request(0)).unwrap();
    // The supervisor's code, as in a zeroed request: only the standby has its own topic.
    writer.request(&Request { controller: 0, ..request(1) }).unwrap();
    let totals = writer.finish().unwrap();
    assert_eq!((totals.messages(Topic::Request), totals.messages(Topic::StandbyRequest)), (2, 5));
    let (entries, error) = read(&bytes);
    assert!(error.is_none() && entries.len() == 7, "{error:?}");
    for entry in entries {
        let Record::Request(request) = &entry.record else { panic!("found {:?}", entry.record) };
        assert_eq!(&*entry.topic == "/request/standby", request.controller == "standby", "{request:?}");
    }
}

#[test]
fn reader_foreign_topic_is_resolved_by_schema() {
    let mut bytes = Vec::new();
    let mut writer = mcap::WriteOptions::new().create(std::io::Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("hapfic.Request", "protobuf", b"not read").unwrap();
    // Name and schema of the second contradict each other.
    for topic in ["/elsewhere", "/state", "/request/standby"] {
        let channel_id = writer.add_channel(schema, topic, "protobuf", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: 3, log_time: 3, publish_time: 3 };
        writer.write_to_known_channel(&header, &convert::request(&request(3)).encode_to_vec()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let (entries, error) = read(&bytes);
    assert!(error.is_none() && entries.len() == 3, "{error:?}");
    assert!(entries.iter().all(|entry| entry.record == Record::Request(convert::request(&request(3)))));
}

#[test]
fn convert_keeps_names_and_full_lists() {
    let message = convert::state(&state(4), &names());
    assert_eq!(message.joint_position, state(4).joint_position[..3]);
    assert_eq!(message.foot_force, [0.0; 3], "zeros are kept: the list has its full length");
    assert_eq!(message.objects[0].name, "ball");
    assert_eq!((&*message.contacts[0].body, &*message.contacts[0].against), ("foot", "floor"));
    assert_eq!(message.contacts[1].against, "body 9");
    let read_back = hapfic_log::proto::State::decode(message.encode_to_vec().as_slice()).unwrap();
    assert_eq!(read_back, message);

    let before = Command { mode: Mode::Hold.code(), source: Source::None.code(), joints: 3, ..Command::default() };
    let message = convert::command(&before);
    assert_eq!((&*message.mode, &*message.source, &*message.controller), ("hold", "none", "none"));
    assert_eq!(message.torque_raw, [0.0; 3]);
    assert_eq!(message.converging, [false; 3]);
    assert_eq!(convert::command(&Command { mode: 99, ..before }).mode, "unknown");

    let mut broken = event(0, "abc");
    broken.text_len = 10_000;
    assert!(convert::event(&broken).text.starts_with("abc"));
    assert_eq!(convert::timing(&timing(0)).wake_lateness_ns, 250);
}

#[test]
fn reader_open_gives_metadata_and_attachments() {
    let bytes = log(1, &WriterOptions::default());
    let reader = Reader::new(bytes.as_slice(), Path::new("memory")).unwrap();
    assert_eq!(reader.metadata()["hapfic"], header()[0].1);
    assert_eq!(reader.names(), names());
    assert_eq!(reader.attachments(), attachments());
}

#[test]
fn log_times_begin_at_given_start() {
    let start_unix_ns = 1_760_000_000_000_000_000;
    assert_eq!(time_of(start_unix_ns, 5), start_unix_ns + 5_000_000);
    assert_eq!(time_of(start_unix_ns, -1), start_unix_ns - 1_000_000);
    assert_eq!(time_of(0, -1), 0);
    let (entries, _) = read(&log(2, &WriterOptions { start_unix_ns, ..WriterOptions::default() }));
    assert_eq!(entries.last().map(|entry| entry.log_time_ns), Some(start_unix_ns + 1_000_000));
}

#[test]
fn writer_same_messages_give_same_bytes() {
    let options = WriterOptions { chunk_bytes: 8 * 1024, ..WriterOptions::default() };
    assert_eq!(log(20, &options), log(20, &options));
}

#[test]
fn mcap_reader_finds_summary_index_and_messages() {
    let bytes = log(50, &WriterOptions { chunk_bytes: 8 * 1024, ..WriterOptions::default() });
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a summary");
    let stats = summary.stats.expect("statistics");
    assert_eq!(stats.message_count, 50 * MESSAGES_PER_TICK as u64);
    assert!(summary.chunk_indexes.len() > 2, "{} chunks", summary.chunk_indexes.len());
    assert_eq!(summary.channels.len(), Topic::COUNT);
    for topic in Topic::ALL {
        let channel = summary.channels.values().find(|channel| channel.topic == topic.name()).expect("the topic");
        let schema = channel.schema.as_ref().expect("its schema");
        assert_eq!((&*schema.name, &*schema.encoding), (topic.schema_name(), "protobuf"));
        assert_eq!(channel.message_encoding, "protobuf");
    }
    let messages = mcap::MessageStream::new(&bytes).unwrap().collect::<Result<Vec<_>, _>>().unwrap();
    let ours = read(&bytes).0;
    assert_eq!(messages.len(), ours.len());
    assert!(messages.iter().zip(&ours).all(|(theirs, ours)| theirs.channel.topic == *ours.topic));
}

#[test]
fn writer_totals_count_messages_and_bytes() {
    let mut bytes = Vec::new();
    let options = WriterOptions::default();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names(), &header(), &attachments(), &options).unwrap();
    for tick in 0..4 {
        write_tick(&mut writer, tick).unwrap();
    }
    writer.state(&state(4)).unwrap();
    assert_eq!((writer.messages(Topic::State), writer.messages(Topic::Log)), (5, 4));
    let message_bytes = writer.message_bytes();
    let totals = writer.finish().unwrap();
    assert_eq!((totals.messages(Topic::State), totals.messages(Topic::Log)), (5, 4));
    assert_eq!(totals.message_bytes, message_bytes);
    assert_eq!(totals.file_bytes, bytes.len() as u64);
}

#[test]
fn writer_killed_keeps_flushed_messages() {
    let path = path("flushed.mcap");
    let options = WriterOptions::default();
    let mut writer = Writer::create(&path, &names(), &header(), &attachments(), &options).unwrap();
    write_tick(&mut writer, 0).unwrap();
    writer.flush().unwrap();
    writer.flush().unwrap();
    write_tick(&mut writer, 1).unwrap();
    // A killed writer leaves the file as it is now.
    let left = std::fs::read(&path).unwrap();
    let (entries, error) = read(&left);
    assert_eq!(entries.len(), MESSAGES_PER_TICK);
    assert!(matches!(error, Some(LogError::Truncated { byte, .. }) if byte == left.len() as u64), "{error:?}");

    writer.finish().unwrap();
    let entries: Result<Vec<_>, _> = Reader::open(&path).unwrap().collect();
    assert_eq!(entries.unwrap().len(), 2 * MESSAGES_PER_TICK);
}

#[test]
fn writer_sync_stores_everything_and_continues() {
    let path = path("synced.mcap");
    let options = WriterOptions::default();
    let mut writer = Writer::create(&path, &names(), &header(), &attachments(), &options).unwrap();
    write_tick(&mut writer, 0).unwrap();
    writer.sync().unwrap();
    let (entries, _) = read(&std::fs::read(&path).unwrap());
    assert_eq!(entries.len(), MESSAGES_PER_TICK);
    write_tick(&mut writer, 1).unwrap();
    writer.finish().unwrap();
    let entries: Result<Vec<_>, _> = Reader::open(&path).unwrap().collect();
    assert_eq!(entries.unwrap().len(), 2 * MESSAGES_PER_TICK);
    // The finished file is no longer locked.
    drop(Writer::create(&path, &names(), &[], &[], &options).unwrap());
}

#[test]
fn writer_sync_of_pipe_succeeds() {
    let (mut output, input) = std::io::pipe().unwrap();
    let reader = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        output.read_to_end(&mut bytes).unwrap();
        bytes
    });
    let path = PathBuf::from(format!("/proc/self/fd/{}", input.as_raw_fd()));
    let mut writer = Writer::create(&path, &names(), &header(), &attachments(), &WriterOptions::default()).unwrap();
    write_tick(&mut writer, 0).unwrap();
    writer.sync().unwrap();
    writer.finish().unwrap();
    drop(input);
    let (entries, error) = read(&reader.join().unwrap());
    assert!(error.is_none() && entries.len() == MESSAGES_PER_TICK, "{error:?}");
}

#[test]
fn writer_dropped_leaves_complete_log() {
    let mut bytes = Vec::new();
    let options = WriterOptions::default();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names(), &[], &[], &options).unwrap();
    write_tick(&mut writer, 0).unwrap();
    drop(writer);
    let (entries, error) = read(&bytes);
    assert!(error.is_none(), "{error:?}");
    assert_eq!(entries.len(), MESSAGES_PER_TICK);
}

#[test]
fn writer_unwritable_path_fails_immediately_with_name() {
    let file = path("a-file");
    std::fs::write(&file, "not a folder").unwrap();
    let inside = file.join("run.mcap");
    let error = Writer::create(&inside, &names(), &[], &[], &WriterOptions::default()).unwrap_err();
    assert!(matches!(error, LogError::Create { .. }), "{error:?}");
    assert!(error.to_string().contains(&inside.display().to_string()), "{error}");
    let error = Reader::open(&inside).unwrap_err();
    assert!(matches!(error, LogError::Open { .. }), "{error:?}");
}

#[test]
fn writer_oversized_attachment_is_rejected() {
    let mut bytes = Vec::new();
    let large = Attachment { name: "large".into(), bytes: vec![0; Attachment::LARGEST + 1], ..Attachment::default() };
    let options = WriterOptions::default();
    let error = Writer::new(&mut bytes, Path::new("memory"), &names(), &[], &[large], &options).unwrap_err();
    assert!(error.to_string().contains("large has 33554433 bytes, expected at most 33554432"), "{error}");
}

#[test]
fn metrics_live_equal_those_from_log() {
    let mut bytes = Vec::new();
    let options = WriterOptions::default();
    let mut live = Metrics::new();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names(), &[], &[], &options).unwrap();
    live.push_operator(&writer.operator(&parameters(0)).unwrap());
    for tick in 0..800 {
        live.push_state(&writer.state(&state(tick)).unwrap());
        live.push_reference(&writer.reference(&reference(tick)).unwrap());
        live.push_command(&writer.command(&command(tick)).unwrap());
        live.push_timing(&writer.timing(&timing(tick), 0).unwrap());
    }
    writer.finish().unwrap();
    let mut later = Metrics::new();
    for entry in read(&bytes).0 {
        later.push(&entry.record);
    }
    assert_eq!(later.summary(), live.summary());
    assert_eq!(live.summary().ticks.last, Some(799));
}

#[test]
fn parts_are_found_in_their_order() {
    let folder = path("parts");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let at = |name: &str| folder.join(name);
    for name in ["run.mcap", "run.part2.mcap", "run.part10.mcap", "run.part3.mcap", "run.partial.mcap", "other.part2.mcap"] {
        std::fs::write(at(name), "").unwrap();
    }
    let names = ["run.mcap", "run.part2.mcap", "run.part3.mcap", "run.part10.mcap"].map(at);
    assert_eq!(hapfic_log::parts(&at("run.mcap")), names);
    assert_eq!(hapfic_log::parts(&at("run.part3.mcap")), [at("run.part3.mcap")]);
    assert_eq!(hapfic_log::parts(&at("run.partial.mcap")), [at("run.partial.mcap")]);
    assert_eq!(hapfic_log::part_path(&at("a.mcap"), 12), at("a.part12.mcap"));
}

#[test]
fn parts_begin_with_a_state_and_the_sets_in_force() {
    let folder = path("rolled");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let log = folder.join("run.mcap");
    let options = WriterOptions {
        chunk_bytes: 4096,
        in_parts: true,
        part_bytes: Some(60_000),
        keep_bytes: Some(200_000),
        ..WriterOptions::default()
    };
    let mut writer = Writer::create(&log, &names(), &header(), &attachments(), &options).unwrap();
    for tick in 0..500 {
        write_tick(&mut writer, tick).unwrap();
    }
    let totals = writer.finish().unwrap();
    assert_eq!(totals.messages(Topic::State), 500);
    let [written, removed] = totals.parts;
    let there = hapfic_log::parts(&log);
    assert_eq!(there.len() as u32, written - removed);
    assert!(removed > 0 && there[0] == log, "{there:?}");
    let size = |path: &PathBuf| std::fs::metadata(path).unwrap().len();
    assert!(there.iter().map(size).sum::<u64>() < 200_000 + 60_000);
    let mut before: Option<(i64, Vec<u64>)> = None;
    for part in &there {
        let reader = Reader::open(part).unwrap();
        assert_eq!((reader.names(), reader.attachments().len()), (names(), attachments().len()));
        let entries: Vec<_> = reader.map(|entry| entry.unwrap().record).collect();
        let sets = |entries: &[Record]| -> Vec<u64> {
            entries
                .iter()
                .filter_map(|record| if let Record::Operator(set) = record { Some(set.version) } else { None })
                .collect()
        };
        let state = entries.iter().position(|record| matches!(record, Record::State(_))).unwrap();
        let Record::State(first) = &entries[state] else { unreachable!() };
        if let Some((last, versions)) = &before
            && first.tick == last + 1
        {
            assert_eq!(sets(&entries[..state]), versions[versions.len() - 2..], "{}", part.display());
        }
        let last = entries.iter().rev().find_map(|record| if let Record::State(s) = record { Some(s.tick) } else { None });
        before = Some((last.unwrap(), sets(&entries)));
    }
    // A new log of this name leaves no part of the old one.
    Writer::create(&log, &names(), &header(), &attachments(), &options).unwrap().finish().unwrap();
    assert_eq!(hapfic_log::parts(&log), [log]);
}
