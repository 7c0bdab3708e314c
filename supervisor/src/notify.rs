//! Tells the service manager how the run is, by the protocol of sd_notify(3): a datagram of `KEY=VALUE` lines to the socket that the
//! environment names. Without one nothing is told.

use std::env::{var, var_os};
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How long a service manager that does not take its messages may hold up the caller.
const TIMEOUT: Duration = Duration::from_millis(100);
/// Signs of life in the time after which the service manager loses patience.
const SIGNS: u32 = 3;

/// The line to the service manager. Not for real-time threads: each message is a system call.
#[derive(Debug)]
pub struct Notify {
    /// Where to; `None`: nobody listens.
    target: Option<(UnixDatagram, SocketAddr)>,
    /// How often a sign of life is due; `None`: nobody waits for any.
    every: Option<Duration>,
    begun: Instant,
    /// When the last sign of life went out, us after `begun`, plus one; zero: never.
    last: AtomicU64,
}

impl Notify {
    /// Variables that name the socket and the watchdog. They are this process's alone: to be removed from the environment of every
    /// process it starts.
    pub const VARIABLES: [&'static str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

    /// As the environment says. A socket that cannot be used is reported, and nothing is told: the run goes on without.
    #[must_use]
    pub fn from_env() -> Self {
        let [socket, usec, pid] = Self::VARIABLES;
        let socket = var_os(socket);
        let every = interval(var(usec).ok().as_deref(), var(pid).ok().as_deref(), std::process::id());
        Self::new(socket.as_deref(), every).unwrap_or_else(|e| {
            crate::say(&format!("hapfic: NOTIFY_SOCKET: found {socket:?}, expected a socket of the service manager: {e}"));
            Self::to(None, None)
        })
    }

    fn new(socket: Option<&OsStr>, every: Option<Duration>) -> io::Result<Self> {
        let Some(name) = socket.filter(|name| !name.is_empty()) else { return Ok(Self::to(None, None)) };
        let address = match name.as_bytes() {
            [b'@', abstract_name @ ..] => SocketAddr::from_abstract_name(abstract_name)?,
            [b'/', ..] => SocketAddr::from_pathname(name)?,
            _ => return Err(io::Error::new(io::ErrorKind::InvalidInput, "neither a path from the root nor `@` and a name")),
        };
        let from = UnixDatagram::unbound()?;
        from.set_write_timeout(Some(TIMEOUT))?;
        Ok(Self::to(Some((from, address)), every))
    }

    fn to(target: Option<(UnixDatagram, SocketAddr)>, every: Option<Duration>) -> Self {
        Self { target, every, begun: Instant::now(), last: AtomicU64::new(0) }
    }

    /// All processes are ready, and the run begins. From here on the watchdog counts.
    pub fn ready(&self) {
        self.send("READY=1");
    }

    /// One line for people.
    pub fn status(&self, text: &str) {
        self.send(&format!("STATUS={}", text.replace(['\n', '\r'], " ")));
    }

    /// The run ends. From here on the watchdog does not count any more.
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }

    /// A sign of life. To be called often, more than three times in `WATCHDOG_USEC`; what is not due yet is not sent.
    pub fn watchdog(&self) {
        let Some(every) = self.every else { return };
        let now = micros(self.begun.elapsed()).saturating_add(1);
        let last = self.last.load(Ordering::Relaxed);
        if (last == 0 || now.saturating_sub(last) >= micros(every)) && self.send("WATCHDOG=1") {
            self.last.store(now, Ordering::Relaxed);
        }
    }

    /// Whether it was taken. A service manager that has gone away, or does not listen, is no reason to end the run.
    fn send(&self, message: &str) -> bool {
        self.target.as_ref().is_some_and(|(from, to)| from.send_to_addr(message.as_bytes(), to).is_ok())
    }
}

fn micros(duration: Duration) -> u64 {
    u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)
}

