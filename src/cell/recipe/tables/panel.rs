//! The panel's name, and the parts of its outline that a person states: `[panel]`.

use panelprep_base::config::{Section, settings};
use panelprep_base::geometry::{Pixel, polygon};
use panelprep_base::number_text::distinguishable_texts;

settings! {
    /// `[panel]`: the panel's name, and a person's statements on its outline. `panel = "name"` alone is the short
    /// form.
    pub struct Panel {
        /// The panel's name, under which the store has the taught data.
        name: String, (), required;
        /// The corners of the panel's outline, in order, px in the taught scan's picture: for a panel with an edge
        /// that the scan does not show, because points are missing there or another object lies beside it. Without
        /// them the scan's depths determine where the panel ends. Edges are still measured by colour within 3 px of
        /// these lines.
        outline_px: Vec<[f64; 2]>, 0.0..=20_000.0, default Vec::new();
        /// The places at which holders or clamps touch the panel's edge: four corners each, px in the taught scan's
        /// picture. The area inside is neither outline nor surface when the panel is taught or located.
        held_px: Vec<[[f64; 2]; 4]>, 0.0..=20_000.0, default Vec::new();
    }
}

impl Panel {
    pub(in crate::recipe) fn name_text(&self) -> &str {
        &self.name
    }
}

/// Largest number of corners: an outline with more corners is a curve that no person has drawn.
const MAX_CORNERS: usize = 200;
/// The smallest area of a polygon that a person draws, px².
const MIN_AREA_PX2: f64 = 16.0;

pub(in crate::recipe) fn parse_panel(top: &Section<'_, '_>) -> Option<Panel> {
    if !top.is_table("panel") {
        let name = top.parse::<String>("panel", (), None)?;
        return Some(Panel { name, outline_px: Vec::new(), held_px: Vec::new() });
    }
    let section = top.section("panel");
    let panel = Panel::parse(&section)?;
    let outline = &panel.outline_px;
    if !outline.is_empty() {
        if !(3..=MAX_CORNERS).contains(&outline.len()) {
            let found = outline.len();
            section.problem("outline_px", format!("found {found} corners, valid: 3 to {MAX_CORNERS}, or none"));
            return None;
        }
        if let Some(problem) = polygon_problem(outline) {
            section.problem("outline_px", format!("the outline {problem}"));
            return None;
        }
    }
    for (index, held) in panel.held_px.iter().enumerate() {
        if let Some(problem) = polygon_problem(held) {
            section.problem("held_px", format!("item {}: the held place {problem}", index + 1));
            return None;
        }
    }
    Some(panel)
}

/// Returns the reason why these corners do not form a simple polygon; `None` if they do.
fn polygon_problem(corners: &[[f64; 2]]) -> Option<String> {
    let pixels: Vec<Pixel> = corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect();
    if let Some([first, second]) = polygon::crossing_sides(&pixels) {
        return Some(format!("crosses itself: the sides from corner {} and from corner {}", first + 1, second + 1));
    }
    let area_px2 = polygon::signed_area_px2(&pixels).abs();
    (area_px2 < MIN_AREA_PX2).then(|| {
        let [area, needed] = distinguishable_texts(area_px2, MIN_AREA_PX2, 1);
        format!("has an area of {area} px², at least {needed} px² are needed")
    })
}
