//! The recipes in the folder that the cell's file names: offered, read, checked and changed by their file names.

use super::cell_files::CellFiles;
use super::fault::SetupFault;
use super::{disk, teaching};
use crate::check::{FileReport, check_file};
use crate::requirements::recipe_fits::{parse_plausible_recipe, unmet_demands};
use crate::requirements::to_problems;
use panelprep_base::config::Problems;
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::cell::Cell;
use panelprep_cell::files;
use panelprep_cell::files::content_hash;
use panelprep_cell::recipe::Recipe;
use panelprep_interfaces::packml::RecipeHash;
use std::path::{Path, PathBuf};

/// The kind of a recipe's file, as `panelprep check` calls it.
const RECIPE: &str = "recipe";

/// A recipe's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeText {
    /// The full name of the file, which messages show.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl RecipeText {
    /// Reads a recipe's file.
    ///
    /// # Errors
    /// If it cannot be read as text.
    pub fn read(file: &Path) -> Result<Self, SetupFault> {
        Ok(RecipeText { name: file.display().to_string(), text: disk::read_text(file)? })
    }

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

/// The recipes of the cell. Errors are texts for people.
impl CellFiles {
    fn recipes_folder(&self) -> &Path {
        &self.cell.page().recipes
    }

    /// Returns the recipes that are offered, by the names of their files. A recipe that cannot be read cannot be
    /// started, and is left out.
    fn offered_recipes(&self) -> Result<Vec<(String, RecipeText)>, String> {
        let files = toml_files(self.recipes_folder()).map_err(|fault| fault.to_string())?;
        let recipe = |(file, text): (PathBuf, Result<String, SetupFault>)| {
            let text = text.ok().filter(|text| kind(text) == Some(RECIPE))?;
            Some((file.file_name()?.to_str()?.to_owned(), RecipeText { name: file.display().to_string(), text }))
        };
        Ok(files.into_iter().filter_map(recipe).collect())
    }

    /// Returns the names of the recipes that are offered.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn recipes(&self) -> Result<Vec<String>, String> {
        Ok(self.offered_recipes()?.into_iter().map(|(name, _)| name).collect())
    }

    /// Returns one of these recipes; any other name is refused.
    ///
    /// # Errors
    /// If there is no such recipe or it cannot be read.
    pub fn recipe(&self, name: &str) -> Result<RecipeText, String> {
        let found = self.offered_recipes()?.into_iter().find(|(known, _)| known == name);
        let folder = self.recipes_folder().display();
        found
            .map(|(_, recipe)| recipe)
            .ok_or_else(|| format!("there is no recipe \"{}\" in {folder}", name.escape_debug()))
    }

    /// Returns the recipes with their hashes, so that a start uses exactly the recipe that was offered.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn recipe_hashes(&self) -> Result<Vec<RecipeHash>, String> {
        let hashed = |(name, recipe): (String, RecipeText)| RecipeHash { name, sha256: recipe.sha256() };
        Ok(self.offered_recipes()?.into_iter().map(hashed).collect())
    }

    /// Returns why no cycle can start with this text although it is valid: the panel was not taught, or was taught with
    /// another region.
    pub fn not_taught(&self, name: &str, text: &str) -> Option<String> {
        let recipe = Recipe::check(name, text).ok()?;
        teaching::teaching_of(self, Path::new(name), &recipe).err().map(|fault| fault.to_string())
    }

    /// Writes a recipe in place of the one with this name; returns the former text.
    ///
    /// # Errors
    /// If the text is not a valid recipe or the disk cannot be written.
    pub fn save_recipe(&self, name: &str, text: &str) -> Result<String, String> {
        let former = self.recipe(name)?.text;
        let problems = recipe_problems(name, text);
        if !problems.is_empty() {
            return Err(problems.join("\n"));
        }
        disk::write_durable(&self.recipes_folder().join(name), text).map_err(|fault| fault.to_string())?;
        Ok(former)
    }

    /// Returns the picture of the scan by which the recipe's panel was taught.
    ///
    /// # Errors
    /// If there is no such recipe, it is not valid, or its panel was not taught.
    pub fn taught_picture(&self, name: &str) -> Result<ColorPicture, String> {
        let RecipeText { name, text } = self.recipe(name)?;
        let recipe = Recipe::check(&name, &text).map_err(|problems| problems.to_string())?;
        let store = self.store().map_err(|fault| fault.to_string())?;
        let taught = store.taught(recipe.panel(), None).map_err(|error| error.to_string())?;
        let scan = files::read_any_cloud(&taught.teaching.scan, None).map_err(|error| error.to_string())?;
        Ok(scan.picture())
    }
}

