//! Context of a child process of the stack: its bus, its clock, its end.

mod states;

pub use states::Gaps;

use crate::arrival_predictor::ArrivalPredictor;
use crate::bus::{Bus, Domain};
use crate::deadline_timer::DeadlineTimer;
use crate::doorbell::{Doorbell, Wakes, wait};
use crate::error::IpcError;
use crate::heartbeat::HeartbeatPage;
use crate::ownership::{Orphanhood, Ownership};
use crate::ports::{Input, Output};
use crate::predecessor::last_messages;
use crate::realtime::{self, Prefault, SchedGrants, SchedRequest};
use crate::run::RunFile;
use crate::run_status::SharedStatus;
use crate::{allocations, topic};
use core::time::Duration;
use hapfic_messages::{Check, Clock, Message, Phase, Process, RealtimeMode, State, TickBuffer, Ticked, Timing};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Longest wait for input before a heartbeat.
const TIMEOUT: Duration = Duration::from_millis(50);
/// Interval of the counts of page faults, each a system call [ticks].
const FAULTS_EVERY: i64 = 1000;

/// Times of a tick's work, by the monotonic clock [ns].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickTimes {
    /// The tick.
    pub tick: i64,
    /// Publication time of the input that started it; for the plant the due time of its timer.
    pub due_ns: u64,
    /// Wake-up time.
    pub wake_ns: u64,
    /// Publication time of the output; zero if there is none.
    pub publish_ns: u64,
    /// Time from the publication to the arrival of the answer (plant only); zero if no answer came in time.
    pub latency_ns: u64,
}

/// Start of a process, counted within the run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessStart {
    /// 0 for the first start in a run.
    pub generation: u32,
}

impl ProcessStart {
    /// Reads the start that the supervisor put into the environment.
    ///
    /// # Errors
    /// [`IpcError::System`] if a variable holds no number.
    pub fn from_env() -> Result<Self, IpcError> {
        Ok(Self { generation: number(RunFile::GENERATION)?.unwrap_or(0) })
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

/// Context of a process loop.
#[derive(Debug)]
pub struct Context {
    /// The process.
    pub process: Process,
    /// Clock of the run.
    pub clock: Clock,
    /// The topics.
    pub bus: Bus,
    /// Start of the process.
    pub start: ProcessStart,
    stop: Arc<AtomicBool>,
    /// The run's folder.
    folder: String,
    owner: Ownership,
    core: Option<usize>,
    standby_core: Option<usize>,
    realtime: RealtimeMode,
    granted: SchedGrants,
    timing: Output<Timing>,
    heartbeats: Arc<HeartbeatPage>,
    rejected: u32,
    /// Time of the last heartbeat [ns].
    heartbeat_ns: u64,
    faults_at_start: u64,
    faults: u32,
    /// Tick of the next count of page faults.
    faults_due: i64,
    allocations_at_wake: u64,
    /// In lockstep: received states.
    states: TickBuffer<State>,
    /// In realtime: predictor of the next state, if busy-poll is enabled.
    predictor: Option<ArrivalPredictor>,
}

impl Context {
    /// Joins a run: the process's loop ends on SIGTERM or SIGINT, and if the run has had no supervisor for longer than
    /// `grace_ms` ([`Ownership`]).
    ///
    /// # Errors
    /// [`IpcError`] if the supervisor is already gone or its topics cannot be opened.
    pub fn join(run: &RunFile, grace_ms: u32, process: Process, start: ProcessStart) -> Result<Self, IpcError> {
        let system = |action| move |e: rustix::io::Errno| IpcError::System { action, cause: e.into() };
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|cause| IpcError::System { action: "handle signals", cause })?;
        }
        let name = std::ffi::CString::new(format!("hapfic-{}", process.name())).unwrap_or_default();
        rustix::thread::set_name(&name).map_err(system("set the process's name"))?;
        // Before any access to shared memory: an orphan must not touch it.
        let owner = Ownership::join(run, grace_ms)?;
        if run.clock == Clock::Realtime && run.realtime != RealtimeMode::Off {
            realtime::lock_memory(Prefault::Used);
        }
        // Failed connections are counted, and the supervisor reports them.
        crate::service::silence_transport_log();
        let domain = Domain::new(&run.prefix, &run.root)?.with_short_timeouts(run.clock);
        let bus = Bus::open(&domain, process.name())?;
        let timing = bus.kept_output(&topic::TIMING, process, run.clock)?;
        let heartbeats = bus.heartbeats();
        Ok(Self {
            process,
            clock: run.clock,
            bus,
            start,
            stop,
            folder: run.root.clone(),
            owner,
            core: if process == Process::Standby { run.standby_core } else { run.core }.map(|c| c as usize),
            standby_core: run.standby_core.map(|c| c as usize),
            realtime: if run.clock == Clock::Lockstep { RealtimeMode::Off } else { run.realtime },
            granted: SchedGrants::default(),
            timing,
            heartbeats,
            rejected: 0,
            heartbeat_ns: 0,
            faults_at_start: 0,
            faults: 0,
            faults_due: 0,
            allocations_at_wake: 0,
            states: TickBuffer::default(),
            predictor: None,
        })
    }

