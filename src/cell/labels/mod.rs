//! A person's statement about a clip: where and when the film broke, as polygons over time, and the mask and the times
//! that follow from it.
//!
//! A break has one or more shapes, each from its own time on. A shape applies until the next one begins. Between two
//! shapes with the same number of corners, corner i moves in a straight line and at a constant speed from its position
//! in the first shape to its position in the second. A break that closes again still counts in the mask: the mask
//! contains all that broke, not only what is still open.
//!
//! Corners are pixels of the clip's pictures, whole numbers at pixel centres; times are those of `clip.csv`, s.
//! Nothing here reads a disk or a clock.
//!
//! `labels.json`, version 1, is one object:
//!
//! | Key | Meaning |
//! |---|---|
//! | `version` | 1 |
//! | `author` | the person's name |
//! | `saved_at` | date and time of the saving, UTC |
//! | `clip_sha256` | SHA-256 of the output of `sha256sum clip.csv FILE…` for the clip's list and its pictures in the list's order |
//! | `size_px` | columns and rows of the pictures |
//! | `clean` | `true`: the person has looked at the whole clip and nothing broke; then there is no break |
//! | `breaks` | the breaks: `closes_s` is the time from which on the film is closed again, or `null`; `shapes` in the order of time, each with `from_s` and `corners_px`, a list of `[u, v]` |

mod broken;
mod check;
mod statement;

#[cfg(test)]
mod tests;

pub use broken::{BrokenPixels, broken_pixels, decoded, time_to_color};
pub use check::{ClipFrame, MAX_SINCE_WET_S, Problem, problems};
pub use statement::{Break, FormError, LabelFile, Shape, Statement, VERSION, read, write};

/// The labels' file.
pub const LABELS: &str = "labels.json";
/// The labels that a person has not saved yet, in the same format.
pub const DRAFT_FILE: &str = "labels.draft.json";
/// The file of the mask: the pixels that broke by the clip's end are white.
pub const MASK: &str = "mask.png";
/// The file of the times: see [`time_to_color`].
pub const TIMES_FILE: &str = "times.png";
