//! Command line of `faults`.

const USAGE: &str = "usage: faults FILE [--quick] [--only matrix|supervisor|soak|refusals] [--minutes N]";
/// Length of the soak without `--minutes` [min]: of a full and of a quick one.
const MINUTES: (u64, u64) = (10, 1);
/// Longest soak [min].
const MAX_MINUTES: u64 = 1000;

/// Name of a part of the document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PartName {
    /// Matrix of processes, faults and phases.
    Matrix,
    /// Kills of the supervisor.
    Supervisor,
    /// Many faults in one run.
    Soak,
    /// Rejected messages.
    Rejections,
}

impl PartName {
    const ALL: [Self; 4] = [Self::Matrix, Self::Supervisor, Self::Rejections, Self::Soak];

    const fn name(self) -> &'static str {
        match self {
            Self::Matrix => "matrix",
            Self::Supervisor => "supervisor",
            Self::Soak => "soak",
            Self::Rejections => "refusals",
        }
    }

    /// Markers of its tables in the document.
    pub(crate) const fn markers(self) -> &'static [&'static str] {
        match self {
            Self::Matrix => &["matrix", "lockstep", "realtime"],
            Self::Supervisor => &["supervisor"],
            Self::Soak => &["soak"],
            Self::Rejections => &["refusals"],
        }
    }
}

/// Arguments of the command line.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Arguments {
    /// Path of the document.
    pub(crate) file: String,
    /// Fewer repetitions.
    pub(crate) quick: bool,
    /// Requested parts.
    pub(crate) parts: Vec<PartName>,
    /// Length of the soak [min].
    pub(crate) minutes: u64,
}

impl Arguments {
    /// Reads the command line. The error has the pattern of all messages: place, found, expected, hint.
    pub(crate) fn read(words: &[String]) -> Result<Self, String> {
        let (mut file, mut quick, mut only, mut minutes) = (None, false, None, None);
        let mut rest = words.iter();
        while let Some(word) = rest.next() {
            let mut value =
                || rest.next().ok_or_else(|| format!("faults: {word}: found nothing after it, expected a value; {USAGE}"));
            match word.as_str() {
                "--quick" => quick = true,
                "--only" => {
                    let name = value()?;
                    only = Some(PartName::ALL.into_iter().find(|which| which.name() == name).ok_or_else(|| {
                        format!("faults: --only: found {name:?}, expected matrix, supervisor, soak or refusals; {USAGE}")
                    })?);
                }
                "--minutes" => {
                    let text = value()?;
                    minutes = Some(text.parse().ok().filter(|minutes| (1..=MAX_MINUTES).contains(minutes)).ok_or_else(|| {
                        format!("faults: --minutes: found {text:?}, expected a whole number in [1, {MAX_MINUTES}]; {USAGE}")
                    })?);
                }
                name if file.is_none() && !name.starts_with("--") => file = Some(name.to_owned()),
                other => return Err(format!("faults: found {other:?}, expected one file or an option; {USAGE}")),
            }
        }
        let file = file.ok_or_else(|| format!("faults: found no file, expected the one with the tables; {USAGE}"))?;
        let parts = only.map_or_else(|| PartName::ALL.to_vec(), |which| vec![which]);
        let minutes = minutes.unwrap_or(if quick { MINUTES.1 } else { MINUTES.0 });
        Ok(Self { file, quick, parts, minutes })
    }
}

#[cfg(test)]
mod tests {
    use super::{Arguments, PartName};

    fn read(line: &str) -> Result<Arguments, String> {
        Arguments::read(&line.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
    }

    #[test]
    fn arguments_valid_line_parsed() {
        let all = read("docs/faults.md").unwrap();
        assert_eq!((all.file.as_str(), all.quick, all.parts.len(), all.minutes), ("docs/faults.md", false, 4, 10));
        let soak = read("--only soak f.md --minutes 3").unwrap();
        assert_eq!((soak.parts, soak.minutes), (vec![PartName::Soak], 3));
        assert_eq!(read("f.md --quick").unwrap().minutes, 1);
    }

    #[test]
    fn arguments_bad_line_rejected() {
        for (line, word) in [
            ("", "no file"),
            ("a b", "found \"b\""),
            ("a --only", "found nothing after it"),
            ("a --only tea", "found \"tea\""),
            ("a --minutes 0", "found \"0\""),
            ("a --fast", "found \"--fast\""),
        ] {
            let error = read(line).unwrap_err();
            assert!(error.contains(word) && error.contains("usage"), "{line}: {error}");
        }
    }
}
