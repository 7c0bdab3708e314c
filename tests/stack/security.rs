//! Access to a run: its files on the machine, the rights of another user, and those of the same user.

use crate::running::{start, status_at};
use hapfic_tests::{StackSandbox, StartedProgram, hapfic, is_running};
use rustix::process::{Gid, Pid, Signal, Uid, geteuid, kill_process};
use rustix::thread::{set_thread_gid, set_thread_groups, set_thread_uid};
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, chown};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// User and group without any files.
const OTHER_USER: u32 = 65_534;
/// Processes that a run starts.
const PROCESSES: [&str; 4] = ["plant", "planner", "controller", "standby"];

fn set(stack: &StackSandbox, change: &str) {
    let end = stack.run(&["set", change]);
    assert_eq!(end.code, Some(0), "{}\n{}", end.out, end.err);
}

fn stop(stack: &StackSandbox, run: StartedProgram) {
    let end = stack.run(&["stop"]);
    assert_eq!(end.code, Some(0), "{}\n{}", end.out, end.err);
    let run = run.finish();
    run.expect(3);
    assert!(run.out.contains("asked to end by the operator"), "{}", run.out);
    assert_eq!(stack.registrations(), 0);
}

/// Registration and name of the only run of a sandbox.
fn registered(stack: &StackSandbox) -> (PathBuf, String) {
    let mut all = fs::read_dir(stack.path("hapfic")).unwrap().map(|entry| entry.unwrap().path());
    let file = all.next().expect("a registration");
    assert_eq!(all.next(), None, "one run");
    let run = file.file_stem().unwrap().to_str().unwrap().to_owned();
    (file, run)
}

/// Entries of a run in `/dev/shm` itself: its segments and its folder.
fn shm_entries(run: &str) -> Vec<PathBuf> {
    let mark = format!("{run}_");
    let found: Vec<PathBuf> = fs::read_dir("/dev/shm")
        .unwrap()
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.file_name().to_str().is_some_and(|name| name == run || name.starts_with(&mark)))
        .map(|entry| entry.path())
        .collect();
    assert!(found.len() > 20, "found {found:?}, expected more than 20 entries of a run");
    found
}

/// Everything below a folder, without entries that vanish meanwhile.
fn below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                folders.push(path.clone());
            }
            found.push(path);
        }
    }
    found
}

/// Calls a function in a thread of another user without supplementary groups. `None` if this user cannot switch users.
fn as_another_user<T: Send>(act: impl FnOnce() -> T + Send) -> Option<T> {
    if !geteuid().is_root() {
        std::io::stderr().write_all(b"skipped: only root can become another user\n").unwrap();
        return None;
    }
    std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            // The kernel sets them for this thread alone, without a way back.
            set_thread_groups(&[]).unwrap();
            set_thread_gid(Gid::from_raw(OTHER_USER)).unwrap();
            set_thread_uid(Uid::from_raw(OTHER_USER)).unwrap();
            act()
        });
        Some(thread.join().unwrap())
    })
}

/// File mode creation mask of this process.
fn umask() -> u32 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("Umask:")).expect("Linux 4.7 or newer");
    u32::from_str_radix(line.trim(), 8).unwrap()
}

#[test]
fn run_files_owner_only() {
    let stack = StackSandbox::new();
    let mut run = start(&stack, "run", "lockstep");
    let _ = run.children(&PROCESSES);
    status_at(&stack, 10);
    let (registration, name) = registered(&stack);
    for path in shm_entries(&name).iter().chain([&stack.path("hapfic"), &registration]) {
        // The connection of a command vanishes with it.
        let Ok(meta) = fs::symlink_metadata(path) else { continue };
        assert_eq!(meta.uid(), geteuid().as_raw(), "{path:?}");
        assert_eq!(meta.mode() & 0o077, 0, "{path:?} has mode {:o}", meta.mode());
    }
    // No other user passes the folder; its content belongs to its user, and no other user could write it.
    let folder = Path::new("/dev/shm").join(&name);
    let inside = below(&folder);
    assert!(inside.len() > 50, "{inside:?}");
    for path in inside {
        let Ok(meta) = fs::symlink_metadata(&path) else { continue };
        assert_eq!(meta.uid(), geteuid().as_raw(), "{path:?}");
        assert_eq!(meta.mode() & 0o022, 0, "{path:?} has mode {:o}", meta.mode());
        assert!(!meta.file_type().is_socket(), "found the socket {path:?}, expected none");
    }
    // The doorbells are in a page of their own.
    assert_eq!(fs::metadata(folder.join("doorbells")).unwrap().mode() & 0o777, 0o600);
    // The log belongs to its user, with the mode that the umask gives any file.
    let log = fs::metadata(stack.path("run.mcap")).unwrap();
    assert_eq!((log.uid(), log.mode() & 0o777), (geteuid().as_raw(), 0o666 & !umask()));
    stop(&stack, run);
}

