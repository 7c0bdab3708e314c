//! Watchdog for executions that do not end.

use super::corpus;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time after which an execution counts as hanging.
const HANG_TIMEOUT: Duration = Duration::from_secs(60);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Current activity of a campaign.
#[derive(Debug, Default)]
enum Activity {
    #[default]
    Idle,
    /// Execution: start and input.
    Executing(Instant, Vec<u8>),
    /// End of the campaign.
    Done,
}

/// Watchdog of one campaign.
///
/// A hanging execution cannot be stopped: the watchdog saves its input and ends the process with exit code 1.
#[derive(Debug)]
pub(super) struct Watchdog {
    activity: Arc<Mutex<Activity>>,
    thread: Option<JoinHandle<()>>,
}

impl Watchdog {
    pub(super) fn start(target: &'static str, findings: PathBuf) -> Self {
        let activity = Arc::new(Mutex::new(Activity::Idle));
        let polled = Arc::clone(&activity);
        let thread = std::thread::spawn(move || {
            loop {
                std::thread::park_timeout(POLL_INTERVAL);
                match &*polled.lock().unwrap_or_else(PoisonError::into_inner) {
                    Activity::Done => return,
                    Activity::Executing(since, input) if since.elapsed() > HANG_TIMEOUT => {
                        report_and_exit(target, &findings, input);
                    }
                    Activity::Executing(..) | Activity::Idle => {}
                }
            }
        });
        Self { activity, thread: Some(thread) }
    }

    pub(super) fn begin(&self, input: &[u8]) {
        self.set(Activity::Executing(Instant::now(), input.to_vec()));
    }

    pub(super) fn end(&self) {
        self.set(Activity::Idle);
    }

    fn set(&self, activity: Activity) {
        *self.activity.lock().unwrap_or_else(PoisonError::into_inner) = activity;
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.set(Activity::Done);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

fn report_and_exit(target: &str, findings: &std::path::Path, input: &[u8]) -> ! {
    use std::io::Write;
    let saved = match corpus::save(findings, target, input) {
        Ok(path) => format!("its input is in {}", path.display()),
        Err(error) => format!("its input cannot be saved: {error}"),
    };
    let _ = writeln!(std::io::stderr(), "{target}: an execution has not ended after {} s; {saved}", HANG_TIMEOUT.as_secs());
    std::process::exit(1);
}
