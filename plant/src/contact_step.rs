//! Implicit sub-step of all bodies that may be in contact.

use crate::collider::{BodyId, Collider};
use crate::contact_law::ContactLaw;
use crate::newton::SolveResult;
use crate::object::FreeBody;
use crate::point::ConstraintPoint;
use crate::scene::ContactPair;
use crate::step_scope::{CLEARANCE, ConstraintSource, StepScope};
use crate::velocities::{MAX_SPEEDS, VelocityVector};
use crate::world::PhysicsWorld;
use hapfic_robot::{JointVector, Kinematics};
use nalgebra::{Matrix3, Vector3};

/// Energy that the midpoint rule may add to the turn of an object by mistake, per time [W]: four times what the
/// built-in scenarios reach. Beyond, the object turns by a rule that adds none.
const MAX_TURN_ERROR_W: f64 = 2e-6;

/// Turn of a joint in a sub-step from which on the leg's equations are those of its middle [rad], or travel [m]. The
/// built-in scenarios stay below.
const FAST_TURN_RAD: f64 = 1e-4;
/// Largest change of a joint's velocity times the sub-step [rad], or [m]: beyond, the sub-step is cut. A foot
/// that hits the floor at 1 m/s stays below.
const ABRUPT_TURN_RAD: f64 = 5e-6;
/// Solutions at the middle, each of which finds it more exactly.
const MIDDLE_SOLVES: usize = 2;

/// Contact law of the stop at a joint's limit, over the angle [rad], or [m] for a prismatic joint.
///
/// Stiff and well damped: it holds the joint's full effort at a depth of 2 mrad or 2 mm.
fn stop(effort: f64) -> ContactLaw {
    let effort = if effort.is_finite() { effort } else { 0.0 };
    let stiffness = (effort / 2e-3).max(1e4);
    ContactLaw {
        stiffness,
        damping: stiffness * 1e-2,
        transition_width: 1e-3,
        friction_static: 0.0,
        friction_dynamic: 0.0,
        critical_speed: 1e-3,
    }
}

/// A normal and two unit vectors perpendicular to it, as columns.
fn axes(normal: &Vector3<f64>) -> Matrix3<f64> {
    let least = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = (least - normal * normal.dot(&least)).normalize();
    Matrix3::from_columns(&[*normal, first, normal.cross(&first)])
}

/// Positions of the speeds of leg and objects in the velocity vector.
#[derive(Clone, Copy, Debug)]
struct VelocityLayout<'a> {
    kin: &'a Kinematics,
    objects: &'a [FreeBody],
    /// Number of the leg's speeds; zero if the leg is not in the sub-step.
    leg: usize,
}

impl VelocityLayout<'_> {
    fn object(&self, index: usize) -> usize {
        self.leg + 6 * index
    }

    /// Adds the Jacobian columns of the motion of `body` relative to `against` at a point, along three directions.
    fn couple(&self, pair: &ContactPair, at: &Vector3<f64>, axes: &Matrix3<f64>, point: &mut ConstraintPoint) {
        let mut sides = [(&pair.body, 1.0), (&pair.against, -1.0)];
        // In the order of the speeds.
        if let [(Collider { parent: BodyId::Object(i), .. }, _), (Collider { parent: BodyId::Object(j), .. }, _)] = sides
            && i > j
        {
            sides.swap(0, 1);
        }
        for (collider, sign) in sides {
            match collider.parent {
                BodyId::World => {}
                BodyId::Link(_) if self.leg == 0 => {}
                BodyId::Link(i) => {
                    let jacobian = self.kin.point_jacobian(i, at);
                    for (index, column) in jacobian.linear[..=i].iter().enumerate() {
                        point.add_column(index, axes.tr_mul(&(column * sign)));
                    }
                }
                BodyId::Object(i) => {
                    let (first, arm) = (self.object(i), at - self.objects[i].position);
                    let along = axes.transpose() * sign;
                    for k in 0..3 {
                        point.add_column(first + k, along.column(k).into_owned());
                    }
                    // Row k: the moment of a unit force along direction k.
                    let moments = Matrix3::from_rows(
                        &[0, 1, 2].map(|row| along.row(row)).map(|axis| arm.cross(&axis.transpose()).transpose()),
                    );
                    for k in 0..3 {
                        point.add_column(first + 3 + k, moments.column(k).into_owned());
                    }
                }
            }
        }
    }
}

/// An attempt at a sub-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Attempt {
    /// A whole sub-step.
    Whole,
    /// A part of a sub-step that was cut.
    Part,
    /// The shortest part: it is taken as it is.
    Last,
}

/// Force at a contact point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointForce {
    /// Index of the body among the names of the scene.
    pub body: usize,
    /// Index of the body that feels the opposite force.
    pub against: usize,
    /// Unit normal, from the second body to the first.
    pub normal: Vector3<f64>,
    /// Force on the first body [N], world frame.
    pub force: Vector3<f64>,
    /// Contact law of the pair.
    pub law: ContactLaw,
}

