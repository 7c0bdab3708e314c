//! Contacts of free bodies against theory, and against explicit integration of the same law at 1 us.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use hapfic_config::Settings;
use hapfic_messages::MAX_JOINTS;
use hapfic_plant::{ContactLaw, DriveAction, FreeBody, Plant};
use nalgebra::{DVector, Matrix3, UnitQuaternion, Vector3};

const G: f64 = 9.81;
const FREE: DriveAction = DriveAction::Torque([0.0; MAX_JOINTS]);

const RIGID: ContactLaw = ContactLaw {
    stiffness: 1e6,
    damping: 1e4,
    transition_width: 1e-3,
    friction_static: 0.5,
    friction_dynamic: 0.3,
    critical_speed: 1e-3,
};
const SOFT: ContactLaw = ContactLaw { stiffness: 1e3, damping: 1e2, ..RIGID };

/// A leg, and an object on a floor with friction.
fn world(object: &str, leg: &str) -> Plant {
    let scenario = format!(
        "[robot]\nurdf = \"leg.urdf\"\nbase_link = \"base\"\ntip_link = \"foot\"\n{leg}\n\
         [world.floor]\nfriction_static = 0.5\nfriction_dynamic = 0.3\n[[world.object]]\nname = \"it\"\n{object}\n"
    );
    let urdf = hapfic_config::robots()[0].1;
    Plant::new(&Settings::from_effective(&scenario, "leg.urdf", urdf).unwrap()).unwrap()
}

const AWAY: &str = "base_position_m = [0, 0, 50]\nstart_position_rad = [0, 0.6, -1.2]";
const CUBE: &str = "shape = \"box\"\nsize_m = [0.2, 0.2, 0.2]\nmass_kg = 2.0\nposition_m = [1.0, 0, 0.1]";

/// A cube at rest on the floor.
fn settled_cube() -> Plant {
    let mut plant = world(CUBE, AWAY);
    for _ in 0..300 {
        plant.world().advance(FREE, 1000);
    }
    plant
}

/// Advances under a side force of `share` times the weight, applied as tilted gravity.
fn advance_pushed(plant: &mut Plant, share: f64, ticks: usize) {
    plant.world().gravity = Vector3::new(share * G, 0.0, -G);
    for _ in 0..ticks {
        plant.world().advance(FREE, 1000);
    }
}

#[test]
fn cube_at_rest_has_depth_of_law() {
    let mut plant = settled_cube();
    let advance = plant.world().advance(FREE, 1000);
    let contact = advance.contacts[0];
    assert_eq!(advance.contact_count, 1);
    assert!((contact.force[2] - 2.0 * G).abs() < 1e-5, "{contact:?}");
    let theory = RIGID.depth_at(2.0 * G / 4.0);
    assert!((contact.depth / theory - 1.0).abs() < 1e-6, "{} against {theory}", contact.depth);
    assert!((contact.point[0] - 1.0).abs() < 1e-9 && contact.point[1].abs() < 1e-9);
    let body = &plant.world().objects[0];
    assert!(body.velocity.norm() < 1e-9 && body.angular_velocity.norm() < 1e-9);
}

#[test]
fn cube_pushed_creeps_by_law() {
    let mut plant = settled_cube();
    for share in [0.1, 0.25, 0.4, 0.45] {
        advance_pushed(&mut plant, share, 500);
        // mu_s r (2 - r) = share.
        let theory = RIGID.critical_speed * (1.0 - (1.0 - share / RIGID.friction_static).sqrt());
        let speed = plant.world().objects[0].velocity.x;
        assert!((speed / theory - 1.0).abs() < 1e-3, "share {share}: {speed} against {theory}");
    }
}

#[test]
fn cube_at_static_friction_breaks_away() {
    let mut plant = settled_cube();
    let mut share = 0.45;
    // Slowly, so that the cube does not rock.
    for i in 1..=100 {
        advance_pushed(&mut plant, share * f64::from(i) / 100.0, 10);
    }
    while plant.world().objects[0].velocity.x < 2.0 * RIGID.critical_speed {
        share += 1e-4;
        assert!(share < 0.6, "the cube does not break away");
        advance_pushed(&mut plant, share, 5);
    }
    assert!((share / RIGID.friction_static - 1.0).abs() < 0.01, "broke away at {share}");
}

