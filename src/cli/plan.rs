//! `panelprep plan`: plans the sanding path over the named grids, or over the grids that failed in a film.

use super::args::{Common, Plan};
use super::disk;
use super::fault::Fault;
use super::inspected::PlacedPanel;
use super::load;
use super::output::Outcome;
use panelprep_base::geometry::{Base, Flange, Joints, KukaPose, Mask, Panel, Rigid, Tool};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::files;
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe::{Recipe, TreatBy};
use panelprep_service::report::{PanelOverlay, dwell_map, overlap_map};
use panelprep_service::setup::{self, Calibrated, CellFiles, LoadedPanel};
use panelprep_service::stages::plan::{self, ReachStart};
use panelprep_service::stages::removal::{EarlierRemoval, PathRemovalTotal};
use panelprep_service::stages::survey::{ToolState, draw_surface};
use panelprep_service::stages::treat::{self, Broken};
use panelprep_service::stages::{self, corners};
use panelprep_toolpath::path::approach::{Approach, CornerTour};
use panelprep_toolpath::path::disc::DiscWearPlan;
use panelprep_toolpath::path::dwell::{self, Dwell, GridDwell};
use panelprep_toolpath::path::panel_reach::ReachSetup;
use panelprep_toolpath::path::routes::Sander;
use panelprep_toolpath::path::{
    self, DwellSpread, Kinematics, PanelPoses, Program, ProgramName, TreatmentCost, Waypoint,
};
use panelprep_toolpath::surface::{self, Fit, Treated};
use panelprep_vision::inspect::{Demands, Footprint};
use serde_json::{Value, json};
use std::path::Path;

/// A planned path with its verdict, and the data from which it was planned.
struct PlannedPath {
    stage: stages::plan::PlanOutcome,
    fit: Fit,
    /// The base frame that must be set on the robot.
    base: KukaPose,
}

