//! Parser for a change of a running stack: `key=value` pairs with the keys and the checks of an operator's entry.

use crate::check;
use crate::error::{ConfigError, Location};
use crate::hint;
use crate::overrides::{override_error, parse};
use crate::parameters::{OperatorChange, ParameterSettings};
use crate::ranges;
use crate::raw::RawOperator;
use crate::read;
use crate::tree::{Node, Value};
use crate::{alias, tree};
use serde::Deserialize;
use std::collections::BTreeMap;

const AXES: [&str; 3] = ["x", "y", "z"];
/// Path of the only entry in the tree that is checked.
const ENTRY: &str = "operator[0]";

/// A change as requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestedChange {
    /// The change; its tick is not set.
    pub change: OperatorChange,
    /// Whether the pairs name single axes, so that the other axes come from the base set.
    pub relative: bool,
}

/// A value before and after a change, as a scenario writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParameterDifference {
    /// Key in an operator's entry.
    pub key: String,
    /// Value before the change.
    pub before: String,
    /// Value after the change.
    pub after: String,
}

/// A scenario that holds only the operator's list.
#[derive(Deserialize)]
struct RawChange {
    operator: Vec<RawOperator>,
}

impl OperatorChange {
    /// Reads pairs such as `desired_force=[0, 0, 80]`, `taper=0.1` or, for a single axis, `desired_force.z=80`.
    ///
    /// Axes that the pairs do not name keep the values of `base`.
    ///
    /// # Errors
    /// The first error, with its pair.
    pub fn from_pairs(pairs: &[&str], base: &ParameterSettings) -> Result<RequestedChange, ConfigError> {
        let place = Location::Change(pairs.join(" ").into());
        let known = table(base)?;
        let mut entry = EntryBuilder { known: &known, keys: BTreeMap::new(), axes: Vec::new() };
        pairs.iter().try_for_each(|pair| entry.add(pair))?;
        if entry.keys.is_empty() {
            let help = "name what to change, for example desired_force.z=80";
            return Err(override_error(&place, "", "no change", "at least one KEY=VALUE", help));
        }
        let relative = !entry.axes.is_empty();
        entry.keys.insert("at_s".to_owned(), Node { place: place.clone(), value: Value::Float(0.0) });
        let change = read_one(&only_entry("operator", entry.keys, &place)).map_err(|error| plain_keys(error, ENTRY))?;
        if let (Some(key), None) = (change.and_then(|change| change.rotation_key()), base.rotation) {
            let help = "start the run with controller.task=pose";
            return Err(override_error(&place, key, "a key of the orientation in a position task", "a pose task", help));
        }
        match change {
            Some(change) => Ok(RequestedChange { change, relative }),
            None => Err(override_error(&place, "", "no change", "at least one KEY=VALUE", "name what to change")),
        }
    }
}

fn read_one(root: &Node) -> Result<Option<OperatorChange>, ConfigError> {
    ranges::check(root)?;
    let raw: RawChange = read::read(root)?;
    Ok(check::changes(&raw.operator, root)?.first().copied())
}

/// A scenario that holds one list with one entry.
pub(crate) fn only_entry(list: &str, keys: BTreeMap<String, Node>, place: &Location) -> Node {
    let node = |value| Node { place: place.clone(), value };
    let entries = node(Value::List(vec![node(Value::Table(keys))]));
    node(Value::Table(BTreeMap::from([(list.to_owned(), entries)])))
}

/// Removes the entry's path from the key: the user wrote the key alone.
pub(crate) fn plain_keys(mut error: ConfigError, entry: &str) -> ConfigError {
    let diagnostic = error.diagnostic_mut();
    if let Some(rest) = diagnostic.key.strip_prefix(entry) {
        diagnostic.key = rest.trim_start_matches('.').to_owned();
    }
    error
}

/// Builder of an operator's entry.
struct EntryBuilder<'a> {
    /// Set that supplies the axes which no pair names.
    known: &'a BTreeMap<String, Node>,
    keys: BTreeMap<String, Node>,
    /// Axes that the pairs name.
    axes: Vec<(String, usize)>,
}

