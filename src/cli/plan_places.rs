//! The places over which `panelprep plan` lays a path: the grids that are named, or those that failed in a film.

use super::args::Plan;
use super::disk;
use super::fault::Fault;
use super::inspected::PlacedPanel;
use super::load::{self, CellFiles, LoadedPanel};
use panelprep_base::geometry::Mask;
use panelprep_cell::files;
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe::{Recipe, TreatBy};
use panelprep_service::stages::treat::{self, Broken};
use panelprep_toolpath::surface::{Fit, Treated};
use panelprep_vision::inspect::{Demands, Footprint};
use std::path::Path;

/// A mask of another size than the camera's pictures.
#[derive(Debug, thiserror::Error)]
#[error(
    "the mask has {} × {} px, the camera's pictures have {} × {} px; name a mask that `inspect --pictures` wrote",
    found_px[0], found_px[1], camera_px[0], camera_px[1]
)]
struct OtherSize {
    found_px: [usize; 2],
    camera_px: [usize; 2],
}

/// Returns the grids of a plan, and what it treats of them; also a remark, if areas around breaks are wanted and the
/// breaks are not known.
///
/// # Errors
/// If a file is invalid, or a word is not a grid's name.
pub(super) fn places(
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

/// Reads the mask of a film and determines the broken places on the panel, at the pose that the film showed.
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

/// Returns the uncertainty of the pose that the plan is for, 95 %, mm; `None` if it is not known.
///
/// # Errors
/// If the file is invalid.
pub(super) fn located_mm(args: &Plan) -> Result<Option<f64>, Fault> {
    Ok(args.located.as_deref().map(load::located_mm).transpose()?.flatten())
}
