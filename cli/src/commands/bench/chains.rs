//! The chains of the comparison and the reference timers: start, reception of their results, end.

use super::stack::RunTiming;
use anyhow::{Context, Result, bail, ensure};
use hapfic_config::{Placement, Settings};
use hapfic_diagnostics::{ChainMeasurement, Core, MeasurementPlan, TIMER};
use hapfic_ipc::realtime::SchedGrants;
use hapfic_messages::{Command as CommandMessage, PERIOD_NS, Request, State};
use hapfic_supervisor::children::this_program;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// The hidden command that drives a chain of this program's own.
pub(super) const CHAIN_COMMAND: &str = "bench-chain";

/// Start of the chains after the plant's timer, in each period [ns].
///
/// Two periods of the reference timer, so that this timer is equally far from the stack's chain, which begins at 0, and
/// from these chains. By then the plant has simulated the tick.
const CHAIN_PHASE_NS: u64 = 500_000;
/// Due time of the timer at the plant's priority, after the plant's timer [ns].
const TIMER_PHASE_NS: u64 = 850_000;
/// Period of the reference timer, and its first due time after the plant's timer [ns].
const REFERENCE_PERIOD_NS: u64 = 250_000;
const REFERENCE_PHASE_NS: u64 = 190_000;
/// Periods of the reference timer after the measurement, so that it covers the late last ticks.
const REFERENCE_EXTRA_PERIODS: u64 = 400;
/// Lateness above which the reference timer reports a sample [ns].
const REFERENCE_ABOVE_NS: u64 = 50_000;
/// Time a chain may take to report its results after its last message.
const REPORT_TIMEOUT: Duration = Duration::from_secs(30);

/// Cores and priorities of plant, controller and gate, at the indices 0, 1 and 2.
#[derive(Clone, Debug)]
pub(super) struct ThreadPlacement {
    pub(super) cores: [Option<u32>; 3],
    /// Core of the stack's gate.
    ///
    /// The chains' third process is on the core of the others unless the settings assign one to the gate: the wake-up
    /// of a sleeping process is fastest there.
    pub(super) gate: Option<u32>,
    pub(super) priorities: [u32; 3],
}

impl ThreadPlacement {
    /// Takes the cores from the settings, and from the run where the settings assign none.
    pub(super) fn new(settings: &Settings, found: RunTiming) -> Self {
        let rt = &settings.realtime;
        let shared = found.core.filter(|_| rt.placement == Placement::OneCore);
        Self {
            cores: [rt.core_plant, rt.core_controller, rt.core_gate].map(|core| core.or(shared)),
            gate: found.gate_core,
            priorities: [rt.priority_plant, rt.priority_controller, rt.priority_gate],
        }
    }

    /// The stack's cores, each once; a single `None` if the stack may use any.
    pub(super) fn distinct_cores(&self) -> Vec<Option<u32>> {
        let mut cores: Vec<_> = [self.cores[0], self.cores[1], self.gate].into_iter().flatten().map(Some).collect();
        cores.sort_unstable();
        cores.dedup();
        if cores.is_empty() { vec![None] } else { cores }
    }
}

/// Kind of a chain, and the program that has it; `None`: this program.
#[derive(Clone, Debug)]
pub(super) struct ChainKind {
    pub(super) program: Option<PathBuf>,
    pub(super) kind: String,
}

/// Lists all kinds: this program's own, and those of its peers.
pub(super) fn chain_kinds(peers: &[PathBuf]) -> Result<Vec<ChainKind>> {
    let own = hapfic_diagnostics::kernel_kinds().map(|kind| ChainKind { program: None, kind: kind.name().to_owned() });
    let mut all = Vec::from(own);
    for program in peers {
        let output = Command::new(program).arg("kinds").stdin(Stdio::null()).stderr(Stdio::inherit()).output();
        let output = output.with_context(|| format!("--peers {}: cannot be started", program.display()))?;
        ensure!(output.status.success(), "--peers {}: `kinds` has failed, expected one name a line", program.display());
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        for kind in text.lines().map(str::trim).filter(|kind| !kind.is_empty()) {
            ensure!(
                kind != TIMER && all.iter().all(|other| other.kind != kind),
                "--peers {}: found the kind '{kind}' twice, expected another name",
                program.display()
            );
            all.push(ChainKind { program: Some(program.clone()), kind: kind.to_owned() });
        }
    }
    Ok(all)
}

/// Running chains and reference timers; killed when dropped.
pub(super) struct Chains {
    drivers: Vec<Driver>,
    /// Number of chains among the drivers; the timer and the reference timers follow.
    chains: usize,
    lines: Receiver<(usize, Option<String>)>,
}