impl PhysicsWorld {
    /// Advances the bodies in `scope` by one implicit sub-step of `h` [s]; returns whether it holds.
    ///
    /// It holds if the solver converged, and no joint's motion changed too abruptly. If it does not, no body has moved,
    /// except in the last attempt, which takes what the solver has.
    pub(crate) fn try_contact_step(
        &mut self,
        scope: StepScope,
        kin: &Kinematics,
        torque: &JointVector,
        damping: &JointVector,
        h: f64,
        attempt: Attempt,
    ) -> bool {
        let leg = if scope == StepScope::All { self.n() } else { 0 };
        self.collect_constraints(scope, kin, h);
        self.newton.leg = leg;
        self.newton.count = self.objects.len();
        if leg > 0 {
            self.set_up_leg(kin, &self.qd.clone(), torque, damping, h);
        }
        self.set_up_objects(leg, h);
        let mut v = [0.0; MAX_SPEEDS];
        let mut solved = self.newton.solve(h, &self.points, &mut v, &mut self.forces);
        self.tick_sums.physics.newton_iterations += solved.iterations;
        if leg > 0 && (attempt != Attempt::Whole || self.qd[..leg].iter().any(|rate| rate.abs() * h > FAST_TURN_RAD)) {
            for _ in 0..MIDDLE_SOLVES {
                solved = self.solve_at_middle(torque, damping, h, &mut v);
            }
        }
        let abrupt = self.qd[..leg].iter().zip(&v).any(|(before, after)| (after - before).abs() * h > ABRUPT_TURN_RAD);
        if (!solved.converged || abrupt) && attempt != Attempt::Last {
            return false;
        }
        let mut mean = [0.0; MAX_SPEEDS];
        for ((mean, before), after) in mean.iter_mut().zip(&self.newton.v0).zip(&v).take(self.newton.n()) {
            *mean = 0.5 * (before + after);
        }
        for (index, body) in self.objects.iter_mut().enumerate() {
            let at = leg + 6 * index;
            let (velocity, angular) = (Vector3::new(v[at], v[at + 1], v[at + 2]), Vector3::new(v[at + 3], v[at + 4], v[at + 5]));
            let start = *body;
            if body.apply_contact_velocities(velocity, angular, h).abs() > h * MAX_TURN_ERROR_W {
                *body = start;
                let turn = body.apply_keeping_energy(velocity, angular, h) / h;
                mean[at + 3..at + 6].copy_from_slice(turn.as_slice());
            }
        }
        for ((q, before), after) in self.q.iter_mut().zip(&self.qd).zip(&v).take(leg) {
            *q += h * 0.5 * (before + after);
        }
        self.qd[..leg].copy_from_slice(&v[..leg]);
        let physics = &mut self.tick_sums.physics;
        physics.substeps += 1;
        physics.contact_substeps += 1;
        physics.unconverged += u32::from(!solved.converged);
        for i in 0..leg {
            self.account.tick.damped[i] += h * v[i] * mean[i];
        }
        self.accumulate(h, &mean);
        true
    }

    /// Sets up the leg's equations with masses at a posture, and bias at a posture and its velocities.
    fn set_up_leg(&mut self, kin: &Kinematics, qd: &JointVector, torque: &JointVector, damping: &JointVector, h: f64) {
        let n = self.n();
        let mass = self.scene.chain.mass_matrix(kin);
        let bias = self.scene.chain.bias(kin, &qd[..n], &self.gravity);
        let newton = &mut self.newton;
        newton.v0[..n].copy_from_slice(&self.qd[..n]);
        newton.mass = mass;
        for i in 0..n {
            let momentum: f64 = (0..n).map(|j| mass[(i, j)] * self.qd[j]).sum();
            newton.mass[(i, i)] += h * damping[i];
            newton.impulse[i] = momentum + h * (torque[i] - bias[i]);
        }
    }

    /// Solves again with the leg's masses and bias at the middle of the motion to the velocities `v`.
    ///
    /// Those of the start leave an energy error of the order of the turn in a sub-step, which a fast leg shows.
    fn solve_at_middle(&mut self, torque: &JointVector, damping: &JointVector, h: f64, v: &mut VelocityVector) -> SolveResult {
        let n = self.n();
        let (mut q, mut qd) = (self.q, self.qd);
        for i in 0..n {
            qd[i] = 0.5 * (self.qd[i] + v[i]);
            q[i] += 0.5 * h * qd[i];
        }
        let kin = self.scene.chain.kinematics(&q);
        self.set_up_leg(&kin, &qd, torque, damping, h);
        let solved = self.newton.solve(h, &self.points, v, &mut self.forces);
        self.tick_sums.physics.newton_iterations += solved.iterations;
        solved
    }

