//! Implicit sub-step of all bodies that may be in contact.

use crate::collider::{BodyId, Collider};
use crate::contact_law::ContactLaw;
use crate::newton::MAX_POINTS;
use crate::object::FreeBody;
use crate::point::ConstraintPoint;
use crate::scene::ContactPair;
use crate::step_scope::{CLEARANCE, ConstraintSource, StepScope};
use crate::velocities::{MAX_SPEEDS, VelocityVector};
use crate::world::PhysicsWorld;
use hapfic_robot::{JointVector, Kinematics};
use nalgebra::{Matrix3, Vector3};

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

impl PhysicsWorld {
    /// Advances the bodies in `scope` by one implicit sub-step of `h` [s].
    pub(crate) fn contact_step(
        &mut self,
        scope: StepScope,
        kin: &Kinematics,
        torque: &JointVector,
        damping: &JointVector,
        h: f64,
    ) {
        let leg = if scope == StepScope::All { self.n() } else { 0 };
        let left_out = self.collect_constraints(scope, kin, h);
        self.newton.leg = leg;
        self.newton.count = self.objects.len();
        if leg > 0 {
            self.set_up_leg(kin, torque, damping, h);
        }
        self.set_up_objects(leg, h);
        let mut v = [0.0; MAX_SPEEDS];
        let solved = self.newton.solve(h, &self.points, &mut v, &mut self.forces);
        let physics = &mut self.tick_sums.physics;
        physics.substeps += 1;
        physics.contact_substeps += 1;
        physics.newton_iterations += solved.iterations;
        physics.unconverged += u32::from(!solved.converged || left_out > 0);
        self.accumulate(h, &v);
        for ((q, before), after) in self.q.iter_mut().zip(&self.qd).zip(&v).take(leg) {
            *q += h * 0.5 * (before + after);
        }
        self.qd[..leg].copy_from_slice(&v[..leg]);
        for (body, v) in self.objects.iter_mut().zip(v[leg..].chunks_exact(6)) {
            body.apply_contact_velocities(Vector3::new(v[0], v[1], v[2]), Vector3::new(v[3], v[4], v[5]), h);
        }
    }

    fn set_up_leg(&mut self, kin: &Kinematics, torque: &JointVector, damping: &JointVector, h: f64) {
        let n = self.n();
        let mass = self.scene.chain.mass_matrix(kin);
        let bias = self.scene.chain.bias(kin, &self.qd[..n], &self.gravity);
        let newton = &mut self.newton;
        newton.v0[..n].copy_from_slice(&self.qd[..n]);
        newton.mass = mass;
        for i in 0..n {
            let momentum: f64 = (0..n).map(|j| mass[(i, j)] * self.qd[j]).sum();
            newton.mass[(i, i)] += h * damping[i];
            newton.impulse[i] = momentum + h * (torque[i] - bias[i]);
        }
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

    /// Collects stops and contact points within reach of a sub-step of `h` [s]; returns the number that did not fit.
    fn collect_constraints(&mut self, scope: StepScope, kin: &Kinematics, h: f64) -> usize {
        self.points.clear();
        self.sources.clear();
        let leg = if scope == StepScope::All { self.n() } else { 0 };
        for (i, joint) in self.scene.chain.joints().iter().enumerate().take(leg) {
            let travel = CLEARANCE + 2.0 * h * self.qd[i].abs();
            for (depth, sign) in [(joint.lower - self.q[i], 1.0), (self.q[i] - joint.upper, -1.0)] {
                if depth > -travel && self.points.len() < MAX_POINTS {
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
        let room = MAX_POINTS - self.points.len();
        for (index, contact) in self.contacts.iter().take(room) {
            let pair = &self.scene.pairs[*index];
            let axes = axes(&contact.normal);
            let mut point = ConstraintPoint::new(contact.depth, pair.law);
            layout.couple(pair, &contact.point, &axes, &mut point);
            self.points.push(point);
            self.sources.push(ConstraintSource::Pair { index: *index, contact: *contact, axes });
        }
        self.contacts.len().saturating_sub(room)
    }

    /// Adds the forces of a sub-step to the tick's sums.
    fn accumulate(&mut self, h: f64, v: &VelocityVector) {
        let mut midpoint = [0.0; MAX_SPEEDS];
        for ((midpoint, before), after) in midpoint.iter_mut().zip(&self.newton.v0).zip(v).take(self.newton.n()) {
            *midpoint = 0.5 * (before + after);
        }
        for ((point, force), source) in self.points.iter().zip(&self.forces).zip(&self.sources) {
            let ConstraintSource::Pair { index, contact, axes } = source else { continue };
            if force.x <= 0.0 {
                continue;
            }
            self.contact_work += h * force.dot(&point.speeds(&midpoint));
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

    /// Elastic energy stored in the contacts at the present state [J].
    #[must_use]
    pub fn contact_stored(&mut self) -> f64 {
        let kin = self.kinematics();
        self.update_colliders(&kin);
        self.scene.find_contacts(&self.objects, |_, _| Some(0.0), &mut self.contacts);
        self.contacts.iter().map(|(index, contact)| self.scene.pairs[*index].law.stored(contact.depth)).sum()
    }
}
