//! `panelprep plan`: the sanding path over the failed grids.

use super::args::{Common, Plan};
use super::assignment::Calibrated;
use super::disk;
use super::fault::Fault;
use super::load::{self, CellFiles, Taught};
use super::outcome::Outcome;
use super::pictures;
use crate::daemon::{self, Approached, Job};
use crate::geometry::{Base, ColorPicture, Flange, Joints, KukaPose, Panel, Point, Rigid, Tool};
use crate::panel::{Grid, GridId};
use crate::path::disc::DiscUse;
use crate::path::dwell::{self, Dwell, GridDwell};
use crate::path::panel_reach::{self, Reached, Stand};
use crate::path::{self, Kinematics, Program, ProgramName, Spread, Waypoint, WaypointLimits};
use crate::recipe::Recipe;
use crate::report::{View, dwell_map, overlap_map, surface_map};
use crate::surface::{self, Deviation, Fit};
use crate::verdict::{Judgement, Reason, Verdict};
use crate::words::{apart, fixed};
use serde_json::{Value, json};
use std::path::Path;

/// A plan with its verdict.
pub struct Planned {
    /// The paths, in the panel's frame.
    pub plan: path::Plan,
    /// The verdict.
    pub judgement: Judgement,
    /// How well the surface lies in the scan.
    pub deviation: Deviation,
    /// The surface, with its deviation pixel by pixel.
    pub fit: Fit,
    /// The pose to set as the robot's base.
    pub base: KukaPose,
}

/// Plans and tells; writes the plan and the KRL program where asked.
///
/// # Errors
/// Where a file is not what it must be, a grid is unknown, or the surface cannot be fitted.
pub fn run(args: &Plan, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let program = args.krl.as_ref().map(|file| Ok::<_, Fault>((file, program_name(file)?))).transpose()?;
    let base_from_panel = load::located(args.located.as_ref())?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let grids = if args.grids.is_empty() {
        taught.panel.region.ids().collect()
    } else {
        args.grids.iter().map(|text| text.parse::<GridId>().map_err(Fault::stage)).collect::<Result<Vec<_>, _>>()?
    };
    let fit = surface::examine(&taught.panel, recipe.surface()).or_else(|refusal| {
        if let (Some(folder), Some(map)) = (&args.pictures, &refusal.map) {
            pictures::save(folder, "surface", &surface_map(map).map_err(Fault::stage)?)?;
        }
        Err(Fault::stage(refusal.error))
    })?;
    let mut planned = on_surface(fit, &taught, &grids, base_from_panel, &recipe)?;
    let (reached, reach_words) = planned.reach((&files, common), &taught, base_from_panel, &recipe)?;
    let worn_mm2 = files.store()?.disc_worn_mm2().map_err(Fault::stage)?;
    let disc = DiscUse::of(&planned.plan, recipe.path(), worn_mm2);
    planned.judge(Judgement::of(vec![], disc.change("this path").into_iter().collect()));
    planned.judge(path::judge_pad(recipe.path(), files.cell.limits().tool_error_mm()));
    if files.cell.limits().workspace().is_some() || program.is_some() {
        let limits = WaypointLimits::from(files.cell.limits());
        planned.judge(path::judge_in_base(&planned.plan, base_from_panel, &limits));
    }
    let dwell = planned.dwell(&taught, &grids, &recipe);
    let mut outcome = planned.outcome();
    outcome.words.extend(planned.table(&dwell, &disc, &recipe));
    outcome.say(reach_words);
    outcome.put(
        "reach",
        json!(reached.as_ref().map(|r| json!({"room_deg": r.travel.room_deg, "spin_deg": r.spin.0}))),
    );
    outcome.put("disc_worn_before_mm2", json!(worn_mm2));
    outcome.put("dwell", planned.numbers(&dwell));
    outcome.put("dwell_ratio", json!(planned.plan.dwell_ratio().map(|(ratio, _)| ratio)));
    outcome.put("max_dwell_ratio", json!(recipe.path().max_dwell_ratio()));
    if let Some((file, name)) = &program {
        let start = reached.as_ref().and_then(|reached| reached.travel.joints.first()).copied();
        let (is_written, words) =
            planned.program((file, name), (start, files.flange_from_tool()?.value), &recipe)?;
        outcome.say(words);
        outcome.put("krl", json!(is_written.then_some(file)));
    }
    if let Some(file) = &args.out {
        disk::write(file, Value::Object(outcome.json.clone()).to_string())?;
    }
    if let Some(folder) = &args.pictures {
        let taught_picture = taught.panel.scan.picture();
        let view = View {
            picture: &taught_picture,
            camera: &taught.panel.camera,
            camera_from_panel: taught.panel.panel_from_camera.inverse(),
        };
        pictures::save(folder, "planned", &planned.over(&view, &taught)?)?;
        pictures::save(folder, "surface", &surface_map(&planned.fit.map).map_err(Fault::stage)?)?;
        pictures::save(folder, "dwell", &dwell_map(&dwell, &taught.panel.region).map_err(Fault::stage)?)?;
        pictures::save(folder, "overlap", &overlap_map(&dwell, &taught.panel.region).map_err(Fault::stage)?)?;
    }
    Ok(outcome)
}

