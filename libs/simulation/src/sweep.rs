//! `--sweep`: values of settings, and all their combinations.

use anyhow::{Result, bail, ensure};

/// Maximum number of runs of a study; all settings are checked before the first run.
const MAX_RUNS: usize = 10_000;
/// Syntax of a sweep.
const USAGE: &str = "KEY=V1,V2,... or KEY=FROM:TO:COUNT";

/// A setting and its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sweep {
    /// Key, as in `--set`.
    pub key: String,
    /// Values, as in `--set`.
    pub values: Vec<String>,
}

impl Sweep {
    /// Reads `KEY=V1,V2,...`; a value may be a range `FROM:TO:COUNT` of numbers, ends included. Commas and colons
    /// within brackets or quotes belong to the value.
    ///
    /// # Errors
    /// If the syntax is invalid. Loading the settings checks the key and the values.
    pub fn read(argument: &str) -> Result<Self> {
        let Some((key, text)) = argument.split_once('=') else {
            bail!("--sweep {argument}: found no =, expected {USAGE}");
        };
        let mut values = Vec::new();
        for value in split(text, ',') {
            match split(value, ':').as_slice() {
                [_] => values.push(value.to_owned()),
                [from, to, count] => values.extend(range(argument, from, to, count)?),
                parts => bail!("--sweep {argument}: found {} parts with : between them, expected {USAGE}", parts.len()),
            }
        }
        Ok(Self { key: key.trim().to_owned(), values })
    }
}

/// All combinations of some sweeps; the last one changes fastest. Without sweeps there is one run without overrides.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    sweeps: Vec<Sweep>,
}

impl Grid {
    /// Reads all sweeps of a command line.
    ///
    /// # Errors
    /// If the syntax is invalid, two sweeps have the same key, or there are too many runs.
    pub fn read(arguments: &[String]) -> Result<Self> {
        let mut sweeps: Vec<Sweep> = Vec::new();
        let mut runs = 1_usize;
        for argument in arguments {
            let sweep = Sweep::read(argument)?;
            ensure!(
                sweeps.iter().all(|other| other.key != sweep.key),
                "--sweep {argument}: found {} a second time, expected one list with all its values",
                sweep.key
            );
            runs = runs.saturating_mul(sweep.values.len());
            ensure!(
                runs <= MAX_RUNS,
                "--sweep {argument}: found {runs} runs with it, expected at most {MAX_RUNS}; take fewer values"
            );
            sweeps.push(sweep);
        }
        Ok(Self { sweeps })
    }

    /// Number of runs.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // A grid has at least one run.
    pub fn len(&self) -> usize {
        self.sweeps.iter().map(|sweep| sweep.values.len()).product()
    }

    /// The sweeps, in the order of the command line.
    #[must_use]
    pub fn sweeps(&self) -> &[Sweep] {
        &self.sweeps
    }

    /// The value of each sweep in a run.
    #[must_use]
    pub fn values(&self, run: usize) -> Vec<&str> {
        let mut rest = run;
        let mut values: Vec<&str> = self
            .sweeps
            .iter()
            .rev()
            .map(|sweep| {
                let value = &sweep.values[rest % sweep.values.len()];
                rest /= sweep.values.len();
                value.as_str()
            })
            .collect();
        values.reverse();
        values
    }

    /// The values of a run as `KEY=VALUE`.
    #[must_use]
    pub fn overrides(&self, run: usize) -> Vec<String> {
        self.sweeps.iter().zip(self.values(run)).map(|(sweep, value)| format!("{}={value}", sweep.key)).collect()
    }
}

/// Splits a text at separators outside of brackets and quotes.
fn split(text: &str, separator: char) -> Vec<&str> {
    let (mut depth, mut quote, mut parts, mut start) = (0_usize, None, Vec::new(), 0);
    for (index, character) in text.char_indices() {
        match quote {
            Some(open) if character == open => quote = None,
            Some(_) => {}
            None => match character {
                '"' | '\'' => quote = Some(character),
                '[' | '{' => depth += 1,
                ']' | '}' => depth = depth.saturating_sub(1),
                _ if character == separator && depth == 0 => {
                    parts.push(text[start..index].trim());
                    start = index + character.len_utf8();
                }
                _ => {}
            },
        }
    }
    parts.push(text[start..].trim());
    parts
}

