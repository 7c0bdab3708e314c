//! The contact law against its reference values.
#![allow(clippy::unwrap_used)]

use hapfic_plant::ContactLaw;

#[test]
fn contact_law_matches_reference() {
    let text = include_str!("vectors/contact_law.csv");
    let mut rows = 0;
    for line in text.lines().skip(1) {
        let v: Vec<f64> = line.split(',').map(|f| f.parse().unwrap()).collect();
        let [
            depth,
            rate,
            slip,
            stiffness,
            damping,
            transition_width,
            friction_static,
            friction_dynamic,
            critical_speed,
            normal,
            friction,
        ] = v[..]
        else {
            panic!("row {rows} has {} fields", v.len())
        };
        let law = ContactLaw { stiffness, damping, transition_width, friction_static, friction_dynamic, critical_speed };
        let n = law.normal(depth, rate).force;
        let t = law.friction(slip).value * n;
        for (ours, theirs) in [(n, normal), (t, friction)] {
            assert!((ours - theirs).abs() <= 1e-12 + 1e-9 * theirs.abs(), "row {rows}: {ours} against {theirs}");
        }
        rows += 1;
    }
    assert_eq!(rows, 200);
}
