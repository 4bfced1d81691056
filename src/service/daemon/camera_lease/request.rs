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
        /// Maximum number of pictures per second; 100 at most.
        pictures_per_second: f64,
    },
}

impl ShotRequest {
    /// Returns the request in words for a message.
    pub fn describe(self) -> &'static str {
        match self {
            ShotRequest::Scan => "a scan",
            ShotRequest::Picture => "a picture",
            ShotRequest::Corner => "a picture of the flange camera",
            ShotRequest::Film { .. } => "a film",
        }
    }
}
