//! An invalid description for each error; each message names the file, the place, the found and the expected value.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_config::JointValues;
use hapfic_robot::{Chain, JointKind, Replacements, RobotError, Shape};

const VALID: &str = r#"<robot name="arm">
  <link name="base"><collision><geometry><box size="1 2 3"/></geometry></collision></link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/><dynamics damping="0.5"/>
  </joint>
  <link name="upper">
    <inertial><origin xyz="0 0.1 0"/><mass value="1.5"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="upper"/><child link="lower"/>
    <origin xyz="0 0.2 0"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.3" effort="50" velocity="1"/>
  </joint>
  <link name="lower">
    <inertial><mass value="0.5"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><capsule radius="0.02" length="0.1"/></geometry></collision>
  </link>
  <joint name="end" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0 0.1 0"/></joint>
  <link name="tip"/>
  <joint name="ear" type="fixed"><parent link="base"/><child link="cover"/></joint>
  <link name="cover"/>
</robot>"#;

/// The valid description with one replacement.
fn with(from: &str, to: &str) -> String {
    assert_eq!(VALID.matches(from).count(), 1, "{from}");
    VALID.replace(from, to)
}

fn read(text: &str) -> Result<Chain, RobotError> {
    Chain::from_urdf(text, "arm.urdf", "base", "tip")
}

/// Error of an invalid description; its message starts with the file and contains all parts.
fn rejected(text: &str, parts: &[&str]) -> RobotError {
    let error = read(text).unwrap_err();
    assert_message(&error, parts);
    error
}

fn assert_message(error: &RobotError, parts: &[&str]) {
    let message = error.to_string();
    assert!(message.starts_with("arm.urdf:"), "{message}");
    for part in parts {
        assert!(message.contains(part), "'{part}' is missing in: {message}");
    }
}

#[test]
fn urdf_valid_is_read() {
    let chain = read(VALID).unwrap();
    assert_eq!(chain.dof(), 2);
    let turn = &chain.joints()[0];
    assert_eq!((turn.kind, turn.lower, turn.upper), (JointKind::Revolute, -1.0, 1.0));
    assert_eq!((turn.effort, turn.velocity_limit, turn.damping), (5.0, 2.0, 0.5));
    assert_eq!(chain.joints()[1].kind, JointKind::Prismatic);
    assert_eq!(chain.joints()[1].damping, 0.0);
    let shapes: Vec<_> = chain.collisions().iter().map(|c| (c.link.as_str(), c.body, c.shape.clone())).collect();
    let expected =
        [("base", None, Shape::Box { size: [1.0, 2.0, 3.0] }), ("lower", Some(1), Shape::Capsule { radius: 0.02, length: 0.1 })];
    assert_eq!(shapes, expected);
}

