//! Signed records: the cell's statement about a cycle, and the signatures of persons on it, as canonical JSON that is
//! signed with the cell's key.
//!
//! A statement is a JSON object in canonical form (RFC 8785); its bytes are signed with ed25519. Each statement
//! contains the SHA-256 of the previous statement of the cell, over all cycles. Therefore a statement that was changed,
//! deleted, inserted, exchanged or rolled back contradicts a signature, the hash chain, or a head that is kept
//! elsewhere. A person with the public key can verify this without the program, because the bytes of the file are the
//! signed bytes.
//!
//! All functions are pure; `store` keeps the keys and the statements. A person with a copy of the private key can sign
//! like the cell, which the chain does not detect.

mod canonical;
mod chain;
mod export;
mod key;
mod statement;

pub use canonical::{canonical, differences};
pub use chain::{NameClaim, Signed, VerificationResult, missing_text, partial_chain_text, verify};
pub use export::{
    ExportContent, SignedPage, cycle_stem, exported_files, page_stem, pdf_name, person_signature_stem,
    verify_export,
};
pub use key::{CellKey, PublicKey, SigningError};
pub use statement::{
    CHAIN_START_HASH, HEAD_FORMAT, Meaning, PersonSignature, STATEMENT_FORMAT, SignedChainPosition, SignedCycle,
    SignedHead, StatedValues, Statement, StatementContent, named_files,
};

#[cfg(test)]
mod tests;
