//! Where the pages of cycles come from, and who signs them.

use crate::record::CycleId;
use crate::store::PersonSigns;

/// A cycle's page as PDF, with what the cell signs of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPdf {
    /// The PDF.
    pub pdf: Vec<u8>,
    /// The signed page that names its SHA-256.
    pub page: Vec<u8>,
    /// The signature of that.
    pub signature: Vec<u8>,
}

/// Where the pages of cycles come from, and who signs them.
pub trait RecordSource: Send + Sync {
    /// The page of a cycle, as it stands in the store or as it is so far.
    ///
    /// # Errors
    /// Where it cannot be made, in words.
    fn page(&self, cycle: CycleId) -> Result<String, String>;

    /// The signed record with its page as PDF/A-3; `None` where the cycle is not signed yet.
    ///
    /// # Errors
    /// Where it cannot be made, in words.
    fn pdf(&self, cycle: CycleId) -> Result<Option<RecordPdf>, String>;

    /// Signs a record as a person; the number of the signature comes back.
    ///
    /// # Errors
    /// Where the cycle is not over, the person signed so already, or the store cannot be written, in words.
    fn sign(&self, signs: &PersonSigns) -> Result<u64, String>;
}