#[test]
fn cube_sliding_has_dynamic_friction() {
    let mut plant = settled_cube();
    advance_pushed(&mut plant, 0.7, 100);
    let before = plant.world().objects[0].velocity.x;
    advance_pushed(&mut plant, 0.7, 400);
    let acceleration = (plant.world().objects[0].velocity.x - before) / 0.4;
    let theory = (0.7 - RIGID.friction_dynamic) * G;
    assert!((acceleration / theory - 1.0).abs() < 0.01, "{acceleration} against {theory}");
}

#[test]
fn ball_at_rest_has_depth_of_weight() {
    let ball = "shape = \"ball\"\nradius_m = 0.1\nmass_kg = 0.5\nposition_m = [1.0, 0, 0.1]\n\
                stiffness_n_per_m = 1e3\ndamping_n_s_per_m = 1e2";
    let mut plant = world(ball, AWAY);
    for _ in 0..2000 {
        plant.world().advance(FREE, 1000);
    }
    let depth = 0.1 - plant.world().objects[0].position.z;
    assert!((depth / (0.5 * G / 1e3) - 1.0).abs() < 1e-5, "{depth}");
}

#[test]
fn ball_rolling_does_not_slip() {
    let ball = "shape = \"ball\"\nradius_m = 0.1\nmass_kg = 0.5\nposition_m = [1.0, 0, 0.0999]";
    let mut plant = world(ball, AWAY);
    plant.world().objects[0].velocity.x = 1.0;
    for _ in 0..1500 {
        plant.world().advance(FREE, 1000);
    }
    // Friction turns a sliding start into rolling at 5/7 of the speed.
    let body = &plant.world().objects[0];
    assert!((body.velocity.x - 5.0 / 7.0).abs() < 2e-3, "{:?}", body.velocity);
    // The contact point is midway between the surfaces.
    let slip = body.velocity.x - body.angular_velocity.y * 0.5 * (body.position.z + 0.1);
    assert!(slip.abs() < 1e-4, "slip {slip}");
}

/// A free rigid body, integrated explicitly.
struct ExplicitBody {
    position: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    velocity: Vector3<f64>,
    momentum: Vector3<f64>,
    mass: f64,
    inertia: Vector3<f64>,
}

impl ExplicitBody {
    /// Copies a body of the plant, at rest.
    fn at_rest(body: &FreeBody) -> Self {
        Self {
            position: body.position,
            rotation: body.rotation,
            velocity: Vector3::zeros(),
            momentum: Vector3::zeros(),
            mass: body.mass,
            inertia: body.inertia,
        }
    }

    fn angular_velocity(&self) -> Vector3<f64> {
        self.rotation * (self.rotation.inverse() * self.momentum).component_div(&self.inertia)
    }

    /// Advances by a step of symplectic Euler.
    fn step(&mut self, force: Vector3<f64>, torque: Vector3<f64>, h: f64) {
        self.velocity += h * (force / self.mass - Vector3::z() * G);
        self.momentum += h * torque;
        self.position += h * self.velocity;
        self.rotation = UnitQuaternion::from_scaled_axis(h * self.angular_velocity()) * self.rotation;
    }
}

/// Contact force of the law at a point with `velocity` against a body at rest with `normal`.
fn force(law: &ContactLaw, depth: f64, normal: &Vector3<f64>, velocity: &Vector3<f64>) -> Vector3<f64> {
    let along = velocity.dot(normal);
    let push = law.normal(depth, -along).force;
    let slip = velocity - normal * along;
    normal * push - slip * (law.friction_per_speed(slip.norm()) * push)
}

#[test]
fn cube_tilted_falls_as_reference() {
    let tilt = 0.35_f64;
    let mut plant = world(&format!("{CUBE}\norientation_rpy_rad = [0, {tilt:?}, 0]").replace("0.1]", "0.1284]"), AWAY);
    let start = plant.world().objects[0];
    let lowest = start.position.z - 0.1 * (tilt.cos() + tilt.sin());
    assert!(lowest > 0.0 && lowest < 2e-3, "starts {lowest} m over the floor");
    let mut reference = ExplicitBody::at_rest(&start);
    let h = 1e-6;
    for _ in 0..800_000 {
        let (mut total, mut torque) = (Vector3::zeros(), Vector3::zeros());
        let omega = reference.angular_velocity();
        for corner in 0..8 {
            let sign = |bit: i32| if corner >> bit & 1 == 0 { 0.1 } else { -0.1 };
            let arm = reference.rotation * Vector3::new(sign(0), sign(1), sign(2));
            let depth = -(reference.position.z + arm.z);
            if depth > 0.0 {
                let push = force(&RIGID, depth, &Vector3::z(), &(reference.velocity + omega.cross(&arm)));
                total += push;
                torque += arm.cross(&push);
            }
        }
        reference.step(total, torque, h);
    }
    for _ in 0..800 {
        plant.world().advance(FREE, 1000);
    }
    let body = &plant.world().objects[0];
    let (moved, expected) = (body.position.x - 1.0, reference.position.x - 1.0);
    println!("tilted cube: moved {:.4} mm, reference {:.4} mm", moved * 1e3, expected * 1e3);
    assert!(expected.abs() > 5e-3, "the reference did not move: {expected}");
    assert!((moved - expected).abs() < 0.01 * expected.abs(), "{moved} against {expected}");
    assert!(body.rotation.angle_to(&reference.rotation) < 1e-3);
    assert!(body.velocity.norm() < 1e-6);
}

