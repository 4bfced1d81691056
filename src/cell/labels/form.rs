//! Reads and writes `labels.json` as text.

use super::shapes::{Break, Statement};
use serde::{Deserialize, Serialize};
use serde_json::json;

/// The version of the file format that is written, and the only one that is read.
pub const VERSION: u32 = 1;

/// The content of the label file: see the [module](super).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelFile {
    /// The version of the file format.
    pub version: u32,
    /// The person's name.
    pub author: String,
    /// The time at which the file was saved, UTC.
    pub saved_at: String,
    /// The hash of the clip.
    pub clip_sha256: String,
    /// Columns and rows of the clip's pictures.
    pub size_px: [usize; 2],
    /// Whether no film broke.
    pub clean: bool,
    /// The marked breaks.
    pub breaks: Vec<Break>,
}

/// The reason why a file is not a label file.
#[derive(Debug, thiserror::Error)]
pub enum FormError {
    /// The file has another format version.
    #[error("the label file has version {found}; this program reads version {VERSION}")]
    Version {
        /// The version in the file.
        found: u32,
    },
    /// The file is not a valid JSON object.
    #[error("the content is not a valid label file: {0}")]
    Syntax(#[from] serde_json::Error),
}

impl LabelFile {
    /// The person's statement.
    pub fn statement(self) -> Statement {
        Statement { author: self.author, clean: self.clean, breaks: self.breaks }
    }
}

/// Reads a `labels.json`. Whether the labels fit the clip is not checked: see [`problems`](super::problems).
///
/// # Errors
/// If the file does not contain such an object, with the line, or has another version.
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

/// Returns the file's text. Reading this text gives an equal file. Each shape is one line.
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
