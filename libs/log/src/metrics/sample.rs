//! Checked excerpts of the messages, for the metrics.

use super::label::{FixedList, Label};
use crate::proto;
use hapfic_messages::{MAX_CONTACTS, MAX_JOINTS, MAX_OBJECTS, Mode, Saturation, Source};
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector3};

/// Largest plausible value, far above any length, speed or force of a run.
///
/// A damaged log, or a log of another program, may hold any value.
const MAX_VALUE: f64 = 1e12;
/// Shortest quaternion with a direction.
const MIN_QUATERNION_NORM: f64 = 1e-6;

/// Excerpt of a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateSample {
    pub(super) position: Vector3<f64>,
    pub(super) velocity: Vector3<f64>,
    pub(super) force: Vector3<f64>,
    pub(super) joints: FixedList<f64, MAX_JOINTS>,
    pub(super) objects: FixedList<ObjectSample, MAX_OBJECTS>,
    pub(super) contacts: FixedList<ContactSample, MAX_CONTACTS>,
    pub(super) physics: Option<PhysicsSample>,
}

impl StateSample {
    /// Returns `None` unless every vector has 3 finite elements, as for all samples.
    ///
    /// Lists are cut to a state's capacity.
    pub(super) fn new(message: &proto::State) -> Option<Self> {
        let joints = message.joint_position.iter().take(MAX_JOINTS);
        Some(Self {
            position: vector(&message.foot_position)?,
            velocity: vector_if_any(&message.foot_velocity)?.unwrap_or_default(),
            force: vector(&message.foot_force)?,
            joints: joints.map(|&q| is_plausible(q).then_some(q)).collect::<Option<_>>()?,
            objects: message.objects.iter().take(MAX_OBJECTS).map(ObjectSample::new).collect::<Option<_>>()?,
            contacts: message.contacts.iter().take(MAX_CONTACTS).map(ContactSample::new).collect::<Option<_>>()?,
            physics: match &message.physics {
                Some(physics) => Some(PhysicsSample::new(physics)?),
                None => None,
            },
        })
    }
}

impl StateSample {
    /// Speed of the foot across an axis [m/s].
    pub(super) fn speed_across(&self, axis: usize) -> f64 {
        self.velocity.remove_row(axis).norm()
    }
}

/// Excerpt of a free body.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ObjectSample {
    pub(super) name: Label,
    pub(super) position: Vector3<f64>,
    pub(super) orientation: UnitQuaternion<f64>,
    pub(super) linear_velocity: Vector3<f64>,
    pub(super) angular_velocity: Vector3<f64>,
}

impl ObjectSample {
    fn new(message: &proto::Object) -> Option<Self> {
        Some(Self {
            name: Label::new(&message.name),
            position: vector(&message.position)?,
            orientation: UnitQuaternion::try_new(Quaternion::from(vector(&message.orientation)?), MIN_QUATERNION_NORM)?,
            linear_velocity: vector(&message.linear_velocity)?,
            angular_velocity: vector(&message.angular_velocity)?,
        })
    }
}

/// Excerpt of a contact.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ContactSample {
    pub(super) body: Label,
    pub(super) against: Label,
    pub(super) force: Vector3<f64>,
}

impl ContactSample {
    fn new(message: &proto::Contact) -> Option<Self> {
        let (body, against) = (Label::new(&message.body), Label::new(&message.against));
        Some(Self { body, against, force: vector(&message.force)? })
    }
}

/// Excerpt of the integrator's statistics.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PhysicsSample {
    pub(super) substeps: u64,
    pub(super) contact_substeps: u64,
    pub(super) newton_iterations: u64,
    pub(super) unconverged: u64,
    /// Work of the contacts since the start [J].
    pub(super) contact_work_j: f64,
    /// Elastic energy in the contacts [J].
    pub(super) contact_stored_j: f64,
    /// Kinetic and potential energy [J].
    pub(super) energy_j: f64,
    /// Error of the energy balance since the start [J].
    pub(super) energy_error_j: f64,
    pub(super) cut_substeps: u64,
    pub(super) passages: u64,
}

impl PhysicsSample {
    fn new(message: &proto::Physics) -> Option<Self> {
        let joule = |value: f64| is_plausible(value).then_some(value);
        Some(Self {
            substeps: message.substeps.into(),
            contact_substeps: message.contact_substeps.into(),
            newton_iterations: message.newton_iterations.into(),
            unconverged: message.unconverged.into(),
            contact_work_j: joule(message.contact_work_j)?,
            contact_stored_j: joule(message.contact_stored_j)?,
            energy_j: joule(message.energy_j)?,
            energy_error_j: joule(message.energy_error_j)?,
            cut_substeps: message.cut_substeps.into(),
            passages: message.passages.into(),
        })
    }
}

