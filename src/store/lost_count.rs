//! The reason why the abrasions of a part cannot be counted: the store was restored from a backup.

use crate::number_text::utc_day;
use std::fmt;

/// A part whose abrasions in a lost time no person has stated: the store was restored from a backup, and lacks the
/// cycles after it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LostCount {
    /// The part's serial number; empty for a part without one.
    pub serial: String,
    /// Time at which the backup was made, s since 1970; `None` if an earlier version of this program restored it.
    pub made_unix_s: Option<i64>,
    /// Time at which the restored store was first opened, s since 1970.
    pub restored_unix_s: i64,
}

impl fmt::Display for LostCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LostCount { serial, made_unix_s, restored_unix_s } = self;
        let part = if serial.is_empty() {
            "a part without a serial number".to_owned()
        } else {
            format!("the part {serial}")
        };
        let made = made_unix_s.map_or_else(|| "an unknown day".to_owned(), utc_day);
        write!(
            f,
            "it is not known how often {part} was abraded: the store was restored on {} from a backup of {made}, and the \
             cycles between them are missing; state at the start that another part than in those cycles is in the \
             fixture (`--another-part`), or the number of passes that this part had in them (`--lost-passes`)",
            utc_day(*restored_unix_s)
        )
    }
}
