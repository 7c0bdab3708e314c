//! Random chains as URDF text.

use hapfic_robot::{Chain, MAX_JOINTS};
use proptest::prelude::*;
use std::f64::consts::PI;
use std::fmt::Write;

/// Kind of a movable joint.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SegmentKind {
    Revolute,
    Continuous,
    Prismatic,
}

/// A movable joint and the link behind it.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    pub(crate) kind: SegmentKind,
    pub(crate) xyz: [f64; 3],
    pub(crate) rpy: [f64; 3],
    pub(crate) axis: [f64; 3],
    pub(crate) inertial: Inertial,
}

/// The inertial element of a link.
#[derive(Clone, Debug)]
pub(crate) struct Inertial {
    pub(crate) mass: f64,
    pub(crate) center: [f64; 3],
    pub(crate) rpy: [f64; 3],
    /// xx, xy, xz, yy, yz, zz in the rotated frame.
    pub(crate) inertia: [f64; 6],
}

/// A joint position, velocity and acceleration for any number of joints.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    pub(crate) q: [f64; MAX_JOINTS],
    pub(crate) qd: [f64; MAX_JOINTS],
    pub(crate) qdd: [f64; MAX_JOINTS],
}

pub(crate) fn triple(size: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-size..size)
}

fn kind() -> impl Strategy<Value = SegmentKind> {
    prop_oneof![Just(SegmentKind::Revolute), Just(SegmentKind::Continuous), Just(SegmentKind::Prismatic)]
}

/// A solid ellipsoid near the link's frame.
pub(crate) fn inertial() -> impl Strategy<Value = Inertial> {
    let half_axes = prop::array::uniform3(0.05..0.3_f64);
    (0.2..3.0_f64, triple(0.3), triple(PI), half_axes).prop_map(|(mass, center, rpy, [a, b, c])| {
        let moment = |u: f64, v: f64| mass / 5.0 * (u * u + v * v);
        Inertial { mass, center, rpy, inertia: [moment(b, c), 0.0, 0.0, moment(a, c), 0.0, moment(a, b)] }
    })
}

pub(crate) fn segment() -> impl Strategy<Value = Segment> {
    // Any direction, any length.
    let axis = (-PI..PI, -1.0..1.0_f64, 0.1..3.0_f64).prop_map(|(angle, z, length)| {
        let r = (1.0 - z * z).sqrt();
        [length * r * angle.cos(), length * r * angle.sin(), length * z]
    });
    (kind(), triple(0.4), triple(PI), axis, inertial()).prop_map(|(kind, xyz, rpy, axis, inertial)| Segment {
        kind,
        xyz,
        rpy,
        axis,
        inertial,
    })
}

pub(crate) fn segments() -> impl Strategy<Value = Vec<Segment>> {
    prop::collection::vec(segment(), 1..=8)
}

pub(crate) fn motion() -> impl Strategy<Value = Motion> {
    let all = |size: f64| prop::array::uniform16(-size..size);
    (all(2.0), all(1.0), all(2.0)).prop_map(|(q, qd, qdd)| Motion { q, qd, qdd })
}

fn triple_text(values: &[f64; 3]) -> String {
    format!("{} {} {}", values[0], values[1], values[2])
}

pub(crate) fn inertial_text(inertial: &Inertial) -> String {
    let [xx, xy, xz, yy, yz, zz] = inertial.inertia;
    format!(
        r#"<inertial><origin xyz="{}" rpy="{}"/><mass value="{}"/>
           <inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/></inertial>"#,
        triple_text(&inertial.center),
        triple_text(&inertial.rpy),
        inertial.mass,
    )
}

/// A fixed joint and its child.
pub(crate) fn fixed_text(parent: &str, child: &str, xyz: &[f64; 3], rpy: &[f64; 3], inertial: Option<&Inertial>) -> String {
    format!(
        r#"<joint name="{child}_fixed" type="fixed"><parent link="{parent}"/><child link="{child}"/>
           <origin xyz="{}" rpy="{}"/></joint><link name="{child}">{}</link>"#,
        triple_text(xyz),
        triple_text(rpy),
        inertial.map(inertial_text).unwrap_or_default(),
    )
}

/// A movable joint and its child link.
pub(crate) fn segment_text(parent: &str, child: &str, segment: &Segment) -> String {
    let (kind, limit) = match segment.kind {
        SegmentKind::Revolute => ("revolute", r#"lower="-3" upper="3""#),
        SegmentKind::Continuous => ("continuous", ""),
        SegmentKind::Prismatic => ("prismatic", r#"lower="-3" upper="3""#),
    };
    format!(
        r#"<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
           <origin xyz="{}" rpy="{}"/><axis xyz="{}"/><limit {limit} effort="10" velocity="5"/></joint>
           <link name="{child}">{}</link>"#,
        triple_text(&segment.xyz),
        triple_text(&segment.rpy),
        triple_text(&segment.axis),
        inertial_text(&segment.inertial),
    )
}

/// Links `{prefix}0`, `{prefix}1`, ... below `base`, and `{prefix}tip` at an offset below the last.
pub(crate) fn limb_text(prefix: &str, base: &str, segments: &[Segment]) -> String {
    let mut text = String::new();
    let mut parent = base.to_owned();
    for (i, segment) in segments.iter().enumerate() {
        let child = format!("{prefix}{i}");
        writeln!(text, "{}", segment_text(&parent, &child, segment)).unwrap();
        parent = child;
    }
    text + &fixed_text(&parent, &format!("{prefix}tip"), &[0.1, -0.2, 0.3], &[0.3, -0.2, 0.5], None)
}

pub(crate) fn robot_text(content: &str) -> String {
    format!(r#"<robot name="random"><link name="base"/>{content}</robot>"#)
}

pub(crate) fn read(content: &str, tip: &str) -> Chain {
    Chain::from_urdf(&robot_text(content), "random.urdf", "base", tip).unwrap()
}

/// The chain of these segments, from `base` to `l_tip`.
pub(crate) fn chain(segments: &[Segment]) -> Chain {
    read(&limb_text("l_", "base", segments), "l_tip")
}
