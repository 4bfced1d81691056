//! Why something cannot be signed or read.

/// What is wrong with a key or a statement.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SigningError {
    /// No private key.
    #[error(
        "this is not a private ed25519 key ({problem}); valid: a PEM file, as `openssl genpkey -algorithm ed25519` \
         writes it"
    )]
    PrivateKey {
        /// What does not fit.
        problem: String,
    },
    /// No public key.
    #[error(
        "this is not a public ed25519 key ({problem}); valid: the PEM file next to the cell's key, or several in \
         one file"
    )]
    PublicKey {
        /// What does not fit.
        problem: String,
    },
    /// No statement of this form.
    #[error(
        "this is not a signed record ({problem}); valid: an unchanged file that `panelprep record export` wrote"
    )]
    Form {
        /// What does not fit.
        problem: String,
    },
    /// JSON cannot hold it.
    #[error("the record cannot be written as JSON: {problem}")]
    Json {
        /// What does not fit.
        problem: String,
    },
}

impl SigningError {
    pub(super) fn form(problem: impl std::fmt::Display) -> Self {
        SigningError::Form { problem: problem.to_string() }
    }
}
