//! JSON Schema of a scenario file, for editors and for the documentation.

use crate::raw::RawScenario;
use crate::tree::join;
use crate::{alias, ranges};
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

/// Returns the JSON Schema (draft 2020-12) of a scenario file: descriptions, defaults, ranges, and the aliases of keys.
#[must_use]
pub fn json_schema() -> String {
    format!("{:#}", annotated())
}

fn annotated() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| settings.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<RawScenario>().to_value();
    annotate(&mut schema, "");
    schema
}

/// Adds ranges and aliases below a key.
fn annotate(schema: &mut Value, key: &str) {
    let Some(object) = schema.as_object_mut() else { return };
    if let Some(range) = ranges::of(key)
        && is_numeric(object)
    {
        bound(object, range);
    }
    if let Some(items) = object.get_mut("items") {
        annotate(items, key);
    }
    for choice in ["anyOf", "oneOf"] {
        if let Some(Value::Array(branches)) = object.get_mut(choice) {
            branches.iter_mut().for_each(|branch| annotate(branch, key));
        }
    }
    if let Some(Value::Object(properties)) = object.get_mut("properties") {
        for (name, property) in properties.iter_mut() {
            annotate(property, &join(key, name));
        }
        for (alias_name, name) in alias::of(key) {
            if let Some(Value::Object(mut property)) = properties.get(*name).cloned() {
                property.insert("description".to_owned(), json!(format!("Alias of `{name}`.")));
                properties.insert((*alias_name).to_owned(), Value::Object(property));
            }
        }
    }
    allow_aliases(object, key);
}

/// Lets a required key have either of its names.
fn allow_aliases(object: &mut Map<String, Value>, key: &str) {
    let Some(Value::Array(required)) = object.get_mut("required") else { return };
    let mut choices = Vec::new();
    for (alias_name, name) in alias::of(key) {
        if let Some(at) = required.iter().position(|entry| entry.as_str() == Some(*name)) {
            required.remove(at);
            choices.push(json!({ "anyOf": [{ "required": [name] }, { "required": [alias_name] }] }));
        }
    }
    if !choices.is_empty() {
        object.insert("allOf".to_owned(), Value::Array(choices));
    }
}

fn is_numeric(object: &Map<String, Value>) -> bool {
    let numeric = |kind: &Value| matches!(kind.as_str(), Some("number" | "integer"));
    match object.get("type") {
        Some(Value::Array(kinds)) => kinds.iter().any(numeric),
        Some(kind) => numeric(kind),
        None => false,
    }
}

fn bound(object: &mut Map<String, Value>, range: ranges::Range) {
    let (lowest, low, high) = match range {
        ranges::Range::Number { low, open: true, high } => ("exclusiveMinimum", json!(low), json!(high)),
        ranges::Range::Number { low, open: false, high } => ("minimum", json!(low), json!(high)),
        ranges::Range::Whole { low, high } => ("minimum", json!(low), json!(high)),
    };
    object.remove("minimum");
    object.insert(lowest.to_owned(), low);
    object.insert("maximum".to_owned(), high);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;

    fn property<'a>(schema: &'a Value, key: &str) -> Option<&'a Value> {
        key.split('.').try_fold(schema, |schema, step| {
            let table = schema.get("items").unwrap_or(schema);
            table.get("properties")?.get(step)
        })
    }

    #[test]
    fn schema_range_table_bounds_known_keys() {
        let schema = annotated();
        for (key, _) in ranges::RANGES {
            let found = property(&schema, key).unwrap_or_else(|| panic!("{key} is no key of a scenario"));
            assert!(found.to_string().contains("\"maximum\""), "{key} is not bounded: {found}");
        }
    }

    #[test]
    fn schema_number_keys_have_range() {
        fn walk(schema: &Value, key: &str, checked: &mut usize) {
            let Some(object) = schema.as_object() else { return };
            if is_numeric(object) {
                assert!(object.contains_key("maximum"), "{key} takes a number without a range");
                *checked += 1;
            }
            for inner in object
                .get("items")
                .into_iter()
                .chain(["anyOf", "oneOf"].iter().filter_map(|choice| object.get(*choice)?.as_array()).flatten())
            {
                walk(inner, key, checked);
            }
            for (name, inner) in object.get("properties").and_then(Value::as_object).into_iter().flatten() {
                walk(inner, &join(key, name), checked);
            }
        }
        let mut checked = 0;
        walk(&annotated(), "", &mut checked);
        assert!(checked > ranges::RANGES.len(), "only {checked} numbers found in the schema");
    }
}
