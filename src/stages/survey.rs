//! The surface of the region, and what of it the arm reaches where the panel stands: known before any water runs.

use super::{Drawing, names};
use crate::force::check_stroke;
use crate::panel::{GridId, TaughtPanel};
use crate::path::check_pad;
use crate::path::disc::DiscUse;
use crate::path::panel_reach::{self, GridReach, Stand};
use crate::recipe::{self, Recipe};
use crate::record::{Check, Finding, Kind, name};
use crate::removal::model::Model;
use crate::report::surface_map;
use crate::surface::{Deviation, DeviationMap, Fit};
use crate::verdict::{Judgement, Reason, SetBy};

/// What is said of the tool beside the path: the error at its tip, and what the disc in use has swept so far.
#[derive(Debug, Clone, Copy)]
pub struct ToolState {
    /// `[limits] tool_error_mm` of the cell.
    pub error_mm: Option<f64>,
    /// Swept by the disc in use, mm².
    pub worn_mm2: f64,
    /// What the disc takes off, where that is calibrated.
    pub removal: Option<Model>,
    /// The stroke of a compliant tool, mm.
    pub stroke_mm: Option<f64>,
    /// The path is run in the air: what contact would need, wear or remove is no reason for anything.
    pub in_air: bool,
}

impl ToolState {
    /// Whether a compliant tool's stroke takes up what is not known of the way over this surface; none of another tool.
    pub(super) fn check_stroke(&self, fit: &Fit, settings: &recipe::Path) -> Option<Check> {
        let errors_mm = [self.error_mm, Some(fit.deviation.p95_mm), Some(settings.chord_error_mm())];
        self.stroke_mm.map(|stroke_mm| check_stroke(stroke_mm, settings.press_in_mm(), errors_mm))
    }

    /// A check of what contact needs, wears or removes.
    pub(super) fn of_contact(&self, check: Check) -> Check {
        if self.in_air { check.without_consequence() } else { check }
    }
}

/// What of a panel the arm reaches, grid by grid.
#[derive(Debug)]
pub struct Surveyed {
    /// Every grid; none where the arm does not come to the panel, or the surface allows no path.
    pub grids: Vec<GridReach>,
    /// Grids that are not reached, and steps that are too large.
    broken: Vec<Check>,
    /// What the tool must be fit for.
    of_tool: Vec<Check>,
    /// The verdict.
    pub judgement: Judgement,
}

/// Follows the path over every grid alone, from where the arm stands before contact; `stand` says why it does not come
/// there, where it does not.
pub fn survey(
    (panel, fit): (&TaughtPanel, &Fit),
    stand: Result<Stand<'_>, Reason>,
    recipe: &Recipe,
    tool: ToolState,
) -> Surveyed {
    let rejected = |reason| Surveyed {
        grids: vec![],
        broken: vec![],
        of_tool: vec![],
        judgement: Judgement::of(vec![reason], vec![]),
    };
    let stand = match stand {
        Ok(stand) => stand,
        Err(reason) => return rejected(reason),
    };
    let (around, settings) = ((&panel.region, panel.outline.as_slice()), recipe.path());
    match panel_reach::of_grids(&fit.surface, around, &stand, settings) {
        Ok(grids) => {
            let (pad, disc) = (check_pad(settings, tool.error_mm), disc(&grids, settings, tool));
            let stroke = tool.check_stroke(fit, settings);
            let of_tool = pad.into_iter().chain(stroke).chain([disc]).map(|check| tool.of_contact(check));
            let of_tool: Vec<Check> = of_tool.collect();
            let broken = panel_reach::broken_by_grids(&grids);
            let judgement = Judgement::of_checks(broken.iter().chain(&of_tool));
            Surveyed { grids, broken, of_tool, judgement }
        }
        Err(error) => rejected(super::reason("no_path", &error)),
    }
}

/// A disc that would not last for the largest grid is changed before the panel is wet.
fn disc(grids: &[GridReach], settings: &recipe::Path, tool: ToolState) -> Check {
    let largest_mm2 = grids.iter().map(|grid| grid.swept_mm2).fold(0.0, f64::max);
    let (worn_after_mm2, life_mm2) = (tool.worn_mm2 + largest_mm2, settings.disc_life_mm2());
    DiscUse { swept_mm2: largest_mm2, worn_after_mm2, life_mm2 }.check(name::WORN_BY_A_GRID, "one grid")
}

/// How the surface lies in the taught scan, pixel by pixel.
pub fn drawn_surface(map: &DeviationMap) -> Drawing {
    Drawing::new("surface", "The region's scan beside the fitted surface", surface_map(map))
}

impl Surveyed {
    /// The result for the record.
    pub fn finding(&self, pass: u8, deviation: &Deviation, (panel, recipe): (&TaughtPanel, &Recipe)) -> Finding {
        let reached = self.grids.iter().filter_map(|grid| grid.outcome.as_ref().ok());
        let missed: Vec<GridId> =
            self.grids.iter().filter(|grid| grid.outcome.is_err()).map(|grid| grid.id).collect();
        let least_deg = reached.clone().copied().reduce(f64::min);
        let all = panel.region.ids().count() as f64;
        let finding =
            Finding::new(Kind::Reach, pass, self.judgement.clone()).with(surface(deviation, recipe)).with([
                Check::new("grids within the arm's reach", "", reached.count() as f64)
                    .at_least(all, SetBy::Program),
                Check::new("room beyond the arm's margins, at least", "°", least_deg),
            ]);
        let finding = finding.with(self.broken.iter().chain(&self.of_tool).cloned());
        if missed.is_empty() { finding } else { finding.detail("out_of_reach", names(&missed)) }
    }
}

/// How the surface lies in the scan.
fn surface(deviation: &Deviation, recipe: &Recipe) -> [Check; 5] {
    let limits = recipe.surface();
    [
        Check::new("residual of the surface, rms", "mm", deviation.rms_mm)
            .at_most(limits.max_rms_mm(), SetBy::recipe("surface.max_rms_mm")),
        Check::new("residual of the surface, 95 %", "mm", deviation.p95_mm),
        Check::new("the scan's white noise", "mm", deviation.noise_mm),
        Check::new("region without points that fit", "%", deviation.missing_percent)
            .at_most(limits.max_missing_percent(), SetBy::recipe("surface.max_missing_percent")),
        Check::new("largest hole in the region", "mm", deviation.largest_hole_mm)
            .at_most(limits.max_hole_mm(), SetBy::recipe("surface.max_hole_mm")),
    ]
}
