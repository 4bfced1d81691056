//! Reads and writes the results of two calibrations: of the arm and of the disc.
//!
//! `[robot_correction]`: the arm's deviations from its nominal geometry, measured by `panelprep calibrate robot`.
//! `[removal]`: the material removal of the disc, measured on coupons by `panelprep calibrate removal`.

use super::provenance::{Date, Provenance, line};
use panelprep_base::config::{self, Problems, Section, Setting, settings};
use std::fmt::Write;
use toml::de::DeValue;

/// Number of parameters of a correction that changes the arm's geometry.
pub const GEOMETRY_PARAMETER_COUNT: usize = 32;
/// Number of parameters of a correction that changes smoothly with the position.
pub const SMOOTH_PARAMETER_COUNT: usize = 24;

/// The parameters of a correction, rotations in rad, lengths in mm. `calib::arm_errors` describes each parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CorrectionNumbers {
    /// Errors of the arm's geometry; the axis angles are needed to apply the correction.
    Geometry([f64; GEOMETRY_PARAMETER_COUNT]),
    /// A rigid displacement that changes smoothly with the position of the flange.
    Smooth {
        /// Centre of the measured volume, mm.
        middle_mm: [f64; 3],
        /// Half of the size of the measured volume, mm.
        half_mm: [f64; 3],
        /// The parameters of the smooth displacement.
        numbers: [f64; SMOOTH_PARAMETER_COUNT],
    },
}

impl CorrectionNumbers {
    /// Returns the keyword of this kind in the file.
    pub fn kind(&self) -> &'static str {
        match self {
            CorrectionNumbers::Geometry(_) => "geometry",
            CorrectionNumbers::Smooth { .. } => "smooth",
        }
    }

    fn list(&self) -> &[f64] {
        match self {
            CorrectionNumbers::Geometry(numbers) => numbers,
            CorrectionNumbers::Smooth { numbers, .. } => numbers,
        }
    }
}

/// A correction of the arm, as stored in its file.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotCorrection {
    /// The parameters of the correction.
    pub numbers: CorrectionNumbers,
    /// Cross-validation: error of the omitted pictures without the correction, rms, mm.
    pub left_out_before_mm: f64,
    /// Cross-validation: error of the omitted pictures with the correction, rms, mm.
    pub left_out_after_mm: f64,
    /// Date of the calibration.
    pub date: Option<Date>,
    /// The program, the pictures and the residual of each picture.
    pub provenance: Provenance,
}

const NUMBER: std::ops::RangeInclusive<f64> = -1_000.0..=1_000.0;
const POSITION_RANGE_MM: std::ops::RangeInclusive<f64> = -20_000.0..=20_000.0;
const DEVIATION_RANGE_MM: std::ops::RangeInclusive<f64> = 0.0..=1_000.0;

struct Numbers(Vec<f64>);

impl Setting for Numbers {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().ok_or_else(|| "valid: a list of numbers".to_owned())?;
        list.iter().map(|item| f64::parse(item.get_ref(), &NUMBER)).collect::<Result<_, _>>().map(Numbers)
    }
}

