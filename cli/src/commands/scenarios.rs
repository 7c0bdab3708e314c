//! `hapfic scenarios`: the embedded scenarios.

use crate::{CommandOutcome, print};
use anyhow::Result;
use hapfic_config::scenarios as embedded;

/// Lists the embedded scenarios, or prints one.
pub fn scenarios(name: Option<&str>) -> Result<CommandOutcome> {
    match name {
        None => {
            for scenario in embedded() {
                print(&format!("{:<16} {}", scenario.name, scenario.title));
            }
            Ok(CommandOutcome::Done)
        }
        Some(name) => match embedded().iter().find(|s| s.name == name) {
            Some(scenario) => {
                print(scenario.text.trim_end());
                Ok(CommandOutcome::Done)
            }
            None => {
                let names: Vec<_> = embedded().iter().map(|s| s.name).collect();
                Ok(CommandOutcome::Rejected(anyhow::anyhow!("no scenario '{name}', expected one of: {}", names.join(", "))))
            }
        },
    }
}
