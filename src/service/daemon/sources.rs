//! The data that the program provides to the service: recipes and calibrations, and the pages of cycles with their
//! signatures.

use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cell::PartRules;
use panelprep_cell::files::content_hash;
use panelprep_cell::record::CycleId;
use panelprep_interfaces::packml::RecipeHash;
use panelprep_store::office::RecipeOffer;
use panelprep_store::store::PersonSigningRequest;

/// A recipe's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeText {
    /// The full name of the file, which messages show.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl RecipeText {
    /// Returns the SHA-256 of the recipe's text; a start refers to the recipe by it.
    pub fn sha256(&self) -> String {
        content_hash(self.text.as_bytes())
    }

    /// Returns the recipe if it is the one on which a person decided.
    ///
    /// # Errors
    /// If its text has changed since then.
    pub fn if_unchanged(self, sha256: &str) -> Result<Self, String> {
        let found = self.sha256();
        if sha256.trim().eq_ignore_ascii_case(&found) {
            return Ok(self);
        }
        Err(format!(
            "{}: the start request names the recipe with the SHA-256 \"{}\", but the file has {found}; read the \
             current recipe, then start with its SHA-256",
            self.name,
            sha256.trim().escape_debug()
        ))
    }
}

/// A camera, the tool or another item with a dated calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equipment {
    /// Name of the equipment.
    pub name: String,
    /// The calibration of the equipment and when it was made, as text.
    pub calibration: String,
    /// The last verification of the equipment, as text.
    pub verification: String,
}

/// An examined item, as `panelprep doctor` reports it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExaminedItem {
    /// Name of the item.
    pub name: String,
    /// Whether the item is in order.
    pub is_right: bool,
    /// What the examination found.
    pub found: String,
    /// The remedy; empty if the item is in order.
    pub advice: String,
}

/// The panel in a scan, as it is proposed to a person.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecipeProposal {
    /// The panel's name.
    pub panel: String,
    /// The name of its recipe; `None` if a person must decide.
    pub recipe: Option<String>,
    /// Why no recipe is proposed.
    pub reasons: Vec<Reason>,
}

/// The source of recipes and calibrations. The names of recipes are names of files in one folder.
pub trait SetupSource: Send + Sync {
    /// Returns the recipes that are offered.
    ///
    /// # Errors
    /// If the folder cannot be read; the error is a text for people.
    fn recipes(&self) -> Result<Vec<String>, String>;

    /// Returns one of these recipes.
    ///
    /// # Errors
    /// If there is no such recipe or it cannot be read; the error is a text for people.
    fn recipe(&self, name: &str) -> Result<RecipeText, String>;

    /// Returns the recipe that the office offers in place of this one; `None` if it offers none, or the same.
    ///
    /// # Errors
    /// As [`SetupSource::recipe`].
    fn recipe_offer(&self, name: &str) -> Result<Option<RecipeOffer>, String>;
    /// Returns the problems of a recipe as `panelprep check` reports them; empty if the recipe is valid.
    fn problems(&self, name: &str, text: &str) -> Vec<String>;

    /// Returns why no cycle can start with this text although it is valid: the panel was not taught, or was taught with
    /// another region.
    fn not_taught(&self, name: &str, text: &str) -> Option<String>;

    /// Writes a recipe in place of the one with this name; returns the former text.
    ///
    /// # Errors
    /// If the text is not a valid recipe or the disk cannot be written; the error is a text for people.
    fn save(&self, name: &str, text: &str) -> Result<Option<String>, String>;

    /// Returns the picture of the scan by which the recipe's panel was taught.
    ///
    /// # Errors
    /// If there is no such recipe, it is not valid, or its panel was not taught; the error is a text for people.
    fn taught_picture(&self, name: &str) -> Result<ColorPicture, String>;

    /// Returns what prevents a cycle now or will soon prevent one, apart from the cameras: the disk, and the age of
    /// verifications.
    fn cycle_obstacles(&self) -> Vec<Reason>;

    /// Examines the whole cell, as `panelprep doctor` does; nothing moves. The examination may take some seconds. If
    /// something cannot be read, the result states it.
    fn examine_cell(&self) -> Vec<ExaminedItem>;

    /// Compares a scan with all taught panels, and the part's serial number with the form that the recipe states.
    ///
    /// # Errors
    /// If a file or the store cannot be read; the error is a text for people.
    fn propose_recipe(
        &self,
        _scan: OrganizedCloud<Camera>,
        _serial: Option<&str>,
    ) -> Result<RecipeProposal, String> {
        Ok(RecipeProposal::default())
    }

    /// Returns the rules for how a start must name its part.
    fn part_rules(&self) -> PartRules {
        PartRules::default()
    }

    /// Returns the equipment, and whether a cycle may start with it.
    ///
    /// # Errors
    /// If a file cannot be read; the error is a text for people.
    fn list_equipment(&self) -> Result<(Verdict, Vec<String>, Vec<Equipment>), String>;
}

/// Returns the recipes with their hashes, so that a start uses exactly the recipe that was offered. A recipe that
/// cannot be read cannot be started, and is left out.
///
/// # Errors
/// If the folder cannot be read.
pub(super) fn recipe_hashes(source: &dyn SetupSource) -> Result<Vec<RecipeHash>, String> {
    let hash = |name: String| {
        let sha256 = source.recipe(&name).ok()?.sha256();
        Some(RecipeHash { name, sha256 })
    };
    Ok(source.recipes()?.into_iter().filter_map(hash).collect())
}

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

    /// Adds a person's signature to a record; returns the number of the signature.
    ///
    /// # Errors
    /// If the cycle is not over, the person has already given this kind of signature, or the store cannot be written;
    /// the error is a text for people.
    fn sign(&self, signs: &PersonSigningRequest) -> Result<u64, String>;
}
