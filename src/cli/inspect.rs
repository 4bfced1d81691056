//! `panelprep inspect`: the water-break test on a clip, or on a labelled set of clips.

use super::args::{Common, Inspect};
use super::disk;
use super::fault::{ClipFault, Fault};
use super::inspected::{PlacedPanel, abraded_pixels, inspect};
use super::load::{self, CellFiles};
use super::outcome::Outcome;
use super::pictures;
use super::validate;
use panelprep_cell::files::{self};
use panelprep_cell::labels::{LABELS, MASK};
use panelprep_service::report::inspection_page;
use panelprep_service::report::page::Figure;
use panelprep_service::stages::film::FilmSetup;
use panelprep_vision::inspect::Demands;

/// Inspects a clip and reports the result.
///
/// # Errors
/// If a file is invalid, or the panel was not taught.
pub fn run(args: &Inspect, common: &Common) -> Result<Outcome, Fault> {
    if let Some(folder) = args.pictures.as_ref().filter(|folder| folder.join(LABELS).exists()) {
        return Err(ClipFault::HoldsLabels { folder: folder.clone() }.into());
    }
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let placed = PlacedPanel::read(&files, &recipe, args.located.as_ref())?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let demands = Demands::from_recipe(&recipe, files.cell.limits());
    let clip = match (&args.clip, &args.truth) {
        (Some(clip), _) => clip,
        (None, Some(set)) => {
            return validate::run(&taught, set, placed, &recipe, demands, args.pictures.as_deref());
        }
        (None, None) => return Err(Fault::stage(files::ClipError::Empty)),
    };
    let sanded = abraded_pixels(&args.abraded, &taught, &recipe)?;
    let setup = FilmSetup { sanded: sanded.as_ref(), ..placed.inspection_setup(&taught, &recipe, demands) };
    let inspected = inspect(&setup, clip, placed.is_assumed, args.truth.as_deref())?;
    let mut mask = None;
    if let Some(folder) = &args.pictures {
        let file = folder.join(MASK);
        let bytes = files::write_gray_png(&inspected.filmed.inspection.mask().to_gray()).map_err(Fault::stage)?;
        disk::write(&file, bytes)?;
        mask = Some(file);
        let mut figures = Vec::new();
        for drawing in inspected.filmed.draw_film(&setup) {
            let picture = drawing.picture.map_err(Fault::stage)?;
            pictures::save(folder, &drawing.name, &picture)?;
            let jpeg = files::write_color_jpeg(&picture).map_err(Fault::stage)?;
            figures.push(Figure { caption: drawing.caption, jpeg });
        }
        let page = inspection_page(&inspected.filmed.inspection, &recipe, &clip.display().to_string(), figures);
        disk::write(&folder.join("inspection.html"), page.html())?;
    }
    Ok(inspected.outcome(mask))
}