    fn set_up_objects(&mut self, leg: usize, h: f64) {
        let newton = &mut self.newton;
        for (index, body) in self.objects.iter().enumerate() {
            let at = leg + 6 * index;
            let momentum = body.angular_momentum();
            newton.bodies[index] = (body.mass, body.world_inertia());
            for k in 0..3 {
                newton.v0[at + k] = body.velocity[k];
                newton.v0[at + 3 + k] = body.angular_velocity[k];
                newton.impulse[at + k] = body.mass * (body.velocity[k] + h * self.gravity[k]);
                newton.impulse[at + 3 + k] = momentum[k];
            }
        }
    }

    /// Collects stops and contact points within reach of a sub-step of `h` [s].
    fn collect_constraints(&mut self, scope: StepScope, kin: &Kinematics, h: f64) {
        self.points.clear();
        self.sources.clear();
        self.tick_sums.tip = kin.tip_position();
        let leg = if scope == StepScope::All { self.n() } else { 0 };
        for (i, joint) in self.scene.chain.joints().iter().enumerate().take(leg) {
            let travel = CLEARANCE + 2.0 * h * self.qd[i].abs();
            for (depth, sign) in [(joint.lower - self.q[i], 1.0), (self.q[i] - joint.upper, -1.0)] {
                if depth > -travel {
                    let mut point = ConstraintPoint::new(depth, stop(self.effort[i]));
                    point.add_column(i, Vector3::new(sign, 0.0, 0.0));
                    self.points.push(point);
                    self.sources.push(ConstraintSource::Stop);
                }
            }
        }
        let reach = |scene: &crate::scene::CollisionScene, index: usize| {
            scope.pair(&scene.pairs[index]).then(|| CLEARANCE + 2.0 * h * scene.closing_speed(index))
        };
        self.scene.find_contacts(&self.objects, reach, &mut self.contacts);
        let layout = VelocityLayout { kin, objects: &self.objects, leg };
        for (index, contact) in &self.contacts {
            let pair = &self.scene.pairs[*index];
            let axes = axes(&contact.normal);
            let mut point = ConstraintPoint::new(contact.depth, pair.law);
            layout.couple(pair, &contact.point, &axes, &mut point);
            self.points.push(point);
            self.sources.push(ConstraintSource::Pair { index: *index, contact: *contact, axes });
        }
    }

    /// Adds the forces of a sub-step, and their work over its motion at the velocities `mean`, to the sums.
    fn accumulate(&mut self, h: f64, mean: &VelocityVector) {
        for ((point, force), source) in self.points.iter().zip(&self.forces).zip(&self.sources) {
            if force.x <= 0.0 {
                continue;
            }
            let work = h * force.dot(&point.speeds(mean));
            let ConstraintSource::Pair { index, contact, axes } = source else {
                self.account.joint_work(work);
                continue;
            };
            self.account.contact_work(work);
            let sensed = self.scene.pairs[*index].sensed;
            self.tick_sums.add(*index, sensed, contact, axes * force, h);
            self.tick_sums.peak_normal = self.tick_sums.peak_normal.max(force.x);
        }
    }

    /// Adds the contact forces of a held leg: elastic parts alone, since nothing moves.
    pub(crate) fn read_held_contact(&mut self, duration: f64) {
        let reach = |scene: &crate::scene::CollisionScene, index: usize| (!scene.pairs[index].has_object()).then_some(CLEARANCE);
        self.scene.find_contacts(&self.objects, reach, &mut self.contacts);
        for (index, contact) in &self.contacts {
            let pair = &self.scene.pairs[*index];
            let force = pair.law.normal(contact.depth, 0.0).force;
            self.tick_sums.add(*index, pair.sensed, contact, contact.normal * force, duration);
        }
    }

    /// Forces of all contact points in the last implicit sub-step.
    pub fn point_forces(&self) -> impl Iterator<Item = PointForce> {
        self.points.iter().zip(&self.forces).zip(&self.sources).filter_map(|((point, force), source)| match source {
            ConstraintSource::Pair { index, contact, axes } if force.x > 0.0 => {
                let pair = &self.scene.pairs[*index];
                let (body, against) = (pair.body.name_index, pair.against.name_index);
                Some(PointForce { body, against, normal: contact.normal, force: axes * force, law: point.law })
            }
            _ => None,
        })
    }

    /// Elastic energy stored in the contacts at the present state [J], whose colliders are up to date.
    fn contact_stored(&mut self) -> f64 {
        self.scene.find_contacts(&self.objects, |_, _| Some(0.0), &mut self.contacts);
        self.contacts.iter().map(|(index, contact)| self.scene.pairs[*index].law.stored(contact.depth)).sum()
    }

    /// Closes the account of a tick that began with the energy `start_j` [J], at the state that the tick has reached.
    pub(crate) fn finish_account(&mut self, start_j: f64) {
        let kin = self.kinematics();
        self.update_colliders(&kin);
        self.account.stored_j = self.contact_stored();
        self.account.finish(start_j, self.energy_at(&kin));
    }

    /// Starts the account at the present state, without energies of contacts before.
    pub(crate) fn start_account(&mut self) {
        let kin = self.kinematics();
        self.update_colliders(&kin);
        self.account.stored_j = self.contact_stored();
    }
}