/// Lists successful accesses of another user to a path.
fn breaches(path: &Path) -> Vec<String> {
    let denied = |what: &str, error: Option<std::io::Error>| match error {
        Some(e) if matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::NotFound) => None,
        // The kernel checks the file type before the permission.
        Some(e) if matches!(e.kind(), ErrorKind::IsADirectory | ErrorKind::NotADirectory) => None,
        // The path is too long for a socket.
        Some(e) if e.kind() == ErrorKind::InvalidInput => None,
        Some(e) => Some(format!("{what} {}: {e}", path.display())),
        None => Some(format!("{what} {}: succeeded", path.display())),
    };
    let socket = UnixDatagram::unbound().unwrap();
    [
        denied("read", File::open(path).err()),
        denied("write", OpenOptions::new().write(true).open(path).err()),
        denied("list", fs::read_dir(path).err()),
        denied("connect to", socket.connect(path).err()),
    ]
    .into_iter()
    .flatten()
    .collect()
}

#[test]
fn other_user_open_remove_kill_denied() {
    let stack = StackSandbox::new();
    let mut run = start(&stack, "run", "lockstep");
    let children = run.children(&PROCESSES);
    status_at(&stack, 10);
    let (registration, name) = registered(&stack);
    let entries = shm_entries(&name);
    let folder = Path::new("/dev/shm").join(&name);
    let pids: Vec<u32> = children.iter().map(|(_, pid)| *pid).chain([run.pid()]).collect();
    let mut closed: Vec<PathBuf> = entries.clone();
    closed.extend(below(&folder));
    // Without the log, whose mode is that of the umask.
    closed.extend([folder, registration, stack.path("hapfic")]);
    for pid in &pids {
        closed.extend(["mem", "environ", "fd"].map(|what| PathBuf::from(format!("/proc/{pid}/{what}"))));
    }
    let found = as_another_user(|| {
        let mut found: Vec<String> = closed.iter().flat_map(|path| breaches(path)).collect();
        for path in &entries {
            match fs::remove_file(path) {
                Err(e) if matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::NotFound | ErrorKind::IsADirectory) => {}
                other => found.push(format!("remove {}: {other:?}", path.display())),
            }
        }
        for pid in &pids {
            for signal in [Signal::TERM, Signal::KILL, Signal::STOP] {
                match kill_process(Pid::from_raw(*pid as i32).unwrap(), signal) {
                    Err(rustix::io::Errno::PERM) => {}
                    other => found.push(format!("{signal:?} to {pid}: {other:?}")),
                }
            }
        }
        found
    });
    assert_eq!(found.unwrap_or_default(), Vec::<String>::new());
    stop(&stack, run);
}

#[test]
fn other_user_commands_rejected() {
    let stack = StackSandbox::new();
    let run = start(&stack, "run", "lockstep");
    let before = status_at(&stack, 10);
    let (_, name) = registered(&stack);
    // A program and a folder that the other user may access.
    let shared = TempDir::new().unwrap();
    fs::set_permissions(shared.path(), Permissions::from_mode(0o755)).unwrap();
    let program = shared.path().join("hapfic");
    // Copied by another process: children of parallel tests could inherit a file that this process has open for
    // writing, and the kernel does not execute such a file.
    assert!(Command::new("cp").arg(hapfic()).arg(&program).status().unwrap().success());
    fs::set_permissions(&program, Permissions::from_mode(0o755)).unwrap();
    let own = shared.path().join("own");
    fs::create_dir(&own).unwrap();
    let owners = stack.path("");
    let rejected = |arguments: &[&str], runtime: Option<&Path>, run_file: Option<&str>| -> Option<String> {
        let mut command = Command::new(&program);
        command.args(arguments).current_dir("/").stdin(Stdio::null()).env_remove("XDG_RUNTIME_DIR").env_remove("HAPFIC_RUN");
        command.envs(runtime.map(|folder| ("XDG_RUNTIME_DIR", folder))).envs(run_file.map(|file| ("HAPFIC_RUN", file)));
        let end = command.output().unwrap();
        let err = String::from_utf8_lossy(&end.stderr).into_owned();
        let clear = err.starts_with("hapfic: ")
            && err.lines().count() == 1
            && ["no stack is running", "where runs are registered", "belongs to user", "Permission denied"]
                .iter()
                .any(|words| err.contains(words));
        let valid = end.status.code() == Some(2) && end.stdout.is_empty() && clear;
        (!valid).then(|| format!("{arguments:?} with {runtime:?}: {:?}\n{err}", end.status))
    };
    let all = || {
        let mut found = Vec::new();
        for runtime in [None, Some(own.as_path()), Some(owners.as_path())] {
            for words in [&["status", "--json"][..], &["set", "taper=0.1"], &["stop"]] {
                found.extend(rejected(words, runtime, None));
                let named = [&words[..1], &["--run", name.as_str()], &words[1..]].concat();
                found.extend(rejected(&named, runtime, None));
            }
        }
        let log = own.join("run.mcap");
        let words = ["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", log.to_str().unwrap()];
        found.extend(rejected(&words, Some(owners.as_path()), None));
        let file = format!("/dev/shm/{name}/run.json");
        found.extend(rejected(&["process", "planner"], Some(own.as_path()), Some(file.as_str())));
        found
    };
    if geteuid().is_root() {
        chown(&own, Some(OTHER_USER), Some(OTHER_USER)).unwrap();
    }
    assert_eq!(as_another_user(all).unwrap_or_default(), Vec::<String>::new());
    // The same if the other user can read the folder of registrations.
    fs::set_permissions(&owners, Permissions::from_mode(0o755)).unwrap();
    assert_eq!(as_another_user(all).unwrap_or_default(), Vec::<String>::new());
    let after = status_at(&stack, before["tick"].as_i64().unwrap() + 1);
    for field in ["announced_version", "rejected_requests"] {
        assert_eq!(before[field], after[field], "{field}");
    }
    stop(&stack, run);
}

