//! What the plant's integrator had to do.

use super::moments::IntegrationSummary;
use super::sample::PhysicsSample;

/// Sums over the states.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Integration {
    contact_ticks: u64,
    substeps: u64,
    contact_substeps: u64,
    newton_iterations: u64,
    unconverged: u64,
    /// Least of the contacts' account so far, J.
    least_j: Option<f64>,
    created_j: f64,
}

impl Integration {
    pub(super) fn tick(&mut self, physics: Option<&PhysicsSample>, in_contact: bool) {
        self.contact_ticks += u64::from(in_contact);
        let Some(physics) = physics else { return };
        self.substeps += physics.substeps;
        self.contact_substeps += physics.contact_substeps;
        self.newton_iterations += physics.newton_iterations;
        self.unconverged += physics.unconverged;
        let account = physics.contact_account_j;
        let least = self.least_j.map_or(account, |least| least.min(account));
        self.least_j = Some(least);
        self.created_j = self.created_j.max(account - least);
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
            contact_energy_created_j: self.created_j,
        }
    }
}
