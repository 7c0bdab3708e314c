//! Cache of the contacts of a pair, so that no query runs twice and distant pairs need no query.

use crate::collider::{Collider, ColliderState};
use crate::contact_point::{ContactFinder, ContactPoints, ContactShape};
use crate::object::FreeBody;
use nalgebra::{Matrix3, Vector3};
use parry3d_f64::shape::ConvexPolyhedron;

/// Search distance beyond the requested one [m]: a pair stays apart until its shapes have moved that far.
const MARGIN: f64 = 5e-3;

/// Cached query of a pair.
#[derive(Clone, Debug)]
pub(crate) struct PairCache {
    /// Instant of `contacts`; `None` before the first query.
    instant: Option<u64>,
    /// `contacts` holds all points with a gap below this [m].
    within: f64,
    contacts: ContactPoints,
    /// Poses of both shapes when their gap was at least `gap` [m].
    apart: [(Vector3<f64>, Matrix3<f64>); 2],
    gap: f64,
    /// Normal of the deepest contact in the frame of `against`, with `body` on its side; `None` without a contact.
    pub(crate) side: Option<Vector3<f64>>,
}

impl PairCache {
    pub(crate) fn new() -> Self {
        let at_origin = (Vector3::zeros(), Matrix3::zeros());
        Self {
            instant: None,
            within: 0.0,
            contacts: ContactPoints::new(),
            apart: [at_origin; 2],
            gap: f64::NEG_INFINITY,
            side: None,
        }
    }

    /// Contact points of `body` and `against` at an instant: all with a gap below `reach` [m], perhaps more.
    pub(crate) fn contacts(
        &mut self,
        instant: u64,
        body: (&Collider, &ColliderState),
        against: (&Collider, &ColliderState),
        objects: &[FreeBody],
        reach: f64,
        (finder, hulls): (&mut ContactFinder, &[ConvexPolyhedron]),
    ) -> &ContactPoints {
        if self.instant == Some(instant) && reach <= self.within {
            return &self.contacts;
        }
        let apart = || self.gap - body.1.travel(body.0, &self.apart[0]) - against.1.travel(against.0, &self.apart[1]);
        if !near(body, against, reach) || (self.gap > reach && apart() > reach) {
            self.contacts.clear();
            (self.instant, self.within) = (Some(instant), reach);
            return &self.contacts;
        }
        let boxes = matches!((&body.0.shape, &against.0.shape), (ContactShape::Box(_), ContactShape::Box(_)));
        // The corners of a manifold depend on the search distance.
        self.within = if boxes { reach } else { reach + MARGIN };
        self.instant = Some(instant);
        finder.find_contacts(
            &body.1.posed_shape(body.0, hulls, objects),
            &against.1.posed_shape(against.0, hulls, objects),
            self.within,
            &mut self.contacts,
        );
        let gap = self.contacts.iter().fold(self.within, |gap, contact| gap.min(-contact.depth));
        self.gap = if gap > reach { gap } else { f64::NEG_INFINITY };
        if gap > reach {
            self.apart = [(body.1.center, body.1.rotation), (against.1.center, against.1.rotation)];
        }
        &self.contacts
    }
}

/// Whether the bounding spheres of two shapes are nearer than `reach` [m].
fn near(a: (&Collider, &ColliderState), b: (&Collider, &ColliderState), reach: f64) -> bool {
    let between = a.1.center - b.1.center;
    match (a.0.shape.bounding_radius(), b.0.shape.bounding_radius()) {
        (Some(ra), Some(rb)) => {
            let limit = ra + rb + reach;
            between.norm_squared() <= limit * limit
        }
        (Some(ra), None) => b.1.rotation.column(2).dot(&between) <= ra + reach,
        (None, Some(rb)) => -a.1.rotation.column(2).dot(&between) <= rb + reach,
        (None, None) => false,
    }
}
