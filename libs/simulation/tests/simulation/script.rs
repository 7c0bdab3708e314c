//! Random motion of the leg: a scenario's world under targets that nobody would give.

use crate::draw::Draw;
use hapfic_config::{OperatorChange, Settings};

/// Where the hip is in the scenarios, m.
const HIP: [f64; 3] = [0.0, 0.0, 0.5];
/// Farthest from the hip, m: a little short of the stretched leg.
const FARTHEST_M: f64 = 0.56;
/// Nearest to it, m.
const NEAREST_M: f64 = 0.12;
/// Lowest target, m: 80 mm below the foot's place on the floor.
const LOWEST_M: f64 = -0.06;

/// An embedded scenario with its objects in place and a random operator, for so many ticks.
///
/// Every third target is in or near the first object as the scenario places it; the others are anywhere within reach, below the
/// floor too. Straight lines between them lead through whatever is there.
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