/// Plans a path and reports the result; writes the plan and the KRL program if requested.
///
/// # Errors
/// If a file is invalid, a grid is unknown, or no surface can be fitted.
pub fn run(args: &Plan, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let recipe = load::read_recipe(&args.recipe)?;
    let program = args.krl.as_ref().map(|file| Ok::<_, Fault>((file, program_name(file)?))).transpose()?;
    let base_from_panel = load::located(args.located.as_ref(), &recipe)?;
    let taught = setup::taught(&files, &args.recipe, &recipe)?;
    let fit = surface::examine_fit(&taught.panel, recipe.surface()).or_else(|refusal| {
        if let (Some(folder), Some(map)) = (&args.pictures, &refusal.map) {
            disk::write_drawings(folder, [draw_surface(map)])?;
        }
        Err(Fault::stage(refusal.error))
    })?;
    let on = (&taught.panel, &fit);
    let (grids, treated, remark) = places(args, (&files, &taught, &fit), &recipe)?;
    let kinematics = Kinematics::new(files.cell.arm());
    let (reach, from) = reach(&kinematics, &files, &taught, base_from_panel, &recipe)?;
    let worn_mm2 = files.store()?.disc_worn_mm2().map_err(Fault::stage)?;
    let removal = files.removal()?.map(|(model, _)| model);
    let stroke_mm = files.cell.tool().compliant().map(|tool| tool.stroke_mm);
    let tool =
        ToolState { error_mm: files.cell.limits().tool_error_mm(), worn_mm2, removal, stroke_mm, in_air: false };
    let plan = plan::lay_lesser_paths(on, (&treated, &grids), (&recipe, tool)).map_err(Fault::stage)?;
    let is_reach_checked = !matches!(reach, ReachStart::Unknown);
    let mut stage = plan::judge(plan, on, reach, (&recipe, tool), (None, EarlierRemoval::default()));
    stage = stage.with_break_position_check(located_mm(args)?, &recipe);
    if files.cell.limits().workspace().is_some() || program.is_some() {
        let poses = PanelPoses { now: base_from_panel, nominal: taught.panel.nominal_pose };
        stage = stage.with_base_checks(poses, files.cell.limits());
    }
    let reach_words = match &stage.reached {
        Some(reached) => format!(
            "the arm can follow the path, {from}; remaining axis range beyond the margins {:.0}°, tool rotated by {:.0}°",
            reached.arm_travel.room_deg, reached.spin.0
        ),
        None if is_reach_checked => "the arm cannot follow the path".to_owned(),
        None => "reach of the arm not checked: the cell's file names no flange_from_tool".to_owned(),
    };
    let planned = PlannedPath { stage, fit, base: KukaPose::from_rigid(&base_from_panel) };
    let (reached, disc) = (planned.stage.reached.as_ref(), &planned.stage.disc);
    let dwell = planned.dwell(&taught, &recipe);
    let mut outcome = planned.outcome();
    outcome.add_value("grids", json!(grids.iter().map(ToString::to_string).collect::<Vec<_>>()));
    outcome.lines.extend(planned.table(&dwell, disc, &recipe));
    outcome.lines.extend(planned.stage.removed.as_ref().map_or_else(Vec::new, PathRemovalTotal::describe));
    outcome.add_value("removal", json!(planned.removal()));
    outcome.add_line(reach_words);
    remark.into_iter().for_each(|remark| outcome.add_line(remark));
    outcome.add_value(
        "reach",
        json!(reached.map(|r| json!({"room_deg": r.arm_travel.room_deg, "spin_deg": r.spin.0}))),
    );
    outcome.add_value("disc_worn_before_mm2", json!(worn_mm2));
    outcome.add_value("dwell", planned.numbers(&dwell));
    outcome.add_value("dwell_ratio", json!(planned.stage.plan.dwell_ratio().map(|(ratio, _)| ratio)));
    outcome.add_value("max_dwell_ratio", json!(recipe.path().max_dwell_ratio()));
    if let Some((file, name)) = &program {
        let start = reached.and_then(|reached| reached.arm_travel.joints.first()).copied();
        let (is_written, words) =
            planned.program((file, name), (start, files.flange_from_tool()?.value), &recipe)?;
        outcome.add_line(words);
        outcome.add_value("krl", json!(is_written.then_some(file)));
    }
    if let Some(file) = &args.out {
        disk::write(file, Value::Object(outcome.json.clone()).to_string())?;
    }
    if let Some(folder) = &args.pictures {
        let taught_picture = taught.panel.scan.picture();
        let view = PanelOverlay {
            picture: &taught_picture,
            camera: &taught.panel.camera,
            camera_from_panel: taught.panel.panel_from_camera.inverse(),
        };
        let drawn = [planned.stage.draw_plan(&taught.panel, &view), draw_surface(&planned.fit.map)];
        disk::write_drawings(folder, drawn)?;
        disk::write_drawings(folder, planned.stage.draw_removal(&taught.panel))?;
        disk::save_picture(folder, "dwell", &dwell_map(&dwell, &taught.panel.region).map_err(Fault::stage)?)?;
        disk::save_picture(folder, "overlap", &overlap_map(&dwell, &taught.panel.region).map_err(Fault::stage)?)?;
    }
    Ok(outcome)
}

/// Returns the name of the KRL program, which must be the name of its file.
fn program_name(file: &Path) -> Result<ProgramName, Fault> {
    if file.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("src")) {
        return Err(Fault::file_fault(file, "the file name of a KRL program must end in .src"));
    }
    let name = file.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    name.parse().map_err(|error| Fault::file_fault(file, error))
}

/// Returns the pose from which the arm starts the path, with a remark about this pose.
fn reach<'a>(
    kinematics: &'a Kinematics,
    files: &CellFiles,
    taught: &LoadedPanel,
    base_from_panel: Rigid<Base, Panel>,
    recipe: &Recipe,
) -> Result<(ReachStart<'a>, &'static str), Fault> {
    let calibration = files.cell.calibration();
    if calibration.flange_from_tool.is_none() {
        return Ok((ReachStart::Unknown, ""));
    }
    let sees = calibration.flange_camera.is_some() && calibration.flange_from_camera.is_some();
    let Some(park) = files.cell.park_pose().filter(|_| sees && !taught.corners.is_empty()) else {
        let flange_from_tool = files.flange_from_tool()?.value;
        let stand = ReachSetup { arm: kinematics, flange_from_tool, base_from_panel, start_joints: None };
        return Ok((ReachStart::From(stand), "in the best configuration (no route from the park pose is known)"));
    };
    let calibrations = Calibrated::read(files)?.values;
    let tour = CornerTour {
        limits: files.cell.limits(),
        arm: files.cell.arm(),
        park,
        ready: files.cell.pose("ready"),
        flange_from_camera: calibrations.flange_from_camera,
        sander: Sander::new(calibrations.flange_from_tool, recipe.path()),
        corners: &taught.corners,
    };
    let view_limit = corners::max_views(recipe.corner(), taught.corners.len());
    let stand = tour.reachable_corners(kinematics, base_from_panel, view_limit).and_then(|corners| {
        tour.reach_setup(kinematics, &Approach { base_from_panel, corners: &corners, obstacles: None })
    });
    Ok((stand.map_or_else(ReachStart::Refused, ReachStart::From), "coming from the park pose by the corner views"))
}

