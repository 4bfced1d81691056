//! The labels of a clip, and their file `labels.json`.

use panelprep_base::geometry::Pixel;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// The outline of a break from a start time on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Start time of this outline, s of the clip.
    pub from_s: f64,
    /// The corners of the outline, px; the last corner is connected to the first.
    pub corners_px: Vec<[f64; 2]>,
}

/// A place where the film broke.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Break {
    /// Time from which the film is closed again, s of the clip; `None` if it is still open at the end of the clip.
    pub closes_s: Option<f64>,
    /// The outlines in the order of time; the break begins at the start time of the first one.
    pub shapes: Vec<Shape>,
}

/// The labels of a clip, as a person has drawn them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statement {
    /// The name of the person who drew the labels.
    pub author: String,
    /// Whether the person has viewed the whole clip and no film broke.
    pub clean: bool,
    /// The places where the film broke.
    pub breaks: Vec<Break>,
}

impl Break {
    /// Returns whether the break is open at this time, s of the clip.
    pub fn is_open_at(&self, time_s: f64) -> bool {
        let has_begun = self.shapes.first().is_some_and(|first| first.from_s <= time_s);
        has_begun && self.closes_s.is_none_or(|closes_s| time_s < closes_s)
    }

    /// Returns the corners of the break at this time, px; empty before the break begins. The time at which the break
    /// closes is not considered.
    pub fn corners_at(&self, time_s: f64) -> Vec<Pixel> {
        let begun = self.shapes.partition_point(|shape| shape.from_s <= time_s);
        let Some(shape) = begun.checked_sub(1).and_then(|index| self.shapes.get(index)) else { return Vec::new() };
        let corners = || shape.corners_px.iter().copied();
        match self.shapes.get(begun) {
            Some(next) if next.corners_px.len() == shape.corners_px.len() => {
                let share = (time_s - shape.from_s) / (next.from_s - shape.from_s);
                let between = |([u, v], [next_u, next_v]): ([f64; 2], [f64; 2])| {
                    Pixel::at(u + (next_u - u) * share, v + (next_v - v) * share)
                };
                corners().zip(next.corners_px.iter().copied()).map(between).collect()
            }
            _ => corners().map(|[u, v]| Pixel::at(u, v)).collect(),
        }
    }
}

/// The version of the file format that is written; no other version is read.
pub const VERSION: u32 = 1;

/// The contents of `labels.json`, which the [module](super) describes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelFile {
    /// The version of the file format.
    pub version: u32,
    /// The name of the person who drew the labels.
    pub author: String,
    /// The time at which the file was saved, UTC.
    pub saved_at: String,
    /// The hash of the clip to which the labels belong.
    pub clip_sha256: String,
    /// Width and height of the clip's pictures, px.
    pub size_px: [usize; 2],
    /// Whether no film broke.
    pub clean: bool,
    /// The breaks that the person drew.
    pub breaks: Vec<Break>,
}

/// The reason why a label file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum FormError {
    /// The file has another version of the format.
    #[error("the label file has version {found}; this program reads version {VERSION}")]
    Version {
        /// The version in the file.
        found: u32,
    },
    /// The file is not valid JSON, or a key is missing or has a wrong type.
    #[error("the content is not a valid label file: {0}")]
    Syntax(#[from] serde_json::Error),
}

impl LabelFile {
    /// Returns the labels without the data about the file.
    pub fn statement(self) -> Statement {
        Statement { author: self.author, clean: self.clean, breaks: self.breaks }
    }
}

/// Parses a `labels.json`. Whether the labels are consistent with the clip is checked by [`problems`](problems).
///
/// # Errors
/// If the text is not a label file (the error states the line), or the version is not supported.
pub fn read(bytes: &[u8]) -> Result<LabelFile, FormError> {
    #[derive(Deserialize)]
    struct Version {
        version: u32,
    }
    let Version { version } = serde_json::from_slice(bytes)?;
    match version {
        VERSION => Ok(serde_json::from_slice(bytes)?),
        found => Err(FormError::Version { found }),
    }
}

/// Returns the text of the file, with one line for each shape. [`read`] parses it to an equal file.
pub fn write(file: &LabelFile) -> String {
    let LabelFile { version, author, saved_at, clip_sha256, size_px, clean, breaks } = file;
    let shapes = |one: &Break| {
        let lines: Vec<String> = one
            .shapes
            .iter()
            .map(|shape| format!("      {}", json!({"from_s": shape.from_s, "corners_px": shape.corners_px})))
            .collect();
        lines.join(",\n")
    };
    let lines: Vec<String> = breaks
        .iter()
        .map(|one| format!("    {{\"closes_s\": {}, \"shapes\": [\n{}\n    ]}}", json!(one.closes_s), shapes(one)))
        .collect();
    format!(
        "{{\n  \"version\": {version},\n  \"author\": {},\n  \"saved_at\": {},\n  \"clip_sha256\": {},\n  \"size_px\": {},\n  \
         \"clean\": {clean},\n  \"breaks\": [{}]\n}}\n",
        json!(author),
        json!(saved_at),
        json!(clip_sha256),
        json!(size_px),
        if lines.is_empty() { String::new() } else { format!("\n{}\n  ", lines.join(",\n")) },
    )
}