/// The program that a file holds: a controller loads it by the file's name.
fn program_name(file: &Path) -> Result<ProgramName, Fault> {
    if file.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("src")) {
        return Err(Fault::file(file, "a KRL program's file ends in .src"));
    }
    let name = file.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    name.parse().map_err(|error| Fault::file(file, error))
}

/// Plans paths over these grids of a fitted surface.
fn on_surface(
    fit: Fit,
    taught: &Taught,
    grids: &[GridId],
    base_from_panel: Rigid<Base, Panel>,
    recipe: &Recipe,
) -> Result<Planned, Fault> {
    let panel = &taught.panel;
    let holes = fit.map.holes(&panel.region, recipe.path().lift_hole_mm());
    let plan = path::plan_around(&fit.surface, &panel.region, grids, (&panel.outline, &holes), recipe.path());
    let plan = plan.map_err(Fault::stage)?;
    let judgement = path::judge(&plan, recipe.path());
    Ok(Planned { plan, judgement, deviation: fit.deviation, base: KukaPose::from_rigid(&base_from_panel), fit })
}

impl Planned {
    /// Looks at the plan's reach and turns its tool as that asks; a plan that the arm cannot follow is rejected. Comes
    /// with what to say of it.
    fn reach(
        &mut self,
        (files, common): (&CellFiles, &Common),
        taught: &Taught,
        base_from_panel: Rigid<Base, Panel>,
        recipe: &Recipe,
    ) -> Result<(Option<Reached>, String), Fault> {
        let calibration = files.cell.calibration();
        if calibration.flange_from_tool.is_none() {
            return Ok((None, "reach not looked at: the cell's file names no flange_from_tool".to_owned()));
        }
        let arm = Kinematics::new(files.cell.arm());
        let sees = calibration.flange_camera.is_some() && calibration.flange_from_camera.is_some();
        let in_cell = sees && files.cell.park().is_some() && !taught.corners.is_empty();
        let (stand, from) = if in_cell {
            let calibrated = Calibrated::read(files, common)?;
            let panel = (&taught.panel, taught.corners.as_slice());
            let job = Job::new(&files.cell, recipe, panel, calibrated.values).map_err(Fault::stage)?;
            let stand = daemon::corners_in_reach(&job, &arm, base_from_panel).and_then(|corners| {
                daemon::stand(&job, &arm, &Approached { base_from_panel, corners: &corners, things: None })
            });
            (stand, "as it comes from the park pose by the corner")
        } else {
            let flange_from_tool = files.flange_from_tool()?.value;
            let stand = Stand { arm: &arm, flange_from_tool, base_from_panel, from: None };
            (Ok(stand), "in the best configuration; the cell states no way there")
        };
        let reached = match stand {
            Ok(stand) => {
                let reached = panel_reach::of_plan(&self.plan, &stand, recipe.path());
                self.judge(panel_reach::judge_plan(&reached, (&self.fit.surface, &taught.panel.region)));
                reached.ok()
            }
            Err(reason) => {
                self.judge(Judgement::of(vec![reason], vec![]));
                None
            }
        };
        let words = match &reached {
            Some(reached) => format!(
                "the arm follows, {from}, {:.0}° of room beyond its margins, tool turned by {:.0}°",
                reached.travel.room_deg, reached.spin.0
            ),
            None => "the arm cannot follow".to_owned(),
        };
        if let Some(reached) = &reached {
            self.plan = panel_reach::turned(&self.plan, reached.spin);
        }
        Ok((reached, words))
    }

