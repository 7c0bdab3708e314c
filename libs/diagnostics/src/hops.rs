//! Latency of the stack's own chain, hop by hop, from the stamps that each process logs at each tick.

use crate::distribution::{ChainQuantiles, Distribution};
use serde::Serialize;

/// Stamps of a process at a tick, `CLOCK_MONOTONIC` [ns]; 0 for an event that did not happen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stamps {
    /// Stamp of the message that started the tick (plant: due time of its timer).
    pub due_ns: u64,
    /// Wake-up.
    pub wake_ns: u64,
    /// End of publishing.
    pub publish_ns: u64,
    /// Plant: time from state published to command received.
    pub latency_ns: u64,
}

impl Stamps {
    /// Time from wake-up to publication [ns]; `None` if a stamp is missing.
    #[must_use]
    pub fn took_ns(&self) -> Option<u64> {
        (self.wake_ns > 0 && self.publish_ns > 0).then(|| self.publish_ns.saturating_sub(self.wake_ns))
    }
}

/// Stamps of all processes at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TickStamps {
    /// Stamps of the plant.
    pub plant: Stamps,
    /// Stamps of the controller whose request the gate took.
    pub controller: Stamps,
    /// Stamps of the gate.
    pub gate: Stamps,
}

/// Hops of the stack's chain, in the order of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hop {
    /// Timer due -> plant awake.
    PlantTimer,
    /// Plant awake -> it begins to write its state: it reads the sensors.
    PlantSample,
    /// Begin of writing -> state published.
    StateWritten,
    /// State published -> controller awake.
    ControllerWakes,
    /// Controller awake -> request published.
    ControllerWorks,
    /// Request published -> gate awake.
    GateWakes,
    /// Gate awake -> command published.
    GateWorks,
    /// Command published -> plant has received it.
    PlantWakes,
}

impl Hop {
    /// All hops in the order of time.
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

    /// Name in tables.
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

/// Durations of the hops of the stack's chain, and of the whole chain.
#[derive(Clone, Debug, Default)]
pub struct HopDurations {
    hops: [Distribution; Hop::ALL.len()],
    /// Begin of writing the state -> plant has received the command, like the round trip of the other chains.
    pub chain: Distribution,
    /// State published -> plant has received the command; the latency in the summary of a run lacks the last hop.
    pub published: Distribution,
    /// Ticks whose command was published after the plant's wait; [`chain`](Self::chain) has them with the publication
    /// time.
    pub late: u64,
}

/// Quantiles of one hop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HopQuantiles {
    /// The hop.
    pub part: Hop,
    /// Quantiles of its duration [us].
    #[serde(flatten)]
    pub quantiles: ChainQuantiles,
}

impl HopDurations {
    /// Adds an answered tick; `share` is the elapsed share of the measurement.
    pub fn push(&mut self, share: f64, tick: &TickStamps) {
        let TickStamps { plant, controller, gate } = *tick;
        let received = if plant.latency_ns > 0 { plant.publish_ns + plant.latency_ns } else { 0 };
        let written = gate.due_ns;
        for (hop, from, to) in [
            (Hop::PlantTimer, plant.due_ns, plant.wake_ns),
            (Hop::PlantSample, plant.wake_ns, written),
            (Hop::StateWritten, written, plant.publish_ns),
            (Hop::ControllerWakes, plant.publish_ns, controller.wake_ns),
            (Hop::ControllerWorks, controller.wake_ns, controller.publish_ns),
            (Hop::GateWakes, controller.publish_ns, gate.wake_ns),
            (Hop::GateWorks, gate.wake_ns, gate.publish_ns),
            (Hop::PlantWakes, gate.publish_ns, received),
        ] {
            if from > 0 && to > 0 {
                // A process on another core may wake up before the sender reads the clock.
                self.hops[hop as usize].push(share, to.saturating_sub(from));
            }
        }
        let end = if received > 0 { received } else { gate.publish_ns };
        self.late += u64::from(received == 0);
        if end > 0 && written > 0 && plant.publish_ns > 0 {
            self.chain.push(share, end.saturating_sub(written));
            self.published.push(share, end.saturating_sub(plant.publish_ns));
        }
    }

    /// Durations of a hop.
    #[must_use]
    pub fn hop(&self, hop: Hop) -> &Distribution {
        &self.hops[hop as usize]
    }

    /// Quantiles of all hops in the order of time.
    #[must_use]
    pub fn table(&self) -> Vec<HopQuantiles> {
        Hop::ALL.into_iter().map(|part| HopQuantiles { part, quantiles: self.hop(part).quantiles() }).collect()
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
    fn hops_of_tick_add_up_to_chain() {
        let mut hops = HopDurations::default();
        hops.push(0.0, &tick());
        let us: Vec<_> = hops.table().iter().map(|hop| hop.quantiles.max.unwrap_or(-1.0)).collect();
        assert_eq!(us, [4.0, 2.0, 1.0, 13.0, 8.0, 11.0, 5.0, 20.0]);
        assert_eq!(hops.chain.quantiles().max, Some(58.0));
        assert_eq!(hops.chain.quantiles().max, Some(us[2..].iter().sum()));
        assert_eq!((hops.published.quantiles().max, hops.late), (Some(57.0), 0));
    }

    #[test]
    fn chain_late_command_counts_until_publication() {
        let mut late = tick();
        late.plant.latency_ns = 0;
        late.gate.publish_ns = 1_506_000;
        let mut hops = HopDurations::default();
        hops.push(0.0, &late);
        assert_eq!((hops.chain.quantiles().max, hops.late), (Some(500.0), 1));
        assert_eq!(hops.hop(Hop::PlantWakes).count(), 0);
        hops.push(0.0, &TickStamps::default());
        assert_eq!(hops.chain.count(), 1, "a tick without stamps does not count");
    }
}
