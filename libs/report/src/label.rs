//! Labels with subscripts, as in `x_{d}`.

/// Piece of a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run<'a> {
    pub(crate) text: &'a str,
    pub(crate) subscript: bool,
}

/// Splits a label into its pieces, in order; none is empty.
pub(crate) fn runs(label: &str) -> Vec<Run<'_>> {
    let mut runs = Vec::new();
    let mut rest = label;
    while let Some((before, after)) = rest.split_once("_{") {
        let Some((inside, remainder)) = after.split_once('}') else { break };
        runs.push(Run { text: before, subscript: false });
        runs.push(Run { text: inside, subscript: true });
        rest = remainder;
    }
    runs.push(Run { text: rest, subscript: false });
    runs.retain(|run| !run.text.is_empty());
    runs
}

/// Converts a label to HTML and escapes its text.
pub(crate) fn html(label: &str) -> String {
    runs(label)
        .into_iter()
        .map(|run| if run.subscript { format!("<sub>{}</sub>", escape(run.text)) } else { escape(run.text) })
        .collect()
}

/// Escapes text for HTML, between tags and in quoted attributes.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\n' | '\t' => escaped.push(' '),
            c if c.is_control() => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn html_converts_only_subscripts() {
        assert_eq!(html("F_{d} <b> & F_{max}"), "F<sub>d</sub> &lt;b&gt; &amp; F<sub>max</sub>");
        assert_eq!(html("hip_pitch _{open"), "hip_pitch _{open");
        assert!(runs("").is_empty());
    }
}
