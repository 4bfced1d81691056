//! Why something cannot be signed or read.

/// What is wrong with a key or a statement.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SigningError {
    /// No private key.
    #[error(
        "this is no private ed25519 key ({problem}); allowed is one as PEM, as `openssl genpkey -algorithm ed25519` writes it"
    )]
    PrivateKey {
        /// What does not fit.
        problem: String,
    },
    /// No public key.
    #[error(
        "this is no public ed25519 key ({problem}); allowed is the PEM file that stands beside the cell's key, or several in one file"
    )]
    PublicKey {
        /// What does not fit.
        problem: String,
    },
    /// No statement of this form.
    #[error(
        "this is no signed record ({problem}); allowed is a file that `panelprep record export` wrote, unchanged"
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
