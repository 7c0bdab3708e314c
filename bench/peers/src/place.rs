//! Where a chain's sockets and shared memory are: a folder of its own in `/dev/shm`, named after the chain.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The parent of all such folders.
const SHM: &str = "/dev/shm";
/// What the names of chains begin with; the number of the driver's process and another number follow.
const CHAIN: &str = "hapfic-chain-";

/// Makes a chain's folder, if it is not there yet.
///
/// # Errors
/// If it cannot be made.
pub fn folder(chain: &str) -> io::Result<PathBuf> {
    let folder = Path::new(SHM).join(chain);
    fs::create_dir_all(&folder)?;
    Ok(folder)
}

/// The path of a socket at a place of a chain.
///
/// # Errors
/// If its folder cannot be made.
pub fn socket(chain: &str, place: usize) -> io::Result<PathBuf> {
    Ok(folder(chain)?.join(format!("{place}.sock")))
}

/// Removes what this process's chains and those of processes that have ended have left.
pub fn clean_up() {
    let Ok(entries) = fs::read_dir(SHM) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        if name.to_str().and_then(driver_of).is_some_and(|pid| pid == std::process::id() || !is_alive(pid)) {
            // Somebody else may have removed it meanwhile.
            let _ = fs::remove_file(entry.path()).or_else(|_| fs::remove_dir_all(entry.path()));
        }
    }
}

/// The process of a chain's driver, if it is the name of something a chain has made.
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
    fn what_is_left_of_the_dead_and_of_this_process_goes_and_the_rest_stays() {
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
