//! Target `config`: scenarios in TOML.

use super::SCENARIO_WORDS;
use crate::fuzz::target::{FuzzOutcome, FuzzTarget};
use hapfic_config::{Settings, scenarios};
use hapfic_messages::{Check, Command, Mode};
use hapfic_plant::Plant;
use std::path::Path;

pub(super) const TARGET: FuzzTarget =
    FuzzTarget { name: "config", seeds, dictionary: SCENARIO_WORDS, text: true, max_bytes: 32 * 1024, execute };

/// Name of the scenario in error messages.
const ORIGIN: &str = "fuzz.toml";
/// Simulated ticks of an accepted scenario: enough to use every number of it.
const TICKS: usize = 2;

fn seeds() -> Vec<Vec<u8>> {
    scenarios().iter().map(|scenario| scenario.text.as_bytes().to_vec()).collect()
}

fn execute(input: &[u8], _: &Path) -> FuzzOutcome {
    let text = String::from_utf8_lossy(input);
    match Settings::from_str(&text, ORIGIN, None, &[]) {
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with(ORIGIN), "found an error without its place: {message}");
            assert!(
                message.contains(": found ") && message.contains(". Hint: "),
                "found an error without found value or hint: {message}"
            );
            FuzzOutcome::Rejected(message)
        }
        Ok(settings) => {
            let urdf = &settings.robot.urdf;
            let again = Settings::from_effective(&settings.effective_toml(), &urdf.name, &urdf.text);
            assert_eq!(again.as_ref(), Ok(&settings), "the effective settings load to other settings");
            match simulated(&settings) {
                Ok(plant) => {
                    assert_eq!(plant.sample().check(), Ok(()), "the plant publishes an invalid state");
                    FuzzOutcome::Accepted
                }
                Err(message) => FuzzOutcome::Rejected(message),
            }
        }
    }
}

/// Plant of a scenario after its first ticks without a torque.
pub(super) fn simulated(settings: &Settings) -> Result<Plant, String> {
    let mut plant = Plant::new(settings).map_err(|error| error.to_string())?;
    plant.take(&Command { tick: -1, mode: Mode::Active.code(), ..Command::default() });
    for _ in 0..TICKS {
        plant.advance().map_err(|error| error.to_string())?;
    }
    Ok(plant)
}
