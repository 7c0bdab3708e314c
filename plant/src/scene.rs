//! Bodies of the world, their colliders, and the contact pairs.

use crate::collider::{BodyId, Collider, ColliderStates};
use crate::contact_law::ContactLaw;
use crate::contact_point::{ContactFinder, ContactPoint, ContactShape};
use crate::error::PlantError;
use crate::object::FreeBody;
use crate::pair_cache::PairCache;
use hapfic_config::{Object, ObjectShape, Settings, Surface};
use hapfic_messages::Physics;
use hapfic_robot::{Chain, Collision, Kinematics, Shape};
use nalgebra::{Isometry3, Matrix3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::shape::{Ball, ConvexPolyhedron, Cuboid, HalfSpace};

/// Stiffness below which foot and shank may touch the same place [N/m]. They make one contact then: the deeper one.
const SOFT: f64 = 1e5;
/// Difference up to which two depths count as equal [m]: the end of the shank lies in the foot.
const SAME: f64 = 1e-9;

/// Two colliders that may touch. The normal force acts on `body` along the normal, and on `against` the opposite way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContactPair {
    pub(crate) body: Collider,
    pub(crate) against: Collider,
    pub(crate) law: ContactLaw,
    /// Whether the force sensor at the tip measures the contact.
    pub(crate) sensed: bool,
    /// Pair of the foot, if this is the shank on a soft body: only the deeper of the two pairs counts.
    pub(crate) foot_pair: Option<usize>,
}

impl ContactPair {
    /// Whether a link takes part.
    pub(crate) fn has_link(&self) -> bool {
        matches!(self.body.parent, BodyId::Link(_))
    }

    /// Whether a free body takes part.
    pub(crate) fn has_object(&self) -> bool {
        [self.body, self.against].iter().any(|collider| matches!(collider.parent, BodyId::Object(_)))
    }
}

/// Colliders of the world, and the pairs that may touch.
#[derive(Clone)]
pub(crate) struct CollisionScene {
    pub(crate) chain: Chain,
    pub(crate) names: Vec<String>,
    pub(crate) pairs: Vec<ContactPair>,
    colliders: Vec<Collider>,
    collider_states: ColliderStates,
    pair_caches: Vec<PairCache>,
    finder: ContactFinder,
    hulls: Vec<ConvexPolyhedron>,
    /// Surfaces of floor and objects, each with the index of its collider.
    surfaces: Vec<(usize, Surface)>,
}

/// Contact points, each with the index of its pair.
pub(crate) type PairContacts = Vec<(usize, ContactPoint)>;

/// Largest capsule inside a URDF cylinder.
fn inscribed(radius: f64, length: f64) -> ContactShape {
    let radius = radius.min(0.5 * length);
    let half = 0.5 * length - radius;
    if half > 0.0 { ContactShape::capsule(-half, half, radius) } else { ContactShape::Ball(Ball::new(radius)) }
}

/// The shape for the contacts; a hull joins `hulls`. `None` if a hull has no volume.
fn contact_shape(shape: &Shape, hulls: &mut Vec<ConvexPolyhedron>) -> Option<ContactShape> {
    Some(match *shape {
        Shape::Sphere { radius } => ContactShape::Ball(Ball::new(radius)),
        Shape::Cylinder { radius, length } => inscribed(radius, length),
        Shape::Capsule { radius, length } => ContactShape::capsule(-0.5 * length, 0.5 * length, radius),
        Shape::Box { size } => ContactShape::Box(Cuboid::new(Vector::new(0.5 * size[0], 0.5 * size[1], 0.5 * size[2]))),
        Shape::Hull { ref corners } => {
            let corners: Vec<Vector> = corners.iter().map(|corner| Vector::from_array(*corner)).collect();
            let radius = corners.iter().fold(0.0, |most: f64, corner| most.max(corner.length()));
            hulls.push(ConvexPolyhedron::from_convex_hull(&corners)?);
            ContactShape::Hull { index: hulls.len() - 1, radius }
        }
    })
}

