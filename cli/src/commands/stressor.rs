//! `hapfic stressor`: a process that keeps cores busy or fills a disk, for an injected fault. It ends with its
//! supervisor.

use crate::CommandOutcome;
use anyhow::{Context, Result, bail};
use std::io::Write;
use std::time::{Duration, Instant};

/// Stresses the machine: `hog MS` keeps a core busy, `fill FILE` writes until the disk is full.
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
        _ => bail!("expected `hog MS` or `fill FILE`, found {arguments:?}"),
    }
    Ok(CommandOutcome::Done)
}