/// Point of the shank's axis, from knee to tip, nearest to another point.
fn on_axis(from: &Vector3<f64>, to: &Vector3<f64>, point: &Vector3<f64>) -> Vector3<f64> {
    let along = to - from;
    let share = ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    from + along * share
}

#[test]
fn ball_kicked_by_shank_has_reference_impulse() {
    // The leg hangs with a slightly bent knee and swings its shank into the ball.
    let leg = "base_position_m = [0, 0, 0.62]\nstart_position_rad = [0, 0.0, -0.2]";
    let ball = "shape = \"ball\"\nradius_m = 0.1\nmass_kg = 0.5\nposition_m = [0.18, 0.05, 0.0951]\n\
                stiffness_n_per_m = 1e3\ndamping_n_s_per_m = 1e2";
    let mut plant = world(ball, leg);
    let chain = plant.chain().clone();
    // Towards +x.
    plant.world().qd[2] = -6.0;
    let (mut q, mut qd) = (plant.world().q, plant.world().qd);
    let start = plant.world().objects[0];
    let mut reference = ExplicitBody::at_rest(&start);
    let (h, ticks) = (1e-6, 120);
    let (mut impulse, mut peak) = (Vector3::zeros(), 0.0_f64);
    for _ in 0..ticks * 1000 {
        let kin = chain.kinematics(&q);
        let knee = kin.body_origin(2);
        let tip = kin.tip_position();
        let axis = on_axis(&knee, &tip, &reference.position);
        let between = axis - reference.position;
        let depth = 0.1 + 0.02 - between.norm();
        let mut joint = [0.0; 3];
        let (mut total, mut torque) = (Vector3::zeros(), Vector3::zeros());
        let omega = reference.angular_velocity();
        if depth > 0.0 {
            // From the ball to the shank, midway between the surfaces.
            let normal = between.normalize();
            let point = reference.position + normal * (0.1 - 0.5 * depth);
            let jacobian = kin.point_jacobian(2, &point);
            let arm = point - reference.position;
            let velocity = jacobian.linear_mul(&qd[..3]) - reference.velocity - omega.cross(&arm);
            let push = force(&SOFT, depth, &normal, &velocity);
            joint.copy_from_slice(&jacobian.linear_transpose_mul(&push)[..3]);
            total -= push;
            torque -= arm.cross(&push);
            impulse += push * h;
            peak = peak.max(push.norm());
        }
        let sunk = 0.1 - reference.position.z;
        if sunk > 0.0 {
            let arm = Vector3::new(0.0, 0.0, -(0.1 - 0.5 * sunk));
            let push = force(&SOFT, sunk, &Vector3::z(), &(reference.velocity + omega.cross(&arm)));
            total += push;
            torque += arm.cross(&push);
        }
        reference.step(total, torque, h);
        let mass = chain.mass_matrix(&kin);
        let bias = chain.bias(&kin, &qd[..3], &Vector3::new(0.0, 0.0, -G));
        let right = DVector::from_fn(3, |i, _| joint[i] - bias[i]);
        let qdd = Matrix3::from_fn(|i, j| mass[(i, j)]).cholesky().unwrap().solve(&right.fixed_rows::<3>(0).into_owned());
        for i in 0..3 {
            qd[i] += h * qdd[i];
            q[i] += h * qd[i];
        }
    }
    let mut measured = Vector3::zeros();
    let mut contact_ticks = 0;
    for _ in 0..ticks {
        let advance = plant.world().advance(FREE, 1000);
        assert_eq!(advance.sensed_force, Vector3::zeros(), "the foot touched something");
        for contact in &advance.contacts[..advance.contact_count] {
            if plant.body_names()[contact.body as usize] == "shank" {
                measured += Vector3::from(contact.force) * 1e-3;
                contact_ticks += 1;
            }
        }
    }
    let error = measured.norm() / impulse.norm() - 1.0;
    println!(
        "kick: {contact_ticks} ticks, peak {peak:.1} N, impulse {:.5} N s, reference {:.5}, {:.3} %",
        measured.norm(),
        impulse.norm(),
        100.0 * error
    );
    assert!(peak > 5.0 && contact_ticks > 5, "the shank missed the ball: {peak} N, {contact_ticks} ticks");
    assert!(error.abs() < 0.005, "impulse {measured:?} against {impulse:?}");
    assert!((plant.world().objects[0].velocity - reference.velocity).norm() < 0.005 * reference.velocity.norm());
}

