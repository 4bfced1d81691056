//! Why a message is not one of ours.

/// What is wrong with a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OfficeError {
    /// It is no message of a cell.
    #[error("the {what} cannot be read: {problem}")]
    Form {
        /// "head of a message" and the like.
        what: &'static str,
        /// What does not fit.
        problem: String,
    },
    /// Its content does not have the hash that its head states.
    #[error("the content of number {number} has the SHA-256 {found}, its head states {stated}")]
    Hash {
        /// Its number.
        number: u64,
        /// The hash of the content.
        found: String,
        /// The hash in the head.
        stated: String,
    },
    /// It is larger than any that a cell sends.
    #[error("it has {found} (limit {allowed})")]
    Large {
        /// "5000 parts" and the like.
        found: String,
        /// In the same unit.
        allowed: String,
    },
    /// The parts of one item state different numbers of parts.
    #[error("part {part} states {found} parts, another part stated {before}")]
    Parts {
        /// Which part.
        part: u32,
        /// The number that this part states.
        found: u32,
        /// The number that an earlier part stated.
        before: u32,
    },
    /// A signature that its key does not verify, or a statement that is none.
    #[error("number {number} is not what its cell signed: {problem}")]
    Signature {
        /// Its number.
        number: u64,
        /// What does not fit.
        problem: String,
    },
}

impl OfficeError {
    pub(super) fn form(what: &'static str, problem: impl ToString) -> Self {
        OfficeError::Form { what, problem: problem.to_string() }
    }
}
