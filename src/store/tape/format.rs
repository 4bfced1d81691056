//! The number of a recording's format, and the names of the records that belong to none of its topics.

/// The meaning of a recording's records. A recording with another number has another meaning, and is not read.
///
/// 2: pictures have the camera's time, computed results have their time, a recording may begin with a cycle of a
/// running service. 3: points have an alpha channel, and the lenses are included: both for people who view the
/// recording. The content of 2 is read as before. 4: a compliant tool has its own topic. The content of 2 and 3 is
/// read as before.
pub const FORMAT: u32 = 4;
/// The oldest format that can be read.
pub const OLDEST_FORMAT: u32 = 2;

/// Names of the metadata records, of the attachment that states how the loop began, and of the files beside it.
pub(super) const METADATA: &str = "panelprep";
pub(super) const END: &str = "panelprep.end";
pub(super) const START: &str = "start.json";
