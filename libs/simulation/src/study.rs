//! One simulation from start to end, and its figures.

use crate::extremes::Extremes;
use crate::recording::Recording;
use crate::{Simulation, SimulationError, Snapshot};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_log::{LogError, Metrics, MetricsSummary, Names, convert};
use hapfic_messages::{Operator, Parameters};
use std::sync::atomic::{AtomicBool, Ordering};

/// Divided by, and not multiplied by the period, 3800 ticks are 3.8 s.
const TICKS_PER_S: f64 = 1.0 / PERIOD_S;

/// How a simulation ended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// All ticks are done.
    #[default]
    Completed,
    /// It could not go on.
    Failed(String),
    /// Somebody asked for its end.
    Stopped,
}

/// What came of a simulation.
#[derive(Clone, Debug, Default)]
pub struct Done {
    /// How it ended.
    pub end: End,
    /// Ticks that were done.
    pub ticks: u64,
    /// The figures that a log of it gives.
    pub metrics: MetricsSummary,
    /// Those that it does not.
    pub extremes: Extremes,
}

impl Done {
    /// Simulated time, s.
    #[must_use]
    pub fn simulated_s(&self) -> f64 {
        self.ticks as f64 / TICKS_PER_S
    }
}

/// Simulates a scenario to its end, or until `stop` is set; writes it down as it goes, if there is a recording.
///
/// # Errors
/// [`LogError`] if the recording cannot be written. That a simulation cannot go on is an end, not an error.
pub fn study(settings: &Settings, stop: &AtomicBool, recording: Option<&mut Recording>) -> Result<Done, LogError> {
    let mut simulation = match Simulation::new(settings) {
        Ok(simulation) => simulation,
        Err(e) => return Ok(Done { end: End::Failed(e.to_string()), ..Done::default() }),
    };
    let mut sums = Sums {
        names: {
            let plant = simulation.plant();
            Names::new(settings, plant.chain(), plant.body_names())
        },
        metrics: Metrics::new(),
        extremes: Extremes::default(),
        announced: 0,
        recording,
    };
    let mut ticks = 0;
    let mut end = End::Completed;
    while ticks < settings.duration_ticks {
        if stop.load(Ordering::Relaxed) {
            end = End::Stopped;
            break;
        }
        match step(&mut simulation) {
            Ok(snapshot) => sums.take(&snapshot)?,
            Err(e) => {
                end = End::Failed(e.to_string());
                break;
            }
        }
        ticks += 1;
    }
    // What was announced in the last tick is in force in none, and in the log all the same.
    sums.announce(simulation.operator())?;
    Ok(Done { end, ticks, metrics: sums.metrics.summary(), extremes: sums.extremes })
}

fn step(simulation: &mut Simulation) -> Result<Snapshot, SimulationError> {
    simulation.step().copied()
}

/// Figures that grow tick by tick.
struct Sums<'a> {
    names: Names,
    metrics: Metrics,
    extremes: Extremes,
    /// Newest version of the operator's sets so far.
    announced: u64,
    recording: Option<&'a mut Recording>,
}

impl Sums<'_> {
    fn take(&mut self, snapshot: &Snapshot) -> Result<(), LogError> {
        self.announce(&snapshot.operator)?;
        let (state, reference, command) = match &mut self.recording {
            Some(recording) => recording.tick(snapshot)?,
            None => (
                convert::state(&snapshot.state, &self.names),
                convert::reference(&snapshot.reference),
                convert::command(&snapshot.command),
            ),
        };
        self.metrics.push_state(&state);
        self.metrics.push_reference(&reference);
        self.metrics.push_command(&command);
        self.extremes = self.extremes.step(&snapshot.state, &snapshot.command);
        Ok(())
    }

    /// Each set once, when it is announced.
    fn announce(&mut self, operator: &Operator) -> Result<(), LogError> {
        for set in [&operator.current, &operator.next] {
            if set.version > self.announced {
                self.announced = set.version;
                self.set(set)?;
            }
        }
        Ok(())
    }

    fn set(&mut self, set: &Parameters) -> Result<(), LogError> {
        let set = match &mut self.recording {
            Some(recording) => recording.set(set)?,
            None => convert::operator(set),
        };
        self.metrics.push_operator(&set);
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn settings(overrides: &[&str]) -> Settings {
        Settings::load("floor", &overrides.iter().map(|argument| (*argument).to_owned()).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_scenario_is_simulated_to_its_end() {
        let done = study(&settings(&["duration_s=4.5"]), &AtomicBool::new(false), None).unwrap();
        assert_eq!((&done.end, done.ticks, done.simulated_s()), (&End::Completed, 4500, 4.5));
        assert_eq!(Done { ticks: 3800, ..Done::default() }.simulated_s(), 3.8);
        assert_eq!((done.metrics.ticks.last, done.metrics.ticks.lost), (Some(4499), 0));
        // Pressed with 50 N from 3 s on, and at rest.
        assert!(done.metrics.force.settled_rms_percent[2].unwrap() < 0.2, "{:?}", done.metrics.force);
        assert!(done.extremes.foot_force_n > 49.0 && done.extremes.contact_force_n >= done.extremes.foot_force_n);
        assert!(done.extremes.largest_torque() > 0.0 && done.extremes.work_j > 0.0);
    }

    #[test]
    fn one_that_cannot_go_on_says_why() {
        let mut mad = settings(&["duration_s=1.0"]);
        // No file can say that: it stands for gains with which the numbers overflow.
        mad.initial.stiffness = [f64::NAN; 3];
        let done = study(&mad, &AtomicBool::new(false), None).unwrap();
        assert!(matches!(&done.end, End::Failed(error) if error.contains("lower the gains")), "{:?}", done.end);
        assert!(done.ticks < 1000, "{}", done.ticks);
    }

    #[test]
    fn one_that_was_stopped_says_so() {
        let done = study(&settings(&[]), &AtomicBool::new(true), None).unwrap();
        assert_eq!((done.end, done.ticks, done.metrics.ticks.last), (End::Stopped, 0, None));
    }
}
