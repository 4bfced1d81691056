//! The messages between a client and the service: the requests to the cameras, and the header of each answer.

use panelprep_base::verdict::Reason;
use panelprep_devices::cameras::Conditions;
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
        /// Maximum number of pictures per second; at most 100.
        pictures_per_second: f64,
    },
}

impl ShotRequest {
    /// Describes the request for a message.
    pub fn describe(self) -> &'static str {
        match self {
            ShotRequest::Scan => "a scan",
            ShotRequest::Picture => "a picture",
            ShotRequest::Corner => "a picture of the flange camera",
            ShotRequest::Film { .. } => "a film",
        }
    }
}

/// The header of an answer of the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "sent", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum ShotHeader {
    /// A scan: this many bytes of PCD follow.
    Scan {
        /// Their number.
        bytes: usize,
        /// The time at which the shot was taken, s.
        time_s: f64,
        conditions: Conditions,
    },
    /// A picture: the red, green and blue values of each pixel follow the header, row by row.
    Picture { width_px: usize, height_px: usize, time_s: f64, conditions: Conditions },
    /// A film begins; the time is on the same clock as the times of its pictures.
    Began { time_s: f64 },
    /// The film has ended; `dropped` is the number of its pictures that were dropped.
    Ended { dropped: u64 },
    /// The shot failed, or the film has no further picture.
    Failed { reasons: Vec<Reason> },
}
