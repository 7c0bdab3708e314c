//! The chains beside the stack's own, and the witnesses: started, heard, ended.

use super::stack::Found;
use anyhow::{Context, Result, bail, ensure};
use hapfic_config::{Placement, Settings};
use hapfic_diagnostics::{Core, Measured, Plan, TIMER};
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
pub(super) const OWN: &str = "bench-chain";

/// When in the period the chains begin, ns after the plant's timer. Two of the witness's periods: so it is as far away from the
/// stack's chain, which begins at 0, as from these. The plant has simulated by then.
const CHAIN_PHASE_NS: u64 = 500_000;
/// When in the period the timer at the plant's priority is due.
const TIMER_PHASE_NS: u64 = 850_000;
/// The witness: how often, and when after the plant's timer.
const WITNESS_EVERY_NS: u64 = 250_000;
const WITNESS_PHASE_NS: u64 = 190_000;
/// For how many more it stays than the measurement lasts, so that what makes the last ticks late is seen.
const WITNESS_LONGER: u64 = 400;
/// The witness tells only of what is later than this, ns.
const WITNESS_ABOVE_NS: u64 = 50_000;
/// How long a chain may take to hand its figures over after its last message.
const HAND_OVER: Duration = Duration::from_secs(30);

/// Cores and priorities of plant, controller and gate: places 0, 1 and 2.
#[derive(Clone, Debug)]
pub(super) struct Where {
    pub(super) cores: [Option<u32>; 3],
    /// Core of the stack's gate. The chains' third process is on that of the others unless the settings say where the gate is to be: who
    /// sleeps is woken soonest there.
    pub(super) gate: Option<u32>,
    pub(super) priorities: [u32; 3],
}

impl Where {
    /// As the settings say, and as was found in the run where they say nothing.
    pub(super) fn new(settings: &Settings, found: Found) -> Self {
        let rt = &settings.realtime;
        let shared = found.core.filter(|_| rt.placement == Placement::OneCore);
        Self {
            cores: [rt.core_plant, rt.core_controller, rt.core_gate].map(|core| core.or(shared)),
            gate: found.gate_core,
            priorities: [rt.priority_plant, rt.priority_controller, rt.priority_gate],
        }
    }

    /// The stack's cores, each once; `None` alone where any will do.
    pub(super) fn polled(&self) -> Vec<Option<u32>> {
        let mut cores: Vec<_> = [self.cores[0], self.cores[1], self.gate].into_iter().flatten().map(Some).collect();
        cores.sort_unstable();
        cores.dedup();
        if cores.is_empty() { vec![None] } else { cores }
    }
}

/// A kind of chain, and who has it; none: this program.
#[derive(Clone, Debug)]
pub(super) struct Contender {
    pub(super) program: Option<PathBuf>,
    pub(super) kind: String,
}

/// All kinds: this program's own, and those of its peers.
pub(super) fn contenders(peers: &[PathBuf]) -> Result<Vec<Contender>> {
    let own = hapfic_diagnostics::own().map(|kind| Contender { program: None, kind: kind.name().to_owned() });
    let mut all = Vec::from(own);
    for program in peers {
        let asked = Command::new(program).arg("kinds").stdin(Stdio::null()).stderr(Stdio::inherit()).output();
        let asked = asked.with_context(|| format!("--peers {}: cannot be started", program.display()))?;
        ensure!(asked.status.success(), "--peers {}: does not know `kinds`, expected one name a line", program.display());
        let text = String::from_utf8_lossy(&asked.stdout).into_owned();
        for kind in text.lines().map(str::trim).filter(|kind| !kind.is_empty()) {
            ensure!(
                kind != TIMER && all.iter().all(|other| other.kind != kind),
                "--peers {}: its kind '{kind}' is there already, expected another name",
                program.display()
            );
            all.push(Contender { program: Some(program.clone()), kind: kind.to_owned() });
        }
    }
    Ok(all)
}

/// Chains and witnesses at work; killed when dropped.
pub(super) struct Chains {
    drivers: Vec<Driver>,
    /// How many of them are chains; then come the timer and the witnesses.
    chains: usize,
    heard: Receiver<(usize, Option<String>)>,
}

