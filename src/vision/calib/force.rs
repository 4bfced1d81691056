//! Determines payload and zero of the force sensor, from its measured values without contact at several attitudes of
//! the tool.
//!
//! Without contact, (1) to (3) of `force::gravity` give, with x = a · d,
//!
//! ```text
//! F_reading = zero − m g x                                                                       (1)
//! ```
//!
//! a straight line over x, fitted by least squares. With n measured values, residuals r and s² = Σr² / (n − 2), the
//! variance of the slope is s² / Σ(x − x̄)² and that of the zero s² (1/n + x̄² / Σ(x − x̄)²). The stated uncertainties
//! are these standard errors times the 95 % quantile of Student's distribution for n − 2. They are at least those of a
//! sensor whose only scatter is its resolution. Measured values whose attitudes do not differ enough do not determine
//! the payload and are refused.

use super::health::VerificationLimits;
use panelprep_base::geometry::STANDARD_GRAVITY_M_S2;
use panelprep_base::geometry::statistics::student_95;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Check, LimitSource};
use panelprep_cell::cell::{CompliantTool, Limits};
use panelprep_cell::force::SensorLoad;

/// Minimum number of measured values.
const MIN_READINGS: usize = 3;
/// Minimum range of x over the measured values: 60° about the horizontal.
const MIN_DOWNWARD_RANGE: f64 = 0.5;
/// Uncertainty due to the best resolution of a sensor, 95 %, N: 1.96 · 0.05.
const MIN_RESOLUTION_95_N: f64 = 0.098;
/// Maximum distance of a measured value from the line, N; a value farther away was not measured without contact.
const MAX_RESIDUAL_N: f64 = 3.0;
/// Maximum error of a reading without contact, as a share of the tool's force band (`band_n`).
const MAX_BAND_ERROR_SHARE: f64 = 0.5;

/// A measured force without contact, with the attitude of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeReading {
    /// Downward component of the tool's direction, −1…1: 1 if the tool points straight down.
    pub downwards: f64,
    /// The measured force, N.
    pub force_n: f64,
}

/// The calibrated payload and zero, with the residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceCalibration {
    /// Payload on the sensor.
    pub weight: SensorLoad,
    /// Uncertainty of the payload, 95 %, kg.
    pub payload_95_kg: f64,
    /// Uncertainty of the zero, 95 %, N.
    pub zero_95_n: f64,
    /// Residuals of the force, rms, N.
    pub rms_n: f64,
    /// Number of measured values.
    pub readings: usize,
}

impl ForceCalibration {
    /// Compares the uncertainty of the force, from payload and zero, with the limit of a verification.
    pub fn check_uncertainty(&self, tool: Option<&CompliantTool>) -> Check {
        let known_n = self.zero_95_n + STANDARD_GRAVITY_M_S2 * self.payload_95_kg;
        let check = Check::new("force by payload and zero, 95 %, at the worst attitude", "N", known_n);
        let Some(tool) = tool else { return check };
        let allowed_n = MAX_BAND_ERROR_SHARE * tool.band_n;
        check.with_max(allowed_n, LimitSource::cell("tool.band_n")).or_review("force_uncertain", || {
            let [found, allowed] = distinguishable_texts(known_n, allowed_n, 1);
            format!(
                "the force has an uncertainty of {found} N (limit {allowed} N); take more readings, at attitudes \
                 that differ more"
            )
        })
    }
}

/// Returns the largest force in N that the readings without contact state with the tool's payload and zero; a reading
/// that is not a number is the largest one. `None` if there is no reading.
pub fn largest_error_n(readings: &[AttitudeReading], tool: &CompliantTool) -> Option<f64> {
    let load = SensorLoad::from(tool);
    readings.iter().map(|read| load.contact_n(read.force_n, read.downwards).abs()).max_by(f64::total_cmp)
}

/// Returns the limits for the last verification of a tool's force, in N.
pub fn verification_limits(limits: &Limits, tool: &CompliantTool) -> VerificationLimits {
    VerificationLimits { limit: MAX_BAND_ERROR_SHARE * tool.band_n, ..VerificationLimits::from_limits(limits) }
}

