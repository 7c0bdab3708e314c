//! Target `runfile`: run files, JSON that the supervisor writes and its children read.

use super::SCENARIO_WORDS;
use crate::fuzz::target::{FuzzOutcome, FuzzTarget};
use hapfic_config::Settings;
use hapfic_ipc::{Domain, RunFile};
use hapfic_messages::{Clock, RealtimeMode};
use std::fs;
use std::path::Path;

pub(super) const TARGET: FuzzTarget =
    FuzzTarget { name: "runfile", seeds, dictionary: SCENARIO_WORDS, text: true, max_bytes: 64 * 1024, execute };

fn seeds() -> Vec<Vec<u8>> {
    let settings = Settings::load("floor", &[]).expect("an embedded scenario");
    let run = |clock, realtime, core| RunFile {
        prefix: "hf1a_".to_owned(),
        root: "/dev/shm/hf1a".to_owned(),
        scenario: "floor".to_owned(),
        log: "/tmp/run.mcap".into(),
        log_name: "run.mcap".into(),
        start_unix_ns: if clock == Clock::Realtime { 1_760_000_000_000_000_000 } else { 0 },
        launcher_pid: 4711,
        launched_ns: 0,
        clock,
        realtime,
        core,
        standby_core: core,
        gate_core: Some(1),
        gate_busy_polls: true,
        spare_core: core,
        start_pose: [[0.1, 0.0, -0.5], [0.0, 0.5, 0.0]],
        settings: settings.effective_toml(),
        urdf_name: settings.robot.urdf.name.clone(),
        urdf: settings.robot.urdf.text.clone(),
    };
    let runs = [run(Clock::Lockstep, RealtimeMode::Off, None), run(Clock::Realtime, RealtimeMode::Auto, Some(1))];
    runs.iter().map(|run| serde_json::to_vec_pretty(run).expect("a run file is JSON")).collect()
}

fn execute(input: &[u8], scratch: &Path) -> FuzzOutcome {
    let path = scratch.join("run.json");
    fs::write(&path, input).expect("scratch can be written");
    let run = match RunFile::read(&path) {
        Ok(run) => run,
        // The path does not depend on the input.
        Err(error) => return FuzzOutcome::Rejected(error.to_string().replace(&path.display().to_string(), "run.json")),
    };
    run.write(&path).expect("scratch can be written");
    assert_eq!(RunFile::read(&path).expect("what was written"), run, "a run file that was written again has changed");
    if let Err(error) = Domain::new(&run.prefix, &run.root) {
        return FuzzOutcome::Rejected(error.to_string());
    }
    match Settings::from_effective(&run.settings, &run.urdf_name, &run.urdf) {
        Ok(_) => FuzzOutcome::Accepted,
        Err(error) => FuzzOutcome::Rejected(error.to_string()),
    }
}
