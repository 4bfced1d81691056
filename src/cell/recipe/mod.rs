//! The recipe: one TOML file for each kind of panel, checked and converted to types that contain only valid values.
//!
//! Each table is declared in `film`, `path` or `place`: every key with its range, default and meaning. This file joins
//! the tables and checks rules that involve several keys. `config/` reads the file.

mod edit;
mod film;
mod path;
mod place;

#[cfg(test)]
mod tests;

pub use edit::{DrawnShapes, EditError, with_shapes};
pub use film::{Inspect, Method, Process, Region, SandedReference};
pub use path::{FitMethod, Path, Pattern, Removal, RemovalMethod, Surface, Treat, TreatBy};
pub use place::{Corner, CornerName, CornerNames, DrawingPlacement, Locate, Panel, Registration};

use panelprep_base::config::{self, Problems, Section};

/// A recipe: the contents of its file after all checks.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    panel: Panel,
    process: Process,
    locate: Locate,
    corner: Corner,
    region: Region,
    inspect: Inspect,
    surface: Surface,
    path: Path,
    treat: Treat,
    removal: Option<Removal>,
    nominal: Option<DrawingPlacement>,
}

/// Top-level keys that distinguish a recipe from other TOML files.
pub const RECIPE_KEYS: [&str; 11] =
    ["panel", "process", "locate", "corner", "region", "inspect", "surface", "path", "treat", "removal", "nominal"];

impl Recipe {
    /// Parses and checks a recipe; `file` is its name in messages.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        config::parse_file(file, text, Self::parse)
    }

    fn parse(top: &Section<'_, '_>) -> Option<Self> {
        let panel = place::parse_panel(top);
        let process = film::parse_process(&top.section("process"));
        let locate = place::parse_locate(&top.section("locate"));
        let corner = place::parse_corner(&top.section("corner"));
        let region = film::parse_region(&top.section("region"));
        let inspect = film::parse_inspect(&top.section("inspect"));
        let surface = Surface::parse(&top.section("surface"));
        let path = path::parse_path(&top.section("path"));
        let treat = path::parse_treat(&top.section("treat"), path.as_ref());
        let removal = path::parse_removal(&top.section("removal"), path.as_ref());
        let nominal = place::parse_nominal(&top.section("nominal"));
        top.finish();
        Some(Recipe {
            panel: panel?,
            process: process?,
            locate: locate?,
            corner: corner?,
            region: region?,
            inspect: inspect?,
            surface: surface?,
            path: path?,
            treat: treat?,
            removal: removal?,
            nominal: nominal?,
        })
    }

    /// Returns the panel's name, which identifies its taught data in the store.
    pub fn panel(&self) -> &str {
        self.panel.name_text()
    }

    /// Returns the drawn outline of the panel and its held places.
    pub fn outline(&self) -> &Panel {
        &self.panel
    }

    /// Returns the parameters of the water-break test and of the sanding passes.
    pub fn process(&self) -> &Process {
        &self.process
    }

    /// Returns the search box for the panel, and the acceptance limits of the localization.
    pub fn locate(&self) -> &Locate {
        &self.locate
    }

    /// Returns the parameters for the evaluation of a corner picture.
    pub fn corner(&self) -> &Corner {
        &self.corner
    }

    /// Returns the region to inspect and sand.
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// Returns the parameters for the detection of a broken film.
    pub fn inspect(&self) -> &Inspect {
        &self.inspect
    }

    /// Returns the parameters of the surface fit.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Returns the parameters of the tool's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns which areas are sanded after a grid has failed.
    pub fn treat(&self) -> &Treat {
        &self.treat
    }

    /// Returns the required removal, if the recipe states one.
    pub fn removal(&self) -> Option<&Removal> {
        self.removal.as_ref()
    }

    /// Returns the pose of the panel's drawing, if the panel is taught from its drawing.
    pub fn nominal(&self) -> Option<&DrawingPlacement> {
        self.nominal.as_ref()
    }

    /// Returns the force of the tool on the panel, N: `[path] force_n` for a compliant tool, the value in `[removal]`
    /// for a spring.
    pub fn force_n(&self) -> Option<f64> {
        self.path.force_n().or_else(|| self.removal.as_ref()?.force_n())
    }
}
