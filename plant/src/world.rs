//! The integrator: advances the articulated velocities through free flight and contact.
//!
//! Time is counted in whole microseconds, so that a tick is always the same sum of sub-steps. Away from everything a sub-step is
//! one of the classic fourth-order Runge-Kutta method; near a contact or a joint's stop it is a short implicit one
//! ([`crate::newton`]).

use crate::contact_law::ContactLaw;
use crate::newton::{self, MAX_POINTS, MAX_SPEEDS, Newton, Point, PointForce, Row};
use crate::scene::{Carrier, Pair, Scene, Side, Touch};
use hapfic_ipc::message::{ContactState, MAX_CONTACTS, Physics};
use hapfic_robot::{JointVector, Kinematics, MAX_JOINTS};
use nalgebra::Vector3;

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
/// Share of a damped velocity that may decay in a Runge-Kutta sub-step; the method is unstable beyond 2.8.
const DECAY: f64 = 0.5;
/// A contact this near, m, is treated as one, besides the way that can be covered in a sub-step.
const CLEARANCE: f64 = 1e-4;

/// What the drive does for a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// The brakes hold the joints where they are.
    Held,
    /// A torque on each joint, held for the tick.
    Torque(JointVector),
    /// No torque; damping on each joint, N m s/rad.
    Damped(f64),
}

/// Lengths of the sub-steps, us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Substeps {
    /// Away from contact.
    pub flight_us: u32,
    /// In contact.
    pub contact_us: u32,
}

/// What came out of a tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Advance {
    /// Mean force on the sensor, N.
    pub sensed_force: Vector3<f64>,
    /// Mean torque of the drive.
    pub torque: JointVector,
    /// Largest normal force of any sub-step on any contact, N.
    pub peak_normal: f64,
    /// Contacts of the tick, one a pair.
    pub contacts: [ContactState; MAX_CONTACTS],
    /// How many of them.
    pub contact_count: usize,
    /// The account; energies are filled in by [`World::energy`].
    pub physics: Physics,
}

/// The world in motion.
#[derive(Debug)]
pub struct World {
    pub(crate) scene: Scene,
    /// q.
    pub q: JointVector,
    /// q'.
    pub qd: JointVector,
    /// Gravity, m/s^2.
    pub gravity: Vector3<f64>,
    damping: JointVector,
    effort: JointVector,
    substeps: Substeps,
    newton: Newton,
    points: Vec<Point>,
    forces: Vec<PointForce>,
    owners: Vec<Owner>,
    contact_work: f64,
}

/// Whose a point is: a pair with its place and directions, or a joint's stop.
#[derive(Clone, Copy, Debug)]
enum Owner {
    Pair { index: usize, touch: Touch, tangents: [Vector3<f64>; 2] },
    Stop,
}

impl World {
    pub(crate) fn new(
        scene: Scene,
        q: JointVector,
        gravity: Vector3<f64>,
        damping: JointVector,
        effort: JointVector,
        substeps: Substeps,
    ) -> Self {
        let n = scene.chain.dof();
        Self {
            scene,
            q,
            qd: [0.0; MAX_JOINTS],
            gravity,
            damping,
            effort,
            substeps,
            newton: Newton::new(n),
            points: Vec::with_capacity(MAX_POINTS),
            forces: vec![[0.0; 3]; MAX_POINTS],
            owners: Vec::with_capacity(MAX_POINTS),
            contact_work: 0.0,
        }
    }

    fn n(&self) -> usize {
        self.scene.chain.dof()
    }

    /// Forward kinematics at the present position.
    #[must_use]
    pub fn kinematics(&self) -> Kinematics {
        self.scene.chain.kinematics(&self.q)
    }

    /// Kinetic and potential energy, J.
    #[must_use]
    pub fn energy(&self) -> f64 {
        let kin = self.kinematics();
        self.scene.chain.kinetic_energy(&kin, &self.qd) + self.scene.chain.potential_energy(&kin, &self.gravity)
    }

    /// Work the contacts have done on the bodies since the start, J.
    #[must_use]
    pub fn contact_work(&self) -> f64 {
        self.contact_work
    }