impl RobotCorrection {
    /// Parses and checks the file of a correction.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        config::parse_file(file, text, |top| {
            let correction = Self::parse(&top.section("robot_correction"));
            top.finish();
            correction
        })
    }

    fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let kind = section.parse::<String>("kind", (), None);
        let numbers = section.parse::<Numbers>("numbers", (), None);
        let middle_mm = section.parse::<Option<[f64; 3]>>("middle_mm", POSITION_RANGE_MM, Some(None));
        let half_mm = section.parse::<Option<[f64; 3]>>("half_mm", 1.0..=20_000.0, Some(None));
        let before = section.parse("left_out_before_mm", DEVIATION_RANGE_MM, None);
        let after = section.parse("left_out_after_mm", DEVIATION_RANGE_MM, None);
        let date = section.parse("date", (), Some(None));
        let provenance = Provenance::parse(section, "residuals_mm");
        section.finish();
        let (kind, list, middle_mm, half_mm) = (kind?, numbers?.0, middle_mm?, half_mm?);
        let (as_geometry, as_smooth) = (list.as_slice().try_into().ok(), list.as_slice().try_into().ok());
        let numbers = match (kind.as_str(), as_geometry, as_smooth, middle_mm, half_mm) {
            ("geometry", Some(numbers), ..) => CorrectionNumbers::Geometry(numbers),
            ("smooth", _, Some(numbers), Some(middle_mm), Some(half_mm)) => {
                CorrectionNumbers::Smooth { middle_mm, half_mm, numbers }
            }
            _ => {
                let found = list.len();
                let message = format!(
                    "found {kind} with {found} numbers, valid: geometry with {GEOMETRY_PARAMETER_COUNT}, or smooth with \
                     {SMOOTH_PARAMETER_COUNT}, middle_mm and half_mm"
                );
                section.problem("kind", message);
                return None;
            }
        };
        let (left_out_before_mm, left_out_after_mm) = (before?, after?);
        let (date, provenance) = (date?, provenance?);
        Some(RobotCorrection { numbers, left_out_before_mm, left_out_after_mm, date, provenance })
    }

    /// Returns the text of the file. [`RobotCorrection::check`] reads all numbers back exactly.
    #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
    pub fn to_toml(&self) -> String {
        let mut text = format!("[robot_correction]\nkind = {}\n", toml::Value::from(self.numbers.kind()));
        let _ = writeln!(text, "numbers = {:?}", self.numbers.list());
        if let CorrectionNumbers::Smooth { middle_mm, half_mm, .. } = &self.numbers {
            let _ = writeln!(text, "middle_mm = {middle_mm:?}\nhalf_mm = {half_mm:?}");
        }
        let _ = writeln!(text, "left_out_before_mm = {:?}", self.left_out_before_mm);
        let _ = writeln!(text, "left_out_after_mm = {:?}", self.left_out_after_mm);
        if let Some(date) = &self.date {
            let _ = writeln!(text, "date = {date}");
        }
        self.provenance.write(&mut text, "residuals_mm");
        text
    }
}

settings! {
    /// The parameters of the removal model, which the module `removal` explains.
    pub struct RemovalNumbers {
        /// Preston's coefficient of a new disc, mm²/N.
        preston_mm2_per_n: f64, 1e-9..=10.0, required;
        /// Standard deviation of Preston's coefficient, percent of the coefficient.
        preston_deviation_percent: f64, 0.0..=100.0, required;
        /// The decrease of ln k (wear) for each square metre that the disc sweeps, 1/m².
        wear_per_m2: f64, -100.0..=1_000.0, required;
        /// Standard deviation of the wear, 1/m².
        wear_deviation_per_m2: f64, 0.0..=1_000.0, required;
        /// Correlation between ln k and the wear.
        correlation: f64, -1.0..=1.0, required;
        /// Standard deviation of a single coupon from the model, percent.
        coupon_deviation_percent: f64, 0.0..=100.0, required;
        /// Cross-validation: rms error of omitted coupons that were predicted from the others, percent.
        left_out_percent: f64, 0.0..=1_000.0, required;
        /// Number of coupons of the calibration.
        coupons: usize, 3..=10_000, required;
        /// Smallest force on a coupon, N; `None` if the file does not state it.
        least_force_n: Option<f64>, 0.5..=500.0, default None;
        /// Largest force on a coupon, N; `None` if the file does not state it.
        most_force_n: Option<f64>, 0.5..=500.0, default None;
        /// Exponent of the force in the removed depth; `None` if the coupons do not determine it.
        force_power: Option<f64>, -10.0..=10.0, default None;
        /// 95 % uncertainty of the exponent.
        force_power_uncertainty: Option<f64>, 0.0..=10.0, default None;
        /// Number of discs that sanded the coupons; 0 if the scatter between discs is unknown.
        discs: usize, 0..=10_000, default 0;
        /// Standard deviation between discs, percent.
        disc_deviation_percent: Option<f64>, 0.0..=1_000.0, default None;
        /// The pad's modulus divided by its thickness, N/mm³.
        pad_n_mm3: f64, 1e-4..=1_000.0, required;
        /// Diameter of the orbit, mm; 0 for a disc that does not orbit.
        orbit_mm: f64, 0.0..=50.0, required;
        /// Speed of the orbital motion, revolutions per minute.
        orbit_rev_min: f64, 0.0..=100_000.0, required;
    }
}

