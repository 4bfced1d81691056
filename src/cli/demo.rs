//! `panelprep demo`: a rendered cell through all stages on its files, one page, and how far from the truth each was.
//!
//! The stages read the files that `render` wrote; the truth is read here alone, for the score.

use super::args::{Common, Demo, Teach};
use super::fault::Fault;
use super::inspect::{self, Inspected, Placed};
use super::load::{self, CellFiles, Taught};
use super::locate::{self, Located};
use super::outcome::Outcome;
use super::pictures::{self, figure};
use super::plan::{self, Planned};
use super::refine::{self, RefinedPlace};
use super::{disk, render, teach};
use crate::geometry::{Base, ColorPicture, Panel, Rigid};
use crate::recipe::Recipe;
use crate::report::page::{Page, Row, Section};
use crate::sim::{self, Truth};
use crate::verdict::{Judgement, Verdict};
use nalgebra::Vector3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What the stages found, as far as they went.
struct Found {
    recipe: Recipe,
    taught: Taught,
    taught_picture: ColorPicture,
    located: Located,
    refined: Option<RefinedPlace>,
    inspected: Option<Inspected>,
    planned: Option<Planned>,
}

/// Renders, runs all stages, writes pictures and page.
///
/// # Errors
/// Where the folder cannot be written or a stage refuses its input.
pub fn run(args: &Demo, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let begin = Instant::now();
    let cell = sim::Cell::new(args.seed, args.scene.into(), args.reduction as usize);
    let folder = args.out.join("cell");
    render::write(&cell, &folder, progress)?;
    let found = stages(&folder, progress)?;
    let judgement = found.judgement();
    let report = args.out.join("index.html");
    progress("writing the page");
    let scored = Scored { found: &found, truth: cell.truth() };
    let pictures = args.out.join("pictures");
    let sections = scored.sections(&pictures)?;
    let page = Page {
        title: "Panelprep: from a scan to the waypoints".to_owned(),
        subtitle: format!("simulated cell, seed {}, scene {}", args.seed, sim::Scene::from(args.scene).word()),
        judgement: judgement.clone(),
        sections,
    };
    disk::write(&report, page.html())?;
    let mut outcome = Outcome::of(&judgement);
    outcome.words.extend(scored.words());
    outcome.say(format!("page: {}", report.display()));
    outcome.put("seed", json!(args.seed));
    outcome.put("scene", json!(sim::Scene::from(args.scene).word()));
    outcome.put("cycle_id", Value::Null);
    outcome.put("report", json!(report));
    outcome.put("wall_s", json!(begin.elapsed().as_secs_f64()));
    scored.put(&mut outcome);
    Ok(outcome)
}

/// The stages, one after the other, on the files of a folder.
fn stages(folder: &Path, progress: &dyn Fn(&str)) -> Result<Found, Fault> {
    let file = |name: &str| folder.join(name);
    let common = Common { cell: file("cell.toml"), store: None, json: false };
    progress("teaching the panel at its nominal place");
    let recipe_file = file("recipe.toml");
    let teach = Teach {
        recipe: recipe_file.clone(),
        scan: file("taught_scan.pcd"),
        corner: vec![file("taught_corner.png")],
        flange: vec![file("taught_flange.json")],
        pictures: None,
    };
    teach::run(&teach, &common)?;
    let files = CellFiles::read(&common)?;
    let recipe = load::recipe(&recipe_file)?;
    let taught = load::taught(&files, &recipe_file, &recipe)?;
    let taught_picture = teach::picture(&taught)?;
    progress("locating the panel in the scan");
    let (camera, base_from_camera) = (files.scanner()?.value, files.base_from_camera()?.value);
    let scan = load::scan(&file("scan.pcd"), &camera)?;
    let located = locate::stage(&taught, &scan, camera, base_from_camera, &recipe)?;
    let mut found =
        Found { recipe, taught, taught_picture, located, refined: None, inspected: None, planned: None };
    let Some(base_from_panel) = found.accepted() else { return Ok(found) };
    progress("correcting the place by the corner picture");
    let flange_camera = files.flange_camera()?.value;
    let shots = load::corner_shots(&[file("corner.png")], &[file("flange.json")], &flange_camera)?;
    let flange_from_camera = files.flange_from_camera()?.value;
    let refined =
        refine::stage(&found.taught, base_from_panel, shots, &flange_camera, flange_from_camera, &found.recipe)?;
    let base_from_panel = refined.refined.base_from_panel;
    let goes_on = refined.judgement.verdict == Verdict::Accept;
    found.refined = Some(refined);
    if !goes_on {
        return Ok(found);
    }
    progress("inspecting the clip");
    let placed = Placed { camera, base_from_camera, base_from_panel };
    let demands = inspect::demands(&files, &found.recipe);
    let truth = file("truth");
    let inspected = inspect::stage(&found.taught, &file("clip"), placed, &found.recipe, demands, Some(&truth))?;
    let failed: Vec<_> = inspected.inspection.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect();
    let goes_on = inspected.inspection.judgement.verdict == Verdict::Fail;
    found.inspected = Some(inspected);
    if goes_on {
        progress("planning the path over the failed grids");
        found.planned = Some(plan::stage(&found.taught, &failed, base_from_panel, &found.recipe)?);
    }
    Ok(found)
}