struct Driver {
    name: String,
    child: Child,
    ready: bool,
    line: Option<String>,
}

/// Results of all chains and timers.
#[derive(Debug)]
pub(super) struct ChainResults {
    /// Chains in the order of their kinds.
    pub(super) chains: Vec<ChainMeasurement>,
    /// Timer at the plant's priority.
    pub(super) timer: ChainMeasurement,
    /// Reference timers above that priority, on each core of the stack.
    pub(super) reference_timers: Vec<ChainMeasurement>,
}

/// Plans all chains and timers: chain `i` of `n` sends in the ticks k with k modulo n = i.
fn plans(kinds: &[ChainKind], placement: &ThreadPlacement, start_ns: u64, seconds: u64) -> Vec<MeasurementPlan> {
    let n = kinds.len() as u64;
    let plan = |kind: &str, start_ns, period_ns, cores: &[Option<u32>], priority, above_ns| MeasurementPlan {
        kind: kind.to_owned(),
        core: cores.iter().map(|core| Core(*core)).collect(),
        priority,
        start_ns,
        period_ns,
        count: seconds * 1_000_000_000 / period_ns,
        sizes: [size_of::<State>(), size_of::<Request>(), size_of::<CommandMessage>()].map(|bytes| bytes as u32).to_vec(),
        above_ns,
    };
    let priorities = placement.priorities.to_vec();
    let mut plans: Vec<_> = (0..n)
        .zip(kinds)
        .map(|(i, c)| {
            plan(&c.kind, start_ns + i * PERIOD_NS + CHAIN_PHASE_NS, n * PERIOD_NS, &placement.cores, priorities.clone(), 0)
        })
        .collect();
    plans.push(plan(TIMER, start_ns + TIMER_PHASE_NS, PERIOD_NS, &placement.cores, priorities, 0));
    // Above the plant's priority only the machine can delay the reference timer, not the stack.
    let above = vec![(placement.priorities[0] + 1).min(98)];
    let reference = |core| {
        let phase_ns = start_ns + REFERENCE_PHASE_NS;
        let plan = plan(TIMER, phase_ns, REFERENCE_PERIOD_NS, &[core; 3], above.clone(), REFERENCE_ABOVE_NS);
        MeasurementPlan { count: plan.count + REFERENCE_EXTRA_PERIODS, ..plan }
    };
    plans.extend(placement.distinct_cores().into_iter().map(reference));
    plans
}

impl Chains {
    /// Starts all chains and timers, to begin at `start_ns`. Only for the main thread: they end with their parent
    /// thread.
    pub(super) fn start(kinds: &[ChainKind], placement: &ThreadPlacement, start_ns: u64, seconds: u64) -> Result<Self> {
        let (sender, lines) = channel();
        let mut chains = Self { drivers: Vec::new(), chains: kinds.len(), lines };
        for (i, plan) in plans(kinds, placement, start_ns, seconds).iter().enumerate() {
            let mut command = match kinds.get(i).and_then(|c| c.program.as_ref()) {
                Some(program) => Command::new(program),
                None => {
                    let mut command = this_program()?;
                    command.arg(CHAIN_COMMAND);
                    command
                }
            };
            let child = command.args(plan.arguments()).stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
            let mut child = child.with_context(|| format!("cannot start the chain {}", plan.kind))?;
            let out = child.stdout.take();
            chains.drivers.push(Driver { name: plan.kind.clone(), child, ready: false, line: None });
            let (out, sender) = (out.context("a chain has no output")?, sender.clone());
            std::thread::spawn(move || {
                for line in BufReader::new(out).lines().map_while(Result::ok) {
                    if sender.send((i, Some(line))).is_err() {
                        return;
                    }
                }
                // Fails only after the measurement has ended.
                let _ = sender.send((i, None));
            });
        }
        Ok(chains)
    }

    /// Waits until all are ready; returns whether `stop` was set meanwhile.
    pub(super) fn ready(&mut self, until_ns: u64, stop: &AtomicBool) -> Result<bool> {
        while self.drivers.iter().any(|d| !d.ready) {
            let left = until_ns.saturating_sub(hapfic_ipc::clock::now_ns());
            if left == 0 {
                let late: Vec<_> = self.drivers.iter().filter(|d| !d.ready).map(|d| d.name.as_str()).collect();
                bail!("{}: not ready in time, expected it before the measurement begins", late.join(", "));
            }
            if stop.load(Ordering::Relaxed) {
                return Ok(true);
            }
            self.receive(Duration::from_nanos(left).min(Duration::from_millis(50)))?;
        }
        Ok(false)
    }

