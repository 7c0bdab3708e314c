//! Metrics of the plant's integrator.

use super::moments::IntegrationSummary;
use super::sample::PhysicsSample;

/// Sums over the states.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct IntegrationSums {
    contact_ticks: u64,
    substeps: u64,
    contact_substeps: u64,
    newton_iterations: u64,
    unconverged: u64,
    cut: u64,
    passages: u64,
    /// Least and largest energy.
    energy: Option<(f64, f64)>,
    /// Error of the balance with the largest absolute value.
    energy_error: f64,
    /// Rise of the contact work.
    returned: Rise,
    /// Rise of contact work and stored energy together.
    created: Rise,
}

/// Largest rise above the least value before.
#[derive(Clone, Copy, Debug, Default)]
struct Rise {
    minimum: Option<f64>,
    largest: f64,
}

impl Rise {
    fn update(&mut self, value: f64) {
        let minimum = self.minimum.map_or(value, |minimum| minimum.min(value));
        self.minimum = Some(minimum);
        self.largest = self.largest.max(value - minimum);
    }
}

impl IntegrationSums {
    pub(super) fn tick(&mut self, physics: Option<&PhysicsSample>, in_contact: bool) {
        self.contact_ticks += u64::from(in_contact);
        let Some(physics) = physics else { return };
        self.substeps += physics.substeps;
        self.contact_substeps += physics.contact_substeps;
        self.newton_iterations += physics.newton_iterations;
        self.unconverged += physics.unconverged;
        self.cut += physics.cut_substeps;
        self.passages += physics.passages;
        let energy = physics.energy_j;
        self.energy = Some(self.energy.map_or((energy, energy), |(least, most)| (least.min(energy), most.max(energy))));
        if physics.energy_error_j.abs() > self.energy_error.abs() {
            self.energy_error = physics.energy_error_j;
        }
        self.returned.update(physics.contact_work_j);
        self.created.update(physics.contact_work_j + physics.contact_stored_j);
    }

    pub(super) fn summary(&self) -> IntegrationSummary {
        let per_substep = self.newton_iterations as f64 / self.contact_substeps as f64;
        IntegrationSummary {
            contact_ticks: self.contact_ticks,
            substeps: self.substeps,
            contact_substeps: self.contact_substeps,
            newton_iterations: self.newton_iterations,
            newton_per_contact_substep: (self.contact_substeps > 0).then_some(per_substep),
            unconverged: self.unconverged,
            cut: self.cut,
            contact_energy_returned_j: self.returned.largest,
            contact_energy_created_j: self.created.largest,
            energy_error_j: self.energy_error,
            energy_range_j: self.energy.map_or(0.0, |(least, most)| most - least),
            passages: self.passages,
        }
    }
}
