//! `panelprep calibrate verify --live`: takes the picture of the target now. In a simulated cell, a simulated
//! person has put the target in its place.

use super::super::super::args::{Common, Shot};
use super::super::super::disk;
use super::super::super::fault::Fault;
use super::super::super::flange_pose::FlangePoses;
use super::super::super::live;
use super::super::super::load::CellFiles;
use super::super::super::outcome::Outcome;
use super::super::super::output::write_progress as tell;
use super::super::super::shoot::{free_names, opening};
use super::super::args::{CameraName, Verify};
use super::super::verify;
use opening::RequestedShot;
use panelprep_base::geometry::{ColorPicture, KukaPose};
use panelprep_cell::files::{self, ReportedFlange};
use std::path::{Path, PathBuf};

/// Takes the picture and does the same as the command with files.
///
/// # Errors
/// If the camera does not deliver, the flange's pose is not known, or writing to the disk fails; otherwise as for the
/// command with files.
pub fn take_target_picture(
    (args, folder): (&Verify, &Path),
    common: &Common,
    progress: &dyn Fn(&str),
) -> Result<Outcome, Fault> {
    let cell = CellFiles::read(common)?;
    let (image, flange) = match args.camera {
        CameraName::Scanner => (scanner(args, (&cell, folder), progress)?, None),
        CameraName::FlangeCamera => {
            let (image, flange) = flange_camera(args, (&cell, folder), progress)?;
            (image, Some(flange))
        }
    };
    tell(&format!("{}: the picture for the verification", image.display()));
    verify::run(&Verify { image: Some(image), flange, live: None, ..args.clone() }, common, progress)
}

/// Takes a 3D shot, which also gives the size of the squares; with a simulated scanner, its picture of the target.
fn scanner(args: &Verify, (cell, folder): (&CellFiles, &Path), progress: &dyn Fn(&str)) -> Result<PathBuf, Fault> {
    if cell.cell.scanner().is_simulated() {
        let file = free_names(folder, "verify_scanner", &["png"]).remove(0);
        let world = live::simulated_cell(&cell.scanner()?.value, args.simulation)?;
        let picture = files::write_gray_png(&world.scanner_target().picture).map_err(Fault::stage)?;
        return disk::write(&file, picture).map(|()| file);
    }
    let file = free_names(folder, "verify_scanner", &["pcd"]).remove(0);
    let wanted = RequestedShot { shot: Shot::Scan, simulation: args.simulation };
    let mut opened = opening::scanner(cell, &wanted, progress)?;
    let shot = opened.camera.capture_3d().map_err(Fault::stage)?;
    disk::write(&file, files::write_pcd(&shot.cloud)).map(|()| file)
}

/// Takes a picture, and reads the flange's pose at this picture.
fn flange_camera(
    args: &Verify,
    (cell, folder): (&CellFiles, &Path),
    progress: &dyn Fn(&str),
) -> Result<(PathBuf, PathBuf), Fault> {
    let names = free_names(folder, "verify_flange_camera", &["png", "json"]);
    let (picture, flange) = match cell.cell.flange_camera().is_simulated() {
        true => simulated_picture(args, cell)?,
        false => {
            let wanted = RequestedShot { shot: Shot::Corner, simulation: args.simulation };
            let mut opened = opening::flange_camera(cell, &wanted, progress)?;
            let poses = FlangePoses::new(cell);
            loop {
                let before = poses.now();
                let shot = opened.camera.capture().map_err(Fault::stage)?;
                if let Some(flange) = poses.combine_or_ask(before, shot.base_from_flange)? {
                    break (shot.picture, flange);
                }
            }
        }
    };
    disk::write(&names[0], files::write_color_png(&picture).map_err(Fault::stage)?)?;
    disk::write(&names[1], files::write_reported_flange(&flange))?;
    Ok((names[0].clone(), names[1].clone()))
}

fn simulated_picture(args: &Verify, cell: &CellFiles) -> Result<(ColorPicture, ReportedFlange), Fault> {
    let world = live::simulated_cell(&cell.scanner()?.value, args.simulation)?;
    let target = world.flange_target();
    let base_from_flange = KukaPose::from_rigid(&target.base_from_flange);
    Ok((target.picture.to_color(), ReportedFlange { base_from_flange, joints: None }))
}
