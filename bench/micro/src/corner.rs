//! Namespace of a benchmark in shared memory.

use anyhow::{Context, Result};
use hapfic_ipc::Domain;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

/// Folder of shared memory.
const SHM: &str = "/dev/shm";
/// Prefix of all namespaces; process id and namespace number follow.
const NAME: &str = "hapficbench";

/// Namespaces that this process has opened.
static OPENED: AtomicU32 = AtomicU32::new(0);

/// A [`Domain`] of one benchmark; dropping it removes its files.
#[derive(Debug)]
pub struct BenchNamespace {
    domain: Domain,
    name: String,
}

impl BenchNamespace {
    /// Opens a namespace, and removes the namespaces of processes that no longer exist.
    ///
    /// # Errors
    /// If shared memory is not available.
    pub fn open() -> Result<Self> {
        remove(|name| owner_of(name).is_some_and(|pid| !Path::new(&format!("/proc/{pid}")).exists()));
        let name = format!("{NAME}{}x{}", std::process::id(), OPENED.fetch_add(1, Ordering::Relaxed));
        let root = Path::new(SHM).join(&name);
        fs::create_dir_all(&root).with_context(|| format!("cannot create {}", root.display()))?;
        let domain = Domain::new(&format!("{name}_"), &root.to_string_lossy())?;
        Ok(Self { domain, name })
    }

    /// Returns the domain.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for BenchNamespace {
    fn drop(&mut self) {
        remove(|name| name.strip_prefix(&self.name).is_some_and(|rest| rest.is_empty() || rest.starts_with('_')));
    }
}

/// Removes the entries of shared memory whose name matches.
fn remove(matches: impl Fn(&str) -> bool) {
    let Ok(entries) = fs::read_dir(SHM) else { return };
    for entry in entries.flatten() {
        if entry.file_name().to_str().is_some_and(&matches) {
            // Files and folders; another process may have removed the entry.
            let _ = fs::remove_file(entry.path()).or_else(|_| fs::remove_dir_all(entry.path()));
        }
    }
}

/// Returns the process that opened the namespace of an entry, if any.
fn owner_of(name: &str) -> Option<u32> {
    name.strip_prefix(NAME)?.split_once('x')?.0.parse().ok()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_ipc::{Bus, Wait, topic};
    use hapfic_messages::State;

    #[test]
    fn namespace_dropped_after_messages_leaves_nothing() {
        let namespace = BenchNamespace::open().unwrap();
        let (name, root) = (namespace.name.clone(), Path::new(SHM).join(&namespace.name));
        {
            let bus = Bus::open(namespace.domain(), "test").unwrap();
            let mut output = bus.output(&topic::STATE).unwrap();
            let mut input = bus.input(&topic::STATE, Wait::No).unwrap();
            output.preloan();
            output.send(&State { tick: 7, ..State::default() }).unwrap();
            assert_eq!(input.next().unwrap().unwrap().tick, 7);
        }
        assert!(root.exists());
        drop(namespace);
        let remaining =
            fs::read_dir(SHM).unwrap().flatten().filter(|e| e.file_name().to_string_lossy().starts_with(&name)).count();
        assert_eq!(remaining, 0);
    }

    #[test]
    fn open_remains_of_dead_processes_are_removed() {
        let dead = Path::new(SHM).join(format!("{NAME}4194305x0_left"));
        fs::write(&dead, "").unwrap();
        let first = BenchNamespace::open().unwrap();
        let second = BenchNamespace::open().unwrap();
        assert!(!dead.exists());
        drop(second);
        assert!(Path::new(SHM).join(&first.name).exists(), "dropping a namespace removed another one");
        assert_eq!(owner_of("hapficbench17x3_a.data"), Some(17));
        assert_eq!(owner_of("hapficbench17"), None);
    }
}
