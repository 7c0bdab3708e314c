//! What a part of the document is made of: tables, and what is expected of them.

/// A part of the document.
pub(crate) struct Part {
    /// By the marker of its place.
    pub(crate) tables: Vec<(&'static str, String)>,
    /// What must hold.
    pub(crate) expectations: Vec<Expectation>,
}

/// Something that must hold.
pub(crate) struct Expectation {
    /// What it is about.
    pub(crate) what: String,
    /// What must be found.
    pub(crate) expected: String,
    /// What was found.
    pub(crate) found: String,
    /// Whether it holds.
    pub(crate) reached: bool,
}

impl Expectation {
    pub(crate) fn new(what: &str, expected: &str, found: String, reached: bool) -> Self {
        Self { what: what.to_owned(), expected: expected.to_owned(), found, reached }
    }
}

/// A table, as Markdown.
pub(crate) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: String| format!("| {cells} |\n");
    let mut text = line(head.join(" | "));
    text.push_str(&format!("|{}\n", "---|".repeat(head.len())));
    text.extend(rows.iter().map(|row| line(row.join(" | "))));
    text
}

/// Expected and found, as a table.
pub(crate) fn verdict(expectations: &[Expectation]) -> String {
    let row = |e: &Expectation| {
        let reached = if e.reached { "yes" } else { "**no**" };
        vec![e.what.clone(), e.expected.clone(), e.found.clone(), reached.to_owned()]
    };
    table(&["what", "expected", "found", "reached"], &expectations.iter().map(row).collect::<Vec<_>>())
}

/// The value in the middle; the mean of the two in the middle of an even number. `None` of nothing.
pub(crate) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    let upper = *sorted.get(middle)?;
    Some(if sorted.len() % 2 == 1 { upper } else { (sorted[middle - 1] + upper) / 2.0 })
}

/// The largest; `None` of nothing.
pub(crate) fn largest(values: &[f64]) -> Option<f64> {
    values.iter().copied().reduce(f64::max)
}

/// The mean; zero of nothing.
pub(crate) fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// With so many digits after the point, or a dash.
pub(crate) fn digits(value: Option<f64>, digits: usize) -> String {
    // Without the sign of a zero that was rounded.
    value.map_or("-".to_owned(), |value| {
        let text = format!("{value:.digits$}");
        if text.trim_start_matches(['-', '0', '.']).is_empty() { text.trim_start_matches('-').to_owned() } else { text }
    })
}

/// Median and largest.
pub(crate) fn spread(values: &[f64], places: usize) -> String {
    if values.is_empty() {
        return "-".to_owned();
    }
    format!("{} / {}", digits(median(values), places), digits(largest(values), places))
}

#[cfg(test)]
mod tests {
    use super::{digits, largest, mean, median, spread};

    #[test]
    fn figures_of_lists() {
        assert_eq!((median(&[]), median(&[3.0]), median(&[4.0, 1.0, 2.0])), (None, Some(3.0), Some(2.0)));
        assert_eq!((median(&[1.0, 2.0]), largest(&[1.0, 5.0, 2.0]), mean(&[1.0, 2.0])), (Some(1.5), Some(5.0), 1.5));
        assert_eq!((digits(Some(-0.01), 1), digits(Some(-0.06), 1), digits(None, 1)), ("0.0".into(), "-0.1".into(), "-".into()));
        assert_eq!((spread(&[], 1), spread(&[1.0, 2.0, 9.0], 0)), ("-".to_owned(), "2 / 9".to_owned()));
    }
}
