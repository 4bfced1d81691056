//! `panelprep tune`: gives advice about the light, and about the settings of the inspection method, from a clip.

use super::args::{Common, Tune};
use super::fault::Fault;
use super::inspected::{Labels, PlacedPanel, read_clip};
use super::load;
use super::output::Outcome;
use panelprep_base::geometry::{ColorPicture, Mask};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::files::ClipEntry;
use panelprep_cell::recipe::{Method, Recipe};
use panelprep_service::setup::{self, CellFiles};
use panelprep_vision::inspect::{
    Advice, Demands, FilmView, FilmWatch, GridContrast, MIN_CONTRAST_TO_NOISE, Sampler, Tuning, best_threshold,
    thesis_checks,
};
use serde_json::json;

/// The names of a picture's channels.
const CHANNELS: [&str; 3] = ["red", "green", "blue"];
/// Maximum number of evaluated pictures per phase.
const MAX_PICTURES_PER_PHASE: usize = 10;
/// Evaluates a clip and prints the advice.
///
/// # Errors
/// If a file is invalid, the panel was not taught, or the clip has no dry picture.
pub fn run(args: &Tune, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let recipe = load::read_recipe(&args.recipe)?;
    let placed = PlacedPanel::read(&files, &recipe, args.located.as_ref())?;
    let taught = setup::taught(&files, &args.recipe, &recipe)?;
    let list = args.clip.join("clip.csv");
    let clip = read_clip(&args.clip)?;
    let picture = |shot: &ClipEntry| load::picture(&args.clip.join(&shot.file), &placed.camera);
    let camera_from_panel = placed.base_from_camera.inverse() * placed.base_from_panel;
    let demands = Demands::from_recipe(&recipe, files.cell.limits());
    // The view defines the region of the panel in the pictures, and is used for the checks of the pictures.
    let view = FilmView { taught: &taught.panel, camera: &placed.camera, camera_from_panel, sanded: None };
    let mut watch = FilmWatch::new(&view, recipe.inspect(), demands).map_err(Fault::stage)?;
    if placed.is_assumed {
        watch.assume_nominal_pose();
    }
    let region = watch.region();
    let mut sampler = Sampler::new(&region);
    let pictures = |phase: Phase| clip.entries().iter().filter(move |shot| shot.phase == phase);
    for shot in pictures(Phase::Dry).take(MAX_PICTURES_PER_PHASE) {
        let picture = picture(shot)?;
        sampler.add_dry(&picture);
        watch.push(&picture, shot.time_s, shot.phase).map_err(Fault::stage)?;
    }
    let mut reference: Option<ColorPicture> = None;
    for shot in pictures(Phase::Wet).take(MAX_PICTURES_PER_PHASE) {
        let picture = picture(shot)?;
        sampler.add_wet(&picture);
        reference.get_or_insert(picture);
    }
    let settings = recipe.inspect();
    let Some((advice, reference)) = sampler.advice(settings).zip(reference) else {
        let message = "no picture of phase dry, or no picture of phase wet; the comparison needs both";
        return Err(Fault::file_fault(&list, std::io::Error::other(message)));
    };
    let labels = args.truth.as_deref().map(|folder| Labels::read(folder, &args.clip)).transpose()?;
    let truth = labels.map(|labels| labels.mask);
    if settings.method() == Method::Film {
        let mut flashes = sampler.flash_detector(settings, truth.as_ref());
        let all = Mask { inside: vec![true; taught.panel.mask.inside.len()], ..taught.panel.mask };
        let sanded = FilmView { sanded: Some(&all), ..view };
        let mut if_sanded = FilmWatch::new(&sanded, settings, demands).map_err(Fault::stage)?;
        for shot in pictures(Phase::Dry).take(1).chain(pictures(Phase::Wet)) {
            let picture = picture(shot)?;
            if_sanded.push(&picture, shot.time_s, shot.phase).map_err(Fault::stage)?;
            if shot.phase == Phase::Wet {
                flashes.push(&picture, shot.time_s);
            }
        }
        let if_sanded = if_sanded.finish().map_err(Fault::stage)?;
        let unseen = if_sanded.grids.iter().filter(|grid| !grid.seen && !grid.failed);
        let found = Tuning {
            advice,
            grids: sampler.grid_contrasts(settings, &watch.grid_pixels()),
            flash_s: flashes.longest_s(),
            detection_limit_mm2: watch.detection_limit_mm2(),
            unseen_if_sanded: unseen.map(|grid| grid.id).collect(),
            displaced_reason: watch.displaced_panel_reason(),
        };
        return Ok(film_outcome(&found, &demands, &recipe));
    }
    let mut outcome = thesis_outcome(&advice, watch.displaced_panel_reason());
    if let (Some(truth), Some(last)) = (&truth, pictures(Phase::Wet).next_back()) {
        let last = picture(last)?;
        let (threshold, score) =
            best_threshold(settings, [&reference, &last], truth, &region).map_err(Fault::stage)?;
        outcome.add_line(format!(
            "compared with the labels, method \"thesis\" is best with threshold = {threshold}: intersection over union \
             {:.3}, precision {:.3}, recall {:.3}",
            score.iou, score.precision, score.recall
        ));
        outcome.add_value("best_threshold", json!({"threshold": threshold, "iou": score.iou}));
    }
    Ok(outcome)
}

