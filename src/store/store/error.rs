//! The errors of the store. Also the error about a part whose number of sanding passes is unknown after the store was
//! restored from a backup.

use panelprep_base::number_text::utc_day;
use panelprep_cell::record::describe_part;
use std::fmt;
use std::path::{Path, PathBuf};

/// The reason why data cannot be stored or read.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// An operation on a file or folder failed.
    #[error("cannot {operation} {}: {source}", path.display())]
    File {
        /// The operation that failed.
        operation: &'static str,
        /// The path of the file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A statement of the database failed.
    #[error("cannot {operation} the store {}: {problem}", path.display())]
    Database {
        /// The operation that failed.
        operation: &'static str,
        /// The path of the database.
        path: PathBuf,
        /// The error of SQLite.
        problem: String,
    },
    /// There is no store at this path.
    #[error("no store found in {}; teach a panel first (`panelprep teach` creates the store), or name the folder \
             of the store", path.display())]
    Missing {
        /// The folder without a store.
        path: PathBuf,
    },
    /// Another process is writing to the store.
    #[error("{holder} is writing to the store {}; stop that process first, or name another store", path.display())]
    Leased {
        /// The folder of the store.
        path: PathBuf,
        /// The other process, such as "process 1234".
        holder: String,
    },
    /// The store was opened for reading only.
    #[error("the store {} is open for reading only", path.display())]
    ReadOnly {
        /// The path of the database.
        path: PathBuf,
    },
    /// SQLite reports that the database is damaged.
    #[error("the store {} is damaged: {problem}; restore it from a copy", path.display())]
    Damaged {
        /// The path of the database.
        path: PathBuf,
        /// The report of SQLite.
        problem: String,
    },
    /// The journal is damaged or was changed.
    #[error("the journal of {} is damaged at line {sequence}: {problem}; restore the store from a copy", path.display())]
    DamagedJournal {
        /// The path of the database.
        path: PathBuf,
        /// The damaged line, from 1; 0 if the damage belongs to no line.
        sequence: i64,
        /// How the line differs from what was written.
        problem: String,
    },
    /// An earlier append to the journal failed.
    #[error("an earlier write to the journal of {} failed, so nothing more is written; restart the program", path.display())]
    JournalInDoubt {
        /// The path of the database.
        path: PathBuf,
    },
    /// The motion to close is not open.
    #[error("the store has no open {motion}")]
    MotionNotOpen {
        /// The motion, as text.
        motion: String,
    },
    /// The verification does not exist.
    #[error("the store {} has no verification {number}; `panelprep calibrate history` lists the verifications", path.display())]
    UnknownVerification {
        /// The path of the database.
        path: PathBuf,
        /// The requested number.
        number: i64,
    },
    /// The verification is already struck out.
    #[error("verification {number} of the store {} is already struck out, by {by}", path.display())]
    AlreadyStruck {
        /// The path of the database.
        path: PathBuf,
        /// Number of the verification.
        number: i64,
        /// The person who struck out the verification.
        by: String,
    },
    /// The cycle does not exist, or has already ended.
    #[error("the store {} has no {what} {id}", path.display())]
    UnknownCycle {
        /// The path of the database.
        path: PathBuf,
        /// What was expected: "cycle" or "running cycle".
        what: &'static str,
        /// Number of the requested cycle.
        id: i64,
    },
    /// The number of sanding passes on a part is unknown.
    #[error("{0}")]
    CountUnknown(UnknownPassCount),
    /// A row cannot be decoded.
    #[error("a row of the store {} cannot be decoded: {problem}; restore the store from a copy", path.display())]
    Unreadable {
        /// The path of the database.
        path: PathBuf,
        /// The problem of the row.
        problem: String,
    },
    /// A number is NaN or infinite, which JSON cannot represent.
    #[error("the value '{name}' is NaN or infinite; store None for a value that was not measured")]
    NotFinite {
        /// Name of the value.
        name: String,
    },
    /// The store was written by a newer version of this program, or by a build before the first release, whose schemas
    /// had other numbers.
    #[error(
        "the store {} has schema {found}, this program supports schemas up to {known}: a newer version wrote it, or a \
         build before the first release. Use the program that wrote it, or another folder",
        path.display()
    )]
    Newer {
        /// The path of the database.
        path: PathBuf,
        /// Schema version of the store.
        found: i64,
        /// Newest schema version that this program supports.
        known: i64,
    },
    /// The store was written by an earlier version of this program and is not yet updated.
    #[error(
        "the store {} has schema {found}, this program needs schema {known}. Start the service once (`panelprep \
         run`): it keeps a copy of the database and updates it. Then try again",
        path.display()
    )]
    Older {
        /// The folder of the store.
        path: PathBuf,
        /// Schema version of the store.
        found: i64,
        /// The schema version of this program.
        known: i64,
    },
    /// The database was written by another program.
    #[error("{} is a database of another program; name another folder", path.display())]
    Foreign {
        /// The path of the database.
        path: PathBuf,
    },
    /// A stored file is damaged or was changed.
    #[error("{} is damaged: its SHA-256 is {found}; restore it from a copy, or delete it and teach again", path.display())]
    DamagedBlob {
        /// The path of the file; its name is the expected hash.
        path: PathBuf,
        /// The hash of the file's present content.
        found: String,
    },
    /// A stored version of a taught panel is damaged or was changed.
    #[error("version {version} of the taught panel '{name}' is damaged: {problem}; teach the panel again")]
    DamagedRow {
        /// Name of the panel.
        name: String,
        /// The damaged version.
        version: String,
        /// How the version differs from what was written.
        problem: String,
    },
    /// The flange pose of a taught corner is NaN or infinite.
    #[error("corner {corner} has a flange pose with NaN or infinite values; teach the corner again")]
    Pose {
        /// Number of the corner, from 1.
        corner: usize,
    },
    /// No panel with this name was taught.
    #[error("no panel '{name}' was taught; {}", describe_known_names(nearest.as_deref(), known))]
    UnknownPanel {
        /// The requested name.
        name: String,
        /// The most similar name of a taught panel.
        nearest: Option<String>,
        /// The names of all taught panels.
        known: Vec<String>,
    },
    /// The panel does not have this version.
    #[error("the panel '{name}' has no version {version}; versions, oldest first: {}", known.join(", "))]
    UnknownVersion {
        /// Name of the panel.
        name: String,
        /// The requested version.
        version: String,
        /// All versions of the panel.
        known: Vec<String>,
    },
    /// A text of a person's signature is invalid.
    #[error("the signature's {what} is \"{found}\": {problem}")]
    Unsignable {
        /// The invalid field: "name", "user", "remark" or the name of a stated value.
        what: &'static str,
        /// The invalid text.
        found: String,
        /// The problem of the text, and the valid values.
        problem: String,
    },
    /// The person has already signed the record with this meaning.
    #[error("{name} has already signed the record of cycle {cycle} as {meaning}, {at}")]
    AlreadySigned {
        /// Name of the person.
        name: String,
        /// Number of the cycle.
        cycle: i64,
        /// The meaning of the signature.
        meaning: &'static str,
        /// Time of the signature.
        at: String,
    },
    /// The record cannot be signed with this meaning.
    #[error("the record of cycle {cycle} cannot be signed as \"{meaning}\": {problem}")]
    MeaningNotPermitted {
        /// Number of the cycle.
        cycle: i64,
        /// The meaning of the signature.
        meaning: &'static str,
        /// The reason, and what to do.
        problem: String,
    },
    /// Another process signed at the same time, in every attempt.
    #[error("the record cannot be signed: other processes signed in the store {} at the same time, in ten \
             attempts; try again", path.display())]
    SignedMeanwhile {
        /// The path of the database.
        path: PathBuf,
    },
    /// A key or a statement cannot be used for signing.
    #[error("{}: {source}", path.display())]
    Signing {
        /// The path of the database, or of the key's file.
        path: PathBuf,
        /// The problem of the key or of the statement.
        source: crate::signing::SigningError,
    },
    /// The disk is full.
    #[error("the disk of the store {} is full ({free}, minimum {minimum_mb} MB); {advice}", path.display())]
    Full {
        /// The folder of the store.
        path: PathBuf,
        /// The free space as text, or why it is unknown.
        free: String,
        /// Minimum free space for normal operation, MB.
        minimum_mb: u64,
        /// What to do: the files that may be deleted.
        advice: String,
    },
}

