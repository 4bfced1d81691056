//! The path over some grids: laid on the surface, followed by the arm with its tool turned as that needs, and judged by
//! every gate.

use super::survey::ToolState;
use super::{Drawing, names};
use crate::geometry::{Panel, Point, Tool};
use crate::panel::{Grid, GridId, TaughtPanel};
use crate::path::disc::DiscUse;
use crate::path::panel_reach::{self, Reached, Stand};
use crate::path::{self, MIN_COVERAGE, Plan, PlanError, ToolPath, judge_pad};
use crate::recipe::Recipe;
use crate::record::{Finding, Kind, Limit, Number, name};
use crate::report::View;
use crate::surface::Fit;
use crate::verdict::{Judgement, Reason};

/// Where the arm follows a plan from.
#[derive(Debug)]
pub enum Reach<'a> {
    /// It is not known which tool it has: reach is not looked at.
    Unknown,
    /// It stands so before the panel.
    From(Stand<'a>),
    /// It does not come there.
    Refused(Reason),
}

/// A plan with the verdict of every gate.
#[derive(Debug, Clone)]
pub struct Planned {
    /// The paths in the panel's frame, the tool turned as the arm follows best.
    pub plan: Plan,
    /// How the arm follows; `None` where it does not, or where that was not looked at.
    pub reached: Option<Reached>,
    /// What the path wears of the disc.
    pub disc: DiscUse,
    /// The verdict.
    pub judgement: Judgement,
}

/// Lays paths over these grids of a fitted surface.
///
/// # Errors
/// Where the surface allows none.
pub fn lay((panel, fit): (&TaughtPanel, &Fit), grids: &[GridId], recipe: &Recipe) -> Result<Plan, PlanError> {
    let holes = fit.map.holes(&panel.region, recipe.path().lift_hole_mm());
    path::plan_around(&fit.surface, &panel.region, grids, (&panel.outline, &holes), recipe.path())
}

/// Follows a plan with the arm and judges it.
pub fn judge(
    plan: Plan,
    (panel, fit): (&TaughtPanel, &Fit),
    reach: Reach<'_>,
    recipe: &Recipe,
    tool: ToolState,
) -> Planned {
    let settings = recipe.path();
    let (reached, of_reach) = match reach {
        Reach::Unknown => (None, Judgement::of(vec![], vec![])),
        Reach::Refused(reason) => (None, Judgement::of(vec![reason], vec![])),
        Reach::From(stand) => {
            let reached = panel_reach::of_plan(&plan, &stand, settings);
            let judgement = panel_reach::judge_plan(&reached, (&fit.surface, &panel.region));
            (reached.ok(), judgement)
        }
    };
    let disc = DiscUse::of(&plan, settings, tool.worn_mm2);
    let worn = disc.change("this path").into_iter().collect();
    let judgement = of_reach
        .and(path::judge(&plan, settings))
        .and(judge_pad(settings, tool.error_mm))
        .and(Judgement::of(vec![], worn));
    let plan = match &reached {
        Some(reached) => panel_reach::turned(&plan, reached.spin),
        None => plan,
    };
    Planned { plan, reached, disc, judgement }
}

impl Planned {
    /// The path over the panel in a picture of it.
    pub fn drawn(&self, panel: &TaughtPanel, view: &View<'_>) -> Drawing {
        let contact = |path: &ToolPath| -> Vec<Point<Panel>> {
            let on_panel = path.waypoints.iter().filter(|waypoint| waypoint.contact);
            on_panel.map(|waypoint| waypoint.pose.to_rigid::<Panel, Tool>().origin()).collect()
        };
        let paths: Vec<_> = self.plan.paths.iter().map(contact).collect();
        let planned = |grid: &Grid| self.plan.paths.iter().any(|path| path.grids.contains(&grid.id));
        Drawing::new(
            "planned",
            "The planned path of the tool over the panel",
            view.planned(panel, &paths, &planned),
        )
    }

    /// The result for the record.
    pub fn finding(&self, pass: u8, grids: &[GridId], recipe: &Recipe) -> Finding {
        let (plan, disc, settings) = (&self.plan, &self.disc, recipe.path());
        let reached = self.reached.as_ref();
        let least_covered = plan.grids.iter().map(|grid| grid.share()).fold(1.0, f64::min);
        let waypoints: usize = plan.paths.iter().map(|path| path.waypoints.len()).sum();
        let steps = plan.step_over_mm;
        Finding::new(Kind::Plan, pass, self.judgement.clone()).detail("grids", names(grids)).with([
            Number::new("coverage of these grids", "", plan.coverage),
            Number::new("coverage of the worst of them", "", least_covered).within(Limit::AtLeast(MIN_COVERAGE)),
            Number::new("step-over, smallest", "mm", steps.map(|step| step.min_mm)),
            Number::new("step-over, largest", "mm", steps.map(|step| step.max_mm))
                .within(Limit::AtMost(settings.step_over_mm())),
            Number::new("time under the disc, 5 % of the treated area", "s", plan.dwell.map(|dwell| dwell.low_s)),
            Number::new("time under the disc, 95 % of the treated area", "s", plan.dwell.map(|dwell| dwell.high_s)),
            Number::new(
                "their ratio, all together or the worst grid's",
                "",
                plan.dwell_ratio().map(|(ratio, _)| ratio),
            )
            .within(Limit::AtMost(settings.max_dwell_ratio())),
            Number::new("disc beyond the panel's outline", "mm", plan.overhang.largest_mm)
                .within(Limit::AtMost(settings.edge_overhang_mm())),
            Number::new("paths", "", plan.paths.len() as f64),
            Number::new(name::PLANNED, "", waypoints as f64),
            Number::new("length", "mm", plan.length_mm),
            Number::new("time at the recipe's feed", "s", plan.duration_s),
            Number::new("turn of the tool about its axis, for reach", "°", reached.map(|reached| reached.spin.0)),
            Number::new("room beyond the arm's margins", "°", reached.map(|reached| reached.travel.room_deg)),
            Number::new("swept by the disc", "mm²", disc.swept_mm2),
            Number::new("worn of the disc afterwards", "mm²", disc.life_mm2.map(|_| disc.worn_after_mm2))
                .within(disc.life_mm2.map_or(Limit::Unlimited, Limit::AtMost)),
        ])
    }
}