impl PlannedPath {
    /// Writes the plan as a KRL program, unless the plan is rejected. Returns whether the program was written, and a
    /// message.
    fn program(
        &self,
        (file, name): (&Path, &ProgramName),
        (start, flange_from_tool): (Option<Joints>, Rigid<Flange, Tool>),
        recipe: &Recipe,
    ) -> Result<(bool, String), Fault> {
        let shown = file.display();
        let (Some(start), false) = (start, self.stage.judgement.verdict == Verdict::Reject) else {
            let earlier = if file.exists() { "; the existing file is from an earlier plan" } else { "" };
            return Ok((false, format!("no program was written to {shown}: this plan is rejected{earlier}")));
        };
        let remark = |reason: &Reason| format!("A person must decide: {}", reason.message);
        let remarks: Vec<String> = self.stage.judgement.reasons.iter().map(remark).collect();
        let program = Program {
            name,
            plan: &self.stage.plan,
            flange_from_tool: KukaPose::from_rigid(&flange_from_tool),
            base_from_panel: self.base,
            start,
            remarks: &remarks,
        };
        disk::write(file, path::to_krl(&program, recipe.path()))?;
        let words = "the program sets $TOOL and $BASE and begins with a PTP motion to the first point of the path";
        Ok((true, format!("KRL program written to {shown}; {words}")))
    }

    /// Returns the removal of the plan; `None` if it is not requested or not known.
    fn removal(&self) -> Option<Value> {
        let found = self.stage.removed.as_ref()?.figures?;
        Some(json!({
            "mean_um": found.mean_um, "p5_um": found.low_um, "p95_um": found.high_um, "largest_um": found.largest_um,
            "largest_bound_um": found.largest_bound_um, "within_percent": found.within_percent,
            "uncertainty_percent": found.uncertainty_percent,
        }))
    }

    /// Simulates the dwell time of the disc along the plan.
    fn dwell(&self, taught: &LoadedPanel, recipe: &Recipe) -> Dwell {
        let radius_mm = recipe.path().disc_diameter_mm() / 2.0;
        let (plan, executed) = (&self.stage.plan, dwell::timed_poses(&self.stage.plan));
        dwell::simulate_treated(&self.fit.surface, &taught.panel.region, &plan.treated, &executed, radius_mm)
    }

    /// Returns the results of the simulation as the lines of a table.
    fn table(&self, dwell: &Dwell, disc: &DiscWearPlan, recipe: &Recipe) -> Vec<String> {
        let discs =
            disc.discs().map_or("not counted, disc_life_mm2 is not set".to_owned(), |discs| format!("{discs:.2}"));
        let mut table = vec![
            format!(
                "length             {:8.0} mm, of which {:.0} mm in contact",
                self.stage.plan.length_mm, self.stage.plan.contact_mm
            ),
            format!(
                "time               {:8.1} s at {:.0} mm/s and {:.0} mm/s²",
                self.stage.plan.duration_s,
                recipe.path().feed_mm_s(),
                recipe.path().acceleration_mm_s2()
            ),
            format!(
                "swept by the disc  {:8.0} mm², discs: {discs}; swept before this plan {:.0} mm²",
                disc.swept_mm2,
                disc.wear_after_mm2 - disc.swept_mm2
            ),
            format!(
                "covered            {:8.2} %, longest time under the disc {:.2} s",
                100.0 * dwell.covered_fraction(),
                dwell.longest_s()
            ),
            self.describe_uniformity(recipe),
            "grid      covered %   overlap %   left mm²   mean s    5 % s   95 % s   ratio".to_owned(),
        ];
        table.extend(dwell.grids.iter().map(|grid| {
            let spread = self.grid_spread(grid.id).map_or("nothing treated".to_owned(), |spread| {
                format!("{:6.2}   {:6.2}   {:5.2}", spread.low_s, spread.high_s, spread.ratio())
            });
            format!(
                "{:8}  {:9.2}   {:9.1}   {:8.1}   {:6.2}   {spread}",
                grid.id.to_string(),
                100.0 * grid.covered_fraction(),
                100.0 * grid.overlap(),
                grid.untreated_mm2(),
                grid.mean_dwell_s()
            )
        }));
        table
    }