/// Equidistant numbers, ends included.
fn range(argument: &str, from: &str, to: &str, count: &str) -> Result<Vec<String>> {
    let number = |text: &str| match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => bail!("--sweep {argument}: found {text:?}, expected a number; a range is FROM:TO:COUNT"),
    };
    let (first, last) = (number(from)?, number(to)?);
    let count: usize = match count.parse() {
        Ok(count) if (2..=MAX_RUNS).contains(&count) => count,
        _ => bail!("--sweep {argument}: found COUNT {count:?}, expected a whole number in [2, {MAX_RUNS}]"),
    };
    if let Some(whole) = whole_numbers(from, to, count) {
        return Ok(whole);
    }
    let share = |index: usize| index as f64 / (count - 1) as f64;
    Ok((0..count).map(|index| format!("{:?}", rounded(first * (1.0 - share(index)) + last * share(index)))).collect())
}

/// The range as integers, if all its numbers are integers: a setting that counts accepts no other.
fn whole_numbers(from: &str, to: &str, count: usize) -> Option<Vec<String>> {
    let (first, last) = (from.parse::<i64>().ok()?, to.parse::<i64>().ok()?);
    let (span, gaps) = (last.checked_sub(first)?, i64::try_from(count).ok()? - 1);
    (span % gaps == 0).then(|| (0..=gaps).map(|index| (first + index * (span / gaps)).to_string()).collect())
}

/// Rounds to twelve digits, so that the midpoint of 0.1 and 0.5 reads 0.3.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn values(argument: &str) -> Vec<String> {
        Sweep::read(argument).unwrap().values
    }

    fn error(arguments: &[&str]) -> String {
        let arguments: Vec<String> = arguments.iter().map(|argument| (*argument).to_owned()).collect();
        Grid::read(&arguments).unwrap_err().to_string()
    }

    #[test]
    fn sweep_list_splits_outside_brackets_and_quotes() {
        let sweep = Sweep::read(" controller.taper = 0.1, 0.2,0.3").unwrap();
        assert_eq!(
            sweep,
            Sweep { key: "controller.taper".to_owned(), values: ["0.1", "0.2", "0.3"].map(str::to_owned).to_vec() }
        );
        assert_eq!(values("operator.2.desired_force=[0, 0, 50],[0,0,80]"), ["[0, 0, 50]", "[0,0,80]"]);
        assert_eq!(values("fault=[{kind=\"kill\",at=[1,2]}],[]"), ["[{kind=\"kill\",at=[1,2]}]", "[]"]);
        assert_eq!(values("title=\"a,b:c:d\",'e,f'"), ["\"a,b:c:d\"", "'e,f'"]);
        // Loading the settings checks the empty value.
        assert_eq!(values("a=1,,2"), ["1", "", "2"]);
        assert_eq!(values("a=b=c"), ["b=c"]);
    }

    #[test]
    fn sweep_range_has_both_ends_and_round_numbers() {
        assert_eq!(values("a=0.1:0.5:5"), ["0.1", "0.2", "0.3", "0.4", "0.5"]);
        assert_eq!(values("a=1:2:3"), ["1.0", "1.5", "2.0"]);
        assert_eq!(values("a=10:50:3"), ["10", "30", "50"]);
        assert_eq!(values("a=50:-50:3"), ["50", "0", "-50"]);
        assert_eq!(values("a=1e-3:2e-3:2, 5"), ["0.001", "0.002", "5"]);
        assert_eq!(values("a=-9223372036854775808:9223372036854775807:2").len(), 2);
    }

    #[test]
    fn grid_combinations_are_ordered_and_unique() {
        let grid = Grid::read(&["a=1,2".to_owned(), "b=x,y,z".to_owned()]).unwrap();
        let all: Vec<_> = (0..grid.len()).map(|run| grid.values(run).join("")).collect();
        assert_eq!(all, ["1x", "1y", "1z", "2x", "2y", "2z"]);
        assert_eq!(grid.overrides(4), ["a=2", "b=y"]);
        let none = Grid::default();
        assert_eq!((none.len(), none.overrides(0)), (1, Vec::new()));
    }

    #[test]
    fn sweep_invalid_argument_is_rejected() {
        for (arguments, words) in [
            (&["taper"][..], "--sweep taper: found no =, expected KEY=V1,V2,... or KEY=FROM:TO:COUNT"),
            (&["a=1:x:3"], "found \"x\", expected a number"),
            (&["a=1:inf:3"], "found \"inf\", expected a number"),
            (&["a=1:2:1"], "found COUNT \"1\", expected a whole number in [2, 10000]"),
            (&["a=1:2:2.5"], "found COUNT \"2.5\""),
            (&["a=1:2"], "found 2 parts with : between them"),
            (&["a=1", "a=2"], "found a a second time"),
            (&["a=0:1:200", "b=0:1:200"], "found 40000 runs with it, expected at most 10000"),
        ] {
            let error = error(arguments);
            assert!(error.contains(words), "{arguments:?}: {error}");
        }
    }
}