struct Driver {
    name: String,
    child: Child,
    ready: bool,
    line: Option<String>,
}

/// What all of them have measured.
#[derive(Debug)]
pub(super) struct Heard {
    /// In the order of the contenders.
    pub(super) chains: Vec<Measured>,
    /// At the plant's priority.
    pub(super) timer: Measured,
    /// Just above it, on each core of the stack.
    pub(super) witnesses: Vec<Measured>,
}

/// When chain `i` of `n` sends: in tick k where k modulo n is i.
fn plans(kinds: &[Contender], place: &Where, start_ns: u64, seconds: u64) -> Vec<Plan> {
    let n = kinds.len() as u64;
    let plan = |kind: &str, start_ns: u64, period_ns: u64, cores: &[Option<u32>], priority: Vec<u32>, above_ns: u64| Plan {
        kind: kind.to_owned(),
        core: cores.iter().map(|core| Core(*core)).collect(),
        priority,
        start_ns,
        period_ns,
        count: seconds * 1_000_000_000 / period_ns,
        sizes: [size_of::<State>(), size_of::<Request>(), size_of::<CommandMessage>()].map(|bytes| bytes as u32).to_vec(),
        above_ns,
    };
    let priorities = place.priorities.to_vec();
    let mut plans: Vec<_> = (0..n)
        .zip(kinds)
        .map(|(i, c)| {
            plan(&c.kind, start_ns + i * PERIOD_NS + CHAIN_PHASE_NS, n * PERIOD_NS, &place.cores, priorities.clone(), 0)
        })
        .collect();
    plans.push(plan(TIMER, start_ns + TIMER_PHASE_NS, PERIOD_NS, &place.cores, priorities, 0));
    // Above the plant: whatever the stack does, only the machine can make it late.
    let above = vec![(place.priorities[0] + 1).min(98)];
    let witness = |core| {
        let plan = plan(TIMER, start_ns + WITNESS_PHASE_NS, WITNESS_EVERY_NS, &[core; 3], above.clone(), WITNESS_ABOVE_NS);
        Plan { count: plan.count + WITNESS_LONGER, ..plan }
    };
    plans.extend(place.polled().into_iter().map(witness));
    plans
}

impl Chains {
    /// Starts them all, to begin at `start_ns`. To be called on the main thread: they end with the thread that starts them.
    pub(super) fn start(kinds: &[Contender], place: &Where, start_ns: u64, seconds: u64) -> Result<Self> {
        let (tell, heard) = channel();
        let mut chains = Self { drivers: Vec::new(), chains: kinds.len(), heard };
        for (i, plan) in plans(kinds, place, start_ns, seconds).iter().enumerate() {
            let mut command = match kinds.get(i).and_then(|c| c.program.as_ref()) {
                Some(program) => Command::new(program),
                None => {
                    let mut command = this_program()?;
                    command.arg(OWN);
                    command
                }
            };
            let child = command.args(plan.words()).stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
            let mut child = child.with_context(|| format!("cannot start the chain {}", plan.kind))?;
            let out = child.stdout.take();
            chains.drivers.push(Driver { name: plan.kind.clone(), child, ready: false, line: None });
            let (out, tell) = (out.context("a chain has no output")?, tell.clone());
            std::thread::spawn(move || {
                for line in BufReader::new(out).lines().map_while(Result::ok) {
                    if tell.send((i, Some(line))).is_err() {
                        return;
                    }
                }
                // Nobody listens any more if the measurement has ended.
                let _ = tell.send((i, None));
            });
        }
        Ok(chains)
    }

