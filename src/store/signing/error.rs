//! Errors in signing, and in reading signed statements.

/// The problem of a key or a statement.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SigningError {
    /// No private key.
    #[error(
        "not a valid private ed25519 key ({problem}); valid: a PEM file from `openssl genpkey -algorithm ed25519`"
    )]
    PrivateKey {
        /// The problem that was found.
        problem: String,
    },
    /// No public key.
    #[error(
        "not a valid public ed25519 key ({problem}); valid: the PEM file next to the cell's key, or several such \
         keys in one file"
    )]
    PublicKey {
        /// The problem that was found.
        problem: String,
    },
    /// The text is not a statement of this form.
    #[error("not a valid signed record ({problem}); valid: an unchanged file from `panelprep record export`")]
    Form {
        /// The problem that was found.
        problem: String,
    },
    /// JSON cannot represent the value.
    #[error("the record cannot be written as JSON: {problem}")]
    Json {
        /// The problem that was found.
        problem: String,
    },
}

impl SigningError {
    pub(super) fn form_error(problem: impl std::fmt::Display) -> Self {
        SigningError::Form { problem: problem.to_string() }
    }
}
