//! `hapfic-substep`: the plant's side of the comparison with MuJoCo (`bench/mujoco/compare.py`). Prints JSON.
//!
//! One second in each of three scenes, in which the foot lands, presses and slides: what a sub-step costs, and how far the run is from
//! its own converged reference.

mod accuracy;
mod model;
mod plan;
mod run;

use anyhow::Result;
use clap::{Parser, Subcommand, ValueEnum};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::io::Write;

/// Cost and error of the plant's sub-step, as JSON.
#[derive(Debug, Parser)]
struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Cost and error in every scene.
    All {
        /// How often each scene is timed, the scenes in turn.
        #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
        repetitions: u32,
    },
    /// Model, contact laws and drive of a scene, for another simulator to do the same.
    Model {
        /// The scene.
        scene: Scene,
    },
    /// Cost of a sub-step in a scene: one run, after a short one that is not counted.
    Time {
        /// The scene.
        scene: Scene,
    },
    /// Error of a scene against its own converged reference.
    Error {
        /// The scene.
        scene: Scene,
    },
}

/// What the foot presses on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Scene {
    /// A rigid floor without friction.
    Floor,
    /// A rigid box that stands on a floor with friction.
    Box,
    /// A soft ball on a floor with friction.
    Ball,
}

impl Scene {
    /// Its scenario.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Floor => "floor",
            Self::Box => "box",
            Self::Ball => "ball",
        }
    }
}

fn main() -> Result<()> {
    let answer = match Arguments::parse().what {
        What::All { repetitions } => all(repetitions)?,
        What::Model { scene } => serde_json::to_value(model::describe(scene)?)?,
        What::Time { scene } => json!({ "scene": scene, "ns_per_substep": run::time(scene)? }),
        What::Error { scene } => serde_json::to_value(accuracy::measure(scene)?)?,
    };
    writeln!(std::io::stdout(), "{answer}")?;
    Ok(())
}

fn all(repetitions: u32) -> Result<Value> {
    let mut times = vec![Vec::new(); Scene::value_variants().len()];
    for _ in 0..repetitions {
        for (scene, times) in Scene::value_variants().iter().zip(&mut times) {
            times.push(run::time(*scene)?.median);
        }
    }
    let mut answer = Map::new();
    for (scene, times) in Scene::value_variants().iter().zip(&mut times) {
        let median = run::median(times);
        let cost = json!({
            "median": median,
            "least": times.first(),
            "most": times.last(),
            "repetitions": repetitions,
        });
        answer.insert(scene.name().to_owned(), json!({ "ns_per_substep": cost, "error": accuracy::measure(*scene)? }));
    }
    Ok(Value::Object(answer))
}
