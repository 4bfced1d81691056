//! A recipe that the office has approved and offers to its cells. A cell never adopts a recipe automatically: a person
//! at the cell checks the difference and approves it like any other change.

use super::error::OfficeError;
use panelprep_cell::files::content_hash;
use serde::{Deserialize, Serialize};

const FORM: &str = "panelprep-offer-1";
/// Longest offer, bytes.
const MAX_BYTES: usize = 256 * 1_024;
/// The longest name and reason, in characters.
const MAX_CHARACTERS: usize = 200;

/// A recipe that the office offers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecipeOffer {
    form: String,
    /// The panel to which the recipe belongs.
    pub panel: String,
    /// Its text.
    pub text: String,
    /// The printed name of the person who approved it in the office.
    pub by: String,
    /// Reason of the change, as the person stated it.
    pub why: String,
    /// Time of the approval, ms since 1970.
    pub unix_ms: i64,
}

impl RecipeOffer {
    /// Creates an offer of this recipe.
    ///
    /// # Errors
    /// If the name or the reason cannot be printed unchanged, or the text is too long.
    pub fn new(panel: &str, text: &str, (by, why): (&str, &str), unix_ms: i64) -> Result<Self, OfficeError> {
        let [panel, text, by, why] = [panel, text, by, why].map(str::to_owned);
        let offer = RecipeOffer { form: FORM.to_owned(), panel, text, by, why, unix_ms };
        offer.validated()
    }

    fn validated(self) -> Result<Self, OfficeError> {
        for (what, text) in [("name", &self.by), ("reason", &self.why)] {
            panelprep_base::number_text::printable(text, MAX_CHARACTERS).map_err(|problem| {
                OfficeError::form_error("offer of a recipe", format!("its {what}: {problem}"))
            })?;
        }
        match self.text.len() {
            0..MAX_BYTES => Ok(self),
            found => {
                let [found, allowed] = [found, MAX_BYTES].map(|count| format!("{count} bytes"));
                Err(OfficeError::Large { found, allowed })
            }
        }
    }

    /// Returns the SHA-256 of the recipe's text, as records state it.
    pub fn hash(&self) -> String {
        content_hash(self.text.as_bytes())
    }

    /// Returns the bytes to send.
    ///
    /// # Errors
    /// If JSON cannot represent the offer.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        serde_json::to_vec(self).map_err(|error| OfficeError::form_error("offer of a recipe", error))
    }

    /// Reads an offer.
    ///
    /// # Errors
    /// If the bytes are not an offer.
    pub fn read(bytes: &[u8]) -> Result<Self, OfficeError> {
        if bytes.len() > 2 * MAX_BYTES {
            let [found, allowed] = [bytes.len(), 2 * MAX_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let wrong = |problem: String| OfficeError::form_error("offer of a recipe", problem);
        let offer: RecipeOffer = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if offer.form != FORM {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{FORM}\"",
                offer.form.escape_debug()
            )));
        }
        offer.validated()
    }
}
