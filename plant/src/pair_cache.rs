//! Pairs of shapes, and what is known of each, so that nothing is asked for twice and far pairs are not asked for at all.

use crate::collider::{Collider, Placed};
use crate::contact_point::{ContactShape, Finder, Touches};
use crate::object::FreeBody;
use nalgebra::{Matrix3, Vector3};

/// How far beyond what is asked for is looked, m: as long as both shapes have not gone that way, a pair is known to be apart.
const MARGIN: f64 = 5e-3;

/// What is known of a pair.
#[derive(Clone, Debug)]
pub(crate) struct PairCache {
    /// The instant of the touches; none yet.
    instant: Option<u64>,
    /// All touches with a gap below `within`, m, are known.
    within: f64,
    touches: Touches,
    /// Where the two were when their gap was at least `gap`, m.
    apart: [(Vector3<f64>, Matrix3<f64>); 2],
    gap: f64,
}

impl PairCache {
    pub(crate) fn new() -> Self {
        let nowhere = (Vector3::zeros(), Matrix3::zeros());
        Self { instant: None, within: 0.0, touches: Touches::new(), apart: [nowhere; 2], gap: f64::NEG_INFINITY }
    }

    /// Where `body` touches `against` at an instant: all touches with a gap below `reach`, m, and perhaps more.
    pub(crate) fn look(
        &mut self,
        instant: u64,
        body: (&Collider, &Placed),
        against: (&Collider, &Placed),
        objects: &[FreeBody],
        reach: f64,
        finder: &mut Finder,
    ) -> &Touches {
        if self.instant == Some(instant) && reach <= self.within {
            return &self.touches;
        }
        let apart = || self.gap - body.1.way(body.0, &self.apart[0]) - against.1.way(against.0, &self.apart[1]);
        if !near(body, against, reach) || (self.gap > reach && apart() > reach) {
            self.touches.clear();
            (self.instant, self.within) = (Some(instant), reach);
            return &self.touches;
        }
        let boxes = matches!((&body.0.form, &against.0.form), (ContactShape::Box(_), ContactShape::Box(_)));
        // The corners of a manifold are those of its reach.
        self.within = if boxes { reach } else { reach + MARGIN };
        self.instant = Some(instant);
        finder.touches(&body.1.solid(body.0, objects), &against.1.solid(against.0, objects), self.within, &mut self.touches);
        let gap = self.touches.iter().fold(self.within, |gap, touch| gap.min(-touch.depth));
        self.gap = if gap > reach { gap } else { f64::NEG_INFINITY };
        if gap > reach {
            self.apart = [(body.1.center, body.1.rotation), (against.1.center, against.1.rotation)];
        }
        &self.touches
    }
}

/// Whether the spheres about two shapes are nearer than `reach`.
fn near(a: (&Collider, &Placed), b: (&Collider, &Placed), reach: f64) -> bool {
    let between = a.1.center - b.1.center;
    match (a.0.form.reach(), b.0.form.reach()) {
        (Some(ra), Some(rb)) => {
            let limit = ra + rb + reach;
            between.norm_squared() <= limit * limit
        }
        (Some(ra), None) => b.1.rotation.column(2).dot(&between) <= ra + reach,
        (None, Some(rb)) => -a.1.rotation.column(2).dot(&between) <= rb + reach,
        (None, None) => false,
    }
}
