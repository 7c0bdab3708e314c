//! A body that goes through another one: counted in the metrics, and an event of the log.

use hapfic_config::Settings;
use hapfic_log::{Reader, Record};
use hapfic_simulation::recording::Recording;
use hapfic_simulation::study::{End, study};
use std::sync::atomic::AtomicBool;

/// A heavy ball falls on a sheet of 1 mm, and presses its middle below the surface of the floor.
const SCENE: &str = "duration_s = 1.0
[robot]
urdf = \"leg.urdf\"
base_link = \"base\"
tip_link = \"foot\"
base_position_m = [0, 0, 0.5]
start_position_rad = [0, 0.6, -1.2]
[world.floor]
[[world.object]]
name = \"sheet\"
shape = \"box\"
size_m = [0.3, 0.3, 0.001]
mass_kg = 0.2
position_m = [2, 0, 0.0005]
[[world.object]]
name = \"weight\"
shape = \"ball\"
radius_m = 0.05
mass_kg = 2.0
position_m = [2.02, 0.01, 3]
";

#[test]
fn passage_is_counted_and_an_event_of_the_log() {
    let settings = Settings::from_effective(SCENE, "leg.urdf", hapfic_config::robots()[0].1).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("passage.mcap");
    let mut recording = Recording::create("passage", &settings, &path).unwrap();
    let done = study(&settings, &AtomicBool::new(false), Some(&mut recording)).unwrap();
    recording.finish().unwrap();
    assert_eq!(done.end, End::Completed);
    let integration = &done.metrics.integration;
    assert_eq!((integration.passages, integration.unconverged), (1, 0));
    assert!(integration.energy_error_j.abs() <= 1e-6 * integration.energy_range_j, "{integration:?}");
    let events: Vec<_> = Reader::open(&path)
        .unwrap()
        .filter_map(|message| match message.unwrap().record {
            Record::Event(event) => Some(event),
            _ => None,
        })
        .collect();
    assert_eq!(events.len(), 1, "{events:?}");
    assert_eq!((events[0].kind.as_str(), events[0].process.as_str()), ("passage", "plant"));
    assert!(events[0].text.starts_with("sheet went through floor"), "{}", events[0].text);
}