    fn judge(&mut self, other: Judgement) {
        self.judgement = other.and(self.judgement.clone());
    }

    /// Writes the plan as a program, unless it is rejected; comes with whether it did and what to say of it.
    fn program(
        &self,
        (file, name): (&Path, &ProgramName),
        (start, flange_from_tool): (Option<Joints>, Rigid<Flange, Tool>),
        recipe: &Recipe,
    ) -> Result<(bool, String), Fault> {
        let shown = file.display();
        let (Some(start), false) = (start, self.judgement.verdict == Verdict::Reject) else {
            let earlier = if file.exists() { "; the file that is there is of an earlier plan" } else { "" };
            return Ok((false, format!("no program was written to {shown}: this plan is rejected{earlier}")));
        };
        let remark = |reason: &Reason| format!("A person must decide: {}", reason.message);
        let remarks: Vec<String> = self.judgement.reasons.iter().map(remark).collect();
        let program = Program {
            name,
            plan: &self.plan,
            flange_from_tool: KukaPose::from_rigid(&flange_from_tool),
            base_from_panel: self.base,
            start,
            remarks: &remarks,
        };
        disk::write(file, path::krl(&program, recipe.path()))?;
        let words = "it sets $TOOL and $BASE and begins with a PTP to the path's first place";
        Ok((true, format!("the program is in {shown}; {words}")))
    }

    /// What the disc does along the plan.
    fn dwell(&self, taught: &Taught, grids: &[GridId], recipe: &Recipe) -> Dwell {
        let radius_mm = recipe.path().disc_diameter_mm() / 2.0;
        let executed = dwell::planned(&self.plan);
        dwell::simulate(&self.fit.surface, &taught.panel.region, grids, &executed, radius_mm)
    }

    /// The dry run in numbers, line by line.
    fn table(&self, dwell: &Dwell, disc: &DiscUse, recipe: &Recipe) -> Vec<String> {
        let discs = disc.discs().map_or("not counted, no disc_life_mm2".to_owned(), |discs| format!("{discs:.2}"));
        let mut table = vec![
            format!(
                "length             {:8.0} mm, {:.0} mm of it in contact",
                self.plan.length_mm, self.plan.contact_mm
            ),
            format!(
                "time               {:8.1} s at {:.0} mm/s and {:.0} mm/s²",
                self.plan.duration_s,
                recipe.path().feed_mm_s(),
                recipe.path().acceleration_mm_s2()
            ),
            format!(
                "swept by the disc  {:8.0} mm², discs: {discs}; before this {:.0} mm²",
                disc.swept_mm2,
                disc.worn_after_mm2 - disc.swept_mm2
            ),
            format!(
                "covered            {:8.2} %, longest under the disc {:.2} s",
                100.0 * dwell.share(),
                dwell.longest_s()
            ),
            self.evenness(recipe),
            "grid      covered %   overlap %   left mm²   mean s    5 % s   95 % s   ratio".to_owned(),
        ];
        table.extend(dwell.grids.iter().map(|grid| {
            let spread = self.grid_spread(grid.id).map_or("nothing treated".to_owned(), |spread| {
                format!("{:6.2}   {:6.2}   {:5.2}", spread.low_s, spread.high_s, spread.ratio())
            });
            format!(
                "{:8}  {:9.2}   {:9.1}   {:8.1}   {:6.2}   {spread}",
                grid.id.to_string(),
                100.0 * grid.share(),
                100.0 * grid.overlap(),
                grid.left_mm2(),
                grid.mean_dwell_s()
            )
        }));
        table
    }

