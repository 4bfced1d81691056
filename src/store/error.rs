//! Errors of the store.

use std::path::{Path, PathBuf};

/// Why something could not be remembered or recalled.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file or folder refused.
    #[error("cannot {doing} {}: {source}", path.display())]
    File {
        /// What was tried.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The database refused.
    #[error("cannot {doing} the store {}: {problem}", path.display())]
    Database {
        /// What was tried.
        doing: &'static str,
        /// The database.
        path: PathBuf,
        /// The error of SQLite.
        problem: String,
    },
    /// No store to read from.
    #[error("there is no store in {}; `panelprep teach` makes one: teach a panel first, or name the folder that holds the store", path.display())]
    Missing {
        /// The folder.
        path: PathBuf,
    },
    /// Another writer.
    #[error("{holder} is writing to the store {}; stop it first, or name another store", path.display())]
    Leased {
        /// The folder.
        path: PathBuf,
        /// Who writes, "process 1234".
        holder: String,
    },
    /// Opened for reading.
    #[error("the store {} is open for reading only", path.display())]
    ReadOnly {
        /// The database.
        path: PathBuf,
    },
    /// SQLite finds its file damaged.
    #[error("the store {} is damaged: {problem}; restore it from a copy", path.display())]
    Damaged {
        /// The database.
        path: PathBuf,
        /// What SQLite found.
        problem: String,
    },
    /// The journal is not what was written.
    #[error("the journal of {} is damaged at line {sequence}: {problem}; restore the store from a copy", path.display())]
    DamagedJournal {
        /// The database.
        path: PathBuf,
        /// The line, from 1; 0 for none in particular.
        sequence: i64,
        /// What does not fit.
        problem: String,
    },
    /// An append failed before.
    #[error("an earlier write to the journal of {} failed; nothing more is appended until the program starts again", path.display())]
    JournalInDoubt {
        /// The database.
        path: PathBuf,
    },
    /// A motion to close that is not the open one.
    #[error("the store has no open {motion}")]
    MotionNotOpen {
        /// The motion.
        motion: String,
    },
    /// No such verification.
    #[error("the store {} has no verification {number}; `panelprep calibrate history` lists them", path.display())]
    UnknownVerification {
        /// The database.
        path: PathBuf,
        /// The requested number.
        number: i64,
    },
    /// A verification is struck out once.
    #[error("verification {number} of the store {} is struck out already, by {by}", path.display())]
    StruckAlready {
        /// The database.
        path: PathBuf,
        /// Its number.
        number: i64,
        /// Who struck it out.
        by: String,
    },
    /// No such cycle, or it is over.
    #[error("the store {} has no {what} {id}", path.display())]
    UnknownCycle {
        /// The database.
        path: PathBuf,
        /// "cycle" or "running cycle".
        what: &'static str,
        /// The requested cycle.
        id: i64,
    },
    /// A row does not read back.
    #[error("a row of the store {} does not read back: {problem}; restore it from a copy", path.display())]
    Unreadable {
        /// The database.
        path: PathBuf,
        /// What does not fit.
        problem: String,
    },
    /// A number that JSON cannot hold.
    #[error("the number '{name}' is NaN or infinite; a value that was not measured is None")]
    NotFinite {
        /// The number.
        name: String,
    },
    /// Written by a later version of this program.
    #[error(
        "the store {} has schema {found}, this program knows up to {known}: use the newer program, or another folder",
        path.display()
    )]
    Newer {
        /// The database.
        path: PathBuf,
        /// Its schema.
        found: i64,
        /// The newest schema that this program supports.
        known: i64,
    },
    /// Written by an earlier version of this program, and not brought up to date yet.
    #[error(
        "the store {} has schema {found}, this program works with {known}: start the service once (`panelprep run`), which keeps a \
         copy of its database and brings it up to date; then try again",
        path.display()
    )]
    Older {
        /// The folder.
        path: PathBuf,
        /// Its schema.
        found: i64,
        /// The schema of this program.
        known: i64,
    },
    /// Written by another program.
    #[error("{} is a database of another program; name another folder", path.display())]
    Foreign {
        /// The database.
        path: PathBuf,
    },
    /// A stored file is not what was stored.
    #[error("{} is damaged: its SHA-256 is {found}; restore it from a copy, or delete it and teach again", path.display())]
    DamagedBlob {
        /// The file, named by the hash that it should have.
        path: PathBuf,
        /// The hash that it has.
        found: String,
    },
    /// A row is not what was stored.
    #[error("version {version} of the taught panel '{name}' is damaged: {problem}; teach it again")]
    DamagedRow {
        /// The panel.
        name: String,
        /// The version.
        version: String,
        /// What does not fit.
        problem: String,
    },
    /// A pose that cannot be kept.
    #[error("corner {corner} has a flange pose with NaN or infinite numbers")]
    Pose {
        /// The corner, from 1.
        corner: usize,
    },
    /// No such panel.
    #[error("no panel '{name}' was taught; {}", known_names(nearest.as_deref(), known))]
    UnknownPanel {
        /// The requested name.
        name: String,
        /// The name most likely meant.
        nearest: Option<String>,
        /// All names.
        known: Vec<String>,
    },
    /// No such version.
    #[error("the panel '{name}' has no version {version}; there are, oldest first: {}", known.join(", "))]
    UnknownVersion {
        /// The panel.
        name: String,
        /// The requested version.
        version: String,
        /// All versions.
        known: Vec<String>,
    },
    /// A text of a person's signature cannot be stored as given.
    #[error("the signature's {what} is \"{found}\": {problem}")]
    Unsignable {
        /// "name", "user" or "remark".
        what: &'static str,
        /// What was given.
        found: String,
        /// What is wrong with it, and what is allowed.
        problem: String,
    },
    /// A person signs a record once for each meaning.
    #[error("{name} has signed the record of cycle {cycle} as {meaning} already, {at}")]
    SignedAlready {
        /// Who.
        name: String,
        /// The cycle.
        cycle: i64,
        /// What the signature means.
        meaning: &'static str,
        /// When.
        at: String,
    },
    /// Other processes signed meanwhile, again and again.
    #[error("the store {} was signed by other processes meanwhile, ten times in a row; try again", path.display())]
    SignedMeanwhile {
        /// The database.
        path: PathBuf,
    },
    /// A key, or what is signed.
    #[error("{}: {source}", path.display())]
    Signing {
        /// The database, or the key's file.
        path: PathBuf,
        /// What does not fit.
        source: crate::signing::SigningError,
    },
    /// The disk is full.
    #[error("the disk of the store {} is full ({free_mb} MB are left); {advice}", path.display())]
    Full {
        /// The folder.
        path: PathBuf,
        /// Free space.
        free_mb: u64,
        /// What may be deleted.
        advice: String,
    },
}

impl StoreError {
    pub(super) fn database(doing: &'static str, path: &Path, error: &rusqlite::Error) -> Self {
        StoreError::Database { doing, path: path.to_owned(), problem: error.to_string() }
    }
}

fn known_names(nearest: Option<&str>, known: &[String]) -> String {
    match (nearest, known) {
        (_, []) => "none was, in this store: run panelprep teach first".to_owned(),
        (Some(nearest), _) => format!("did you mean '{nearest}'? There are: {}", known.join(", ")),
        (None, _) => format!("there are: {}", known.join(", ")),
    }
}
