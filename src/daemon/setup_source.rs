//! Where recipes and calibrations come from.

use crate::files::content_hash;
use crate::geometry::ColorPicture;
use crate::office::RecipeOffer;
use crate::packml::RecipeHash;
use crate::verdict::{Reason, Verdict};

/// A recipe's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeText {
    /// Its whole name, which messages show.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl RecipeText {
    /// SHA-256 of its text, by which a start names it.
    pub fn sha256(&self) -> String {
        content_hash(self.text.as_bytes())
    }

    /// The recipe, if it is the one that a person decided upon.
    ///
    /// # Errors
    /// Where it has another text by now.
    pub fn decided_upon(self, sha256: &str) -> Result<Self, String> {
        let found = self.sha256();
        if sha256.trim().eq_ignore_ascii_case(&found) {
            return Ok(self);
        }
        Err(format!(
            "{}: the start was decided upon the recipe with SHA-256 \"{}\", and the file's is {found}; read the recipe as it is now, then start by it",
            self.name,
            sha256.trim().escape_debug()
        ))
    }
}

/// A camera, the tool or another thing whose calibration has an age.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equipment {
    /// What it is.
    pub name: String,
    /// Its calibration and when it was made, in words.
    pub calibration: String,
    /// Its last verification, in words.
    pub verification: String,
}

/// A thing that was looked at, as `panelprep doctor` tells it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Examined {
    /// What it is.
    pub name: String,
    /// Nothing is wrong with it.
    pub is_right: bool,
    /// What was found.
    pub found: String,
    /// What to do about it; empty where it is right.
    pub advice: String,
}

/// Where recipes and calibrations come from. Names of recipes are those of files in one folder.
pub trait SetupSource: Send + Sync {
    /// The recipes that are offered.
    ///
    /// # Errors
    /// Where the folder cannot be read, in words.
    fn recipes(&self) -> Result<Vec<String>, String>;

    /// One of them.
    ///
    /// # Errors
    /// Where there is no such recipe or it cannot be read, in words.
    fn recipe(&self, name: &str) -> Result<RecipeText, String>;

    /// The recipe that the office offers in the place of this one; `None` where it offers none, or the same.
    ///
    /// # Errors
    /// As [`SetupSource::recipe`].
    fn offer(&self, name: &str) -> Result<Option<RecipeOffer>, String>;
    /// What is wrong with a recipe, as `panelprep check` says it; nothing where it is right.
    fn problems(&self, name: &str, text: &str) -> Vec<String>;

    /// Writes a recipe in place of the one with this name; the former text comes back.
    ///
    /// # Errors
    /// Where it is wrong or the disk refuses, in words.
    fn save(&self, name: &str, text: &str) -> Result<Option<String>, String>;

    /// The picture of the scan by which the recipe's panel was taught.
    ///
    /// # Errors
    /// Where there is no such recipe, it is wrong, or its panel was not taught, in words.
    fn taught_picture(&self, name: &str) -> Result<ColorPicture, String>;

    /// What is or will soon be in the way of a cycle, apart from the cameras: the disk, and the age of verifications.
    fn standing(&self) -> Vec<Reason>;

    /// Looks at the whole cell, as `panelprep doctor` does; nothing moves. It may take some seconds.
    /// What cannot be read is a finding.
    fn examine(&self) -> Vec<Examined>;

    /// The equipment, and whether a cycle may start with it.
    ///
    /// # Errors
    /// Where a file cannot be read, in words.
    fn equipment(&self) -> Result<(Verdict, Vec<String>, Vec<Equipment>), String>;
}

/// The recipes with their hashes, so that a start is by the one that was offered. One that cannot be read cannot be started by, and is left
/// out.
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