impl StoreError {
    pub(super) fn database(doing: &'static str, path: &Path, error: &rusqlite::Error) -> Self {
        StoreError::Database { operation: doing, path: path.to_owned(), problem: error.to_string() }
    }
}

fn describe_known_names(nearest: Option<&str>, known: &[String]) -> String {
    match (nearest, known) {
        (_, []) => "the store contains no taught panel: run panelprep teach first".to_owned(),
        (Some(nearest), _) => format!("did you mean '{nearest}'? Taught panels: {}", known.join(", ")),
        (None, _) => format!("taught panels: {}", known.join(", ")),
    }
}

/// A part whose number of sanding passes is unknown: the store was restored from a backup, the cycles after the backup
/// are missing, and no person has stated the passes on the part in these cycles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownPassCount {
    /// The serial number of the part; empty for a part without one.
    pub serial: String,
    /// Time at which the backup was made, s since 1970; `None` if the mark of the restore does not state it.
    pub made_unix_s: Option<i64>,
    /// Time at which the restored store was first opened, s since 1970.
    pub restored_unix_s: i64,
}

impl UnknownPassCount {
    /// Returns whether the statement "another part is in the fixture" is sufficient for the part with this serial
    /// number. It is sufficient only for a part without a serial number. For a part with a serial number, a person must
    /// state the number of sanding passes.
    pub fn is_another_part_sufficient(serial: &str) -> bool {
        serial.trim().is_empty()
    }
}