/// Reads and checks a recipe.
///
/// # Errors
/// If it cannot be read or has problems.
pub fn read_recipe(file: &Path) -> Result<Recipe, SetupFault> {
    Ok(parse_plausible_recipe(&file.display().to_string(), &disk::read_text(file)?)?)
}

/// Parses a recipe, and refuses it if it requests what the cell cannot do; `name` is its file's name in messages.
///
/// # Errors
/// If the recipe has problems; the error lists them.
pub fn parse_recipe_for_cell(cell: &Cell, name: &str, text: &str) -> Result<Recipe, Problems> {
    let recipe = parse_plausible_recipe(name, text)?;
    let unmet = unmet_demands(cell, &recipe, &disk::read_referenced);
    if unmet.is_empty() {
        return Ok(recipe);
    }
    Err(Problems { file: name.to_owned(), list: to_problems(text, unmet) })
}

/// Returns the problems of a recipe as `panelprep check` reports them; empty if the recipe is valid.
pub fn recipe_problems(name: &str, text: &str) -> Vec<String> {
    let FileReport { kind, problems: list, .. } = check_file(name, text);
    let problems = Problems { file: name.to_owned(), list }.to_string();
    let mut problems: Vec<String> = problems.lines().map(str::to_owned).collect();
    if let Some(other) = kind.filter(|kind| *kind != RECIPE) {
        problems.push(format!("the text is not a recipe but a file of the kind {other}"));
    }
    problems
}

/// Returns the files of a folder that may be recipes by their names, each with its text, in the order of their names.
///
/// # Errors
/// If the folder cannot be read.
pub(super) fn toml_files(folder: &Path) -> Result<Vec<(PathBuf, Result<String, SetupFault>)>, SetupFault> {
    let failed = |error: std::io::Error| SetupFault::file_fault(folder, error);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        if file.extension().is_some_and(|ending| ending == "toml") && file.is_file() {
            let text = disk::read_text(&file);
            files.push((file, text));
        }
    }
    files.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(files)
}

/// Returns whether a text is certainly no recipe: other files of the same folder are the cell's and its calibrations.
pub(super) fn is_of_other_kind(text: &str) -> bool {
    kind(text).is_some_and(|kind| kind != RECIPE)
}

fn kind(text: &str) -> Option<&'static str> {
    check_file("", text).kind
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::testing::write_cell;

    const DOOR: &str = "panel = \"door\"\n\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\n\
                        [region]\ncorners_px = [[10, 10], [90, 10], [90, 60], [10, 60]]\nrows = 2\ncolumns = 3\n";

    /// Of the files in the folder only recipes are offered, by their plain names; a text that is not a valid recipe is
    /// not written; a folder that is gone is named.
    #[test]
    fn only_recipes_of_the_folder_are_offered_and_changed() {
        let folder = tempfile::tempdir().expect("a folder");
        let files =
            write_cell(folder.path(), "", &[("door.toml", DOOR), ("cell.toml", "[scanner]\nkind = 'simulated'\n")]);
        assert_eq!(files.recipes().expect("read"), ["door.toml"]);
        let hashes = files.recipe_hashes().expect("read");
        assert_eq!((hashes.len(), hashes[0].sha256.as_str()), (1, content_hash(DOOR.as_bytes()).as_str()));
        for name in ["cell.toml", "../cell.toml", "/etc/passwd", "", "none.toml"] {
            assert!(files.recipe(name).is_err_and(|why| why.starts_with("there is no recipe")), "{name}");
        }
        assert!(files.save_recipe("door.toml", &DOOR.replace("rows = 2", "rows = 0")).is_err());
        assert_eq!(files.recipe("door.toml").expect("it is there").text, DOOR);
        let changed = DOOR.replace("rows = 2", "rows = 4");
        assert_eq!(files.save_recipe("door.toml", &changed).expect("valid"), DOOR);
        assert_eq!(files.recipe("door.toml").expect("it is there").text, changed);
        std::fs::remove_dir_all(folder.path().join("recipes")).expect("removed");
        let why = files.recipes().expect_err("the folder is gone");
        assert!(why.contains("recipes") && why.contains("No such file"), "{why}");
    }
}