    /// Starts a [`DeadlineTimer`] for this process, at its own priority, on the core of the standby controller.
    ///
    /// # Errors
    /// [`IpcError::System`] if the thread cannot be started.
    pub fn deadline_timer(
        &self,
        name: &str,
        doorbell: Doorbell,
        period_ns: u64,
        priority: u32,
    ) -> Result<DeadlineTimer, IpcError> {
        let request = SchedRequest { core: self.standby_core, ..SchedRequest::new(priority, None) };
        let request = (self.realtime != RealtimeMode::Off).then_some(request);
        DeadlineTimer::start(name, doorbell, period_ns, request)
            .map_err(|cause| IpcError::System { action: "start a deadline timer", cause })
    }

    /// Ends the loop if the run has had no supervisor for too long.
    fn look_for_owner(&mut self) {
        if self.owner.look(crate::clock::now_ns()) >= Orphanhood::AllEnd {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    /// Takes real-time privileges, if the run requests them, and reports that the process is ready.
    ///
    /// # Errors
    /// [`IpcError`] if the message cannot be sent.
    pub fn ready(&mut self, request: SchedRequest) -> Result<(), IpcError> {
        if self.realtime != RealtimeMode::Off {
            let core = request.core.or(self.core);
            self.granted = realtime::apply_to_current_thread(SchedRequest { core, ..request });
        }
        self.faults_at_start = realtime::page_faults();
        self.heartbeat(Phase::Ready, -1)
    }

    /// Whether the loop continues. [`idle`](Self::idle) and [`account`](Self::account) look for the supervisor, in idle time only.
    #[must_use]
    pub fn running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Waits for a message on an input, a signal or 50 ms; in the last case does what [`idle`](Self::idle) does.
    /// Returns whether the loop continues.
    ///
    /// # Errors
    /// [`IpcError`] if waiting fails or the heartbeat cannot be sent.
    pub fn wait(&mut self, inputs: &[&dyn Wakes], tick: i64) -> Result<bool, IpcError> {
        // Also under repeated wake-ups without usable input.
        if !wait(inputs, TIMEOUT)? || crate::clock::now_ns() - self.heartbeat_ns > TIMEOUT.as_nanos() as u64 {
            self.idle(tick)?;
        }
        Ok(self.running())
    }

    /// Takes all received messages; counts those that fail their check, and leaves them out.
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

    /// Takes received messages up to one that is `enough`, where a further read would delay an answer; checks as
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

    /// Opens the sender of this process's messages, the last of which outlive it.
    ///
    /// # Errors
    /// As [`Bus::kept_output`].
    pub fn output<T: Message>(&self, topic: &topic::Topic<T>) -> Result<Output<T>, IpcError> {
        self.bus.kept_output(topic, self.process, self.clock)
    }

    /// Sends the last messages of this process's predecessor again, for those that they have not reached and for late
    /// joiners, and returns the newest, from which the process continues; `None` in its first start.
    ///
    /// # Errors
    /// [`IpcError`] if they cannot be read or sent.
    pub fn continue_behind_predecessor<T>(&self, topic: &topic::Topic<T>, output: &mut Output<T>) -> Result<Option<T>, IpcError>
    where
        T: Check + Ticked + Message,
    {
        if self.start.generation == 0 {
            return Ok(None);
        }
        let status = SharedStatus::open(&self.folder)?;
        let last = last_messages(&self.bus, topic, self.process, self.clock, &status.gate.tick)?;
        for message in &last {
            output.send_again(message)?;
            output.preloan();
        }
        Ok(last.last().copied())
    }

    /// Waits until the supervisor ends the process: those of its last messages that others have not received yet exist only as
    /// long as it lives.
    ///
    /// # Errors
    /// [`IpcError`] if the heartbeat cannot be sent.
    pub fn finish(&mut self, tick: i64) -> Result<(), IpcError> {
        while self.running() {
            self.heartbeat(Phase::Finished, tick)?;
            wait(&[], TIMEOUT)?;
            self.look_for_owner();
        }
        Ok(())
    }

    /// Sends a heartbeat, and ends the loop if the run has no supervisor any more. The process calls it after a time-out.
    ///
    /// # Errors
    /// [`IpcError`] if the heartbeat cannot be sent.
    pub fn idle(&mut self, tick: i64) -> Result<(), IpcError> {
        self.look_for_owner();
        self.heartbeat(if tick < 0 { Phase::Ready } else { Phase::Waiting }, tick)
    }

    /// Counts a rejected message.
    pub fn reject(&mut self) {
        self.rejected = self.rejected.saturating_add(1);
    }

    /// Starts counting allocations. The process calls it at a wake-up with work to do.
    pub fn begin(&mut self) {
        self.allocations_at_wake = allocations::count();
    }

    /// Time stamp for messages, by the monotonic clock [ns]: zero in lockstep.
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
        // A system call: in idle time, and not at every tick.
        if tick >= self.faults_due {
            self.faults_due = tick - tick % FAULTS_EVERY + FAULTS_EVERY;
            self.count_faults();
        }
        self.look_for_owner();
        // The first tick connects to its peers, and lockstep has no real-time bound.
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

    /// Sends a heartbeat without a tick's work.
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
        let timing = Timing {
            process: self.process.code(),
            rejected: self.rejected,
            page_faults: self.faults,
            realtime: self.granted.0,
            generation: self.start.generation,
            failed_connections: crate::failed_connections(),
            ..*timing
        };
        // First: the supervisor must see it, whatever becomes of the message.
        self.heartbeats.write(&timing, self.heartbeat_ns);
        self.timing.preloan();
        self.timing.send(&timing)?;
        Ok(())
    }
}
