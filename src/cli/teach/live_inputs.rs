//! Takes the inputs of `teach` now: the scan, the region drawn on its picture in a browser, and the corner
//! pictures.

use super::super::args::{Shot, Teach};
use super::super::disk;
use super::super::fault::{DeviceFault, Fault, TeachingFault};
use super::super::flange_pose::FlangePoses;
use super::super::load::{self, CellFiles};
use super::super::output::{read_answer_line, write_progress};
use super::super::shoot::opening::{self, RequestedShot};
use super::super::{live, service_request};
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use panelprep_cell::files;
use panelprep_interfaces::page::LocalServer;
use panelprep_interfaces::page::drawing::{self, DrawingSheet};
use panelprep_sim::{self as sim, PanelPosition};
use std::path::{Path, PathBuf};

/// The same command with existing files: those that it names, or those that were taken. The region is drawn on the
/// picture of the scan, or of the drawing.
///
/// # Errors
/// If a camera does not deliver, there is no answer, the page cannot be served, or writing to the disk fails.
pub fn with_files(args: &Teach, cell: &CellFiles, drawn: Option<&OrganizedCloud<Camera>>) -> Result<Teach, Fault> {
    let mut ready = args.clone();
    let world = simulated_cell(args, cell)?;
    if let Some(folder) = &args.live {
        ready.scan = Some(scan(args, (cell, world.as_ref()), folder)?);
    }
    if args.draw || args.live.is_some() && !args.no_draw {
        let picture = match (drawn, &ready.scan) {
            (Some(drawn), _) => drawn.picture(),
            (None, Some(scan)) => load::scan(scan, &cell.scanner()?.value)?.picture(),
            (None, None) => return Err(TeachingFault::NoScan.into()),
        };
        draw(args, &picture)?;
    }
    if let Some(folder) = args.live.as_ref().filter(|_| args.corner.is_empty()) {
        let calibration = cell.cell.calibration();
        if calibration.flange_camera.is_some() && calibration.flange_from_camera.is_some() {
            (ready.corner, ready.flange) = corners(args, (cell, world.as_ref()), folder)?;
        }
    }
    Ok(ready)
}

/// The simulated cell, if it is used and its cameras are free: a simulated person puts the panel at its nominal pose.
fn simulated_cell(args: &Teach, cell: &CellFiles) -> Result<Option<sim::Cell>, Fault> {
    let is_simulated =
        [cell.cell.scanner().is_simulated(), cell.cell.flange_camera().is_simulated()].contains(&true);
    if args.live.is_none() || !is_simulated || service_request::service_state(&cell.socket()).is_some() {
        return Ok(None);
    }
    Ok(Some(live::simulated_cell(&cell.scanner()?.value, args.simulation)?))
}

fn scan(args: &Teach, (cell, world): (&CellFiles, Option<&sim::Cell>), folder: &Path) -> Result<PathBuf, Fault> {
    let file = folder.join("taught_scan.pcd");
    let cloud = match world.filter(|_| cell.cell.scanner().is_simulated()) {
        Some(world) => world.taught_scan(),
        None => {
            let wanted = RequestedShot { shot: Shot::Scan, simulation: args.simulation };
            let mut opened = opening::scanner(cell, &wanted, &write_progress)?;
            opened.camera.capture_3d().map_err(Fault::stage)?.cloud
        }
    };
    disk::write(&file, files::write_pcd(&cloud))?;
    write_progress(&format!("{}: the scan from which the panel is taught", file.display()));
    Ok(file)
}

/// Serves the page for drawing until the person has finished.
fn draw(args: &Teach, picture: &ColorPicture) -> Result<(), Fault> {
    let recipe = args.recipe.clone();
    let sheet = DrawingSheet {
        recipe: args.recipe.clone(),
        picture_png: files::write_color_png(picture).map_err(Fault::stage)?,
        size_px: [picture.width, picture.height],
        write: Box::new(move |text| disk::write_durable(&recipe, text).map_err(|fault| fault.to_string())),
    };
    let local = LocalServer::listen(args.listen).map_err(Fault::stage)?;
    write_progress(&format!(
        "Draw the region and the masked areas: open {} in a browser on this computer.",
        local.url()
    ));
    let saved = drawing::serve(local, sheet).map_err(Fault::stage)?;
    let words = if saved == 0 { "nothing was saved: the recipe is unchanged" } else { "saved" };
    write_progress(&format!("{}: {words}", args.recipe.display()));
    Ok(())
}

/// Takes the corner pictures with their poses, in the recipe's order.
fn corners(
    args: &Teach,
    (cell, world): (&CellFiles, Option<&sim::Cell>),
    folder: &Path,
) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Fault> {
    let names = load::recipe(&args.recipe)?.corner().which().keywords();
    let world = world.filter(|_| cell.cell.flange_camera().is_simulated());
    let mut camera = match world {
        Some(_) => None,
        None => {
            let wanted = RequestedShot { shot: Shot::Corner, simulation: args.simulation };
            Some(opening::flange_camera(cell, &wanted, &write_progress)?.camera)
        }
    };
    let poses = FlangePoses::new(cell);
    let (mut pictures, mut flanges) = (Vec::new(), Vec::new());
    for (index, name) in names.iter().enumerate() {
        let number = index + 1;
        let (picture, reported) = loop {
            write_progress(&format!(
                "Move the camera on the flange until it sees the {name} corner of the panel, as far away as in a \
                 cycle, and press Enter."
            ));
            if read_answer_line()?.is_none() {
                return Err(TeachingFault::NoAnswer.into());
            }
            let before = poses.now();
            let (picture, from_camera) = match (world, &mut camera) {
                (Some(world), _) => simulated_corner_view(world, index)?,
                (None, Some(camera)) => {
                    let taken = camera.capture().map_err(Fault::stage)?;
                    (taken.picture, taken.base_from_flange)
                }
                (None, None) => return Err(DeviceFault::NoWorld.into()),
            };
            if let Some(flange) = poses.combine_or_ask(before, from_camera)? {
                break (picture, flange);
            }
        };
        let (file, flange) =
            (folder.join(format!("taught_corner{number}.png")), folder.join(format!("taught_flange{number}.json")));
        disk::write(&file, files::write_color_png(&picture).map_err(Fault::stage)?)?;
        disk::write(&flange, files::write_reported_flange(&reported))?;
        write_progress(&format!("{}, {}: the {name} corner", file.display(), flange.display()));
        pictures.push(file);
        flanges.push(flange);
    }
    Ok((pictures, flanges))
}

/// The simulated camera's view of a corner, from the pose to which the simulated person has brought it.
fn simulated_corner_view(
    world: &sim::Cell,
    index: usize,
) -> Result<(ColorPicture, Option<Rigid<Base, Flange>>), Fault> {
    let views = world.corner_views();
    let view = views.get(index).ok_or(DeviceFault::NoWorld)?;
    Ok((world.flange_picture(&view.base_from_flange, PanelPosition::Nominal), Some(view.base_from_flange)))
}
