//! Overrides `--set key.path=value`, which replace values of the scenario before the checks.

use crate::alias;
use crate::error::{ConfigError, Diagnostic, Location};
use crate::raw::RawScenario;
use crate::tree::{Node, Value, join};
use std::collections::BTreeMap;

/// Applies overrides in order.
pub(crate) fn apply(root: &mut Node, arguments: &[String]) -> Result<(), ConfigError> {
    if arguments.is_empty() {
        return Ok(());
    }
    let defaults = defaults()?;
    arguments.iter().try_for_each(|argument| apply_one(root, &defaults, argument))
}

fn apply_one(root: &mut Node, defaults: &Node, argument: &str) -> Result<(), ConfigError> {
    let place = Location::Override(argument.into());
    let Some((path, text)) = argument.split_once('=') else {
        return Err(override_error(&place, "", "no =", "KEY=VALUE", "write for example --set controller.taper=0.1"));
    };
    let path = path.trim();
    let mut keys: Vec<&str> = path.split('.').map(str::trim).collect();
    if keys.iter().any(|key| key.is_empty()) {
        return Err(override_error(&place, path, "an empty key", "keys joined by single points", "remove the extra point"));
    }
    // In the operator's list the entry's index stands between the section and its key.
    let section = keys[0];
    let own = if section == "operator" { 2 } else { 1 };
    if keys.len() > own {
        keys[own] = alias::canonical(section, keys[own]);
    }
    let value = parse(text.trim(), path, &place)?;
    Setter { place: &place, defaults }.set(root, &keys, String::new(), value)?;
    alias::canonicalise(root)
}

/// Parses a TOML value, or a word that needs no quotes.
pub(crate) fn parse(text: &str, path: &str, place: &Location) -> Result<Node, ConfigError> {
    // TOML reads nan as a number; here it is a kind of fault.
    if text == "nan" && path.rsplit('.').next() == Some("kind") {
        return Ok(Node { place: place.clone(), value: Value::Text(text.to_owned()) });
    }
    if let Some(node) = Node::parse_value(text, place) {
        return Ok(node);
    }
    let bare = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | '/');
    let starts_like_a_word = text.starts_with(|c: char| c.is_alphabetic() || matches!(c, '_' | '.' | '/'));
    if starts_like_a_word && text.chars().all(bare) {
        return Ok(Node { place: place.clone(), value: Value::Text(text.to_owned()) });
    }
    let found = if text.is_empty() { "nothing after =".to_owned() } else { format!("{text:?}, which is not TOML") };
    let help = "numbers are plain, lists are [1, 2, 3], text with blanks is quoted for TOML and for the shell";
    Err(override_error(place, path, &found, "a TOML value or a single word", help))
}

struct Setter<'a> {
    place: &'a Location,
    defaults: &'a Node,
}

impl Setter<'_> {
    fn set(&self, node: &mut Node, keys: &[&str], path: String, new: Node) -> Result<(), ConfigError> {
        let Some((key, rest)) = keys.split_first() else {
            *node = new;
            return Ok(());
        };
        let found = node.describe();
        match &mut node.value {
            Value::Table(table) => {
                let path = join(&path, key);
                let child = table.entry((*key).to_owned()).or_insert_with(|| self.default_at(&path));
                self.set(child, rest, path, new)
            }
            Value::List(items) => {
                let count = items.len();
                match key.parse::<usize>().ok().filter(|index| *index < count) {
                    Some(index) => self.set(&mut items[index], rest, format!("{path}[{index}]"), new),
                    None => {
                        let expected = if count == 0 {
                            "a list with values; this one is empty".to_owned()
                        } else {
                            format!("a number from 0 to {}", count - 1)
                        };
                        let help = "indices count from 0; to make the list longer, set the whole list";
                        Err(override_error(self.place, &path, &format!("{key:?} as an index into the list"), &expected, help))
                    }
                }
            }
            _ => {
                let help = format!("set {path} itself");
                Err(override_error(self.place, &path, &found, &format!("a table or a list, to set {key} in it"), &help))
            }
        }
    }

    /// Returns the value of a path that the scenario omits.
    ///
    /// A list starts from its default, so that an override can set single elements of it. A table starts empty; its
    /// keys get their defaults as in any scenario.
    fn default_at(&self, path: &str) -> Node {
        let value = match self.defaults.get(path).map(|node| &node.value) {
            Some(Value::List(items)) => Value::List(items.clone()),
            _ => Value::Table(BTreeMap::new()),
        };
        Node { place: self.place.clone(), value }
    }
}

/// A scenario that holds only defaults.
fn defaults() -> Result<Node, ConfigError> {
    let place = Location::whole("defaults");
    match toml::to_string(&RawScenario::default()) {
        Ok(text) => Node::parse(&text, "defaults"),
        Err(error) => Err(override_error(&place, "", &error.to_string(), "defaults that TOML can hold", "report this")),
    }
}

pub(crate) fn override_error(place: &Location, key: &str, found: &str, expected: &str, help: &str) -> ConfigError {
    ConfigError::Override(Box::new(Diagnostic {
        place: place.clone(),
        key: key.to_owned(),
        found: found.to_owned(),
        expected: expected.to_owned(),
        help: help.to_owned(),
    }))
}
