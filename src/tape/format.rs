//! The number of a recording's form, and the names of the records that belong to none of its topics.

/// What a recording's records mean. Another number is another meaning, and is not read.
///
/// 2: pictures have the camera's time, what was computed has its moment, a recording may begin with a service's cycle.
/// 3: points have an alpha channel, and the lenses are there: both for those who look at it. What 2 says is read as before.
/// 4: a compliant tool has a topic of its own. What 2 and 3 say is read as before.
pub const FORMAT: u32 = 4;
/// The oldest that is read.
pub const OLDEST_FORMAT: u32 = 2;

/// Names of the metadata records, of the attachment that says how the loop began, and of the files beside it.
pub(super) const METADATA: &str = "panelprep";
pub(super) const END: &str = "panelprep.end";
pub(super) const START: &str = "start.json";
