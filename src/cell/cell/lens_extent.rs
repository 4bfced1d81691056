//! The contents of a lens's file besides its numbers: its model, the coefficients that were left out, and the part
//! of the picture in which it is known.

use super::provenance::TextList;
use panelprep_base::config::{Section, Setting};
use panelprep_base::geometry::{Pixel, polygon};
use std::fmt::Write;
use toml::de::DeValue;

/// The part of the picture in which a lens is calibrated to a stated error.
#[derive(Debug, Clone, PartialEq)]
pub struct SupportedArea {
    /// The error, 95 %, px.
    pub error_px: f64,
    /// The outline of the part; if it has no corners, the part is empty.
    pub outline_px: Vec<Pixel>,
}

impl SupportedArea {
    /// Returns whether the lens is calibrated at this pixel.
    pub fn contains_pixel(&self, pixel: Pixel) -> bool {
        polygon::contains(&self.outline_px, pixel)
    }
}

/// Model and support of a lens; all values may be absent, as in files of other programs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LensExtent {
    /// The coefficients of the lens model, such as `k1k2`.
    pub model: Option<String>,
    /// Each coefficient that was left out, with the reason.
    pub excluded_coefficients: Vec<String>,
    /// The part in which the lens is known; `None` for the whole picture.
    pub supported: Option<SupportedArea>,
}

impl LensExtent {
    /// Returns whether the lens is calibrated at this pixel.
    pub fn contains_pixel(&self, pixel: Pixel) -> bool {
        self.supported.as_ref().is_none_or(|supported| supported.contains_pixel(pixel))
    }

    pub(super) fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let model = section.parse::<Option<String>>("model", (), Some(None));
        let left_out = section.parse("left_out", (), Some(TextList::default()));
        let error_px = section.parse::<Option<f64>>("supported_error_px", ERROR_PX, Some(None));
        let outline = section.parse::<Option<Outline>>("supported_px", (), Some(None));
        let supported = match (error_px?, outline?) {
            (Some(error_px), Some(Outline(outline_px))) => Some(SupportedArea { error_px, outline_px }),
            (None, None) => None,
            _ => {
                section.problem("supported_px", "supported_px and supported_error_px belong together");
                return None;
            }
        };
        Some(LensExtent { model: model?, excluded_coefficients: left_out?.0, supported })
    }

    #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
    pub(super) fn to_toml(&self) -> String {
        let mut text = String::new();
        // Writing to a `String` cannot fail.
        if let Some(model) = &self.model {
            let _ = writeln!(text, "model = {}", toml::Value::from(model.as_str()));
        }
        if !self.excluded_coefficients.is_empty() {
            let _ = writeln!(text, "left_out = {}", toml::Value::from(self.excluded_coefficients.clone()));
        }
        if let Some(SupportedArea { error_px, outline_px }) = &self.supported {
            let corners: Vec<[f64; 2]> = outline_px.iter().map(|pixel| [pixel.u, pixel.v]).collect();
            let _ = writeln!(text, "supported_error_px = {error_px:?}\nsupported_px = {corners:?}");
        }
        text
    }
}

const ERROR_PX: std::ops::RangeInclusive<f64> = 0.0..=100.0;
const CORNER_PX: std::ops::RangeInclusive<f64> = -20_000.0..=40_000.0;

struct Outline(Vec<Pixel>);

impl Setting for Outline {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().ok_or_else(|| "valid: a list of [u, v]".to_owned())?;
        let corner = |item: &toml::Spanned<DeValue<'_>>| {
            <[f64; 2]>::parse(item.get_ref(), &CORNER_PX).map(|[u, v]| Pixel::at(u, v))
        };
        list.iter().map(corner).collect::<Result<_, _>>().map(Outline)
    }
}
