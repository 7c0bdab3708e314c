//! Tree of a scenario in which every value knows its place.

use crate::error::{ConfigError, Diagnostic, Location};
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value and its place.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) place: Location,
    pub(crate) value: Value,
}

/// A TOML value.
#[derive(Clone, Debug)]
pub(crate) enum Value {
    Text(String),
    Integer(i128),
    Float(f64),
    Boolean(bool),
    Date(String),
    List(Vec<Node>),
    Table(BTreeMap<String, Node>),
}

impl Node {
    /// Reads a document. `origin` names it in error messages.
    pub(crate) fn parse(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let lines = LineIndex::new(text, origin);
        match DeTable::parse(text) {
            Ok(table) => {
                Ok(Self { place: Location::whole(origin), value: table_value(table.into_inner(), &|at| lines.place(at)) })
            }
            Err(error) => Err(ConfigError::NotToml(Box::new(Diagnostic {
                place: error.span().map_or_else(|| Location::whole(origin), |span| lines.place(span.start)),
                key: String::new(),
                found: format!("text that is not TOML ({})", error.message().replace('\n', ", ")),
                expected: "`key = value`, `[table]`, `[[table]]` or `# comment`".to_owned(),
                help: "a table holds each key once; words are quoted: search = \"sign\"".to_owned(),
            }))),
        }
    }

    /// Reads a single value, all of it at one place. Returns `None` if the text is not a TOML value.
    pub(crate) fn parse_value(text: &str, place: &Location) -> Option<Self> {
        let value = DeValue::parse(text).ok()?;
        // The parser returns an empty span for a missing value.
        if value.span().is_empty() {
            return None;
        }
        Some(convert(value, &|_| place.clone()))
    }

    /// Returns the value at a path such as `operator[2].at_s`.
    pub(crate) fn get(&self, path: &str) -> Option<&Self> {
        steps(path).try_fold(self, Self::child)
    }

    /// Returns the place of the value at a path, or of the nearest table around it if the value is not given.
    pub(crate) fn place(&self, path: &str) -> Location {
        let mut node = self;
        for step in steps(path) {
            match node.child(step) {
                Some(child) => node = child,
                None => break,
            }
        }
        node.place.clone()
    }

    fn child(&self, step: &str) -> Option<&Self> {
        match &self.value {
            Value::Table(table) => table.get(step),
            Value::List(items) => items.get(step.parse::<usize>().ok()?),
            _ => None,
        }
    }

    /// Describes the value for a message: a short value itself, a long one by its kind.
    pub(crate) fn describe(&self) -> String {
        const LONGEST_TEXT: usize = 60;
        const LONGEST_LIST: usize = 8;
        match &self.value {
            Value::Text(text) if text.chars().count() > LONGEST_TEXT => {
                format!("{:?}...", text.chars().take(LONGEST_TEXT).collect::<String>())
            }
            Value::Text(text) => format!("{text:?}"),
            Value::Integer(number) => number.to_string(),
            Value::Float(number) => describe_number(*number),
            Value::Boolean(flag) => flag.to_string(),
            Value::Date(date) => date.clone(),
            Value::List(items) if items.len() > LONGEST_LIST => format!("a list of {} values", items.len()),
            Value::List(items) => {
                let items: Vec<String> = items.iter().map(Self::describe).collect();
                format!("[{}]", items.join(", "))
            }
            Value::Table(_) => "a table".to_owned(),
        }
    }
}

/// Formats a number as TOML does, without trailing zeros.
pub(crate) fn describe_number(number: f64) -> String {
    if number.is_nan() {
        "nan".to_owned()
    } else if number == 0.0 || number.is_infinite() || (1e-5..1e16).contains(&number.abs()) {
        number.to_string()
    } else {
        format!("{number:e}")
    }
}

/// Appends a key to a path.
pub(crate) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

fn steps(path: &str) -> impl Iterator<Item = &str> {
    path.split(['.', '[']).map(|step| step.trim_end_matches(']'))
}

fn convert(value: Spanned<DeValue<'_>>, place: &dyn Fn(usize) -> Location) -> Node {
    let at = place(value.span().start);
    let value = match value.into_inner() {
        DeValue::String(text) => Value::Text(text.into_owned()),
        DeValue::Integer(number) => Value::Integer(integer(number.as_str(), number.radix())),
        DeValue::Float(number) => Value::Float(number.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(flag) => Value::Boolean(flag),
        DeValue::Datetime(date) => Value::Date(date.to_string()),
        DeValue::Array(items) => Value::List(items.into_iter().map(|item| convert(item, place)).collect()),
        DeValue::Table(table) => table_value(table, place),
    };
    Node { place: at, value }
}

fn table_value(table: DeTable<'_>, place: &dyn Fn(usize) -> Location) -> Value {
    Value::Table(table.into_iter().map(|(key, value)| (key.into_inner().into_owned(), convert(value, place))).collect())
}

/// Reads an integer; a number beyond 128 bits becomes the nearest that fits, which every range rejects too.
fn integer(digits: &str, radix: u32) -> i128 {
    let beyond = if digits.starts_with('-') { i128::MIN } else { i128::MAX };
    i128::from_str_radix(digits, radix).unwrap_or(beyond)
}

/// Index from bytes of a text to its lines.
struct LineIndex {
    name: Arc<str>,
    ends: Vec<usize>,
}

impl LineIndex {
    fn new(text: &str, origin: &str) -> Self {
        Self { name: origin.into(), ends: text.match_indices('\n').map(|(at, _)| at).collect() }
    }

    fn place(&self, at: usize) -> Location {
        let line = self.ends.partition_point(|end| *end < at) + 1;
        Location::File { name: Arc::clone(&self.name), line: Some(line) }
    }
}
