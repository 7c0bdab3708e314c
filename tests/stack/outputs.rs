//! Outputs replace nothing foreign, and a run that cannot last is rejected before it starts.

use hapfic_tests::{FinishedProgram, StackSandbox};
use std::process::Command;

const SHORT: [&str; 6] = ["run", "floor", "--clock", "lockstep", "--duration", "0.05"];

#[test]
fn output_of_other_kind_is_kept() {
    let stack = StackSandbox::new();
    std::fs::write(stack.path("precious"), "precious").unwrap();
    stack.run(&[&SHORT[..], &["--log", "own.mcap"]].concat()).expect(0);
    let cases: [&[&str]; 7] = [
        &["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "precious"],
        &["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "a.mcap", "--summary-json", "precious"],
        &["simulate", "floor", "--duration", "0.05", "--csv", "precious"],
        &["simulate", "floor", "--duration", "0.05", "--log", "precious"],
        &["report", "own.mcap", "--html", "precious"],
        &["report", "own.mcap", "--json", "precious"],
        &["bench", "latency", "--json", "precious"],
    ];
    for case in cases {
        let end = stack.run(case);
        end.expect(2);
        assert!(end.err.contains("precious") && end.err.contains("--force"), "{case:?}: {}", end.err);
        assert_eq!(std::fs::read(stack.path("precious")).unwrap(), b"precious", "{case:?}");
        assert!(!stack.path("a.mcap").exists(), "{case:?}");
    }
    stack.run(&[&SHORT[..], &["--log", "precious", "--force"]].concat()).expect(0);
    // Every output may replace one of its own kind.
    for _ in 0..2 {
        stack.run(&[&SHORT[..], &["--log", "own.mcap", "--summary-json", "own.json"]].concat()).expect(0);
        stack.run(&["simulate", "floor", "--duration", "0.05", "--csv", "own.csv", "--log", "simulated.mcap"]).expect(0);
        stack.run(&["report", "own.mcap", "--html", "own.html", "--json", "report.json", "--png", "pictures"]).expect(0);
    }
}

#[test]
fn output_on_input_is_rejected() {
    let stack = StackSandbox::new();
    let scenario = stack.run(&["scenarios", "floor"]).expect(0).out.clone();
    std::fs::write(stack.path("m.toml"), &scenario).unwrap();
    for command in ["run", "simulate"] {
        let end = stack.run(&[command, "m.toml", "--duration", "0.05", "--log", "m.toml", "--force"]);
        end.expect(2);
        assert!(end.err.contains("--log m.toml: found the input file itself"), "{}", end.err);
    }
    assert_eq!(std::fs::read_to_string(stack.path("m.toml")).unwrap(), scenario);
    let end = stack.run(&[&SHORT[..], &["--log", "."]].concat());
    end.expect(2);
    assert!(end.err.contains("--log .: found a folder"), "{}", end.err);
}

#[test]
fn full_standard_output_is_failure() {
    let stack = StackSandbox::new();
    let full = || std::fs::File::options().write(true).open("/dev/full").unwrap();
    let arguments: [&[&str]; 3] = [
        &["scenarios"],
        &["simulate", "floor", "--duration", "0.05"],
        &["run", "floor", "--clock", "lockstep", "--duration", "0.05"],
    ];
    for words in arguments {
        let end = stack.command(words).stdout(full()).output().unwrap();
        let error = String::from_utf8_lossy(&end.stderr);
        assert_eq!(end.status.code(), Some(3), "{words:?}: {error}");
        assert!(error.contains("cannot write to standard output"), "{words:?}: {error}");
    }
}

#[test]
fn pipe_without_reader_is_rejected() {
    let stack = StackSandbox::new();
    rustix::fs::mkfifoat(rustix::fs::CWD, stack.path("pipe"), rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
    let end = stack.run(&[&SHORT[..], &["--log", "pipe"]].concat());
    end.expect(2);
    assert!(end.err.contains("pipe") && end.err.contains("reading"), "{}", end.err);
    assert_eq!(stack.registrations(), 0);
}

/// Runs the program in a shell with a limit.
fn limited(stack: &StackSandbox, limit: &str) -> FinishedProgram {
    let own = stack.command(&[&SHORT[..], &["--log", "run.mcap"]].concat());
    let mut words = vec![own.get_program().to_str().unwrap().to_owned()];
    words.extend(own.get_args().map(|word| word.to_str().unwrap().to_owned()));
    let output = Command::new("sh")
        .args(["-c", &format!("{limit} && exec \"$@\""), "sh"])
        .args(words)
        .current_dir(stack.path("."))
        .env("XDG_RUNTIME_DIR", stack.path("."))
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    FinishedProgram { launcher: 0, code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
}

#[test]
fn small_limit_is_rejected_with_needed_number() {
    let stack = StackSandbox::new();
    for (limit, texts) in [
        ("ulimit -n 64", ["RLIMIT_NOFILE: found 64", "expected at least 512"]),
        ("ulimit -f 100", ["RLIMIT_FSIZE: found 0.1 MB", "expected at least 1.6 MB"]),
    ] {
        let end = limited(&stack, limit);
        assert_eq!(end.code, Some(2), "{limit}: {}\n{}", end.out, end.err);
        assert!(texts.iter().all(|text| end.err.contains(text)), "{limit}: {}", end.err);
        assert_eq!((stack.registrations(), stack.path("run.mcap").exists()), (0, false), "{limit}");
    }
}

#[test]
fn default_log_names_differ() {
    let stack = StackSandbox::new();
    for _ in 0..3 {
        stack.run(&SHORT).expect(0);
    }
    assert_eq!(std::fs::read_dir(stack.path("logs")).unwrap().count(), 3);
}
