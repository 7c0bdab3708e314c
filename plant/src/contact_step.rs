//! One implicit sub-step of everything that may be in contact.

use crate::collider::{Body, Collider};
use crate::contact_law::ContactLaw;
use crate::newton::MAX_POINTS;
use crate::object::FreeBody;
use crate::point::Point;
use crate::scene::Pair;
use crate::step_scope::{CLEARANCE, ConstraintSource, StepScope};
use crate::velocities::{MAX_SPEEDS, VelocityVector};
use crate::world::World;
use hapfic_robot::{JointVector, Kinematics};
use nalgebra::{Matrix3, Vector3};

/// The stop at a joint's limit: a stiff, well damped contact law over the angle, rad (m for a prismatic joint), that holds the
/// joint's full effort with 2 mrad (mm).
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

/// A normal and two unit vectors across it, as columns.
fn axes(normal: &Vector3<f64>) -> Matrix3<f64> {
    let least = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = (least - normal * normal.dot(&least)).normalize();
    Matrix3::from_columns(&[*normal, first, normal.cross(&first)])
}

/// Where the speeds of leg and objects stand in a row.
#[derive(Clone, Copy, Debug)]
struct Layout<'a> {
    kin: &'a Kinematics,
    objects: &'a [FreeBody],
    /// Speeds of the leg; none if it does not take part.
    leg: usize,
}

impl Layout<'_> {
    fn object(&self, index: usize) -> usize {
        self.leg + 6 * index
    }

    /// Says which speeds the motion of `body` seen from `against` depends on at a point, along three directions.
    fn couple(&self, pair: &Pair, at: &Vector3<f64>, axes: &Matrix3<f64>, point: &mut Point) {
        let mut sides = [(&pair.body, 1.0), (&pair.against, -1.0)];
        // In the order of the speeds.
        if let [(Collider { carrier: Body::Object(i), .. }, _), (Collider { carrier: Body::Object(j), .. }, _)] = sides
            && i > j
        {
            sides.swap(0, 1);
        }
        for (side, sign) in sides {
            match side.carrier {
                Body::World => {}
                Body::Link(_) if self.leg == 0 => {}
                Body::Link(i) => {
                    let jacobian = self.kin.point_jacobian(i, at);
                    for (index, column) in jacobian.linear[..=i].iter().enumerate() {
                        point.depends_on(index, axes.tr_mul(&(column * sign)));
                    }
                }
                Body::Object(i) => {
                    let (first, arm) = (self.object(i), at - self.objects[i].position);
                    let along = axes.transpose() * sign;
                    for k in 0..3 {
                        point.depends_on(first + k, along.column(k).into_owned());
                    }
                    // In its rows: the moment of a unit force along each direction.
                    let moments = Matrix3::from_rows(
                        &[0, 1, 2].map(|row| along.row(row)).map(|axis| arm.cross(&axis.transpose()).transpose()),
                    );
                    for k in 0..3 {
                        point.depends_on(first + 3 + k, moments.column(k).into_owned());
                    }
                }
            }
        }
    }
}

impl World {
    /// One implicit sub-step of `h`, s.
    pub(crate) fn press(&mut self, taking: StepScope, kin: &Kinematics, torque: &JointVector, damping: &JointVector, h: f64) {
        let leg = if taking == StepScope::All { self.n() } else { 0 };
        let left_out = self.collect_constraints(taking, kin, h);
        self.newton.leg = leg;
        self.newton.count = self.objects.len();
        if leg > 0 {
            self.set_up_leg(kin, torque, damping, h);
        }
        self.set_up_objects(leg, h);
        let mut v = [0.0; MAX_SPEEDS];
        let solved = self.newton.solve(h, &self.points, &mut v, &mut self.forces);
        let physics = &mut self.account.physics;
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
            body.push(Vector3::new(v[0], v[1], v[2]), Vector3::new(v[3], v[4], v[5]), h);
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

    /// Stops and contact points within reach of a sub-step of `h`, s. Returns how many there was no room for.
    fn collect_constraints(&mut self, taking: StepScope, kin: &Kinematics, h: f64) -> usize {
        self.points.clear();
        self.owners.clear();
        let leg = if taking == StepScope::All { self.n() } else { 0 };
        for (i, joint) in self.scene.chain.joints().iter().enumerate().take(leg) {
            let way = CLEARANCE + 2.0 * h * self.qd[i].abs();
            for (depth, sign) in [(joint.lower - self.q[i], 1.0), (self.q[i] - joint.upper, -1.0)] {
                if depth > -way && self.points.len() < MAX_POINTS {
                    let mut point = Point::new(depth, stop(self.effort[i]));
                    point.depends_on(i, Vector3::new(sign, 0.0, 0.0));
                    self.points.push(point);
                    self.owners.push(ConstraintSource::Stop);
                }
            }
        }
        let reach = |scene: &crate::scene::Scene, index: usize| {
            taking.pair(&scene.pairs[index]).then(|| CLEARANCE + 2.0 * h * scene.closing_speed(index))
        };
        self.scene.find(&self.objects, reach, &mut self.found);
        let layout = Layout { kin, objects: &self.objects, leg };
        let room = MAX_POINTS - self.points.len();
        for (index, touch) in self.found.iter().take(room) {
            let pair = &self.scene.pairs[*index];
            let axes = axes(&touch.normal);
            let mut point = Point::new(touch.depth, pair.law);
            layout.couple(pair, &touch.point, &axes, &mut point);
            self.points.push(point);
            self.owners.push(ConstraintSource::Pair { index: *index, touch: *touch, axes });
        }
        self.found.len().saturating_sub(room)
    }

    /// Adds the forces of a sub-step to the tick's sums.
    fn accumulate(&mut self, h: f64, v: &VelocityVector) {
        let mut middle = [0.0; MAX_SPEEDS];
        for ((middle, before), after) in middle.iter_mut().zip(&self.newton.v0).zip(v).take(self.newton.n()) {
            *middle = 0.5 * (before + after);
        }
        for ((point, force), owner) in self.points.iter().zip(&self.forces).zip(&self.owners) {
            let ConstraintSource::Pair { index, touch, axes } = owner else { continue };
            if force.x <= 0.0 {
                continue;
            }
            self.contact_work += h * force.dot(&point.speeds(&middle));
            let sensed = self.scene.pairs[*index].sensed;
            self.account.add(*index, sensed, touch, axes * force, h);
            self.account.peak_normal = self.account.peak_normal.max(force.x);
        }
    }

    /// What a held leg's contacts with the world carry: without motion only the springs count.
    pub(crate) fn read_held_contact(&mut self, duration: f64) {
        let wanted = |scene: &crate::scene::Scene, index: usize| (!scene.pairs[index].has_object()).then_some(CLEARANCE);
        self.scene.find(&self.objects, wanted, &mut self.found);
        for (index, touch) in &self.found {
            let pair = &self.scene.pairs[*index];
            let force = pair.law.normal(touch.depth, 0.0).force;
            self.account.add(*index, pair.sensed, touch, touch.normal * force, duration);
        }
    }

    /// Elastic energy in the contacts now, J.
    #[must_use]
    pub fn contact_stored(&mut self) -> f64 {
        let kin = self.kinematics();
        self.place(&kin);
        self.scene.find(&self.objects, |_, _| Some(0.0), &mut self.found);
        self.found.iter().map(|(index, touch)| self.scene.pairs[*index].law.stored(touch.depth)).sum()
    }
}