/// Reports the grids on which the film is brighter than the dry panel.
fn report_brighter_grids(grids: &[GridContrast], outcome: &mut Outcome) {
    let brighter = |grid: &&GridContrast| grid.channel_to_noise <= -MIN_CONTRAST_TO_NOISE;
    for grid in grids.iter().filter(brighter) {
        outcome.add_line(format!(
            "{}: the film is brighter than the dry panel, most in {}; the film reflects the lamp or the diffuser there",
            grid.id, CHANNELS[grid.channel]
        ));
    }
}

fn film_outcome(found: &Tuning, demands: &Demands, recipe: &Recipe) -> Outcome {
    let advice = &found.advice;
    let checks = found.checks(demands);
    let (persist_s, longer_s) = (demands.persist_s, found.needed_persist_s(demands));
    let mut outcome = Outcome::from_judgement(&Judgement::from_checks(&checks));
    outcome.add_checks(&checks);
    report_channels(advice, &mut outcome);
    outcome.add_line("grid      dry    wet  contrast/noise  light");
    for grid in &found.grids {
        outcome.add_line(format!(
            "{:6} {:6.1} {:6.1} {:>15} {:6.2}",
            grid.id.to_string(),
            grid.dry,
            grid.wet,
            fixed_decimals(grid.contrast_to_noise, 1).to_string(),
            grid.light
        ));
    }
    report_brighter_grids(&found.grids, &mut outcome);
    report_light(advice, &mut outcome);
    outcome.add_line(format!(
        "smallest break that is reliably found: {:.1} mm²; a grid fails from {:.1} mm² of broken film",
        found.detection_limit_mm2, demands.min_break_mm2
    ));
    outcome.add_line(format!(
        "pixels that appeared dry and then wet again were dry for up to {:.1} s; a break must persist for {persist_s} \
         s",
        found.flash_s
    ));
    let unseen: Vec<String> = found.unseen_if_sanded.iter().map(ToString::to_string).collect();
    let reference = if unseen.is_empty() { "wet" } else { "dry" };
    outcome.add_line(if unseen.is_empty() {
        "after sanding, enough water moves on every grid to judge the grid without a dry picture".to_owned()
    } else {
        format!(
            "after sanding, too little water moves on these grids to judge them without a dry picture: {}",
            unseen.join(", ")
        )
    });
    let weights = advice.channels.map(|channel| channel.weight);
    let min_break_mm2 = demands.min_break_mm2.max(found.detection_limit_mm2.ceil());
    let persist_s = persist_s.max(longer_s);
    outcome.add_line("for the recipe:");
    outcome.add_line("  [inspect]");
    outcome.add_line(format!("  reference = \"{reference}\""));
    outcome.add_line(format!("  channel_weights = {weights:?}"));
    outcome.add_line(format!("  persist_s = {persist_s:?}"));
    outcome.add_line(format!("  min_break_mm2 = {min_break_mm2:?}"));
    outcome.add_line("  [process]");
    outcome.add_line(match recipe.process().lamp() {
        Some(lamp) => format!("  lamp = {lamp:?}        # unchanged"),
        None => {
            "  lamp = \"kind, brightness at the panel\"        # not stated yet; printed on the page that the inspector signs".to_owned()
        }
    });
    let grid = |grid: &GridContrast| {
        json!({"id": grid.id.to_string(), "dry": grid.dry, "wet": grid.wet,
               "contrast_to_noise": grid.contrast_to_noise, "light": grid.light, "channel": CHANNELS[grid.channel],
               "channel_to_noise": grid.channel_to_noise, "faint_percent": grid.faint_percent})
    };
    outcome.add_value("grids", json!(found.grids.iter().map(grid).collect::<Vec<_>>()));
    outcome.add_value("reference", json!(reference));
    outcome.add_value("unseen_if_sanded", json!(unseen));
    outcome.add_value("detection_limit_mm2", json!(found.detection_limit_mm2));
    outcome.add_value("min_break_mm2", json!(min_break_mm2));
    outcome.add_value("flash_s", json!(found.flash_s));
    outcome.add_value("persist_s", json!(persist_s));
    outcome.add_value("lamp", json!(recipe.process().lamp()));
    outcome.add_value("channel_weights", json!(weights));
    outcome
}

