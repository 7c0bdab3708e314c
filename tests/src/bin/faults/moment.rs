//! What came of one fault.

use crate::trace::{Command, Trace};
use hapfic_messages::EventKind;
use std::ops::Range;

/// Ticks before and after a fault whose missed ones count for it.
pub(crate) const AROUND: usize = 200;
/// Ticks after a fault in which the torque's steps count.
const STEPS: usize = 300;
/// Ticks after a fault in which the position error counts, if no other fault comes.
const ERRORS: usize = 1000;
/// Ticks after a fault in which a wait for commands, or a promotion, is taken for its consequence.
const AFTER: usize = 100;

/// What came of a fault; of an undisturbed run: what was there without one.
#[derive(Clone, Debug)]
pub(crate) struct Moment {
    /// Ticks around it without fresh torque.
    pub(crate) missed: f64,
    /// Of them, those of outages that began while the plant's own timer was not late.
    pub(crate) own: f64,
    /// The other controller became the primary.
    pub(crate) promoted: bool,
    /// From the fault to the first braking command, ms.
    pub(crate) to_brake_ms: Option<f64>,
    /// Missed ticks in a row before the brake, the one at which it began included.
    pub(crate) braked_at_missed: Option<usize>,
    /// From the first tick that nobody answered to the next that somebody did, ms.
    pub(crate) back_ms: Option<f64>,
    /// From the first tick without fresh torque to the next with, ms.
    pub(crate) recovered_ms: Option<f64>,
    /// Longest time from one command to the next, ms.
    pub(crate) wait_ms: Option<f64>,
    /// Largest step of a joint's torque between active commands, N m.
    pub(crate) step: f64,
    /// The same to commands whose torque ramps in after a brake, N m.
    pub(crate) ramp_step: Option<f64>,
    /// Largest |x - x_d| of any axis, mm.
    pub(crate) error_mm: f64,
}

