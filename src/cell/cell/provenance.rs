//! The origin of a calibration's numbers: the program, the pictures, and the residual of each picture.

use panelprep_base::config::{Section, Setting};
use std::fmt::Write;
use std::ops::RangeInclusive;
use toml::de::DeValue;

/// The origin of a calibration's numbers; every key may be absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Provenance {
    /// The program that made the file, with its version.
    pub program: Option<String>,
    /// SHA-256 of each picture or points file that was used.
    pub pictures: Vec<String>,
    /// The residual of each picture or points file, in the same order: px for intrinsics, mm for a mount.
    pub residuals: Vec<f64>,
}

impl Provenance {
    pub(super) fn parse(section: &Section<'_, '_>, residuals: &'static str) -> Option<Self> {
        let program = section.parse("program", (), Some(None));
        let pictures = section.parse("pictures", (), Some(TextList::default()));
        let residuals = section.parse(residuals, (), Some(Numbers::default()));
        Some(Provenance { program: program?, pictures: pictures?.0, residuals: residuals?.0 })
    }

    pub(super) fn write(&self, text: &mut String, residuals: &str) {
        line(text, "program", self.program.as_ref().map(|program| toml::Value::from(program.as_str())));
        if !self.pictures.is_empty() {
            line(text, "pictures", Some(toml::Value::from(self.pictures.clone())));
        }
        if !self.residuals.is_empty() {
            line(text, residuals, Some(format!("{:?}", self.residuals)));
        }
    }
}

/// A list of texts.
#[derive(Default)]
pub(super) struct TextList(pub(super) Vec<String>);

impl Setting for TextList {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().map(|list| list.iter().map(|item| String::parse(item.get_ref(), &())));
        let list = list.ok_or_else(|| "valid: a list of texts".to_owned())?;
        list.collect::<Result<_, _>>().map(TextList)
    }
}

/// A list of residuals.
#[derive(Default)]
struct Numbers(Vec<f64>);

impl Setting for Numbers {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().map(|list| list.iter().map(|item| f64::parse(item.get_ref(), &RESIDUALS)));
        let list = list.ok_or_else(|| "valid: a list of numbers".to_owned())?;
        list.collect::<Result<_, _>>().map(Numbers)
    }
}

/// The allowed residuals: a picture that was set aside may have a large residual.
const RESIDUALS: RangeInclusive<f64> = 0.0..=100_000.0;

pub(super) fn line(text: &mut String, key: &str, value: Option<impl std::fmt::Display>) {
    if let Some(value) = value {
        #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
        let _ = writeln!(text, "{key} = {value}");
    }
}
