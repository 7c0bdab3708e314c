//! Selection of the snapshots' viewer frames, in one pass with a bounded number of candidates.

use crate::scene::{BodySolids, SceneContent, SolidShape};
use crate::seconds;
use nalgebra::{Isometry3, Point3};
use std::collections::{BTreeMap, BTreeSet};

/// Most candidates spread over the run.
const MAX_SPREAD: usize = 64;
/// Most candidates at a first contact, of pairs with an object and of others each.
const MAX_CONTACT_CANDIDATES: usize = 16;
/// Most bodies of a scene.
const MAX_BODIES: usize = 128;
/// Rotation rate below which a box does not fall over [degrees/s].
const MIN_TIPPING_DEG_PER_S: f64 = 30.0;

/// Viewer frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct SnapshotFrame {
    pub(crate) tick: i64,
    pub(crate) poses: BTreeMap<String, Isometry3<f64>>,
    pub(crate) arrows: Vec<(Point3<f64>, Point3<f64>)>,
    pub(crate) reference: Option<Point3<f64>>,
    pub(crate) target: Option<Point3<f64>>,
    /// Position of the foot [m].
    pub(crate) foot: Option<Point3<f64>>,
    /// Reason for the selection.
    pub(crate) reason: String,
}

/// Candidates for snapshots.
#[derive(Clone, Debug)]
pub(crate) struct SnapshotCandidates {
    /// Bodies by name; their shapes are constant.
    pub(crate) bodies: BTreeMap<String, BodySolids>,
    /// Names of the free bodies.
    pub(crate) objects: BTreeSet<String>,
    poses: BTreeMap<String, Isometry3<f64>>,
    first: Option<SnapshotFrame>,
    last: Option<SnapshotFrame>,
    /// Frame with the largest force on the foot [N].
    strongest: Option<(f64, SnapshotFrame)>,
    /// Frame with the fastest rotation of a box [degrees/s].
    tipping: Option<(f64, SnapshotFrame)>,
    /// First contacts of the robot, or of an object, with an object.
    object_contacts: Vec<SnapshotFrame>,
    /// Other first contacts.
    pairs: Vec<SnapshotFrame>,
    spread: Vec<SnapshotFrame>,
    /// Number of frames per spread candidate.
    stride: u64,
    count: u64,
}

impl Default for SnapshotCandidates {
    fn default() -> Self {
        Self {
            bodies: BTreeMap::new(),
            objects: BTreeSet::new(),
            poses: BTreeMap::new(),
            first: None,
            last: None,
            strongest: None,
            tipping: None,
            object_contacts: Vec::new(),
            pairs: Vec::new(),
            spread: Vec::new(),
            stride: 1,
            count: 0,
        }
    }
}

impl SnapshotCandidates {
    /// Sets the poses of the next viewer frame.
    pub(crate) fn set_poses(&mut self, poses: Vec<(String, Isometry3<f64>)>) {
        for (name, pose) in poses {
            if self.poses.len() < MAX_BODIES || self.poses.contains_key(&name) {
                self.poses.insert(name, pose);
            }
        }
    }

