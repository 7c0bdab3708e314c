//! The script of docs/reading-a-log-in-python.md plots a log of this build.

use hapfic_tests::StackSandbox;
use std::process::Command;

#[test]
fn python_page_script_plots_log() {
    let page = include_str!("../../docs/reading-a-log-in-python.md");
    let script = page.split_once("```python\n").and_then(|(_, rest)| rest.split_once("```")).map(|(script, _)| script).unwrap();
    assert!(script.lines().count() <= 20);
    let can = Command::new("python3").args(["-c", "import mcap_protobuf.reader, matplotlib"]).output();
    if !can.is_ok_and(|output| output.status.success()) {
        assert!(std::env::var_os("HAPFIC_NEEDS_PYTHON").is_none(), "python3 lacks mcap-protobuf-support or matplotlib");
        eprintln!("skipped: python3 with mcap-protobuf-support and matplotlib is missing");
        return;
    }
    let stack = StackSandbox::new();
    stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "1.5", "--log", "floor.mcap"]).expect(0);
    let output = Command::new("python3")
        .args(["-c", script, "floor.mcap"])
        .env("MPLBACKEND", "Agg")
        .env("MPLCONFIGDIR", stack.path("matplotlib"))
        .current_dir(stack.path("."))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = std::fs::read(stack.path("force.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 5_000, "{} bytes", picture.len());
}
