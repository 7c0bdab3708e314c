//! Check of the foot.

use super::ScenarioCheck;
use crate::error::ConfigError;
use crate::raw::RawFoot;
use crate::settings::{Foot, MAX_SPHERES};

const HELP: &str = "radius_m makes a sphere, with centers_m several; size_m makes a box";

impl ScenarioCheck<'_> {
    /// The foot: spheres or a box.
    pub(super) fn foot(&self, raw: &RawFoot) -> Result<Foot, ConfigError> {
        let wrong = |key: &str, found: &str, expected: &str| {
            ConfigError::Combination(self.diagnostic(&format!("robot.foot{key}"), found, expected, HELP))
        };
        match (raw.radius_m, raw.size_m, &raw.centers_m) {
            (Some(_), Some(_), _) => Err(wrong(".size_m", "radius_m and size_m", "one of the two")),
            (None, None, _) => Err(wrong("", "neither radius_m nor size_m", "one of the two")),
            (None, Some(_), Some(_)) => Err(wrong(".centers_m", "centres beside size_m", "centres beside radius_m")),
            (None, Some(size_m), None) => Ok(Foot::Box { size_m, offset_m: raw.offset_m }),
            (Some(radius_m), None, None) => Ok(Foot::Spheres { radius_m, centers_m: vec![raw.offset_m] }),
            (Some(radius_m), None, Some(centers)) if (1..=MAX_SPHERES).contains(&centers.len()) => {
                let placed = |center: &[f64; 3]| core::array::from_fn(|axis| raw.offset_m[axis] + center[axis]);
                Ok(Foot::Spheres { radius_m, centers_m: centers.iter().map(placed).collect() })
            }
            (Some(_), None, Some(centers)) => {
                Err(wrong(".centers_m", &format!("{} centres", centers.len()), &format!("1 to {MAX_SPHERES}")))
            }
        }
    }
}