/// The largest difference of any joint's torque, N m.
fn step(before: &Command, after: &Command) -> f64 {
    before.torque.iter().zip(&after.torque).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Looks at what came of a fault at tick `at`; the next one is at `next`.
pub(crate) fn measure(trace: &Trace, at: usize, next: usize) -> Moment {
    let end = trace.last().map_or(0, |last| last + 1);
    let until = |ticks: usize| at..(at + ticks).min(end);
    let around = at.saturating_sub(AROUND)..(at + AROUND + 1).min(end);
    let (mut missed, mut own) = (0, 0);
    for outage in trace.outages() {
        let inside = outage.start.max(around.start)..outage.end.min(around.end);
        missed += inside.len();
        own += if trace.host_took(&outage) { 0 } else { inside.len() };
    }
    let find = |from: usize, wanted: &dyn Fn(&Command) -> bool| (from..end).find(|tick| trace.command(*tick).is_some_and(wanted));
    let close = |tick: &usize| *tick <= at + AROUND;
    let brake = find(at, &Command::brakes).filter(close);
    let silent = find(at, &|command: &Command| !command.answered()).filter(close);
    let stale = find(at, &|command: &Command| !command.fresh()).filter(close);
    let ms =
        |from: Option<usize>, wanted: &dyn Fn(&Command) -> bool| from.and_then(|from| Some((find(from, wanted)? - from) as f64));
    let pairs = |ticks: Range<usize>| {
        ticks.filter_map(|tick| Some((trace.command(tick.checked_sub(1)?)?, trace.command(tick)?))).collect::<Vec<_>>()
    };
    let steps = pairs(until(STEPS));
    let active = steps.iter().filter(|(before, after)| before.active() && after.active());
    let ramping = steps.iter().filter(|(_, after)| after.ramped != 0).map(|(before, after)| step(before, after));
    let waits = until(AFTER).filter_map(|tick| {
        let (before, after) = (trace.ticks.get(tick.checked_sub(1)?)?.gated_ns?, trace.ticks[tick].gated_ns?);
        Some(after.saturating_sub(before) as f64 * 1e-6)
    });
    let error = |tick: usize| {
        let (foot, wanted) = (trace.ticks[tick].foot?, trace.ticks[tick].wanted?);
        foot.iter().zip(&wanted).map(|(x, xd)| (x - xd).abs()).reduce(f64::max)
    };
    let errors = at..(at + ERRORS).min(next).min(end);
    let promotions = at as i64 - 1..(at + AFTER) as i64;
    Moment {
        missed: missed as f64,
        own: own as f64,
        promoted: trace.events(EventKind::Promoted).any(|event| promotions.contains(&event.tick)),
        to_brake_ms: brake.map(|tick| (tick - at) as f64),
        braked_at_missed: brake.map(|tick| {
            let before = (0..tick).rev().take_while(|tick| trace.command(*tick).is_some_and(|c| !c.answered() && !c.brakes()));
            before.count() + 1
        }),
        back_ms: ms(silent, &Command::answered),
        recovered_ms: ms(stale, &Command::fresh),
        wait_ms: waits.reduce(f64::max),
        step: active.map(|(before, after)| step(before, after)).fold(0.0, f64::max),
        ramp_step: ramping.reduce(f64::max),
        error_mm: errors.filter_map(error).fold(0.0, f64::max) * 1e3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Tick;
    use hapfic_messages::{Mode, Process, Source};

    /// A run of 500 ticks of which nobody answers two and the drive brakes for 20 more; the torque then comes in by 2 N m a tick.
    fn braked(at: usize) -> Trace {
        let command = |tick: usize| {
            let (mode, source, torque, ramped) = match tick {
                t if t < at || t >= at + 27 => (Mode::Active, Source::Fresh, 10.0, 0),
                t if t == at => (Mode::Active, Source::Repeated, 10.0, 0),
                t if t == at + 1 => (Mode::Brake, Source::None, 0.0, 0),
                t if t < at + 22 => (Mode::Brake, Source::Suppressed, 0.0, 0),
                t => (Mode::Active, Source::Fresh, 2.0 * (t - at - 21) as f64, u32::from(t < at + 26)),
            };
            let (mode, source, controller) = (Some(mode), Some(source), Some(Process::Controller));
            Command { mode, source, controller, torque: vec![torque], raw: vec![10.0], ramped }
        };
        let tick = |tick: usize| Tick {
            command: Some(command(tick)),
            foot: Some([0.0, 0.0, if tick == at + 5 { 0.012 } else { 0.0 }]),
            wanted: Some([0.0; 3]),
            gated_ns: Some(tick as u64 * 1_000_000 + if tick >= at + 3 { 500_000 } else { 0 }),
            ..Tick::default()
        };
        Trace { ticks: (0..500).map(tick).collect(), ..Trace::default() }
    }

    #[test]
    fn a_brake_is_measured() {
        let moment = measure(&braked(250), 250, 500);
        assert_eq!((moment.missed, moment.own), (22.0, 22.0));
        assert_eq!((moment.to_brake_ms, moment.braked_at_missed), (Some(1.0), Some(2)));
        assert_eq!((moment.back_ms, moment.recovered_ms), (Some(2.0), Some(22.0)));
        assert_eq!((moment.step, moment.ramp_step), (2.0, Some(2.0)));
        assert!((moment.error_mm - 12.0).abs() < 1e-9 && (moment.wait_ms.unwrap() - 1.5).abs() < 1e-9);
        assert!(!moment.promoted);
    }

    #[test]
    fn where_nothing_is_amiss_there_is_nothing() {
        let moment = measure(&braked(499), 250, 300);
        assert_eq!((moment.missed, moment.to_brake_ms, moment.back_ms, moment.recovered_ms), (0.0, None, None, None));
        assert_eq!((moment.step, moment.ramp_step, moment.error_mm), (0.0, None, 0.0));
    }
}
