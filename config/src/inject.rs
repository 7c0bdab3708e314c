//! Parser for a fault of a running stack: `key=value` pairs with the keys and the checks of a scenario's fault.

use crate::change::{only_entry, plain_keys, twice};
use crate::check;
use crate::error::{ConfigError, Location};
use crate::fault::{Fault, FaultKind};
use crate::overrides::{override_error, parse};
use crate::ranges;
use crate::raw::{RawFault, RawTargets};
use crate::read;
use crate::tree::Node;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Path of the only entry in the tree that is checked.
const ENTRY: &str = "fault[0]";

/// A scenario that holds only the list of faults.
#[derive(Deserialize)]
struct RawInjections {
    fault: Vec<RawInjection>,
}

/// A fault that begins immediately.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawInjection {
    kind: FaultKind,
    #[serde(default)]
    process: Option<RawTargets>,
    #[serde(default)]
    for_ms: Option<u32>,
    #[serde(default)]
    by_us: Option<u32>,
}

impl Fault {
    /// Reads pairs such as `kind=stop process=planner for_ms=50`. The fault begins immediately and has tick 0.
    ///
    /// # Errors
    /// The first error, with its pair.
    pub fn from_pairs(pairs: &[&str]) -> Result<Self, ConfigError> {
        let place = Location::Injection(pairs.join(" ").into());
        if pairs.is_empty() {
            let help = "name the fault, for example kind=stop process=planner for_ms=50";
            return Err(override_error(&place, "", "no fault", "kind=KIND and the keys of that kind", help));
        }
        let mut keys = BTreeMap::new();
        pairs.iter().try_for_each(|pair| add(&mut keys, pair))?;
        read_one(&only_entry("fault", keys, &place)).map_err(|error| plain_keys(error, ENTRY))
    }
}

fn add(keys: &mut BTreeMap<String, Node>, pair: &str) -> Result<(), ConfigError> {
    let place = Location::Injection(pair.into());
    let example = "write for example kind=kill process=controller";
    let Some((key, text)) = pair.split_once('=') else {
        return Err(override_error(&place, "", "no =", "KEY=VALUE", example));
    };
    let key = key.trim();
    if key.is_empty() {
        return Err(override_error(&place, key, "an empty key", "KEY=VALUE", example));
    }
    if matches!(key, "at_s" | "random") {
        let help = "remove it; the fault begins immediately";
        return Err(override_error(&place, key, "a time", "one of kind, process, for_ms, by_us", help));
    }
    let value = parse(text.trim(), key, &place)?;
    if keys.contains_key(key) {
        return Err(twice(&place, key));
    }
    keys.insert(key.to_owned(), value);
    Ok(())
}

