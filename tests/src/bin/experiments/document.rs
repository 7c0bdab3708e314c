//! Document with tables between markers.

const END: &str = "<!-- end -->";

/// Whether the document has the marker of a table.
pub(crate) fn has_marker(document: &str, name: &str) -> bool {
    let marker = format!("<!-- {name} -->");
    document.lines().any(|line| line == marker)
}

/// Returns the document with `table` between the lines `<!-- name -->` and `<!-- end -->`.
///
/// # Errors
/// If the marker is missing or not unique, or its end is missing.
pub(crate) fn replace(document: &str, name: &str, table: &str) -> Result<String, String> {
    let marker = format!("<!-- {name} -->");
    let lines: Vec<&str> = document.lines().collect();
    let mut matches = lines.iter().enumerate().filter(|(_, line)| **line == marker).map(|(index, _)| index);
    let (Some(start), None) = (matches.next(), matches.next()) else {
        return Err(format!(
            "found no line `{marker}`, or more than one, expected one before the table; add it, or remove a copy"
        ));
    };
    let after = lines[start + 1..].iter().position(|line| line.starts_with("<!-- ")).map(|index| start + 1 + index);
    let Some(end) = after.filter(|&index| lines[index] == END) else {
        let found = after.map_or("the end of the file", |index| lines[index]);
        return Err(format!(
            "after `{marker}` (line {}) found {found}, expected `{END}` after the table; add that line",
            start + 1
        ));
    };
    let mut new = lines[..=start].join("\n");
    new.push('\n');
    new.push_str(table);
    new.push_str(&lines[end..].join("\n"));
    new.push('\n');
    Ok(new)
}

#[cfg(test)]
mod tests {
    use super::replace;

    const DOCUMENT: &str = "# A\n<!-- a -->\n| old |\n<!-- end -->\ntext\n<!-- b -->\n<!-- end -->\nend\n";

    #[test]
    fn replace_one_table_rest_unchanged() {
        let once = replace(DOCUMENT, "a", "| new |\n| row |\n").unwrap();
        assert_eq!(once, DOCUMENT.replace("| old |\n", "| new |\n| row |\n"));
        assert_eq!(replace(&once, "a", "| old |\n").unwrap(), DOCUMENT);
        assert!(replace(DOCUMENT, "b", "| b |\n").unwrap().contains("<!-- b -->\n| b |\n<!-- end -->\nend\n"));
    }

    #[test]
    fn replace_bad_markers_rejected() {
        assert!(replace(DOCUMENT, "c", "").unwrap_err().contains("`<!-- c -->`"));
        assert!(replace(&DOCUMENT.repeat(2), "a", "").unwrap_err().contains("more than one"));
        let open = DOCUMENT.replacen("<!-- end -->\n", "", 1);
        assert!(replace(&open, "a", "").unwrap_err().contains("found <!-- b -->"));
        assert!(replace("<!-- a -->\n", "a", "").unwrap_err().contains("the end of the file"));
    }
}