impl EntryBuilder<'_> {
    fn add(&mut self, pair: &str) -> Result<(), ConfigError> {
        let place = Location::Change(pair.into());
        let Some((path, text)) = pair.split_once('=') else {
            return Err(override_error(&place, "", "no =", "KEY=VALUE", "write for example desired_force.z=80"));
        };
        let path = path.trim();
        if let Some(help) = hint::section_prefix(path) {
            let expected = "a key of an operator's entry, without its section";
            return Err(override_error(&place, path, "a key with its section", expected, &help));
        }
        let (key, axis) = match path.split_once('.') {
            Some((key, axis)) => (key.trim(), Some(axis.trim())),
            None => (path, None),
        };
        let name = alias::canonical("operator", key);
        if name == "at_s" {
            let help = "remove it; a change takes effect a few ticks after its request";
            return Err(override_error(&place, path, "a time", "a key that can change while the stack runs", help));
        }
        if name.is_empty() {
            return Err(override_error(&place, path, "an empty key", "KEY=VALUE", "write for example desired_force.z=80"));
        }
        let value = parse(text.trim(), path, &place)?;
        match axis {
            None if self.keys.contains_key(name) => Err(twice(&place, path)),
            None => {
                self.keys.insert(name.to_owned(), value);
                Ok(())
            }
            Some(axis) => self.add_axis(name, axis, path, value, &place),
        }
    }

    fn add_axis(&mut self, name: &str, axis: &str, path: &str, value: Node, place: &Location) -> Result<(), ConfigError> {
        let Some(Node { value: Value::List(known), .. }) = self.known.get(name) else {
            if self.known.contains_key(name) {
                let help = "set the key itself, without an axis";
                return Err(override_error(place, path, &format!("axis {axis:?}"), "no axis: the value is a single one", help));
            }
            if name == "target_position_m" || name == "target_position" {
                let help = "no target is set yet: set the whole vector, as target_position=[0, 0.05, 0.1]";
                return Err(override_error(place, path, &format!("axis {axis:?}"), "a key that has a value", help));
            }
            // The reader rejects the key and lists the known ones.
            self.keys.insert(name.to_owned(), value);
            return Ok(());
        };
        let Some(index) = AXES.iter().position(|a| *a == axis) else {
            let help = "axes are those of the world frame, z up";
            return Err(override_error(place, path, &format!("axis {axis:?}"), "one of x, y, z", help));
        };
        let named = (name.to_owned(), index);
        let partial = self.axes.iter().any(|(n, _)| n == name);
        if self.axes.contains(&named) || (self.keys.contains_key(name) && !partial) {
            return Err(twice(place, path));
        }
        let node =
            self.keys.entry(name.to_owned()).or_insert_with(|| Node { place: place.clone(), value: Value::List(known.clone()) });
        if let Value::List(items) = &mut node.value
            && let Some(item) = items.get_mut(index)
        {
            *item = value;
        }
        self.axes.push(named);
        Ok(())
    }
}

pub(crate) fn twice(place: &Location, path: &str) -> ConfigError {
    override_error(place, path, "a key that another pair gives too", "each value once", "remove one of the two")
}

/// Lists parameters of a set as `key = value` lines, which [`OperatorChange::from_pairs`] reads: all, or those of `keys`
/// in their order, in either spelling and with or without an axis.
///
/// # Errors
/// [`ConfigError::Override`] for a key that the set does not have.
pub fn parameter_lines(set: &ParameterSettings, keys: &[&str]) -> Result<Vec<String>, ConfigError> {
    let known = table(set)?;
    if keys.is_empty() {
        return Ok(known.iter().map(|(key, node)| format!("{key} = {}", node.describe())).collect());
    }
    keys.iter().map(|key| parameter_line(&known, key.trim())).collect()
}

