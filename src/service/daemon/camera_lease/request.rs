//! The messages between a client of the cameras and the service: requests, and the header of each reply.

use panelprep_base::verdict::Reason;
use panelprep_devices::cameras::Conditions;
use serde::{Deserialize, Serialize};

/// The requests that a client can send to the cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum ShotRequest {
    /// A scan by the 3D camera.
    Scan,
    /// A colour picture by the 3D camera.
    Picture,
    /// A picture by the flange camera.
    Corner,
    /// A film: pictures by the 3D camera, one after the other.
    Film {
        /// Maximum number of pictures per second; at most 100.
        pictures_per_second: f64,
    },
}

impl ShotRequest {
    /// Describes the requested shot for a message.
    pub fn describe(self) -> &'static str {
        match self {
            ShotRequest::Scan => "a scan",
            ShotRequest::Picture => "a picture",
            ShotRequest::Corner => "a picture of the flange camera",
            ShotRequest::Film { .. } => "a film",
        }
    }
}

/// The header of a reply of the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "sent", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum ShotHeader {
    /// A scan: this many bytes of PCD follow.
    Scan {
        /// Their number.
        bytes: usize,
        /// The time at which the shot was captured, s.
        time_s: f64,
        conditions: Conditions,
    },
    /// A picture: the red, green and blue values of each pixel follow the header, row by row.
    Picture { width_px: usize, height_px: usize, time_s: f64, conditions: Conditions },
    /// The beginning of a film; the time is on the same clock as the times of its pictures, s.
    Began { time_s: f64 },
    /// The end of a film; `dropped` is the number of its pictures that were dropped.
    Ended { dropped: u64 },
    /// The shot failed, or the film has no further picture.
    Failed { reasons: Vec<Reason> },
}
