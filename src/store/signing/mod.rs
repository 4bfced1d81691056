//! The signed record: what a cell states about a cycle, and what a person states about that record, as canonical JSON
//! that the cell's key signs.
//!
//! A statement is a JSON object in the form of RFC 8785; its bytes are signed with ed25519. Each statement names the
//! SHA-256 of the statement before it, over all cycles of the cell. A statement that was changed, deleted, inserted,
//! exchanged or rolled back therefore contradicts the signature, the chain or a head that was kept elsewhere. A person
//! with the public key can verify this without the program: the file's bytes are the signed bytes.
//!
//! The module is pure: `store` keeps the keys and statements. A person with a copy of the key can sign as the cell
//! does; the chain does not detect this.

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
