//! The path over the areas to sand: planned on the surface, followed by the arm with the best rotation of the tool
//! about its axis, and checked.

use super::removal::{self, EarlierRemoval, PathRemovalTotal, RemovalInputs};
use super::survey::ToolState;
use super::{ResultDrawing, names, treat};
use crate::report::PanelOverlay;
use panelprep_base::geometry::{Panel, Pixel, Point};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Judgement, Reason, Severity};
use panelprep_cell::cell::Limits;
use panelprep_cell::panel::{Grid, GridId, TaughtPanel};
use panelprep_cell::recipe::{Recipe, RemovalMethod};
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_toolpath::path::disc::DiscWearPlan;
use panelprep_toolpath::path::panel_reach::{self, ReachSetup, ReachablePlan};
use panelprep_toolpath::path::{
    self, Plan, PlanError, ToolPath, TreatmentCost, TreatmentCosts, WaypointLimits, check_pad, dwell,
};
use panelprep_toolpath::removal::map::RemovalMap;
use panelprep_toolpath::surface::{Fit, Parameter, ParameterPatch, Treated};

/// Number of points on each side of the drawn border of an area.
const POINTS_PER_SIDE: usize = 8;

/// The pose from which the arm begins to follow a plan, if it is known.
#[derive(Debug)]
pub enum ReachStart<'a> {
    /// The arm's tool is not known, so the reach is not checked.
    Unknown,
    /// The arm's pose in front of the panel.
    From(ReachSetup<'a>),
    /// The arm cannot reach its pose in front of the panel.
    Refused(Reason),
}

/// A plan with the verdict of all its checks.
#[derive(Debug, Clone)]
pub struct PlanOutcome {
    /// The paths in the panel's frame, with the rotation of the tool that the arm follows best.
    pub plan: Plan,
    /// The motion of the arm along the paths; `None` if the arm cannot follow them, or if this was not checked.
    pub reached: Option<ReachablePlan>,
    /// Wear of the disc by the path.
    pub disc: DiscWearPlan,
    /// The removal over all passes on the part; `None` if the recipe does not require a removal, or if it is not known.
    pub removed: Option<PathRemovalTotal>,
    /// Every judged number.
    pub checks: Vec<Check>,
    /// The verdict.
    pub judgement: Judgement,
}

/// Plans paths over these areas of a fitted surface, with the feeds for the removal that the recipe requires.
///
/// # Errors
/// If no path is possible on the surface.
pub fn lay_paths(
    (panel, fit): (&TaughtPanel, &Fit),
    treated: &Treated,
    (recipe, tool): (&Recipe, ToolState),
) -> Result<Plan, PlanError> {
    let holes = fit.map.holes(&panel.region, recipe.path().lift_hole_mm());
    let abrasive =
        RemovalInputs { panel, fit, recipe, tool, earlier: None, earlier_removal: EarlierRemoval::default() };
    let (outline, beyond_mm) = ((panel.outline.as_slice(), &holes), abrasive.overrun_mm());
    let plan =
        path::plan_beyond_borders(&fit.surface, &panel.region, treated, outline, (recipe.path(), beyond_mm))?;
    Ok(abrasive.schedule_feeds(plan))
}

/// Plans paths over areas around water breaks, if these paths sand less surface in less time than paths over the
/// complete failed grids; otherwise over the complete grids. Many small areas need more motions through the air and
/// lower feeds. The plan contains the costs of both.
///
/// # Errors
/// If no path is possible on the surface.
pub fn lay_lesser_paths(
    on: (&TaughtPanel, &Fit),
    (treated, failed): (&Treated, &[GridId]),
    with: (&Recipe, ToolState),
) -> Result<Plan, PlanError> {
    let around = lay_paths(on, treated, with);
    if treated.areas().is_none() {
        return around;
    }
    let ((panel, fit), radius_mm) = (on, with.0.path().disc_diameter_mm() / 2.0);
    let whole = lay_paths(on, &treated.as_whole_grids(&panel.region, failed), with);
    let all: Vec<GridId> = panel.region.ids().collect();
    let cost = |plan: &Plan| {
        // The simulation contains all grids, because the disc also overlaps grids that are not planned.
        let dwell = dwell::simulate(&fit.surface, &panel.region, &all, &dwell::timed_poses(plan), radius_mm);
        TreatmentCost { under_disc_mm2: dwell.under_disc_mm2(), duration_s: plan.duration_s }
    };
    let [around_breaks, whole_grids] = [&around, &whole].map(|plan| plan.as_ref().ok().map(cost));
    let costs = TreatmentCosts { around_breaks, whole_grids };
    let chosen = if costs.is_less_around_breaks() { around } else { whole };
    Ok(Plan { costs: Some(costs), ..chosen? })
}

