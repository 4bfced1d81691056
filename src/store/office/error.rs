//! Errors for a message that is not a valid message of a cell.

/// Errors of a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OfficeError {
    /// The message cannot be read as a message of a cell.
    #[error("the {what} cannot be read: {problem}")]
    Form {
        /// The part that cannot be read, such as "head of a message".
        what: &'static str,
        /// The problem that was found.
        problem: String,
    },
    /// The content does not have the hash that the head states.
    #[error("the content of record {number} has the SHA-256 {found}, but its head states {stated}")]
    Hash {
        /// Its number.
        number: u64,
        /// The hash of the content.
        found: String,
        /// The hash in the head.
        stated: String,
    },
    /// The message is larger than any that a cell sends.
    #[error("the message has {found} (limit {allowed})")]
    Large {
        /// The size found, such as "5000 parts".
        found: String,
        /// The largest size allowed, in the same unit.
        allowed: String,
    },
    /// The parts of one item state different numbers of parts.
    #[error("part {part} states a total of {found} parts, but another part stated {before}")]
    Parts {
        /// Number of the part.
        part: u32,
        /// The number that this part states.
        found: u32,
        /// The number that an earlier part stated.
        before: u32,
    },
    /// The key does not verify the signature, or the statement is not valid.
    #[error("record {number} does not match the signature of its cell: {problem}")]
    Signature {
        /// Its number.
        number: u64,
        /// The problem that was found.
        problem: String,
    },
}

impl OfficeError {
    pub(super) fn form_error(what: &'static str, problem: impl ToString) -> Self {
        OfficeError::Form { what, problem: problem.to_string() }
    }
}
