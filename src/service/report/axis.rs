//! The axis of a chart: the values written beside it, and the position of a value.

use panelprep_base::number_text::shortest_text;

/// An axis from its lowest to its highest value, over a length in the chart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    min: f64,
    max: f64,
    /// The positions of the lowest and the highest value, in units of the chart.
    from: f64,
    to: f64,
}

impl Axis {
    /// Creates an axis over all of these values, with some space on both sides; NaN and infinite values are
    /// ignored.
    pub fn covering(values: impl Iterator<Item = f64>, [from, to]: [f64; 2]) -> Self {
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        // If all values are equal, the axis still needs a length.
        let room = if high > low { 0.08 * (high - low) } else { 0.5 * high.abs().max(1.0) };
        Axis { min: low - room, max: high + room, from, to }
    }

    /// Returns the position of a value.
    pub fn position(&self, value: f64) -> f64 {
        self.from + (value - self.min) / (self.max - self.min) * (self.to - self.from)
    }

    /// Returns about this number of round values on the axis, each with its text; their distance is 1, 2 or 5 times a
    /// power of ten.
    pub fn ticks(&self, about: usize) -> Vec<(f64, String)> {
        let rough = (self.max - self.min) / about.max(1) as f64;
        let power = 10.0_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|step| *step >= 0.75 * rough);
        let step = step.unwrap_or(10.0 * power);
        let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
        let (first, last) = ((self.min / step).ceil() as i64, (self.max / step).floor() as i64);
        let text =
            |value: f64| format!("{value:.decimals$}").parse().map_or_else(|_| shortest_text(value), shortest_text);
        (first..=last).map(|index| index as f64 * step).map(|value| (value, text(value))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: from 0.05 to 0.25 with 8 % of 0.2 on both sides is 0.034 to 0.266, and steps of 0.05
    /// make five values.
    #[test]
    fn the_values_beside_an_axis_are_round() {
        let axis = Axis::covering([0.05, 0.25, f64::NAN].into_iter(), [300.0, 0.0]);
        let texts: Vec<String> = axis.ticks(5).into_iter().map(|(_, text)| text).collect();
        assert_eq!(texts, ["0.05", "0.1", "0.15", "0.2", "0.25"]);
        // The middle of the values is in the middle of the chart, which counts downwards.
        assert!((axis.position(0.15) - 150.0).abs() < 1e-9 && axis.position(0.25) < axis.position(0.05));
        let texts = |low: f64, high: f64| {
            Axis::covering([low, high].into_iter(), [0.0, 1.0])
                .ticks(4)
                .into_iter()
                .map(|(_, text)| text)
                .collect::<Vec<_>>()
        };
        assert_eq!(texts(-7.0, 13.0), ["-5", "0", "5", "10"]);
        assert_eq!(texts(10_000.0, 52_000.0), ["10000", "20000", "30000", "40000", "50000"]);
        assert_eq!(texts(3.0, 3.0), ["2", "3", "4"], "equal values have an axis");
    }

    #[test]
    fn nothing_has_an_axis_too() {
        let axis = Axis::covering(std::iter::empty(), [0.0, 100.0]);
        assert!(axis.ticks(4).len() >= 3 && axis.position(0.5).is_finite());
    }
}