    fn numbers(&self, dwell: &Dwell) -> Value {
        let grid = |grid: &GridDwell| {
            let spread = self.grid_spread(grid.id);
            json!({
                "grid": grid.id.to_string(), "share": grid.share(), "overlap": grid.overlap(),
                "left_mm2": grid.left_mm2(), "mean_dwell_s": grid.mean_dwell_s(),
                "p5_s": spread.map(|spread| spread.low_s), "p95_s": spread.map(|spread| spread.high_s),
                "ratio": spread.map(|spread| spread.ratio()),
            })
        };
        json!(dwell.grids.iter().map(grid).collect::<Vec<_>>())
    }

    fn grid_spread(&self, id: GridId) -> Option<Spread> {
        self.plan.grid_dwell.iter().find(|(known, _)| *known == id).map(|(_, spread)| *spread)
    }

    /// How even the time under the disc is, in words.
    fn evenness(&self, recipe: &Recipe) -> String {
        let (Some(dwell), Some((ratio, grid))) = (self.plan.dwell, self.plan.dwell_ratio()) else {
            return "under the disc     nothing is treated".to_owned();
        };
        let whose = grid.map_or("all together".to_owned(), |id| format!("the worst, {id}"));
        let [ratio, allowed] = apart(ratio, recipe.path().max_dwell_ratio(), 2);
        format!(
            "under the disc     {:8} s at 5 % of the treated area, {} s at 95 %; ratio {ratio} ({whose}), allowed {allowed}",
            fixed(dwell.low_s, 2),
            fixed(dwell.high_s, 2)
        )
    }

    /// The paths drawn over a view.
    ///
    /// # Errors
    /// Where OpenCV refuses to draw.
    pub fn over(&self, view: &View<'_>, taught: &Taught) -> Result<ColorPicture, Fault> {
        let contact = |path: &path::ToolPath| -> Vec<Point<Panel>> {
            let on_panel = path.waypoints.iter().filter(|waypoint| waypoint.contact);
            on_panel.map(|waypoint| waypoint.panel_from_tool.origin()).collect()
        };
        let paths: Vec<_> = self.plan.paths.iter().map(contact).collect();
        let planned = |grid: &Grid| self.plan.paths.iter().any(|path| path.grids.contains(&grid.id));
        view.planned(&taught.panel, &paths, &planned).map_err(Fault::stage)
    }

    /// The plan in words.
    pub fn words(&self) -> Vec<String> {
        let plan = &self.plan;
        let mut words = vec![format!(
            "planned: {} paths, {:.0} mm, {:.0} s, coverage {:.3}; surface fitted to {:.3} mm rms",
            plan.paths.len(),
            plan.length_mm,
            plan.duration_s,
            plan.coverage,
            self.deviation.rms_mm
        )];
        if let Some(step) = plan.step_over_mm {
            words.push(format!("step-over {:.2} to {:.2} mm", step.min_mm, step.max_mm));
        }
        words
    }

    fn outcome(&self) -> Outcome {
        let mut outcome = Outcome::of(&self.judgement);
        outcome.words.extend(self.words());
        outcome.say(format!("set base: {}", self.base));
        let paths: Vec<_> = self
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
        outcome.put("paths", json!(paths));
        outcome.put("base", json!(self.base));
        outcome.put("length_mm", json!(self.plan.length_mm));
        outcome.put("contact_mm", json!(self.plan.contact_mm));
        outcome.put("duration_s", json!(self.plan.duration_s));
        outcome.put("coverage", json!(self.plan.coverage));
        let step_over = self.plan.step_over_mm.map(|step| json!({"min": step.min_mm, "max": step.max_mm}));
        outcome.put("step_over_mm", json!(step_over));
        outcome
    }
}
