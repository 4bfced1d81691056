//! `panelprep teach`: teaches a panel at its nominal pose, and stores the taught data.

mod inputs;

use super::args::{Common, Teach};
use super::disk;
use super::fault::{Fault, TeachingFault};
use super::identify;
use super::load;
use super::output::{Outcome, write_progress};
use inputs::ViewedDrawing;
use panelprep_base::geometry::{Camera, OrganizedCloud, Pixel, Point};
use panelprep_base::number_text;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::files;
use panelprep_cell::panel::{LearnError, OffPanel, TaughtPanel, TaughtSource};
use panelprep_cell::recipe::Recipe;
use panelprep_service::report::{self, PanelOverlay};
use panelprep_service::setup::{self, CellFiles, LoadedPanel, SetupFault};
use panelprep_store::store::{TaughtCorner, TeachingInputs};
use panelprep_vision::inspect::{Demands, Footprint, coarse_resolution_reason};
use panelprep_vision::locate::{self, gate};
use serde_json::json;
use std::error::Error;
use std::path::Path;

/// Teaches a panel, stores the taught data and reports the result.
///
/// # Errors
/// If a file is invalid, the scan shows no panel in the region, or no corner picture is given although the cell
/// measures corners in each cycle. In this case nothing is stored.
pub fn run(args: &Teach, common: &Common) -> Result<Outcome, Fault> {
    let cell_files = CellFiles::read(&common.paths())?;
    let mut drawn = ViewedDrawing::view_drawing(args, &cell_files)?;
    let args = &inputs::with_files(args, &cell_files, drawn.as_ref().map(|drawn| &drawn.scan))?;
    let recipe = load::read_recipe(&args.recipe)?;
    let (scanner, base_from_camera) = (cell_files.scanner()?, cell_files.base_from_camera()?);
    let (scan, scan_bytes) = match (&mut drawn, &args.scan) {
        (Some(drawn), _) => (drawn.scan.clone(), std::mem::take(&mut drawn.scan_file)),
        // An unsuitable scan is refused here, with the name of its file, before anything is stored.
        (None, Some(file)) => {
            (scanner.scan_errors.correct_scan(load::scan(file, &scanner.value)?), super::disk::read(file)?)
        }
        (None, None) => return Err(TeachingFault::NoScan.into()),
    };
    let teaching = read_given_files((args, scan_bytes), &mut drawn, &cell_files, &recipe)?;
    let name = |index: usize| {
        let file = args.corner.get(index).or_else(|| args.flange.get(index));
        file.map_or_else(|| format!("corner {}", index + 1), |file| file.display().to_string())
    };
    let mut taught = match setup::derive(&teaching, (&recipe, &cell_files.scanner_lens()?), String::new(), &name) {
        Ok(taught) => taught,
        Err(fault) => {
            if let Some(folder) = &args.pictures {
                save_rejected_inputs(folder, (&scan, &recipe), &teaching, &fault)?;
            }
            return Err(fault.into());
        }
    };
    if let Some(folder) = &args.pictures {
        disk::save_picture(folder, "taught", &picture(&taught)?)?;
    }
    let min_break_mm2 = Demands::from_recipe(&recipe, cell_files.cell.limits()).min_break_mm2;
    let limit_mm2 = Footprint::taught_detection_limit_mm2(&taught.panel, recipe.inspect()).map_err(Fault::stage)?;
    taught.version = cell_files.store_for_writing()?.teach(&teaching).map_err(Fault::stage)?;
    let off_panel = region_parts_off_panel(&taught.panel, &recipe);
    let view = locate::ScanView {
        scan: &scan,
        camera: &scanner.value,
        base_from_camera: base_from_camera.value,
        range: scanner.scan_errors.range,
    };
    let held = PoseConstraint::locate(&taught.panel, &view, &recipe);
    let off = off_panel.iter().map(OffPanel::reason);
    let cut = taught.panel.box_cut(recipe.locate()).map(|cut| cut.reason());
    let outside = drawn.iter().flat_map(ViewedDrawing::reasons);
    let review: Vec<Reason> = off
        .chain(coarse_resolution_reason(limit_mm2, min_break_mm2))
        .chain(cut)
        .chain(outside)
        .chain(held.reasons(&recipe))
        .collect();
    let mut outcome = outcome(&taught, recipe.panel(), &Judgement::new(vec![], review));
    outcome.add_line(format!(
        "the smallest break of the film that is reliably found on this panel: {limit_mm2:.1} mm²; a grid fails from {min_break_mm2:.1} mm² \
         of broken film"
    ));
    outcome.add_value("detection_limit_mm2", json!(limit_mm2));
    outcome.add_value("min_break_mm2", json!(min_break_mm2));
    let off_panel: Vec<_> = off_panel
        .iter()
        .map(|off| {
            let (at_px, grids) =
                ([off.pixel.u, off.pixel.v], off.grids.iter().map(ToString::to_string).collect::<Vec<_>>());
            json!({"code": off.reason().code, "size_mm": off.size_mm, "at_px": at_px, "grids": grids})
        })
        .collect();
    outcome.add_value("region_off_panel", json!(off_panel));
    let mut warnings = report_constraint(&taught, &held, &recipe, &mut outcome);
    if let (Some(drawn), Some(file)) = (&drawn, &args.nominal) {
        drawn.report(file, &mut outcome);
        warnings.extend(drawn.warnings());
    }
    warnings.extend(identify::report_alike_panels((&taught.panel, &recipe), &view, &cell_files, &mut outcome)?);
    for warning in &warnings {
        outcome.add_line(format!("warning: {warning}"));
    }
    outcome.add_value("warnings", json!(warnings));
    Ok(outcome)
}