    /// Advances by a whole number of microseconds, at least one, under one action.
    pub fn advance(&mut self, action: Action, duration_us: u32) -> Advance {
        let mut sum = Accumulator::default();
        if action == Action::Held {
            self.qd = [0.0; MAX_JOINTS];
            self.read_held_contact(&mut sum, duration_us);
            return sum.finish(&self.scene.pairs, duration_us);
        }
        let n = self.n();
        let (mut torque, extra) = match action {
            Action::Torque(torque) => (torque, 0.0),
            Action::Damped(damping) => ([0.0; MAX_JOINTS], damping),
            Action::Held => ([0.0; MAX_JOINTS], 0.0),
        };
        let mut damping = self.damping;
        for i in 0..n {
            torque[i] = torque[i].clamp(-self.effort[i], self.effort[i]);
            damping[i] += extra;
        }
        let before = self.q;
        let mut left = duration_us;
        while left > 0 {
            let kin = self.kinematics();
            let flight = left.min(self.substeps.flight_us);
            sum.physics.substeps += 1;
            if self.is_clear(&kin, seconds(flight)) && self.is_slow(&kin, &damping, seconds(flight)) {
                self.fly(&kin, &torque, &damping, seconds(flight));
                left -= flight;
            } else {
                let step = left.min(self.substeps.contact_us);
                self.press(&kin, &torque, &damping, seconds(step), &mut sum);
                left -= step;
            }
        }
        let mut advance = sum.finish(&self.scene.pairs, duration_us);
        for i in 0..n {
            // The integral of the drive's damping torque over the tick is what the joint moved.
            advance.torque[i] = torque[i] - extra * (self.q[i] - before[i]) / seconds(duration_us);
        }
        advance
    }

    /// Whether nothing can be touched within a free sub-step of `h`.
    fn is_clear(&self, kin: &Kinematics, h: f64) -> bool {
        let n = self.n();
        let stops = self.scene.chain.joints().iter().zip(&self.q).zip(&self.qd).all(|((joint, q), qd)| {
            let way = CLEARANCE + 2.0 * h * qd.abs();
            *q - way > joint.lower && *q + way < joint.upper
        });
        stops
            && self.scene.pairs.iter().all(|pair| {
                let reach = CLEARANCE + 2.0 * h * self.scene.closing_speed(pair, kin, &self.qd[..n]);
                self.scene.touch(pair, kin, reach).is_none()
            })
    }

    /// Whether damping is weak enough for an explicit sub-step of `h`: the trace of M^-1 D bounds the fastest decay.
    fn is_slow(&self, kin: &Kinematics, damping: &JointVector, h: f64) -> bool {
        let n = self.n();
        if damping[..n].iter().all(|c| *c == 0.0) {
            return true;
        }
        let Some(factor) = self.factor(kin) else { return false };
        let mut rate = 0.0;
        for i in 0..n {
            let mut unit = [0.0; MAX_SPEEDS];
            unit[i] = 1.0;
            newton::substitute(&factor, &mut unit, n);
            rate += damping[i] * unit[i];
        }
        h * rate < DECAY
    }

    /// Cholesky factor of the mass matrix; `None` if it is singular.
    fn factor(&self, kin: &Kinematics) -> Option<[Row; MAX_SPEEDS]> {
        let n = self.n();
        let mass = self.scene.chain.mass_matrix(kin);
        let mut factor = [[0.0; MAX_SPEEDS]; MAX_SPEEDS];
        for (i, row) in factor.iter_mut().enumerate().take(n) {
            for (j, value) in row.iter_mut().enumerate().take(n) {
                *value = mass[(i, j)];
            }
        }
        newton::factor(&mut factor, n).then_some(factor)
    }