impl Found {
    fn accepted(&self) -> Option<Rigid<Base, Panel>> {
        let fit = self.located.fit.as_ref()?;
        (self.located.judgement.verdict == Verdict::Accept).then_some(fit.base_from_panel)
    }

    /// The last stage's verdict: a failed film with a planned path is an accepted path.
    fn judgement(&self) -> Judgement {
        let planned = self.planned.as_ref().map(|planned| &planned.judgement);
        let inspected = self.inspected.as_ref().map(|inspected| &inspected.inspection.judgement);
        let refined = self.refined.as_ref().map(|refined| &refined.judgement);
        planned.or(inspected).or(refined).unwrap_or(&self.located.judgement).clone()
    }
}

/// What was found, held against the truth.
struct Scored<'a> {
    found: &'a Found,
    truth: Truth,
}

impl Scored<'_> {
    fn put(&self, outcome: &mut Outcome) {
        let fit = self.found.located.fit.as_ref();
        let located = fit.map(|fit| self.truth.placement_error_mm(&fit.base_from_panel));
        outcome.put(
            "locate",
            json!({
                "error_mean_mm": located.map(|error| error.mean_mm),
                "error_max_mm": located.map(|error| error.max_mm),
                "elapsed_ms": self.found.located.elapsed_ms,
            }),
        );
        let refined = self.found.refined.as_ref();
        outcome.put("refine", json!({
            "error_max_mm": refined.map(|place| self.truth.placement_error_mm(&place.refined.base_from_panel).max_mm),
            "corner_error_mm": self.corner_error_mm(),
            "moves": 0,
        }));
        let inspected = self.found.inspected.iter().map(|inspected| {
            let score = inspected.score.as_ref();
            json!({
                "pass": inspected.inspection.judgement.verdict == Verdict::Pass,
                "iou": score.map(|(score, _)| score.iou),
                "grids_failed": inspected.inspection.grids.iter().filter(|grid| grid.failed).count(),
                "grids_true": score.map(|(_, grids)| grids.true_fail + grids.false_pass),
                "grids_wrong": score.map(|(_, grids)| grids.false_fail + grids.false_pass),
                "ms_per_frame": inspected.ms_per_frame,
            })
        });
        outcome.put("inspect", json!(inspected.collect::<Vec<_>>()));
        outcome.put("plan", self.found.planned.as_ref().map_or(Value::Null, |planned| planned.score(&self.truth)));
        outcome.put("abrade", json!([]));
        outcome.put(
            "budget_mm",
            json!({"hand_eye": null, "locate": fit.map(|fit| fit.uncertainty_mm),
                                        "fit": null, "robot": null, "total": null}),
        );
        outcome.put("noise", json!(sim::noise_in_force()));
    }

    /// How far the corrected corner is from the true one in the flange camera's plane, mm.
    fn corner_error_mm(&self) -> Option<f64> {
        let refined = self.found.refined.as_ref()?;
        let view = self.truth.corners.first()?;
        let panel_from_camera = view.base_from_flange * self.truth.flange_from_camera;
        let base_from_panel = refined.refined.base_from_panel;
        let (found, true_place) = (base_from_panel * view.corner, self.truth.base_from_panel * view.corner);
        // The camera's axes, carried along with the panel as the thesis's new corner pose is.
        let axes = self.truth.base_from_panel.rotation() * panel_from_camera.rotation();
        let offset: Vector3<f64> = axes.inverse() * (found - true_place).mm;
        Some(offset.x.hypot(offset.y))
    }

    fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        if let Some(fit) = &self.found.located.fit {
            let error = self.truth.placement_error_mm(&fit.base_from_panel);
            words.push(format!("located: {:.2} mm off on average, {:.2} mm at most", error.mean_mm, error.max_mm));
        }
        if let (Some(place), Some(corner_mm)) = (&self.found.refined, self.corner_error_mm()) {
            let error = self.truth.placement_error_mm(&place.refined.base_from_panel);
            words.push(format!(
                "refined: {corner_mm:.3} mm off in the corner's plane, {:.2} mm at most anywhere",
                error.max_mm
            ));
        }
        if let Some((score, grids)) = self.found.inspected.as_ref().and_then(|inspected| inspected.score.as_ref()) {
            words.push(format!(
                "inspected: intersection over union {:.3}; {} of {} greasy grids found, {} clean ones failed",
                score.iou,
                grids.true_fail,
                grids.true_fail + grids.false_pass,
                grids.false_fail
            ));
        }
        if let Some(planned) = &self.found.planned {
            words.extend(planned.words());
        }
        words
    }

    fn sections(&self, folder: &Path) -> Result<Vec<Section>, Fault> {
        let keep = |name: &str, picture: &ColorPicture| pictures::save(folder, name, picture).map(|_: PathBuf| ());
        let taught = &self.found.taught;
        keep("taught", &self.found.taught_picture)?;
        let mut sections = vec![Section {
            heading: "What was taught".to_owned(),
            text: "The panel at its nominal place, cut out of its scan; its outline, the grids of the region, and the \
                   corner that the flange camera looks for."
                .to_owned(),
            rows: vec![
                Row::new("points on the panel", taught.panel.mask.count().to_string(), ""),
                Row::new("grids", taught.panel.grids.len().to_string(), ""),
            ],
            figures: vec![figure(&self.found.taught_picture, "The taught panel in the 3D camera's picture")?],
        }];
        sections.push(self.located_section(&keep)?);
        if let Some(place) = &self.found.refined {
            sections.push(self.refined_section(place, &keep)?);
        }
        if let Some(inspected) = &self.found.inspected {
            sections.push(self.inspected_section(inspected, &keep)?);
        }
        if let (Some(planned), Some(inspected)) = (&self.found.planned, &self.found.inspected) {
            let picture = planned.drawn(taught, inspected)?;
            keep("planned", &picture)?;
            sections.push(Section {
                heading: "The sanding path".to_owned(),
                text: "The path of the tool centre point over each failed grid, on the fitted surface, tool axis on the \
                       normal; rows alternate in direction."
                    .to_owned(),
                rows: planned.rows(&self.truth),
                figures: vec![figure(&picture, "The planned path over the panel where it stands")?],
            });
        }
        Ok(sections)
    }

    fn located_section(&self, keep: &dyn Fn(&str, &ColorPicture) -> Result<(), Fault>) -> Result<Section, Fault> {
        let (located, limits) = (&self.found.located, self.found.recipe.locate());
        let mut rows = Vec::new();
        let mut figures = Vec::new();
        if let Some(fit) = &located.fit {
            let error = self.truth.placement_error_mm(&fit.base_from_panel);
            rows.push(Row::new(
                "residual, point to plane",
                format!("{:.3} mm rms", fit.rms_mm),
                format!("≤ {:.2} mm", limits.max_rms_mm()),
            ));
            rows.push(Row::new(
                "overlap",
                format!("{:.3}", fit.overlap()),
                format!("≥ {:.2}", limits.min_overlap()),
            ));
            let moved = format!("{:.1} mm, {:.2}°, {:.2}°", fit.shift_mm, fit.turn.0, fit.tilt.0);
            let allowed = format!(
                "≤ {:.0} mm, {:.0}°, {:.0}°",
                limits.max_shift_mm(),
                limits.turn_limit_deg(),
                limits.max_tilt_deg()
            );
            rows.push(Row::new("shift, turn and tilt at the panel's centre", moved, allowed));
            rows.push(Row::new("stated error, 95 %", format!("{:.2} mm", fit.uncertainty_mm), ""));
            rows.push(Row::new(
                "true error, mean and largest",
                format!("{:.2} mm, {:.2} mm", error.mean_mm, error.max_mm),
                "",
            ));
            rows.push(Row::new("scan to verdict", format!("{:.0} ms", located.elapsed_ms), ""));
        }
        if let Some(picture) = located.drawn(&self.found.taught.panel)? {
            keep("located", &picture)?;
            figures.push(figure(
                &picture,
                "The new scan's picture with the taught outline and grids at the place found",
            )?);
        } else {
            figures.push(figure(&located.picture, "The new scan's picture: no panel was found")?);
        }
        let text = "The scan of the displaced panel against the taught one: point to point, then point to plane.";
        Ok(Section { heading: "Where the panel stands".to_owned(), text: text.to_owned(), rows, figures })
    }

    fn refined_section(
        &self,
        place: &RefinedPlace,
        keep: &dyn Fn(&str, &ColorPicture) -> Result<(), Fault>,
    ) -> Result<Section, Fault> {
        let mut figures = Vec::new();
        for (before, after) in place.drawn()? {
            keep("corner_before", &before)?;
            keep("corner_after", &after)?;
            figures.push(figure(&before, "The corner before the correction, by the flange camera")?);
            figures.push(figure(&after, "The corner after the correction")?);
        }
        let error = self.truth.placement_error_mm(&place.refined.base_from_panel);
        let [x_mm, y_mm] = place.refined.shift_mm;
        let mut rows = vec![
            Row::new(
                "correction in camera x and y",
                format!("{x_mm:.3} mm, {y_mm:.3} mm"),
                format!("≤ {:.1} mm", self.found.recipe.corner().max_correction_mm()),
            ),
            Row::new("largest error anywhere on the panel", format!("{:.2} mm", error.max_mm), ""),
        ];
        if let Some(corner_mm) = self.corner_error_mm() {
            rows.push(Row::new("true error in the corner's plane", format!("{corner_mm:.3} mm"), "≤ 0.5 mm"));
        }
        let text = "The corner in the flange camera's picture, where it was expected and where it was found.";
        Ok(Section { heading: "The corner".to_owned(), text: text.to_owned(), rows, figures })
    }

    fn inspected_section(
        &self,
        inspected: &Inspected,
        keep: &dyn Fn(&str, &ColorPicture) -> Result<(), Fault>,
    ) -> Result<Section, Fault> {
        let (picture, strip) = (inspected.drawn(&self.found.taught)?, inspected.strip()?);
        keep("inspected", &picture)?;
        keep("film", &strip)?;
        let inspection = &inspected.inspection;
        let mut rows = vec![
            Row::new("watched", format!("{:.1} s", inspection.observation.observed_s), ""),
            Row::new("wet pictures", inspection.observation.frames.to_string(), ""),
            Row::new("a picture takes, median", format!("{:.1} ms", inspected.ms_per_frame), ""),
        ];
        for grid in inspection.grids.iter().filter(|grid| grid.failed) {
            let when = grid.time_to_break_s.map(|time| format!(", from {time:.1} s")).unwrap_or_default();
            let allowed = format!("< {:.0} mm²", inspection.observation.min_break_mm2);
            rows.push(Row::new(
                &format!("broken film in {}", grid.id),
                format!("{:.0} mm²{when}", grid.broken_mm2),
                allowed,
            ));
        }
        if let Some((score, _)) = &inspected.score {
            rows.push(Row::new(
                "agreement with the true mask",
                format!("{:.3} intersection over union", score.iou),
                "",
            ));
        }
        let figures = vec![
            figure(&strip, "The film in time: broken places tinted")?,
            figure(&picture, "Everything that broke, and the grids that failed")?,
        ];
        let text = "The wet panel while the water runs off: where the film breaks there is grease.";
        Ok(Section { heading: "The film".to_owned(), text: text.to_owned(), rows, figures })
    }
}
