//! The bodies of the world, their shapes, and which of them may touch.

use crate::collider::{Body, Collider, Places};
use crate::contact_law::ContactLaw;
use crate::contact_point::{ContactPoint, ContactShape, Finder};
use crate::error::PlantError;
use crate::object::FreeBody;
use crate::pair_cache::PairCache;
use hapfic_config::{Object, ObjectShape, Settings, Surface};
use hapfic_robot::{Chain, Collision, Kinematics, Shape};
use nalgebra::Isometry3;
use parry3d_f64::math::Vector;
use parry3d_f64::shape::{Ball, Cuboid, HalfSpace};

/// Contacts softer than this, N/m, let a body sink in so far that the lower leg touches with foot and shank at once: it is one
/// contact then, of whichever is deeper.
const SOFT: f64 = 1e5;
/// Depths this near are the same, m: the end of the shank lies in the foot.
const SAME: f64 = 1e-9;

/// Two shapes that may touch. The force on `body` is the normal force along the normal; `against` feels the opposite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) body: Collider,
    pub(crate) against: Collider,
    pub(crate) law: ContactLaw,
    /// Whether the force sensor at the tip feels it.
    pub(crate) sensed: bool,
    /// The foot's pair, if this is of the rest of the lower leg on something soft: only the deeper of the two counts.
    pub(crate) rival: Option<usize>,
}

impl Pair {
    /// Whether it depends on where the leg is.
    pub(crate) fn has_link(&self) -> bool {
        matches!(self.body.carrier, Body::Link(_))
    }

    /// Whether a free body takes part.
    pub(crate) fn has_object(&self) -> bool {
        [self.body, self.against].iter().any(|side| matches!(side.carrier, Body::Object(_)))
    }
}

/// The world's bodies.
#[derive(Clone)]
pub(crate) struct Scene {
    pub(crate) chain: Chain,
    pub(crate) names: Vec<String>,
    pub(crate) pairs: Vec<Pair>,
    sides: Vec<Collider>,
    places: Places,
    watches: Vec<PairCache>,
    finder: Finder,
}

/// A contact point with its pair.
pub(crate) type Contacts = Vec<(usize, ContactPoint)>;

/// URDF's cylinder as the largest capsule in it.
fn inscribed(radius: f64, length: f64) -> ContactShape {
    let radius = radius.min(0.5 * length);
    let half = 0.5 * length - radius;
    if half > 0.0 { ContactShape::capsule(-half, half, radius) } else { ContactShape::Ball(Ball::new(radius)) }
}

fn form(shape: &Shape) -> ContactShape {
    match *shape {
        Shape::Sphere { radius } => ContactShape::Ball(Ball::new(radius)),
        Shape::Cylinder { radius, length } => inscribed(radius, length),
        Shape::Capsule { radius, length } => ContactShape::capsule(-0.5 * length, 0.5 * length, radius),
        Shape::Box { size } => ContactShape::Box(Cuboid::new(Vector::new(0.5 * size[0], 0.5 * size[1], 0.5 * size[2]))),
    }
}

