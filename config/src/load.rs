//! Loading of [`Settings`] from a file, a name or a text.

use crate::alias;
use crate::check;
use crate::embedded;
use crate::error::{ConfigError, Diagnostic, Location, nearest};
use crate::overrides;
use crate::ranges;
use crate::raw::RawScenario;
use crate::read;
use crate::settings::{Settings, Urdf};
use crate::tree::Node;
use std::path::{Path, PathBuf};

impl Settings {
    /// Loads an embedded scenario by name (`floor`), or a file by path (with a `/`, ending in `.toml`, or existing).
    ///
    /// Each override is `key.path=value`; a number in the path is the index into a list, from 0.
    ///
    /// # Errors
    /// The first error, with its place.
    pub fn load(what: &str, overrides: &[String]) -> Result<Self, ConfigError> {
        if let Some(scenario) = embedded::scenarios().iter().find(|scenario| scenario.name == what) {
            return Self::from_str(scenario.text, &format!("{what}.toml"), None, overrides);
        }
        let path = Path::new(what);
        if !what.contains('/') && !what.ends_with(".toml") && !path.exists() {
            return Err(unknown_scenario(what));
        }
        let text = std::fs::read_to_string(path).map_err(|error| {
            ConfigError::Read(Box::new(Diagnostic {
                place: Location::whole(what),
                key: String::new(),
                found: format!("a file that cannot be read ({error})"),
                expected: "a scenario, UTF-8 text in TOML".to_owned(),
                help: format!("check the path, or use an embedded scenario: {}", scenario_names().join(", ")),
            }))
        })?;
        Self::from_str(&text, what, path.parent(), overrides)
    }

    /// Reads a scenario from text. `origin` names it in error messages.
    ///
    /// The search for the robot description covers `base_dir` and the embedded ones (these first without a `base_dir`).
    ///
    /// # Errors
    /// The first error, with its place.
    pub fn from_str(text: &str, origin: &str, base_dir: Option<&Path>, overrides: &[String]) -> Result<Self, ConfigError> {
        let (raw, tree) = read_scenario(text, origin, overrides)?;
        let urdf = load_urdf(&raw.robot.urdf, base_dir, &tree)?;
        check::settings(raw, &tree, urdf)
    }

    /// Reads the output of [`Settings::effective_toml`], together with its robot description.
    ///
    /// # Errors
    /// The first error, with its place.
    pub fn from_effective(toml: &str, urdf_name: &str, urdf_text: &str) -> Result<Self, ConfigError> {
        let (raw, tree) = read_scenario(toml, "effective configuration", &[])?;
        check::settings(raw, &tree, Urdf { name: urdf_name.to_owned(), text: urdf_text.to_owned() })
    }

    /// Returns the scenario as loaded, with overrides applied and defaults written out.
    ///
    /// Together with [`Urdf`] it loads to equal settings.
    #[must_use]
    pub fn effective_toml(&self) -> String {
        self.effective.clone()
    }
}

fn read_scenario(text: &str, origin: &str, overrides: &[String]) -> Result<(RawScenario, Node), ConfigError> {
    let mut tree = Node::parse(text, origin)?;
    alias::canonicalise(&mut tree)?;
    overrides::apply(&mut tree, overrides)?;
    ranges::check(&tree)?;
    let raw = read::read(&tree)?;
    Ok((raw, tree))
}

fn load_urdf(written: &str, base_dir: Option<&Path>, tree: &Node) -> Result<Urdf, ConfigError> {
    const KEY: &str = "robot.urdf";
    let path = base_dir.map_or_else(|| PathBuf::from(written), |dir| dir.join(written));
    let known = embedded::robots().iter().find(|(name, _)| *name == written);
    if let Some((name, text)) = known
        && (base_dir.is_none() || !path.is_file())
    {
        return Ok(Urdf { name: (*name).to_owned(), text: (*text).to_owned() });
    }
    let name = path.display().to_string();
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Urdf { name, text }),
        Err(error) => {
            let names: Vec<&str> = embedded::robots().iter().map(|(name, _)| *name).collect();
            Err(ConfigError::Read(Box::new(Diagnostic {
                place: tree.place(KEY),
                key: KEY.to_owned(),
                found: format!("{name:?}, which cannot be read ({error})"),
                expected: format!("a URDF file, or an embedded one: {}", names.join(", ")),
                help: "the path is relative to the scenario's file".to_owned(),
            })))
        }
    }
}

fn scenario_names() -> Vec<&'static str> {
    embedded::scenarios().iter().map(|scenario| scenario.name).collect()
}

fn unknown_scenario(what: &str) -> ConfigError {
    let names = scenario_names();
    let help = match nearest(what, &names) {
        Some(near) => format!("did you mean {near}?"),
        None => "give the path of a file with a / or the ending .toml".to_owned(),
    };
    ConfigError::UnknownScenario(Box::new(Diagnostic {
        place: Location::whole(what),
        key: String::new(),
        found: "no scenario of this name".to_owned(),
        expected: format!("one of {}, or a file", names.join(", ")),
        help,
    }))
}
