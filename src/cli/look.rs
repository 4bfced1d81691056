//! `panelprep look`: shows a scan as a picture with a pixel ruler, in which a person reads the region for a recipe.

use super::args::{Common, Look};
use super::disk;
use super::fault::Fault;
use super::load::CellFiles;
use super::outcome::Outcome;
use super::pictures;
use panelprep_base::verdict::Judgement;
use panelprep_cell::files;
use panelprep_service::report::{missing_share, scan_picture};
use serde_json::json;

/// Draws the scan and reports how much of it is missing. It needs no cell and no calibration, except for a PLY file
/// that does not state its width. If the cell has this camera's calibration, the scan is checked against it.
///
/// # Errors
/// If the file is not an organised scan, is in another frame or unit, or is not from the calibrated camera, or
/// writing to the disk fails.
pub fn run(args: &Look, common: &Common) -> Result<Outcome, Fault> {
    let calibrated = CellFiles::read(common).and_then(|files| files.scanner()).ok();
    let size_px = calibrated.as_ref().map(|camera| (camera.value.width_px, camera.value.height_px));
    let read = files::read_any_cloud(&disk::read(&args.scan)?, size_px);
    let scan = read.map_err(|error| Fault::file_fault(&args.scan, error))?;
    // A scan of another camera is allowed; its size identifies it.
    let lens = calibrated.as_ref().map(|camera| &camera.value);
    let own = lens.filter(|lens| (lens.width_px, lens.height_px) == (scan.width(), scan.height()));
    let checked = own.map_or_else(|| files::check_frame(&scan), |lens| files::check_rays(&scan, lens));
    checked.map_err(|error| Fault::file_fault(&args.scan, error))?;
    let picture = scan_picture(&scan).map_err(Fault::stage)?;
    let file = pictures::save(&args.pictures, "scan", &picture)?;
    let share = missing_share(&scan);
    let depths_mm = scan.valid_points().map(|(_, point)| point.mm.z);
    let (near_mm, far_mm) =
        depths_mm.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    outcome.add_line(format!(
        "{}×{} px; {:.1} % of the pixels have no 3D point",
        scan.width(),
        scan.height(),
        100.0 * share
    ));
    if near_mm <= far_mm {
        outcome.add_line(format!("points {near_mm:.0} to {far_mm:.0} mm from the camera along its axis"));
    }
    outcome.add_line(format!("{}: read [region] corners_px from the pixel ruler in this picture", file.display()));
    outcome.add_value("missing_share", json!(share));
    outcome.add_value("width_px", json!(scan.width()));
    outcome.add_value("height_px", json!(scan.height()));
    outcome.add_value("picture", json!(file));
    Ok(outcome)
}