fn read_one(root: &Node) -> Result<Fault, ConfigError> {
    ranges::check(root)?;
    let raw: RawInjections = read::read(root)?;
    let Some(raw) = raw.fault.into_iter().next() else {
        return Err(override_error(&root.place, "", "no fault", "kind=KIND and the keys of that kind", "name the fault"));
    };
    if let Some(RawTargets::Sampled(_)) = raw.process {
        let key = format!("{ENTRY}.process");
        let found = root.get(&key).map_or_else(|| "a list".to_owned(), Node::describe);
        let help = "only a scenario samples from a list: name one process";
        return Err(override_error(&root.place(&key), &key, &found, "one process", help));
    }
    let raw = RawFault { kind: raw.kind, process: raw.process, at_s: None, for_ms: raw.for_ms, by_us: raw.by_us, random: None };
    check::injected(&raw, root)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::FaultTarget;

    #[test]
    fn pairs_valid_make_immediate_fault() {
        let fault = |kind, target, ticks, by_us| Fault { tick: 0, kind, target, ticks, by_us };
        for (pairs, expected) in [
            (vec!["kind=stop", "process=planner", "for_ms=50"], fault(FaultKind::Stop, FaultTarget::Planner, 50, 0)),
            (vec![" process = \"supervisor\" ", "kind=kill"], fault(FaultKind::Kill, FaultTarget::Supervisor, 0, 0)),
            (
                vec!["kind=slow", "process=controllers", "for_ms=3", "by_us=900"],
                fault(FaultKind::Slow, FaultTarget::Controllers, 3, 900),
            ),
            // TOML reads nan as a number.
            (vec!["kind=nan", "process=standby"], fault(FaultKind::Nan, FaultTarget::Standby, 1, 0)),
            (vec!["kind=\"nan\"", "process=plant"], fault(FaultKind::Nan, FaultTarget::Plant, 1, 0)),
            (vec!["kind=memory_lock", "process=controller"], fault(FaultKind::MemoryLock, FaultTarget::Controller, 0, 0)),
            (vec!["kind=hog", "for_ms=100"], fault(FaultKind::Hog, FaultTarget::Machine, 100, 0)),
            (vec!["kind=full_disk"], fault(FaultKind::FullDisk, FaultTarget::Machine, 0, 0)),
        ] {
            assert_eq!(Fault::from_pairs(&pairs).unwrap(), expected, "{pairs:?}");
        }
    }

    #[test]
    fn pairs_invalid_rejected_with_pair() {
        for (pairs, words) in [
            (vec![], vec!["no fault", "kind=KIND"]),
            (vec!["kill"], vec!["inject kill: found no =", "KEY=VALUE"]),
            (vec!["=kill"], vec!["empty key"]),
            (vec!["kind="], vec!["inject kind=: kind: found nothing after ="]),
            (vec!["kind=kil", "process=plant"], vec!["inject kind=kil: kind: found \"kil\"", "did you mean \"kill\"?"]),
            (vec!["process=plant"], vec!["inject process=plant: kind: found nothing", "add kind"]),
            (vec!["kind=kill", "proces=plant"], vec!["inject proces=plant: proces: found an unknown key", "mean process?"]),
            (vec!["kind=kill", "process=motor"], vec!["process: found \"motor\"", "\"controllers\", \"supervisor\""]),
            (vec!["kind=kill", "process=machine"], vec!["process: found \"machine\""]),
            (vec!["kind=kill"], vec!["inject kind=kill: process: found nothing beside kind = \"kill\"", "\"planner\""]),
            (
                vec!["kind=nan", "process=supervisor"],
                vec!["found \"supervisor\" beside kind = \"nan\"", "only be killed or halted"],
            ),
            (vec!["kind=stop", "process=[\"plant\", \"planner\"]"], vec!["[\"plant\", \"planner\"]", "expected one process"]),
            (vec!["kind=hog", "process=plant"], vec!["process: found \"plant\" beside kind = \"hog\"", "no process"]),
            (vec!["kind=kill", "process=plant", "for_ms=3"], vec!["for_ms: found 3 beside kind = \"kill\"", "no length"]),
            (vec!["kind=stop", "process=plant", "for_ms=0"], vec!["inject for_ms=0: for_ms: found 0", "[1, 600000]"]),
            (vec!["kind=stop", "process=plant", "for_ms=nan"], vec!["for_ms", "finite"]),
            (vec!["kind=slow", "process=plant"], vec!["by_us: found nothing beside kind = \"slow\"", "add by_us"]),
            (vec!["kind=stop", "process=plant", "by_us=5"], vec!["by_us: found 5 beside kind = \"stop\"", "only slow"]),
            (vec!["kind=kill", "process=plant", "at_s=3"], vec!["inject at_s=3: at_s: found a time", "begins immediately"]),
            (vec!["kind=kill", "random={count=1}", "process=plant"], vec!["random: found a time"]),
            (vec!["kind=kill", "kind=stop"], vec!["inject kind=stop: kind", "each value once"]),
        ] {
            let text = Fault::from_pairs(&pairs).unwrap_err().to_string();
            for word in words {
                assert!(text.contains(word), "{pairs:?}: '{word}' is not in: {text}");
            }
            assert!(text.contains(". Hint: ") && !text.contains(ENTRY), "{text}");
        }
    }
}