    /// Waits until all are ready. Says whether `stop` was set meanwhile.
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
            self.hear(Duration::from_nanos(left).min(Duration::from_millis(50)))?;
        }
        Ok(false)
    }

    /// Takes in what one of them says, if one does.
    pub(super) fn hear(&mut self, patience: Duration) -> Result<()> {
        let (i, line) = match self.heard.recv_timeout(patience) {
            Ok(heard) => heard,
            Err(RecvTimeoutError::Timeout) => return Ok(()),
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(patience);
                return Ok(());
            }
        };
        let driver = &mut self.drivers[i];
        match line {
            Some(line) if !driver.ready => {
                ensure!(line.trim() == "ready", "{}: said '{line}', expected 'ready'", driver.name);
                driver.ready = true;
            }
            Some(line) => driver.line = Some(line),
            None => ensure!(driver.line.is_some(), "the chain {} has ended without figures", driver.name),
        }
        Ok(())
    }

    /// Waits for all figures. `None` if `stop` was set meanwhile.
    pub(super) fn finish(mut self, stop: &AtomicBool) -> Result<Option<Heard>> {
        let begun = Instant::now();
        while self.drivers.iter().any(|d| d.line.is_none()) {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            ensure!(begun.elapsed() < HAND_OVER, "not all chains have handed their figures over in {} s", HAND_OVER.as_secs());
            self.hear(Duration::from_millis(50))?;
        }
        let lines = self.drivers.iter().filter_map(|d| d.line.as_deref());
        let mut all = lines.map(Measured::parse).collect::<Result<Vec<_>, _>>()?;
        ensure!(all.len() > self.chains, "the witnesses have not said anything");
        let witnesses = all.split_off(self.chains + 1);
        let timer = all.pop().context("the timer has not said anything")?;
        Ok(Some(Heard { chains: all, timer, witnesses }))
    }
}

impl Drop for Chains {
    fn drop(&mut self) {
        for driver in &mut self.drivers {
            // Its relays end with it.
            let _ = driver.child.kill();
            let _ = driver.child.wait();
        }
    }
}

/// Privileges that a chain lacks.
pub(super) fn lacks(name: &str, measured: &Measured, place: &Where) -> Vec<String> {
    let mut list = Vec::new();
    for i in 0..measured.granted.len() {
        let granted = measured.granted(i);
        let mut lacking = Vec::new();
        if !granted.has(SchedGrants::FIFO) {
            lacking.push("not FIFO".to_owned());
        }
        if !granted.has(SchedGrants::LOCKED) {
            lacking.push("memory not locked".to_owned());
        }
        if let Some(core) = place.cores.get(i).copied().flatten().filter(|_| !granted.has(SchedGrants::PINNED)) {
            lacking.push(format!("NOT on core {core}"));
        }
        if !lacking.is_empty() {
            list.push(format!("{name}, place {i}: {}", lacking.join(", ")));
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_chains_send_in_the_same_tick_and_all_ticks_are_used() {
        let kinds: Vec<_> = ["a", "b", "c"].map(|kind| Contender { program: None, kind: kind.to_owned() }).into_iter().collect();
        let place = Where { cores: [Some(1), None, Some(1)], gate: Some(0), priorities: [80, 76, 78] };
        let plans = plans(&kinds, &place, 7_000_000_000, 3);
        let mut ticks: Vec<u64> = Vec::new();
        for plan in &plans[..3] {
            assert_eq!(plan.start_ns % PERIOD_NS, CHAIN_PHASE_NS);
            ticks.extend((0..plan.count).map(|i| (plan.start_ns + i * plan.period_ns) / PERIOD_NS));
        }
        ticks.sort_unstable();
        assert_eq!(ticks, (7000..10_000).collect::<Vec<_>>());
        assert_eq!((plans[3].count, plans.len()), (3000, 6));
        let until = |plan: &Plan| plan.start_ns + plan.count * plan.period_ns;
        assert!(plans[4..].iter().all(|witness| until(witness) > 10_000_000_000 + 50 * PERIOD_NS), "they stay longer");
        assert_eq!((plans[4].core[0], plans[5].core[0]), (Core(Some(0)), Core(Some(1))), "a witness on each core of the stack");
        assert!(plans[4].wishes().is_ok_and(|wishes| wishes[0].is_some_and(|w| w.priority == 81)));
    }

    #[test]
    fn what_was_not_granted_is_told_place_by_place() {
        let place = Where { cores: [Some(1); 3], gate: Some(1), priorities: [80, 76, 78] };
        let measured = Measured { kind: "x".to_owned(), hops: 3, count: 0, granted: vec![7, 3, 4], samples: Vec::new() };
        assert_eq!(lacks("x", &measured, &place), ["x, place 1: NOT on core 1", "x, place 2: not FIFO, memory not locked"]);
    }
}