/// Returns the parts of the recipe's region that are not on the panel.
pub fn region_parts_off_panel(panel: &TaughtPanel, recipe: &Recipe) -> Vec<OffPanel> {
    panel.region_off_panel(recipe.surface().max_hole_mm(), &recipe.inspect().masked_px())
}

/// Returns the files that are stored: the bytes of the scan, and the corner pictures. The pictures are those that the
/// command line names, or those that were computed from the drawing, which are moved out of `drawn`.
fn read_given_files(
    (args, scan): (&Teach, Vec<u8>),
    drawn: &mut Option<ViewedDrawing>,
    cell_files: &CellFiles,
    recipe: &Recipe,
) -> Result<TeachingInputs, Fault> {
    let mut teaching = TeachingInputs {
        name: recipe.panel().to_owned(),
        scan,
        recipe_text: super::disk::read_text(&args.recipe)?,
        scanner_calibration_text: cell_files.scanner()?.text,
        base_from_camera_text: cell_files.base_from_camera()?.text,
        corners: Vec::new(),
        flange_camera_text: String::new(),
        flange_from_camera_text: String::new(),
    };
    if args.corner.is_empty() && args.flange.is_empty() {
        let calibration = cell_files.cell.calibration();
        let runs_cycles = calibration.flange_camera.is_some() && calibration.flange_from_camera.is_some();
        return match runs_cycles {
            true if drawn.is_some() => Err(TeachingFault::NoCornerView.into()),
            true => Err(TeachingFault::NoCorner.into()),
            false => Ok(teaching),
        };
    }
    let flange_camera = cell_files.flange_camera()?;
    teaching.corners = match drawn {
        Some(drawn) => std::mem::take(&mut drawn.corners),
        None => {
            let shots = load::corner_shots(cell_files, &args.corner, &args.flange, &flange_camera.value)?;
            let kept = |shot: load::CornerShot| TaughtCorner {
                picture: shot.bytes,
                base_from_flange: shot.base_from_flange,
            };
            shots.into_iter().map(kept).collect()
        }
    };
    teaching.flange_camera_text = flange_camera.text;
    teaching.flange_from_camera_text = cell_files.flange_from_camera()?.text;
    Ok(teaching)
}