fn parameter_line(known: &BTreeMap<String, Node>, path: &str) -> Result<String, ConfigError> {
    let place = Location::Query(path.into());
    if let Some(help) = hint::section_prefix(path) {
        return Err(override_error(&place, "", "a key with its section", "a key of an operator's entry", &help));
    }
    let (key, axis) = path.split_once('.').map_or((path, None), |(key, axis)| (key.trim(), Some(axis.trim())));
    let name = alias::canonical("operator", key);
    let Some(node) = known.get(name) else {
        let names: Vec<&str> = known.keys().map(String::as_str).collect();
        let expected = format!("one of {}", names.join(", "));
        return Err(override_error(&place, "", "an unknown key", &expected, &hint::unknown_key("get", key, &names)));
    };
    let value = match (axis, &node.value) {
        (None, _) => Some(node),
        (Some(axis), Value::List(items)) => AXES.iter().position(|a| *a == axis).and_then(|index| items.get(index)),
        (Some(_), _) => None,
    };
    match (value, axis) {
        (Some(value), None) => Ok(format!("{name} = {}", value.describe())),
        (Some(value), Some(axis)) => Ok(format!("{name}.{axis} = {}", value.describe())),
        (None, axis) => {
            let found = format!("axis {:?}", axis.unwrap_or_default());
            Err(override_error(&place, "", &found, "one of x, y, z, after a vector", "axes are those of the world frame, z up"))
        }
    }
}

/// Lists every value that differs between two sets, by key.
///
/// # Errors
/// [`ConfigError::Override`] if TOML cannot hold a set; a checked set never causes it.
pub fn differences(before: &ParameterSettings, after: &ParameterSettings) -> Result<Vec<ParameterDifference>, ConfigError> {
    let (before, after) = (table(before)?, table(after)?);
    let text = |node: Option<&Node>| node.map_or_else(|| "none".to_owned(), Node::describe);
    Ok(after
        .iter()
        .map(|(key, node)| ParameterDifference { key: key.clone(), before: text(before.get(key)), after: text(Some(node)) })
        .filter(|d| d.before != d.after)
        .collect())
}

