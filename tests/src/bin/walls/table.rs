//! Tables of walls, and the limits of the default law.

use crate::case::{Case, Condition, LAWS};
use crate::outcome::Outcome;

/// Largest settled error, share of F_d.
const SETTLED: f64 = 0.002;
/// The same with noise.
const SETTLED_NOISE: f64 = 0.005;
/// Longest settling time [s], and its largest median.
const SETTLING_S: f64 = 0.4;
const SETTLING_MEDIAN_S: f64 = 0.15;

type Results = [(Case, Outcome)];

/// Cases of one wall without disturbance, with F_d within reach.
fn plain(wall: &Results) -> Vec<&Outcome> {
    let plain = wall.iter().filter(|(case, outcome)| case.condition == Condition::Plain && outcome.within_reach);
    plain.map(|(_, outcome)| outcome).collect()
}

fn largest(outcomes: &[&Outcome], figure: impl Fn(&Outcome) -> f64) -> f64 {
    outcomes.iter().map(|outcome| figure(outcome)).fold(0.0, f64::max)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Percent with three decimals, or a verdict in words.
fn percent(share: f64) -> String {
    if share > 0.1 { format!("**{:.0}**", 100.0 * share) } else { format!("{:.3}", 100.0 * share) }
}

fn seconds(time: f64) -> String {
    if time.is_finite() { format!("{time:.2}") } else { "never".to_owned() }
}

fn walls_of(results: &Results) -> impl Iterator<Item = &Results> {
    results.chunk_by(|(a, _), (b, _)| (a.stiffness, a.ratio) == (b.stiffness, b.ratio))
}

fn name(case: &Case) -> String {
    let ratio = case.ratio.map_or("b = 0.01 s k".to_owned(), |ratio| ratio.to_string());
    format!("{:.0e} | {ratio}", case.stiffness)
}

/// Table of the default law.
pub(crate) fn walls(results: &Results) -> String {
    let mut text = "| k, N/m | damping ratio | settled, % | settling, s: median | at most | beyond F_d, N | landing, N | noise: settled, % | +15 mm: settled, % | 20 Hz: settled, % |\n".to_owned();
    text.push_str(&format!("|{}\n", "---|".repeat(10)));
    for wall in walls_of(results) {
        let (case, plain) = (&wall[0].0, plain(wall));
        let disturbed = |condition: Condition| {
            let found = wall.iter().find(|(case, outcome)| case.condition == condition && outcome.within_reach);
            found.map_or("-".to_owned(), |(_, outcome)| percent(outcome.settled))
        };
        text.push_str(&format!(
            "| {} | {} | {} | {} | {:.0} | {:.0} | {} | {} | {} |\n",
            name(case),
            percent(largest(&plain, |o| o.settled)),
            seconds(median(plain.iter().map(|o| o.settling_s).collect())),
            seconds(largest(&plain, |o| o.settling_s)),
            largest(&plain, |o| o.beyond_n),
            largest(&plain, |o| o.impact_n),
            disturbed(Condition::Noise),
            disturbed(Condition::Height(0.015)),
            disturbed(Condition::Actuators),
        ));
    }
    text
}

/// Table of the default law on walls between.
pub(crate) fn between(results: &Results) -> String {
    let mut text = "| k, N/m | damping ratio | settled, % | settling, s: at most |\n|---|---|---|---|\n".to_owned();
    for wall in walls_of(results) {
        let plain = plain(wall);
        let (settled, settling) = (largest(&plain, |o| o.settled), largest(&plain, |o| o.settling_s));
        text.push_str(&format!("| {} | {} | {} |\n", name(&wall[0].0), percent(settled), seconds(settling)));
    }
    text
}

/// Smallest force of the comparison [N]: with a fixed taper 5 N are not left of their preload when the settled window begins.
const COMPARED_N: f64 = 10.0;

/// Table of the laws side by side.
pub(crate) fn laws(results: &[Vec<(Case, Outcome)>]) -> String {
    let mut text = "| k, N/m | damping ratio |".to_owned();
    for law in LAWS {
        text.push_str(&format!(" {}: settled, % | settling, s |", law.name));
    }
    text.push_str(&format!("\n|{}\n", "---|".repeat(2 + 2 * LAWS.len())));
    let mut tables: Vec<_> = results.iter().map(|results| walls_of(results)).collect();
    while let Some(walls) = tables.iter_mut().map(Iterator::next).collect::<Option<Vec<_>>>() {
        let mut line = format!("| {} |", name(&walls[0][0].0));
        for wall in walls {
            let compared: Vec<_> = wall.iter().filter(|(case, _)| case.force >= COMPARED_N).copied().collect();
            let plain = plain(&compared);
            let settling = median(plain.iter().map(|o| o.settling_s).collect());
            line.push_str(&format!(" {} | {} |", percent(largest(&plain, |o| o.settled)), seconds(settling)));
        }
        text.push_str(&line);
        text.push('\n');
    }
    text
}

/// Cases of the default law beyond the limits, walls that the loop cannot damp left out.
pub(crate) fn shortfalls(results: &Results) -> Vec<String> {
    let counted = results.iter().filter(|(case, outcome)| outcome.within_reach && !case.beyond_the_loop());
    let mut all: Vec<String> = counted
        .clone()
        .filter_map(|(case, outcome)| {
            let most = if case.condition == Condition::Noise { SETTLED_NOISE } else { SETTLED };
            let slow = case.condition == Condition::Plain && outcome.settling_s > SETTLING_S;
            (outcome.settled > most || slow || outcome.share_of_limit > 1.0).then(|| {
                format!(
                    "{:.0e} N/m, damping ratio {:?}, friction {}, {} N, {}: settled {:.3} %, settling {} s, |F_c| / F_max {:.3}",
                    case.stiffness,
                    case.ratio,
                    case.friction,
                    case.force,
                    case.condition.name(),
                    100.0 * outcome.settled,
                    seconds(outcome.settling_s),
                    outcome.share_of_limit
                )
            })
        })
        .collect();
    let plain = counted.filter(|(case, _)| case.condition == Condition::Plain);
    let settling = median(plain.map(|(_, outcome)| outcome.settling_s).collect());
    if settling > SETTLING_MEDIAN_S {
        all.push(format!("median of the settling times {settling:.3} s, expected {SETTLING_MEDIAN_S} s at most"));
    }
    let found = results.iter().filter(|(case, outcome)| case.beyond_the_loop() && outcome.within_reach);
    all.extend(found.filter(|(_, outcome)| outcome.settled > 0.05 && outcome.told_s > 0.3).map(|(case, outcome)| {
        format!("{case:?}: settled {:.1} %, told after {} s", 100.0 * outcome.settled, seconds(outcome.told_s))
    }));
    all
}