    /// q'' under a torque; not a number where the mass matrix is singular, which the plant reports.
    fn acceleration(&self, kin: &Kinematics, qd: &JointVector, torque: &JointVector, damping: &JointVector) -> JointVector {
        let n = self.n();
        let bias = self.scene.chain.bias(kin, &qd[..n], &self.gravity);
        let mut qdd = [0.0; MAX_JOINTS];
        let Some(factor) = self.factor(kin) else { return [f64::NAN; MAX_JOINTS] };
        let mut x = [0.0; MAX_SPEEDS];
        for i in 0..n {
            x[i] = torque[i] - damping[i] * qd[i] - bias[i];
        }
        newton::substitute(&factor, &mut x, n);
        qdd[..n].copy_from_slice(&x[..n]);
        qdd
    }

    /// One Runge-Kutta sub-step.
    fn fly(&mut self, kin: &Kinematics, torque: &JointVector, damping: &JointVector, h: f64) {
        let n = self.n();
        let (q0, v0) = (self.q, self.qd);
        let at = |v: &JointVector, a: &JointVector, s: f64| {
            let (mut q, mut w) = (q0, v0);
            for i in 0..n {
                q[i] += s * v[i];
                w[i] += s * a[i];
            }
            (q, w)
        };
        let a1 = self.acceleration(kin, &v0, torque, damping);
        let (q2, v2) = at(&v0, &a1, 0.5 * h);
        let a2 = self.acceleration(&self.scene.chain.kinematics(&q2), &v2, torque, damping);
        let (q3, v3) = at(&v2, &a2, 0.5 * h);
        let a3 = self.acceleration(&self.scene.chain.kinematics(&q3), &v3, torque, damping);
        let (q4, v4) = at(&v3, &a3, h);
        let a4 = self.acceleration(&self.scene.chain.kinematics(&q4), &v4, torque, damping);
        for i in 0..n {
            self.q[i] = q0[i] + h / 6.0 * (v0[i] + 2.0 * (v2[i] + v3[i]) + v4[i]);
            self.qd[i] = v0[i] + h / 6.0 * (a1[i] + 2.0 * (a2[i] + a3[i]) + a4[i]);
        }
    }

    /// One implicit sub-step in contact.
    fn press(&mut self, kin: &Kinematics, torque: &JointVector, damping: &JointVector, h: f64, sum: &mut Accumulator) {
        let n = self.n();
        let left_out = self.gather(kin, h);
        let chain = &self.scene.chain;
        let mass = chain.mass_matrix(kin);
        let bias = chain.bias(kin, &self.qd[..n], &self.gravity);
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
        let mut v = [0.0; MAX_SPEEDS];
        let solved = newton.solve(h, &self.points, &mut v, &mut self.forces);
        sum.physics.newton_iterations += solved.iterations;
        sum.physics.unconverged += u32::from(!solved.converged || left_out > 0);
        for ((q, before), after) in self.q.iter_mut().zip(&self.qd).zip(&v).take(n) {
            *q += h * 0.5 * (before + after);
        }
        self.qd[..n].copy_from_slice(&v[..n]);
        self.account(h, sum);
    }