/// How often a sign of life is due, from `WATCHDOG_USEC` and `WATCHDOG_PID`; `None` if this process is to give none.
fn interval(usec: Option<&str>, pid: Option<&str>, own: u32) -> Option<Duration> {
    let limit = usec?.parse::<u64>().ok().filter(|usec| *usec > 0)?;
    let ours = pid.is_none_or(|pid| pid.parse::<u32>() == Ok(own));
    ours.then(|| Duration::from_micros(limit) / SIGNS)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    /// A service manager, in a folder of the test's own.
    struct Manager {
        socket: UnixDatagram,
        path: PathBuf,
    }

    impl Manager {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("hapfic-notify-{}-{name}", std::process::id()));
            let _ = std::fs::remove_file(&path);
            Self::listening(UnixDatagram::bind(&path).unwrap(), path)
        }

        fn listening(socket: UnixDatagram, path: PathBuf) -> Self {
            socket.set_nonblocking(true).unwrap();
            Self { socket, path }
        }

        /// All that has arrived. A datagram has arrived when it was sent.
        fn heard(&self) -> Vec<String> {
            let mut heard = Vec::new();
            let mut buffer = [0; 4096];
            while let Ok(count) = self.socket.recv(&mut buffer) {
                heard.push(String::from_utf8(buffer[..count].to_vec()).unwrap());
            }
            heard
        }
    }

    impl Drop for Manager {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.path);
        }
    }

    #[test]
    fn messages_are_those_of_the_protocol() {
        let manager = Manager::new("protocol");
        let notify = Notify::new(Some(manager.path.as_os_str()), None).unwrap();
        notify.ready();
        notify.status("tick 5\nREADY=0");
        notify.watchdog();
        notify.stopping();
        assert_eq!(manager.heard(), ["READY=1", "STATUS=tick 5 READY=0", "STOPPING=1"]);
    }

    #[test]
    fn an_abstract_socket_is_as_good() {
        let name = format!("hapfic-notify-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let manager = Manager::listening(UnixDatagram::bind_addr(&address).unwrap(), PathBuf::new());
        let notify = Notify::new(Some(OsStr::new(&format!("@{name}"))), None).unwrap();
        notify.ready();
        assert_eq!(manager.heard(), ["READY=1"]);
    }

    #[test]
    fn signs_of_life_are_sent_when_they_are_due() {
        let manager = Manager::new("due");
        let seldom = Notify::new(Some(manager.path.as_os_str()), interval(Some("3000000000"), None, 7)).unwrap();
        for _ in 0..5 {
            seldom.watchdog();
        }
        assert_eq!(manager.heard(), ["WATCHDOG=1"]);
        let often = Notify::new(Some(manager.path.as_os_str()), interval(Some("1"), Some("7"), 7)).unwrap();
        for _ in 0..5 {
            often.watchdog();
        }
        assert_eq!(manager.heard().len(), 5);
    }

    #[test]
    fn a_sign_of_life_that_was_not_taken_is_due_again() {
        let manager = Manager::new("again");
        let notify = Notify::new(Some(manager.path.as_os_str()), interval(Some("3000000000"), None, 7)).unwrap();
        let path = manager.path.clone();
        drop(manager);
        notify.watchdog();
        let manager = Manager::listening(UnixDatagram::bind(&path).unwrap(), path);
        notify.watchdog();
        assert_eq!(manager.heard(), ["WATCHDOG=1"]);
    }

    #[test]
    fn who_is_not_asked_tells_nothing() {
        for (usec, pid) in [(None, None), (Some("0"), None), (Some("soon"), None), (Some("-1"), None), (Some("9"), Some("8"))] {
            assert_eq!(interval(usec, pid, 7), None, "{usec:?} {pid:?}");
        }
        assert_eq!(interval(Some("9"), Some("other"), 7), None);
        assert_eq!(interval(Some("2000001"), Some("7"), 7), Some(Duration::from_nanos(666_667_000)));
        for nobody in [None, Some(OsStr::new(""))] {
            let notify = Notify::new(nobody, Some(Duration::ZERO)).unwrap();
            notify.ready();
            notify.status("alone");
            notify.watchdog();
            notify.stopping();
            assert!(notify.target.is_none());
        }
    }

    #[test]
    fn what_is_no_address_is_refused() {
        let long = format!("/{}", "x".repeat(200));
        for bad in ["notify", "vsock:2:1234", long.as_str()] {
            assert!(Notify::new(Some(OsStr::new(bad)), None).is_err(), "{bad}");
        }
        // A service manager that is gone is not found out before something is said, and then it is no failure.
        Notify::new(Some(OsStr::new("/nonexistent/notify")), None).unwrap().ready();
    }
}
