//! Shared text of the tests.

/// Shortest valid scenario: five lines.
pub const ROBOT: &str = r#"[robot]
urdf = "leg.urdf"
base_link = "base"
tip_link = "foot"
start_position_rad = [0, 0.9, -1.8]
"#;
