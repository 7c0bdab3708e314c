//! The latency distributions as a figure.

use super::results::BenchResults;
use anyhow::{Context, Result};
use hapfic_report::Figure;
use hapfic_report::figure::{Color, Curve, Panel, PanelContent, Scale, Style};
use std::path::Path;

/// Number of cycles to which the counts are scaled.
const CYCLES: f64 = 100_000.0;

/// Writes the figure.
pub(super) fn write(results: &BenchResults, path: &Path) -> Result<()> {
    let png = figure(results).png()?;
    std::fs::write(path, png).with_context(|| format!("--plot {}: cannot be written", path.display()))
}

/// Plots the cycles exceeding a latency, both axes logarithmic, with the stack's chain as a wide line.
fn figure(results: &BenchResults) -> Figure {
    let stack =
        Curve { name: "the stack".to_owned(), color: Color::INK, style: Style::Wide, points: results.stack.longer_than(CYCLES) };
    let others = results.chains.iter().enumerate().map(|(i, chain)| Curve {
        name: chain.name.clone(),
        color: Color::cycle(i),
        style: Style::Line,
        points: chain.round.longer_than(CYCLES),
    });
    let load = if results.about.load > 0 { ", loaded machine" } else { "" };
    Figure {
        name: "latency",
        title: format!("Interleaved three-hop round trip: {}, {} s{load}", results.about.scenario, results.about.seconds),
        panels: vec![Panel {
            title: String::new(),
            x_label: "latency [us]".to_owned(),
            y_label: "cycles exceeding it, per 100 000".to_owned(),
            scale: Scale::Logarithmic,
            content: PanelContent::Curves { areas: Vec::new(), curves: std::iter::once(stack).chain(others).collect() },
            marks: Vec::new(),
        }],
        note: None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::results::tests::sample_results;
    use super::*;

    #[test]
    fn figure_sample_results_has_curve_per_chain() {
        let figure = figure(&sample_results());
        let PanelContent::Curves { curves, .. } = &figure.panels[0].content else { panic!("no curves") };
        assert_eq!(curves.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["the stack", "futex"]);
        assert!(curves.iter().all(|c| !c.points.is_empty()));
        assert!(figure.png().unwrap().starts_with(b"\x89PNG"));
    }
}
