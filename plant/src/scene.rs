//! The bodies of the world, their shapes, and which of them may touch.

use crate::contact_law::ContactLaw;
use crate::error::PlantError;
use crate::object::FreeBody;
use crate::touch::{Finder, Form, Touch, Touches, pose};
use hapfic_config::{Object, ObjectShape, Settings, Surface};
use hapfic_robot::{Chain, Collision, Kinematics, Shape};
use nalgebra::{Isometry3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::shape::{Ball, Cuboid, HalfSpace};

/// Contacts softer than this, N/m, let a body sink in so far that the lower leg touches with foot and shank at once: it is one
/// contact then, of whichever is deeper.
const SOFT: f64 = 1e5;
/// Depths this near are the same, m: the end of the shank lies in the foot.
const SAME: f64 = 1e-9;

/// What a shape is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// The world.
    World,
    /// A moving body of the chain.
    Link(usize),
    /// A free body.
    Object(usize),
}

/// A shape with its carrier and its name's place in [`Scene::names`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side {
    pub(crate) carrier: Carrier,
    pub(crate) form: Form,
    /// In the frame of the carrier.
    local: Pose,
    pub(crate) name: usize,
}

/// Two shapes that may touch. The force on `body` is the normal force along the normal; `against` feels the opposite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) body: Side,
    pub(crate) against: Side,
    pub(crate) law: ContactLaw,
    /// Whether the force sensor at the tip feels it.
    pub(crate) sensed: bool,
    /// The foot's pair, if this is of the rest of the lower leg on something soft: only the deeper of the two counts.
    pub(crate) rival: Option<usize>,
}

impl Pair {
    /// Whether it depends on where the leg is.
    pub(crate) fn has_link(&self) -> bool {
        matches!(self.body.carrier, Carrier::Link(_))
    }

    /// Whether a free body takes part.
    pub(crate) fn has_object(&self) -> bool {
        [self.body, self.against].iter().any(|side| matches!(side.carrier, Carrier::Object(_)))
    }
}

/// The world's bodies.
#[derive(Clone)]
pub(crate) struct Scene {
    pub(crate) chain: Chain,
    pub(crate) names: Vec<String>,
    pub(crate) pairs: Vec<Pair>,
    finder: Finder,
    touches: Touches,
}

/// A contact point with its pair.
pub(crate) type Found = Vec<(usize, Touch)>;

/// URDF's cylinder as the largest capsule in it.
fn inscribed(radius: f64, length: f64) -> Form {
    let radius = radius.min(0.5 * length);
    let half = 0.5 * length - radius;
    if half > 0.0 { Form::capsule(-half, half, radius) } else { Form::Ball(Ball::new(radius)) }
}

fn form(shape: &Shape) -> Form {
    match *shape {
        Shape::Sphere { radius } => Form::Ball(Ball::new(radius)),
        Shape::Cylinder { radius, length } => inscribed(radius, length),
        Shape::Capsule { radius, length } => Form::capsule(-0.5 * length, 0.5 * length, radius),
        Shape::Box { size } => Form::Box(Cuboid::new(Vector::new(0.5 * size[0], 0.5 * size[1], 0.5 * size[2]))),
    }
}

/// The same on a soft body: a cylinder's axis then goes from end to end, so that the shank's reaches into the foot.
fn form_on_soft(shape: &Shape) -> Form {
    match *shape {
        Shape::Cylinder { radius, length } => Form::capsule(-0.5 * length, 0.5 * length, radius),
        _ => form(shape),
    }
}

fn law(surface: &Surface) -> ContactLaw {
    ContactLaw {
        stiffness: surface.stiffness_n_per_m,
        damping: surface.damping_n_s_per_m,
        transition_width: surface.transition_width_m,
        friction_static: surface.friction_static,
        friction_dynamic: surface.friction_dynamic,
        critical_speed: surface.critical_speed_m_per_s,
    }
}

/// Where two surfaces meet: the softer gives, the more slippery slides.
fn meet(a: &Surface, b: &Surface) -> ContactLaw {
    let soft = law(if a.stiffness_n_per_m <= b.stiffness_n_per_m { a } else { b });
    let slippery = if a.friction_static <= b.friction_static { a } else { b };
    ContactLaw {
        friction_static: slippery.friction_static,
        friction_dynamic: slippery.friction_dynamic,
        critical_speed: slippery.critical_speed_m_per_s,
        ..soft
    }
}

/// Something that is not the robot, and its surface.
struct Thing<'a> {
    side: Side,
    surface: &'a Surface,
}

impl Scene {
    /// Builds the world of a scenario.
    pub(crate) fn new(settings: &Settings, chain: Chain) -> Result<Self, PlantError> {
        let mut scene = Self { chain, names: Vec::new(), pairs: Vec::new(), finder: Finder::default(), touches: Touches::new() };
        let limbs = scene.limbs()?;
        let mut things = Vec::new();
        if let Some(floor) = &settings.world.floor {
            let local = pose(&Isometry3::translation(0.0, 0.0, floor.height_m));
            let form = Form::HalfSpace(HalfSpace::new(Vector::Z));
            things.push(Thing { side: scene.side(Carrier::World, form, local, "floor")?, surface: &floor.surface });
        }
        for (index, object) in settings.world.objects.iter().enumerate() {
            things.push(scene.object(index, object)?);
        }
        if !things.is_empty() && !limbs.iter().any(|(_, collision)| scene.is_foot(collision)) {
            return Err(PlantError::NoFoot { link: scene.chain.tip_link().to_owned() });
        }
        for thing in &things {
            scene.pair_with_limbs(&limbs, thing);
        }
        for (i, against) in things.iter().enumerate() {
            for body in &things[i + 1..] {
                let law = meet(body.surface, against.surface);
                scene.pairs.push(Pair { body: body.side, against: against.side, law, sensed: false, rival: None });
            }
        }
        Ok(scene)
    }

