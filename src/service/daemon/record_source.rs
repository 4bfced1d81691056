//! The source of the pages of cycles, and of their signatures.

use panelprep_cell::record::CycleId;
use panelprep_store::store::PersonSigningRequest;

/// A cycle's page as PDF, with the part that the cell signs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPdf {
    /// The PDF.
    pub pdf: Vec<u8>,
    /// The signed page, which contains the SHA-256 of the PDF.
    pub page: Vec<u8>,
    /// The signature of the signed page.
    pub signature: Vec<u8>,
}

/// The source of the pages of cycles, and of their signatures.
pub trait RecordSource: Send + Sync {
    /// Returns the page of a cycle from the store; for a cycle in progress, as it is so far.
    ///
    /// # Errors
    /// If it cannot be made; the error is a text for people.
    fn page(&self, cycle: CycleId) -> Result<String, String>;

    /// Returns the signed record with its page as PDF/A-3; `None` if the cycle is not signed yet.
    ///
    /// # Errors
    /// If it cannot be made; the error is a text for people.
    fn pdf(&self, cycle: CycleId) -> Result<Option<RecordPdf>, String>;

    /// Signs a record as a person; returns the number of the signature.
    ///
    /// # Errors
    /// If the cycle is not over, the person has already given this kind of signature, or the store cannot be written;
    /// the error is a text for people.
    fn sign(&self, signs: &PersonSigningRequest) -> Result<u64, String>;
}