/// The reason why readings do not determine a result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// There are too few measured values.
    #[error("{found} readings were given, at least {MIN_READINGS} at different attitudes are needed")]
    TooFew {
        /// The number of measured values.
        found: usize,
    },
    /// The force or the attitude is not a finite number.
    #[error("reading {index}: the force or the attitude is not a valid number")]
    NotFinite {
        /// Number of the measured value, from 1.
        index: usize,
    },
    /// The attitudes are too similar.
    #[error(
        "the downward component of the tool's direction is {least:.2} to {most:.2} over all readings, but must \
         vary by at least {MIN_DOWNWARD_RANGE}: take one reading pointing down, one level and one pointing up, as \
         far as the arm allows"
    )]
    TooSimilar {
        /// Minimum downward component of the tool's direction.
        least: f64,
        /// Maximum downward component of the tool's direction.
        most: f64,
    },
    /// One measured value deviates from the others.
    #[error(
        "reading {index} differs by {} N from the others (limit {} N); check whether the tool touched something",
        distinguishable_texts(*off_n, MAX_RESIDUAL_N, 1)[0],
        distinguishable_texts(*off_n, MAX_RESIDUAL_N, 1)[1]
    )]
    Outlier {
        /// Number of the measured value, from 1.
        index: usize,
        /// Deviation of the measured value from the line, N.
        off_n: f64,
    },
    /// The payload is physically impossible.
    #[error(
        "the readings give a payload of {payload_kg:.2} kg; check that force and attitude of each reading belong \
         together, and check the sign of the force"
    )]
    Negative {
        /// The calculated payload, kg.
        payload_kg: f64,
    },
}