/// Computes how the arm follows a plan, and checks the plan.
pub fn judge(
    plan: Plan,
    (panel, fit): (&TaughtPanel, &Fit),
    reach: ReachStart<'_>,
    (recipe, tool): (&Recipe, ToolState),
    (earlier, before): (Option<&RemovalMap>, EarlierRemoval),
) -> PlanOutcome {
    let settings = recipe.path();
    let unknown = || Check::new(panel_reach::ROOM_NUMBER, "°", None);
    let (reached, room) = match reach {
        ReachStart::Unknown => (None, unknown()),
        ReachStart::Refused(reason) => (None, unknown().with_reason(Some(reason), Severity::Reject)),
        ReachStart::From(stand) => {
            let reached = panel_reach::follow_plan(&plan, &stand, settings);
            let room = panel_reach::check_plan(&reached, (&fit.surface, &panel.region));
            (reached.ok(), room)
        }
    };
    let disc = DiscWearPlan::compute(&plan, settings, tool.worn_mm2);
    let removed =
        RemovalInputs { panel, fit, recipe, tool, earlier, earlier_removal: before }.planned_removal(&plan);
    let (of_path, path_judgement) = path_checks(&plan, recipe, removed.is_some());
    let of_removal = removed.as_ref().map_or_else(Vec::new, |removed| removed.checks.clone());
    let of_contact = |check: Check| tool.contact_check(check);
    let of_removal = of_removal.into_iter().chain(removal::unknown_removal_check(recipe, tool)).map(of_contact);
    let of_removal: Vec<Check> = of_removal.collect();
    let pad = check_pad(settings, tool.error_mm).map(of_contact);
    let worn = of_contact(disc.check_wear("worn of the disc afterwards", "this path"));
    let stroke = tool.check_stroke(fit, settings).map(of_contact);
    let judgement = Judgement::from_checks([&room])
        .combined_with(path_judgement)
        .combined_with(Judgement::from_checks(&pad))
        .combined_with(Judgement::from_checks(&stroke))
        .combined_with(Judgement::from_checks([&worn]))
        .combined_with(Judgement::from_checks(&of_removal));
    let spin_deg = reached.as_ref().map(|reached| reached.spin.0);
    let spin = Check::new("turn of the tool about its axis, for reach", "°", spin_deg);
    let swept = Check::new("swept by the disc", "mm²", disc.swept_mm2);
    let of_arm = [spin, room].into_iter().chain(pad).chain(stroke).chain([swept, worn]);
    let checks = of_path.into_iter().chain(size_checks(&plan)).chain(of_arm).chain(of_removal).collect();
    let plan = match &reached {
        Some(reached) => panel_reach::plan_with_spin(&plan, reached.spin),
        None => plan,
    };
    PlanOutcome { plan, reached, disc, removed, checks, judgement }
}

impl PlanOutcome {
    /// Adds the checks before the motion, at the panel's pose: box, step lengths, rotations and tilt.
    #[must_use]
    pub fn with_base_checks(mut self, panel: path::PanelPoses, limits: &Limits) -> Self {
        let broken = path::violated_in_base(&self.plan, panel, &WaypointLimits::from(limits));
        self.judgement = Judgement::from_checks(&broken).combined_with(self.judgement);
        self.checks.extend(broken);
        self
    }

    /// If areas around water breaks are planned, adds the check of the position uncertainty of the breaks. `located_mm`
    /// is the uncertainty of the panel's pose, 95 %.
    #[must_use]
    pub fn with_break_position_check(mut self, located_mm: Option<f64>, recipe: &Recipe) -> Self {
        if let Some(check) = treat::checks(&self.plan.treated, located_mm, recipe) {
            self.judgement = Judgement::from_checks([&check]).combined_with(self.judgement);
            self.checks.push(check);
        }
        self
    }

