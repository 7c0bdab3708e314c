//! `--sweep`: the values that settings go through, and all their combinations.

use anyhow::{Result, bail, ensure};

/// Most runs of one study: each is checked before the first one starts.
const MOST_RUNS: usize = 10_000;
/// How a sweep is written.
const USAGE: &str = "KEY=V1,V2,... or KEY=FROM:TO:COUNT";

/// A setting and the values it goes through.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sweep {
    /// As `--set` names it.
    pub key: String,
    /// As `--set` would have them.
    pub values: Vec<String>,
}

impl Sweep {
    /// Reads `KEY=V1,V2,...`; a value may be a range `FROM:TO:COUNT` of numbers, ends included. Commas and colons within
    /// brackets or quotes belong to the value.
    ///
    /// # Errors
    /// What is wrong with it. Whether there is such a setting, and may have such values, is for those who load it to say.
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

/// All combinations of some sweeps; the last one changes fastest. Without sweeps there is one, of nothing.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    sweeps: Vec<Sweep>,
}

impl Grid {
    /// Reads all sweeps of a command line.
    ///
    /// # Errors
    /// If one cannot be read, two are of one setting, or they make too many runs.
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
                runs <= MOST_RUNS,
                "--sweep {argument}: found {runs} runs with it, expected at most {MOST_RUNS}; take fewer values"
            );
            sweeps.push(sweep);
        }
        Ok(Self { sweeps })
    }

    /// Runs.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // A grid has at least one run.
    pub fn len(&self) -> usize {
        self.sweeps.iter().map(|sweep| sweep.values.len()).product()
    }

    /// The sweeps, in the order in which they were written.
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

    /// The same as `KEY=VALUE`.
    #[must_use]
    pub fn overrides(&self, run: usize) -> Vec<String> {
        self.sweeps.iter().zip(self.values(run)).map(|(sweep, value)| format!("{}={value}", sweep.key)).collect()
    }
}

/// The parts between separators that are in no brackets and no quotes.
fn split(text: &str, separator: char) -> Vec<&str> {
    let (mut depth, mut quote, mut parts, mut start) = (0_usize, None, Vec::new(), 0);
    for (place, letter) in text.char_indices() {
        match quote {
            Some(open) if letter == open => quote = None,
            Some(_) => {}
            None => match letter {
                '"' | '\'' => quote = Some(letter),
                '[' | '{' => depth += 1,
                ']' | '}' => depth = depth.saturating_sub(1),
                _ if letter == separator && depth == 0 => {
                    parts.push(text[start..place].trim());
                    start = place + letter.len_utf8();
                }
                _ => {}
            },
        }
    }
    parts.push(text[start..].trim());
    parts
}

/// Numbers at equal distances, ends included.
fn range(argument: &str, from: &str, to: &str, count: &str) -> Result<Vec<String>> {
    let number = |text: &str| match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => bail!("--sweep {argument}: found {text:?}, expected a number; a range is FROM:TO:COUNT"),
    };
    let (first, last) = (number(from)?, number(to)?);
    let count: usize = match count.parse() {
        Ok(count) if (2..=MOST_RUNS).contains(&count) => count,
        _ => bail!("--sweep {argument}: found COUNT {count:?}, expected a whole number in [2, {MOST_RUNS}]"),
    };
    if let Some(whole) = whole_numbers(from, to, count) {
        return Ok(whole);
    }
    let share = |place: usize| place as f64 / (count - 1) as f64;
    Ok((0..count).map(|place| format!("{:?}", rounded(first * (1.0 - share(place)) + last * share(place)))).collect())
}

/// The range, if it is one of whole numbers, written so: a setting that counts something takes no others.
fn whole_numbers(from: &str, to: &str, count: usize) -> Option<Vec<String>> {
    let (first, last) = (from.parse::<i64>().ok()?, to.parse::<i64>().ok()?);
    let (span, gaps) = (last.checked_sub(first)?, i64::try_from(count).ok()? - 1);
    (span % gaps == 0).then(|| (0..=gaps).map(|place| (first + place * (span / gaps)).to_string()).collect())
}

/// To twelve digits: 0.3 in the middle of 0.1 and 0.5, not what the sum of two halves comes to.
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
    fn lists_are_split_outside_of_brackets_and_quotes() {
        let sweep = Sweep::read(" controller.taper = 0.1, 0.2,0.3").unwrap();
        assert_eq!(
            sweep,
            Sweep { key: "controller.taper".to_owned(), values: ["0.1", "0.2", "0.3"].map(str::to_owned).to_vec() }
        );
        assert_eq!(values("operator.2.desired_force=[0, 0, 50],[0,0,80]"), ["[0, 0, 50]", "[0,0,80]"]);
        assert_eq!(values("fault=[{kind=\"kill\",at=[1,2]}],[]"), ["[{kind=\"kill\",at=[1,2]}]", "[]"]);
        assert_eq!(values("title=\"a,b:c:d\",'e,f'"), ["\"a,b:c:d\"", "'e,f'"]);
        // What a setting makes of nothing is for it to say.
        assert_eq!(values("a=1,,2"), ["1", "", "2"]);
        assert_eq!(values("a=b=c"), ["b=c"]);
    }

    #[test]
    fn ranges_have_both_ends_and_round_numbers() {
        assert_eq!(values("a=0.1:0.5:5"), ["0.1", "0.2", "0.3", "0.4", "0.5"]);
        assert_eq!(values("a=1:2:3"), ["1.0", "1.5", "2.0"]);
        assert_eq!(values("a=10:50:3"), ["10", "30", "50"]);
        assert_eq!(values("a=50:-50:3"), ["50", "0", "-50"]);
        assert_eq!(values("a=1e-3:2e-3:2, 5"), ["0.001", "0.002", "5"]);
        assert_eq!(values("a=-9223372036854775808:9223372036854775807:2").len(), 2);
    }

    #[test]
    fn combinations_come_in_order_each_once() {
        let grid = Grid::read(&["a=1,2".to_owned(), "b=x,y,z".to_owned()]).unwrap();
        let all: Vec<_> = (0..grid.len()).map(|run| grid.values(run).join("")).collect();
        assert_eq!(all, ["1x", "1y", "1z", "2x", "2y", "2z"]);
        assert_eq!(grid.overrides(4), ["a=2", "b=y"]);
        let none = Grid::default();
        assert_eq!((none.len(), none.overrides(0)), (1, Vec::new()));
    }

    #[test]
    fn what_is_wrong_is_told() {
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
