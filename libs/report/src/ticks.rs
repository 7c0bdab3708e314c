//! Tick marks of the axes of a picture.

/// Tick mark of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TickMark {
    pub(crate) value: f64,
    pub(crate) text: String,
}

/// Places about `about` tick marks on a linear axis.
pub(crate) fn linear(low: f64, high: f64, about: usize) -> Vec<TickMark> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return Vec::new();
    }
    let rough = span / about.max(1) as f64;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|step| *step >= rough * 0.999).unwrap_or(power);
    let decimals = (-step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    // A step is never much smaller than span / about, so that the count is small.
    let count = (last - first).clamp(-1.0, 100.0) as i64;
    (0..=count)
        .map(|i| {
            // Zero has no sign.
            let value = (first + i as f64) * step + 0.0;
            TickMark { value, text: format!("{value:.decimals$}") }
        })
        .collect()
}

/// Places tick marks at the powers of ten of a logarithmic axis from `low` to `high`, both above zero.
pub(crate) fn decades(low: f64, high: f64) -> Vec<TickMark> {
    if !(low > 0.0 && high >= low && high.is_finite()) {
        return Vec::new();
    }
    let (first, last) = ((low.log10() - 1e-9).ceil() as i32, (high.log10() + 1e-9).floor() as i32);
    (first..=last)
        .map(|power| {
            let value = 10_f64.powi(power);
            let decimals = usize::try_from(-power).unwrap_or(0);
            TickMark { value, text: format!("{value:.decimals$}") }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(ticks: &[TickMark]) -> Vec<&str> {
        ticks.iter().map(|tick| tick.text.as_str()).collect()
    }

    #[test]
    fn linear_ticks_are_round_numbers() {
        assert_eq!(texts(&linear(-0.3, 1.1, 4)), ["0.0", "0.5", "1.0"]);
        assert_eq!(texts(&linear(0.0, 60.0, 6)), ["0", "10", "20", "30", "40", "50", "60"]);
        assert_eq!(texts(&linear(-150.0, 150.0, 3)), ["-100", "0", "100"]);
        assert_eq!(texts(&linear(0.021, 0.0234, 4)), ["0.021", "0.022", "0.023"]);
        assert!(linear(1.0, 1.0, 5).is_empty());
    }

    #[test]
    fn decade_ticks_are_powers_of_ten() {
        assert_eq!(texts(&decades(0.5, 2000.0)), ["1", "10", "100", "1000"]);
        assert_eq!(texts(&decades(0.1, 1.0)), ["0.1", "1"]);
    }
}
