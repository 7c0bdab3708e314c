//! Shape of an error message: its text without the input's own words and numbers.

/// Largest shape [bytes]; longer messages differ at their start.
const MAX_BYTES: usize = 200;

/// Returns a message without digits and without quoted text.
#[must_use]
pub fn shape(message: &str) -> String {
    let mut shape = String::new();
    let mut quote = None;
    let mut escaped = false;
    let mut in_number = false;
    let mut before = ' ';
    for c in message.chars() {
        if shape.len() >= MAX_BYTES {
            break;
        }
        if let Some(end) = quote {
            if c == end && !escaped {
                quote = None;
                shape.push(c);
            }
            escaped = c == '\\' && !escaped;
        } else if c.is_ascii_digit() {
            if !in_number {
                shape.push('#');
            }
            in_number = true;
        } else if !(in_number && matches!(c, '.' | 'e' | 'E' | '+' | '-' | '_')) {
            in_number = false;
            // An apostrophe inside a word opens no quotation.
            if matches!(c, '"' | '`') || c == '\'' && !before.is_alphanumeric() {
                quote = Some(c);
                escaped = false;
            }
            shape.push(c);
        }
        before = c;
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_numbers_and_quotations_ignored() {
        let a =
            shape("floor.toml:17: controller.taper: found -1.5e-7, expected a number in (0, 1]. Hint: the robot's \"x\\\"y\"");
        let b = shape("floor.toml:3: controller.taper: found -8, expected a number in (0, 1]. Hint: the robot's \"\"");
        assert_eq!(a, b);
        assert_ne!(a, shape("floor.toml:3: controller.tapir: found -8, expected a number in (0, 1]. Hint: the robot's \"\""));
        assert_eq!(shape("link 'a b' at 5"), shape("link 'c' at 67"));
    }
}
