//! Random motion of the leg: the world of a scenario under random targets.

use crate::draw::Draw;
use hapfic_config::{OperatorChange, Settings};

/// Position of the hip in the scenarios [m].
const HIP: [f64; 3] = [0.0, 0.0, 0.5];
/// Largest distance from the hip [m]: a little less than the stretched leg.
const FARTHEST_M: f64 = 0.56;
/// Smallest distance from the hip [m].
const NEAREST_M: f64 = 0.12;
/// Lowest target [m]: 80 mm below the foot on the floor.
const LOWEST_M: f64 = -0.06;

/// An embedded scenario with its objects and a random operator, for `ticks` ticks.
///
/// A third of the targets are in or near the initial position of the first object. The others are anywhere within
/// reach, also below the floor. The straight lines between targets lead through objects and floor.
pub fn random(scenario: &str, seed: u64, ticks: u64) -> Settings {
    let mut settings = Settings::load(scenario, &[]).unwrap();
    let mut draw = Draw::new(seed);
    let object = settings.world.objects[0].position_m;
    settings.duration_ticks = ticks;
    settings.operator.clear();
    let mut at_tick = 200;
    while at_tick < ticks {
        settings.operator.push(OperatorChange {
            at_tick: at_tick as i64,
            target_position: Some(target(&mut draw, &object)),
            mean_speed: Some(draw.within(0.2, 0.8)),
            desired_force: Some(draw.on_each_axis(|draw| if draw.one_in(3) { draw.within(-60.0, 60.0) } else { 0.0 })),
            ..OperatorChange::default()
        });
        at_tick += draw.whole(300, 1200);
    }
    settings
}

fn target(draw: &mut Draw, object: &[f64; 3]) -> [f64; 3] {
    let near_the_object = draw.one_in(3);
    loop {
        let target = if near_the_object {
            object.map(|place| place + draw.within(-0.12, 0.12))
        } else {
            [draw.within(-0.5, 0.5), draw.within(-0.5, 0.5), draw.within(LOWEST_M, 0.5)]
        };
        let distance = (0..3).map(|axis| (target[axis] - HIP[axis]).powi(2)).sum::<f64>().sqrt();
        if (NEAREST_M..=FARTHEST_M).contains(&distance) && target[2] >= LOWEST_M {
            return target;
        }
    }
}
