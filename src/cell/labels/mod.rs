//! The labels of a clip, drawn by a person: where and when the film broke, as polygons over time; and the mask and the
//! times that are computed from them.
//!
//! A break has one or more shapes, each with a start time. A shape is valid until the next shape starts. Between two
//! shapes with the same number of corners, each corner moves in a straight line at constant speed from its position in
//! the first shape to its position in the second. A break that closes again is still part of the mask: the mask
//! contains everything that broke before the end of the clip.
//!
//! Corners are pixels of the clip's pictures, with whole numbers at the pixel centres. Times are those of `clip.csv`,
//! s. This module uses no disk and no clock.
//!
//! `labels.json`, version 1, contains one object:
//!
//! | Key | Meaning |
//! |---|---|
//! | `version` | 1 |
//! | `author` | the name of the person who drew the labels |
//! | `saved_at` | date and time at which the labels were saved, UTC |
//! | `clip_sha256` | SHA-256 of the output of `sha256sum clip.csv FILE…` for the clip's list and its pictures in the
//! list's order |
//! | `size_px` | width and height of the pictures |
//! | `clean` | `true`: the person has viewed the whole clip and no film broke; then there are no breaks |
//! | `breaks` | the breaks: `closes_s` is the time from which the film is closed again, or `null`; `shapes`, in the
//! order of time, each with `from_s` and `corners_px`, a list of `[u, v]` |

mod broken;
mod check;
mod statement;

#[cfg(test)]
mod tests;

pub use broken::{BrokenPixels, broken_pixels, color_to_time, time_to_color};
pub use check::{ClipFrame, MAX_SINCE_WET_S, Problem, problems};
pub use statement::{Break, FormError, LabelFile, Shape, Statement, VERSION, read, write};

/// The file of saved labels.
pub const LABELS: &str = "labels.json";
/// The file of labels that the person has not saved yet, in the same format.
pub const DRAFT_FILE: &str = "labels.draft.json";
/// The file of the mask, in which the pixels that broke before the end of the clip are white.
pub const MASK: &str = "mask.png";
/// The file of the times at which the pixels broke, encoded by [`time_to_color`].
pub const TIMES_FILE: &str = "times.png";
