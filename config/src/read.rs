//! serde deserializer of a [`Node`] tree; each error names path and place of its value.

use crate::error::{ConfigError, Diagnostic, Location, nearest};
use crate::hint;
use crate::tree::{Node, Value, join};
use serde::de::value::StrDeserializer;
use serde::de::{self, DeserializeOwned, DeserializeSeed, Expected, IntoDeserializer, Unexpected, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};
use std::collections::btree_map;
use std::fmt;
use std::slice;

/// Reads a whole scenario.
pub(crate) fn read<T: DeserializeOwned>(root: &Node) -> Result<T, ConfigError> {
    let result: Result<T, ReadError> = Deserialize::deserialize(NodeReader { node: root, path: String::new() });
    result.map_err(|error| error.into_config_error(root))
}

/// Error of serde, with its value.
#[derive(Debug)]
pub(crate) struct ReadError(Box<ReadErrorDetail>);

#[derive(Debug)]
struct ReadErrorDetail {
    problem: ReadProblem,
    value: Option<FoundValue>,
}

#[derive(Debug)]
struct FoundValue {
    path: String,
    place: Location,
    found: String,
}

#[derive(Debug)]
enum ReadProblem {
    Type { expected: String },
    Length { found: usize, expected: String },
    UnknownKey { key: String, known: &'static [&'static str] },
    UnknownWord { known: &'static [&'static str] },
    MissingKey { key: &'static str },
}

impl From<ReadProblem> for ReadError {
    fn from(problem: ReadProblem) -> Self {
        Self(Box::new(ReadErrorDetail { problem, value: None }))
    }
}

impl ReadError {
    /// Adds path and value; the innermost value counts.
    fn at(mut self, path: &str, node: &Node) -> Self {
        if self.0.value.is_none() {
            self.0.value = Some(FoundValue { path: path.to_owned(), place: node.place.clone(), found: node.describe() });
        }
        self
    }

    fn into_config_error(self, root: &Node) -> ConfigError {
        let ReadErrorDetail { problem, value } = *self.0;
        let FoundValue { path, place, found } =
            value.unwrap_or_else(|| FoundValue { path: String::new(), place: root.place.clone(), found: root.describe() });
        let diagnostic = |key: String, found: String, expected: String, help: String| {
            Box::new(Diagnostic { place, key, found, expected, help })
        };
        match problem {
            ReadProblem::Type { expected } => {
                let help = hint::form(&path, &found, &expected);
                ConfigError::WrongType(diagnostic(path, found, expected, help))
            }
            ReadProblem::Length { found, expected } => {
                let help = format!("{} values", if found == 0 { "add" } else { "add or remove" });
                ConfigError::WrongLength(diagnostic(path, format!("a list of {found}"), expected, help))
            }
            ReadProblem::UnknownKey { key, known } => {
                let help = hint::unknown_key(&path, &key, known);
                let expected = format!("one of {}", known.join(", "));
                ConfigError::UnknownKey(diagnostic(join(&path, &key), "an unknown key".to_owned(), expected, help))
            }
            ReadProblem::UnknownWord { known } => {
                let help = match nearest(found.trim_matches('"'), known) {
                    Some(near) => format!("did you mean \"{near}\"?"),
                    None => "use one of these words, in quotes".to_owned(),
                };
                let quoted: Vec<String> = known.iter().map(|word| format!("\"{word}\"")).collect();
                ConfigError::WrongType(diagnostic(path, found, format!("one of {}", quoted.join(", ")), help))
            }
            ReadProblem::MissingKey { key } => {
                let help = format!("add {key}; it has no default");
                let expected = "a value".to_owned();
                ConfigError::MissingKey(diagnostic(join(&path, key), "nothing".to_owned(), expected, help))
            }
        }
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.0)
    }
}

impl std::error::Error for ReadError {}

/// Translates serde's names of Rust types into words of TOML.
fn expectation(expected: &dyn Expected) -> String {
    let text = expected.to_string();
    match text.as_str() {
        "f64" => "a number".to_owned(),
        "i64" | "u16" | "u32" | "u64" | "usize" => "an integer".to_owned(),
        "a sequence" => "a list".to_owned(),
        _ => text,
    }
}

