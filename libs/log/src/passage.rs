//! Event of a body that went through another one.
//!
//! The plant counts passages in its state, since it has no port for events. Each writer of a log makes the event from
//! the state.

use crate::names::Names;
use hapfic_messages::{Detector, Event, EventKind, Process, Severity, State};

/// Event of the passages in the tick before a state, if there were any.
#[must_use]
pub fn passage_event(state: &State, names: &Names) -> Option<Event> {
    let physics = &state.physics;
    if physics.passages == 0 {
        return None;
    }
    let (body, against) = (names.body(physics.passed_body), names.body(physics.passed_against));
    let more = match physics.passages {
        1 => String::new(),
        several => format!(", and {} more passages in this tick", several - 1),
    };
    let text = format!("{body} went through {against}{more}: the simulation is not physical from here on");
    Some(Event::new(state.tick, Process::Plant, EventKind::Passage, Severity::Nominal, Detector::Recorder, &text))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn passage_event_names_both_bodies() {
        let names = Names { bodies: vec!["floor".to_owned(), "plate".to_owned()], ..Names::default() };
        let mut state = State { tick: 7, ..State::default() };
        assert_eq!(passage_event(&state, &names), None);
        (state.physics.passages, state.physics.passed_body) = (1, 1);
        let event = passage_event(&state, &names).unwrap();
        assert_eq!((event.tick, event.kind), (7, EventKind::Passage.code()));
        assert!(event.text().starts_with("plate went through floor:"), "{}", event.text());
        state.physics.passages = 3;
        assert!(passage_event(&state, &names).unwrap().text().contains("2 more passages"));
    }
}
