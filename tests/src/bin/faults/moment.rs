//! Consequences of one fault.

use crate::trace::{Trace, TraceCommand};
use hapfic_messages::EventKind;
use std::ops::Range;

/// Largest distance before and after a fault within which missed ticks count [ticks].
pub(crate) const MISSED_RANGE: usize = 200;
/// Largest distance after a fault within which torque steps count [ticks].
const STEP_RANGE: usize = 300;
/// Largest distance after a fault, up to the next one, within which the position error counts [ticks].
const ERROR_RANGE: usize = 1000;
/// Largest distance after a fault within which a wait for a command, or a promotion, counts [ticks].
const WAIT_RANGE: usize = 100;

/// Consequences of a fault; in an undisturbed run, the same figures without a fault.
#[derive(Clone, Debug)]
pub(crate) struct FaultEffect {
    /// Ticks around the fault without fresh torque.
    pub(crate) missed: f64,
    /// The same without outages that steal time explains.
    pub(crate) without_steal: f64,
    /// Whether the other controller became the primary.
    pub(crate) promoted: bool,
    /// Time from the fault to the first braking command [ms].
    pub(crate) to_brake_ms: Option<f64>,
    /// Consecutive missed ticks up to the brake, its first tick included.
    pub(crate) braked_at_missed: Option<usize>,
    /// Time from the first unanswered tick to the next answered one [ms].
    pub(crate) answered_again_ms: Option<f64>,
    /// Time from the first tick without fresh torque to the next one with it [ms].
    pub(crate) recovered_ms: Option<f64>,
    /// Longest time from one command to the next [ms].
    pub(crate) wait_ms: Option<f64>,
    /// Largest step of a joint's torque between active commands [N m].
    pub(crate) step: f64,
    /// Largest step of a joint's torque that ramps in after a brake [N m].
    pub(crate) ramp_step: Option<f64>,
    /// Largest |x - x_d| of any axis [mm].
    pub(crate) error_mm: f64,
}

/// Largest torque difference of any joint [N m].
fn step(before: &TraceCommand, after: &TraceCommand) -> f64 {
    before.torque.iter().zip(&after.torque).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Measures the consequences of a fault at tick `at`; the next fault is at tick `next`.
pub(crate) fn measure(trace: &Trace, at: usize, next: usize) -> FaultEffect {
    let end = trace.last().map_or(0, |last| last + 1);
    let until = |ticks: usize| at..(at + ticks).min(end);
    let around = at.saturating_sub(MISSED_RANGE)..(at + MISSED_RANGE + 1).min(end);
    let (mut missed, mut without_steal) = (0, 0);
    for outage in trace.outages() {
        let inside = outage.start.max(around.start)..outage.end.min(around.end);
        missed += inside.len();
        without_steal += if trace.is_steal_time(&outage) { 0 } else { inside.len() };
    }
    let find =
        |from: usize, which: &dyn Fn(&TraceCommand) -> bool| (from..end).find(|tick| trace.command(*tick).is_some_and(which));
    let close = |tick: &usize| *tick <= at + MISSED_RANGE;
    let brake = find(at, &TraceCommand::brakes).filter(close);
    let unanswered = find(at, &|command: &TraceCommand| !command.answered()).filter(close);
    let stale = find(at, &|command: &TraceCommand| !command.fresh()).filter(close);
    let ms = |from: Option<usize>, which: &dyn Fn(&TraceCommand) -> bool| {
        from.and_then(|from| Some((find(from, which)? - from) as f64))
    };
    let pairs = |ticks: Range<usize>| {
        ticks.filter_map(|tick| Some((trace.command(tick.checked_sub(1)?)?, trace.command(tick)?))).collect::<Vec<_>>()
    };
    let steps = pairs(until(STEP_RANGE));
    let active = steps.iter().filter(|(before, after)| before.active() && after.active());
    let ramping = steps.iter().filter(|(_, after)| after.ramped != 0).map(|(before, after)| step(before, after));
    let waits = until(WAIT_RANGE).filter_map(|tick| {
        let (before, after) = (trace.ticks.get(tick.checked_sub(1)?)?.command_ns?, trace.ticks[tick].command_ns?);
        Some(after.saturating_sub(before) as f64 * 1e-6)
    });
    let error = |tick: usize| {
        let (foot, reference) = (trace.ticks[tick].foot?, trace.ticks[tick].reference?);
        foot.iter().zip(&reference).map(|(x, xd)| (x - xd).abs()).reduce(f64::max)
    };
    let errors = at..(at + ERROR_RANGE).min(next).min(end);
    let promotions = at as i64 - 1..(at + WAIT_RANGE) as i64;
    FaultEffect {
        missed: missed as f64,
        without_steal: without_steal as f64,
        promoted: trace.events(EventKind::Promoted).any(|event| promotions.contains(&event.tick)),
        to_brake_ms: brake.map(|tick| (tick - at) as f64),
        braked_at_missed: brake.map(|tick| {
            let before = (0..tick).rev().take_while(|tick| trace.command(*tick).is_some_and(|c| !c.answered() && !c.brakes()));
            before.count() + 1
        }),
        answered_again_ms: ms(unanswered, &TraceCommand::answered),
        recovered_ms: ms(stale, &TraceCommand::fresh),
        wait_ms: waits.reduce(f64::max),
        step: active.map(|(before, after)| step(before, after)).fold(0.0, f64::max),
        ramp_step: ramping.reduce(f64::max),
        error_mm: errors.filter_map(error).fold(0.0, f64::max) * 1e3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::TraceTick;
    use hapfic_messages::{Mode, Process, Source};

    /// Run of 500 ticks: two unanswered ones, a brake for 20 more, then a torque that ramps in by 2 N m a tick.
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
            TraceCommand { mode, source, controller, torque: vec![torque], raw: vec![10.0], ramped }
        };
        let tick = |tick: usize| TraceTick {
            command: Some(command(tick)),
            foot: Some([0.0, 0.0, if tick == at + 5 { 0.012 } else { 0.0 }]),
            reference: Some([0.0; 3]),
            command_ns: Some(tick as u64 * 1_000_000 + if tick >= at + 3 { 500_000 } else { 0 }),
            ..TraceTick::default()
        };
        Trace { ticks: (0..500).map(tick).collect(), ..Trace::default() }
    }

    #[test]
    fn measure_brake_all_figures() {
        let effect = measure(&braked(250), 250, 500);
        assert_eq!((effect.missed, effect.without_steal), (22.0, 22.0));
        assert_eq!((effect.to_brake_ms, effect.braked_at_missed), (Some(1.0), Some(2)));
        assert_eq!((effect.answered_again_ms, effect.recovered_ms), (Some(2.0), Some(22.0)));
        assert_eq!((effect.step, effect.ramp_step), (2.0, Some(2.0)));
        assert!((effect.error_mm - 12.0).abs() < 1e-9 && (effect.wait_ms.unwrap() - 1.5).abs() < 1e-9);
        assert!(!effect.promoted);
    }

    #[test]
    fn measure_no_fault_no_figures() {
        let effect = measure(&braked(499), 250, 300);
        assert_eq!((effect.missed, effect.to_brake_ms, effect.answered_again_ms, effect.recovered_ms), (0.0, None, None, None));
        assert_eq!((effect.step, effect.ramp_step, effect.error_mm), (0.0, None, 0.0));
    }
}