/// The same on a soft body: the capsule's axis spans the whole cylinder, so that the shank's reaches into the foot.
fn on_soft(collider: &Collider, shape: &Shape) -> ContactShape {
    match *shape {
        Shape::Cylinder { radius, length } => ContactShape::capsule(-0.5 * length, 0.5 * length, radius),
        _ => collider.shape,
    }
}

/// Contact law of two surfaces: stiffness and damping of the softer one, friction of the more slippery one.
fn combine_surfaces(a: &Surface, b: &Surface) -> ContactLaw {
    let soft = ContactLaw::of(if a.stiffness_n_per_m <= b.stiffness_n_per_m { a } else { b });
    let slippery = if a.friction_static <= b.friction_static { a } else { b };
    ContactLaw {
        friction_static: slippery.friction_static,
        friction_dynamic: slippery.friction_dynamic,
        critical_speed: slippery.critical_speed_m_per_s,
        ..soft
    }
}

/// Floor or object, with its surface.
struct EnvironmentBody<'a> {
    collider: Collider,
    surface: &'a Surface,
}

impl CollisionScene {
    /// Builds the colliders and pairs of a scenario.
    pub(crate) fn new(settings: &Settings, chain: Chain) -> Result<Self, PlantError> {
        let mut scene = Self {
            chain,
            names: Vec::new(),
            pairs: Vec::new(),
            colliders: Vec::new(),
            collider_states: ColliderStates::new(0),
            pair_caches: Vec::new(),
            finder: ContactFinder::default(),
            hulls: Vec::new(),
            surfaces: Vec::new(),
        };
        let link_colliders = scene.link_colliders()?;
        let mut environment = Vec::new();
        if let Some(floor) = &settings.world.floor {
            let local = Isometry3::translation(0.0, 0.0, floor.height_m);
            let shape = ContactShape::HalfSpace(HalfSpace::new(Vector::Z));
            environment.push(EnvironmentBody {
                collider: scene.add_named_collider(BodyId::World, shape, local, "floor")?,
                surface: &floor.surface,
            });
        }
        for (index, object) in settings.world.objects.iter().enumerate() {
            environment.push(scene.object(index, object)?);
        }
        scene.surfaces = environment.iter().map(|body| (body.collider.index, *body.surface)).collect();
        if !environment.is_empty() && !link_colliders.iter().any(|(_, collision)| scene.is_foot(collision)) {
            return Err(PlantError::NoFoot { link: scene.chain.tip_link().to_owned() });
        }
        let tip_only = settings.world.floor.as_ref().is_some_and(|floor| floor.tip_only);
        for other in &environment {
            let alone = tip_only && matches!(other.collider.parent, BodyId::World);
            let touching: Vec<_> =
                link_colliders.iter().filter(|(_, collision)| !alone || scene.is_foot(collision)).cloned().collect();
            scene.pair_with_links(&touching, other);
        }
        for (i, against) in environment.iter().enumerate() {
            for body in &environment[i + 1..] {
                let law = combine_surfaces(body.surface, against.surface);
                scene.pairs.push(ContactPair {
                    body: body.collider,
                    against: against.collider,
                    law,
                    sensed: false,
                    foot_pair: None,
                });
            }
        }
        scene.collider_states = ColliderStates::new(scene.colliders.len());
        for collider in &scene.colliders {
            if let ContactShape::Hull { index, radius } = collider.shape {
                scene.finder.warm_up(&scene.hulls[index], radius);
            }
        }
        scene.pair_caches = vec![PairCache::new(); scene.pairs.len()];
        Ok(scene)
    }

    /// All colliders, in the order of their indices.
    pub(crate) fn colliders(&self) -> &[Collider] {
        &self.colliders
    }

    /// A convex hull by its index.
    pub(crate) fn hull(&self, index: usize) -> &ConvexPolyhedron {
        &self.hulls[index]
    }

    /// Sliding friction of a collider's surface; `None` for a link, which has none of its own.
    pub(crate) fn friction(&self, collider: &Collider) -> Option<f64> {
        self.surfaces.iter().find(|(index, _)| *index == collider.index).map(|(_, surface)| surface.friction_dynamic)
    }

