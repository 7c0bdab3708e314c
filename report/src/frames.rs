//! Which moments of a run are worth a picture, found in one pass with a bounded number of candidates.

use crate::geometry::{Pose, Vector, add, norm, scale};
use crate::scene::{Body, Update};
use std::collections::BTreeMap;

/// Most frames kept for being spread over the run.
const MOST_SPREAD: usize = 64;
/// Most frames kept for a pair that touched for the first time.
const MOST_PAIRS: usize = 16;
/// Most bodies of a scene.
const MOST_BODIES: usize = 128;
/// A turn below it is not worth a picture, degrees.
const SMALLEST_TURN_DEG: f64 = 1.0;

/// A moment as a viewer saw it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Frame {
    pub(crate) tick: i64,
    pub(crate) poses: BTreeMap<String, Pose>,
    pub(crate) arrows: Vec<(Vector, Vector)>,
    pub(crate) reference: Option<Vector>,
    pub(crate) target: Option<Vector>,
    /// Why it was kept.
    pub(crate) reason: String,
}

/// The candidates.
#[derive(Clone, Debug)]
pub(crate) struct Frames {
    /// Bodies by name; they do not change their shape.
    pub(crate) bodies: BTreeMap<String, Body>,
    poses: BTreeMap<String, Pose>,
    first: Option<Frame>,
    last: Option<Frame>,
    strongest: Option<(f64, Frame)>,
    turned: Option<(f64, Frame)>,
    pairs: Vec<Frame>,
    spread: Vec<Frame>,
    /// One frame of so many is kept for being spread over the run.
    stride: u64,
    count: u64,
}

impl Default for Frames {
    fn default() -> Self {
        Self {
            bodies: BTreeMap::new(),
            poses: BTreeMap::new(),
            first: None,
            last: None,
            strongest: None,
            turned: None,
            pairs: Vec::new(),
            spread: Vec::new(),
            stride: 1,
            count: 0,
        }
    }
}

impl Frames {
    /// Where the frames are from now on.
    pub(crate) fn moved(&mut self, poses: Vec<(String, Pose)>) {
        for (name, pose) in poses {
            if self.poses.len() < MOST_BODIES || self.poses.contains_key(&name) {
                self.poses.insert(name, pose);
            }
        }
    }

    /// A frame is whole. `turned` is the object that has turned furthest, and how far, degrees; `touching` names a pair that
    /// touches for the first time in the run.
    pub(crate) fn shown(&mut self, tick: i64, update: Update, turned: Option<(&str, f64)>, touching: Option<String>) {
        for (name, body) in update.bodies {
            if self.bodies.len() < MOST_BODIES || self.bodies.contains_key(&name) {
                self.bodies.insert(name, body);
            }
        }
        let frame = Frame {
            tick,
            poses: self.poses.clone(),
            arrows: update.arrows,
            reference: update.reference,
            target: update.target,
            reason: String::new(),
        };
        let force = frame.arrows.iter().map(|(from, to)| norm(add(*to, scale(*from, -1.0)))).fold(0.0, f64::max);
        if force > self.strongest.as_ref().map_or(0.0, |best| best.0) {
            self.strongest = Some((force, Frame { reason: "largest contact force".to_owned(), ..frame.clone() }));
        }
        if let Some((name, angle)) = turned
            && angle > self.turned.as_ref().map_or(SMALLEST_TURN_DEG, |best| best.0)
        {
            self.turned = Some((angle, Frame { reason: format!("{name} turned by {angle:.0}°"), ..frame.clone() }));
        }
        if let Some(pair) = touching
            && self.pairs.len() < MOST_PAIRS
        {
            self.pairs.push(Frame { reason: format!("{pair} touch"), ..frame.clone() });
        }
        if self.count.is_multiple_of(self.stride) {
            self.spread.push(frame.clone());
            if self.spread.len() > MOST_SPREAD {
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
            self.first = Some(Frame { reason: "start".to_owned(), ..frame.clone() });
        }
        self.last = Some(Frame { reason: "end".to_owned(), ..frame });
    }

    /// The frames to draw, in the order of time: the first, the last, and between them the most telling ones that are not too
    /// close to each other.
    pub(crate) fn choose(&self, most: usize) -> Vec<&Frame> {
        let (Some(first), Some(last)) = (&self.first, &self.last) else { return Vec::new() };
        let mut chosen = vec![first];
        if last.tick > first.tick {
            chosen.push(last);
        }
        let apart = ((last.tick - first.tick) / 30).max(1);
        let distance = |frame: &Frame, chosen: &[&Frame]| {
            chosen.iter().map(|other| frame.tick.abs_diff(other.tick)).min().unwrap_or(u64::MAX)
        };
        let best = [&self.turned, &self.strongest].into_iter().flatten().map(|(_, frame)| frame);
        for frame in best {
            if chosen.len() < most && distance(frame, &chosen) >= apart.unsigned_abs() {
                chosen.push(frame);
            }
        }
        // First contacts while there are any, then whatever is furthest from all others.
        for candidates in [&self.pairs, &self.spread] {
            while chosen.len() < most {
                let furthest = candidates.iter().max_by_key(|frame| (distance(frame, &chosen), std::cmp::Reverse(frame.tick)));
                match furthest {
                    Some(frame) if distance(frame, &chosen) >= apart.unsigned_abs() => chosen.push(frame),
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

    #[test]
    fn the_extremes_and_the_ends_are_chosen_in_bounded_memory() {
        let mut frames = Frames::default();
        for tick in 0..100_000 {
            let length = if tick == 33_333 { 0.2 } else { 0.1 };
            let update = Update { arrows: vec![([0.0; 3], [0.0, 0.0, length])], ..Update::default() };
            let turned = if tick == 70_000 { 88.0 } else { 2.0 };
            let touching = (tick == 12_000).then(|| "foot-box".to_owned());
            frames.shown(tick, update, Some(("box", turned)), touching);
        }
        assert!(frames.spread.len() <= MOST_SPREAD && frames.spread.len() > MOST_SPREAD / 4);
        let chosen = frames.choose(5);
        assert_eq!(chosen.iter().map(|frame| frame.tick).collect::<Vec<_>>(), [0, 12_000, 33_333, 70_000, 99_999]);
        assert_eq!(chosen[3].reason, "box turned by 88°");
    }

    #[test]
    fn without_anything_telling_they_are_spread_evenly() {
        let mut frames = Frames::default();
        for tick in 0..1000 {
            frames.shown(tick, Update::default(), None, None);
        }
        let ticks: Vec<_> = frames.choose(5).iter().map(|frame| frame.tick).collect();
        assert_eq!(ticks.len(), 5);
        assert!(ticks.windows(2).all(|pair| pair[1] - pair[0] > 150), "{ticks:?}");
        assert!(Frames::default().choose(5).is_empty());
    }
}
