//! `hapfic-substep`: the plant's side of the comparison with MuJoCo (`bench/mujoco/compare.py`). Prints JSON.
//!
//! In each of three scenes the foot lands, presses and slides for one second. The results are the cost of a sub-step,
//! and the error against the run's own converged reference.

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
    query: Query,
}

#[derive(Debug, Subcommand)]
enum Query {
    /// Cost and error in every scene.
    All {
        /// Repetitions of the timing; each repetition runs all scenes.
        #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
        repetitions: u32,
    },
    /// Model, contact laws and servo of a scene, for another simulator.
    Model {
        /// The scene.
        scene: BenchScene,
    },
    /// Cost of a sub-step in a scene, of one run after a warm-up run.
    Time {
        /// The scene.
        scene: BenchScene,
    },
    /// Error of a scene against its own converged reference.
    Error {
        /// The scene.
        scene: BenchScene,
    },
}

/// Scene of the comparison, named after the body below the foot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum BenchScene {
    /// A rigid floor without friction.
    Floor,
    /// A rigid box on a floor with friction.
    Box,
    /// A soft ball on a floor with friction.
    Ball,
}

impl BenchScene {
    /// Returns the name of the scenario.
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
    let result = match Arguments::parse().query {
        Query::All { repetitions } => all(repetitions)?,
        Query::Model { scene } => serde_json::to_value(model::describe(scene)?)?,
        Query::Time { scene } => json!({ "scene": scene, "ns_per_substep": run::time(scene)? }),
        Query::Error { scene } => serde_json::to_value(accuracy::measure(scene)?)?,
    };
    writeln!(std::io::stdout(), "{result}")?;
    Ok(())
}

fn all(repetitions: u32) -> Result<Value> {
    let mut times = vec![Vec::new(); BenchScene::value_variants().len()];
    for _ in 0..repetitions {
        for (scene, times) in BenchScene::value_variants().iter().zip(&mut times) {
            times.push(run::time(*scene)?.median);
        }
    }
    let mut results = Map::new();
    for (scene, times) in BenchScene::value_variants().iter().zip(&mut times) {
        let median = run::median(times);
        let cost = json!({
            "median": median,
            "least": times.first(),
            "most": times.last(),
            "repetitions": repetitions,
        });
        results.insert(scene.name().to_owned(), json!({ "ns_per_substep": cost, "error": accuracy::measure(*scene)? }));
    }
    Ok(Value::Object(results))
}
