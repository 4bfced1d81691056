//! `[scanner_errors]` in the 3D camera's own file: the result of `panelprep calibrate scanner` from scans of a flat
//! board. This module contains both reader and writer.

use super::date::Date;
use super::provenance::{Provenance, line};
use panelprep_base::config::Section;
use panelprep_base::geometry::{DepthField, FIELD_SIZE, FieldRectangle};
use std::ops::RangeInclusive;

/// The 3D camera's own errors in the form of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredScanner {
    /// White noise of a pixel at 700 mm, standard deviation, mm.
    pub white_mm: f64,
    /// The smooth error of one scan, standard deviation, mm.
    pub smooth_mm: f64,
    /// Side of the squares within which the smooth error is the same, mm.
    pub correlation_mm: f64,
    /// The ratio of measured to true distances, minus one, percent.
    pub scale_percent: f64,
    /// Standard deviation of the scale from scan to scan beyond what the smooth error explains, percent.
    pub scale_deviation_percent: f64,
    /// Number of positions of the board.
    pub board_positions: usize,
    /// The error that is the same in each scan, and is corrected; `None` if there is none.
    pub field: Option<DepthField>,
    /// Date of the measurement.
    pub date: Option<Date>,
    /// Program, scans and the residual of each scan from a plane, mm.
    pub provenance: Provenance,
}

/// The name of the errors' table.
const TABLE: &str = "scanner_errors";
const LENGTH_MM: RangeInclusive<f64> = 5.0..=2_000.0;
const ERROR_MM: RangeInclusive<f64> = 0.001..=10.0;
const PERCENT: RangeInclusive<f64> = -10.0..=10.0;
const DIRECTION: RangeInclusive<f64> = -5.0..=5.0;
const FIELD_MM: RangeInclusive<f64> = -50.0..=50.0;

impl MeasuredScanner {
    /// Reads the table, if there is one.
    pub(super) fn parse(top: &Section<'_, '_>) -> Option<Option<Self>> {
        let section = top.section(TABLE);
        if !section.is_present() {
            return Some(None);
        }
        let error = |key| section.parse::<f64>(key, ERROR_MM, None);
        let (white_mm, smooth_mm) = (error("white_mm"), error("smooth_mm"));
        let correlation_mm = section.parse::<f64>("correlation_mm", LENGTH_MM, None);
        let percent = |key| section.parse::<f64>(key, PERCENT, None);
        let (scale_percent, scale_deviation_percent) =
            (percent("scale_percent"), percent("scale_deviation_percent"));
        let places = section.parse::<usize>("places", 1..=10_000, None);
        let field = Self::field(&section);
        let date = section.parse("date", (), Some(None));
        let provenance = Provenance::parse(&section, "residuals_mm");
        section.finish();
        Some(Some(MeasuredScanner {
            white_mm: white_mm?,
            smooth_mm: smooth_mm?,
            correlation_mm: correlation_mm?,
            scale_percent: scale_percent?,
            scale_deviation_percent: scale_deviation_percent?,
            board_positions: places?,
            field: field?,
            date: date?,
            provenance: provenance?,
        }))
    }

    /// Reads the field's three keys: all of them or none.
    fn field(section: &Section<'_, '_>) -> Option<Option<DepthField>> {
        let direction = |key| section.parse::<Option<[f64; 2]>>(key, DIRECTION, Some(None));
        let (from, to) = (direction("field_from"), direction("field_to"));
        let coefficients = section.parse::<Option<[f64; FIELD_SIZE]>>("field_mm", FIELD_MM, Some(None));
        match (from?, to?, coefficients?) {
            (None, None, None) => Some(None),
            (Some(from), Some(to), Some(coefficients_mm)) if from[0] < to[0] && from[1] < to[1] => {
                Some(Some(DepthField { rectangle: FieldRectangle { min: from, max: to }, coefficients_mm }))
            }
            _ => {
                section.problem(
                    "field_mm",
                    "field_from, field_to and field_mm belong together, and field_from must be less than field_to",
                );
                None
            }
        }
    }

    /// Writes the table so that [`MeasuredScanner::parse`] reads it back with identical bits.
    pub(super) fn write(&self, text: &mut String) {
        text.push_str("\n[scanner_errors]\n");
        let numbers = [
            ("white_mm", self.white_mm),
            ("smooth_mm", self.smooth_mm),
            ("correlation_mm", self.correlation_mm),
            ("scale_percent", self.scale_percent),
            ("scale_deviation_percent", self.scale_deviation_percent),
        ];
        numbers.iter().for_each(|(key, number)| line(text, key, Some(format!("{number:?}"))));
        line(text, "places", Some(self.board_positions));
        if let Some(DepthField { rectangle: over, coefficients_mm }) = &self.field {
            line(text, "field_from", Some(format!("{:?}", over.min)));
            line(text, "field_to", Some(format!("{:?}", over.max)));
            line(text, "field_mm", Some(format!("{coefficients_mm:?}")));
        }
        line(text, "date", self.date.as_ref());
        self.provenance.write(text, "residuals_mm");
    }
}

#[cfg(test)]
mod tests {
    use super::super::Intrinsics;
    use super::*;
    use panelprep_base::geometry::PinholeCamera;

    fn lens(errors: MeasuredScanner) -> Intrinsics {
        let camera = PinholeCamera {
            width_px: 1944,
            height_px: 1200,
            fx_px: 1785.0,
            fy_px: 1784.0,
            cx_px: 972.0,
            cy_px: 600.0,
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        };
        Intrinsics { errors: Some(errors), ..Intrinsics::from_camera(camera) }
    }

    fn errors(field: Option<DepthField>) -> MeasuredScanner {
        MeasuredScanner {
            white_mm: 0.054_321,
            smooth_mm: 0.033,
            correlation_mm: 80.0,
            scale_percent: -0.0123,
            scale_deviation_percent: 0.02,
            board_positions: 16,
            field,
            date: None,
            provenance: Provenance { residuals: vec![0.03, 0.04], ..Provenance::default() },
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let over = FieldRectangle { min: [-0.55, -0.34], max: [0.55, 0.34] };
        let field =
            DepthField { rectangle: over, coefficients_mm: std::array::from_fn(|k| 0.1 / (1.0 + k as f64)) };
        for lens in [lens(errors(None)), lens(errors(Some(field)))] {
            assert_eq!(Intrinsics::check("f", &lens.to_toml()), Ok(lens.clone()), "{}", lens.to_toml());
        }
    }

    #[test]
    fn each_mistake_is_named() {
        let text = lens(errors(None)).to_toml();
        let wrong = text.replace("smooth_mm = 0.033", "smooth_mm = 0.0").replace("places", "plaecs");
        let problems = Intrinsics::check("f", &(wrong + "field_from = [0, 0]\n")).expect_err("refused").to_string();
        for words in ["scanner_errors.smooth_mm: found 0.0", "places", "belong together"] {
            assert!(problems.contains(words), "{words}: {problems}");
        }
    }
}
