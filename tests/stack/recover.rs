//! `hapfic recover` on the log of a real run.

use crate::log_file::streams;
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
