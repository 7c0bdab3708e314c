//! A child process of the stack: its bus, its clock, its end.

mod states;

pub use states::Gaps;

use crate::arrival_predictor::ArrivalPredictor;
use crate::bus::{Bus, Domain, Input, Output};
use crate::child::{Ending, supervisor_gone, tie_to_supervisor};
use crate::deadline_timer::DeadlineTimer;
use crate::doorbell::{Doorbell, Wakes, wait};
use crate::error::IpcError;
use crate::realtime::{self, Prefault, SchedGrants, SchedRequest};
use crate::run::RunFile;
use crate::{allocations, topic};
use core::time::Duration;
use hapfic_messages::{Check, Clock, Message, Phase, Process, RealtimeMode, State, TickBuffer, Timing};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// How long a process waits for input before it looks around.
const TIMEOUT: Duration = Duration::from_millis(50);
/// How often page faults are counted, in ticks: a system call.
const FAULTS_EVERY: i64 = 1000;

/// When a tick's work was done, by the monotonic clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickTimes {
    /// Which tick.
    pub tick: i64,
    /// When the input that started it was published (plant: when the timer should have fired).
    pub due_ns: u64,
    /// When the process woke up.
    pub wake_ns: u64,
    /// When it had published; zero if it did not.
    pub publish_ns: u64,
    /// From its own publication to the answer's arrival (plant only); zero if there was none in time.
    pub latency_ns: u64,
}

/// Which start of its process this is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessStart {
    /// 0 for the first start in a run.
    pub generation: u32,
    /// TickTimes of its forerunner's last message, from which it goes on.
    pub resume: Option<i64>,
}

impl ProcessStart {
    /// As the supervisor has put it into the environment.
    ///
    /// # Errors
    /// [`IpcError::System`] if a variable holds no number.
    pub fn from_env() -> Result<Self, IpcError> {
        Ok(Self { generation: number(RunFile::GENERATION)?.unwrap_or(0), resume: number(RunFile::RESUME)? })
    }
}

fn number<T: core::str::FromStr>(variable: &'static str) -> Result<Option<T>, IpcError> {
    let Some(text) = std::env::var_os(variable) else { return Ok(None) };
    let parsed = text.to_str().and_then(|t| t.parse().ok());
    parsed.map(Some).ok_or_else(|| IpcError::System {
        action: "join the run",
        cause: std::io::Error::other(format!("{variable} is {}, expected a whole number", text.display())),
    })
}

/// What every process loop has at hand.
#[derive(Debug)]
pub struct Context {
    /// Which process this is.
    pub process: Process,
    /// How time passes.
    pub clock: Clock,
    /// The topics.
    pub bus: Bus,
    /// Which start of the process this is.
    pub start: ProcessStart,
    stop: Arc<AtomicBool>,
    supervisor_pid: i32,
    core: Option<usize>,
    reserve_core: Option<usize>,
    realtime: RealtimeMode,
    granted: SchedGrants,
    timing: Output<Timing>,
    rejected: u32,
    failed_connections: u32,
    /// When it was last heard of.
    heartbeat_ns: u64,
    faults_at_start: u64,
    faults: u32,
    /// First tick at which they are counted again.
    faults_due: i64,
    allocations_at_wake: u64,
    /// In lockstep: states that have come.
    states: TickBuffer<State>,
    /// In realtime: when the next is due, if that is looked out for.
    predictor: Option<ArrivalPredictor>,
}

