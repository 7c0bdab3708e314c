//! Reports the state of the run to the service manager by the protocol of sd_notify(3): datagrams of `KEY=VALUE` lines.
//!
//! The environment names the socket. Without a socket the supervisor sends nothing.

use std::env::{var, var_os};
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Time for which a service manager that reads no messages may block the caller.
const TIMEOUT: Duration = Duration::from_millis(100);
/// Heartbeats within one watchdog time-out of the service manager.
const HEARTBEATS_PER_TIMEOUT: u32 = 3;

/// The connection to the service manager. Not for real-time threads: each message is a system call.
#[derive(Debug)]
pub struct Notify {
    /// Socket and address; `None`: no service manager.
    target: Option<(UnixDatagram, SocketAddr)>,
    /// Interval of the heartbeats; `None`: no watchdog.
    every: Option<Duration>,
    created: Instant,
    /// Time of the last heartbeat after `created`, plus one [us]; zero: none yet.
    last_us: AtomicU64,
}

impl Notify {
    /// Variables that name the socket and the watchdog. They apply to this process only, so a caller removes them from
    /// the environment of every process that it starts.
    pub const VARIABLES: [&'static str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

    /// Gives the socket to the supervisor, which reports in the place of this process. The unit needs `NotifyAccess=all`.
    pub(crate) fn pass_on(command: &mut Command) {
        let [socket, usec, pid] = Self::VARIABLES;
        if let Some(name) = var_os(socket) {
            command.env(socket, name);
        }
        if interval(var(usec).ok().as_deref(), var(pid).ok().as_deref(), std::process::id()).is_some()
            && let Some(limit) = var_os(usec)
        {
            command.env(usec, limit);
        }
    }

    /// Connects as the environment specifies. Logs an unusable socket and continues without a service manager.
    #[must_use]
    pub fn from_env() -> Self {
        let [socket, usec, pid] = Self::VARIABLES;
        let socket = var_os(socket);
        let every = interval(var(usec).ok().as_deref(), var(pid).ok().as_deref(), std::process::id());
        Self::new(socket.as_deref(), every).unwrap_or_else(|e| {
            crate::log_line(&format!("hapfic: NOTIFY_SOCKET: found {socket:?}, expected a socket of the service manager: {e}"));
            Self::to(None, None)
        })
    }

    fn new(socket: Option<&OsStr>, every: Option<Duration>) -> io::Result<Self> {
        let Some(name) = socket.filter(|name| !name.is_empty()) else { return Ok(Self::to(None, None)) };
        let address = match name.as_bytes() {
            [b'@', abstract_name @ ..] => SocketAddr::from_abstract_name(abstract_name)?,
            [b'/', ..] => SocketAddr::from_pathname(name)?,
            _ => return Err(io::Error::new(io::ErrorKind::InvalidInput, "neither an absolute path nor `@` and a name")),
        };
        let from = UnixDatagram::unbound()?;
        from.set_write_timeout(Some(TIMEOUT))?;
        Ok(Self::to(Some((from, address)), every))
    }

    fn to(target: Option<(UnixDatagram, SocketAddr)>, every: Option<Duration>) -> Self {
        Self { target, every, created: Instant::now(), last_us: AtomicU64::new(0) }
    }

    /// Reports that all processes are ready. The watchdog starts counting.
    pub fn ready(&self) {
        self.send("READY=1");
    }

    /// Reports a one-line status text.
    pub fn status(&self, text: &str) {
        self.send(&format!("STATUS={}", text.replace(['\n', '\r'], " ")));
    }

    /// Reports that the run ends. The watchdog stops counting.
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }

    /// Sends a heartbeat if one is due. The caller calls this more than three times in `WATCHDOG_USEC`.
    pub fn watchdog(&self) {
        let Some(every) = self.every else { return };
        let now = micros(self.created.elapsed()).saturating_add(1);
        let last = self.last_us.load(Ordering::Relaxed);
        if (last == 0 || now.saturating_sub(last) >= micros(every)) && self.send("WATCHDOG=1") {
            self.last_us.store(now, Ordering::Relaxed);
        }
    }

    /// Sends a message; returns whether the socket accepted it. A lost service manager does not end the run.
    fn send(&self, message: &str) -> bool {
        self.target.as_ref().is_some_and(|(from, to)| from.send_to_addr(message.as_bytes(), to).is_ok())
    }
}

fn micros(duration: Duration) -> u64 {
    u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)
}