/// Saves pictures of an input from which no panel could be taught: the scan with the region of the recipe and, if a
/// corner was not found, all corner pictures.
fn save_rejected_inputs(
    folder: &Path,
    (scan, recipe): (&OrganizedCloud<Camera>, &Recipe),
    teaching: &TeachingInputs,
    fault: &SetupFault,
) -> Result<(), Fault> {
    let wrong: Vec<usize> = match fault {
        SetupFault::Stage(error) => wrong_corner_indices(error.as_ref()),
        _ => vec![],
    };
    let corners_px = recipe.region().corners_px().map(|[u, v]| Pixel::at(u, v));
    let drawn = report::draw_region(scan, &corners_px, &wrong).map_err(Fault::stage)?;
    let mut files = vec![disk::save_picture(folder, "taught_region", &drawn)?];
    if let SetupFault::Corners(_) = fault {
        for (index, corner) in teaching.corners.iter().enumerate() {
            let picture = files::read_color(&corner.picture).map_err(Fault::stage)?;
            files.push(disk::save_picture(folder, &format!("taught_corner_{}", index + 1), &picture)?);
        }
    }
    files.iter().for_each(|file| write_progress(&format!("{}: the given input", file.display())));
    Ok(())
}

fn wrong_corner_indices(error: &(dyn Error + Send + Sync + 'static)) -> Vec<usize> {
    match error.downcast_ref() {
        Some(LearnError::WrongCorners { corners }) => corners.iter().map(|wrong| wrong.corner).collect(),
        _ => vec![],
    }
}

/// How well the shape of the panel constrains its pose: the result of locating the panel in its own taught scan.
struct PoseConstraint {
    outline: Option<locate::OutlineEvidence>,
    marks_mm: f64,
    found: Result<locate::Fit, locate::LocateError>,
}

impl PoseConstraint {
    fn locate(panel: &TaughtPanel, view: &locate::ScanView<'_>, recipe: &Recipe) -> Self {
        let model = locate::TaughtModel::from_panel(panel, view.range);
        let prepared = model.as_ref().map(|model| locate::PreparedScan::new((panel, model), view, recipe.locate()));
        let outline = prepared.as_ref().ok().map(locate::PreparedScan::outline_seen);
        let marks_mm = prepared.as_ref().map_or(0.0, locate::PreparedScan::marks_mm);
        let found = prepared.map_err(locate::LocateError::clone).and_then(|prepared| prepared.locate());
        PoseConstraint { outline, marks_mm, found }
    }

    /// Returns the reasons why the taught panel is not accepted: a cycle could not locate it.
    fn reasons(&self, recipe: &Recipe) -> Vec<Reason> {
        let (judgement, what) = match &self.found {
            Ok(fit) => {
                (gate::judge(fit, recipe), "the localization of the panel in its own taught scan is not accepted")
            }
            Err(error) => (gate::refusal(error), "the panel is not found in its own taught scan"),
        };
        let named = |reason: Reason| Reason { message: format!("{what}: {}", reason.message), ..reason };
        judgement.reasons.into_iter().map(named).collect()
    }
}

/// Reports how well the shape of the panel constrains its pose, and how well its corner pictures show a displacement
/// along the normal. Returns the warnings.
fn report_constraint(
    taught: &LoadedPanel,
    held: &PoseConstraint,
    recipe: &Recipe,
    outcome: &mut Outcome,
) -> Vec<String> {
    let PoseConstraint { outline, marks_mm, found } = held;
    if let Some(outline) = outline {
        report_outline_evidence(outline, outcome);
    }
    if *marks_mm > 0.0 {
        outcome.add_line(format!(
            "marks on the panel: {marks_mm:.0} mm of their borders also constrain the panel sideways"
        ));
    }
    outcome.add_value("marks_mm", json!(marks_mm));
    // A drawing contains no fixture, so there is no advice about the fixture.
    let is_drawn = matches!(taught.panel.reference, TaughtSource::Drawing);
    let fit = found.as_ref().ok().filter(|_| !is_drawn);
    let at_teaching = outline.as_ref().map_or(Vec::new(), |outline| gate::teaching_checks(outline, fit));
    let unwatched = is_drawn.then(|| {
        "the drawing contains no fixture, so a motion of the camera is not detected; run `panelprep calibrate verify` each day".to_owned()
    });
    let warnings: Vec<String> =
        at_teaching.into_iter().filter_map(|check| check.message).chain(unwatched).collect();
    if let Ok(fit) = found {
        let weakest = fit.weakest_direction.describe();
        outcome.add_line(format!(
            "the panel's shape determines its pose to {:.2} mm (95 %) at the worst point; largest uncertainty {weakest}, {:.2} mm",
            fit.uncertainty_mm, fit.weakest_mm
        ));
        report_camera_check(fit, outcome);
        outcome.add_value("uncertainty_mm", json!(fit.uncertainty_mm));
        outcome.add_value("weakest_mm", json!(fit.weakest_mm));
        outcome.add_value("weakest", json!(weakest));
    }
    let verify_mm = recipe.corner().verify_mm();
    for (index, corner) in taught.corners.iter().enumerate() {
        let seen = corner.visible_normal_fraction();
        // Below one hundredth, the effect of the lens's own errors is as large as the effect of the displacement.
        let detection =
            if seen > 0.01 { format!("of {:.1} mm or more is", verify_mm / seen) } else { "is not".to_owned() };
        outcome.add_line(format!(
            "corner {}: its picture shows {:.0} % of a displacement along the normal; before contact, a displacement along \
             the normal {detection} detected",
            index + 1,
            100.0 * seen
        ));
    }
    let seen: Vec<f64> =
        taught.corners.iter().map(panelprep_cell::panel::TaughtCorner::visible_normal_fraction).collect();
    outcome.add_value("normal_seen", json!(seen));
    warnings
}

fn report_outline_evidence(seen: &locate::OutlineEvidence, outcome: &mut Outcome) {
    let locate::OutlineEvidence { by_colour, by_depth, held, unseen } = *seen;
    let percent = |share: f64| number_text::fixed_decimals(100.0 * share, 0);
    outcome.add_line(format!(
        "outline of the panel: {} % is seen by colour, {} % by depth, {} % is excluded because a holder touches the \
         edge, {} % is not seen",
        percent(by_colour),
        percent(by_depth),
        percent(held),
        percent(unseen)
    ));
    outcome.add_value(
        "outline",
        json!({"by_colour": by_colour, "by_depth": by_depth, "held": held, "unseen": unseen}),
    );
}

fn report_camera_check(fit: &locate::Fit, outcome: &mut Outcome) {
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    let detectable_displacement_mm = uncertainty_mm.map(gate::detectable_displacement_mm);
    if let Some(mm) = detectable_displacement_mm {
        outcome.add_line(format!(
            "a motion of the camera is detected at the fixture if the motion shifts the panel's pose by {mm:.2} mm or more"
        ));
    }
    outcome.add_value("camera_noticed_mm", json!(detectable_displacement_mm));
}

/// Draws the taught panel on its picture.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn picture(taught: &LoadedPanel) -> Result<panelprep_base::geometry::ColorPicture, Fault> {
    let panel = &taught.panel;
    let scan = panel.scan.picture();
    let view = PanelOverlay {
        picture: &scan,
        camera: &panel.camera,
        camera_from_panel: panel.panel_from_camera.inverse(),
    };
    let corners: Vec<Point<_>> = taught.corners.iter().map(|corner| corner.point).collect();
    view.taught(panel, &corners).map_err(Fault::stage)
}

fn outcome(taught: &LoadedPanel, panel: &str, judgement: &Judgement) -> Outcome {
    let mut outcome = Outcome::from_judgement(judgement);
    let points = taught.panel.mask.count();
    let grids: Vec<_> = taught
        .panel
        .grids
        .iter()
        .map(|grid| json!({"id": grid.id.to_string(), "corners_mm": grid.corners.map(|p| <[f64; 3]>::from(p.mm.coords))}))
        .collect();
    outcome.add_line(format!("panel {panel}, version {}", taught.version));
    outcome.add_line(format!("{points} points, {} grids, {} corners", grids.len(), taught.corners.len()));
    outcome.add_value("panel", json!(panel));
    outcome.add_value("version", json!(taught.version));
    outcome.add_value("points", json!(points));
    outcome.add_value("grids", json!(grids));
    outcome
}