#[test]
fn same_user_stray_files_harmless() {
    let stack = StackSandbox::new();
    let run = start(&stack, "run", "lockstep");
    status_at(&stack, 10);
    let (_, name) = registered(&stack);
    let folder = Path::new("/dev/shm").join(&name);
    let mut stray = vec![
        (format!("/dev/shm/{name}_junk"), b"junk".to_vec()),
        (format!("{}/junk", folder.display()), b"junk".to_vec()),
        (format!("{}/nodes/junk", folder.display()), b"junk".to_vec()),
        (format!("{}/services/{name}_0000000000000000000000000000000000000000.service", folder.display()), b"junk".to_vec()),
        (stack.path("hapfic/junk.json").display().to_string(), b"junk".to_vec()),
    ];
    // Truncated copies of real segments, and empty ones, under names like those of iceoryx2.
    let segments: Vec<PathBuf> = shm_entries(&name)
        .into_iter()
        .filter(|path| path.extension().is_some_and(|e| e == "connection" || e == "dynamic"))
        .collect();
    assert!(segments.len() > 10, "{segments:?}");
    for path in &segments {
        let (stem, extension) = path.to_str().unwrap().rsplit_once('.').unwrap();
        let bytes = fs::read(path).unwrap_or_default();
        stray.push((format!("{stem}7.{extension}"), bytes[..bytes.len() / 2].to_vec()));
        stray.push((format!("{stem}8.{extension}"), Vec::new()));
    }
    for (path, bytes) in &stray {
        fs::write(path, bytes).unwrap();
    }
    let tick = status_at(&stack, 0)["tick"].as_i64().unwrap();
    set(&stack, "taper=0.15");
    // Killed callers make the supervisor scan all of it.
    for _ in 0..10 {
        let caller = stack.start(&["set", "taper=0.1"]);
        std::thread::sleep(Duration::from_millis(10));
        let _ = caller.kill();
    }
    status_at(&stack, tick + 100);
    set(&stack, "taper=0.12");
    // Not part of the run, so the run does not remove it.
    fs::remove_file(stack.path("hapfic/junk.json")).unwrap();
    stop(&stack, run);
    for (path, _) in &stray {
        assert!(!Path::new(path).exists(), "{path} is left");
    }
}

#[test]
fn same_user_truncated_segments_end_run_only() {
    for kind in ["data", "connection", "dynamic"] {
        let stack = StackSandbox::new();
        let mut run = start(&stack, "run", "lockstep");
        let children = run.children(&PROCESSES);
        run.wait_for(&stack.path("run.mcap"), 200_000);
        let (_, name) = registered(&stack);
        for path in shm_entries(&name).iter().filter(|path| path.extension().is_some_and(|e| e == kind)) {
            // What a lost process leaves behind is removed meanwhile.
            match OpenOptions::new().write(true).truncate(true).open(path) {
                Ok(_) => {}
                Err(e) => assert_eq!(e.kind(), ErrorKind::NotFound, "{path:?}"),
            }
        }
        // A process that touches a segment gets SIGBUS; the supervisor reports the loss of any other process.
        let end = run.finish();
        assert!(matches!(end.code, None | Some(3)), "{kind}: {:?}\n{}", end.code, end.out);
        let begun = Instant::now();
        while children.iter().any(|(_, pid)| is_running(*pid)) {
            assert!(begun.elapsed() < Duration::from_secs(10), "{kind}: still running: {children:?}");
            std::thread::yield_now();
        }
        stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "next.mcap"]).expect(0);
        end.expect_nothing_left();
        assert_eq!(stack.registrations(), 0);
    }
}
