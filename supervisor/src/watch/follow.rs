//! Course of a run in the main thread: start, ticks, end.

use super::evidence::Suspicion;
use super::slot::ProcessSlot;
use super::{FAST_POLL_INTERVAL, POLL_INTERVAL, RunTimes, WATCH_PRIORITY, Watch, bit};
use crate::children::{self, Child, started};
use crate::progress::Progress;
use crate::{preflight, privileges, summary};
use anyhow::Result;
use hapfic_config::PERIOD_S;
use hapfic_ipc::ProcessStart;
use hapfic_ipc::realtime;
use hapfic_messages::{Clock, Detector, EventKind, Phase, Process, RealtimeMode, Severity};
use std::process::Stdio;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Ticks before an injected fault in which the supervisor polls fast.
const NEAR_TICKS: i64 = 200;
/// Most extensions of the time to get ready, each of the time-out.
const READY_EXTENSIONS: u32 = 5;
/// Time that processes may take for their last tick after the gate's.
const LAST_TICK_TIMEOUT: Duration = Duration::from_secs(1);

impl Watch<'_> {
    /// Starts all processes, waits until they are ready, and watches the run to its end.
    ///
    /// # Errors
    /// If a process cannot be started or polled.
    pub fn start_and_follow(&mut self) -> Result<RunTimes> {
        for process in started(self.run.settings) {
            let child = Child::start(*process, self.run.settings, self.run.run_file, ProcessStart::default(), Stdio::null())?;
            self.run.record.process(*process).set_pid(Some(child.pid().as_raw_nonzero().get()));
            self.slots.push(ProcessSlot::new(*process, child));
        }
        let ready = self.wait_until_ready()?;
        let record = self.run.record;
        record.begun_ns.store(hapfic_ipc::clock::now_ns(), Ordering::Relaxed);
        record.launch_ns.store(self.run.request.since.elapsed().as_nanos() as u64, Ordering::Relaxed);
        record.steal_ms.store(summary::steal_ms(), Ordering::Relaxed);
        let mut completed = false;
        if ready {
            preflight::reserve_segments(&self.run.prefix)?;
            if self.run.clock == Clock::Realtime && !self.has_required_privileges() {
                return Ok(self.times(false));
            }
            if self.run.clock == Clock::Realtime {
                privileges::report(self.run.settings, self.run.request.realtime, self.run.cores, &self.run.shared);
            }
            let what = format!("{} ({}) starts", self.run.request.scenario, self.run.clock.name());
            self.report(-1, Process::Supervisor, EventKind::Started, Severity::Nominal, Detector::None, &what);
            self.run.notify.ready();
            self.run.notify.status(&what);
            self.begun = Instant::now();
            self.stall.advanced = (-1, self.evidence.observed_ns());
            let present = started(self.run.settings).iter().fold(bit(Process::Recorder), |bits, p| bits | bit(*p));
            self.run.shared.presence.present.store(present, Ordering::Release);
            for slot in &mut self.slots {
                slot.restart.stage = hapfic_gate::restart_policy::RestartStage::Working;
            }
            self.inject()?;
            self.take_priority();
            self.run.shared.orders.start.store(true, Ordering::Release);
            completed = self.follow()?;
            if completed {
                let last = self.run.shared.gate.tick.load(Ordering::Relaxed);
                self.report(last, Process::Supervisor, EventKind::Ended, Severity::Nominal, Detector::None, "all ticks are done");
            }
        }
        Ok(self.times(completed))
    }

    /// Takes the priority of the main thread.
    pub(super) fn take_priority(&self) {
        if self.run.clock == Clock::Realtime && self.gates_are_realtime() {
            // Restarts must not wait for other processes of the machine; without the privilege they do.
            let _ = realtime::set_fifo(WATCH_PRIORITY);
        }
    }

    /// Times of the run up to now.
    pub(super) fn times(&self, completed: bool) -> RunTimes {
        let record = self.run.record;
        let wall_ns = hapfic_ipc::clock::now_ns().saturating_sub(record.begun_ns.load(Ordering::Relaxed));
        RunTimes {
            launch_s: record.launch_ns.load(Ordering::Relaxed) as f64 * 1e-9,
            wall_s: wall_ns as f64 * 1e-9,
            steal_ms: summary::steal_ms().saturating_sub(record.steal_ms.load(Ordering::Relaxed)),
            completed,
        }
    }

    /// Waits until all processes report that they are ready; `false` if one does not.
    ///
    /// Until then they have no real-time priority, so on a busy machine they may wait long for a processor. They get more
    /// time then, up to [`READY_EXTENSIONS`] times the time-out.
    fn wait_until_ready(&mut self) -> Result<bool> {
        let timeout = Duration::from_millis(self.run.settings.supervisor.ready_timeout_ms.into());
        let mut deadline = Instant::now() + timeout;
        let mut extensions = 0;
        let children = self.slots.iter().filter_map(|slot| slot.child.as_ref());
        let mut suspicions: Vec<_> = children.map(|child| Suspicion::begin(child.pid(), &self.evidence)).collect();
        loop {
            if !self.healthy()? {
                return Ok(false);
            }
            let missing: Vec<_> = started(self.run.settings)
                .iter()
                .filter(|p| self.run.shared.heartbeats.read(**p).phase.is_none())
                .map(|p| p.name())
                .collect();
            if missing.is_empty() {
                return Ok(true);
            }
            let late = Instant::now() > deadline;
            // Every excuse is asked for, so that all begin anew.
            let excused = late && suspicions.iter_mut().map(|s| u32::from(s.excuse(&self.evidence))).sum::<u32>() > 0;
            if excused && extensions < READY_EXTENSIONS {
                extensions += 1;
                deadline = Instant::now() + timeout;
                let what = format!("still waits for {}: the machine is busy and gives no processor", missing.join(", "));
                self.report(-1, Process::Supervisor, EventKind::Note, Severity::Nominal, Detector::Start, &what);
            } else if late {
                for process in missing {
                    self.fault(process, "did not get ready in time".to_owned(), Detector::Start);
                }
                return Ok(false);
            }
            self.pause(FAST_POLL_INTERVAL);
        }
    }

    /// Watches the run; returns whether it completed.
    pub(super) fn follow(&mut self) -> Result<bool> {
        let mut progress = Progress::new(self.run.settings.duration_ticks as f64 * PERIOD_S);
        loop {
            if self.run.shared.gate.tick.load(Ordering::Acquire) + 1 >= self.run.settings.duration_ticks as i64 {
                progress.clear();
                let stopped = self.run.shared.gate.severity.load(Ordering::Relaxed) == Severity::Stopped.code();
                if stopped && !self.stopped_by_budget {
                    self.fault("supervisor", "was in a latched stop when the run ended".to_owned(), Detector::Operator);
                }
                return Ok(true);
            }
            if !self.healthy()? {
                progress.clear();
                return Ok(false);
            }
            progress.show(&self.run.latest.snapshot(), self.run.shared.gate.counts().missed);
            self.run.notify.watchdog();
            let joining = self.slots.iter().any(ProcessSlot::joining);
            if joining {
                for doorbell in &self.doorbells {
                    doorbell.notify();
                }
            }
            let near = joining || self.injections.near(self.run.shared.gate.tick.load(Ordering::Relaxed), NEAR_TICKS);
            self.pause(if near { FAST_POLL_INTERVAL } else { POLL_INTERVAL });
        }
    }

    /// Waits until a process ends, or for `time`.
    fn pause(&self, time: Duration) {
        children::watch(self.slots.iter().filter_map(|s| s.child.as_ref()), time);
    }

    /// Injects the faults that are due.
    pub(super) fn inject(&mut self) -> Result<()> {
        let gated = self.run.shared.gate.tick.load(Ordering::Acquire);
        for (fault, what) in self.injections.act(&mut self.slots, &self.run.shared, gated)? {
            let about = Process::from_name(fault.target.name()).unwrap_or(Process::Supervisor);
            self.note(about, EventKind::Injected, Detector::None, &format!("injected fault: {what}"));
        }
        Ok(())
    }

    /// With `--realtime require`: whether every thread has all privileges that it requested.
    fn has_required_privileges(&mut self) -> bool {
        if self.run.request.realtime != RealtimeMode::Require {
            return true;
        }
        let missing = privileges::missing(self.run.settings, self.run.cores, &self.run.shared);
        for (process, what) in &missing {
            self.fault(process, format!("did not get {what}, which --realtime require demands"), Detector::Start);
        }
        missing.is_empty()
    }

    /// Ends gate and processes. The recorder then has all messages before it.
    ///
    /// # Errors
    /// If the system does not report how a process ended.
    pub fn end(&mut self, completed: bool) -> Result<()> {
        self.run.notify.stopping();
        if completed {
            // A controller whose request the last tick did not need still sends it.
            let begun = Instant::now();
            // The gate that is not the active one looks whether all ticks are done.
            for doorbell in &self.doorbells {
                doorbell.notify();
            }
            let done = |s: &ProcessSlot| {
                s.child.is_none()
                    || s.process == Process::Recorder
                    || self.run.shared.heartbeats.read(s.process).phase == Some(Phase::Finished)
            };
            while !self.slots.iter().all(done) && begun.elapsed() < LAST_TICK_TIMEOUT {
                self.pause(FAST_POLL_INTERVAL);
            }
        }
        self.run.shared.orders.stop.store(true, Ordering::Release);
        if completed {
            // Their last messages lie in their own memory: the recorder drains them before the processes end.
            let begun = Instant::now();
            let page = self.run.recorder.page();
            let seen = page.rounds();
            while page.rounds() < seen + 2 && begun.elapsed() < LAST_TICK_TIMEOUT {
                self.pause(FAST_POLL_INTERVAL);
            }
        }
        let others = self.slots.iter_mut().filter(|slot| slot.process != Process::Recorder);
        let children: Vec<Child> = others.filter_map(|slot| slot.child.take()).collect();
        let killed = children::end(children)?;
        for process in killed.processes {
            self.fault(process.name(), "did not end on request, and was killed".to_owned(), Detector::Exit);
        }
        self.abandoned.extend(killed.abandoned);
        for child in std::mem::take(&mut self.abandoned).iter_mut() {
            if child.ended()?.is_none() {
                self.fault(
                    child.process.name(),
                    format!("is left behind: it does not end after SIGKILL ({})", child.remains()),
                    Detector::Exit,
                );
            }
        }
        Ok(())
    }
}
