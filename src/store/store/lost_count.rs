//! The reason why the abrasions of a part cannot be counted: the store was restored from a backup.

use panelprep_base::number_text::utc_day;
use panelprep_cell::record::describe_part;
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

impl LostCount {
    /// Returns whether the statement that another part is in the fixture answers for the part with this serial number.
    /// It does so only for a part without one: a serial number names one part, and a person who states that it is
    /// another part than before does not state how often it was abraded. Only a number of passes answers for it.
    pub fn is_answered_by_another_part(serial: &str) -> bool {
        serial.trim().is_empty()
    }
}

impl fmt::Display for LostCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LostCount { serial, made_unix_s, restored_unix_s } = self;
        let another = if LostCount::is_answered_by_another_part(serial) {
            "that another part than in those cycles is in the fixture (`--another-part`), or "
        } else {
            ""
        };
        let made = made_unix_s.map_or_else(|| "an unknown day".to_owned(), utc_day);
        write!(
            f,
            "it is not known how often {} was abraded: the store was restored on {} from a backup of {made}, and the \
             cycles between them are missing; state at the start {another}the number of passes that this part had in \
             them (`panelprep ctl start --lost-passes NUMBER`, 0 if it had none); if the number is not known, take the \
             part out and let the inspector decide about it",
            describe_part(serial),
            utc_day(*restored_unix_s)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1,800,000,000 s since 1970 is 2027-01-15, 8:00 UTC; a day has 86,400 s.
    #[test]
    fn the_message_states_the_part_both_days_and_the_remedy() {
        let of = |serial: &str, made_unix_s| LostCount {
            serial: serial.to_owned(),
            made_unix_s,
            restored_unix_s: 1_800_086_400,
        };
        let passes = "the number of passes that this part had in them (`panelprep ctl start --lost-passes NUMBER`, 0 if \
                      it had none); if the number is not known, take the part out and let the inspector decide about it";
        let named = "it is not known how often the part SN 1 was abraded: the store was restored on 2027-01-16 from a \
                     backup of 2027-01-15, and the cycles between them are missing; state at the start";
        assert_eq!(of("SN 1", Some(1_800_000_000)).to_string(), format!("{named} {passes}"));
        let without = "it is not known how often a part without a serial number was abraded: the store was restored on \
                       2027-01-16 from a backup of an unknown day, and the cycles between them are missing; state at the \
                       start that another part than in those cycles is in the fixture (`--another-part`), or";
        assert_eq!(of("", None).to_string(), format!("{without} {passes}"));
    }
}