    /// Draws the path over the panel in a picture of the panel.
    pub fn draw_plan(&self, panel: &TaughtPanel, view: &PanelOverlay<'_>) -> ResultDrawing {
        let contact = |path: &ToolPath| -> Vec<Point<Panel>> {
            let on_panel = path.waypoints.iter().filter(|waypoint| waypoint.contact);
            on_panel.map(|waypoint| waypoint.panel_from_tool.origin()).collect()
        };
        let paths: Vec<_> = self.plan.paths.iter().map(contact).collect();
        let planned = |grid: &Grid| self.plan.paths.iter().any(|path| path.grids.contains(&grid.id));
        let areas = self.plan.treated.areas().unwrap_or_default();
        let areas: Vec<_> = areas.iter().map(|area| area_border(panel, area)).collect();
        ResultDrawing::new(
            "planned",
            "The planned path of the tool over the panel",
            view.draw_plan(panel, (&paths, &areas), &planned),
        )
    }

    /// Draws the removal of the path, if it is known.
    pub fn draw_removal(&self, panel: &TaughtPanel) -> Option<ResultDrawing> {
        let caption = "Depth that this path and earlier passes on this part remove, µm";
        self.removed.as_ref().map(|removed| removed.draw_map(panel, ("removal_planned", caption)))
    }

    /// Returns the result for the record.
    pub fn finding(&self, pass: u8, grids: &[GridId]) -> Finding {
        let finding = Finding::new(Kind::Plan, pass, self.judgement.clone());
        let finding = finding.with_detail("grids", names(grids)).with_checks(self.checks.iter().cloned());
        let finding = match &self.plan.costs {
            Some(costs) => finding.with_detail("cost around the breaks and of whole grids", costs_text(costs)),
            None => finding,
        };
        if self.plan.treated.areas().is_none() {
            return finding;
        }
        // An area may extend into grids that did not fail: these are sanded as well, and the pass is counted for them.
        let beside = self.plan.treated.grids().iter().copied().filter(|id| !grids.contains(id));
        let beside: Vec<GridId> = beside.collect();
        let mm2 = Check::new(name::AROUND_BREAKS, "mm²", self.plan.treated_mm2());
        let finding = finding.with_detail("areas around breaks", areas_text(&self.plan)).with_checks([mm2]);
        if beside.is_empty() {
            finding
        } else {
            finding.with_detail("grids beside that are abraded as well", names(&beside))
        }
    }
}

/// Describes the costs of both treatments, and the resulting choice.
pub fn costs_text(costs: &TreatmentCosts) -> Vec<String> {
    let [around, whole] = match (costs.around_breaks, costs.whole_grids) {
        (Some(around), Some(whole)) => {
            let mm2 = distinguishable_texts(around.under_disc_mm2, whole.under_disc_mm2, 0);
            let s = distinguishable_texts(around.duration_s, whole.duration_s, 0);
            [0, 1].map(|way| format!("{} mm² sanded, {} s", mm2[way], s[way]))
        }
        (around, whole) => [around, whole].map(|cost| if cost.is_some() { "a path" } else { "no path" }.to_owned()),
    };
    let chosen = if costs.is_less_around_breaks() { "around the breaks" } else { "whole grids" };
    vec![format!("around the breaks: {around}"), format!("whole grids: {whole}"), format!("chosen: {chosen}")]
}

/// Returns the names of the grids of each area, in the order of the path.
fn areas_text(plan: &Plan) -> Vec<String> {
    let text = |path: &ToolPath| names(&path.grids).join(", ");
    plan.paths.iter().map(text).collect()
}

/// Returns the border of an area on the panel; points at which the panel's surface is not known are omitted.
fn area_border(panel: &TaughtPanel, area: &ParameterPatch) -> Vec<Point<Panel>> {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let side = |side: usize| {
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        (0..POINTS_PER_SIDE).map(move |step| {
            let share = step as f64 / POINTS_PER_SIDE as f64;
            Parameter { u: from.0 + share * (to.0 - from.0), v: from.1 + share * (to.1 - from.1) }
        })
    };
    let pixel = |at: Parameter| -> Pixel { panel.region.pixel(nalgebra::Point2::new(at.u, at.v)) };
    (0..4).flat_map(side).filter_map(|share| panel.surface_point_at(pixel(area.parameter_at(share)))).collect()
}

