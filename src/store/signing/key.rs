//! The private key that signs for a cell, the public key that verifies its signatures, and the errors of signing and of
//! reading signed statements.

use ed25519_dalek::ed25519::pkcs8::KeypairBytes;
use ed25519_dalek::pkcs8::spki::der::pem::LineEnding;
use ed25519_dalek::pkcs8::{DecodePrivateKey, DecodePublicKey, EncodePrivateKey, EncodePublicKey};
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use panelprep_cell::files::hex;

/// The reason why a key or a statement cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SigningError {
    /// The text is not a private key.
    #[error(
        "not a valid private ed25519 key ({problem}); valid: a PEM file from `openssl genpkey -algorithm ed25519`"
    )]
    PrivateKey {
        /// What is wrong with the value of the key.
        problem: String,
    },
    /// The text is not a public key.
    #[error(
        "not a valid public ed25519 key ({problem}); valid: the PEM file next to the cell's key, or several such \
         keys in one file"
    )]
    PublicKey {
        /// The problem of the key.
        problem: String,
    },
    /// The text is not a valid statement.
    #[error("not a valid signed record ({problem}); valid: an unchanged file from `panelprep record export`")]
    Form {
        /// The problem of the statement.
        problem: String,
    },
    /// JSON cannot represent the value.
    #[error("the record cannot be written as JSON: {problem}")]
    Json {
        /// The problem of the value.
        problem: String,
    },
}

impl SigningError {
    pub(super) fn form_error(problem: impl std::fmt::Display) -> Self {
        SigningError::Form { problem: problem.to_string() }
    }
}

/// The private key of a cell. It never appears in a message or log.
#[derive(Clone)]
pub struct CellKey(SigningKey);

impl std::fmt::Debug for CellKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "CellKey of {}", self.public_key().hex())
    }
}

impl CellKey {
    /// Creates a key from 32 random bytes.
    pub fn from_random_bytes(bytes: &[u8; 32]) -> Self {
        CellKey(SigningKey::from_bytes(bytes))
    }

    /// Parses a private key in PEM (PKCS #8).
    ///
    /// # Errors
    /// If the text is not a private ed25519 key.
    pub fn read(pem: &str) -> Result<Self, SigningError> {
        let problem = |error: ed25519_dalek::pkcs8::Error| SigningError::PrivateKey { problem: error.to_string() };
        SigningKey::from_pkcs8_pem(pem).map(CellKey).map_err(problem)
    }

    /// Returns the key as PEM, in the format of `openssl`.
    ///
    /// # Errors
    /// If the key cannot be encoded.
    pub fn to_pem(&self) -> Result<String, SigningError> {
        let bytes = KeypairBytes { secret_key: self.0.to_bytes(), public_key: None };
        let pem = bytes.to_pkcs8_pem(LineEnding::LF);
        let pem = pem.map_err(|error| SigningError::PrivateKey { problem: error.to_string() })?;
        Ok(pem.to_string())
    }

    /// Returns the public key that verifies the signatures of this key.
    pub fn public_key(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }

    /// Returns the signature of these bytes; it is deterministic.
    pub fn sign(&self, bytes: &[u8]) -> [u8; 64] {
        self.0.sign(bytes).to_bytes()
    }
}

/// The public key of a cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PublicKey(VerifyingKey);

const END: &str = "-----END PUBLIC KEY-----";

impl PublicKey {
    /// Parses all public keys in a PEM file; a cell whose key was replaced has several.
    ///
    /// # Errors
    /// If the file contains no public key, or one that is not an ed25519 key.
    pub fn parse_all(pem: &str) -> Result<Vec<Self>, SigningError> {
        let problem = |problem: String| SigningError::PublicKey { problem };
        let blocks = pem.split_inclusive(END).filter(|block| block.contains(END));
        let key = |block: &str| {
            VerifyingKey::from_public_key_pem(block.trim_start())
                .map(PublicKey)
                .map_err(|error| problem(error.to_string()))
        };
        let keys: Vec<Self> = blocks.map(key).collect::<Result<_, _>>()?;
        if keys.is_empty() { Err(problem("the file contains no PUBLIC KEY block".to_owned())) } else { Ok(keys) }
    }

    /// Parses a public key from 64 hexadecimal digits, as in a statement.
    ///
    /// # Errors
    /// If the text is not a public ed25519 key.
    pub fn from_hex(hex: &str) -> Result<Self, SigningError> {
        let problem = |problem: &str| SigningError::PublicKey { problem: problem.to_owned() };
        let digit = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
        let bytes: Option<Vec<u8>> = hex.as_bytes().chunks(2).map(digit).collect();
        let bytes: Option<[u8; 32]> = bytes.and_then(|bytes| bytes.try_into().ok());
        let bytes = bytes.ok_or_else(|| problem("the key does not have 64 hexadecimal digits"))?;
        VerifyingKey::from_bytes(&bytes).map(PublicKey).map_err(|error| problem(&error.to_string()))
    }

    /// Returns the key as 64 hexadecimal digits.
    pub fn hex(&self) -> String {
        hex(self.0.as_bytes())
    }

    /// Returns the public key as PEM, for `openssl pkeyutl -pubin`.
    ///
    /// # Errors
    /// If the key cannot be encoded.
    pub fn to_pem(&self) -> Result<String, SigningError> {
        let pem = self.0.to_public_key_pem(LineEnding::LF);
        pem.map_err(|error| SigningError::PublicKey { problem: error.to_string() })
    }

    /// Returns whether this is the signature of these bytes by the private key that belongs to this public key.
    pub fn is_valid_signature(&self, bytes: &[u8], signature: &[u8]) -> bool {
        Signature::from_slice(signature).is_ok_and(|signature| self.0.verify_strict(bytes, &signature).is_ok())
    }
}
