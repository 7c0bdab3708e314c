//! `hapfic recover` on the log of a real run.

use crate::log_file::{part_streams, streams};
use hapfic_tests::StackSandbox;

#[test]
fn recover_truncated_log_recovered() {
    let stack = StackSandbox::new();
    stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "1", "--log", "run.mcap"]).expect(0);
    let end = stack.run(&["recover", "run.mcap"]);
    assert!(end.expect(0).out.contains("whole"), "{}", end.out);
    assert!(!stack.path("run.recovered.mcap").exists());

    let bytes = std::fs::read(stack.path("run.mcap")).unwrap();
    let cut = &bytes[..bytes.len() / 2];
    std::fs::write(stack.path("cut.mcap"), cut).unwrap();
    let end = stack.run(&["recover", "cut.mcap"]);
    assert!(end.expect(0).out.contains("recovered to cut.recovered.mcap"), "{}", end.out);
    assert_eq!(std::fs::read(stack.path("cut.mcap")).unwrap(), cut);
    let (whole, kept) = (streams(&stack.path("run.mcap")), streams(&stack.path("cut.recovered.mcap")));
    assert!(kept["/state"].len() > 100, "{} states", kept["/state"].len());
    for (topic, messages) in &kept {
        assert!(whole[topic].starts_with(messages), "{topic}: the recovered messages differ");
    }

    let end = stack.run(&["recover", "cut.mcap"]);
    assert!(end.expect(2).err.contains("exists already"), "{}", end.err);
    let end = stack.run(&["recover", "cut.mcap", "--output", "other.mcap"]);
    end.expect(0);
    assert_eq!(streams(&stack.path("other.mcap")), kept);
    let end = stack.run(&["recover", "cut.mcap", "--output", "cut.mcap"]);
    assert!(end.expect(2).err.contains("the output is the log itself"), "{}", end.err);
}

#[test]
fn recover_other_file_rejected() {
    let stack = StackSandbox::new();
    std::fs::write(stack.path("notes.mcap"), "not a log at all").unwrap();
    let end = stack.run(&["recover", "notes.mcap"]);
    assert!(end.expect(2).err.contains("not a log"), "{}", end.err);
    assert!(stack.run(&["recover", "missing.mcap"]).expect(2).err.contains("missing.mcap"));
    let files: Vec<_> = std::fs::read_dir(stack.path(".")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(files, ["notes.mcap"]);
}

/// A log in parts: every part is whole, and report, timeline and recover take them together.
#[test]
fn log_in_parts_is_read_as_one() {
    let stack = StackSandbox::new();
    let run = |log: &str, more: &[&str]| {
        let words = ["run", "floor", "--clock", "lockstep", "--duration", "6", "--log", log];
        stack.run(&[words.as_slice(), more].concat())
    };
    run("one.mcap", &[]).expect(0);
    let end = run("run.mcap", &["--set", "recorder.part_mb=1", "--set", "recorder.chunk_kib=64"]);
    end.expect(0);
    let parts = hapfic_log::parts(&stack.path("run.mcap"));
    assert!(parts.len() > 3, "{parts:?}");
    assert!(end.out.contains(&format!(" in {} parts, 0 ticks lost", parts.len())), "{}", end.out);
    let whole = streams(&stack.path("one.mcap"));
    let mut joined = part_streams(&parts[0]);
    for part in &parts[1..] {
        for (topic, messages) in part_streams(part) {
            // Each part repeats the parameter sets that may be in force.
            let new = messages.into_iter().skip(if topic == "/operator" { 2 } else { 0 });
            joined.entry(topic).or_default().extend(new);
        }
    }
    for topic in ["/state", "/command", "/reference", "/request", "/operator"] {
        assert_eq!(joined[topic].len(), whole[topic].len(), "{topic}");
        assert!(joined[topic] == whole[topic], "{topic} differs");
    }

    let entries = |log: &str| {
        let end = stack.run(&["timeline", log]);
        end.expect(0).out.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(entries("run.mcap"), entries("one.mcap"));
    let ticks = |log: &str| {
        let json = format!("{log}.json");
        stack.run(&["report", log, "--json", &json]).expect(0);
        let report: serde_json::Value = serde_json::from_slice(&std::fs::read(stack.path(&json)).unwrap()).unwrap();
        (report["metrics"]["ticks"].clone(), report["metrics"]["force"].clone(), report["run"]["cut_off"].clone())
    };
    assert_eq!(ticks("run.mcap"), ticks("one.mcap"));

    // A part cut in the middle: the others are whole, the copy keeps what is before the cut.
    let bytes = std::fs::read(&parts[1]).unwrap();
    std::fs::write(&parts[1], &bytes[..bytes.len() / 2]).unwrap();
    let (found, _, cut_off) = ticks("run.mcap");
    assert!(cut_off.as_str().unwrap().contains("part2"), "{cut_off}");
    let missing = found["lost"].as_u64().unwrap();
    assert!((200..2000).contains(&missing), "{found}");
    let end = stack.run(&["recover", "run.mcap"]);
    assert_eq!(end.expect(0).out.matches("whole, no copy was made").count(), parts.len() - 1, "{}", end.out);
    assert!(stack.path("run.part2.recovered.mcap").exists(), "{}", end.out);
    let end = stack.run(&["recover", "run.mcap", "--output", "all.mcap"]);
    assert!(end.expect(2).err.contains(&format!("found {} parts for the one output", parts.len())), "{}", end.err);

    // A limit removes the oldest but the first; a new run of the same name leaves no part of the old one.
    let limit = ["recorder.part_mb=1", "recorder.chunk_kib=64", "recorder.keep_mb=4"].map(|set| ["--set", set]).concat();
    let end = run("run.mcap", &limit);
    end.expect(0);
    let kept = hapfic_log::parts(&stack.path("run.mcap"));
    assert!((3..parts.len()).contains(&kept.len()) && kept[0] == parts[0] && kept.last() == parts.last(), "{kept:?}");
    let removed = format!("{} parts, {} of them removed", parts.len(), parts.len() - kept.len());
    assert!(end.out.contains(&removed), "{}", end.out);
    let (_, _, cut_off) = ticks("run.mcap");
    assert!(cut_off.as_str().unwrap().contains("missing: removed by recorder.keep_mb"), "{cut_off}");

    // A part of another run is left out, and whatever is no log is not replaced.
    std::fs::copy(stack.path("one.mcap"), stack.path("run.part2.mcap")).unwrap();
    let (_, _, cut_off) = ticks("run.mcap");
    assert!(cut_off.as_str().unwrap().contains("run.part2.mcap: found another run"), "{cut_off}");
    std::fs::write(stack.path("run.part3.mcap"), "precious").unwrap();
    let before = std::fs::read(stack.path("run.mcap")).unwrap();
    let end = run("run.mcap", &limit);
    assert!(end.expect(2).err.contains("run.part3.mcap") && end.err.contains("is no log"), "{}", end.err);
    assert_eq!(std::fs::read_to_string(stack.path("run.part3.mcap")).unwrap(), "precious");
    assert!(std::fs::read(stack.path("run.mcap")).unwrap() == before && stack.path("run.part2.mcap").exists());
}