/// A removal model, as stored in its file.
#[derive(Debug, Clone, PartialEq)]
pub struct RemovalCalibration {
    /// The parameters of the removal model.
    pub numbers: RemovalNumbers,
    /// Date of the calibration.
    pub date: Option<Date>,
    /// The program, the coupons file and the residuals.
    pub provenance: Provenance,
}

impl RemovalCalibration {
    /// Parses and checks the file of a removal model.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        config::parse_file(file, text, |top| {
            let calibration = Self::parse(&top.section("removal"));
            top.finish();
            calibration
        })
    }

    fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let date = section.parse("date", (), Some(None));
        let provenance = Provenance::parse(section, "residuals_percent");
        // Parses the remaining keys and reports unknown ones.
        let numbers = RemovalNumbers::parse(section);
        Some(RemovalCalibration { numbers: numbers?, date: date?, provenance: provenance? })
    }

    /// Returns the text of a file with these parameters, in the order of [`RemovalNumbers`], and the numbers of coupons
    /// and discs. [`RemovalCalibration::check`] reads all values back exactly, if they are within its ranges; here the
    /// ranges are not checked.
    pub fn to_text(
        numbers: &[(&'static str, f64)],
        (coupons, discs): (usize, usize),
        (date, provenance): (Option<Date>, &Provenance),
    ) -> String {
        let mut text = "[removal]\n".to_owned();
        numbers.iter().for_each(|(key, number)| line(&mut text, key, Some(format!("{number:?}"))));
        line(&mut text, "coupons", Some(coupons));
        line(&mut text, "discs", Some(discs));
        line(&mut text, "date", date);
        provenance.write(&mut text, "residuals_percent");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NUMBERS: [(&str, f64); 15] = [
        ("preston_mm2_per_n", 4.123_456_789e-4),
        ("preston_deviation_percent", 1.25),
        ("wear_per_m2", 0.8),
        ("wear_deviation_per_m2", 0.1),
        ("correlation", 0.7),
        ("coupon_deviation_percent", 3.5),
        ("left_out_percent", 3.9),
        ("least_force_n", 15.0),
        ("most_force_n", 30.0),
        ("force_power", 0.98),
        ("force_power_uncertainty", 0.04),
        ("disc_deviation_percent", 2.5),
        ("pad_n_mm3", 0.05),
        ("orbit_mm", 5.0),
        ("orbit_rev_min", 10_000.0),
    ];

    #[test]
    fn what_is_written_is_read_back() {
        let provenance = Provenance { residuals: vec![1.0, 2.5], ..Provenance::default() };
        let day = Date::from_unix_s(1_764_000_000);
        let text = RemovalCalibration::to_text(&NUMBERS, (12, 4), (Some(day.clone()), &provenance));
        let read = RemovalCalibration::check("removal.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((read.numbers.least_force_n(), read.numbers.most_force_n()), (Some(15.0), Some(30.0)));
        assert_eq!((read.numbers.preston_mm2_per_n(), read.numbers.coupons()), (4.123_456_789e-4, 12));
        assert_eq!((read.numbers.force_power(), read.numbers.disc_deviation_percent()), (Some(0.98), Some(2.5)));
        assert_eq!((read.numbers.discs(), read.numbers.force_power_uncertainty()), (4, Some(0.04)));
        assert_eq!((read.date, read.provenance), (Some(day), provenance));
    }

    #[test]
    fn each_mistake_is_named() {
        let text = RemovalCalibration::to_text(&NUMBERS, (2, 0), (None, &Provenance::default()));
        let wrong = text.replace("orbit_mm = 5.0", "orbit_cm = 0.5").replace("0.05", "0.0");
        let problems = RemovalCalibration::check("f", &wrong).expect_err("refused").to_string();
        for words in [
            "removal.pad_n_mm3: found 0.0, valid: a number from 0.0001 to 1000",
            "removal.coupons: found 2, valid: a whole number from 3 to 10000",
            "removal.orbit_cm: unknown key; this length is in mm: write orbit_mm",
        ] {
            assert!(problems.contains(words), "{words}: {problems}");
        }
    }
}