    /// Stops and contact points within reach of a sub-step of `h`. Returns how many points there was no room for.
    fn gather(&mut self, kin: &Kinematics, h: f64) -> u32 {
        let n = self.n();
        self.points.clear();
        self.owners.clear();
        let mut left_out = 0;
        for (i, joint) in self.scene.chain.joints().iter().enumerate() {
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
        for (index, pair) in self.scene.pairs.iter().enumerate() {
            let reach = CLEARANCE + 2.0 * h * self.scene.closing_speed(pair, kin, &self.qd[..n]);
            let Some(touch) = self.scene.touch(pair, kin, reach) else { continue };
            let tangents = tangents(&touch.normal);
            let row = |direction: &Vector3<f64>| relative_row(pair.body, pair.against, kin, &touch.point, direction);
            if self.points.len() == MAX_POINTS {
                left_out += 1;
            } else {
                self.points.push(Point {
                    normal: row(&touch.normal),
                    tangents: [row(&tangents[0]), row(&tangents[1])],
                    rough: pair.law.friction_static > 0.0,
                    depth: touch.depth,
                    law: pair.law,
                });
                self.owners.push(Owner::Pair { index, touch, tangents });
            }
        }
        left_out
    }

    /// Adds the forces of a sub-step to the tick's sums.
    fn account(&mut self, h: f64, sum: &mut Accumulator) {
        let n = self.n();
        for ((point, force), owner) in self.points.iter().zip(&self.forces).zip(&self.owners) {
            let middle = |row: &Row| (0..n).map(|i| 0.5 * row[i] * (self.newton.v0[i] + self.qd[i])).sum::<f64>();
            let work = h
                * (force[0] * middle(&point.normal)
                    + force[1] * middle(&point.tangents[0])
                    + force[2] * middle(&point.tangents[1]));
            let Owner::Pair { index, touch, tangents } = owner else { continue };
            self.contact_work += work;
            let sensed = self.scene.pairs[*index].sensed;
            sum.add(*index, sensed, touch, touch.normal * force[0] + tangents[0] * force[1] + tangents[1] * force[2], h);
            sum.peak_normal = sum.peak_normal.max(force[0]);
        }
    }

    /// What the contacts of a standing leg carry: without motion only the springs count.
    fn read_held_contact(&self, sum: &mut Accumulator, duration_us: u32) {
        let kin = self.kinematics();
        for (index, pair) in self.scene.pairs.iter().enumerate() {
            if let Some(touch) = self.scene.touch(pair, &kin, CLEARANCE) {
                let force = pair.law.normal(touch.depth, 0.0).force;
                sum.add(index, pair.sensed, &touch, touch.normal * force, seconds(duration_us));
            }
        }
    }
}

fn seconds(us: u32) -> f64 {
    f64::from(us) * 1e-6
}

/// Two unit vectors across a normal.
fn tangents(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let least = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = (least - normal * normal.dot(&least)).normalize();
    [first, normal.cross(&first)]
}

/// The row that maps velocities to how fast `body` moves along a direction, seen from `against`, at a point.
fn relative_row(body: Side, against: Side, kin: &Kinematics, point: &Vector3<f64>, direction: &Vector3<f64>) -> Row {
    let mut row = [0.0; MAX_SPEEDS];
    for (side, sign) in [(body, 1.0), (against, -1.0)] {
        match side.carrier {
            Carrier::World => {}
            Carrier::Link(i) => {
                let jacobian = kin.point_jacobian(i, point);
                for (value, column) in row.iter_mut().zip(&jacobian.linear).take(jacobian.n) {
                    *value += sign * column.dot(direction);
                }
            }
        }
    }
    row
}

/// Sums over the sub-steps of a tick.
#[derive(Clone, Copy, Debug, Default)]
struct Accumulator {
    sensed: Vector3<f64>,
    impulse: [Vector3<f64>; MAX_CONTACTS],
    last: [Option<Touch>; MAX_CONTACTS],
    peak_normal: f64,
    physics: Physics,
}

impl Accumulator {
    fn add(&mut self, pair: usize, sensed: bool, touch: &Touch, force: Vector3<f64>, h: f64) {
        if sensed {
            self.sensed += force * h;
        }
        // There is room to report a few pairs; all of them push, and are felt.
        if let (Some(impulse), Some(last)) = (self.impulse.get_mut(pair), self.last.get_mut(pair)) {
            *impulse += force * h;
            *last = Some(*touch);
        }
    }

    fn finish(self, pairs: &[Pair], duration_us: u32) -> Advance {
        let mut advance = Advance {
            sensed_force: self.sensed / seconds(duration_us),
            peak_normal: self.peak_normal,
            physics: self.physics,
            ..Advance::default()
        };
        for ((pair, impulse), last) in pairs.iter().zip(self.impulse).zip(self.last) {
            let force = impulse / seconds(duration_us);
            if let Some(touch) = last
                && force.norm_squared() > 0.0
            {
                advance.contacts[advance.contact_count] = ContactState {
                    body: pair.body.name as u32,
                    against: pair.against.name as u32,
                    point: touch.point.into(),
                    force: force.into(),
                    depth: touch.depth,
                };
                advance.contact_count += 1;
            }
        }
        advance
    }
}