#[test]
fn joint_continuous_has_no_position_limits() {
    let chain = read(&with(r#""turn" type="revolute""#, r#""turn" type="continuous""#)).unwrap();
    let turn = &chain.joints()[0];
    assert_eq!((turn.kind, turn.lower, turn.upper), (JointKind::Continuous, f64::NEG_INFINITY, f64::INFINITY));
}

#[test]
fn urdf_malformed_xml_is_rejected() {
    let error = rejected("<robot name='arm'><link name='base'", &["cannot be read as URDF", "correct the file"]);
    assert!(matches!(error, RobotError::Parse { .. }));
    for text in ["", "<robot>", "base", r#"<robot><link name="base"></joint></robot>"#] {
        assert!(matches!(read(text), Err(RobotError::Parse { .. })), "{text}");
    }
}

#[test]
fn urdf_word_as_number_is_rejected() {
    let parts = ["arm.urdf:9: ", "link 'upper' <mass value>", "\"heavy\"", "a number"];
    let error = rejected(&with(r#"<mass value="1.5"/>"#, r#"<mass value="heavy"/>"#), &parts);
    assert!(matches!(error, RobotError::Number { .. }));
    let parts = ["arm.urdf:5: ", "joint 'turn' <axis xyz>", "\"0 2\"", "three numbers"];
    rejected(&with(r#"<axis xyz="0 0 2"/>"#, r#"<axis xyz="0 2"/>"#), &parts);
}

#[test]
fn link_unknown_base_or_tip_is_rejected() {
    let error = Chain::from_urdf(VALID, "arm.urdf", "trunk", "tip").unwrap_err();
    assert_message(&error, &["base link 'trunk' does not exist", "one of 'base', 'upper', 'lower', 'tip', 'cover'"]);
    let error = Chain::from_urdf(VALID, "arm.urdf", "base", "tipp").unwrap_err();
    assert_message(&error, &["tip link 'tipp' does not exist", "'tip'"]);
    assert!(matches!(error, RobotError::UnknownLink { role: "tip", .. }));
    rejected("<robot name='empty'/>", &["base link 'base' does not exist", "this one has none"]);
}

#[test]
fn link_unknown_among_many_lists_nearest() {
    let many: String = (0..30).map(|i| format!(r#"<link name="x{i}"/>"#)).collect();
    let text = with(r#"<link name="cover"/>"#, &format!(r#"<link name="cover"/>{many}"#));
    let error = Chain::from_urdf(&text, "arm.urdf", "base", "lowr").unwrap_err();
    assert_message(&error, &["a link such as 'lower'"]);
    assert!(!error.to_string().contains("'x29'"), "{error}");
}

#[test]
fn joint_undeclared_link_in_chain_is_rejected() {
    let text = with(r#"<parent link="upper"/>"#, r#"<parent link="uper"/>"#);
    let error = rejected(&text, &["joint 'slide'", "parent link 'uper'", "'upper'"]);
    assert!(matches!(error, RobotError::DanglingJoint { end: "parent", .. }));
    rejected(&with(r#"<parent link="upper"/>"#, ""), &["<joint> has no <parent>"]);
}

#[test]
fn joint_without_ends_off_chain_is_left_out_with_warning() {
    let ends = r#"<parent link="base"/><child link="cover"/>"#;
    let whole = Chain::from_urdf(VALID, "arm.urdf", "base", "tip").unwrap();
    for (text, parts) in [
        (with(r#"<link name="cover"/>"#, ""), ["joint 'ear'", "child link 'cover'"]),
        (with(ends, r#"<parent link="bass"/><child link="cover"/>"#), ["joint 'ear'", "parent link 'bass'"]),
        (with(ends, r#"<child link="cover"/>"#), ["arm.urdf:", "<joint> has no <parent>"]),
        (with(ends, r#"<parent link="base"/>"#), ["arm.urdf:", "<joint> has no <child>"]),
        (with(ends, r#"<parent/><child link="cover"/>"#), ["arm.urdf:", "<parent> has no attribute 'link'"]),
    ] {
        let chain = Chain::from_urdf(&text, "arm.urdf", "base", "tip").unwrap();
        assert_eq!(chain.warnings().len(), whole.warnings().len() + 1, "{:?}", chain.warnings());
        let warning = &chain.warnings()[0];
        assert!(parts.iter().all(|part| warning.contains(part)) && warning.contains("left out"), "{warning}");
    }
}

#[test]
fn urdf_duplicate_name_is_rejected() {
    let text = with(r#"<link name="cover"/>"#, r#"<link name="cover"/><link name="upper"/>"#);
    assert!(matches!(rejected(&text, &["two links 'upper'"]), RobotError::Duplicate { .. }));
    rejected(&with(r#"<joint name="ear""#, r#"<joint name="turn""#), &["two joints 'turn'"]);
}

#[test]
fn link_tip_not_below_base_is_rejected() {
    let error = Chain::from_urdf(VALID, "arm.urdf", "cover", "tip").unwrap_err();
    assert_message(&error, &["tip link 'tip' is not below base link 'cover'", "'tip', 'lower', 'upper', 'base'"]);
    assert!(matches!(error, RobotError::NotBelow { .. }));
    let error = Chain::from_urdf(VALID, "arm.urdf", "lower", "upper").unwrap_err();
    assert_message(&error, &["tip link 'upper' is not below base link 'lower'"]);
}

#[test]
fn link_two_parents_is_rejected() {
    let text = with(
        r#"<link name="cover"/>"#,
        r#"<link name="cover"/><joint name="strut" type="fixed"><parent link="cover"/><child link="tip"/></joint>"#,
    );
    let error = rejected(&text, &["link 'tip'", "joint 'end'", "joint 'strut'"]);
    assert!(matches!(error, RobotError::TwoParents { .. }));
}

#[test]
fn link_cycle_is_rejected() {
    let text = with(
        r#"<link name="cover"/>"#,
        r#"<link name="cover"/><joint name="back" type="fixed"><parent link="tip"/><child link="base"/></joint>"#,
    );
    assert!(matches!(rejected(&text, &["its own ancestor", "remove a joint"]), RobotError::Cycle { .. }));
    let text = with(r#"<parent link="base"/><child link="cover"/>"#, r#"<parent link="cover"/><child link="cover"/>"#);
    rejected(&text, &["link 'cover' is its own ancestor"]);
}

#[test]
fn joint_unsupported_kind_is_rejected() {
    for found in ["floating", "planar", "spherical"] {
        let text = with(r#""turn" type="revolute""#, &format!(r#""turn" type="{found}""#));
        let error = rejected(&text, &["joint 'turn'", &format!("is {found}")]);
        assert!(matches!(error, RobotError::UnsupportedJoint { .. }));
    }
}

#[test]
fn joint_mimic_is_rejected() {
    let text = with(r#"<axis xyz="0 1 0"/>"#, r#"<axis xyz="0 1 0"/><mimic joint="turn" multiplier="2"/>"#);
    assert!(matches!(rejected(&text, &["joint 'slide'", "mimics joint 'turn'"]), RobotError::Mimic { .. }));
}

#[test]
fn chain_without_movable_joint_is_rejected() {
    let error = Chain::from_urdf(VALID, "arm.urdf", "lower", "tip").unwrap_err();
    assert_message(&error, &["no joint between 'lower' and 'tip' can move", "expected 1 to 16"]);
    assert!(matches!(error, RobotError::NoMovableJoint { .. }));
    assert!(matches!(Chain::from_urdf(VALID, "arm.urdf", "base", "base"), Err(RobotError::NoMovableJoint { .. })));
}

#[test]
fn chain_seventeen_joints_is_rejected() {
    let mut text = String::from(r#"<robot name="snake"><link name="l0"/>"#);
    for i in 1..18 {
        text += &format!(
            r#"<joint name="j{i}" type="continuous"><parent link="l{}"/><child link="l{i}"/><axis xyz="1 0 0"/>
               <limit effort="1" velocity="1"/></joint>
               <link name="l{i}"><inertial><mass value="1"/>
               <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"#,
            i - 1
        );
    }
    text += "</robot>";
    let error = Chain::from_urdf(&text, "arm.urdf", "l0", "l17").unwrap_err();
    assert_message(&error, &["17 joints between 'l0' and 'l17'", "expected 1 to 16"]);
    assert!(matches!(error, RobotError::TooManyJoints { found: 17, .. }));
    assert_eq!(Chain::from_urdf(&text, "arm.urdf", "l1", "l9").unwrap().dof(), 8);
}

#[test]
fn joint_zero_axis_is_rejected() {
    for bad in ["0 0 0", "nan 0 1", "inf 0 0"] {
        let text = with(r#"<axis xyz="0 1 0"/>"#, &format!(r#"<axis xyz="{bad}"/>"#));
        let error = rejected(&text, &["joint 'slide' <axis xyz>", "not zero"]);
        assert!(matches!(error, RobotError::Axis { .. }));
    }
}

#[test]
fn joint_missing_limits_is_rejected() {
    let limit = r#"<limit lower="0" upper="0.3" effort="50" velocity="1"/>"#;
    let error = rejected(&with(limit, ""), &["prismatic joint 'slide' has no <limit>", "lower=.. upper=.."]);
    assert!(matches!(error, RobotError::MissingLimit { .. }));
    let text = with(r#"<limit lower="-1" upper="1" effort="5" velocity="2"/>"#, "");
    rejected(&text, &["revolute joint 'turn' has no <limit>"]);
    // A continuous joint needs no position limits, but a peak torque: here, or in the scenario.
    let text = text.replace(r#""turn" type="revolute""#, r#""turn" type="continuous""#);
    rejected(&text, &["joint 'turn' <limit effort>: found none", "robot.effort_limit_n_m"]);
    let replacements = Replacements { effort_limit: Some(&JointValues::InOrder(vec![7.0, 8.0])), ..Replacements::default() };
    let chain = Chain::from_urdf_with(&text, "arm.urdf", "base", "tip", &replacements).unwrap();
    assert_eq!(chain.joints().iter().map(|joint| joint.effort).collect::<Vec<_>>(), [7.0, 8.0]);
    assert_eq!(chain.joints()[0].velocity_limit, f64::INFINITY);
}

#[test]
fn values_by_joint_name_complete_or_are_rejected() {
    let named = JointValues::ByName(vec![("slide".to_owned(), 3.0)]);
    let with = |key: &str| {
        let mut replacements = Replacements::default();
        match key {
            "effort" => replacements.effort_limit = Some(&named),
            "speed" => replacements.velocity_limit = Some(&named),
            "friction" => replacements.joint_friction = Some(&named),
            _ => replacements.armature = Some(&named),
        }
        let chain = Chain::from_urdf_with(VALID, "arm.urdf", "base", "tip", &replacements).unwrap();
        chain.joints().to_vec()
    };
    let plain = Chain::from_urdf(VALID, "arm.urdf", "base", "tip").unwrap().joints().to_vec();
    let slide = plain.iter().position(|joint| joint.name == "slide").unwrap();
    let other = 1 - slide;
    assert_eq!((with("effort")[slide].effort, with("effort")[other].effort), (3.0, plain[other].effort));
    assert_eq!((with("speed")[slide].velocity_limit, with("speed")[other].velocity_limit), (3.0, plain[other].velocity_limit));
    assert_eq!((with("friction")[slide].friction, with("friction")[other].friction), (3.0, plain[other].friction));
    assert_eq!((with("armature")[slide].armature, with("armature")[other].armature), (3.0, 0.0));
    let stray = JointValues::ByName(vec![("slid".to_owned(), 3.0)]);
    let replacements = Replacements { armature: Some(&stray), ..Replacements::default() };
    let error = Chain::from_urdf_with(VALID, "arm.urdf", "base", "tip", &replacements).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("robot.armature_kg_m2") && text.contains("'slid'") && text.contains("slide"), "{text}");
}

#[test]
fn joint_invalid_limits_is_rejected() {
    let text = with(r#"lower="0" upper="0.3""#, r#"lower="0.5" upper="0.3""#);
    let error = rejected(&text, &["joint 'slide'", "lower = 0.5", "upper = 0.3"]);
    assert!(matches!(error, RobotError::LimitsReversed { .. }));
    for bad in ["0", "-3"] {
        let error = rejected(&with(r#"effort="5""#, &format!(r#"effort="{bad}""#)), &["joint 'turn' <limit effort>", bad]);
        assert!(matches!(error, RobotError::Effort { .. }));
    }
    // A speed limit is watched alone, so a placeholder is a warning.
    let chain = read(&with(r#"velocity="2""#, r#"velocity="-2""#)).unwrap();
    assert_eq!(chain.joints()[0].velocity_limit, f64::INFINITY);
    assert!(chain.warnings()[0].contains("joint 'turn' <limit velocity>: found -2"), "{:?}", chain.warnings());
    let error = rejected(&with(r#"damping="0.5""#, r#"damping="-0.5""#), &["joint 'turn' <dynamics damping>"]);
    assert!(matches!(error, RobotError::Negative { .. }));
    rejected(&with(r#"damping="0.5""#, r#"damping="-0.5""#), &["joint 'turn' <dynamics damping>", "-0.5"]);
}

#[test]
fn urdf_non_finite_number_is_rejected() {
    let cases = [
        (r#"lower="-1""#, r#"lower="nan""#, "joint 'turn' <limit lower>"),
        (r#"upper="0.3""#, r#"upper="inf""#, "joint 'slide' <limit upper>"),
        (r#"effort="5""#, r#"effort="inf""#, "joint 'turn' <limit effort>"),
        (r#"velocity="2""#, r#"velocity="nan""#, "joint 'turn' <limit velocity>"),
        (r#"damping="0.5""#, r#"damping="nan""#, "joint 'turn' <dynamics damping>"),
        (r#"xyz="0 0 0.1""#, r#"xyz="0 nan 0.1""#, "joint 'turn' <origin> xyz"),
        (r#"rpy="0 0 0""#, r#"rpy="0 0 inf""#, "joint 'turn' <origin> rpy"),
        (r#"<origin xyz="0 0.1 0"/><mass"#, r#"<origin xyz="0 inf 0"/><mass"#, "link 'upper' <inertial><origin> xyz"),
        (r#"mass value="1.5""#, r#"mass value="nan""#, "link 'upper' <mass value>"),
        (r#"iyy="0.03""#, r#"iyy="inf""#, "link 'upper' <inertia iyy>"),
    ];
    for (from, to, place) in cases {
        let error = rejected(&with(from, to), &[place, "finite"]);
        assert!(matches!(error, RobotError::NotFinite { .. }), "{error}");
    }
}

#[test]
fn link_invalid_mass_is_rejected() {
    let error = rejected(&with(r#"mass value="1.5""#, r#"mass value="-1.5""#), &["link 'upper' <mass value>", "-1.5"]);
    assert!(matches!(error, RobotError::Negative { .. }));
    let error = rejected(&with(r#"mass value="0.5""#, r#"mass value="0""#), &["joint 'slide'", "link 'lower'", "0 kg"]);
    assert!(matches!(error, RobotError::Massless { .. }));
    // A link without mass moves what is behind it.
    read(&with(r#"mass value="1.5""#, r#"mass value="0""#)).unwrap();
}

#[test]
fn link_massless_uses_fixed_part_mass() {
    let inertial =
        r#"<inertial><mass value="0.5"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let text = with(inertial, "");
    rejected(&text, &["joint 'slide'", "link 'lower'", "0 kg"]);
    let text = text.replace(r#"<link name="tip"/>"#, &format!(r#"<link name="tip">{inertial}</link>"#));
    let chain = read(&text).unwrap();
    assert_eq!(chain.inertia(1).mass_kg, 0.5);
    assert_eq!(chain.inertia(1).center_m, nalgebra::Vector3::new(0.0, 0.1, 0.0));
}

#[test]
fn joint_last_without_inertia_is_rejected() {
    let text = with(r#"ixx="0.001" iyy="0.001" izz="0.001""#, r#"ixx="0" iyy="0" izz="0""#);
    // A prismatic joint needs no moment of inertia.
    read(&text).unwrap();
    let text = text.replace(r#""slide" type="prismatic""#, r#""slide" type="revolute""#);
    let error = rejected(&text, &["joint 'slide'", "about its axis is 0 kg m^2", "link 'lower'"]);
    assert!(matches!(error, RobotError::NoInertia { .. }));
    // A rotor completes it.
    let rotor = JointValues::ByName(vec![("slide".to_owned(), 0.01)]);
    let replacements = Replacements { armature: Some(&rotor), ..Replacements::default() };
    Chain::from_urdf_with(&text, "arm.urdf", "base", "tip", &replacements).unwrap();
}

#[test]
fn link_impossible_inertia_is_rejected() {
    // A violated triangle is usable where the mass matrix is positive definite: as measured, with a warning.
    let chain = read(&with(r#"izz="0.04""#, r#"izz="0.06""#)).unwrap();
    assert_eq!(chain.warnings().len(), 1, "{:?}", chain.warnings());
    assert!(chain.warnings()[0].contains("link 'upper' <inertia>"), "{:?}", chain.warnings());
    // What is fixed to each other counts: a part with the rest of the moments mends it, with a warning.
    let part = r#"<joint name="lid" type="fixed"><parent link="upper"/><child link="box"/></joint><link name="box">
        <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;
    let chain = read(&with(r#"izz="0.04""#, r#"izz="0.06""#).replace("</robot>", part)).unwrap();
    assert_eq!(chain.warnings().len(), 1);
    assert!(chain.warnings()[0].starts_with("arm.urdf:8: link 'upper' <inertia>"), "{:?}", chain.warnings());
    rejected(&with(r#"ixx="0.02""#, r#"ixx="-0.02""#), &["link 'upper' <inertia>", "none of them negative"]);
    // A negative moment through a product of inertia.
    let text = with(r#"izz="0.04" ixy="0""#, r#"izz="0.04" ixy="0.03""#);
    rejected(&text, &["link 'upper' <inertia>", "none of them negative"]);
    // Thin plates and rods are at the limit; rounding in the file is within the tolerance.
    read(&with(r#"izz="0.04""#, r#"izz="0.05""#)).unwrap();
    read(&with(r#"izz="0.04""#, r#"izz="0.05000001""#)).unwrap();
}

/// Warnings of a description that is read.
fn warned(text: &str, parts: &[&str]) -> Chain {
    let chain = read(text).unwrap();
    let [warning] = chain.warnings() else { panic!("{:?}", chain.warnings()) };
    for part in parts {
        assert!(warning.contains(part), "'{part}' is missing in: {warning}");
    }
    chain
}

#[test]
fn shapes_unusable_are_left_out_with_a_warning() {
    let shapes = |chain: &Chain| chain.collisions().iter().map(|c| c.link.clone()).collect::<Vec<_>>();
    let mesh = r#"<collision><geometry><mesh filename="cover.stl"/></geometry></collision>"#;
    for link in ["tip", "cover"] {
        let text = with(&format!(r#"<link name="{link}"/>"#), &format!(r#"<link name="{link}">{mesh}</link>"#));
        assert_eq!(shapes(&warned(&text, &[&format!("link '{link}'"), "mesh 'cover.stl'", "left out"])), ["base", "lower"]);
    }
    let cases = [
        (r#"radius="0.02""#, r#"radius="0""#, "arm.urdf:19: link 'lower' <collision> capsule radius: found 0"),
        (r#"radius="0.02""#, r#"radius="nan""#, "link 'lower' <collision> capsule radius: found NaN"),
        (r#"length="0.1""#, r#"length="-0.1""#, "link 'lower' <collision> capsule length: found -0.1"),
        (r#"<capsule radius="0.02" length="0.1"/>"#, r#"<torus radius="0.02"/>"#, "unknown shape <torus>"),
        ("<geometry><capsule", r#"<origin xyz="nan 0 0"/><geometry><capsule"#, "link 'lower' <collision><origin> xyz"),
    ];
    for (from, to, part) in cases {
        assert_eq!(shapes(&warned(&with(from, to), &[part, "left out"])), ["base"], "{to}");
    }
    assert_eq!(shapes(&warned(&with(r#"size="1 2 3""#, r#"size="1 0 3""#), &["link 'base' <collision> box size"])), ["lower"]);
}

#[test]
fn placeholders_are_pointed_out() {
    let chain = warned(&with(r#"velocity="2""#, r#"velocity="0""#), &["joint 'turn' <limit velocity>: found 0"]);
    assert_eq!(chain.joints()[0].velocity_limit, f64::INFINITY);
    warned(&with(r#"effort="5""#, r#"effort="1e6""#), &["arm.urdf:6: joint 'turn' <limit effort>: 1000000 is a placeholder"]);
}

#[test]
fn numbers_too_large_are_rejected() {
    for (from, to) in [
        (r#"xyz="0 0 0.1""#, r#"xyz="0 0 1e200""#),
        (r#"mass value="1.5""#, r#"mass value="1e300""#),
        (r#"iyy="0.03""#, r#"iyy="1e300""#),
    ] {
        assert!(matches!(rejected(&with(from, to), &["at most 1000000000 in size"]), RobotError::TooLarge { .. }));
    }
}

#[test]
fn mass_matrix_singular_names_posture_and_joint() {
    // Two joints about one axis, with nothing between them.
    let text = with(
        r#"<joint name="slide" type="prismatic">
    <parent link="upper"/>"#,
        r#"<joint name="again" type="continuous"><parent link="upper"/><child link="ring"/><axis xyz="0 0 1"/>
        <limit effort="1"/></joint><link name="ring"/>
        <joint name="slide" type="prismatic"><parent link="ring"/>"#,
    );
    let text = text.replace(r#"<mass value="1.5"/>"#, r#"<mass value="0"/>"#).replace(r#"ixx="0.02" iyy="0.03" izz="0.04""#, "");
    let error = rejected(&text, &["mass matrix is singular at the posture [", "in the motion of joint"]);
    assert!(matches!(error, RobotError::Singular { .. }));
}

/// Descriptions as they are found: what does not concern the chain stops no load.
#[test]
fn foreign_parts_are_not_read() {
    let parts = [
        r#"<material name="a"><texture/></material><material name="a"/>"#,
        r#"<link name="eye"><inertial><mass value="x"/></inertial></link>
           <joint name="eye" type="floating"><parent link="upper"/><child link="eye"/><origin xyz="0 0"/></joint>"#,
        r#"<gazebo reference="upper"><sensor type="camera"/></gazebo><transmission name="t"><joint name="turn"/></transmission>"#,
    ];
    for part in parts {
        let chain = read(&VALID.replace("</robot>", &format!("{part}</robot>"))).unwrap();
        assert_eq!(chain, read(VALID).unwrap(), "{part}");
    }
    // Fixed to the base, which does not move: left out with a warning.
    let part = r#"<joint name="eye" type="fixed"><parent link="base"/><child link="eye"/><origin xyz="0 0"/></joint>
        <link name="eye"/></robot>"#;
    warned(&VALID.replace("</robot>", part), &["joint 'eye' <origin> xyz", "the base does not move"]);
    let inertial = r#"<inertial><mass value="1e-6"/><inertia ixx="1e-6" ixy="1e-6" ixz="1e-6" iyy="1e-6" iyz="1e-6" izz="1e-6"/></inertial>"#;
    let text = with(r#"<link name="cover"/>"#, &format!(r#"<link name="cover">{inertial}</link>"#));
    warned(&text, &["link 'cover' <inertia>", "the base does not move"]);
}
