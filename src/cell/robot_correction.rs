//! `[robot_correction]`: how the arm differs from its drawing, as `panelprep calibrate robot` found it.

use super::calibration::Provenance;
use super::date::Date;
use crate::config::{self, Problems, Section, Setting};
use std::fmt::Write;
use toml::de::DeValue;

/// A correction as its file holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotCorrection {
    /// `geometry` or `smooth`.
    pub kind: String,
    /// Its numbers, turns in rad, lengths in mm.
    pub numbers: Vec<f64>,
    /// Of a smooth one: the middle of the measured volume, mm.
    pub middle_mm: Option<[f64; 3]>,
    /// Of a smooth one: half the size of that volume, mm.
    pub half_mm: Option<[f64; 3]>,
    /// What left-out pictures were off without it, rms, mm.
    pub left_out_before_mm: f64,
    /// What they are off with it.
    pub left_out_after_mm: f64,
    /// When.
    pub date: Option<Date>,
    /// Program, pictures and their residuals.
    pub provenance: Provenance,
}

const NUMBER: std::ops::RangeInclusive<f64> = -1_000.0..=1_000.0;
const PLACE_MM: std::ops::RangeInclusive<f64> = -20_000.0..=20_000.0;
const OFF_MM: std::ops::RangeInclusive<f64> = 0.0..=1_000.0;

struct Numbers(Vec<f64>);

impl Setting for Numbers {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().ok_or_else(|| "allowed is a list of numbers".to_owned())?;
        list.iter().map(|item| f64::parse(item.get_ref(), &NUMBER)).collect::<Result<_, _>>().map(Numbers)
    }
}

impl RobotCorrection {
    /// Checks the text of a correction's file.
    ///
    /// # Errors
    /// Every problem with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        config::check(file, text, |top| {
            let correction = Self::take(&top.section("robot_correction"));
            top.done();
            correction
        })
    }

    fn take(section: &Section<'_, '_>) -> Option<Self> {
        let kind = section.take::<String>("kind", (), None);
        let numbers = section.take::<Numbers>("numbers", (), None);
        let middle_mm = section.take::<Option<[f64; 3]>>("middle_mm", PLACE_MM, Some(None));
        let half_mm = section.take::<Option<[f64; 3]>>("half_mm", 1.0..=20_000.0, Some(None));
        let before = section.take("left_out_before_mm", OFF_MM, None);
        let after = section.take("left_out_after_mm", OFF_MM, None);
        let date = section.take("date", (), Some(None));
        let provenance = Provenance::take(section, "residuals_mm");
        section.done();
        let (kind, numbers, middle_mm, half_mm) = (kind?, numbers?.0, middle_mm?, half_mm?);
        let is_whole = match kind.as_str() {
            "geometry" => numbers.len() == 32,
            "smooth" => numbers.len() == 24 && middle_mm.is_some() && half_mm.is_some(),
            _ => false,
        };
        if !is_whole {
            section.problem(
                "kind",
                format!(
                    "found {kind} with {} numbers, allowed is geometry with 32, or smooth with 24, middle_mm and half_mm",
                    numbers.len()
                ),
            );
            return None;
        }
        let (left_out_before_mm, left_out_after_mm) = (before?, after?);
        let (date, provenance) = (date?, provenance?);
        Some(RobotCorrection {
            kind,
            numbers,
            middle_mm,
            half_mm,
            left_out_before_mm,
            left_out_after_mm,
            date,
            provenance,
        })
    }

    /// The file that [`RobotCorrection::check`] reads back to the last bit.
    pub fn to_toml(&self) -> String {
        let mut text = format!("[robot_correction]\nkind = {}\n", toml::Value::from(self.kind.as_str()));
        // Writing to a `String` cannot fail.
        let _ = writeln!(text, "numbers = {:?}", self.numbers);
        for (key, place) in [("middle_mm", self.middle_mm), ("half_mm", self.half_mm)] {
            if let Some(place) = place {
                let _ = writeln!(text, "{key} = {place:?}");
            }
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