impl Context {
    /// Joins a run: is killed with its supervisor, ends on SIGTERM, leaves SIGINT to the supervisor.
    ///
    /// # Errors
    /// [`IpcError`] if the supervisor is gone already or its topics cannot be opened.
    pub fn join(run: &RunFile, process: Process, start: ProcessStart) -> Result<Self, IpcError> {
        let system = |action| move |e: rustix::io::Errno| IpcError::System { action, cause: e.into() };
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|cause| IpcError::System { action: "handle signals", cause })?;
        }
        let name = std::ffi::CString::new(format!("hapfic-{}", process.name())).unwrap_or_default();
        rustix::thread::set_name(&name).map_err(system("set the process's name"))?;
        // Before anything in shared memory is touched: an orphan must not.
        tie_to_supervisor(run.supervisor_pid, Ending::Killed)
            .map_err(|cause| IpcError::System { action: "join the run", cause })?;
        if run.clock == Clock::Realtime && run.realtime != RealtimeMode::Off {
            realtime::lock_memory(Prefault::Used);
        }
        // What cannot be met is counted and told of by the supervisor.
        crate::service::quiet();
        let domain = Domain::new(&run.prefix, &run.root)?.with_short_timeouts(run.clock);
        let bus = Bus::open(&domain, process.name())?;
        let timing = bus.output(&topic::TIMING)?;
        Ok(Self {
            process,
            clock: run.clock,
            bus,
            start,
            stop,
            supervisor_pid: run.supervisor_pid,
            core: if process == Process::Standby { run.reserve_core } else { run.core }.map(|c| c as usize),
            reserve_core: run.reserve_core.map(|c| c as usize),
            realtime: if run.clock == Clock::Lockstep { RealtimeMode::Off } else { run.realtime },
            granted: SchedGrants::default(),
            timing,
            rejected: 0,
            failed_connections: 0,
            heartbeat_ns: 0,
            faults_at_start: 0,
            faults: 0,
            faults_due: 0,
            allocations_at_wake: 0,
            states: TickBuffer::default(),
            predictor: None,
        })
    }

    /// An [`DeadlineTimer`] for this process, at a priority of its own, on the core where the controller in reserve is.
    ///
    /// # Errors
    /// [`IpcError::System`] if there is no thread to be had.
    pub fn deadline_timer(
        &self,
        name: &str,
        doorbell: Doorbell,
        period_ns: u64,
        priority: u32,
    ) -> Result<DeadlineTimer, IpcError> {
        let wish = SchedRequest { core: self.reserve_core, ..SchedRequest::new(priority, None) };
        let wish = (self.realtime != RealtimeMode::Off).then_some(wish);
        DeadlineTimer::start(name, doorbell, period_ns, wish)
            .map_err(|cause| IpcError::System { action: "start an deadline_timer", cause })
    }

    fn supervisor_gone(&self) -> bool {
        supervisor_gone(self.supervisor_pid)
    }

    /// Takes real-time privileges, as far as the run asks for them, and says that the process is ready.
    ///
    /// # Errors
    /// [`IpcError`] if the message cannot be sent.
    pub fn ready(&mut self, wish: SchedRequest) -> Result<(), IpcError> {
        if self.realtime != RealtimeMode::Off {
            let core = wish.core.or(self.core);
            self.granted = realtime::apply_to_current_thread(SchedRequest { core, ..wish });
        }
        self.faults_at_start = realtime::page_faults();
        self.heartbeat(Phase::Ready, -1)
    }

    /// Whether the loop should go on. Asks the system for the parent only in the slack, see [`idle`](Self::idle).
    #[must_use]
    pub fn running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Waits for something on one of the inputs, a signal or 50 ms; in the latter case does what [`idle`](Self::idle)
    /// does. Says whether to go on.
    ///
    /// # Errors
    /// [`IpcError`] if waiting fails or the heartbeat cannot be sent.
    pub fn wait(&mut self, inputs: &[&dyn Wakes], tick: i64) -> Result<bool, IpcError> {
        // Also when it is woken again and again by what it cannot use.
        if !wait(inputs, TIMEOUT)? || crate::clock::now_ns() - self.heartbeat_ns > TIMEOUT.as_nanos() as u64 {
            self.idle(tick)?;
        }
        Ok(self.running())
    }

    /// Takes everything that has come in; what does not pass its check is counted and left out.
    ///
    /// # Errors
    /// [`IpcError`] if a connection is damaged.
    pub fn drain<T>(&mut self, input: &mut Input<T>, mut take: impl FnMut(T)) -> Result<(), IpcError>
    where
        T: Check + Message,
    {
        self.take_until(input, |message| {
            take(message);
            false
        })
    }

    /// Takes what has come in up to a message that is `enough`, for when somebody waits and a look for more would cost; checks as
    /// [`drain`](Self::drain) does.
    ///
    /// # Errors
    /// [`IpcError`] if a connection is damaged.
    pub fn take_until<T>(&mut self, input: &mut Input<T>, mut enough: impl FnMut(T) -> bool) -> Result<(), IpcError>
    where
        T: Check + Message,
    {
        while let Some(message) = input.next()? {
            if message.check().is_err() {
                self.reject();
            } else if enough(message) {
                break;
            }
        }
        Ok(())
    }

    /// Waits for the message that the supervisor hands over from a forerunner. `None` when the process should end.
    ///
    /// # Errors
    /// [`IpcError`] if waiting or receiving fails.
    pub fn handed_over<T>(&mut self, input: &mut Input<T>, wanted: impl Fn(&T) -> bool) -> Result<Option<T>, IpcError>
    where
        T: Check + Message,
    {
        loop {
            while let Some(message) = input.next()? {
                if message.check().is_ok() && wanted(&message) {
                    return Ok(Some(message));
                }
            }
            if !self.wait(&[&*input], -1)? {
                return Ok(None);
            }
        }
    }

    /// Waits until the supervisor ends the process: what it has sent stays in being as long as it does.
    ///
    /// # Errors
    /// [`IpcError`] if the heartbeat cannot be sent.
    pub fn finish(&mut self, tick: i64) -> Result<(), IpcError> {
        while self.running() {
            self.heartbeat(Phase::Finished, tick)?;
            wait(&[], TIMEOUT)?;
            if self.supervisor_gone() {
                break;
            }
        }
        Ok(())
    }

    /// To be called when a wait timed out: sends a heartbeat, and ends the loop if the supervisor is gone.
    ///
    /// # Errors
    /// [`IpcError`] if the heartbeat cannot be sent.
    pub fn idle(&mut self, tick: i64) -> Result<(), IpcError> {
        if self.supervisor_gone() {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.heartbeat(if tick < 0 { Phase::Ready } else { Phase::Waiting }, tick)
    }

    /// Counts a message that was not used.
    pub fn reject(&mut self) {
        self.rejected = self.rejected.saturating_add(1);
    }

    /// How often the process's ports could not meet somebody: the supervisor then lets all look round once more.
    pub fn report_failed_connections(&mut self, failed_connections: u32) {
        self.failed_connections = failed_connections;
    }

    /// To be called on waking up with work to do: starts counting allocations.
    pub fn begin(&mut self) {
        self.allocations_at_wake = allocations::count();
    }

    /// Time of the monotonic clock for messages: zero in lockstep.
    #[must_use]
    pub fn stamp(&self) -> u64 {
        match self.clock {
            Clock::Realtime => crate::clock::now_ns(),
            Clock::Lockstep => 0,
        }
    }

    /// Accounts for a tick after its output was sent.
    ///
    /// # Errors
    /// [`IpcError`] if the message cannot be sent.
    pub fn account(&mut self, done: TickTimes) -> Result<(), IpcError> {
        let TickTimes { tick, due_ns, wake_ns, publish_ns, latency_ns } = done;
        // A system call: in the slack, and not at every tick.
        if tick >= self.faults_due {
            self.faults_due = tick - tick % FAULTS_EVERY + FAULTS_EVERY;
            self.count_faults();
        }
        // The first tick meets its peers, and in lockstep nobody waits in real time.
        let counts = tick > 0 && self.clock == Clock::Realtime;
        let allocations = if counts { (allocations::count() - self.allocations_at_wake) as u32 } else { 0 };
        self.send(&Timing {
            phase: Phase::Running.code(),
            tick,
            due_ns,
            wake_ns,
            publish_ns,
            latency_ns,
            allocations,
            ..Timing::default()
        })
    }

    /// A heartbeat without a tick's work.
    ///
    /// # Errors
    /// [`IpcError`] if the message cannot be sent.
    pub fn heartbeat(&mut self, phase: Phase, tick: i64) -> Result<(), IpcError> {
        let now = crate::clock::now_ns();
        if phase == Phase::Finished {
            self.count_faults();
        }
        self.send(&Timing { phase: phase.code(), tick, due_ns: now, wake_ns: now, ..Timing::default() })
    }

    fn count_faults(&mut self) {
        self.faults = (realtime::page_faults() - self.faults_at_start) as u32;
    }

    fn send(&mut self, timing: &Timing) -> Result<(), IpcError> {
        self.heartbeat_ns = crate::clock::now_ns();
        self.timing.preloan();
        self.timing.send(&Timing {
            process: self.process.code(),
            rejected: self.rejected,
            page_faults: self.faults,
            realtime: self.granted.0,
            generation: self.start.generation,
            failed_connections: self.failed_connections,
            ..*timing
        })?;
        Ok(())
    }
}
