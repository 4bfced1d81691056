//! `panelprep inspect`: the water-break test on a clip or, with `--truth DIR`, on a labelled set of clips, which is
//! scored as a whole.
//!
//! Each folder in DIR that contains a `clip.csv` is a clip. Its labels are in `truth` or, if a person made them, next
//! to its pictures. For each true break (a connected component of the true mask), the score states whether half of its
//! area was found, and with what delay its first 10 mm² were detected as broken.

use super::args::{Common, Inspect};
use super::disk;
use super::fault::{ClipFault, Fault};
use super::inspected::{self, InspectedClip, Labels, PlacedPanel, abraded_pixels, inspect};
use super::load;
use super::output::{self, Outcome};
use panelprep_base::geometry::Mask;
use panelprep_base::geometry::statistics::mean;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::files;
use panelprep_cell::labels::{LABELS, MASK};
use panelprep_cell::recipe::Recipe;
use panelprep_service::report::page::Figure;
use panelprep_service::report::{BarClass, draw_bars, inspection_page};
use panelprep_service::setup::{self, CellFiles, LoadedPanel};
use panelprep_service::stages::film::FilmSetup;
use panelprep_vision::inspect::{Confusion, Demands, Score, score_within};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Inspects a clip and reports the result.
///
/// # Errors
/// If a file is invalid, or the panel was not taught.
pub fn run(args: &Inspect, common: &Common) -> Result<Outcome, Fault> {
    if let Some(folder) = args.pictures.as_ref().filter(|folder| folder.join(LABELS).exists()) {
        return Err(ClipFault::HoldsLabels { folder: folder.clone() }.into());
    }
    let files = CellFiles::read(&common.paths())?;
    let recipe = load::read_recipe(&args.recipe)?;
    let placed = PlacedPanel::read(&files, &recipe, args.located.as_ref())?;
    let taught = setup::taught(&files, &args.recipe, &recipe)?;
    let demands = Demands::from_recipe(&recipe, files.cell.limits());
    let clip = match (&args.clip, &args.truth) {
        (Some(clip), _) => clip,
        (None, Some(set)) => {
            return run_labelled_set(&taught, set, placed, &recipe, demands, args.pictures.as_deref());
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
            disk::save_picture(folder, &drawing.name, &picture)?;
            let jpeg = files::write_color_jpeg(&picture).map_err(Fault::stage)?;
            figures.push(Figure { caption: drawing.caption, jpeg });
        }
        let page = inspection_page(&inspected.filmed.inspection, &recipe, &clip.display().to_string(), figures);
        disk::write(&folder.join("inspection.html"), page.html())?;
    }
    Ok(inspected.outcome(mask))
}

/// Bin limits of the histogram of break sizes, mm².
const SIZE_BIN_LIMITS_MM2: [f64; 6] = [0.0, 5.0, 25.0, 50.0, 200.0, f64::INFINITY];
/// Area at which a break begins, mm²: the time of a break is the time at which its broken area first reaches this size.
const MIN_TIMED_BREAK_MM2: f64 = 10.0;
/// Bin limits of the histogram of delays, s.
const DELAY_BIN_LIMITS_S: [f64; 7] = [f64::NEG_INFINITY, -1.0, -0.5, 0.0, 0.5, 1.0, f64::INFINITY];

/// A true break of the film, and how it was detected.
struct TrueBreak {
    area_mm2: f64,
    found: bool,
    late_s: Option<f64>,
}

/// The row of one clip in the table of results.
struct Row {
    name: String,
    verdict: Verdict,
    whole: Score,
    within: Score,
    grids: Confusion,
    breaks: Vec<TrueBreak>,
}

/// Inspects and scores the labelled set in `folder`.
///
/// # Errors
/// If the folder contains no clip, or a clip or its labels cannot be read.
fn run_labelled_set(
    taught: &LoadedPanel,
    folder: &Path,
    placed: PlacedPanel,
    recipe: &Recipe,
    demands: Demands,
    pictures: Option<&Path>,
) -> Result<Outcome, Fault> {
    let clips = clips(folder)?;
    let mut rows = Vec::with_capacity(clips.len());
    for clip in &clips {
        output::write_progress(&clip.display().to_string());
        let truth = inspected::find_label_folder(clip)?;
        let inspected =
            inspect(&placed.inspection_setup(taught, recipe, demands), clip, placed.is_assumed, Some(&truth))?;
        rows.push(row(clip, &inspected, &Labels::read(&truth, clip)?)?);
    }
    let mut outcome = build_outcome(&rows);
    if let Some(pictures) = pictures {
        for (name, picture) in plot_results(&rows)? {
            super::disk::save_picture(pictures, name, &picture)?;
        }
    }
    outcome.add_value("set", json!(folder));
    Ok(outcome)
}

