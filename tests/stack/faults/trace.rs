//! Commands, events and references of a log.

use hapfic_log::{Reader, Record, proto};
use std::path::Path;

/// Commands, events and references of a log.
#[derive(Default)]
pub struct EventTrace {
    pub commands: Vec<proto::Command>,
    pub events: Vec<proto::Event>,
    pub references: Vec<proto::Reference>,
}

impl EventTrace {
    pub fn read(log: &Path) -> Self {
        let mut trace = Self::default();
        for entry in Reader::open(log).unwrap() {
            match entry.unwrap().record {
                Record::Command(m) => trace.commands.push(m),
                Record::Event(m) => trace.events.push(m),
                Record::Reference(m) => trace.references.push(m),
                _ => {}
            }
        }
        trace
    }

    /// Events of a kind about a process.
    pub fn events(&self, kind: &str, process: &str) -> Vec<&proto::Event> {
        self.events.iter().filter(|e| e.kind == kind && e.process == process).collect()
    }

    /// Events as lines of text, for messages of failed tests.
    pub fn text(&self) -> String {
        let line = |e: &proto::Event| format!("{} {} {} {} {}: {}\n", e.tick, e.process, e.kind, e.severity, e.detector, e.text);
        self.events.iter().map(line).collect()
    }

    /// Number of commands with fresh torque from a controller.
    pub fn fresh_from(&self, controller: &str) -> usize {
        self.commands.iter().filter(|c| c.source == "fresh" && c.controller == controller).count()
    }

    /// Largest step of any joint's torque between consecutive commands, among steps under the rate limit [N m].
    pub fn largest_ramped_step(&self) -> f64 {
        let steps = self.commands.windows(2).filter(|pair| pair[1].ramped != 0 && pair[1].tick == pair[0].tick + 1);
        steps.flat_map(|pair| pair[0].torque.iter().zip(&pair[1].torque).map(|(a, b)| (b - a).abs())).fold(0.0, f64::max)
    }
}