    fn is_foot(&self, collision: &Collision) -> bool {
        collision.link == self.chain.tip_link()
    }

    fn add_named_collider(
        &mut self,
        parent: BodyId,
        shape: ContactShape,
        local: Isometry3<f64>,
        name: &str,
    ) -> Result<Collider, PlantError> {
        if !matches!(parent, BodyId::Link(_)) && self.names.iter().any(|n| n == name) {
            return Err(PlantError::Name { name: name.to_owned() });
        }
        // All shapes of a link share one name.
        let index = self.names.iter().position(|n| n == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        Ok(self.add_collider(Collider::new(parent, shape, local, index, self.colliders.len())))
    }

    fn add_collider(&mut self, collider: Collider) -> Collider {
        self.colliders.push(collider);
        collider
    }

    /// Adds the moving colliders of the robot, the foot first.
    fn link_colliders(&mut self) -> Result<Vec<(Collider, Collision)>, PlantError> {
        let mut collisions: Vec<Collision> = self.chain.collisions().to_vec();
        collisions.sort_by_key(|c| !self.is_foot(c));
        let mut link_colliders = Vec::new();
        for collision in collisions {
            let Some(body) = collision.body else { continue };
            // A disc would be a capsule, and a hull has a single contact point: neither stands flat.
            if self.is_foot(&collision) && matches!(collision.shape, Shape::Cylinder { .. } | Shape::Hull { .. }) {
                return Err(PlantError::FootShape { link: collision.link.clone(), shape: collision.shape.describe() });
            }
            // A hull without volume touches nothing; the description was warned of.
            let Some(shape) = contact_shape(&collision.shape, &mut self.hulls) else { continue };
            let collider = self.add_named_collider(BodyId::Link(body), shape, collision.origin, &collision.link)?;
            link_colliders.push((collider, collision));
        }
        Ok(link_colliders)
    }

    fn object<'a>(&mut self, index: usize, object: &'a Object) -> Result<EnvironmentBody<'a>, PlantError> {
        let shape = match object.shape {
            ObjectShape::Box { size_m: [x, y, z] } => ContactShape::Box(Cuboid::new(Vector::new(0.5 * x, 0.5 * y, 0.5 * z))),
            ObjectShape::Ball { radius_m } => ContactShape::Ball(Ball::new(radius_m)),
        };
        let collider = self.add_named_collider(BodyId::Object(index), shape, Isometry3::identity(), &object.name)?;
        Ok(EnvironmentBody { collider, surface: &object.surface })
    }

    fn pair_with_links(&mut self, link_colliders: &[(Collider, Collision)], other: &EnvironmentBody) {
        let law = ContactLaw::of(other.surface);
        let round = |collision: &Collision| matches!(collision.shape, Shape::Sphere { .. });
        let feet = link_colliders.iter().filter(|(_, collision)| self.is_foot(collision)).count();
        let mut foot = None;
        for (collider, collision) in link_colliders {
            let sensed = self.is_foot(collision);
            let mut body = *collider;
            let mut foot_pair = None;
            if law.stiffness < SOFT && !sensed {
                // The link that carries a single sphere reaches into it; other links do not, and a flat foot is wider.
                foot_pair = foot.filter(|(_, parent)| *parent == collider.parent).map(|(pair, _)| pair);
                if foot_pair.is_some() {
                    body = self.add_collider(collider.with(on_soft(collider, &collision.shape), self.colliders.len()));
                }
            }
            if sensed && feet == 1 && round(collision) {
                foot = Some((self.pairs.len(), collider.parent));
            }
            self.pairs.push(ContactPair { body, against: other.collider, law, sensed, foot_pair });
        }
    }

    /// Updates the poses of all colliders for the queries that follow.
    pub(crate) fn update_colliders(&mut self, kin: &Kinematics, qd: &[f64], objects: &[FreeBody]) {
        self.collider_states.update(&self.colliders, &self.chain, kin, qd, objects);
    }

    /// Upper bound of the closing speed of a pair [m/s].
    pub(crate) fn closing_speed(&self, index: usize) -> f64 {
        let pair = &self.pairs[index];
        self.collider_states.of(&pair.body).speed + self.collider_states.of(&pair.against).speed
    }

    /// Contact points of a pair with a gap below `reach` [m].
    pub(crate) fn pair_contacts(
        &mut self,
        index: usize,
        objects: &[FreeBody],
        reach: f64,
    ) -> impl Iterator<Item = &ContactPoint> {
        let ContactPair { body, against, .. } = &self.pairs[index];
        let (at, to) = (self.collider_states.of(body), self.collider_states.of(against));
        let pair_cache = &mut self.pair_caches[index];
        let contacts = pair_cache.contacts(
            self.collider_states.instant,
            (body, at),
            (against, to),
            objects,
            reach,
            (&mut self.finder, &self.hulls),
        );
        contacts.iter().filter(move |contact| -contact.depth < reach)
    }

    /// Finds the contact points of all pairs whose gap is below the limit from `choose` [m]; `None` skips a pair.
    pub(crate) fn find_contacts(
        &mut self,
        objects: &[FreeBody],
        choose: impl Fn(&Self, usize) -> Option<f64>,
        contacts: &mut PairContacts,
    ) {
        contacts.clear();
        for index in 0..self.pairs.len() {
            let Some(reach) = choose(self, index) else { continue };
            let foot_pair = self.pairs[index].foot_pair;
            let mut deepest: Option<(f64, Vector3<f64>)> = None;
            for contact in self.pair_contacts(index, objects, reach) {
                if deepest.is_none_or(|(depth, _)| contact.depth > depth) {
                    deepest = Some((contact.depth, contact.normal));
                }
                let existing = foot_pair.and_then(|foot_pair| contacts.iter().position(|(pair, _)| *pair == foot_pair));
                match existing {
                    Some(at) if contact.depth > contacts[at].1.depth + SAME => contacts[at] = (index, *contact),
                    Some(_) => {}
                    None => contacts.push((index, *contact)),
                }
            }
            if let Some((_, normal)) = deepest {
                self.keep_side(index, &normal);
            }
        }
    }
}