impl fmt::Display for UnknownPassCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let UnknownPassCount { serial, made_unix_s, restored_unix_s } = self;
        let another = if UnknownPassCount::is_another_part_sufficient(serial) {
            "that a different part than in those cycles is in the fixture (`--another-part`), or "
        } else {
            ""
        };
        let made = made_unix_s.map_or_else(|| "an unknown day".to_owned(), utc_day);
        write!(
            f,
            "the number of sanding passes on {} is unknown: the store was restored on {} from a backup of {made}, and the \
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

    /// Expected value: 1,800,000,000 s since 1970 is 2027-01-15, 8:00 UTC; a day has 86,400 s.
    #[test]
    fn the_message_states_the_part_both_days_and_the_remedy() {
        let of = |serial: &str, made_unix_s| UnknownPassCount {
            serial: serial.to_owned(),
            made_unix_s,
            restored_unix_s: 1_800_086_400,
        };
        let passes = "the number of passes that this part had in them (`panelprep ctl start --lost-passes NUMBER`, 0 if \
                      it had none); if the number is not known, take the part out and let the inspector decide about it";
        let named = "the number of sanding passes on the part SN 1 is unknown: the store was restored on 2027-01-16 from a \
                     backup of 2027-01-15, and the cycles between them are missing; state at the start";
        assert_eq!(of("SN 1", Some(1_800_000_000)).to_string(), format!("{named} {passes}"));
        let without = "the number of sanding passes on a part without a serial number is unknown: the store was restored on \
                       2027-01-16 from a backup of an unknown day, and the cycles between them are missing; state at the \
                       start that a different part than in those cycles is in the fixture (`--another-part`), or";
        assert_eq!(of("", None).to_string(), format!("{without} {passes}"));
    }
}
