//! The key that signs for a cell, the public key that verifies the signatures, and the errors in signing and in
//! reading signed statements.

use ed25519_dalek::ed25519::pkcs8::KeypairBytes;
use ed25519_dalek::pkcs8::spki::der::pem::LineEnding;
use ed25519_dalek::pkcs8::{DecodePrivateKey, DecodePublicKey, EncodePrivateKey, EncodePublicKey};
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use panelprep_cell::files::hex;

/// The error of a key or a statement.
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

/// The private key of a cell. No text of the program contains it.
#[derive(Clone)]
pub struct CellKey(SigningKey);

impl std::fmt::Debug for CellKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "CellKey of {}", self.public_key().hex())
    }
}

impl CellKey {
    /// Creates a key from 32 random bytes of the operating system.
    pub fn from_random_bytes(bytes: &[u8; 32]) -> Self {
        CellKey(SigningKey::from_bytes(bytes))
    }

    /// Reads a private key, PKCS #8 in PEM.
    ///
    /// # Errors
    /// If the text is not such a key.
    pub fn read(pem: &str) -> Result<Self, SigningError> {
        let problem = |error: ed25519_dalek::pkcs8::Error| SigningError::PrivateKey { problem: error.to_string() };
        SigningKey::from_pkcs8_pem(pem).map(CellKey).map_err(problem)
    }

    /// Returns the key as text, in the form that `openssl` writes.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn to_pem(&self) -> Result<String, SigningError> {
        let bytes = KeypairBytes { secret_key: self.0.to_bytes(), public_key: None };
        let pem = bytes.to_pkcs8_pem(LineEnding::LF);
        let pem = pem.map_err(|error| SigningError::PrivateKey { problem: error.to_string() })?;
        Ok(pem.to_string())
    }

    /// Returns the key that verifies the signatures of this key.
    pub fn public_key(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }

    /// Signs these bytes; the signature is always the same for the same bytes.
    pub fn sign(&self, bytes: &[u8]) -> [u8; 64] {
        self.0.sign(bytes).to_bytes()
    }
}

/// The public key of a cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PublicKey(VerifyingKey);

const END: &str = "-----END PUBLIC KEY-----";

impl PublicKey {
    /// Reads every public key in a PEM file; a cell with a replaced key has several.
    ///
    /// # Errors
    /// If there is none, or one is not an ed25519 key.
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

    /// Reads the key from 64 hexadecimal digits, as a statement names it.
    ///
    /// # Errors
    /// If the text is not such a key.
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

    /// Returns the key as PEM, as `openssl pkeyutl -pubin` reads it.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn to_pem(&self) -> Result<String, SigningError> {
        let pem = self.0.to_public_key_pem(LineEnding::LF);
        pem.map_err(|error| SigningError::PublicKey { problem: error.to_string() })
    }

    /// Returns whether the private key of this public key signed these bytes.
    pub fn is_valid_signature(&self, bytes: &[u8], signature: &[u8]) -> bool {
        Signature::from_slice(signature).is_ok_and(|signature| self.0.verify_strict(bytes, &signature).is_ok())
    }
}