impl CollisionScene {
    /// Keeps the side on which the body of a pair is by the normal of its deepest contact.
    fn keep_side(&mut self, index: usize, normal: &Vector3<f64>) {
        let (between, against) = self.between(index);
        // A body that is already beyond the middle cannot pass it.
        self.pair_caches[index].side = (between.dot(normal) > 0.0).then(|| against.tr_mul(normal));
    }

    /// From the centre of `against` to that of `body`, and the orientation of `against`.
    fn between(&self, index: usize) -> (Vector3<f64>, &Matrix3<f64>) {
        let pair = &self.pairs[index];
        let (body, against) = (self.collider_states.of(&pair.body), self.collider_states.of(&pair.against));
        (body.center - against.center, &against.rotation)
    }

    /// Counts the pairs whose body has crossed to the other side since its contacts were found, and forgets the sides.
    ///
    /// The contact normal of two convex shapes leads from the middle of one to the middle of the other. Once the middle
    /// of `body` lies beyond that of `against`, seen along that normal, the contact pushes the wrong way: the body has
    /// passed through. That holds for any depth, and for a body that jumps across in a single sub-step.
    pub(crate) fn note_passages(&mut self, physics: &mut Physics) {
        for index in 0..self.pairs.len() {
            let Some(side) = self.pair_caches[index].side.take() else { continue };
            let (between, against) = self.between(index);
            if between.dot(&(against * side)) < 0.0 {
                let pair = &self.pairs[index];
                physics.passages += 1;
                (physics.passed_body, physics.passed_against) = (pair.body.name_index as u32, pair.against.name_index as u32);
            }
        }
    }

    /// Forgets all sides: a state before, or a state that was set, says nothing about the motion to come.
    pub(crate) fn forget_sides(&mut self) {
        self.pair_caches.iter_mut().for_each(|cache| cache.side = None);
    }
}

impl core::fmt::Debug for CollisionScene {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("CollisionScene").field("names", &self.names).field("pairs", &self.pairs.len()).finish_non_exhaustive()
    }
}
