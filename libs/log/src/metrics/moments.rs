//! The figures of what happened in the scene: objects, contacts, posture, and the integration behind them.

use super::label::{Label, List};
use hapfic_messages::{MAX_JOINTS, MAX_OBJECTS};
use serde::Serialize;

/// Most pairs of bodies whose contacts are told apart; those that touch first count.
pub const MAX_PAIRS: usize = 24;

/// What happened in the scene.
///
/// The foot touches nothing where no component of its measured force is above the force resolution in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MomentsSummary {
    /// Free bodies, in the order of the scenario.
    pub objects: List<ObjectSummary, MAX_OBJECTS>,
    /// Pairs of bodies that touched, in the order in which they first did.
    pub contacts: List<PairSummary, MAX_PAIRS>,
    /// Joints, from the base to the tip.
    pub joints: List<JointSummary, MAX_JOINTS>,
    /// Wished forces while the foot touches nothing.
    pub air: AirSummary,
}

/// How a free body turned and moved, against its first pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ObjectSummary {
    /// Its name in the scenario.
    pub name: Label,
    /// Largest angle of the turn from its first to a later orientation, degrees, 0 to 180.
    pub max_turn_deg: f64,
    /// The same of its last orientation, degrees.
    pub final_turn_deg: f64,
    /// Whether it ever rested on another face: its z axis 80 degrees or more from where it pointed first, for 0.2 s slower
    /// than 1 mm/s and 0.01 rad/s.
    pub tipped_at_rest: bool,
    /// Largest distance of its centre of mass from its first place, m.
    pub max_displacement_m: f64,
}

/// Contacts of two bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PairSummary {
    /// The first body: a link, or an object on something fixed.
    pub body: Label,
    /// The second body.
    pub against: Label,
    /// Ticks in which they touched.
    pub ticks: u64,
    /// Of these, ticks in which the foot touched nothing.
    pub foot_free_ticks: u64,
    /// Largest mean force of a tick between the two, N.
    pub peak_n: f64,
}

/// One joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct JointSummary {
    /// Smallest |q|, degrees (of a prismatic joint, its metres taken for radians).
    pub smallest_deg: f64,
    /// Ticks within one degree of zero: a knee is straight there.
    pub straight_ticks: u64,
}

/// Axes with a wished force, at ticks in mode `active` at which the foot touches nothing: the law must not search there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AirSummary {
    /// Ticks of it.
    pub ticks: [u64; 3],
    /// Largest |dx|, m; 0 if there is no drift.
    pub max_offset_m: [f64; 3],
    /// Largest |e|, e = x_d + dx - x, m; also while the reference moves.
    pub max_error_m: [f64; 3],
}

/// What the plant's integrator had to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct IntegrationSummary {
    /// Ticks in which anything touched anything.
    pub contact_ticks: u64,
    /// Sub-steps.
    pub substeps: u64,
    /// Of these, implicit ones: near a contact or a joint's stop.
    pub contact_substeps: u64,
    /// Newton iterations of these.
    pub newton_iterations: u64,
    /// Mean of Newton iterations per implicit sub-step.
    pub newton_per_contact_substep: Option<f64>,
    /// Implicit sub-steps that ended above the tolerance.
    pub unconverged: u64,
    /// Largest rise of the work done by the contacts above its least value so far, J: what compressed contacts gave back.
    pub contact_energy_returned_j: f64,
    /// Largest rise of the work done by the contacts, and the elastic energy stored in them, above its least value so far, J.
    /// Contacts only dissipate: any rise was created by the integration.
    pub contact_energy_created_j: f64,
}
