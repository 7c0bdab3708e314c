//! Makes the table of walls: force on walls of every stiffness and damping, in one-process lockstep.
//!
//! `walls [--csv FILE] [DOCUMENT...]` simulates every case with the default law, the law before it and the paper's.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, clippy::print_stdout)]

mod case;

mod outcome;

use case::{Case, LAWS};
use outcome::Outcome;
use std::sync::atomic::AtomicBool;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|a| a == "study") {
        let settings = hapfic_config::Settings::load(&arguments[1], &arguments[2..]).unwrap();
        let done = hapfic_simulation::study::study(&settings, &AtomicBool::new(false), None).unwrap();
        println!("{}", serde_json::to_string(&done.metrics).unwrap());
        return;
    }
    if arguments.first().is_some_and(|a| a == "scenario") {
        let settings = hapfic_config::Settings::load(&arguments[1], &arguments[2..]).unwrap();
        let mut sim = hapfic_simulation::Simulation::new(&settings).unwrap();
        let mut before = [0.0; 3];
        for t in 0..settings.duration_ticks {
            let s = *sim.step().unwrap();
            let r = &s.command.request;
            let step = (0..3).map(|i| (s.command.torque[i] - before[i]).abs()).fold(0.0, f64::max);
            before.copy_from_slice(&s.command.torque[..3]);
            let f3 = |v: [f64; 3]| format!("{:.4} {:.4} {:.4}", v[0], v[1], v[2]);
            println!(
                "{t} {step:.3} X {} V {} E {} F {} C {} S {} ph {:?} O {}",
                f3(s.state.foot_position),
                f3(s.state.foot_velocity),
                f3(r.error),
                f3(r.force),
                f3(s.state.foot_force),
                f3(s.reference.position),
                r.state.converging,
                f3(r.state.offset)
            );
        }
        return;
    }
    if arguments.first().is_some_and(|a| a == "trace") {
        let f = |i: usize| arguments[i].parse::<f64>().unwrap();
        let extra: Vec<String> = arguments[6..].to_vec();
        let leaked: &'static [&'static str] = Vec::leak(extra.into_iter().map(|s| &*String::leak(s)).collect());
        let case = Case {
            law: case::Law { name: "x", overrides: leaked },
            stiffness: f(1),
            ratio: if f(2) > 0.0 { Some(f(2)) } else { None },
            friction: f(3),
            force: f(4),
            condition: [
                case::Condition::Plain,
                case::Condition::Noise,
                case::Condition::Height(0.015),
                case::Condition::Height(-0.015),
                case::Condition::Actuators,
            ][f(5) as usize],
        };
        let mut sim = hapfic_simulation::Simulation::new(&case.settings()).unwrap();
        for t in 0..case::TICKS {
            let s = *sim.step().unwrap();
            let r = &s.command.request;
            let true_z: f64 = s.state.contacts[..s.state.contact_count as usize].iter().map(|c| c.force[2]).sum();
            println!(
                "{t} {:.3} {:.3} {:.3} {:.5} {:.4} {:.4} {:.5} {:.3} {:.4} {} {:.3} {:.3}",
                true_z,
                s.state.foot_force[0],
                s.state.foot_force[2],
                s.state.foot_position[2],
                s.state.foot_velocity[2],
                r.state.offset[2] * 1e3,
                r.error[2] * 1e3,
                r.force[2],
                r.state.taper[2],
                r.state.converging[2],
                r.force[0],
                s.state.foot_velocity[0]
            );
        }
        return;
    }
    let laws = arguments.first().map_or(3, |n| n.parse().unwrap_or(3));
    let extra: Vec<String> = arguments.iter().skip(1).cloned().collect();
    let leaked: &'static [&'static str] = Vec::leak(extra.into_iter().map(|s| &*String::leak(s)).collect());
    for mut law in LAWS.into_iter().take(laws) {
        if !leaked.is_empty() {
            law.overrides = leaked;
        }
        let cases = Case::all(law);
        let mut results: Vec<Outcome> = Vec::new();
        hapfic_simulation::pool::in_order(
            cases.len(),
            std::thread::available_parallelism().map_or(1, usize::from),
            &AtomicBool::new(false),
            |i| Some(outcome::outcome(&cases[i])),
            |_, r| {
                results.push(r.map_err(anyhow::Error::msg).unwrap_or_else(|e| {
                    eprintln!("{e}");
                    Outcome::default()
                }));
                Ok(())
            },
        )
        .unwrap();
        println!(
            "\n{}: wall | settled worst %, mean | settle median, max | overshoot | impact | peak | taper | noise settled/settle | +15 | -15 | 20Hz",
            law.name
        );
        let mut settle_all = Vec::new();
        let mut bad = Vec::new();
        for (chunk, out) in cases.chunks(16).zip(results.chunks(16)) {
            let c = &chunk[0];
            let plain: Vec<(&Case, &Outcome)> = chunk.iter().zip(out).take(12).filter(|(_, o)| o.within_reach).collect();
            let mut times: Vec<f64> = plain.iter().map(|(_, o)| o.settling_s).collect();
            times.sort_by(f64::total_cmp);
            if !c.beyond_the_loop() {
                settle_all.extend(&times);
            }
            let worst = plain.iter().map(|(_, o)| o.settled).fold(0.0, f64::max);
            let over = plain.iter().map(|(_, o)| o.overshoot).fold(0.0, f64::max);
            let impact = plain.iter().map(|(_, o)| o.impact).fold(0.0, f64::max);
            let peak = plain.iter().map(|(_, o)| o.peak).fold(0.0, f64::max);
            let taper = plain.iter().map(|(_, o)| o.taper).fold(f64::INFINITY, f64::min);
            let d: Vec<String> = out[12..]
                .iter()
                .map(|o| if o.within_reach { format!("{:.3}/{:.2}", o.settled * 100.0, o.settling_s) } else { "-".into() })
                .collect();
            println!(
                "{:.0e} {} | {:.3} ({}) | {:.2} {:.2} | {:.0}% | {:.0} | {:.0} | {:.3} | {}",
                c.stiffness,
                c.ratio.map_or("paper".into(), |r| r.to_string()),
                worst * 100.0,
                plain.len(),
                times.get(times.len() / 2).copied().unwrap_or(-1.0),
                times.last().copied().unwrap_or(-1.0),
                over * 100.0,
                impact,
                peak,
                taper,
                d.join(" | ")
            );
            if !c.beyond_the_loop() {
                for (c, o) in chunk.iter().zip(out).filter(|(_, o)| o.within_reach) {
                    let lim = if c.condition == case::Condition::Noise { 0.005 } else { 0.002 };
                    if o.settled > lim || o.settling_s > 0.4 {
                        bad.push(format!(
                            "  {:.0e} {:?} mu {} F {} {}: settled {:.3} % settle {:.3} over {:.0}% taper {:.3}",
                            c.stiffness,
                            c.ratio,
                            c.friction,
                            c.force,
                            c.condition.name(),
                            o.settled * 100.0,
                            o.settling_s,
                            o.overshoot * 100.0,
                            o.taper
                        ));
                    }
                }
            }
        }
        settle_all.sort_by(f64::total_cmp);
        println!(
            "settling median {:.3} max {:.3} of {}; bad {}",
            settle_all[settle_all.len() / 2],
            settle_all.last().unwrap(),
            settle_all.len(),
            bad.len()
        );
        for b in bad.iter().take(60) {
            println!("{b}");
        }
    }
}