fn clips(folder: &Path) -> Result<Vec<PathBuf>, Fault> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|error| Fault::file_fault(folder, error))?;
    let mut clips: Vec<PathBuf> =
        entries.iter().map(fs::DirEntry::path).filter(|path| path.join("clip.csv").is_file()).collect();
    clips.sort();
    let none = || std::io::Error::other("contains no folder with a clip.csv; a labelled set is a folder of clips");
    if clips.is_empty() { Err(Fault::file_fault(folder, none())) } else { Ok(clips) }
}

fn row(clip: &Path, inspected: &InspectedClip, labels: &Labels) -> Result<Row, Fault> {
    let inspection = &inspected.filmed.inspection;
    let (Some((whole, grids)), footprint) = (inspected.score, &inspection.footprint) else {
        return Err(Fault::file_fault(clip, std::io::Error::other("the clip has no labels")));
    };
    let region = footprint.region();
    let within = score_within(&inspection.mask(), &labels.mask, &region).map_err(Fault::stage)?;
    let width = labels.mask.width;
    let true_break = |piece: &Vec<usize>| {
        let mut mask = Mask::all_outside(width, labels.mask.height);
        piece.iter().for_each(|&index| mask.inside[index] = true);
        let area_mm2: f64 = footprint.broken_mm2(&mask).iter().sum();
        let mut found_s: Vec<f64> =
            piece.iter().filter_map(|&index| inspection.break_time_s(index % width, index / width)).collect();
        let mut true_s: Vec<f64> = piece.iter().filter_map(|&index| labels.time_s(index)).collect();
        let found = found_s.len() * 2 >= piece.len();
        found_s.sort_by(f64::total_cmp);
        true_s.sort_by(f64::total_cmp);
        let nth = (MIN_TIMED_BREAK_MM2 / area_mm2 * piece.len() as f64).ceil() as usize;
        let late_s = found_s.get(nth).zip(true_s.get(nth)).map(|(found_s, true_s)| found_s - true_s);
        TrueBreak { area_mm2, found, late_s }
    };
    let inside = Mask {
        inside: labels.mask.inside.iter().zip(&region.inside).map(|(broke, inside)| *broke && *inside).collect(),
        ..labels.mask
    };
    Ok(Row {
        name: clip.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        verdict: inspection.judgement.verdict,
        whole,
        within,
        grids,
        breaks: inside.connected_components().iter().map(true_break).collect(),
    })
}

/// Returns for each size class its name, the number of true breaks, and how many of them were missed.
fn count_detections_by_size(rows: &[Row]) -> Vec<(String, usize, usize)> {
    let breaks = || rows.iter().flat_map(|row| &row.breaks);
    let class = |ends: &[f64]| {
        let of = || breaks().filter(|one| (ends[0]..ends[1]).contains(&one.area_mm2));
        (format_range(ends, "mm²"), of().count(), of().filter(|one| !one.found).count())
    };
    SIZE_BIN_LIMITS_MM2.windows(2).map(class).collect()
}

fn count_delays_by_bin(rows: &[Row]) -> Vec<(String, usize)> {
    let late = || rows.iter().flat_map(|row| &row.breaks).filter_map(|one| one.late_s);
    DELAY_BIN_LIMITS_S
        .windows(2)
        .map(|ends| (format_range(ends, "s"), late().filter(|s| (ends[0]..ends[1]).contains(s)).count()))
        .collect()
}

fn format_range(ends: &[f64], unit: &str) -> String {
    match (ends[0].is_finite(), ends[1].is_finite()) {
        (true, true) => format!("{} to {} {unit}", ends[0], ends[1]),
        (true, false) => format!("{} {unit} and more", ends[0]),
        _ => format!("below {} {unit}", ends[1]),
    }
}

