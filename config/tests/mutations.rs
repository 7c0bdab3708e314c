//! Mutated scenarios: rejected or loaded, without a panic.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::ROBOT;
use hapfic_config::{Settings, scenarios};
use proptest::prelude::*;

const FAULTS: &str = r#"[[fault]]
kind = "slow"
process = ["planner", "controllers"]
for_ms = 20
by_us = 900
[fault.random]
count = 9
from_s = 0.5
to_s = 9
[[fault]]
kind = "full_disk"
at_s = 3
"#;

#[derive(Clone, Debug)]
enum Edit {
    Delete(usize, usize),
    Insert(usize, Vec<u8>),
    Replace(usize, u8),
    Copy(usize, usize, usize),
}

fn edit() -> impl Strategy<Value = Edit> {
    let bytes = prop_oneof![
        proptest::collection::vec(any::<u8>(), 1..4),
        proptest::sample::select(vec![
            "nan",
            "-1",
            "[",
            "]",
            "[[",
            "{",
            "}",
            "\"",
            "\n",
            "=",
            ".",
            "1e999",
            "0x",
            "99999999999999999999999999999999999999999999999999"
        ])
        .prop_map(|text: &str| text.as_bytes().to_vec()),
    ];
    prop_oneof![
        (any::<usize>(), 1_usize..40).prop_map(|(at, count)| Edit::Delete(at, count)),
        (any::<usize>(), bytes).prop_map(|(at, bytes)| Edit::Insert(at, bytes)),
        (any::<usize>(), any::<u8>()).prop_map(|(at, byte)| Edit::Replace(at, byte)),
        (any::<usize>(), any::<usize>(), 1_usize..80).prop_map(|(from, to, count)| Edit::Copy(from, to, count)),
    ]
}

fn apply(text: &str, edits: Vec<Edit>) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for edit in edits {
        let length = bytes.len();
        let place = |at: usize| at % (length + 1);
        match edit {
            Edit::Delete(at, count) => drop(bytes.drain(place(at)..(place(at) + count).min(length))),
            Edit::Insert(at, new) => drop(bytes.splice(place(at)..place(at), new)),
            Edit::Replace(at, byte) => {
                if let Some(old) = bytes.get_mut(place(at)) {
                    *old = byte;
                }
            }
            Edit::Copy(from, to, count) => {
                let piece = bytes[place(from)..(place(from) + count).min(length)].to_vec();
                drop(bytes.splice(place(to)..place(to), piece));
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Asserts that a rejection names its place, and that accepted settings load again to the same.
fn validate(result: Result<Settings, hapfic_config::ConfigError>) {
    match result {
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with("floor.toml") || message.starts_with("--set "), "{message}");
            assert!(message.contains(": found ") && message.contains(". Hint: "), "{message}");
        }
        Ok(settings) => {
            let urdf = &settings.robot.urdf;
            let again = Settings::from_effective(&settings.effective_toml(), &urdf.name, &urdf.text);
            assert_eq!(again.as_ref(), Ok(&settings));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn text_mutated_rejected_or_reloads_equal(edits in proptest::collection::vec(edit(), 1..6)) {
        validate(Settings::from_str(&apply(scenarios()[0].text, edits), "floor.toml", None, &[]));
    }

    #[test]
    fn faults_mutated_rejected_or_reload_equal(edits in proptest::collection::vec(edit(), 1..6)) {
        validate(Settings::from_str(&apply(&format!("{ROBOT}{FAULTS}"), edits), "floor.toml", None, &[]));
    }

    #[test]
    fn override_random_rejected_or_reloads_equal(
        key in "(controller|operator|fault|robot|seed|world|[a-z]{0,3})(\\.[a-z_0-9]{0,12}){0,3}",
        value in "\\PC{0,20}",
    ) {
        validate(Settings::from_str(scenarios()[0].text, "floor.toml", None, &[format!("{key}={value}")]));
    }
}
