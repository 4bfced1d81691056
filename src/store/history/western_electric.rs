//! The four rules of Western Electric, which detect that values no longer scatter around a constant mean. A hint asks a
//! person to check the process: a process may be out of control although every value is within its limit.
//!
//! Western Electric Company, Statistical Quality Control Handbook, 1956, pages 25 to 28; NIST/SEMATECH e-Handbook of
//! Statistical Methods, 6.3.2. The standard deviation is estimated from the differences between consecutive values
//! (moving range), as for a chart of individual values (e-Handbook, 6.3.2.2). Therefore a slow drift does not increase
//! the estimate and can be detected.

use serde::Serialize;

/// Minimum number of values at which the standard deviation can be estimated.
pub const MIN_VALUES: usize = 10;
/// Ratio of the mean difference between consecutive values to the standard deviation, for a normal distribution: 2 /
/// √π.
const MEAN_DIFFERENCE_RATIO: f64 = std::f64::consts::FRAC_2_SQRT_PI;

/// The four rules of Western Electric.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, strum::EnumIter)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// One value is more than three standard deviations from the mean.
    OneBeyondThree,
    /// Two of three consecutive values are more than two standard deviations from the mean, on the same side.
    TwoOfThreeBeyondTwo,
    /// Four of five consecutive values are more than one standard deviation from the mean, on the same side.
    FourOfFiveBeyondOne,
    /// Eight consecutive values are on the same side of the mean.
    EightOnOneSide,
}

impl Rule {
    /// Returns the number of consecutive values, how many of them must exceed the bound, and the bound in standard
    /// deviations.
    fn window_and_count(self) -> (usize, usize, f64) {
        match self {
            Rule::OneBeyondThree => (1, 1, 3.0),
            Rule::TwoOfThreeBeyondTwo => (3, 2, 2.0),
            Rule::FourOfFiveBeyondOne => (5, 4, 1.0),
            Rule::EightOnOneSide => (8, 8, 0.0),
        }
    }

    /// Returns the rule as text for people.
    pub fn describe(self) -> &'static str {
        match self {
            Rule::OneBeyondThree => "one value is more than 3 standard deviations from the mean",
            Rule::TwoOfThreeBeyondTwo => {
                "2 of 3 successive values are more than 2 standard deviations from the mean, on the same side"
            }
            Rule::FourOfFiveBeyondOne => {
                "4 of 5 successive values are more than 1 standard deviation from the mean, on the same side"
            }
            Rule::EightOnOneSide => "8 successive values are on the same side of the mean",
        }
    }
}

/// The side of the mean on which the values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names explain themselves")]
pub enum Side {
    Above,
    Below,
}

/// A value at which a rule is violated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Hint {
    /// The rule that is violated.
    pub rule: Rule,
    /// Index of the value at which the rule is violated, from 0.
    pub at: usize,
    /// The side of the mean on which the values are.
    pub side: Side,
}

/// The usual range of values: mean and standard deviation. The standard deviation is estimated from the differences
/// between consecutive values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UsualRange {
    /// Mean of the values.
    pub mean: f64,
    /// Estimated standard deviation of the values.
    pub sigma: f64,
}

