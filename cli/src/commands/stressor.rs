//! `hapfic stressor`: a process that keeps cores busy, fills a disk or halts its supervisor, for an injected fault. It ends
//! with its supervisor.

use crate::CommandOutcome;
use anyhow::{Context, Result, bail};
use rustix::process::{Pid, Signal, kill_process};
use std::io::Write;
use std::time::{Duration, Instant};

/// Stresses the machine: `hog MS` keeps a core busy, `fill FILE` writes until the disk is full, `halt MS` halts the supervisor.
pub fn stressor(supervisor: i32, arguments: &[String]) -> Result<CommandOutcome> {
    hapfic_ipc::tie_to_parent(supervisor).context("cannot join the run")?;
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["hog", ms] => {
            let end = Instant::now() + Duration::from_millis(ms.parse().context("hog: expected milliseconds")?);
            let mut x = 1_u64;
            while Instant::now() < end {
                for _ in 0..10_000 {
                    x = std::hint::black_box(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
                }
            }
        }
        ["fill", path] => {
            let mut file = std::fs::File::create_new(path).with_context(|| format!("cannot make {path}"))?;
            let block = vec![0_u8; 1 << 16];
            // Until neither a block nor a smaller piece fits.
            while file.write_all(&block).is_ok() {}
            while file.write_all(&[0; 64]).is_ok() {}
        }
        ["halt", ms] => {
            let length = Duration::from_millis(ms.parse().context("halt: expected milliseconds")?);
            let supervisor = Pid::from_raw(supervisor).context("halt: expected a process id")?;
            kill_process(supervisor, Signal::STOP)?;
            std::thread::sleep(length);
            kill_process(supervisor, Signal::CONT)?;
        }
        _ => bail!("expected `hog MS`, `fill FILE` or `halt MS`, found {arguments:?}"),
    }
    Ok(CommandOutcome::Done)
}