impl de::Error for ReadError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        ReadProblem::Type { expected: message.to_string() }.into()
    }

    fn invalid_type(_: Unexpected<'_>, expected: &dyn Expected) -> Self {
        ReadProblem::Type { expected: expectation(expected) }.into()
    }

    fn invalid_value(_: Unexpected<'_>, expected: &dyn Expected) -> Self {
        ReadProblem::Type { expected: expectation(expected) }.into()
    }

    fn invalid_length(found: usize, expected: &dyn Expected) -> Self {
        ReadProblem::Length { found, expected: expectation(expected) }.into()
    }

    fn unknown_variant(_: &str, known: &'static [&'static str]) -> Self {
        ReadProblem::UnknownWord { known }.into()
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        ReadProblem::UnknownKey { key: key.to_owned(), known }.into()
    }

    fn missing_field(key: &'static str) -> Self {
        ReadProblem::MissingKey { key }.into()
    }
}

struct NodeReader<'a> {
    node: &'a Node,
    path: String,
}

impl NodeReader<'_> {
    fn wrong(&self, expected: String) -> ReadError {
        ReadError::from(ReadProblem::Type { expected }).at(&self.path, self.node)
    }
}

impl<'de> de::Deserializer<'de> for NodeReader<'_> {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        let result: Result<V::Value, ReadError> = match &self.node.value {
            Value::Text(text) => visitor.visit_str(text),
            Value::Integer(number) => match (i64::try_from(*number), u64::try_from(*number)) {
                (Ok(number), _) => visitor.visit_i64(number),
                (_, Ok(number)) => visitor.visit_u64(number),
                _ => visitor.visit_i128(*number),
            },
            Value::Float(number) => visitor.visit_f64(*number),
            Value::Boolean(flag) => visitor.visit_bool(*flag),
            Value::Date(_) => Err(de::Error::invalid_type(Unexpected::Other("a date"), &visitor)),
            Value::List(items) => visitor.visit_seq(ListReader { path: &self.path, index: 0, rest: items.iter() }),
            Value::Table(table) => visitor.visit_map(TableReader { path: &self.path, rest: table.iter(), current: None }),
        };
        result.map_err(|error| error.at(&self.path, self.node))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_newtype_struct(self)
    }

    /// Rejects a list in place of a table, which serde would read key by key.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match self.node.value {
            Value::Table(_) => self.deserialize_any(visitor),
            _ => Err(self.wrong("a table".to_owned())),
        }
    }

    /// Reads a vector: a list of fixed length.
    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, ReadError> {
        let expected = format!("a list of {length} numbers");
        match &self.node.value {
            Value::List(items) if items.len() == length => self.deserialize_any(visitor),
            Value::List(items) => {
                Err(ReadError::from(ReadProblem::Length { found: items.len(), expected }).at(&self.path, self.node))
            }
            _ => Err(self.wrong(expected)),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        known: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match &self.node.value {
            Value::Text(word) => {
                let word: StrDeserializer<'_, ReadError> = word.as_str().into_deserializer();
                visitor.visit_enum(word).map_err(|error| error.at(&self.path, self.node))
            }
            _ => Err(ReadError::from(ReadProblem::UnknownWord { known }).at(&self.path, self.node)),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq
        tuple_struct map identifier ignored_any
    }
}

struct ListReader<'a> {
    path: &'a str,
    index: usize,
    rest: slice::Iter<'a, Node>,
}

impl<'de> de::SeqAccess<'de> for ListReader<'_> {
    type Error = ReadError;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, ReadError> {
        let Some(node) = self.rest.next() else { return Ok(None) };
        let path = format!("{}[{}]", self.path, self.index);
        self.index += 1;
        seed.deserialize(NodeReader { node, path }).map(Some)
    }
}

struct TableReader<'a> {
    path: &'a str,
    rest: btree_map::Iter<'a, String, Node>,
    current: Option<(&'a str, &'a Node)>,
}

impl<'de> de::MapAccess<'de> for TableReader<'_> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, ReadError> {
        let Some((name, node)) = self.rest.next() else { return Ok(None) };
        self.current = Some((name.as_str(), node));
        let name: StrDeserializer<'_, ReadError> = name.as_str().into_deserializer();
        // The error of an unknown key has the table's path and the key's line.
        seed.deserialize(name).map(Some).map_err(|error| error.at(self.path, node))
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        let Some((name, node)) = self.current.take() else {
            return Err(de::Error::custom("a key before its value"));
        };
        seed.deserialize(NodeReader { node, path: join(self.path, name) })
    }
}