/// Values of a set by the keys of an operator's entry.
fn table(set: &ParameterSettings) -> Result<BTreeMap<String, Node>, ConfigError> {
    const ORIGIN: &str = "parameters in force";
    let text = toml::to_string(set).map_err(|error| {
        override_error(&Location::whole(ORIGIN), "", &error.to_string(), "parameters that TOML can hold", "report this")
    })?;
    match tree::Node::parse(&text, ORIGIN)?.value {
        Value::Table(table) => {
            Ok(table.into_iter().map(|(key, node)| (alias::canonical("operator", &key).to_owned(), node)).collect())
        }
        _ => Ok(BTreeMap::new()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{Search, Settings};

    fn base() -> ParameterSettings {
        let initial = Settings::load("floor", &[]).unwrap().initial;
        ParameterSettings { target_position: Some([0.1, 0.2, 0.3]), desired_force: [1.0, 2.0, 50.0], ..initial }
    }

    fn change(pairs: &[&str]) -> RequestedChange {
        OperatorChange::from_pairs(pairs, &base()).unwrap()
    }

    fn message(pairs: &[&str]) -> String {
        OperatorChange::from_pairs(pairs, &base()).unwrap_err().to_string()
    }

    #[test]
    fn pairs_both_spellings_make_change() {
        let requested = change(&["desired_force=[0, 0, 80]", "stiffness_n_per_m = [1, 2, 3]", "search=sign", "taper=0.1"]);
        let expected = OperatorChange {
            desired_force: Some([0.0, 0.0, 80.0]),
            stiffness: Some([1.0, 2.0, 3.0]),
            search: Some(Search::Sign),
            taper: Some(0.1),
            ..OperatorChange::default()
        };
        assert_eq!(requested, RequestedChange { change: expected, relative: false });
    }

    #[test]
    fn pair_single_axis_keeps_others() {
        let requested = change(&["desired_force.z=80", "desired_force.x=-1", "target_position_m.y=0.5"]);
        assert_eq!(requested.change.desired_force, Some([-1.0, 2.0, 80.0]));
        assert_eq!(requested.change.target_position, Some([0.1, 0.5, 0.3]));
        assert!(requested.relative);
    }

    #[test]
    fn pairs_all_parameters_set_every_value() {
        // Detects a parameter that the set has and the entry lacks, or has under another name.
        let all = table(&base()).unwrap();
        let pairs: Vec<String> = all.iter().map(|(key, node)| format!("{key}={}", node.describe())).collect();
        let pairs: Vec<&str> = pairs.iter().map(String::as_str).collect();
        let requested = change(&pairs);
        assert_eq!(ParameterSettings { target_position: None, ..base() }.with(&requested.change), base());
    }

    #[test]
    fn pairs_invalid_rejected_with_pair() {
        for (pairs, words) in [
            (vec![], vec!["no change", "KEY=VALUE"]),
            (vec!["taper"], vec!["set taper", "no =", "KEY=VALUE"]),
            (vec!["=3"], vec!["empty key"]),
            (vec!["taper="], vec!["taper", "nothing after ="]),
            (vec!["taper=2"], vec!["set taper=2: taper:", "(0, 1]"]),
            (vec!["taper=nan"], vec!["taper", "finite"]),
            (vec!["tapr=0.1"], vec!["tapr", "did you mean taper"]),
            (vec!["desird_force.z=80"], vec!["desird_force", "did you mean desired_force"]),
            (vec!["controller.taper=0.1"], vec!["set controller.taper=0.1", "leave controller. out: write taper"]),
            (vec!["planner.mean_speed=0.1"], vec!["leave planner. out: write mean_speed"]),
            (vec!["force=[0, 0, 80]"], vec!["force", "did you mean desired_force?"]),
            (vec!["force.z=80"], vec!["force", "did you mean desired_force?"]),
            (vec!["desired_force.w=80"], vec!["\"w\"", "x, y, z"]),
            (vec!["taper.z=0.1"], vec!["taper.z", "single"]),
            (vec!["stiffness.z=-1"], vec!["stiffness_n_per_m[2]", "(0, 1000000]"]),
            (vec!["desired_force=[0, 80]"], vec!["desired_force_n", "3 numbers"]),
            (vec!["desired_force=[9e3, 9e3, 0]"], vec!["desired_force_n", "no longer than 10000"]),
            (vec!["search=sgn"], vec!["search", "sign"]),
            (vec!["at_s=3", "taper=0.1"], vec!["at_s", "a time"]),
            (vec!["taper=0.1", "taper=0.2"], vec!["taper", "each value once"]),
            (vec!["stiffness=[1, 2, 3]", "stiffness_n_per_m.z=4"], vec!["each value once"]),
            (vec!["stiffness.z=4", "stiffness.z=5"], vec!["each value once"]),
            (vec!["target_orientation=[0, 0, 1]"], vec!["target_orientation", "in a position task", "controller.task=pose"]),
            (vec!["gravity_compensation=maybe"], vec!["gravity_compensation", "maybe"]),
        ] {
            let text = message(&pairs);
            for word in words {
                assert!(text.contains(word), "{pairs:?}: '{word}' is not in: {text}");
            }
            assert!(!text.contains(ENTRY), "{text}");
        }
    }

    #[test]
    fn parameter_lines_are_pairs_of_same_set() {
        let lines = parameter_lines(&base(), &[]).unwrap();
        let pairs: Vec<&str> = lines.iter().map(String::as_str).collect();
        assert_eq!(ParameterSettings { target_position: None, ..base() }.with(&change(&pairs).change), base());
        let some = parameter_lines(&base(), &["desired_force.z", "taper", "stiffness_n_per_m"]).unwrap();
        assert_eq!(some, ["desired_force_n.z = 50", "taper = 0.4", "stiffness_n_per_m = [6000, 6000, 12000]"]);
        assert_eq!(change(&[&some[0]]).change.desired_force, Some(base().desired_force));
        for (key, words) in [
            ("tapr", "get tapr: found an unknown key, expected one of"),
            ("tapr", "did you mean taper?"),
            ("taper.z", "found axis \"z\""),
            ("desired_force.w", "one of x, y, z"),
            ("controller.taper", "leave controller. out: write taper"),
        ] {
            let error = parameter_lines(&base(), &[key]).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn differences_name_only_changed_values() {
        let after = base().with(&change(&["desired_force.z=80", "taper=0.4"]).change);
        let expected = ParameterDifference {
            key: "desired_force_n".to_owned(),
            before: "[1, 2, 50]".to_owned(),
            after: "[1, 2, 80]".to_owned(),
        };
        assert_eq!(differences(&base(), &after).unwrap(), [expected]);
    }
}