    fn numbers(&self, dwell: &Dwell) -> Value {
        let grid = |grid: &GridDwell| {
            let spread = self.grid_spread(grid.id);
            json!({
                "grid": grid.id.to_string(), "share": grid.covered_fraction(), "overlap": grid.overlap(),
                "left_mm2": grid.untreated_mm2(), "mean_dwell_s": grid.mean_dwell_s(),
                "p5_s": spread.map(|spread| spread.low_s), "p95_s": spread.map(|spread| spread.high_s),
                "ratio": spread.map(|spread| spread.ratio()),
            })
        };
        json!(dwell.grids.iter().map(grid).collect::<Vec<_>>())
    }

    fn grid_spread(&self, id: GridId) -> Option<DwellSpread> {
        self.stage.plan.grid_dwell.iter().find(|(known, _)| *known == id).map(|(_, spread)| *spread)
    }

    /// Returns a line about the uniformity of the dwell time.
    fn describe_uniformity(&self, recipe: &Recipe) -> String {
        let (Some(dwell), Some((ratio, grid))) = (self.stage.plan.dwell, self.stage.plan.dwell_ratio()) else {
            return "dwell time         nothing is treated".to_owned();
        };
        let whose = grid.map_or("all together".to_owned(), |id| format!("the worst, {id}"));
        let [ratio, allowed] = distinguishable_texts(ratio, recipe.path().max_dwell_ratio(), 2);
        format!(
            "dwell time         {:8} s at 5 % of the treated area, {} s at 95 %; ratio {ratio} ({whose}), limit \
             {allowed}",
            fixed_decimals(dwell.low_s, 2),
            fixed_decimals(dwell.high_s, 2)
        )
    }

    /// Returns the description of the plan as lines.
    fn describe_plan(&self) -> Vec<String> {
        let plan = &self.stage.plan;
        let mut words = vec![format!(
            "planned: {} paths, {:.0} mm² to treat, {:.0} mm, {:.0} s, coverage {:.3}; surface fitted to {:.3} mm rms",
            plan.paths.len(),
            plan.treated_mm2(),
            plan.length_mm,
            plan.duration_s,
            plan.coverage,
            self.fit.deviation.rms_mm
        )];
        words.extend(plan.costs.iter().flat_map(plan::costs_text));
        if let Some(step) = plan.step_over_mm {
            words.push(format!("step-over {:.2} to {:.2} mm", step.min_mm, step.max_mm));
        }
        words
    }

    fn outcome(&self) -> Outcome {
        let mut outcome = Outcome::from_judgement(&self.stage.judgement);
        outcome.add_checks(&self.stage.checks);
        outcome.lines.extend(self.describe_plan());
        outcome.add_line(format!("set base: {}", self.base));
        let paths: Vec<_> = self
            .stage
            .plan
            .paths
            .iter()
            .map(|path| {
                let grids: Vec<String> = path.grids.iter().map(ToString::to_string).collect();
                let contact: Vec<bool> = path.waypoints.iter().map(|waypoint| waypoint.contact).collect();
                let waypoints: Vec<KukaPose> = path.waypoints.iter().map(Waypoint::pose).collect();
                let feeds: Vec<f64> = path.waypoints.iter().map(|waypoint| waypoint.feed_mm_s).collect();
                let blends: Vec<f64> = path.waypoints.iter().map(|waypoint| waypoint.blend_mm).collect();
                json!({
                    "grids": grids, "waypoints": waypoints, "contact": contact, "feed_mm_s": feeds, "blend_mm": blends,
                })
            })
            .collect();
        outcome.add_value("paths", json!(paths));
        outcome.add_value("base", json!(self.base));
        outcome.add_value("length_mm", json!(self.stage.plan.length_mm));
        outcome.add_value("contact_mm", json!(self.stage.plan.contact_mm));
        outcome.add_value("duration_s", json!(self.stage.plan.duration_s));
        outcome.add_value("coverage", json!(self.stage.plan.coverage));
        let by = if self.stage.plan.treated.areas().is_some() { "break" } else { "grid" };
        outcome.add_value("treated_by", json!(by));
        outcome.add_value("treated_mm2", json!(self.stage.plan.treated_mm2()));
        outcome.add_value("breaks_reached", json!(self.stage.plan.breaks_reached));
        let cost =
            |cost: TreatmentCost| json!({"under_disc_mm2": cost.under_disc_mm2, "duration_s": cost.duration_s});
        let costs = self.stage.plan.costs;
        let costs = costs.map(|both| {
            json!({"around_breaks": both.around_breaks.map(cost), "whole_grids": both.whole_grids.map(cost)})
        });
        outcome.add_value("costs", json!(costs));
        let step_over = self.stage.plan.step_over_mm.map(|step| json!({"min": step.min_mm, "max": step.max_mm}));
        outcome.add_value("step_over_mm", json!(step_over));
        outcome
    }
}