/// Returns all checks of the path. If the feeds are scheduled for the removal, the uniformity of the removal is checked
/// instead of the uniformity of the dwell times.
fn path_checks(plan: &Plan, recipe: &Recipe, is_known: bool) -> (Vec<Check>, Judgement) {
    let (checks, judgement) = path::judge_plan(plan, recipe.path());
    let scheduled = recipe.removal().is_some_and(|asked| asked.method() == RemovalMethod::Scheduled);
    if !(scheduled && is_known) {
        return (checks, judgement);
    }
    let freed = |check: Check| if check.name == name::DWELL_RATIO { check.without_consequence() } else { check };
    let checks: Vec<Check> = checks.into_iter().map(freed).collect();
    let judgement = Judgement::from_checks(&checks);
    (checks, judgement)
}

/// Returns the values that describe the size of the plan.
fn size_checks(plan: &Plan) -> [Check; 4] {
    let waypoints: usize = plan.paths.iter().map(|path| path.waypoints.len()).sum();
    [
        Check::new("paths", "", plan.paths.len() as f64),
        Check::new(name::PLANNED, "", waypoints as f64),
        Check::new("length", "mm", plan.length_mm),
        Check::new("time at the recipe's feed", "s", plan.duration_s),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_toolpath::surface::examine_fit;
    use panelprep_toolpath::surface::scene::{ScanDefects, Shape, recipe, taught};

    /// Expected areas, calculated by hand: the scene's grids are 57 mm wide. The path stays 3 mm inside of an area of
    /// 45 mm, and the disc's radius is 15 mm. The disc therefore covers (39 + 30)² mm² with round corners, 4761 − 193 =
    /// 4568 mm². On the complete grid it covers (51 + 30)² − 193 = 6368 mm².
    ///
    /// An area of 70 mm costs more than the grid, so the grid is planned. Only the break in the grid is used, not the
    /// other one.
    #[test]
    fn areas_with_higher_costs_than_whole_grids_are_not_planned() {
        let recipe = recipe(Shape::Plane, "[treat]\nby = \"break\"\n");
        let panel = taught(Shape::Plane, ScanDefects::default(), &recipe);
        let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
        let failed = [GridId { row: 2, column: 3 }];
        let tool = ToolState { error_mm: None, worn_mm2: 0.0, removal: None, stroke_mm: None, in_air: false };
        let [width_mm, height_mm] = panelprep_toolpath::surface::sides_mm(&fit.surface);
        let at = |x_mm: f64| Parameter { u: 0.5 + x_mm / width_mm, v: 0.5 };
        let planned = |half_mm: f64| {
            let [by_u, by_v] = [half_mm / width_mm, half_mm / height_mm];
            let (low, high) =
                (Parameter { u: 0.5 - by_u, v: 0.5 - by_v }, Parameter { u: 0.5 + by_u, v: 0.5 + by_v });
            let broken = vec![at(0.0), at(33.0)];
            let around = Treated::from_areas(&panel.region, vec![ParameterPatch { low, high }], broken);
            lay_lesser_paths((&panel, &fit), (&around, &failed), (&recipe, tool)).expect("a path")
        };
        let small = planned(22.5);
        let costs = small.costs.expect("compared");
        let [around, whole] = [costs.around_breaks, costs.whole_grids].map(|cost| cost.expect("a path"));
        assert!((around.under_disc_mm2 - 4_568.0).abs() < 150.0, "{around:?}");
        assert!((whole.under_disc_mm2 - 6_368.0).abs() < 200.0, "{whole:?}");
        assert!(small.treated.areas().is_some() && around.duration_s < whole.duration_s, "{around:?} {whole:?}");
        let large = planned(35.0);
        assert_eq!((large.treated.areas(), large.treated.grids()), (None, &failed[..]));
        assert_eq!((large.treated.broken(), large.breaks_reached), (Some(&[at(0.0)][..]), Some(1.0)));
        assert_eq!(costs_text(&large.costs.expect("compared"))[2], "chosen: whole grids");
        let by_grid = Treated::from_grids(&failed);
        let by_grid = lay_lesser_paths((&panel, &fit), (&by_grid, &failed), (&recipe, tool));
        assert_eq!(by_grid.expect("a path").costs, None);
    }
}
