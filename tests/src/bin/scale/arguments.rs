//! Command line of `scale`.

const USAGE: &str = "usage: scale FILE [--quick] [--seconds S] [--rounds N]";
/// Length of a measurement without and with `--quick` [s].
const SECONDS: (u64, u64) = (10, 3);
/// Rounds without and with `--quick`.
const ROUNDS: (u64, u64) = (3, 1);
/// Longest measurement [s], and largest number of rounds.
const MAX_VALUE: u64 = 1000;

/// Arguments of the command line.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Arguments {
    /// Path of the document.
    pub(crate) file: String,
    /// Length of a measurement [s].
    pub(crate) seconds: u64,
    /// Number of rounds.
    pub(crate) rounds: u64,
}

impl Arguments {
    /// Reads the command line. The error has the pattern of all messages: place, found, expected, hint.
    pub(crate) fn read(words: &[String]) -> Result<Self, String> {
        let (mut file, mut quick, mut seconds, mut rounds) = (None, false, None, None);
        let mut rest = words.iter();
        while let Some(word) = rest.next() {
            match word.as_str() {
                "--quick" => quick = true,
                "--seconds" => seconds = Some(whole(word, rest.next())?),
                "--rounds" => rounds = Some(whole(word, rest.next())?),
                name if file.is_none() && !name.starts_with("--") => file = Some(name.to_owned()),
                other => return Err(format!("scale: found {other:?}, expected one file or an option; {USAGE}")),
            }
        }
        let file = file.ok_or_else(|| format!("scale: found no file, expected the one with the tables; {USAGE}"))?;
        let pick = |(usual, short): (u64, u64)| if quick { short } else { usual };
        Ok(Self { file, seconds: seconds.unwrap_or(pick(SECONDS)), rounds: rounds.unwrap_or(pick(ROUNDS)) })
    }
}

fn whole(option: &str, text: Option<&String>) -> Result<u64, String> {
    let text = text.ok_or_else(|| format!("scale: {option}: found nothing after it, expected a value; {USAGE}"))?;
    text.parse()
        .ok()
        .filter(|number| (1..=MAX_VALUE).contains(number))
        .ok_or_else(|| format!("scale: {option}: found {text:?}, expected a whole number in [1, {MAX_VALUE}]; {USAGE}"))
}

#[cfg(test)]
mod tests {
    use super::Arguments;

    fn read(line: &str) -> Result<Arguments, String> {
        Arguments::read(&line.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
    }

    #[test]
    fn arguments_valid_line_parsed() {
        let figures = |line| read(line).map(|arguments| (arguments.file, arguments.seconds, arguments.rounds)).unwrap();
        assert_eq!(figures("a.md"), ("a.md".to_owned(), 10, 3));
        assert_eq!(figures("--quick a.md"), ("a.md".to_owned(), 3, 1));
        assert_eq!(figures("a.md --seconds 60 --rounds 2 --quick"), ("a.md".to_owned(), 60, 2));
    }

    #[test]
    fn arguments_bad_line_rejected() {
        for (line, word) in [
            ("", "no file"),
            ("a b", "found \"b\""),
            ("a --rounds", "found nothing after it"),
            ("a --seconds 0", "found \"0\""),
            ("a --rounds 1.5", "found \"1.5\""),
            ("a --fast", "found \"--fast\""),
        ] {
            let error = read(line).unwrap_err();
            assert!(error.contains(word) && error.contains("usage"), "{line}: {error}");
        }
    }
}
