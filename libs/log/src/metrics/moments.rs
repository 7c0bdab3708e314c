//! Metrics of the scene: objects, contacts, posture, and the integration behind them.

use super::label::{FixedList, Label};
use hapfic_messages::{MAX_JOINTS, MAX_OBJECTS};
use serde::{Deserialize, Serialize};

/// Most contact pairs; later pairs are ignored.
pub const MAX_PAIRS: usize = 24;

/// Metrics of the scene.
///
/// The foot touches nothing where no component of its measured force is above the force resolution of that tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MomentsSummary {
    /// Free bodies, in the order of the scenario.
    pub objects: FixedList<ObjectSummary, MAX_OBJECTS>,
    /// Contact pairs, in the order of their first contact.
    pub contacts: FixedList<PairSummary, MAX_PAIRS>,
    /// Joints, from the base to the tip.
    pub joints: FixedList<JointSummary, MAX_JOINTS>,
    /// Axes with a desired force while the foot touches nothing.
    pub air: AirSummary,
}

/// Rotation and displacement of a free body against its first pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectSummary {
    /// Name in the scenario.
    pub name: Label,
    /// Largest angle of rotation from the first to a later orientation, 0 to 180 [deg].
    pub max_turn_deg: f64,
    /// Angle of rotation from the first to the last orientation [deg].
    pub final_turn_deg: f64,
    /// Whether it ever rested on another face: its z axis at least 80 degrees from the first direction, for 0.2 s
    /// slower than 1 mm/s and 0.01 rad/s.
    pub tipped_at_rest: bool,
    /// Largest distance of the centre of mass from its first position [m].
    pub max_displacement_m: f64,
}

/// Contact pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PairSummary {
    /// The first body: a link, or an object on something fixed.
    pub body: Label,
    /// The second body.
    pub against: Label,
    /// Ticks with contact between the two.
    pub ticks: u64,
    /// Of these, ticks in which the foot touched nothing.
    pub foot_free_ticks: u64,
    /// Largest mean force of a tick between the two [N].
    pub peak_n: f64,
}

/// Posture of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointSummary {
    /// Smallest |q| [deg]; metres of a prismatic joint count as radians.
    pub smallest_deg: f64,
    /// Ticks within one degree of zero, where a knee is straight.
    pub straight_ticks: u64,
}

/// Axes with a desired force, at ticks in mode `active` without contact of the foot: the law must not search there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AirSummary {
    /// Number of such ticks.
    pub ticks: [u64; 3],
    /// Largest |dx| [m]; 0 if there is no drift.
    pub max_offset_m: [f64; 3],
    /// Largest |e|, e = x_d + dx - x [m]; also while the reference moves.
    pub max_error_m: [f64; 3],
}

/// Metrics of the plant's integrator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IntegrationSummary {
    /// Ticks with any contact.
    pub contact_ticks: u64,
    /// Sub-steps.
    pub substeps: u64,
    /// Of these, implicit sub-steps: near a contact or a joint's stop.
    pub contact_substeps: u64,
    /// Newton iterations of the implicit sub-steps.
    pub newton_iterations: u64,
    /// Mean number of Newton iterations per implicit sub-step.
    pub newton_per_contact_substep: Option<f64>,
    /// Implicit sub-steps that ended above the tolerance.
    pub unconverged: u64,
    /// Sub-steps that were rolled back and cut: they did not converge, or would have added energy.
    pub cut: u64,
    /// Largest rise of the contact work above its least value so far [J]: the energy that compressed contacts returned.
    pub contact_energy_returned_j: f64,
    /// Largest rise of contact work and elastic contact energy together above their least value so far [J].
    /// Contacts only dissipate: any rise is an error of the contacts' forces.
    pub contact_energy_created_j: f64,
    /// Error of the energy balance where it is largest [J]: kinetic and potential energy, less the works of contacts and
    /// joints, plus the loss to joint damping, less the same at the start. Zero in logs that lack it (0.2 and before).
    pub energy_error_j: f64,
    /// Largest kinetic and potential energy less the smallest [J]: the measure of the error.
    pub energy_range_j: f64,
    /// Passages: a body went through another one.
    pub passages: u64,
}
