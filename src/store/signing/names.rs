//! The file names of an export.

use super::chain::NameClaim;
use panelprep_cell::record::CycleId;

/// Returns the name, without its extension, of the cell's statement of a cycle.
pub fn cycle_stem(cycle: CycleId) -> String {
    format!("cycle-{cycle}")
}

/// Returns the name, without its extension, of a person's signature on a cycle.
pub fn person_signature_stem(cycle: CycleId, number: u64) -> String {
    format!("cycle-{cycle}-signature-{number}")
}

/// Returns the name, without its extension, of the signed page of a cycle.
pub fn page_stem(cycle: CycleId) -> String {
    format!("cycle-{cycle}-page")
}

/// Returns the name of a cycle's page as PDF.
pub fn pdf_name(cycle: CycleId) -> String {
    format!("cycle-{cycle}.pdf")
}

/// Returns the cycle to which the signed page with this name belongs, if it is the name of a signed page; the name is
/// given without its extension.
pub(super) fn cycle_from_page_name(stem: &str) -> Option<CycleId> {
    let number = stem.strip_suffix("-page")?.strip_prefix("cycle-")?;
    number.parse().ok().map(CycleId)
}

/// Returns the cycle to which the PDF page with this name belongs, if it is the name of such a page.
pub(super) fn cycle_from_pdf_name(name: &str) -> Option<CycleId> {
    name.strip_suffix(".pdf")?.strip_prefix("cycle-")?.parse().ok().map(CycleId)
}

/// Returns the claim that a statement's name makes; the name is given without its extension.
pub(super) fn parse_claim(stem: &str) -> NameClaim {
    let Some(rest) = stem.strip_prefix("cycle-") else { return NameClaim::Nothing };
    match rest.split_once("-signature-") {
        Some((_, number)) => number.parse().map_or(NameClaim::Nothing, NameClaim::Number),
        None => rest.parse().map_or(NameClaim::Nothing, |id| NameClaim::Cycle(CycleId(id))),
    }
}
