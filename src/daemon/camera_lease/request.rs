//! The possible requests to the cameras.

use serde::{Deserialize, Serialize};

/// The possible requests to the cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum ShotRequest {
    /// A scan of the 3D camera.
    Scan,
    /// A colour picture of the 3D camera.
    Picture,
    /// A picture of the flange camera.
    Corner,
    /// Pictures of the 3D camera, one after the other.
    Film {
        /// At most this many a second, and at most 100.
        pictures_per_second: f64,
    },
}

impl ShotRequest {
    /// Returns the request as text.
    pub fn word(self) -> &'static str {
        match self {
            ShotRequest::Scan => "a scan",
            ShotRequest::Picture => "a picture",
            ShotRequest::Corner => "a picture of the flange camera",
            ShotRequest::Film { .. } => "a film",
        }
    }
}
