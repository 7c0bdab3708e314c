//! Target `change`: changes of a running stack, as `key=value` pairs in an operator's request.

use crate::fuzz::target::{FuzzOutcome, FuzzTarget};
use hapfic_config::{OperatorChange, ParameterSettings, Settings};
use hapfic_controller::parameters::{TipPose, parameters};
use hapfic_messages::{Check, OperatorKind, OperatorRequest};
use std::path::Path;

pub(super) const TARGET: FuzzTarget = FuzzTarget {
    name: "change",
    seeds,
    dictionary: &[
        "target_position",
        "target_position_m",
        "desired_force",
        "desired_force_n",
        "stiffness",
        "max_force",
        "position_bound",
        "reset_policy",
        "saturation",
        "search",
        "taper",
        "search_scale",
        "force_resolution",
        "gravity_compensation",
        "offset_anti_windup",
        "stall_release",
        "mean_speed",
        "max_acceleration",
        "at_s",
        ".x",
        ".y",
        ".z",
        "=",
        "[0, 0, 50]",
        "sign",
        "tapered",
        "never",
        "as_printed",
        "contact_loss",
        "continuous",
        "true",
        "false",
    ],
    text: true,
    max_bytes: 4096,
    execute,
};

fn seeds() -> Vec<Vec<u8>> {
    let lines = [
        "desired_force=[0, 0, 80]",
        "desired_force.z=80\nstiffness.x=9000\ntaper=0.1",
        "target_position=[-0.1, 0.05, 0.012]\nmean_speed=0.3\nmax_acceleration=5",
        "search=sign\nreset_policy=never\nsaturation=as_printed\ngravity_compensation=true\noffset_anti_windup=false",
        "stiffness_n_per_m = [1e3, 2e3, 3e3]\nmax_force=[1, 2, 3]\nposition_bound=[0.01, 0.02, 0.03]",
        "search_scale=0.5\nforce_resolution=1\nstall_release=false",
    ];
    lines.map(|text| text.as_bytes().to_vec()).into()
}

fn base() -> ParameterSettings {
    thread_local! {
        static BASE: ParameterSettings = Settings::load("floor", &[]).expect("an embedded scenario").initial;
    }
    BASE.with(|base| *base)
}

fn execute(input: &[u8], _: &Path) -> FuzzOutcome {
    let text = String::from_utf8_lossy(input).replace('\n', "\0");
    let request = match OperatorRequest::new(OperatorKind::Set, &text) {
        Ok(request) => request,
        Err(error) => return FuzzOutcome::Rejected(error.to_string()),
    };
    match request.parts() {
        Ok((_, text)) => match changed(text) {
            Ok(()) => FuzzOutcome::Accepted,
            Err(message) => FuzzOutcome::Rejected(message),
        },
        Err(error) => panic!("found a rejected request, expected a valid one from text: {error}"),
    }
}

/// Applies the text of a request as the supervisor does.
pub(super) fn changed(text: &str) -> Result<(), String> {
    let pairs: Vec<&str> = text.split('\0').filter(|pair| !pair.is_empty()).collect();
    for base in [base(), ParameterSettings { target_position: Some([0.1, 0.2, 0.3]), ..base() }] {
        let parsed = OperatorChange::from_pairs(&pairs, &base).map_err(|error| error.to_string())?;
        let set = parameters(&base.with(&parsed.change), 2, 100, &TipPose::default());
        assert_eq!(set.check(), Ok(()), "an accepted change makes an invalid set");
    }
    Ok(())
}
