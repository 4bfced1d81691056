//! What is abraded after a film broke: `[treat]`.

use super::path::Path;
use panelprep_base::config::{Choice, Section, settings};
use panelprep_base::number_text::shortest_text;

/// The places that are abraded after a grid failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TreatBy {
    /// The whole grid.
    Grid,
    /// The breaks of the grid, widened.
    Break,
}

impl Choice for TreatBy {
    const KEYWORDS: &'static [(&'static str, Self)] = &[("grid", TreatBy::Grid), ("break", TreatBy::Break)];
}

settings! {
    /// `[treat]`: the places that are abraded after a grid failed.
    pub struct Treat {
        /// What is abraded: whole grids, or areas around the breaks.
        by: TreatBy, (), default TreatBy::Grid;
        /// Distance by which a break is widened on the surface, mm; only with `by = "break"`, see
        /// [`Treat::widened_mm`].
        margin_mm: Option<f64>, 1.0..=200.0, default None;
        /// Uncertainty of a break's outline on the panel, 95 %, mm: of the panel's pose in the film, of the break's
        /// blurred rim, and of the tool. The program's own margin for pose and tool is 1.5 mm (`path::touching`), and
        /// the rim is blurred by half a millimetre.
        uncertainty_mm: f64, 0.5..=20.0, default 2.0;
    }
}

impl Treat {
    /// Returns the distance by which breaks are widened, mm; if the recipe does not state it, the least allowed one.
    pub fn widened_mm(&self, path: &Path) -> f64 {
        self.margin_mm().unwrap_or_else(|| self.least_mm(path))
    }

    /// Returns the least margin, mm: the disc's radius and the uncertainty of the outline.
    fn least_mm(&self, path: &Path) -> f64 {
        path.disc_diameter_mm() / 2.0 + self.uncertainty_mm()
    }
}

/// Reads the table. If `[path]` has problems, `path` is `None` here, and the margin is not compared with the disc.
pub(in crate::recipe) fn parse_treat(section: &Section<'_, '_>, path: Option<&Path>) -> Option<Treat> {
    let treat = Treat::parse(section)?;
    if treat.by() == TreatBy::Grid {
        let lonely: Vec<&str> =
            ["margin_mm", "uncertainty_mm"].into_iter().filter(|key| section.has_key(key)).collect();
        lonely.iter().for_each(|key| section.problem(key, "has no effect without by = \"break\""));
        return lonely.is_empty().then_some(treat);
    }
    let Some(path) = path else { return Some(treat) };
    let (found_mm, least_mm) = (treat.widened_mm(path), treat.least_mm(path));
    if found_mm < least_mm {
        let [found, least] = [found_mm, least_mm].map(shortest_text);
        let message = format!(
            "found {found} (at least {least}: half of path.disc_diameter_mm, and uncertainty_mm): a break at the area's \
             border would be under the disc for too short a time"
        );
        section.problem("margin_mm", message);
        return None;
    }
    Some(treat)
}
