//! One implicit sub-step of everything that may be in contact.

use crate::contact_law::ContactLaw;
use crate::newton::{MAX_POINTS, MAX_SPEEDS, Point, Row};
use crate::object::FreeBody;
use crate::scene::{Carrier, Pair, Side};
use crate::touch::Touch;
use crate::world::{CLEARANCE, World};
use hapfic_robot::{JointVector, Kinematics};
use nalgebra::Vector3;

/// What takes part in a sub-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taking {
    /// Leg and objects.
    All,
    /// The objects; the leg is far away.
    Objects,
    /// The objects; the leg is held where it is, and may be in their way.
    ObjectsAndHeldLeg,
}

impl Taking {
    fn pair(self, pair: &Pair) -> bool {
        match self {
            Self::All => true,
            Self::Objects => !pair.has_link(),
            Self::ObjectsAndHeldLeg => pair.has_object(),
        }
    }
}

/// Whose a point is: a pair with its place and directions, or a joint's stop.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Owner {
    Pair { index: usize, touch: Touch, tangents: [Vector3<f64>; 2] },
    Stop,
}

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

/// Two unit vectors across a normal.
fn tangents(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let least = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = (least - normal * normal.dot(&least)).normalize();
    [first, normal.cross(&first)]
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

    /// The row that maps speeds to how fast `body` moves along a direction, seen from `against`, at a point.
    fn row(&self, pair: (&Side, &Side), point: &Vector3<f64>, direction: &Vector3<f64>) -> Row {
        let mut row = [0.0; MAX_SPEEDS];
        for (side, sign) in [(pair.0, 1.0), (pair.1, -1.0)] {
            match side.carrier {
                Carrier::World => {}
                Carrier::Link(i) => {
                    let jacobian = self.kin.point_jacobian(i, point);
                    for (value, column) in row.iter_mut().zip(&jacobian.linear).take(self.leg) {
                        *value += sign * column.dot(direction);
                    }
                }
                Carrier::Object(i) => {
                    let lever = (point - self.objects[i].position).cross(direction);
                    let at = self.object(i);
                    for k in 0..3 {
                        row[at + k] += sign * direction[k];
                        row[at + 3 + k] += sign * lever[k];
                    }
                }
            }
        }
        row
    }
}

impl World {
    /// One implicit sub-step of `h`, s.
    pub(crate) fn press(&mut self, taking: Taking, kin: &Kinematics, torque: &JointVector, damping: &JointVector, h: f64) {
        let leg = if taking == Taking::All { self.n() } else { 0 };
        let left_out = self.gather(taking, kin, h);
        self.newton.n = leg + 6 * self.objects.len();
        self.newton.clear();
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
        self.tally(h, &v);
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
        for i in 0..n {
            let mut momentum = 0.0;
            for j in 0..n {
                newton.matrix[i][j] = mass[(i, j)];
                momentum += mass[(i, j)] * self.qd[j];
            }
            newton.matrix[i][i] += h * damping[i];
            newton.impulse[i] = momentum + h * (torque[i] - bias[i]);
        }
    }

    fn set_up_objects(&mut self, leg: usize, h: f64) {
        let newton = &mut self.newton;
        for (index, body) in self.objects.iter().enumerate() {
            let at = leg + 6 * index;
            let (inertia, momentum) = (body.world_inertia(), body.angular_momentum());
            for k in 0..3 {
                newton.v0[at + k] = body.velocity[k];
                newton.v0[at + 3 + k] = body.angular_velocity[k];
                newton.matrix[at + k][at + k] = body.mass;
                newton.impulse[at + k] = body.mass * (body.velocity[k] + h * self.gravity[k]);
                for l in 0..3 {
                    newton.matrix[at + 3 + k][at + 3 + l] = inertia[(k, l)];
                }
                newton.impulse[at + 3 + k] = momentum[k];
            }
        }
    }

    /// Stops and contact points within reach of a sub-step of `h`, s. Returns how many there was no room for.
    fn gather(&mut self, taking: Taking, kin: &Kinematics, h: f64) -> usize {
        self.points.clear();
        self.owners.clear();
        let leg = if taking == Taking::All { self.n() } else { 0 };
        for (i, joint) in self.scene.chain.joints().iter().enumerate().take(leg) {
            let way = CLEARANCE + 2.0 * h * self.qd[i].abs();
            for (depth, sign) in [(joint.lower - self.q[i], 1.0), (self.q[i] - joint.upper, -1.0)] {
                if depth > -way && self.points.len() < MAX_POINTS {
                    let mut normal = [0.0; MAX_SPEEDS];
                    normal[i] = sign;
                    let zero = [0.0; MAX_SPEEDS];
                    self.points.push(Point { normal, tangents: [zero; 2], rough: false, depth, law: stop(self.effort[i]) });
                    self.owners.push(Owner::Stop);
                }
            }
        }
        let (qd, objects, n) = (&self.qd, &self.objects, self.scene.chain.dof());
        let reach = |scene: &crate::scene::Scene, pair: &Pair| {
            taking.pair(pair).then(|| CLEARANCE + 2.0 * h * scene.closing_speed(pair, kin, &qd[..n], objects))
        };
        self.scene.find(kin, objects, reach, &mut self.found);
        let layout = Layout { kin, objects: &self.objects, leg };
        let room = MAX_POINTS - self.points.len();
        for (index, touch) in self.found.iter().take(room) {
            let pair = &self.scene.pairs[*index];
            let tangents = tangents(&touch.normal);
            let row = |direction: &Vector3<f64>| layout.row((&pair.body, &pair.against), &touch.point, direction);
            self.points.push(Point {
                normal: row(&touch.normal),
                tangents: [row(&tangents[0]), row(&tangents[1])],
                rough: pair.law.friction_static > 0.0,
                depth: touch.depth,
                law: pair.law,
            });
            self.owners.push(Owner::Pair { index: *index, touch: *touch, tangents });
        }
        self.found.len().saturating_sub(room)
    }

    /// Adds the forces of a sub-step to the tick's sums.
    fn tally(&mut self, h: f64, v: &Row) {
        let n = self.newton.n;
        for ((point, force), owner) in self.points.iter().zip(&self.forces).zip(&self.owners) {
            let Owner::Pair { index, touch, tangents } = owner else { continue };
            if force[0] <= 0.0 {
                continue;
            }
            let middle = |row: &Row| (0..n).map(|i| 0.5 * row[i] * (self.newton.v0[i] + v[i])).sum::<f64>();
            self.contact_work += h
                * (force[0] * middle(&point.normal)
                    + force[1] * middle(&point.tangents[0])
                    + force[2] * middle(&point.tangents[1]));
            let sensed = self.scene.pairs[*index].sensed;
            let total = touch.normal * force[0] + tangents[0] * force[1] + tangents[1] * force[2];
            self.account.add(*index, sensed, touch, total, h);
            self.account.peak_normal = self.account.peak_normal.max(force[0]);
        }
    }

    /// What a held leg's contacts with the world carry: without motion only the springs count.
    pub(crate) fn read_held_contact(&mut self, kin: &Kinematics, duration: f64) {
        let wanted = |_: &crate::scene::Scene, pair: &Pair| (!pair.has_object()).then_some(CLEARANCE);
        self.scene.find(kin, &self.objects, wanted, &mut self.found);
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
        self.scene.find(&kin, &self.objects, |_, _| Some(0.0), &mut self.found);
        self.found.iter().map(|(index, touch)| self.scene.pairs[*index].law.stored(touch.depth)).sum()
    }
}
