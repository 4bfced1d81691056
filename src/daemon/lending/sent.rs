//! The head of what the service sends.

use crate::devices::cameras::Conditions;
use crate::verdict::Reason;
use serde::{Deserialize, Serialize};

/// The head of what the service sends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "sent", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Sent {
    /// A scan: this many bytes of PCD follow.
    Scan {
        /// Their number.
        bytes: usize,
        /// When it was taken, s.
        time_s: f64,
        conditions: Conditions,
    },
    /// A picture: red, green and blue of each pixel follow, row by row.
    Picture { width_px: usize, height_px: usize, time_s: f64, conditions: Conditions },
    /// A film begins; the time is on its pictures' clock.
    Began { time_s: f64 },
    /// It has ended; this many of its pictures were dropped.
    Ended { dropped: u64 },
    /// There is no shot, or no further one.
    Failed { reasons: Vec<Reason> },
}
