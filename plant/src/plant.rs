//! Simulated robot and world, advanced by ticks.

use crate::account::TickResult;
use crate::collider::{BodyId, Collider};
use crate::drive::DriveState;
use crate::engine::Engine;
use crate::error::PlantError;
use crate::force_noise::ForceNoise;
use crate::object::FreeBody;
use crate::rapier::RapierEngine;
use crate::scene::CollisionScene;
use crate::world::{PhysicsWorld, Substeps};
use hapfic_config::{EngineSettings, Settings};
use hapfic_messages::{Command, Drive, MAX_JOINTS, MAX_OBJECTS, ObjectState, State};
use hapfic_robot::{Chain, JointVector};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

// A message holds as many objects as a scenario.
const _: () = assert!(hapfic_config::MAX_OBJECTS == hapfic_messages::MAX_OBJECTS);

/// Length of a tick [us].
const TICK_US: u32 = 1000;

/// A robot with its drive and sensors, in its world.
#[derive(Clone, Debug)]
pub struct Plant {
    engine: Box<dyn Engine>,
    drive: DriveState,
    applied: Drive,
    command_timeout_ticks: u32,
    brake_damping: f64,
    tick: i64,
    last: TickResult,
    noise: ForceNoise,
}

impl Plant {
    /// Builds robot and world of a scenario, in the start posture, brakes on.
    ///
    /// # Errors
    /// [`PlantError`] if the robot description or the start posture is invalid.
    pub fn new(settings: &Settings) -> Result<Self, PlantError> {
        let chain = Chain::from_settings(&settings.robot)?;
        let q = start_position(&settings.robot.start_position, &chain)?;
        let (mut damping, mut effort) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        for (i, joint) in chain.joints().iter().enumerate() {
            damping[i] = joint.damping;
            effort[i] = joint.effort;
        }
        let substeps = Substeps { flight_us: settings.plant.flight_substep_us, contact_us: settings.plant.contact_substep_us };
        let mut scene = CollisionScene::new(settings, chain)?;
        let objects: Vec<_> = settings.world.objects.iter().map(FreeBody::new).collect();
        let gravity = Vector3::from(settings.world.gravity_m_per_s2);
        reject_penetration(&mut scene, &q, &objects, &gravity)?;
        let engine: Box<dyn Engine> = match &settings.plant.engine {
            EngineSettings::Hapfic => {
                let mut world = PhysicsWorld::new(scene, q, objects, gravity, damping, effort, substeps);
                world.start_account();
                Box::new(world)
            }
            EngineSettings::Rapier(rapier) => Box::new(RapierEngine::new(scene, q, objects, gravity, (damping, effort), rapier)),
        };
        Ok(Self {
            engine,
            drive: DriveState::default(),
            applied: Drive::Held,
            command_timeout_ticks: settings.plant.command_timeout_ticks,
            brake_damping: settings.plant.brake_damping_n_m_s_per_rad,
            tick: 0,
            noise: ForceNoise { deviation: settings.plant.force_noise, seed: settings.seed },
            last: TickResult::default(),
        })
    }

    /// What the engine remembers beside a state; `None` if a state is all.
    #[must_use]
    pub fn memory(&self) -> Option<Vec<u8>> {
        self.engine.memory()
    }

    /// Resumes from a state that a predecessor has published, and from what its engine remembered at that tick.
    ///
    /// # Errors
    /// [`PlantError::Resume`] if the state is of another robot or world; [`PlantError::Memory`] if an engine that remembers
    /// more gets nothing that it knows.
    pub fn resume(&mut self, state: &State, memory: Option<&[u8]>) -> Result<(), PlantError> {
        let mut objects = [ObjectState::default(); MAX_OBJECTS];
        let expected = (self.chain().dof(), self.engine.objects(&mut objects));
        let found = (state.joints as usize, state.object_count as usize);
        if found != expected {
            return Err(PlantError::Resume { found, expected });
        }
        if self.engine.memory().is_some() && !memory.is_some_and(|memory| self.engine.remember(memory)) {
            return Err(PlantError::Memory);
        }
        self.engine.resume(state);
        self.applied = Drive::from_code(state.drive).unwrap_or(Drive::Held);
        self.drive = DriveState::resumed(self.applied != Drive::Held);
        self.tick = state.tick;
        self.last = TickResult {
            sensed_force: Vector3::from(state.foot_force) - Vector3::from(self.noise.at(state.tick)),
            sensed_moment: Vector3::from(state.foot_moment),
            torque: state.joint_torque,
            contacts: state.contacts,
            contact_count: state.contact_count as usize,
            physics: state.physics,
            ..TickResult::default()
        };
        Ok(())
    }

    /// The world of the plant's own engine, to inspect or set its state.
    ///
    /// # Panics
    /// If another engine moves the robot.
    #[must_use]
    #[allow(clippy::expect_used)]
    pub fn world(&mut self) -> &mut PhysicsWorld {
        self.engine.own().expect("plant.engine is hapfic")
    }

    /// Adds to the velocities of the joints [rad/s or m/s], as a short blow does.
    pub fn kick(&mut self, change: &JointVector) {
        let (q, mut qd) = self.engine.joints();
        qd.iter_mut().zip(change).for_each(|(rate, change)| *rate += change);
        self.engine.set_joints(&q, &qd);
    }

