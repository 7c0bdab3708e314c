//! A corner of shared memory for a benchmark alone, which is gone afterwards.

use anyhow::{Context, Result};
use hapfic_ipc::Domain;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

/// Where shared memory is.
const SHM: &str = "/dev/shm";
/// What the names of all corners begin with; the numbers of the process and of the corner follow.
const NAME: &str = "hapficbench";

/// Corners that this process has had.
static MADE: AtomicU32 = AtomicU32::new(0);

/// A domain of its own.
#[derive(Debug)]
pub struct Corner {
    domain: Domain,
    name: String,
}

impl Corner {
    /// Makes one, and removes those of processes that have not lived to do it themselves.
    ///
    /// # Errors
    /// If there is no shared memory to be had.
    pub fn open() -> Result<Self> {
        remove(|name| maker_of(name).is_some_and(|pid| !Path::new(&format!("/proc/{pid}")).exists()));
        let name = format!("{NAME}{}x{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
        let root = Path::new(SHM).join(&name);
        fs::create_dir_all(&root).with_context(|| format!("cannot make {}", root.display()))?;
        let domain = Domain::new(&format!("{name}_"), &root.to_string_lossy())?;
        Ok(Self { domain, name })
    }

    /// The domain.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for Corner {
    fn drop(&mut self) {
        remove(|name| name.strip_prefix(&self.name).is_some_and(|rest| rest.is_empty() || rest.starts_with('_')));
    }
}

/// Removes what is in shared memory by some names.
fn remove(which: impl Fn(&str) -> bool) {
    let Ok(entries) = fs::read_dir(SHM) else { return };
    for entry in entries.flatten() {
        if entry.file_name().to_str().is_some_and(&which) {
            // Files and folders; one that somebody else has removed meanwhile is no loss.
            let _ = fs::remove_file(entry.path()).or_else(|_| fs::remove_dir_all(entry.path()));
        }
    }
}

/// The process that has made what has a name, if it is part of a corner.
fn maker_of(name: &str) -> Option<u32> {
    name.strip_prefix(NAME)?.split_once('x')?.0.parse().ok()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_ipc::{Bus, Wait, topic};
    use hapfic_messages::State;

    #[test]
    fn what_is_sent_arrives_and_nothing_is_left() {
        let corner = Corner::open().unwrap();
        let (name, root) = (corner.name.clone(), Path::new(SHM).join(&corner.name));
        {
            let bus = Bus::open(corner.domain(), "test").unwrap();
            let mut output = bus.output(&topic::STATE).unwrap();
            let mut input = bus.input(&topic::STATE, Wait::No).unwrap();
            output.preloan();
            output.send(&State { tick: 7, ..State::default() }).unwrap();
            assert_eq!(input.next().unwrap().unwrap().tick, 7);
        }
        assert!(root.exists());
        drop(corner);
        let left = fs::read_dir(SHM).unwrap().flatten().filter(|e| e.file_name().to_string_lossy().starts_with(&name)).count();
        assert_eq!(left, 0);
    }

    #[test]
    fn what_the_dead_have_left_goes_with_the_next_corner() {
        let dead = Path::new(SHM).join(format!("{NAME}4194305x0_left"));
        fs::write(&dead, "").unwrap();
        let first = Corner::open().unwrap();
        let second = Corner::open().unwrap();
        assert!(!dead.exists());
        drop(second);
        assert!(Path::new(SHM).join(&first.name).exists(), "a corner takes another's away");
        assert_eq!(maker_of("hapficbench17x3_a.data"), Some(17));
        assert_eq!(maker_of("hapficbench17"), None);
    }
}