/// Fits the line (1).
///
/// # Errors
/// If the measured values do not determine payload and zero.
pub fn calibrate(readings: &[AttitudeReading]) -> Result<ForceCalibration, CalibrationError> {
    let n = readings.len() as f64;
    if readings.len() < MIN_READINGS {
        return Err(CalibrationError::TooFew { found: readings.len() });
    }
    let is_number = |reading: &AttitudeReading| reading.downwards.abs() <= 1.000_1 && reading.force_n.is_finite();
    if let Some(index) = readings.iter().position(|reading| !is_number(reading)) {
        return Err(CalibrationError::NotFinite { index: index + 1 });
    }
    let all = || readings.iter().map(|reading| reading.downwards);
    let (lowest, highest) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
    if highest - lowest < MIN_DOWNWARD_RANGE {
        return Err(CalibrationError::TooSimilar { least: lowest, most: highest });
    }
    let (mean_x, mean_n) =
        (all().sum::<f64>() / n, readings.iter().map(|reading| reading.force_n).sum::<f64>() / n);
    let spread: f64 = all().map(|x| (x - mean_x).powi(2)).sum();
    let product: f64 = readings.iter().map(|read| (read.downwards - mean_x) * (read.force_n - mean_n)).sum();
    let slope_n = product / spread;
    let zero_n = mean_n - slope_n * mean_x;
    let off_n = |read: &AttitudeReading| read.force_n - zero_n - slope_n * read.downwards;
    let farthest = readings.iter().map(|read| off_n(read).abs()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((index, off_n)) = farthest.filter(|(_, off_n)| *off_n > MAX_RESIDUAL_N) {
        return Err(CalibrationError::Outlier { index: index + 1, off_n });
    }
    let payload_kg = -slope_n / STANDARD_GRAVITY_M_S2;
    if payload_kg < 0.0 {
        return Err(CalibrationError::Negative { payload_kg });
    }
    let squares: f64 = readings.iter().map(|read| off_n(read).powi(2)).sum();
    let half_n = (student_95(n - 2.0) * (squares / (n - 2.0)).sqrt()).max(MIN_RESOLUTION_95_N);
    Ok(ForceCalibration {
        weight: SensorLoad { payload_kg, zero_n },
        payload_95_kg: half_n / spread.sqrt() / STANDARD_GRAVITY_M_S2,
        zero_95_n: half_n * (1.0 / n + mean_x * mean_x / spread).sqrt(),
        rms_n: (squares / n).sqrt(),
        readings: readings.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::Cell;
    use proptest::prelude::*;

    fn read(downwards: f64, force_n: f64) -> AttitudeReading {
        AttitudeReading { downwards, force_n }
    }

    /// Expected values, calculated by hand: 1 kg and a zero of 2 N give forces of −7.80665 N down, 2 N level and
    /// 11.80665 N up, and Σ(x − x̄)² = 2. With a scatter of 0.05 N the uncertainties are 1.96 · 0.05 / √2 / 9.80665 =
    /// 0.00707 kg and 1.96 · 0.05 / √3 = 0.0566 N.
    #[test]
    fn payload_and_zero_are_found() {
        let found = calibrate(&[read(1.0, -7.806_65), read(0.0, 2.0), read(-1.0, 11.806_65)]).expect("a result");
        assert!((found.weight.payload_kg - 1.0).abs() < 1e-9 && (found.weight.zero_n - 2.0).abs() < 1e-9);
        assert!((found.payload_95_kg - 0.007_07).abs() < 1e-5, "{found:?}");
        assert!((found.zero_95_n - 0.056_6).abs() < 1e-4, "{found:?}");
    }

    /// A reading that is not a number is no evidence that the tool's payload and zero are right.
    #[test]
    fn a_reading_that_is_not_a_number_is_the_largest_error() {
        let cell =
            Cell::check("cell.toml", "[tool]\nkind = 'simulated'\npayload_kg = 1.0\nzero_n = 2.0\n").expect("good");
        let tool = cell.tool().compliant().expect("compliant");
        let largest = |readings: &[AttitudeReading]| largest_error_n(readings, tool);
        assert!((largest(&[read(1.0, -7.806_65), read(0.0, 2.5)]).expect("readings") - 0.5).abs() < 1e-9);
        assert!(largest(&[read(1.0, f64::NAN), read(0.0, 2.5)]).expect("readings").is_nan());
        assert_eq!(largest(&[]), None);
    }

    /// Expected values, calculated by hand: if the middle value has an error of 0.3 N, the three values deviate from
    /// their line by −0.1, 0.2 and −0.1 N, so s² = 0.06 / 1. Student's quantile for 1 degree of freedom is 12.706, so
    /// the uncertainty of the zero is 12.706 · 0.24495 / √3 = 1.797 N.
    #[test]
    fn three_scattered_readings_have_a_large_uncertainty() {
        let found = calibrate(&[read(1.0, -7.806_65), read(0.0, 2.3), read(-1.0, 11.806_65)]).expect("a result");
        assert!((found.zero_95_n - 1.797).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn readings_that_determine_no_result_are_refused() {
        let says = |readings: &[AttitudeReading]| calibrate(readings).expect_err("refused").to_string();
        assert!(says(&[read(1.0, 1.0), read(0.0, 2.0)]).starts_with("2 readings"));
        assert!(says(&[read(1.0, 1.0), read(0.9, 2.0), read(0.8, 2.0)]).contains("0.80 to 1.00"));
        assert!(says(&[read(1.0, 1.0), read(f64::NAN, 2.0), read(0.0, 2.0)]).starts_with("reading 2"));
        let touched = [read(1.0, -8.0), read(0.5, -3.0), read(0.0, 22.0), read(-1.0, 12.0)];
        assert!(says(&touched).starts_with("reading 3 differs by 14.9 N"), "{}", says(&touched));
        assert!(says(&[read(1.0, 12.0), read(0.0, 2.0), read(-1.0, -8.0)]).contains("payload of -1.0"));
    }

    proptest! {
        /// With noise, the error of the result is less than three times the stated uncertainty.
        #[test]
        fn the_true_value_is_near_the_result(
            payload_kg in 0.2..8.0_f64,
            zero_n in -5.0..5.0_f64,
            noise in prop::collection::vec(-0.05..0.05_f64, 7),
        ) {
            let truth = SensorLoad { payload_kg, zero_n };
            let at = |(index, noise_n): (usize, &f64)| {
                let downwards = 1.0 - index as f64 / 3.0;
                read(downwards, truth.zero_n - truth.weight_force_n(downwards) + noise_n)
            };
            let readings: Vec<AttitudeReading> = noise.iter().enumerate().map(at).collect();
            let found = calibrate(&readings).expect("a result");
            prop_assert!((found.weight.payload_kg - payload_kg).abs() <= 3.0 * found.payload_95_kg);
            prop_assert!((found.weight.zero_n - zero_n).abs() <= 3.0 * found.zero_95_n);
        }
    }
}
