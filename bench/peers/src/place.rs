//! Files of a chain: its sockets and shared memory in a folder in `/dev/shm`, named after the chain.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Parent of all folders.
const SHM: &str = "/dev/shm";
/// Prefix of all chains' names; process id of the driver and another number follow.
const CHAIN: &str = "hapfic-chain-";

/// Creates the folder of a chain unless it exists.
///
/// # Errors
/// If the folder cannot be created.
pub fn folder(chain: &str) -> io::Result<PathBuf> {
    let folder = Path::new(SHM).join(chain);
    fs::create_dir_all(&folder)?;
    Ok(folder)
}

/// Returns the path of the socket of a stage.
///
/// # Errors
/// If the folder cannot be created.
pub fn socket(chain: &str, stage: usize) -> io::Result<PathBuf> {
    Ok(folder(chain)?.join(format!("{stage}.sock")))
}

/// Removes the files of this process's chains, and those of ended processes.
pub fn clean_up() {
    let Ok(entries) = fs::read_dir(SHM) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        if name.to_str().and_then(driver_of).is_some_and(|pid| pid == std::process::id() || !is_alive(pid)) {
            // Another process may have removed the entry.
            let _ = fs::remove_file(entry.path()).or_else(|_| fs::remove_dir_all(entry.path()));
        }
    }
}

/// Returns the process id of the driver whose chain made an entry, if any.
fn driver_of(name: &str) -> Option<u32> {
    name.strip_prefix(CHAIN)?.split('-').next()?.parse().ok()
}

fn is_alive(pid: u32) -> bool {
    Path::new(&format!("/proc/{pid}")).exists()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn clean_up_removes_own_and_dead_chains_only() {
        let own = format!("{CHAIN}{}-7", std::process::id());
        let other = format!("{CHAIN}1-7");
        let dead = format!("{CHAIN}4194305-7");
        let folders: Vec<_> = [&own, &other, &dead].map(|name| folder(name).unwrap()).into();
        fs::write(folders[0].join("0.sock"), "").unwrap();
        fs::write(Path::new(SHM).join(format!("{own}_something.shm")), "").unwrap();
        clean_up();
        assert_eq!(folders.iter().map(|f| f.exists()).collect::<Vec<_>>(), [false, true, false]);
        assert!(!Path::new(SHM).join(format!("{own}_something.shm")).exists());
        fs::remove_dir(&folders[1]).unwrap();
        assert_eq!(driver_of("something-else"), None);
    }
}
