//! Looks after executions that do not come back.

use super::corpus;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// An execution that takes so long will not come back.
const LOST: Duration = Duration::from_secs(60);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// What is being done.
#[derive(Debug, Default)]
enum Doing {
    #[default]
    Nothing,
    /// An execution, since when and of what.
    Executing(Instant, Vec<u8>),
    /// The campaign is over.
    Done,
}

/// Watches the executions of one campaign. One that never ends cannot be stopped: its input is saved and the process ends with 1.
#[derive(Debug)]
pub(super) struct Watchdog {
    doing: Arc<Mutex<Doing>>,
    thread: Option<JoinHandle<()>>,
}

impl Watchdog {
    pub(super) fn start(target: &'static str, findings: PathBuf) -> Self {
        let doing = Arc::new(Mutex::new(Doing::Nothing));
        let polled = Arc::clone(&doing);
        let thread = std::thread::spawn(move || {
            loop {
                std::thread::park_timeout(POLL_INTERVAL);
                match &*polled.lock().unwrap_or_else(PoisonError::into_inner) {
                    Doing::Done => return,
                    Doing::Executing(since, input) if since.elapsed() > LOST => {
                        give_up(target, &findings, input);
                    }
                    Doing::Executing(..) | Doing::Nothing => {}
                }
            }
        });
        Self { doing, thread: Some(thread) }
    }

    pub(super) fn begins(&self, input: &[u8]) {
        self.set(Doing::Executing(Instant::now(), input.to_vec()));
    }

    pub(super) fn ended(&self) {
        self.set(Doing::Nothing);
    }

    fn set(&self, doing: Doing) {
        *self.doing.lock().unwrap_or_else(PoisonError::into_inner) = doing;
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.set(Doing::Done);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

fn give_up(target: &str, findings: &std::path::Path, input: &[u8]) -> ! {
    use std::io::Write;
    let told = match corpus::save(findings, target, input) {
        Ok(path) => format!("its input is in {}", path.display()),
        Err(error) => format!("its input cannot be saved: {error}"),
    };
    let _ = writeln!(std::io::stderr(), "{target}: an execution has not ended after {} s; {told}", LOST.as_secs());
    std::process::exit(1);
}
