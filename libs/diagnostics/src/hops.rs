//! The stack's own chain, split by hop: from the stamps that each process logs at each tick.

use crate::distribution::{ChainQuantiles, Distribution};
use serde::Serialize;

/// What a process says of a tick, ns of `CLOCK_MONOTONIC`; 0 for what did not happen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stamps {
    /// When what started the tick was written (plant: when its timer was due).
    pub due_ns: u64,
    /// When it woke up.
    pub wake_ns: u64,
    /// When it had published.
    pub publish_ns: u64,
    /// Plant: from state published to command received.
    pub latency_ns: u64,
}

impl Stamps {
    /// From waking up to having published, ns; `None` if one is not known.
    #[must_use]
    pub fn took_ns(&self) -> Option<u64> {
        (self.wake_ns > 0 && self.publish_ns > 0).then(|| self.publish_ns.saturating_sub(self.wake_ns))
    }
}

/// Everybody's stamps of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TickStamps {
    /// The plant's.
    pub plant: Stamps,
    /// Of the controller whose request counted.
    pub controller: Stamps,
    /// The gate's.
    pub gate: Stamps,
}

/// The parts of the stack's chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// How late the plant's timer was.
    PlantTimer,
    /// Plant awake -> it writes its state: the sensors are read.
    PlantSample,
    /// The state is written.
    StateWritten,
    /// State published -> controller awake.
    ControllerWakes,
    /// Controller awake -> request published.
    ControllerWorks,
    /// Request published -> gate awake.
    GateWakes,
    /// Gate awake -> command published.
    GateWorks,
    /// Command published -> plant has it.
    PlantWakes,
}

impl Part {
    /// In the order of time.
    pub const ALL: [Self; 8] = [
        Self::PlantTimer,
        Self::PlantSample,
        Self::StateWritten,
        Self::ControllerWakes,
        Self::ControllerWorks,
        Self::GateWakes,
        Self::GateWorks,
        Self::PlantWakes,
    ];

    /// What it is, in words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PlantTimer => "timer due -> plant awake",
            Self::PlantSample => "plant: reads its sensors",
            Self::StateWritten => "plant: writes the state",
            Self::ControllerWakes => "state -> controller awake",
            Self::ControllerWorks => "controller: computes and publishes",
            Self::GateWakes => "request -> gate awake",
            Self::GateWorks => "gate: checks and publishes",
            Self::PlantWakes => "command -> plant has it",
        }
    }
}

/// The stack's chain, measured.
#[derive(Clone, Debug, Default)]
pub struct Hops {
    parts: [Distribution; Part::ALL.len()],
    /// State about to be written -> plant has the command: what the other chains measure, too.
    pub chain: Distribution,
    /// State published -> plant has the command: what a run's own summary calls latency is this less the last hop.
    pub published: Distribution,
    /// Ticks whose command was published after the plant had stopped waiting for it. They are in [`chain`](Self::chain) with the
    /// time at which it was published.
    pub late: u64,
}

/// A part and its durations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PartQuantiles {
    /// Which.
    pub part: Part,
    /// How long, us.
    #[serde(flatten)]
    pub quantiles: ChainQuantiles,
}

impl Hops {
    /// Takes an answered tick; `share` is how much of the measurement had passed.
    pub fn push(&mut self, share: f64, tick: &TickStamps) {
        let TickStamps { plant, controller, gate } = *tick;
        let received = if plant.latency_ns > 0 { plant.publish_ns + plant.latency_ns } else { 0 };
        let written = gate.due_ns;
        for (part, from, to) in [
            (Part::PlantTimer, plant.due_ns, plant.wake_ns),
            (Part::PlantSample, plant.wake_ns, written),
            (Part::StateWritten, written, plant.publish_ns),
            (Part::ControllerWakes, plant.publish_ns, controller.wake_ns),
            (Part::ControllerWorks, controller.wake_ns, controller.publish_ns),
            (Part::GateWakes, controller.publish_ns, gate.wake_ns),
            (Part::GateWorks, gate.wake_ns, gate.publish_ns),
            (Part::PlantWakes, gate.publish_ns, received),
        ] {
            if from > 0 && to > 0 {
                // On two cores one may be woken before the other has looked at the clock.
                self.parts[part as usize].push(share, to.saturating_sub(from));
            }
        }
        let end = if received > 0 { received } else { gate.publish_ns };
        self.late += u64::from(received == 0);
        if end > 0 && written > 0 && plant.publish_ns > 0 {
            self.chain.push(share, end.saturating_sub(written));
            self.published.push(share, end.saturating_sub(plant.publish_ns));
        }
    }

    /// A part's durations.
    #[must_use]
    pub fn part(&self, part: Part) -> &Distribution {
        &self.parts[part as usize]
    }

    /// The parts in the order of time.
    #[must_use]
    pub fn table(&self) -> Vec<PartQuantiles> {
        Part::ALL.into_iter().map(|part| PartQuantiles { part, quantiles: self.part(part).quantiles() }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick() -> TickStamps {
        let stamps = |due_ns, wake_ns, publish_ns| Stamps { due_ns, wake_ns, publish_ns, latency_ns: 0 };
        TickStamps {
            plant: Stamps { latency_ns: 57_000, ..stamps(1_000_000, 1_004_000, 1_007_000) },
            controller: stamps(1_006_000, 1_020_000, 1_028_000),
            gate: stamps(1_006_000, 1_039_000, 1_044_000),
        }
    }

    #[test]
    fn the_parts_make_up_the_whole() {
        let mut hops = Hops::default();
        hops.push(0.0, &tick());
        let us: Vec<_> = hops.table().iter().map(|row| row.quantiles.max.unwrap_or(-1.0)).collect();
        assert_eq!(us, [4.0, 2.0, 1.0, 13.0, 8.0, 11.0, 5.0, 20.0]);
        assert_eq!(hops.chain.quantiles().max, Some(58.0));
        assert_eq!(hops.chain.quantiles().max, Some(us[2..].iter().sum()));
        assert_eq!((hops.published.quantiles().max, hops.late), (Some(57.0), 0));
    }

    #[test]
    fn an_answer_that_the_plant_did_not_wait_for_counts_all_the_same() {
        let mut late = tick();
        late.plant.latency_ns = 0;
        late.gate.publish_ns = 1_506_000;
        let mut hops = Hops::default();
        hops.push(0.0, &late);
        assert_eq!((hops.chain.quantiles().max, hops.late), (Some(500.0), 1));
        assert_eq!(hops.part(Part::PlantWakes).count(), 0);
        hops.push(0.0, &TickStamps::default());
        assert_eq!(hops.chain.count(), 1, "a tick of which nothing is known is none");
    }
}