fn build_outcome(rows: &[Row]) -> Outcome {
    let broken = || rows.iter().filter(|row| row.grids.true_fail + row.grids.false_pass > 0);
    let sum = |of: fn(&Confusion) -> usize| rows.iter().map(|row| of(&row.grids)).sum::<usize>();
    let confusion = Confusion {
        true_fail: sum(|grids| grids.true_fail),
        false_fail: sum(|grids| grids.false_fail),
        false_pass: sum(|grids| grids.false_pass),
        true_pass: sum(|grids| grids.true_pass),
    };
    let late: Vec<f64> = rows.iter().flat_map(|row| &row.breaks).filter_map(|one| one.late_s).collect();
    let near = late.iter().filter(|late_s| late_s.abs() <= 0.5).count();
    let iou = mean(broken().map(|row| row.whole.iou));
    let within = mean(broken().map(|row| row.within.iou));
    let (precision, recall) =
        (mean(broken().map(|row| row.whole.precision)), mean(broken().map(|row| row.whole.recall)));
    // The verdict is always "accept", because a labelled set judges the method and not a panel.
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines = vec![format!("{:16} verdict   iou   within  prec.  recall  breaks missed", "clip")];
    for row in rows {
        let Score { iou, precision, recall } = row.whole;
        let missed = row.breaks.iter().filter(|one| !one.found).count();
        outcome.add_line(format!(
            "{:16} {:8}  {iou:.3}  {:.3}   {precision:.3}  {recall:.3}  {:6} {missed:6}",
            row.name,
            row.verdict.keyword(),
            row.within.iou,
            row.breaks.len()
        ));
    }
    let shown = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.3}"));
    outcome.add_line(format!(
        "mean of clips with breaks: intersection over union {} ({} without a border of ±1 px), precision {}, recall {}",
        shown(iou),
        shown(within),
        shown(precision),
        shown(recall)
    ));
    let Confusion { true_fail, false_fail, false_pass, true_pass } = confusion;
    outcome.add_line(format!(
        "grids: {true_fail} rightly failed, {false_fail} wrongly failed, {false_pass} wrongly passed, {true_pass} rightly passed"
    ));
    let sizes = count_detections_by_size(rows);
    for (class, places, missed) in &sizes {
        outcome.add_line(format!("  breaks of {class:16} {places:4}, missed {missed:4}"));
    }
    outcome.add_line(format!(
        "time to break, for breaks of {MIN_TIMED_BREAK_MM2} mm² or more: {near} of {} within 0.5 s",
        late.len()
    ));
    let clips: Vec<Value> = rows
        .iter()
        .map(|row| {
            json!({"clip": row.name, "verdict": row.verdict, "iou": row.whole.iou, "iou_within": row.within.iou,
               "precision": row.whole.precision, "recall": row.whole.recall})
        })
        .collect();
    let sizes: Vec<Value> = sizes
        .iter()
        .map(|(class, places, missed)| json!({"size": class, "places": places, "missed": missed}))
        .collect();
    outcome.add_value("score", json!({
        "clips": rows.len(), "iou": iou, "iou_within": within, "precision": precision, "recall": recall,
        "grids": {"true_fail": true_fail, "false_fail": false_fail, "false_pass": false_pass, "true_pass": true_pass},
        "miss_by_size": sizes, "timed": late.len(), "within_half_a_second": near,
    }));
    outcome.add_value("clips", json!(clips));
    outcome
}

fn plot_results(rows: &[Row]) -> Result<[(&'static str, panelprep_base::geometry::ColorPicture); 2], Fault> {
    let missed: Vec<BarClass> = count_detections_by_size(rows)
        .into_iter()
        .map(|(class, places, missed)| BarClass {
            label: format!("{class} ({missed} of {places})"),
            share: missed as f64 / places.max(1) as f64,
        })
        .collect();
    let lateness = count_delays_by_bin(rows);
    let all: usize = lateness.iter().map(|(_, count)| count).sum();
    let late: Vec<BarClass> = lateness
        .into_iter()
        .map(|(class, count)| BarClass {
            label: format!("{class} ({count})"),
            share: count as f64 / all.max(1) as f64,
        })
        .collect();
    Ok([
        ("missed_by_size", draw_bars("missed breaks, by size", &missed).map_err(Fault::stage)?),
        ("time_error", draw_bars("delay until the first 10 mm² were found", &late).map_err(Fault::stage)?),
    ])
}
