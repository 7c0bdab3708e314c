//! Collision shapes: feet that a scenario gives, and meshes as convex hulls, or left out with one warning.

#![allow(clippy::unwrap_used, clippy::panic)]

use hapfic_config::Foot;
use hapfic_robot::{Chain, Replacements, Shape};

const VALID: &str = r#"<robot name="arm">
  <link name="base"><collision><geometry><box size="1 2 3"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="lower"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <link name="lower">
    <inertial><mass value="0.5"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><capsule radius="0.02" length="0.1"/></geometry></collision>
  </link>
  <joint name="end" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0 0.1 0"/></joint>
  <link name="tip"/>
</robot>"#;

fn with(from: &str, to: &str) -> String {
    assert!(VALID.contains(from));
    VALID.replace(from, to)
}

/// A cube of edge 1 with corners at 0 and 1, and its centre, as an OBJ file.
fn cube() -> String {
    let corners = (0..8).map(|i| format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2));
    corners.collect::<String>() + "v 0.5 0.5 0.5\nf 1 2 3\nf 2 3 4\nf 5 6 7\nf 6 7 8\nf 1 6 9\nf 4 7 9\n"
}

#[test]
fn mesh_is_its_hull() {
    let folder = tempfile::tempdir().unwrap();
    let package = folder.path().join("robots/arm");
    std::fs::create_dir_all(package.join("urdf")).unwrap();
    std::fs::create_dir_all(package.join("meshes")).unwrap();
    std::fs::write(package.join("meshes/cube.obj"), cube()).unwrap();
    let file = package.join("urdf/arm.urdf");
    std::fs::write(&file, "").unwrap();
    let capsule = r#"<capsule radius="0.02" length="0.1"/>"#;
    for name in ["package://arm/meshes/cube.obj", "../meshes/cube.obj", "file://../meshes/cube.obj", "model://meshes/cube.obj"] {
        let text = with(capsule, &format!(r#"<mesh filename="{name}" scale="1 2 0.5"/>"#));
        let chain = Chain::from_urdf(&text, file.to_str().unwrap(), "base", "tip").unwrap();
        assert_eq!(chain.warnings(), [""; 0], "{name}");
        let mesh = chain.collisions().last().unwrap();
        let Shape::Hull { corners } = &mesh.shape else { panic!("{name}: {mesh:?}") };
        assert_eq!(corners.len(), 8, "{name}: {corners:?}");
        assert!(corners.iter().all(|at| at.map(f64::abs) == [0.5, 1.0, 0.25]), "{corners:?}");
        assert_eq!(mesh.origin.translation.vector, nalgebra::Vector3::new(0.5, 1.0, 0.25));
    }

    // One warning for all that are missing or no meshes.
    std::fs::write(package.join("meshes/flat.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n").unwrap();
    std::fs::write(package.join("meshes/far.obj"), cube().replace("v 1", "v 1e9")).unwrap();
    std::fs::write(package.join("meshes/broken.stl"), "solid but not quite").unwrap();
    std::fs::write(package.join("meshes/part.dae"), "<COLLADA/>").unwrap();
    std::fs::write(package.join("meshes/part.3ds"), "MM").unwrap();
    for (name, reason) in [
        ("package://arm/meshes/none.stl", "found no such file"),
        ("../meshes/flat.obj", "volume"),
        ("../meshes/far.obj", "expected all within 100 m"),
        ("../meshes/broken.stl", "broken.stl"),
        ("../meshes/part.dae", "found no vertices"),
        ("../meshes/part.3ds", "found a file of kind '3ds'"),
        ("", "found no such file"),
    ] {
        let mesh = format!(r#"<mesh filename="{name}"/>"#);
        let text = with(capsule, &mesh).replace(r#"<box size="1 2 3"/>"#, &mesh);
        let chain = Chain::from_urdf(&text, file.to_str().unwrap(), "base", "tip").unwrap();
        let [warning] = chain.warnings() else { panic!("{name}: {:?}", chain.warnings()) };
        let parts = ["arm.urdf:2: link 'base'", reason, "(left out, as that of link lower)"];
        assert!(parts.iter().all(|part| warning.contains(part)), "{name}: {warning}");
    }
}

#[test]
fn round_mesh_has_few_corners() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("arm.urdf");
    std::fs::write(&file, "").unwrap();
    let mut text = String::new();
    for i in 0..40 {
        for j in 0..80 {
            let (a, b) = (f64::from(i) * core::f64::consts::PI / 39.0, f64::from(j) * core::f64::consts::TAU / 80.0);
            text += &format!("v {} {} {}\n", a.sin() * b.cos(), a.sin() * b.sin(), a.cos());
        }
    }
    // The file's vertices are those of its faces.
    (1..3199).for_each(|i| text += &format!("f {} {} {}\n", i, i + 1, i + 2));
    std::fs::write(folder.path().join("ball.obj"), text).unwrap();
    let text = with(r#"<capsule radius="0.02" length="0.1"/>"#, r#"<mesh filename="ball.obj"/>"#);
    let chain = Chain::from_urdf(&text, file.to_str().unwrap(), "base", "tip").unwrap();
    let Shape::Hull { corners } = &chain.collisions().last().unwrap().shape else { panic!("{:?}", chain.warnings()) };
    assert!((64..=128).contains(&corners.len()), "{}", corners.len());
    assert!(corners.iter().all(|at| (nalgebra::Vector3::from(*at).norm() - 1.0).abs() < 0.05));
}

#[test]
fn foot_replaces_shapes_of_tip() {
    let foot = Foot::Spheres { radius_m: 0.03, centers_m: vec![[0.0, 0.0, 0.01], [0.1, 0.0, 0.01]] };
    let replacements = Replacements { foot: Some(&foot), ..Replacements::default() };
    let shape = r#"<link name="tip"><collision><geometry><box size="1 1 1"/></geometry></collision></link>"#;
    let text = with(r#"<link name="tip"/>"#, shape);
    let chain = Chain::from_urdf_with(&text, "arm.urdf", "base", "tip", &replacements).unwrap();
    let [.., first, second] = chain.collisions() else { unreachable!() };
    assert_eq!((first.link.as_str(), first.body, &first.shape), ("tip", Some(0), &Shape::Sphere { radius: 0.03 }));
    assert_eq!(first.origin.translation.vector, nalgebra::Vector3::new(0.0, 0.1, 0.01));
    assert_eq!(second.origin.translation.vector, nalgebra::Vector3::new(0.1, 0.1, 0.01));
    assert_eq!(chain.collisions().len(), 4);

    let foot = Foot::Box { size_m: [0.1, 0.06, 0.02], offset_m: [0.0, 0.0, -0.01] };
    let replacements = Replacements { foot: Some(&foot), ..Replacements::default() };
    let chain = Chain::from_urdf_with(&text, "arm.urdf", "base", "tip", &replacements).unwrap();
    let sole = chain.collisions().last().unwrap();
    assert_eq!(sole.shape, Shape::Box { size: [0.1, 0.06, 0.02] });
    let mut corners = sole.spheres(&sole.origin);
    corners.sort_by(|a, b| a.0.z.total_cmp(&b.0.z));
    assert!(corners[..4].iter().all(|(at, radius)| (at.z + 0.02).abs() < 1e-15 && *radius == 0.0), "{corners:?}");
}
