//! Restart of a lost process: event, hand-over, start and rejoining, or a latched stop after its budget is spent.

use super::clean_up::CleanUpState;
use super::slot::{DetectorLimits, ProcessSlot};
use super::{FAST_POLL_INTERVAL, WATCH_PRIORITY, Watch, bit};
use crate::children::{self, Child};
use crate::preflight;
use anyhow::Result;
use hapfic_config::OnLoss;
use hapfic_gate::protocol::ControllerSlot;
use hapfic_gate::restart_policy::{RestartAction, RestartPolicy, RestartSignal, RestartStage};
use hapfic_ipc::realtime::{self, SchedGrants};
use hapfic_ipc::{IpcError, ProcessStart, topic};
use hapfic_messages::{Clock, Detector, EventKind, Process};
use std::process::Stdio;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Rejected requests in a row after which a controller counts as lost.
const REJECTED_LIMIT: u32 = 20;
/// Priority of a starting process until it sets its own: below all ticking processes.
const JOINING_PRIORITY: u32 = 10;
/// Dead nodes above which the clean-up does not wait for a starting process.
const MAX_DEAD_NODES: u32 = 3;
/// Time that a start waits for the clean-up if there are more.
const CROWDED_TIMEOUT: Duration = Duration::from_millis(200);

impl Watch<'_> {
    /// Checks every process and performs its restart actions; `false` if the run must end.
    pub(super) fn check_processes(&mut self) -> Result<bool> {
        let supervisor = &self.run.settings.supervisor;
        let limits = DetectorLimits {
            ready_ns: u64::from(supervisor.ready_timeout_ms) * 1_000_000,
            silence_ns: self.silence_limit_ns(),
            behind: (self.run.clock == Clock::Realtime).then_some(i64::from(supervisor.tick_timeout_ms)),
        };
        for index in 0..self.slots.len() {
            let slot = &mut self.slots[index];
            let process = slot.process;
            if let Some((detector, what)) = slot.check(&self.run.shared, &self.evidence, &limits)?
                && !self.on_lost(process, detector, &what)?
            {
                return Ok(false);
            }
        }
        if !self.run.shared.orders.start.load(Ordering::Relaxed) {
            return Ok(true);
        }
        for slot in ControllerSlot::BOTH {
            let rejected = &self.run.shared.gate.rejected_requests[slot as usize];
            if rejected.load(Ordering::Relaxed) >= REJECTED_LIMIT {
                rejected.store(0, Ordering::Relaxed);
                let what = format!("has sent rejected requests {REJECTED_LIMIT} ticks in a row");
                if !self.on_lost(slot.process(), Detector::Check, &what)? {
                    return Ok(false);
                }
            }
        }
        self.update_primary();
        self.receive_latest()?;
        let rearms = self.run.shared.orders.rearms.load(Ordering::Acquire);
        if rearms != std::mem::replace(&mut self.rearms, rearms) {
            self.stopped_by_budget = false;
            self.faults.retain(|fault| fault.detector != Detector::Budget);
            self.keep_faults();
            for index in 0..self.slots.len() {
                if self.slots[index].process != Process::Recorder || self.run.recorder.can_resume() {
                    self.advance(index, RestartSignal::Rearmed)?;
                }
            }
        }
        for index in 0..self.slots.len() {
            let signal = if self.slots[index].ticks(&self.run.shared) { RestartSignal::Ticked } else { RestartSignal::Time };
            self.advance(index, signal)?;
            self.report_rejected(index);
        }
        self.reconnect_all()?;
        if self.run.shared.operator.cleanup_requested.swap(false, Ordering::AcqRel) {
            self.clean_up()?;
        }
        self.poll_clean_up();
        self.reap_abandoned()?;
        // Clean-up takes milliseconds and delays starting processes, so it waits for them; topics hold some dead nodes.
        let joining = self.slots.iter().any(ProcessSlot::joining);
        if self.dead_nodes.count > MAX_DEAD_NODES || (self.dead_nodes.count > 0 && !joining) {
            self.clean_up()?;
        }
        Ok(true)
    }

    /// Cleans up dead nodes and forces all ports to reconnect after a failed connection.
    ///
    /// A connection fails if a process is killed or preempted for too long while it makes the connection.
    fn reconnect_all(&mut self) -> Result<()> {
        let own = hapfic_ipc::failed_connections();
        let mut more = own > self.dead_nodes.own_failed && !self.dead_nodes.reconnect_due;
        for slot in &mut self.slots {
            let failed_connections = self.run.shared.heartbeats.read(slot.process).failed_connections;
            more |= failed_connections > std::mem::replace(&mut slot.failed_connections, failed_connections);
        }
        if !more {
            return Ok(());
        }
        self.dead_nodes.reconnect_due = true;
        self.clean_up()
    }

    /// Follows the helper process of the clean-up, and reconnects all ports after it if that is due.
    fn poll_clean_up(&mut self) -> CleanUpState {
        let state = self.dead_nodes.helper.poll(self.run.run_file, self.helper_priority());
        if let CleanUpState::Failed(text) = &state {
            self.note(Process::Supervisor, EventKind::Note, Detector::None, text);
        }
        if state != CleanUpState::Running && std::mem::take(&mut self.dead_nodes.reconnect_due) {
            let reconnected = self.force_reconnect_all();
            // Its ports for this count, too.
            self.dead_nodes.own_failed = hapfic_ipc::failed_connections();
            let text = match reconnected {
                Ok(()) => "a connection failed: all ports reconnect".to_owned(),
                // The ports that have failed count again at their next attempt.
                Err(e) => format!("a connection failed, and a topic cannot be joined to repair it: {e}"),
            };
            self.note(Process::Supervisor, EventKind::Note, Detector::None, &text);
        }
        state
    }

    fn force_reconnect_all(&self) -> Result<(), IpcError> {
        self.run.bus.force_reconnect(&topic::STATE)?;
        self.run.bus.force_reconnect(&topic::REFERENCE)?;
        self.run.bus.force_reconnect(&topic::REQUEST)?;
        self.run.bus.force_reconnect(&topic::COMMAND)?;
        self.run.bus.force_reconnect(&topic::OPERATOR)?;
        self.run.bus.force_reconnect(&topic::EVENT)?;
        self.run.bus.force_reconnect(&topic::TIMING)?;
        self.run.bus.force_reconnect(&topic::CREDIT)?;
        self.run.bus.force_reconnect(&topic::INJECTION)
    }

    /// Requests the removal of dead nodes.
    fn clean_up(&mut self) -> Result<()> {
        let crowded = self.dead_nodes.count > MAX_DEAD_NODES;
        self.dead_nodes.count = 0;
        self.dead_nodes.helper.request();
        let begun = Instant::now();
        // Without room for another node the next process could not start.
        while self.poll_clean_up() == CleanUpState::Running && crowded && begun.elapsed() < CROWDED_TIMEOUT {
            std::thread::sleep(FAST_POLL_INTERVAL);
        }
        Ok(())
    }

    /// Returns the priority of helper processes: that of the main thread, if the gate has real-time privileges.
    fn helper_priority(&self) -> Option<u32> {
        (self.run.clock == Clock::Realtime && self.gates_are_realtime()).then_some(WATCH_PRIORITY)
    }

    /// Whether a gate has real-time priority: then the others have, too.
    pub(super) fn gates_are_realtime(&self) -> bool {
        let granted = |gate| SchedGrants(self.run.shared.heartbeats.read(gate).realtime).has(SchedGrants::FIFO);
        granted(Process::Gate) || granted(Process::SpareGate)
    }

    /// Forgets abandoned processes that have ended after all.
    fn reap_abandoned(&mut self) -> Result<()> {
        for index in (0..self.abandoned.len()).rev() {
            if self.abandoned[index].ended()?.is_some() {
                self.abandoned.swap_remove(index);
                // Their nodes have died now.
                self.dead_nodes.count += 1;
            }
        }
        Ok(())
    }

    fn policy(&self) -> RestartPolicy {
        let supervisor = &self.run.settings.supervisor;
        RestartPolicy {
            budget: supervisor.restart_budget,
            window_ms: supervisor.restart_window_ms.into(),
            backoff_ms: supervisor.restart_backoff_ms.into(),
        }
    }

    /// Returns the time of the restart states [ms].
    fn now_ms(&self) -> u64 {
        self.begun.elapsed().as_millis() as u64
    }

    /// Handles the loss of a process; `false` if the run must end.
    pub(super) fn on_lost(&mut self, process: Process, detector: Detector, what: &str) -> Result<bool> {
        let Some(index) = self.slots.iter().position(|s| s.process == process) else { return Ok(true) };
        self.dead_nodes.segments.process_lost();
        // Precedes the other steps, so that the gate stops waiting for the process.
        self.run.shared.presence.present.fetch_and(!bit(process), Ordering::AcqRel);
        let fatal = match process {
            _ if !self.run.shared.orders.start.load(Ordering::Relaxed) => true,
            Process::Plant => self.run.settings.plant.on_loss == OnLoss::Fail,
            _ => false,
        };
        if fatal {
            self.fault(process.name(), what.to_owned(), detector);
            return Ok(false);
        }
        if process != Process::Recorder {
            self.run.shared.presence.missing.fetch_or(bit(process), Ordering::AcqRel);
        }
        self.hand_over_gate(process);
        for doorbell in &self.doorbells {
            doorbell.notify();
        }
        let slot = &mut self.slots[index];
        slot.lost = Some(Instant::now());
        slot.losses += 1;
        let record = self.run.record.process(process);
        record.losses.store(slot.losses, Ordering::Relaxed);
        // What runs without a record ends with its supervisor's successor.
        record.set_pid(None);
        // The process may still run, or have started others.
        let abandoned = slot.child.take().map(children::kill).transpose()?.flatten();
        self.note(process, EventKind::Lost, detector, &format!("{process} {what}"));
        if let Some(child) = abandoned {
            // Its successor starts beside it: SIGKILL ends the process before it runs another instruction.
            let text = format!("{process} is abandoned: it does not end after SIGKILL ({})", child.remains());
            self.note(process, EventKind::Note, detector, &text);
            self.abandoned.push(child);
        }
        if process == Process::Recorder && !self.run.recorder.can_resume() {
            self.slots[index].restart.stage = RestartStage::BudgetSpent;
            return self.recorder_given_up("was lost, and its log is a pipe or a device, which has no parts");
        }
        self.advance(index, RestartSignal::Lost)?;
        if process == Process::Recorder && self.slots[index].restart.stage == RestartStage::BudgetSpent {
            return self.recorder_given_up(&self.budget_spent());
        }
        // In lockstep the clock would wait forever; without a plant no tick is left in which the gate could stop.
        if self.stopped_by_budget && (self.run.clock == Clock::Lockstep || process == Process::Plant) {
            return Ok(false);
        }
        self.advance(index, RestartSignal::Time)?;
        Ok(true)
    }

    /// Makes the other gate the active one if the active one is lost, and the other is there.
    fn hand_over_gate(&self, lost: Process) {
        let other = match lost {
            Process::Gate => Process::SpareGate,
            Process::SpareGate => Process::Gate,
            _ => return,
        };
        let present = self.run.shared.presence.present.load(Ordering::Acquire);
        if self.run.gates.active() == lost && present & bit(other) != 0 {
            self.run.gates.set_active(other);
        }
    }

    /// Advances the restart state of a slot and performs the resulting action.
    fn advance(&mut self, index: usize, signal: RestartSignal) -> Result<()> {
        let (policy, now) = (self.policy(), self.now_ms());
        let slot = &mut self.slots[index];
        let (restart, action) = std::mem::take(&mut slot.restart).after(signal, now, &policy);
        slot.restart = restart;
        match action {
            Some(RestartAction::Start) => self.restart(index),
            // The caller handles it: no tick depends on the recorder.
            Some(RestartAction::Stop) if self.slots[index].process == Process::Recorder => Ok(()),
            Some(RestartAction::Stop) => {
                self.trip_latched_stop(index);
                Ok(())
            }
            Some(RestartAction::MarkReady) => self.mark_ready(index),
            None => Ok(()),
        }
    }

    fn restart(&mut self, index: usize) -> Result<()> {
        let process = self.slots[index].process;
        let prioritise = self.run.clock == Clock::Realtime && self.gates_are_realtime();
        let slot = &mut self.slots[index];
        slot.generation += 1;
        slot.started_observed_ns = self.evidence.observed_ns();
        slot.suspicion = None;
        (slot.rejected, slot.failed_connections) = (0, 0);
        slot.kill_pending = false;
        self.run.shared.heartbeats.expect(process, slot.generation);
        self.run.record.process(process).generation.store(slot.generation, Ordering::Release);
        self.run.record.process(process).given_up.store(0, Ordering::Relaxed);
        let start = ProcessStart { generation: slot.generation };
        let started = match process {
            Process::Recorder => self.run.recorder.start(start),
            _ => Child::start(process, self.run.settings, self.run.run_file, start, Stdio::null()),
        };
        let child = match started {
            Ok(child) => child,
            // Out of memory or processes: handled like a process that ends immediately.
            Err(e) => {
                self.note(process, EventKind::Lost, Detector::Exit, &format!("{process} cannot be started: {e:#}"));
                return self.advance(index, RestartSignal::Lost);
            }
        };
        if process != Process::Recorder && prioritise {
            prioritise_joining(&child, self.run.cores.reserve);
        }
        self.run.record.process(process).set_pid(Some(child.pid().as_raw_nonzero().get()));
        slot.child = Some(child);
        let (number, waited) = (slot.restart.restarts(), slot.lost.map_or(0, |lost| lost.elapsed().as_millis()));
        let text = format!("{process} restarts {waited} ms after the detected loss (number {number} of its budget)");
        self.note(process, EventKind::Restarted, Detector::None, &text);
        self.dead_nodes.count += 1;
        Ok(())
    }

    fn mark_ready(&mut self, index: usize) -> Result<()> {
        let slot = &mut self.slots[index];
        let (process, generation) = (slot.process, slot.generation);
        let out = slot.lost.take().map_or(Duration::ZERO, |lost| lost.elapsed());
        slot.longest = slot.longest.max(out);
        self.run.record.process(process).longest_ns.store(slot.longest.as_nanos() as u64, Ordering::Relaxed);
        // The first gate has the core on which it may poll.
        let other_gate_lost = process == Process::SpareGate && self.run.shared.presence.is_missing(Process::Gate);
        let becomes_active = generation > 0 && (process == Process::Gate || other_gate_lost);
        if becomes_active {
            self.run.gates.set_active(process);
        }
        self.run.shared.presence.missing.fetch_and(!bit(process), Ordering::AcqRel);
        // Last: a successor of this supervisor takes a present process for one that has joined.
        self.run.shared.presence.present.fetch_or(bit(process), Ordering::AcqRel);
        if generation > 0 {
            if let Err(e) = preflight::reserve_segments(&self.run.prefix) {
                self.note(process, EventKind::Note, Detector::None, &format!("{e:#}"));
            }
            if becomes_active {
                for doorbell in &self.doorbells {
                    doorbell.notify();
                }
            }
            self.swap_roles();
            let what = if process == Process::Recorder { "records" } else { "does ticks" };
            let text = format!("{process} {what} again, {:.1} ms after the detected loss", out.as_secs_f64() * 1e3);
            self.note(process, EventKind::Joined, Detector::None, &text);
            self.injections.republish(process, self.run.shared.gate.tick.load(Ordering::Acquire))?;
        }
        Ok(())
    }

    /// Swaps priorities and cores of the controllers after the gate has changed the primary.
    pub(super) fn update_primary(&mut self) {
        let primary = self.run.shared.gate.primary.load(Ordering::Relaxed);
        if std::mem::replace(&mut self.primary, primary) != primary {
            self.swap_roles();
        }
    }

    /// Gives the primary controller the higher priority and the shared core, the standby the other core.
    ///
    /// A starting controller keeps its priority and core until it does ticks.
    pub(super) fn swap_roles(&mut self) {
        if self.run.clock == Clock::Lockstep {
            return;
        }
        let primary = self.run.shared.gate.primary.load(Ordering::Relaxed);
        let present = self.run.shared.presence.present.load(Ordering::Acquire);
        let controllers = self.slots.iter().filter(|s| matches!(s.process, Process::Controller | Process::Standby));
        for slot in controllers.filter(|s| present & bit(s.process) != 0) {
            let first = slot.process.code() == primary;
            let realtime = &self.run.settings.realtime;
            let priority = realtime.priority_controller - u32::from(!first);
            let core = if first {
                realtime.core_controller.or(self.run.cores.shared)
            } else {
                realtime.core_standby.or(self.run.cores.reserve)
            };
            let Some(child) = &slot.child else { continue };
            let granted = SchedGrants(self.run.shared.heartbeats.read(slot.process).realtime);
            // Both calls fail only if the controller has just ended.
            if granted.has(SchedGrants::FIFO) {
                let _ = realtime::set_priority_of(child.pid(), priority);
            }
            if let Some(core) = core.filter(|_| granted.has(SchedGrants::PINNED)) {
                let _ = realtime::pin(Some(child.pid()), core as usize);
            }
        }
    }

    fn trip_latched_stop(&mut self, index: usize) {
        let process = self.slots[index].process;
        self.stopped_by_budget = true;
        self.run.record.process(process).given_up.store(1, Ordering::Relaxed);
        self.run.shared.orders.stop_latched(Detector::Budget);
        let what = self.budget_spent();
        self.fault(process.name(), what.clone(), Detector::Budget);
        if self.run.clock == Clock::Realtime && process != Process::Plant {
            crate::log_line(&format!(
                "hapfic: LATCHED STOP: {process} {what}. The drive brakes. Hint: `hapfic rearm` tries again, \
                 `hapfic stop` ends the run"
            ));
        }
    }

    /// Describes a process that was lost once more than its budget allows.
    fn budget_spent(&self) -> String {
        let budget = self.run.settings.supervisor.restart_budget;
        let window_s = f64::from(self.run.settings.supervisor.restart_window_ms) * 1e-3;
        format!("was lost once more after {budget} restarts within {window_s} s: it does not restart")
    }

    /// Receives the latest messages, for operators and for the progress line.
    ///
    /// # Errors
    /// If a connection is damaged.
    pub fn receive_latest(&mut self) -> Result<()> {
        self.inputs.receive()?;
        if let Some(sets) = self.inputs.operator() {
            self.run.latest.set_operator(sets);
        }
        if let Some((state, reference)) = self.inputs.newest() {
            self.run.latest.update(state, reference);
        }
        Ok(())
    }

    /// Reports the messages that a process has rejected since the last report.
    fn report_rejected(&mut self, index: usize) {
        let slot: &mut ProcessSlot = &mut self.slots[index];
        let process = slot.process;
        let now = self.run.shared.heartbeats.read(process).rejected;
        let before = std::mem::replace(&mut slot.rejected, now);
        if now > before {
            let text = format!("{process} has rejected {} messages", now - before);
            self.note(process, EventKind::Rejected, Detector::Check, &text);
        }
    }
}

/// Puts a starting process on the reserve core, with a priority above all non-real-time processes.
///
/// A port that connects to the process waits until it has made the connection. Preempted midway on the core of a
/// waiting real-time thread, the process could not continue: gate waits of 15 ms were measured.
fn prioritise_joining(child: &Child, core: Option<u32>) {
    // Both calls fail only if the process has already ended.
    if let Some(core) = core {
        let _ = realtime::pin(Some(child.pid()), core as usize);
    }
    let _ = realtime::set_priority_of(child.pid(), JOINING_PRIORITY);
}
