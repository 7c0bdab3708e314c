//! Checks of the floor and the objects.

use super::ScenarioCheck;
use crate::error::ConfigError;
use crate::policy::{EngineKind, ShapeKind};
use crate::raw::{RawObject, RawPlant, RawWorld};
use crate::settings::{EngineSettings, Floor, MAX_OBJECTS, Object, ObjectShape, RapierSettings, Surface, WorldSettings};
use crate::tree::describe_number;

/// Longest gravity vector [m/s^2].
const GRAVITY_MAX: f64 = 100.0;
/// Names in use by contacts and by viewer frames.
const RESERVED_NAMES: [&str; 4] = ["floor", "contacts", "reference", "target"];
/// Longest name of an object [bytes]: the length that summaries keep.
const LONGEST_NAME: usize = 31;

impl ScenarioCheck<'_> {
    pub(super) fn world(&self, raw: RawWorld) -> Result<WorldSettings, ConfigError> {
        self.short_enough("world.gravity_m_per_s2", raw.gravity_m_per_s2, GRAVITY_MAX)?;
        let floor = raw.floor.map(|floor| Floor {
            tip_only: false,
            height_m: floor.height_m,
            surface: Surface {
                stiffness_n_per_m: floor.stiffness_n_per_m,
                damping_n_s_per_m: floor.damping_n_s_per_m,
                transition_width_m: floor.transition_width_m,
                friction_static: floor.friction_static,
                friction_dynamic: floor.friction_dynamic,
                critical_speed_m_per_s: floor.critical_speed_m_per_s,
            },
        });
        if let Some(floor) = floor {
            self.friction("world.floor", &floor.surface)?;
        }
        if raw.objects.len() > MAX_OBJECTS {
            let found = format!("{} of them", raw.objects.len());
            let expected = format!("at most {MAX_OBJECTS}");
            let help = "the messages have no room for more";
            return Err(ConfigError::WrongLength(self.diagnostic("world.object", &found, &expected, help)));
        }
        let mut objects: Vec<Object> = Vec::with_capacity(raw.objects.len());
        for (index, object) in raw.objects.into_iter().enumerate() {
            let object = self.object(&format!("world.object[{index}]"), object)?;
            let name = object.name.as_str();
            let taken = RESERVED_NAMES.contains(&name) || objects.iter().any(|o| o.name == name);
            if name.trim().is_empty() || name.len() > LONGEST_NAME || taken {
                let key = format!("world.object[{index}].name");
                let expected = format!("a unique name of at most {LONGEST_NAME} bytes, none of {}", RESERVED_NAMES.join(", "));
                let help = "contacts, figures and viewers identify bodies by these names";
                return Err(ConfigError::Combination(self.diagnostic(&key, &self.found(&key), &expected, help)));
            }
            objects.push(object);
        }
        Ok(WorldSettings { gravity_m_per_s2: raw.gravity_m_per_s2, floor, objects })
    }

    /// The engine of the plant, with what it can represent.
    pub(super) fn engine(&self, raw: &RawPlant) -> Result<EngineSettings, ConfigError> {
        let wrong = |key: &str, found: &str, expected: &str, help: &str| {
            Err(ConfigError::Combination(self.diagnostic(key, found, expected, help)))
        };
        match (raw.engine, raw.softness) {
            (EngineKind::Hapfic, None) => Ok(EngineSettings::Hapfic),
            (EngineKind::Hapfic, Some(_)) => wrong(
                "plant.softness",
                "a softness of all contacts",
                "none with plant.engine = \"hapfic\"",
                "each surface has its own stiffness_n_per_m and damping_n_s_per_m",
            ),
            (EngineKind::Rapier, None) => wrong(
                "plant.engine",
                "rapier without plant.softness",
                "plant.softness = { frequency_hz = 100, damping_ratio = 1 } or the like",
                "rapier has one softness for all contacts, and cannot represent stiffness_n_per_m, damping_n_s_per_m, \
                 transition_width_m and critical_speed_m_per_s of the surfaces",
            ),
            (EngineKind::Rapier, Some(softness)) => Ok(EngineSettings::Rapier(RapierSettings {
                substep_us: raw.rapier_substep_us,
                frequency_hz: softness.frequency_hz,
                damping_ratio: softness.damping_ratio,
            })),
        }
    }

    fn object(&self, path: &str, raw: RawObject) -> Result<Object, ConfigError> {
        let wrong = |key: &str, expected: &str| {
            let key = format!("{path}.{key}");
            let found = if self.tree.get(&key).is_some() { self.found(&key) } else { "nothing".to_owned() };
            let help = "a box has size_m, a ball has radius_m";
            Err(ConfigError::Combination(self.diagnostic(&key, &found, expected, help)))
        };
        let shape = match (raw.shape, raw.size_m, raw.radius_m) {
            (ShapeKind::Box, Some(size_m), None) => ObjectShape::Box { size_m },
            (ShapeKind::Ball, None, Some(radius_m)) => ObjectShape::Ball { radius_m },
            (ShapeKind::Box, None, _) => return wrong("size_m", "the edges of the box, m"),
            (ShapeKind::Ball, _, None) => return wrong("radius_m", "the radius of the ball, m"),
            (ShapeKind::Box, Some(_), Some(_)) => return wrong("radius_m", "no radius for a box"),
            (ShapeKind::Ball, Some(_), Some(_)) => return wrong("size_m", "no edges for a ball"),
        };
        let surface = Surface {
            stiffness_n_per_m: raw.stiffness_n_per_m,
            damping_n_s_per_m: raw.damping_n_s_per_m,
            transition_width_m: raw.transition_width_m,
            friction_static: raw.friction_static,
            friction_dynamic: raw.friction_dynamic,
            critical_speed_m_per_s: raw.critical_speed_m_per_s,
        };
        self.friction(path, &surface)?;
        Ok(Object {
            name: raw.name,
            shape,
            mass_kg: raw.mass_kg,
            position_m: raw.position_m,
            orientation_rpy_rad: raw.orientation_rpy_rad,
            surface,
        })
    }

    fn friction(&self, path: &str, surface: &Surface) -> Result<(), ConfigError> {
        if surface.friction_dynamic <= surface.friction_static {
            return Ok(());
        }
        let found = describe_number(surface.friction_dynamic);
        let expected = format!("at most {path}.friction_static = {}", describe_number(surface.friction_static));
        let help = "raise friction_static or lower friction_dynamic";
        Err(ConfigError::Combination(self.diagnostic(&format!("{path}.friction_dynamic"), &found, &expected, help)))
    }
}