/// The same on a soft body: a cylinder's axis then goes from end to end, so that the shank's reaches into the foot.
fn form_on_soft(shape: &Shape) -> ContactShape {
    match *shape {
        Shape::Cylinder { radius, length } => ContactShape::capsule(-0.5 * length, 0.5 * length, radius),
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
    side: Collider,
    surface: &'a Surface,
}

impl Scene {
    /// Builds the world of a scenario.
    pub(crate) fn new(settings: &Settings, chain: Chain) -> Result<Self, PlantError> {
        let mut scene = Self {
            chain,
            names: Vec::new(),
            pairs: Vec::new(),
            sides: Vec::new(),
            places: Places::new(0),
            watches: Vec::new(),
            finder: Finder::default(),
        };
        let limbs = scene.limbs()?;
        let mut things = Vec::new();
        if let Some(floor) = &settings.world.floor {
            let local = Isometry3::translation(0.0, 0.0, floor.height_m);
            let form = ContactShape::HalfSpace(HalfSpace::new(Vector::Z));
            things.push(Thing { side: scene.side(Body::World, form, local, "floor")?, surface: &floor.surface });
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
        scene.places = Places::new(scene.sides.len());
        scene.watches = vec![PairCache::new(); scene.pairs.len()];
        Ok(scene)
    }

    fn is_foot(&self, collision: &Collision) -> bool {
        collision.link == self.chain.tip_link()
    }

    fn side(&mut self, carrier: Body, form: ContactShape, local: Isometry3<f64>, name: &str) -> Result<Collider, PlantError> {
        if !matches!(carrier, Body::Link(_)) && self.names.iter().any(|n| n == name) {
            return Err(PlantError::Name { name: name.to_owned() });
        }
        // A link may have several shapes, and one name.
        let index = self.names.iter().position(|n| n == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        Ok(self.keep(Collider::new(carrier, form, local, index, self.sides.len())))
    }

    fn keep(&mut self, side: Collider) -> Collider {
        self.sides.push(side);
        side
    }

    /// The moving shapes of the robot, feet first.
    fn limbs(&mut self) -> Result<Vec<(Collider, Collision)>, PlantError> {
        let mut collisions: Vec<Collision> = self.chain.collisions().to_vec();
        collisions.sort_by_key(|c| !self.is_foot(c));
        let mut limbs = Vec::new();
        for collision in collisions {
            let Some(body) = collision.body else { continue };
            // A flat foot would need a rule of its own for where foot and shank meet.
            if self.is_foot(&collision) && !matches!(collision.shape, Shape::Sphere { .. }) {
                return Err(PlantError::FootShape { link: collision.link.clone(), shape: collision.shape });
            }
            let side = self.side(Body::Link(body), form(&collision.shape), collision.origin, &collision.link)?;
            limbs.push((side, collision));
        }
        Ok(limbs)
    }

    fn object<'a>(&mut self, index: usize, object: &'a Object) -> Result<Thing<'a>, PlantError> {
        let form = match object.shape {
            ObjectShape::Box { size_m } => form(&Shape::Box { size: size_m }),
            ObjectShape::Ball { radius_m } => ContactShape::Ball(Ball::new(radius_m)),
        };
        let side = self.side(Body::Object(index), form, Isometry3::identity(), &object.name)?;
        Ok(Thing { side, surface: &object.surface })
    }

    fn pair_with_limbs(&mut self, limbs: &[(Collider, Collision)], thing: &Thing) {
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
                    body = self.keep(side.with(form_on_soft(&collision.shape), self.sides.len()));
                }
            }
            if sensed {
                foot = Some((self.pairs.len(), side.carrier));
            }
            self.pairs.push(Pair { body, against: thing.side, law, sensed, rival });
        }
    }

    /// Says where everything is: what is asked for after this is asked for there.
    pub(crate) fn place(&mut self, kin: &Kinematics, qd: &[f64], objects: &[FreeBody]) {
        self.places.update(&self.sides, &self.chain, kin, qd, objects);
    }

    /// An upper bound of how fast the two sides of a pair can come closer, m/s.
    pub(crate) fn closing_speed(&self, index: usize) -> f64 {
        let pair = &self.pairs[index];
        self.places.of(&pair.body).speed + self.places.of(&pair.against).speed
    }

    /// Where the sides of a pair touch, as far as their gap is below `reach`, m.
    pub(crate) fn touch(&mut self, index: usize, objects: &[FreeBody], reach: f64) -> impl Iterator<Item = &ContactPoint> {
        let Pair { body, against, .. } = &self.pairs[index];
        let (at, to) = (self.places.of(body), self.places.of(against));
        let watch = &mut self.watches[index];
        let touches = watch.look(self.places.instant, (body, at), (against, to), objects, reach, &mut self.finder);
        touches.iter().filter(move |touch| -touch.depth < reach)
    }

    /// All contact points of the pairs that `choose` wants, as far as their gap is below what it returns, m.
    pub(crate) fn find(&mut self, objects: &[FreeBody], choose: impl Fn(&Self, usize) -> Option<f64>, found: &mut Contacts) {
        found.clear();
        for index in 0..self.pairs.len() {
            let Some(reach) = choose(self, index) else { continue };
            let rival = self.pairs[index].rival;
            for touch in self.touch(index, objects, reach) {
                let standing = rival.and_then(|rival| found.iter().position(|(pair, _)| *pair == rival));
                match standing {
                    Some(place) if touch.depth > found[place].1.depth + SAME => found[place] = (index, *touch),
                    Some(_) => {}
                    None => found.push((index, *touch)),
                }
            }
        }
    }
}

impl core::fmt::Debug for Scene {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Scene").field("names", &self.names).field("pairs", &self.pairs.len()).finish_non_exhaustive()
    }
}