/// Excerpt of a reference.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReferenceSample {
    pub(super) position: Vector3<f64>,
    pub(super) velocity: Vector3<f64>,
}

impl ReferenceSample {
    pub(super) fn new(message: &proto::Reference) -> Option<Self> {
        Some(Self { position: vector(&message.position)?, velocity: vector(&message.velocity)? })
    }

    /// Whether the reference is at rest. The comparison is exact: the planner's arcs end at rest in closed form.
    pub(super) fn at_rest(&self) -> bool {
        self.velocity == Vector3::zeros()
    }

    /// Whether the reference moves across an axis and not along it.
    pub(super) fn moves_across(&self, axis: usize) -> bool {
        !self.at_rest() && self.velocity[axis] == 0.0
    }
}

/// Excerpt of a command.
#[derive(Clone, Copy, Debug)]
pub(super) struct CommandSample {
    pub(super) force: Vector3<f64>,
    pub(super) active: bool,
    pub(super) converging: [bool; 3],
    /// The gate had no valid request of this tick.
    pub(super) missed: bool,
    /// The peak or the rate limit cut the torque of a joint.
    pub(super) limited: bool,
    /// dx; `None` in a log without it, as for the error.
    pub(super) offset: Option<Vector3<f64>>,
    pub(super) error: Option<Vector3<f64>>,
    /// Angle from the tip to its reference [rad]; `None` in a position task.
    pub(super) turned: Option<f64>,
}

impl CommandSample {
    pub(super) fn new(message: &proto::Command) -> Option<Self> {
        let rotation_offset = vector_if_any(&message.rotation_offset)?;
        Some(Self {
            force: vector(&message.force)?,
            active: message.mode == Mode::Active.name(),
            converging: std::array::from_fn(|i| message.converging.get(i).copied().unwrap_or(false)),
            missed: ![Source::Fresh, Source::Suppressed].iter().any(|s| message.source == s.name()),
            limited: message.limited != 0 || message.rate_limited != 0,
            offset: vector_if_any(&message.offset)?,
            error: vector_if_any(&message.error)?,
            turned: vector_if_any(&message.rotation_error)?.map(|error| (error - rotation_offset.unwrap_or_default()).norm()),
        })
    }
}

/// Excerpt of a parameter set.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParameterSample {
    pub(super) version: u64,
    pub(super) effective_tick: i64,
    pub(super) desired_force: Vector3<f64>,
    pub(super) stiffness: Vector3<f64>,
    pub(super) max_force: Vector3<f64>,
    pub(super) position_bound: Vector3<f64>,
    pub(super) force_resolution: f64,
    /// The profile softens: its largest force is min(F_max, K0 x_b).
    pub(super) softening: bool,
    pub(super) continuous_reentry: bool,
}

impl ParameterSample {
    /// Largest force of the profile of an axis [N].
    pub(super) fn largest_force(&self, axis: usize) -> f64 {
        let linear = self.stiffness[axis] * self.position_bound[axis];
        if self.softening { linear.min(self.max_force[axis]) } else { self.max_force[axis] }
    }

    pub(super) fn new(message: &proto::Operator) -> Option<Self> {
        Some(Self {
            version: message.version,
            effective_tick: message.effective_tick,
            desired_force: vector(&message.desired_force)?,
            stiffness: vector_if_any(&message.stiffness)?.unwrap_or_default(),
            max_force: vector(&message.max_force)?,
            position_bound: vector(&message.position_bound)?,
            force_resolution: is_plausible(message.force_resolution).then_some(message.force_resolution)?,
            softening: message.saturation == Saturation::Softening.name(),
            continuous_reentry: message.continuous_reentry,
        })
    }
}

fn vector<const N: usize>(values: &[f64]) -> Option<SVector<f64, N>> {
    let vector = SVector::from(<[f64; N]>::try_from(values).ok()?);
    vector.iter().copied().all(is_plausible).then_some(vector)
}

/// Reads an optional vector: `Some(None)` if it is empty, `None` if it is invalid.
fn vector_if_any(values: &[f64]) -> Option<Option<Vector3<f64>>> {
    if values.is_empty() { Some(None) } else { vector(values).map(Some) }
}

fn is_plausible(value: f64) -> bool {
    value.abs() < MAX_VALUE
}