    /// Adds a viewer frame.
    ///
    /// `objects` are the names of the free bodies; `foot` is the position of the foot [m] and the force on it [N];
    /// `touched` are the pairs with their first contact since the previous frame.
    pub(crate) fn add<'a>(
        &mut self,
        tick: i64,
        update: SceneContent,
        objects: impl Iterator<Item = &'a str>,
        foot: Option<(Point3<f64>, f64)>,
        touched: Vec<(String, String)>,
    ) {
        for name in objects {
            if self.objects.len() < MAX_BODIES && !self.objects.contains(name) {
                self.objects.insert(name.to_owned());
            }
        }
        for (name, body) in update.bodies {
            if self.bodies.len() < MAX_BODIES || self.bodies.contains_key(&name) {
                self.bodies.insert(name, body);
            }
        }
        let frame = SnapshotFrame {
            tick,
            poses: self.poses.clone(),
            arrows: update.arrows,
            reference: update.reference,
            target: update.target,
            foot: foot.map(|(position, _)| position),
            reason: String::new(),
        };
        let force = foot.map_or(0.0, |(_, force)| force);
        if force > self.strongest.as_ref().map_or(0.0, |best| best.0) {
            self.strongest = Some((force, SnapshotFrame { reason: "largest force on the foot".to_owned(), ..frame.clone() }));
        }
        if let Some((name, rate)) = self.fastest_rotation(tick)
            && rate > self.tipping.as_ref().map_or(MIN_TIPPING_DEG_PER_S, |best| best.0)
        {
            self.tipping = Some((rate, SnapshotFrame { reason: format!("{name} rotates fastest"), ..frame.clone() }));
        }
        for (body, against) in touched {
            let is_object = |name: &str| self.objects.contains(name);
            let salient = (is_object(&body) && !self.is_floor(&against)) || (is_object(&against) && !self.is_floor(&body));
            let list = if salient { &mut self.object_contacts } else { &mut self.pairs };
            if list.len() < MAX_CONTACT_CANDIDATES {
                list.push(SnapshotFrame { reason: format!("{body} and {against} touch"), ..frame.clone() });
            }
        }
        if self.count.is_multiple_of(self.stride) {
            self.spread.push(frame.clone());
            if self.spread.len() > MAX_SPREAD {
                let mut even = false;
                self.spread.retain(|_| {
                    even = !even;
                    even
                });
                self.stride *= 2;
            }
        }
        self.count += 1;
        if self.first.is_none() {
            self.first = Some(SnapshotFrame { reason: "start".to_owned(), ..frame.clone() });
        }
        self.last = Some(SnapshotFrame { reason: "end".to_owned(), ..frame });
    }

    /// Name of the box with the fastest rotation since the previous frame, and its rate [degrees/s].
    ///
    /// Balls do not count.
    fn fastest_rotation(&self, tick: i64) -> Option<(&str, f64)> {
        let last = self.last.as_ref().filter(|last| last.tick < tick)?;
        let rate = |name: &String| {
            let body = self.bodies.get(name)?;
            let is_box = body.solids.iter().any(|solid| matches!(solid.shape, SolidShape::Block { .. }));
            let (before, now) = (last.poses.get(&body.frame)?, self.poses.get(&body.frame)?);
            let angle = before.rotation.angle_to(&now.rotation).to_degrees();
            is_box.then(|| angle / seconds(tick - last.tick))
        };
        let rates = self.objects.iter().filter_map(|name| Some((name.as_str(), rate(name)?)));
        rates.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn is_floor(&self, name: &str) -> bool {
        self.bodies.get(name).is_some_and(|body| body.solids.iter().any(|solid| solid.shape == SolidShape::Floor))
    }

    /// Chooses up to `count` frames, in the order of time: the first, the last, and salient frames between them with
    /// some distance from each other.
    pub(crate) fn choose(&self, count: usize) -> Vec<&SnapshotFrame> {
        let (Some(first), Some(last)) = (&self.first, &self.last) else { return Vec::new() };
        let mut chosen = vec![first];
        if last.tick > first.tick {
            chosen.push(last);
        }
        let apart = ((last.tick - first.tick) / 30).max(1).unsigned_abs();
        let distance = |frame: &SnapshotFrame, chosen: &[&SnapshotFrame]| {
            chosen.iter().map(|other| frame.tick.abs_diff(other.tick)).min().unwrap_or(u64::MAX)
        };
        let (strongest, tipping) = (self.strongest.iter().map(|best| &best.1), self.tipping.iter().map(|best| &best.1));
        for candidates in [strongest.collect::<Vec<_>>(), self.object_contacts.iter().collect(), tipping.collect()] {
            let salient = candidates.into_iter().find(|frame| distance(frame, &chosen) >= apart);
            if let Some(frame) = salient
                && chosen.len() < count
            {
                chosen.push(frame);
            }
        }
        // First contacts, then the frames furthest from all others.
        for candidates in [&self.object_contacts, &self.pairs, &self.spread] {
            while chosen.len() < count {
                let furthest = candidates.iter().max_by_key(|frame| (distance(frame, &chosen), std::cmp::Reverse(frame.tick)));
                match furthest {
                    Some(frame) if distance(frame, &chosen) >= apart => chosen.push(frame),
                    _ => break,
                }
            }
        }
        chosen.sort_by_key(|frame| frame.tick);
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::PlacedSolid;
    use nalgebra::Vector3;

    /// Box, ball and floor.
    fn bodies() -> Vec<(String, BodySolids)> {
        let body = |name: &str, shape| {
            let solids = vec![PlacedSolid { pose: Isometry3::identity(), shape, color: [0.5; 3] }];
            (name.to_owned(), BodySolids { frame: name.to_owned(), solids })
        };
        vec![
            body("box", SolidShape::Block { size: Vector3::repeat(0.1) }),
            body("ball", SolidShape::Ball { radius: 0.1 }),
            body("floor", SolidShape::Floor),
        ]
    }

    fn rotated(angle_deg: f64) -> Isometry3<f64> {
        Isometry3::rotation(Vector3::x() * angle_deg.to_radians())
    }

    #[test]
    fn frames_salient_events_and_ends_are_chosen() {
        let mut frames = SnapshotCandidates::default();
        for tick in (0..100_000).step_by(10) {
            // The ball rotates faster than the box tips, which must not count; the box creeps afterwards.
            let fall = if tick < 70_000 { 0.0 } else { (tick - 70_000) as f64 * 0.1 };
            frames.set_poses(vec![
                ("box".to_owned(), rotated(fall.min(90.0) + tick as f64 * 1e-4)),
                ("ball".to_owned(), rotated((tick % 3000) as f64)),
            ]);
            let update = SceneContent { bodies: if tick == 0 { bodies() } else { Vec::new() }, ..SceneContent::default() };
            let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
            let touched = match tick {
                5_000 => vec![pair("ball", "floor")],
                12_000 => vec![pair("shank", "ball")],
                20_000 => vec![pair("foot", "floor")],
                _ => Vec::new(),
            };
            let force = if tick == 33_330 { 99.0 } else { 10.0 };
            frames.add(tick, update, ["box", "ball"].into_iter(), Some((Point3::origin(), force)), touched);
        }
        assert!(frames.spread.len() <= MAX_SPREAD && frames.spread.len() > MAX_SPREAD / 4);
        let chosen = frames.choose(5);
        let reasons: Vec<_> = chosen.iter().map(|frame| frame.reason.as_str()).collect();
        assert_eq!(reasons, ["start", "shank and ball touch", "largest force on the foot", "box rotates fastest", "end"]);
        assert_eq!((chosen[1].tick, chosen[2].tick), (12_000, 33_330));
        assert!((70_000..71_000).contains(&chosen[3].tick), "{}", chosen[3].tick);
        let six: Vec<_> = frames.choose(6).iter().map(|frame| frame.tick).collect();
        assert!(six.contains(&20_000), "the other first contact far from the start: {six:?}");
    }

    #[test]
    fn frames_without_events_are_spread_evenly() {
        let mut frames = SnapshotCandidates::default();
        for tick in 0..1000 {
            frames.add(tick, SceneContent::default(), std::iter::empty(), None, Vec::new());
        }
        let ticks: Vec<_> = frames.choose(5).iter().map(|frame| frame.tick).collect();
        assert_eq!(ticks.len(), 5);
        assert!(ticks.windows(2).all(|pair| pair[1] - pair[0] > 150), "{ticks:?}");
        assert!(SnapshotCandidates::default().choose(5).is_empty());
    }
}