    /// Receives a line of one of them, or waits for `timeout`.
    pub(super) fn receive(&mut self, timeout: Duration) -> Result<()> {
        let (i, line) = match self.lines.recv_timeout(timeout) {
            Ok(line) => line,
            Err(RecvTimeoutError::Timeout) => return Ok(()),
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(timeout);
                return Ok(());
            }
        };
        let driver = &mut self.drivers[i];
        match line {
            Some(line) if !driver.ready => {
                ensure!(line.trim() == "ready", "{}: found the line '{line}', expected 'ready'", driver.name);
                driver.ready = true;
            }
            Some(line) => driver.line = Some(line),
            None => ensure!(driver.line.is_some(), "the chain {} has ended without results", driver.name),
        }
        Ok(())
    }

    /// Waits for all results; `None` if `stop` was set meanwhile.
    pub(super) fn finish(mut self, stop: &AtomicBool) -> Result<Option<ChainResults>> {
        let begun = Instant::now();
        while self.drivers.iter().any(|d| d.line.is_none()) {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let timeout_s = REPORT_TIMEOUT.as_secs();
            ensure!(begun.elapsed() < REPORT_TIMEOUT, "not all chains have reported their results in {timeout_s} s");
            self.receive(Duration::from_millis(50))?;
        }
        let lines = self.drivers.iter().filter_map(|d| d.line.as_deref());
        let mut all = lines.map(ChainMeasurement::parse).collect::<Result<Vec<_>, _>>()?;
        ensure!(all.len() > self.chains, "the reference timers have reported nothing");
        let reference_timers = all.split_off(self.chains + 1);
        let timer = all.pop().context("the timer has reported nothing")?;
        Ok(Some(ChainResults { chains: all, timer, reference_timers }))
    }
}

impl Drop for Chains {
    fn drop(&mut self) {
        for driver in &mut self.drivers {
            // The relays of a driver end with it.
            let _ = driver.child.kill();
            let _ = driver.child.wait();
        }
    }
}

/// Lists the privileges that a chain lacks.
pub(super) fn missing_privileges(name: &str, measured: &ChainMeasurement, placement: &ThreadPlacement) -> Vec<String> {
    let mut list = Vec::new();
    for i in 0..measured.granted.len() {
        let granted = measured.granted(i);
        let mut missing = Vec::new();
        if !granted.has(SchedGrants::FIFO) {
            missing.push("not FIFO".to_owned());
        }
        if !granted.has(SchedGrants::LOCKED) {
            missing.push("memory not locked".to_owned());
        }
        if let Some(core) = placement.cores.get(i).copied().flatten().filter(|_| !granted.has(SchedGrants::PINNED)) {
            missing.push(format!("NOT on core {core}"));
        }
        if !missing.is_empty() {
            list.push(format!("{name}, process {i}: {}", missing.join(", ")));
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_several_chains_share_all_ticks() {
        let kinds: Vec<_> = ["a", "b", "c"].map(|kind| ChainKind { program: None, kind: kind.to_owned() }).into_iter().collect();
        let placement = ThreadPlacement { cores: [Some(1), None, Some(1)], gate: Some(0), priorities: [80, 76, 78] };
        let plans = plans(&kinds, &placement, 7_000_000_000, 3);
        let mut ticks: Vec<u64> = Vec::new();
        for plan in &plans[..3] {
            assert_eq!(plan.start_ns % PERIOD_NS, CHAIN_PHASE_NS);
            ticks.extend((0..plan.count).map(|i| (plan.start_ns + i * plan.period_ns) / PERIOD_NS));
        }
        ticks.sort_unstable();
        assert_eq!(ticks, (7000..10_000).collect::<Vec<_>>());
        assert_eq!((plans[3].count, plans.len()), (3000, 6));
        let until = |plan: &MeasurementPlan| plan.start_ns + plan.count * plan.period_ns;
        assert!(plans[4..].iter().all(|timer| until(timer) > 10_000_000_000 + 50 * PERIOD_NS), "timers outlast the measurement");
        assert_eq!((plans[4].core[0], plans[5].core[0]), (Core(Some(0)), Core(Some(1))), "a timer on each core of the stack");
        assert!(plans[4].sched_requests().is_ok_and(|requests| requests[0].is_some_and(|w| w.priority == 81)));
    }

    #[test]
    fn missing_privileges_are_listed_by_process() {
        let placement = ThreadPlacement { cores: [Some(1); 3], gate: Some(1), priorities: [80, 76, 78] };
        let measured = ChainMeasurement { kind: "x".to_owned(), hops: 3, count: 0, granted: vec![7, 3, 4], samples: Vec::new() };
        assert_eq!(
            missing_privileges("x", &measured, &placement),
            ["x, process 1: NOT on core 1", "x, process 2: not FIFO, memory not locked"]
        );
    }
}
