//! The distributions as a picture.

use super::results::Results;
use anyhow::{Context, Result};
use hapfic_report::Figure;
use hapfic_report::figure::{Color, Content, Curve, Panel, Scale, Style};
use std::path::Path;

/// Of so many, how many took longer.
const OF: f64 = 100_000.0;

/// Writes the picture.
pub(super) fn write(results: &Results, path: &Path) -> Result<()> {
    let png = figure(results).png()?;
    std::fs::write(path, png).with_context(|| format!("--plot {}: cannot be written", path.display()))
}

/// How many chains took longer than what, both logarithmic; the stack's in a wide line.
fn figure(results: &Results) -> Figure {
    let stack =
        Curve { name: "the stack".to_owned(), color: Color::INK, style: Style::Wide, points: results.stack.longer_than(OF) };
    let others = results.chains.iter().enumerate().map(|(i, chain)| Curve {
        name: chain.name.clone(),
        color: Color::cycle(i),
        style: Style::Line,
        points: chain.round.longer_than(OF),
    });
    let load = if results.about.load > 0 { ", loaded machine" } else { "" };
    Figure {
        name: "latency",
        title: format!("Three hops in the same milliseconds: {}, {} s{load}", results.about.scenario, results.about.seconds),
        panels: vec![Panel {
            title: String::new(),
            x_label: "longer than, us".to_owned(),
            y_label: "of 100 000".to_owned(),
            scale: Scale::Logarithmic,
            content: Content::Curves { areas: Vec::new(), curves: std::iter::once(stack).chain(others).collect() },
            marks: Vec::new(),
        }],
        note: None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::results::tests::made_up;
    use super::*;

    #[test]
    fn every_chain_has_a_line_and_the_picture_can_be_drawn() {
        let figure = figure(&made_up());
        let Content::Curves { curves, .. } = &figure.panels[0].content else { panic!("no curves") };
        assert_eq!(curves.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["the stack", "futex"]);
        assert!(curves.iter().all(|c| !c.points.is_empty()));
        assert!(figure.png().unwrap().starts_with(b"\x89PNG"));
    }
}
