//! `[robot_correction]`: how the arm differs from its nominal geometry, as measured by `panelprep calibrate robot`.

use super::date::Date;
use super::provenance::Provenance;
use panelprep_base::config::{self, Problems, Section, Setting};
use std::fmt::Write;
use toml::de::DeValue;

/// Number of parameters of a correction by the arm's geometry.
pub const GEOMETRY_NUMBERS: usize = 32;
/// Number of parameters of a smooth correction.
pub const SMOOTH_NUMBERS: usize = 24;

/// The numbers of a correction, rotations in rad, lengths in mm; `calib::robot_correction` describes each of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CorrectionNumbers {
    /// Errors of the arm's geometry: the axis angles are needed to apply them.
    Geometry([f64; GEOMETRY_NUMBERS]),
    /// A motion that changes smoothly with the flange's position.
    Smooth {
        /// The middle of the measured volume, mm.
        middle_mm: [f64; 3],
        /// Half the size of that volume, mm.
        half_mm: [f64; 3],
        /// Its numbers.
        numbers: [f64; SMOOTH_NUMBERS],
    },
}

impl CorrectionNumbers {
    /// Returns the file's keyword for this kind.
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

/// A correction in the form of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotCorrection {
    /// Its numbers.
    pub numbers: CorrectionNumbers,
    /// Error of left-out pictures without the correction, rms, mm.
    pub left_out_before_mm: f64,
    /// Error of left-out pictures with the correction, rms, mm.
    pub left_out_after_mm: f64,
    /// Date of the calibration.
    pub date: Option<Date>,
    /// Program, pictures and their residuals.
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
    /// Checks the text of a correction's file.
    ///
    /// # Errors
    /// Every problem with its line and key.
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
                    "found {kind} with {found} numbers, valid: geometry with {GEOMETRY_NUMBERS}, or smooth with \
                     {SMOOTH_NUMBERS}, middle_mm and half_mm"
                );
                section.problem("kind", message);
                return None;
            }
        };
        let (left_out_before_mm, left_out_after_mm) = (before?, after?);
        let (date, provenance) = (date?, provenance?);
        Some(RobotCorrection { numbers, left_out_before_mm, left_out_after_mm, date, provenance })
    }

    /// Returns the text of a file that [`RobotCorrection::check`] reads back with identical bits.
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