/// The error for a mask that does not have the size of the camera's pictures.
#[derive(Debug, thiserror::Error)]
#[error(
    "the mask has {} × {} px, the camera's pictures have {} × {} px; name a mask that `inspect --pictures` wrote",
    found_px[0], found_px[1], camera_px[0], camera_px[1]
)]
struct OtherSize {
    found_px: [usize; 2],
    camera_px: [usize; 2],
}

/// Returns the grids of a plan, and the areas of these grids that are treated. Also returns a remark if the recipe
/// requires areas around breaks but the breaks are not known.
///
/// # Errors
/// If a file is invalid, or a name is not that of a grid.
fn places(
    args: &Plan,
    (files, taught, fit): (&CellFiles, &LoadedPanel, &Fit),
    recipe: &Recipe,
) -> Result<(Vec<GridId>, Treated, Option<&'static str>), Fault> {
    let named = args.grids.iter().map(|text| text.parse::<GridId>().map_err(Fault::stage));
    let named = named.collect::<Result<Vec<_>, _>>()?;
    let Some(mask) = &args.broken else {
        let grids = if named.is_empty() { taught.panel.region.ids().collect() } else { named };
        let is_around = recipe.treat().by() == TreatBy::Break;
        let remark = "whole grids, although the recipe has [treat] by = \"break\": the breaks are not known without --broken";
        let treated = Treated::from_grids(&grids);
        return Ok((grids, treated, is_around.then_some(remark)));
    };
    let broken = broken(mask, args, (files, taught), recipe)?;
    let least_mm2 = Demands::from_recipe(recipe, files.cell.limits()).min_break_mm2;
    let is_failed = |(id, [_, mm2]): &(GridId, [f64; 2])| (*mm2 >= least_mm2).then_some(*id);
    let grids = if named.is_empty() { broken.located_mm2.iter().filter_map(is_failed).collect() } else { named };
    let treated = treat::treated((&taught.panel, fit), &broken, (&grids, &[]), recipe);
    Ok((grids, treated, None))
}

/// Reads the mask of a film, and returns the water breaks on the panel at the panel's pose in this film.
fn broken(
    mask: &Path,
    args: &Plan,
    (files, taught): (&CellFiles, &LoadedPanel),
    recipe: &Recipe,
) -> Result<Broken, Fault> {
    let gray = files::read_gray(&disk::read(mask)?).map_err(|error| Fault::file_fault(mask, error))?;
    let placed = PlacedPanel::read(files, recipe, args.located.as_ref())?;
    let (found_px, camera_px) = ([gray.width, gray.height], [placed.camera.width_px, placed.camera.height_px]);
    if found_px != camera_px {
        return Err(Fault::file_fault(mask, OtherSize { found_px, camera_px }));
    }
    let mask = Mask::from_gray(&gray);
    let camera_from_panel = placed.base_from_camera.inverse() * placed.base_from_panel;
    let footprint = Footprint::of_view(&taught.panel, (&placed.camera, camera_from_panel), recipe.inspect());
    let footprint = footprint.map_err(Fault::stage)?;
    let grids = footprint.grids().iter().zip(footprint.broken_mm2(&mask));
    let located_mm2 = grids.map(|(grid, mm2)| (grid.id, [mm2, mm2])).collect();
    Ok(Broken { places: footprint.taught_pixels(&mask), located_mm2 })
}

/// Returns the uncertainty (95 %) of the pose for which the plan is made, mm; `None` if it is not known.
///
/// # Errors
/// If the file with the pose is invalid.
fn located_mm(args: &Plan) -> Result<Option<f64>, Fault> {
    Ok(args.located.as_deref().map(load::located_mm).transpose()?.flatten())
}