fn thesis_outcome(advice: &Advice, elsewhere: Option<Reason>) -> Outcome {
    let checks = thesis_checks(advice, elsewhere);
    let mut outcome = Outcome::from_judgement(&Judgement::from_checks(&checks));
    outcome.add_checks(&checks);
    report_channels(advice, &mut outcome);
    report_light(advice, &mut outcome);
    let weights = advice.channels.map(|channel| channel.weight);
    outcome.add_line("for the recipe, [inspect]:");
    outcome.add_line(format!("  channel_weights = {weights:?}"));
    outcome.add_line(format!("  threshold = {}", advice.threshold));
    outcome.add_line(format!("  hsv_min = {:?}", advice.hsv[0]));
    outcome.add_line(format!("  hsv_max = {:?}", advice.hsv[1]));
    outcome.add_value("channel_weights", json!(weights));
    outcome.add_value("threshold", json!(advice.threshold));
    outcome.add_value("hsv_min", json!(advice.hsv[0]));
    outcome.add_value("hsv_max", json!(advice.hsv[1]));
    outcome
}

fn report_channels(advice: &Advice, outcome: &mut Outcome) {
    outcome.add_line("channel     dry    wet  noise  contrast/noise  weight");
    let mut rows = Vec::new();
    for (name, channel) in CHANNELS.iter().zip(&advice.channels) {
        let ratio = channel.contrast_to_noise();
        outcome.add_line(format!(
            "{name:7} {:7.1} {:6.1} {:6.2} {:>15} {:7.2}",
            channel.dry,
            channel.wet,
            channel.noise,
            fixed_decimals(ratio, 1).to_string(),
            channel.weight
        ));
        rows.push(json!({"name": name, "dry": channel.dry, "wet": channel.wet, "noise": channel.noise,
                         "contrast_to_noise": ratio, "weight": channel.weight}));
    }
    outcome.add_value("channels", json!(rows));
}

fn report_light(advice: &Advice, outcome: &mut Outcome) {
    outcome.add_line(format!(
        "light over the dry region: {:.2} to {:.2} times its mean; overexposed pixels {:.2} %",
        advice.evenness[0],
        advice.evenness[1],
        100.0 * advice.overexposed
    ));
    outcome.add_value("evenness", json!(advice.evenness));
    outcome.add_value("overexposed", json!(advice.overexposed));
}
