//! Labels with subscripts, as in `x_{d}`.

/// Piece of a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LabelPart<'a> {
    pub(crate) text: &'a str,
    pub(crate) subscript: bool,
}

/// Splits a label into its pieces, in order; none is empty.
pub(crate) fn parts(label: &str) -> Vec<LabelPart<'_>> {
    let mut parts = Vec::new();
    let mut rest = label;
    while let Some((before, after)) = rest.split_once("_{") {
        let Some((inside, remainder)) = after.split_once('}') else { break };
        parts.push(LabelPart { text: before, subscript: false });
        parts.push(LabelPart { text: inside, subscript: true });
        rest = remainder;
    }
    parts.push(LabelPart { text: rest, subscript: false });
    parts.retain(|part| !part.text.is_empty());
    parts
}

/// Converts a label to HTML and escapes its text.
pub(crate) fn html(label: &str) -> String {
    parts(label)
        .into_iter()
        .map(|part| if part.subscript { format!("<sub>{}</sub>", escape(part.text)) } else { escape(part.text) })
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
        assert!(parts("").is_empty());
    }
}