/// Interval of the heartbeats from `WATCHDOG_USEC` and `WATCHDOG_PID`; `None` if this process sends none.
fn interval(usec: Option<&str>, pid: Option<&str>, own: u32) -> Option<Duration> {
    let limit = usec?.parse::<u64>().ok().filter(|usec| *usec > 0)?;
    let ours = pid.is_none_or(|pid| pid.parse::<u32>() == Ok(own));
    ours.then(|| Duration::from_micros(limit) / HEARTBEATS_PER_TIMEOUT)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    /// A service manager with a socket in the temporary folder.
    struct ServiceManager {
        socket: UnixDatagram,
        path: PathBuf,
    }

    impl ServiceManager {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("hapfic-notify-{}-{name}", std::process::id()));
            let _ = std::fs::remove_file(&path);
            Self::listening(UnixDatagram::bind(&path).unwrap(), path)
        }

        fn listening(socket: UnixDatagram, path: PathBuf) -> Self {
            socket.set_nonblocking(true).unwrap();
            Self { socket, path }
        }

        /// Returns all received messages; a sent datagram is immediately readable.
        fn received(&self) -> Vec<String> {
            let mut messages = Vec::new();
            let mut buffer = [0; 4096];
            while let Ok(count) = self.socket.recv(&mut buffer) {
                messages.push(String::from_utf8(buffer[..count].to_vec()).unwrap());
            }
            messages
        }
    }

    impl Drop for ServiceManager {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.path);
        }
    }

    #[test]
    fn notify_each_call_sends_protocol_line() {
        let manager = ServiceManager::new("protocol");
        let notify = Notify::new(Some(manager.path.as_os_str()), None).unwrap();
        notify.ready();
        notify.status("tick 5\nREADY=0");
        notify.watchdog();
        notify.stopping();
        assert_eq!(manager.received(), ["READY=1", "STATUS=tick 5 READY=0", "STOPPING=1"]);
    }

    #[test]
    fn notify_abstract_socket_receives() {
        let name = format!("hapfic-notify-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let manager = ServiceManager::listening(UnixDatagram::bind_addr(&address).unwrap(), PathBuf::new());
        let notify = Notify::new(Some(OsStr::new(&format!("@{name}"))), None).unwrap();
        notify.ready();
        assert_eq!(manager.received(), ["READY=1"]);
    }

    #[test]
    fn watchdog_before_interval_sends_nothing() {
        let manager = ServiceManager::new("due");
        let rare = Notify::new(Some(manager.path.as_os_str()), interval(Some("3000000000"), None, 7)).unwrap();
        for _ in 0..5 {
            rare.watchdog();
        }
        assert_eq!(manager.received(), ["WATCHDOG=1"]);
        let frequent = Notify::new(Some(manager.path.as_os_str()), interval(Some("1"), Some("7"), 7)).unwrap();
        for _ in 0..5 {
            frequent.watchdog();
        }
        assert_eq!(manager.received().len(), 5);
    }

    #[test]
    fn watchdog_failed_send_retries() {
        let manager = ServiceManager::new("again");
        let notify = Notify::new(Some(manager.path.as_os_str()), interval(Some("3000000000"), None, 7)).unwrap();
        let path = manager.path.clone();
        drop(manager);
        notify.watchdog();
        let manager = ServiceManager::listening(UnixDatagram::bind(&path).unwrap(), path);
        notify.watchdog();
        assert_eq!(manager.received(), ["WATCHDOG=1"]);
    }

    #[test]
    fn notify_without_target_sends_nothing() {
        for (usec, pid) in [(None, None), (Some("0"), None), (Some("soon"), None), (Some("-1"), None), (Some("9"), Some("8"))] {
            assert_eq!(interval(usec, pid, 7), None, "{usec:?} {pid:?}");
        }
        assert_eq!(interval(Some("9"), Some("other"), 7), None);
        assert_eq!(interval(Some("2000001"), Some("7"), 7), Some(Duration::from_nanos(666_667_000)));
        for none in [None, Some(OsStr::new(""))] {
            let notify = Notify::new(none, Some(Duration::ZERO)).unwrap();
            notify.ready();
            notify.status("not sent");
            notify.watchdog();
            notify.stopping();
            assert!(notify.target.is_none());
        }
    }

    #[test]
    fn notify_invalid_address_is_rejected() {
        let long = format!("/{}", "x".repeat(200));
        for bad in ["notify", "vsock:2:1234", long.as_str()] {
            assert!(Notify::new(Some(OsStr::new(bad)), None).is_err(), "{bad}");
        }
        // A missing service manager shows at the first message only, and is no failure.
        Notify::new(Some(OsStr::new("/nonexistent/notify")), None).unwrap().ready();
    }
}