#[test]
fn object_start_inside_other_is_rejected() {
    for (object, what) in [
        (CUBE.replace("0.1]", "0.05]"), "it starts 0.0500 m deep in floor"),
        (CUBE.replace("[1.0, 0, 0.1]", "[0, 0, 0.1]"), "deep in it"),
    ] {
        let leg =
            if what.contains("floor") { AWAY } else { "base_position_m = [0, 0, 0.5]\nstart_position_rad = [0, 0.6, -1.2]" };
        let scenario = format!(
            "[robot]\nurdf = \"leg.urdf\"\nbase_link = \"base\"\ntip_link = \"foot\"\n{leg}\n[world.floor]\n[[world.object]]\nname = \"it\"\n{object}\n"
        );
        let settings = Settings::from_effective(&scenario, "leg.urdf", hapfic_config::robots()[0].1).unwrap();
        let error = Plant::new(&settings).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn object_name_of_link_is_rejected() {
    let scenario = format!(
        "[robot]\nurdf = \"leg.urdf\"\nbase_link = \"base\"\ntip_link = \"foot\"\n{AWAY}\n[world.floor]\n[[world.object]]\nname = \"shank\"\n{CUBE}\n"
    );
    let settings = Settings::from_effective(&scenario, "leg.urdf", hapfic_config::robots()[0].1).unwrap();
    assert!(Plant::new(&settings).unwrap_err().to_string().contains("'shank'"));
}

/// A mesh on the robot's slide comes to rest where its lowest corner touches the floor.
#[test]
fn mesh_of_link_rests_on_floor() {
    let folder = tempfile::tempdir().unwrap();
    let corners = [[0.125, 0.0, -0.25], [-0.125, 0.125, 0.0], [-0.125, -0.125, 0.0], [0.0, 0.0, 0.25]];
    let mesh: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    std::fs::write(folder.path().join("wedge.obj"), mesh + "f 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n").unwrap();
    let urdf = r#"<robot name="slide"><link name="base"/>
        <joint name="rail" type="prismatic"><parent link="base"/><child link="body"/><axis xyz="0 0 1"/>
          <limit lower="0" upper="5" effort="100" velocity="10"/></joint>
        <link name="body"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
          <collision><geometry><mesh filename="wedge.obj"/></geometry></collision></link>
        <joint name="end" type="fixed"><parent link="body"/><child link="tip"/><origin xyz="0 0 1"/></joint>
        <link name="tip"><collision><geometry><sphere radius="0.05"/></geometry></collision></link></robot>"#;
    let file = folder.path().join("slide.urdf");
    std::fs::write(&file, urdf).unwrap();
    let scenario = format!(
        "[robot]\nurdf = {file:?}\nbase_link = \"base\"\ntip_link = \"tip\"\nstart_position_rad = [0.26]\n\
         [world.floor]\nstiffness_n_per_m = 1e4\ndamping_n_s_per_m = 300.0\n"
    );
    let mut plant = Plant::new(&Settings::from_effective(&scenario, file.to_str().unwrap(), urdf).unwrap()).unwrap();
    for _ in 0..1500 {
        plant.world().advance(FREE, 1000);
    }
    let advance = plant.world().advance(FREE, 1000);
    let contact = advance.contacts[0];
    assert_eq!(advance.contact_count, 1);
    assert!((contact.force[2] - 2.0 * G).abs() < 1e-6, "{contact:?}");
    assert!((contact.point[0] - 0.125).abs() < 1e-9 && contact.point[1].abs() < 1e-9, "{contact:?}");
    assert!((plant.world().q[0] - 0.25 + contact.depth).abs() < 1e-9, "{} {contact:?}", plant.world().q[0]);
}