    /// The robot's model.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.engine.scene().chain
    }

    /// Names of the bodies, by the indices in [`hapfic_messages::ContactState`].
    #[must_use]
    pub fn body_names(&self) -> &[String] {
        &self.engine.scene().names
    }

    /// Result of the last tick.
    #[must_use]
    pub fn last(&self) -> &TickResult {
        &self.last
    }

    /// State at the present tick, without wall-clock times.
    #[must_use]
    pub fn sample(&self) -> State {
        let (q, qd) = self.engine.joints();
        let chain = self.chain();
        let n = chain.dof();
        let kin = chain.kinematics(&q);
        let jacobian = chain.jacobian(&kin);
        let mut state = State {
            tick: self.tick,
            time_ns: self.tick as u64 * u64::from(TICK_US) * 1000,
            command_tick: self.drive.command_tick(),
            joints: n as u32,
            drive: self.applied.code(),
            joint_position: q,
            joint_velocity: qd,
            joint_torque: self.last.torque,
            foot_position: kin.tip_position().into(),
            foot_velocity: jacobian.linear_mul(&qd[..n]).into(),
            foot_force: (self.last.sensed_force + Vector3::from(self.noise.at(self.tick))).into(),
            foot_orientation: quaternion(&kin.tip_rotation()),
            foot_angular_velocity: jacobian.angular_mul(&qd[..n]).into(),
            foot_moment: self.last.sensed_moment.into(),
            contact_count: self.last.contact_count as u32,
            limbs: 1,
            contacts: self.last.contacts,
            physics: self.last.physics,
            ..State::default()
        };
        self.engine.write_energy(&mut state.physics);
        state.object_count = self.engine.objects(&mut state.objects) as u32;
        state
    }

    /// Accepts a command if it is newer than the present one; returns whether it was.
    pub fn take(&mut self, command: &Command) -> bool {
        self.drive.take(command)
    }

    /// Tick of the present command; -1 without a command.
    #[must_use]
    pub fn command_tick(&self) -> i64 {
        self.drive.command_tick()
    }

    /// Advances by one tick under the present command.
    ///
    /// # Errors
    /// [`PlantError::NotFinite`] if the state left the finite numbers; the plant is invalid from then on.
    pub fn advance(&mut self) -> Result<(), PlantError> {
        let (drive, action) = self.drive.act(self.tick, self.command_timeout_ticks, self.brake_damping);
        self.applied = drive;
        self.last = self.engine.advance(action, TICK_US);
        if !self.engine.is_finite() {
            let n = self.chain().dof();
            let (q, qd) = self.engine.joints();
            let mut objects = [ObjectState::default(); MAX_OBJECTS];
            let count = self.engine.objects(&mut objects);
            return Err(PlantError::NotFinite {
                tick: self.tick,
                position: q[..n].to_vec(),
                velocity: qd[..n].to_vec(),
                objects: objects[..count].iter().map(|body| body.position).collect(),
            });
        }
        self.tick += 1;
        Ok(())
    }
}

/// Unit quaternion of a rotation matrix, x y z w.
fn quaternion(rotation: &Matrix3<f64>) -> [f64; 4] {
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
    [q.i, q.j, q.k, q.w]
}

/// Rejects a start in which two bodies are deeper in each other than their transition width plus the depth under their
/// weight.
fn reject_penetration(
    scene: &mut CollisionScene,
    q: &[f64],
    objects: &[FreeBody],
    gravity: &Vector3<f64>,
) -> Result<(), PlantError> {
    let kin = scene.chain.kinematics(q);
    let mut found = Vec::new();
    scene.update_colliders(&kin, &[0.0; MAX_JOINTS], objects);
    scene.find_contacts(objects, |_, _| Some(0.0), &mut found);
    for (index, contact) in found {
        let pair = &scene.pairs[index];
        let weight = |parent| match parent {
            BodyId::Object(i) => objects[i].mass * gravity.norm(),
            BodyId::World | BodyId::Link(_) => 0.0,
        };
        let load = weight(pair.body.parent) + weight(pair.against.parent);
        let limit_m = pair.law.transition_width + pair.law.depth_at(load);
        if contact.depth > limit_m {
            let name = |collider: &Collider| scene.names[collider.name_index].clone();
            return Err(PlantError::StartsInside {
                depth_m: contact.depth,
                body: name(&pair.body),
                against: name(&pair.against),
                limit_m,
            });
        }
    }
    Ok(())
}

fn start_position(configured: &[f64], chain: &Chain) -> Result<[f64; MAX_JOINTS], PlantError> {
    let n = chain.dof();
    if configured.len() != n {
        return Err(PlantError::Start {
            place: String::new(),
            found: format!("{} values", configured.len()),
            expected: format!("{n}, one for each joint from '{}' to '{}'", chain.base_link(), chain.tip_link()),
        });
    }
    let mut q = [0.0; MAX_JOINTS];
    for (i, (joint, &value)) in chain.joints().iter().zip(configured).enumerate() {
        if value < joint.lower || value > joint.upper {
            return Err(PlantError::Start {
                place: format!("[{i}]"),
                found: value.to_string(),
                expected: format!("{} to {}, the limits of joint '{}'", joint.lower, joint.upper, joint.name),
            });
        }
        q[i] = value;
    }
    Ok(q)
}