    fn is_foot(&self, collision: &Collision) -> bool {
        collision.link == self.chain.tip_link()
    }

    fn side(&mut self, carrier: Carrier, form: Form, local: Pose, name: &str) -> Result<Side, PlantError> {
        if !matches!(carrier, Carrier::Link(_)) && self.names.iter().any(|n| n == name) {
            return Err(PlantError::Name { name: name.to_owned() });
        }
        // A link may have several shapes, and one name.
        let index = self.names.iter().position(|n| n == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        Ok(Side { carrier, form, local, name: index })
    }

    /// The moving shapes of the robot, feet first.
    fn limbs(&mut self) -> Result<Vec<(Side, Collision)>, PlantError> {
        let mut collisions: Vec<Collision> = self.chain.collisions().to_vec();
        collisions.sort_by_key(|c| !self.is_foot(c));
        let mut limbs = Vec::new();
        for collision in collisions {
            let Some(body) = collision.body else { continue };
            // A flat foot would need a rule of its own for where foot and shank meet.
            if self.is_foot(&collision) && !matches!(collision.shape, Shape::Sphere { .. }) {
                return Err(PlantError::FootShape { link: collision.link.clone(), shape: collision.shape });
            }
            let side = self.side(Carrier::Link(body), form(&collision.shape), pose(&collision.origin), &collision.link)?;
            limbs.push((side, collision));
        }
        Ok(limbs)
    }

    fn object<'a>(&mut self, index: usize, object: &'a Object) -> Result<Thing<'a>, PlantError> {
        let form = match object.shape {
            ObjectShape::Box { size_m } => form(&Shape::Box { size: size_m }),
            ObjectShape::Ball { radius_m } => Form::Ball(Ball::new(radius_m)),
        };
        let side = self.side(Carrier::Object(index), form, Pose::identity(), &object.name)?;
        Ok(Thing { side, surface: &object.surface })
    }

    fn pair_with_limbs(&mut self, limbs: &[(Side, Collision)], thing: &Thing) {
        let law = law(thing.surface);
        let mut foot = None;
        for (side, collision) in limbs {
            let sensed = self.is_foot(collision);
            let mut body = *side;
            let mut rival = None;
            if law.stiffness < SOFT && !sensed {
                // Only the link that carries the foot reaches into it.
                rival = foot.filter(|(_, carrier)| *carrier == side.carrier).map(|(pair, _)| pair);
                if rival.is_some() {
                    body.form = form_on_soft(&collision.shape);
                }
            }
            if sensed {
                foot = Some((self.pairs.len(), side.carrier));
            }
            self.pairs.push(Pair { body, against: thing.side, law, sensed, rival });
        }
    }

    fn pose_of(side: &Side, kin: &Kinematics, objects: &[FreeBody]) -> Pose {
        match side.carrier {
            Carrier::World => side.local,
            Carrier::Link(i) => pose(&kin.body_pose(i)) * side.local,
            Carrier::Object(i) => pose(&objects[i].pose()) * side.local,
        }
    }

    /// Where the sides of a pair touch, if their gap is below `reach`, m: nowhere, or at some points.
    pub(crate) fn touch(&mut self, index: usize, kin: &Kinematics, objects: &[FreeBody], reach: f64) -> &[Touch] {
        let pair = &self.pairs[index];
        let (body, against) = (Self::pose_of(&pair.body, kin, objects), Self::pose_of(&pair.against, kin, objects));
        self.finder.touches((&pair.body.form, &body), (&pair.against.form, &against), reach, &mut self.touches);
        &self.touches
    }

    /// All contact points of the pairs that `choose` wants, as far as their gap is below what it returns, m.
    pub(crate) fn find(
        &mut self,
        kin: &Kinematics,
        objects: &[FreeBody],
        choose: impl Fn(&Self, &Pair) -> Option<f64>,
        found: &mut Found,
    ) {
        found.clear();
        for index in 0..self.pairs.len() {
            let Some(reach) = choose(self, &self.pairs[index]) else { continue };
            let rival = self.pairs[index].rival;
            for touch in self.touch(index, kin, objects, reach) {
                let standing = found.iter().position(|(pair, _)| Some(*pair) == rival);
                match standing {
                    Some(place) if touch.depth > found[place].1.depth + SAME => found[place] = (index, *touch),
                    Some(_) => {}
                    None => found.push((index, *touch)),
                }
            }
        }
    }

    /// An upper bound of how fast the two sides can come closer, m/s, at joint velocities `qd`.
    pub(crate) fn closing_speed(&self, pair: &Pair, kin: &Kinematics, qd: &[f64], objects: &[FreeBody]) -> f64 {
        [&pair.body, &pair.against]
            .into_iter()
            .map(|side| {
                let reach = side.form.reach().unwrap_or(0.0);
                match side.carrier {
                    Carrier::World => 0.0,
                    Carrier::Link(i) => {
                        let center = Self::pose_of(side, kin, objects).translation;
                        let jacobian = kin.point_jacobian(i, &Vector3::new(center.x, center.y, center.z));
                        jacobian.linear_mul(qd).norm() + jacobian.angular_mul(qd).norm() * reach
                    }
                    Carrier::Object(i) => objects[i].velocity.norm() + objects[i].angular_velocity.norm() * reach,
                }
            })
            .sum()
    }
}

impl core::fmt::Debug for Scene {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Scene").field("names", &self.names).field("pairs", &self.pairs.len()).finish_non_exhaustive()
    }
}