/// Returns the mean, and the standard deviation from the differences between consecutive values; `None` for fewer than
/// [`MIN_VALUES`] values.
pub fn usual_range(values: &[f64]) -> Option<UsualRange> {
    if values.len() < MIN_VALUES {
        return None;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let moved: f64 = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
    Some(UsualRange { mean, sigma: moved / (values.len() - 1) as f64 / MEAN_DIFFERENCE_RATIO })
}

/// Returns the values at which a rule is violated, in their order. Equal values violate no rule.
pub fn find_violations(values: &[f64], usual: UsualRange) -> Vec<Hint> {
    if usual.sigma <= 0.0 {
        return Vec::new();
    }
    let scores: Vec<f64> = values.iter().map(|value| (value - usual.mean) / usual.sigma).collect();
    let rules = [Rule::OneBeyondThree, Rule::TwoOfThreeBeyondTwo, Rule::FourOfFiveBeyondOne, Rule::EightOnOneSide];
    let mut hints = Vec::new();
    for at in 0..scores.len() {
        for rule in rules {
            let (of, needed, beyond) = rule.window_and_count();
            let window = &scores[(at + 1).saturating_sub(of)..=at];
            for (side, sign) in [(Side::Above, 1.0), (Side::Below, -1.0)] {
                let is_beyond = |score: &&f64| **score * sign > beyond;
                // The value at which the rule is violated must itself exceed the bound.
                if is_beyond(&&scores[at]) && window.iter().filter(is_beyond).count() >= needed {
                    hints.push(Hint { rule, at, side });
                }
            }
        }
    }
    hints
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: UsualRange = UsualRange { mean: 10.0, sigma: 2.0 };

    fn violated(scores: &[f64]) -> Vec<(Rule, usize, Side)> {
        let values: Vec<f64> = scores.iter().map(|score| 10.0 + 2.0 * score).collect();
        find_violations(&values, UNIT).into_iter().map(|hint| (hint.rule, hint.at, hint.side)).collect()
    }

    /// Expected values, determined by hand, in standard deviations: each row contains values, and the first index at
    /// which they violate the rule.
    #[test]
    fn each_rule_is_violated_as_in_the_handbook() {
        assert_eq!(violated(&[0.5, -0.5, 3.1]), [(Rule::OneBeyondThree, 2, Side::Above)]);
        assert_eq!(violated(&[0.5, -0.5, 3.0]), [], "three times itself is not beyond");
        assert_eq!(violated(&[-2.1, 0.5, -2.1]), [(Rule::TwoOfThreeBeyondTwo, 2, Side::Below)]);
        assert_eq!(violated(&[-2.1, 0.5, 2.1]), [], "not on the same side");
        assert_eq!(violated(&[2.1, 0.5, -0.5, 2.1]), [], "two of four");
        assert_eq!(violated(&[1.1, 1.1, -0.5, 1.1, 1.1]), [(Rule::FourOfFiveBeyondOne, 4, Side::Above)]);
        assert_eq!(violated(&[1.1, 1.1, -0.5, 0.9, 1.1]), []);
        assert_eq!(violated(&[-0.1; 8]), [(Rule::EightOnOneSide, 7, Side::Below)]);
        assert_eq!(violated(&[-0.1; 7]), []);
        assert_eq!(violated(&[-0.1, -0.1, -0.1, 0.1, -0.1, -0.1, -0.1, -0.1, -0.1]), []);
    }

    /// Expected values, calculated by hand: the ten values 1, 3, 1, 3, … have the mean 2 and differences of 2, so the
    /// estimated standard deviation is 2 / 1.1284 = 1.7725.
    #[test]
    fn the_scatter_comes_from_the_differences_of_neighbours() {
        let values: Vec<f64> = (0..10).map(|index| if index % 2 == 0 { 1.0 } else { 3.0 }).collect();
        let usual = usual_range(&values).expect("ten values");
        assert!((usual.mean - 2.0).abs() < 1e-12 && (usual.sigma - 1.7725).abs() < 1e-4, "{usual:?}");
        assert_eq!(super::usual_range(&values[..9]), None);
        assert_eq!(find_violations(&[4.0; 12], super::usual_range(&[4.0; 12]).expect("twelve")), []);
    }

    /// A drift of a fifth of the standard deviation per value is detected. With the standard deviation of all values
    /// instead of the estimate, it would not be detected.
    #[test]
    fn a_slow_drift_is_detected() {
        let values: Vec<f64> =
            (0..30).map(|index| 0.2 * f64::from(index) + if index % 2 == 0 { 0.5 } else { -0.5 }).collect();
        let found = find_violations(&values, usual_range(&values).expect("thirty"));
        assert!(
            found.iter().any(|hint| hint.side == Side::Below) && found.iter().any(|hint| hint.side == Side::Above)
        );
    }
}
