//! Simulation of a scenario from start to end, with its figures.

use crate::conditions::{TaskReport, TaskWatch};
use crate::extremes::Extremes;
use crate::recording::Recording;
use crate::{Simulation, SimulationError, Snapshot};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_log::{LogError, Metrics, MetricsSummary, Names, convert};
use hapfic_messages::{Operator, Parameters};
use std::sync::atomic::{AtomicBool, Ordering};

/// Divisor for ticks: 3800 divided by it is exactly 3.8 s, unlike 3800 times the period.
const TICKS_PER_S: f64 = 1.0 / PERIOD_S;

/// End of a simulation.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// All ticks are simulated.
    #[default]
    Completed,
    /// An error ended it; the message.
    Failed(String),
    /// The stop flag ended it.
    Stopped,
}

/// Result of a simulation.
#[derive(Clone, Debug, Default)]
pub struct Done {
    /// End of the simulation.
    pub end: End,
    /// Number of simulated ticks.
    pub ticks: u64,
    /// Metrics of its log.
    pub metrics: MetricsSummary,
    /// Figures beyond the metrics.
    pub extremes: Extremes,
    /// Conditions of the task that held.
    pub tasks: Vec<TaskReport>,
}

impl Done {
    /// Simulated time [s].
    #[must_use]
    pub fn simulated_s(&self) -> f64 {
        self.ticks as f64 / TICKS_PER_S
    }
}

/// Simulates a scenario to its end, or until `stop` is set, and writes the recording, if any.
///
/// # Errors
/// [`LogError`] if the recording cannot be written. A failed simulation is an [`End`], not an error.
pub fn study(settings: &Settings, stop: &AtomicBool, recording: Option<&mut Recording>) -> Result<Done, LogError> {
    let mut simulation = match Simulation::new(settings) {
        Ok(simulation) => simulation,
        Err(e) => return Ok(Done { end: End::Failed(e.to_string()), ..Done::default() }),
    };
    let mut sums = StudySums {
        names: {
            let plant = simulation.plant();
            Names::new(settings, plant.chain(), plant.body_names())
        },
        metrics: Metrics::new(),
        extremes: Extremes::default(),
        tasks: TaskWatch::new(settings, simulation.plant().chain().clone()),
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
    // A set announced in the last tick never takes effect, but belongs in the log.
    sums.announce(simulation.operator())?;
    Ok(Done { end, ticks, metrics: sums.metrics.summary(), extremes: sums.extremes, tasks: sums.tasks.report() })
}

fn step(simulation: &mut Simulation) -> Result<Snapshot, SimulationError> {
    simulation.step().copied()
}

/// Metrics and figures, summed over the ticks.
struct StudySums<'a> {
    names: Names,
    metrics: Metrics,
    extremes: Extremes,
    tasks: TaskWatch,
    /// Newest version of the operator's sets so far.
    announced: u64,
    recording: Option<&'a mut Recording>,
}

impl StudySums<'_> {
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
        let set = snapshot.operator.at(snapshot.state.tick);
        let events = self.tasks.push(&snapshot.state, &snapshot.reference, &snapshot.command, set);
        if let Some(recording) = &mut self.recording {
            events.iter().try_for_each(|event| recording.event(event))?;
        }
        Ok(())
    }

    /// Adds each set once, when it is announced.
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
    fn study_without_error_completes() {
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
    fn study_overflow_reports_reason() {
        let mut overflowing = settings(&["duration_s=1.0"]);
        // Invalid in a file; stands for gains with which the numbers overflow.
        overflowing.initial.stiffness = [f64::NAN; 3];
        let done = study(&overflowing, &AtomicBool::new(false), None).unwrap();
        assert!(matches!(&done.end, End::Failed(error) if error.contains("lower the gains")), "{:?}", done.end);
        assert!(done.ticks < 1000, "{}", done.ticks);
    }

    #[test]
    fn study_stop_flag_stops() {
        let done = study(&settings(&[]), &AtomicBool::new(true), None).unwrap();
        assert_eq!((done.end, done.ticks, done.metrics.ticks.last), (End::Stopped, 0, None));
    }
}
