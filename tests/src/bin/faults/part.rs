//! Part of the document: tables, and expectations of their figures.

/// Part of the document.
pub(crate) struct DocumentPart {
    /// Tables, each with its marker.
    pub(crate) tables: Vec<(&'static str, String)>,
    /// Conditions that must hold.
    pub(crate) expectations: Vec<Expectation>,
}

/// Condition that must hold.
pub(crate) struct Expectation {
    /// Subject.
    pub(crate) what: String,
    /// Expected figure.
    pub(crate) expected: String,
    /// Measured figure.
    pub(crate) found: String,
    /// Whether the condition holds.
    pub(crate) reached: bool,
}

impl Expectation {
    pub(crate) fn new(what: &str, expected: &str, found: String, reached: bool) -> Self {
        Self { what: what.to_owned(), expected: expected.to_owned(), found, reached }
    }
}

/// Formats a Markdown table.
pub(crate) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: String| format!("| {cells} |\n");
    let mut text = line(head.join(" | "));
    text.push_str(&format!("|{}\n", "---|".repeat(head.len())));
    text.extend(rows.iter().map(|row| line(row.join(" | "))));
    text
}

/// Formats expectations as a table.
pub(crate) fn verdict(expectations: &[Expectation]) -> String {
    let row = |e: &Expectation| {
        let reached = if e.reached { "yes" } else { "**no**" };
        vec![e.what.clone(), e.expected.clone(), e.found.clone(), reached.to_owned()]
    };
    table(&["what", "expected", "found", "reached"], &expectations.iter().map(row).collect::<Vec<_>>())
}

/// Median; `None` of an empty list.
pub(crate) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    let upper = *sorted.get(middle)?;
    Some(if sorted.len() % 2 == 1 { upper } else { (sorted[middle - 1] + upper) / 2.0 })
}

/// Largest value; `None` of an empty list.
pub(crate) fn largest(values: &[f64]) -> Option<f64> {
    values.iter().copied().reduce(f64::max)
}

/// Mean; zero of an empty list.
pub(crate) fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// Formats a value with a number of decimals; a dash for `None`.
pub(crate) fn digits(value: Option<f64>, digits: usize) -> String {
    // A value that rounds to zero has no sign.
    value.map_or("-".to_owned(), |value| {
        let text = format!("{value:.digits$}");
        if text.trim_start_matches(['-', '0', '.']).is_empty() { text.trim_start_matches('-').to_owned() } else { text }
    })
}

/// Formats median and largest value.
pub(crate) fn spread(values: &[f64], decimals: usize) -> String {
    if values.is_empty() {
        return "-".to_owned();
    }
    format!("{} / {}", digits(median(values), decimals), digits(largest(values), decimals))
}

#[cfg(test)]
mod tests {
    use super::{digits, largest, mean, median, spread};

    #[test]
    fn statistics_lists_computed_and_formatted() {
        assert_eq!((median(&[]), median(&[3.0]), median(&[4.0, 1.0, 2.0])), (None, Some(3.0), Some(2.0)));
        assert_eq!((median(&[1.0, 2.0]), largest(&[1.0, 5.0, 2.0]), mean(&[1.0, 2.0])), (Some(1.5), Some(5.0), 1.5));
        assert_eq!((digits(Some(-0.01), 1), digits(Some(-0.06), 1), digits(None, 1)), ("0.0".into(), "-0.1".into(), "-".into()));
        assert_eq!((spread(&[], 1), spread(&[1.0, 2.0, 9.0], 0)), ("-".to_owned(), "2 / 9".to_owned()));
    }
}
