//! `panelprep plan`: the sanding path over the failed grids.

use super::args::{Common, Plan};
use super::disk;
use super::fault::Fault;
use super::load::{self, CellFiles, Taught};
use super::outcome::Outcome;
use super::pictures;
use crate::geometry::{Base, ColorPicture, KukaPose, Panel, Point, Rigid, Tool};
use crate::panel::{Grid, GridId};
use crate::path::{self, ProgramName};
use crate::recipe::Recipe;
use crate::report::View;
use crate::surface::{self, Deviation};
use crate::verdict::Judgement;
use serde_json::{Value, json};

/// A plan with its verdict.
pub struct Planned {
    /// The paths, in the panel's frame.
    pub plan: path::Plan,
    /// The verdict.
    pub judgement: Judgement,
    /// How well the surface lies in the scan.
    pub deviation: Deviation,
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
    let base_from_panel = load::located(args.located.as_ref())?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let grids = if args.grids.is_empty() {
        taught.panel.region.ids().collect()
    } else {
        args.grids.iter().map(|text| text.parse::<GridId>().map_err(Fault::stage)).collect::<Result<Vec<_>, _>>()?
    };
    let planned = stage(&taught, &grids, base_from_panel, &recipe)?;
    let outcome = planned.outcome();
    let text = Value::Object(outcome.json.clone()).to_string();
    if let Some(file) = &args.krl {
        let name = file.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        let name: ProgramName = name.parse().map_err(|error| Fault::file(file, error))?;
        disk::write(file, path::krl(&name, &planned.plan, Some(planned.base), recipe.path()))?;
    }
    if let Some(file) = &args.out {
        disk::write(file, text)?;
    }
    if let Some(folder) = &args.pictures {
        let taught_picture = taught.panel.scan.picture();
        let view = View {
            picture: &taught_picture,
            camera: &taught.panel.camera,
            camera_from_panel: taught.panel.panel_from_camera.inverse(),
        };
        pictures::save(folder, "planned", &planned.over(&view, &taught)?)?;
    }
    Ok(outcome)
}

/// Fits the surface and plans paths over these grids.
///
/// # Errors
/// Where the surface cannot be fitted or a grid has no path.
pub fn stage(
    taught: &Taught,
    grids: &[GridId],
    base_from_panel: Rigid<Base, Panel>,
    recipe: &Recipe,
) -> Result<Planned, Fault> {
    let panel = &taught.panel;
    let fit = surface::fit(panel, recipe.surface()).map_err(Fault::stage)?;
    let plan =
        path::plan(&fit.surface, &panel.region, grids, &panel.outline, recipe.path()).map_err(Fault::stage)?;
    let judgement = path::judge(&plan, recipe.path());
    Ok(Planned { plan, judgement, deviation: fit.deviation, base: KukaPose::from_rigid(&base_from_panel) })
}

impl Planned {
    /// The paths drawn over a view.
    ///
    /// # Errors
    /// Where OpenCV refuses to draw.
    pub fn over(&self, view: &View<'_>, taught: &Taught) -> Result<ColorPicture, Fault> {
        let contact = |path: &path::ToolPath| -> Vec<Point<Panel>> {
            let on_panel = path.waypoints.iter().filter(|waypoint| waypoint.contact);
            on_panel.map(|waypoint| waypoint.pose.to_rigid::<Panel, Tool>().origin()).collect()
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
                let waypoints: Vec<KukaPose> = path.waypoints.iter().map(|waypoint| waypoint.pose).collect();
                json!({"grids": grids, "waypoints": waypoints, "contact": contact})
            })
            .collect();
        outcome.put("paths", json!(paths));
        outcome.put("base", json!(self.base));
        outcome.put("length_mm", json!(self.plan.length_mm));
        outcome.put("duration_s", json!(self.plan.duration_s));
        outcome.put("coverage", json!(self.plan.coverage));
        let step_over = self.plan.step_over_mm.map(|step| json!({"min": step.min_mm, "max": step.max_mm}));
        outcome.put("step_over_mm", json!(step_over));
        outcome
    }
}
