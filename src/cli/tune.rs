//! `panelprep tune`: what a clip says about light and the settings of the method in use.

use super::args::{Common, Tune};
use super::disk;
use super::fault::Fault;
use super::inspect::Placed;
use super::labels::Labels;
use super::load::{self, CellFiles};
use super::outcome::Outcome;
use crate::files::{self, ClipEntry};
use crate::geometry::ColorPicture;
use crate::inspect::{
    Advice, Demands, GridContrast, MIN_CHANGE_LEVELS, Sampler, Watch, best_threshold, too_coarse,
};
use crate::phase::Phase;
use crate::recipe::{Method, Recipe};
use crate::verdict::{Judgement, Reason};
use crate::words::{apart, fixed};
use serde_json::json;

/// The channels of a picture.
const CHANNELS: [&str; 3] = ["red", "green", "blue"];
/// Pictures of each phase that are looked at.
const LOOKED_AT: usize = 10;
/// Fewer times the noise is too little to tell wet from dry by.
const MIN_CONTRAST_TO_NOISE: f64 = 5.0;
/// Of a grid this share may look alike under a film and dry, percent: greasy places do.
const MOST_FAINT_PERCENT: f64 = 10.0;
/// A panel that is darker when dry, in levels, needs more light before anything else.
const DARK_LEVELS: f64 = 40.0;
/// Light less even than this leaves a part of the panel dark or overexposed sooner than the rest.
const MIN_EVENNESS: f64 = 0.6;

/// Looks at a clip and advises.
///
/// # Errors
/// Where a file is not what it must be, the panel was not taught, or the clip has no dry picture.
pub fn run(args: &Tune, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let placed = Placed::read(&files, args.located.as_ref())?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let list = args.clip.join("clip.csv");
    let clip = files::read_clip(&disk::read(&list)?).map_err(|error| Fault::file(&list, error))?;
    let picture = |shot: &ClipEntry| load::picture(&args.clip.join(&shot.file), &placed.camera);
    let camera_from_panel = placed.base_from_camera.inverse() * placed.base_from_panel;
    let demands = Demands::of(&recipe, files.cell.limits());
    // For its region, and for the checks of what is pushed.
    let mut watch = Watch::new(&taught.panel, &placed.camera, camera_from_panel, recipe.inspect(), demands)
        .map_err(Fault::stage)?;
    if placed.is_assumed {
        watch.assume_place();
    }
    let region = watch.region();
    let mut sampler = Sampler::new(&region);
    let of = |phase: Phase| clip.shots().iter().filter(move |shot| shot.phase == phase);
    for shot in of(Phase::Dry).take(LOOKED_AT) {
        let picture = picture(shot)?;
        sampler.dry(&picture);
        watch.push(&picture, shot.time_s, shot.phase).map_err(Fault::stage)?;
    }
    let mut reference: Option<ColorPicture> = None;
    for shot in of(Phase::Wet).take(LOOKED_AT) {
        let picture = picture(shot)?;
        sampler.wet(&picture);
        reference.get_or_insert(picture);
    }
    let settings = recipe.inspect();
    let Some((advice, reference)) = sampler.advice(settings).zip(reference) else {
        let message = "it has no picture of phase dry, or none of phase wet; without both nothing is compared";
        return Err(Fault::file(&list, std::io::Error::other(message)));
    };
    let truth = args.truth.as_deref().map(Labels::read).transpose()?.map(|labels| labels.mask);
    if settings.method() == Method::Film {
        let mut flashes = sampler.flashes(settings, truth.as_ref());
        for shot in of(Phase::Wet) {
            flashes.push(&picture(shot)?, shot.time_s);
        }
        let found = Found {
            advice,
            grids: sampler.contrasts(settings, &watch.grid_pixels()),
            flash_s: flashes.longest_s(),
            limit_mm2: watch.detection_limit_mm2(),
            elsewhere: watch.stands_elsewhere(),
        };
        return Ok(film_told(&found, &demands, &recipe));
    }
    let mut outcome = thesis_told(&advice, watch.stands_elsewhere());
    if let (Some(truth), Some(last)) = (&truth, of(Phase::Wet).next_back()) {
        let last = picture(last)?;
        let (threshold, score) =
            best_threshold(settings, [&reference, &last], truth, &region).map_err(Fault::stage)?;
        outcome.say(format!(
            "on the labels, the thesis's pipeline is best with threshold = {threshold}: intersection over union {:.3}, \
             precision {:.3}, recall {:.3}",
            score.iou, score.precision, score.recall
        ));
        outcome.put("best_threshold", json!({"threshold": threshold, "iou": score.iou}));
    }
    Ok(outcome)
}

/// What a clip says to the film method.
struct Found {
    advice: Advice,
    grids: Vec<GridContrast>,
    /// How long places look dry and then wet again, s.
    flash_s: f64,
    limit_mm2: f64,
    elsewhere: Option<Reason>,
}

/// What is wrong with the light, whatever the method.
fn light_reasons(advice: &Advice) -> Vec<Reason> {
    let mut review = Vec::new();
    if advice.evenness[0] < MIN_EVENNESS {
        let [darkest, needed] = apart(advice.evenness[0], MIN_EVENNESS, 2);
        let message = format!(
            "the darkest twentieth of the region has {darkest} of its mean light, needed are {needed}: a diffuser, or a lamp \
             farther away"
        );
        review.push(Reason::new("uneven", message));
    }
    if advice.overexposed > 0.001 {
        let message =
            format!("{:.1} % of the dry region is overexposed: a shorter exposure", 100.0 * advice.overexposed);
        review.push(Reason::new("overexposed", message));
    }
    review
}

fn contrast_reason(what: &str, contrast_to_noise: f64) -> Option<Reason> {
    // A NaN is no contrast.
    let is_enough = contrast_to_noise >= MIN_CONTRAST_TO_NOISE;
    let [found, needed] = apart(contrast_to_noise, MIN_CONTRAST_TO_NOISE, 1);
    let message = format!(
        "the film changes {what} by {found} times the noise, needed are {needed}: more light, or a longer exposure"
    );
    (!is_enough).then(|| Reason::new("contrast", message))
}

/// Where a break would not show, and what would help.
fn faint_reason(grids: &[GridContrast]) -> Option<Reason> {
    let faint: Vec<&GridContrast> = grids.iter().filter(|grid| grid.faint_percent > MOST_FAINT_PERCENT).collect();
    let mean_dry = faint.iter().map(|grid| grid.dry).sum::<f64>() / faint.len().max(1) as f64;
    let named: Vec<String> =
        faint.iter().map(|grid| format!("{} ({:.0} %)", grid.id, grid.faint_percent)).collect();
    let remedy = if mean_dry < DARK_LEVELS {
        "more light or a longer exposure"
    } else {
        "there the film mirrors something that makes it as bright as the dry panel: move the lamp or the diffuser aside, so that \
         the panel mirrors the dark there, or take a diffuser so large that it mirrors nothing else"
    };
    let message = format!(
        "the film changes a part of {} by less than {MIN_CHANGE_LEVELS:.0} grey levels in every channel, and a break there would not \
         show: {remedy}",
        named.join(", ")
    );
    (!faint.is_empty()).then(|| Reason::new("no_contrast", message))
}

/// Grids that the film makes brighter.
fn say_brighter(grids: &[GridContrast], outcome: &mut Outcome) {
    let brighter = |grid: &&GridContrast| grid.channel_to_noise <= -MIN_CONTRAST_TO_NOISE;
    for grid in grids.iter().filter(brighter) {
        outcome.say(format!(
            "{}: the film is brighter than the dry panel, most in {}; it mirrors the lamp or the diffuser there",
            grid.id, CHANNELS[grid.channel]
        ));
    }
}

fn film_told(found: &Found, demands: &Demands, recipe: &Recipe) -> Outcome {
    let advice = &found.advice;
    let worst = found.grids.iter().min_by(|a, b| a.best_to_noise().total_cmp(&b.best_to_noise()));
    let mut review: Vec<Reason> = found.elsewhere.iter().cloned().collect();
    review.extend(worst.and_then(|grid| contrast_reason(&format!("grid {}", grid.id), grid.best_to_noise())));
    review.extend(faint_reason(&found.grids));
    review.extend(light_reasons(advice));
    review.extend(too_coarse(found.limit_mm2, demands.min_break_mm2));
    let (persist_s, interval_s) = (demands.persist_s, 1.0 / demands.frames_per_second);
    let longer_s = tenth_up((found.flash_s + interval_s).max(2.0 * interval_s));
    if persist_s < longer_s {
        let [persist, longer] = apart(persist_s, longer_s, 1);
        let message = format!(
            "places look dry for up to {} s and then wet again, and persist_s is {persist} s: needed are {longer} s, or fewer \
             reflections",
            fixed(found.flash_s, 1)
        );
        review.push(Reason::new("persist", message));
    }
    let mut outcome = Outcome::of(&judged(review));
    say_channels(advice, &mut outcome);
    outcome.say("grid      dry    wet  contrast/noise  light");
    for grid in &found.grids {
        outcome.say(format!(
            "{:6} {:6.1} {:6.1} {:>15} {:6.2}",
            grid.id.to_string(),
            grid.dry,
            grid.wet,
            fixed(grid.contrast_to_noise, 1).to_string(),
            grid.light
        ));
    }
    say_brighter(&found.grids, &mut outcome);
    say_light(advice, &mut outcome);
    outcome.say(format!(
        "smallest break that is surely found: {:.1} mm²; a grid fails from {:.1} mm²",
        found.limit_mm2, demands.min_break_mm2
    ));
    outcome.say(format!(
        "places that look dry and then wet again: for up to {:.1} s; a break must be seen for {persist_s} s",
        found.flash_s
    ));
    let weights = advice.channels.map(|channel| channel.weight);
    let min_break_mm2 = demands.min_break_mm2.max(found.limit_mm2.ceil());
    let persist_s = persist_s.max(longer_s);
    outcome.say("for the recipe:");
    outcome.say("  [inspect]");
    outcome.say(format!("  channel_weights = {weights:?}"));
    outcome.say(format!("  persist_s = {persist_s:?}"));
    outcome.say(format!("  min_break_mm2 = {min_break_mm2:?}"));
    outcome.say("  [process]");
    outcome.say(match recipe.process().lamp() {
        Some(lamp) => format!("  lamp = {lamp:?}        # as it stands"),
        None => {
            "  lamp = \"kind, brightness at the panel\"        # not stated yet; the inspector signs it".to_owned()
        }
    });
    let grid = |grid: &GridContrast| {
        json!({"id": grid.id.to_string(), "dry": grid.dry, "wet": grid.wet,
               "contrast_to_noise": grid.contrast_to_noise, "light": grid.light, "channel": CHANNELS[grid.channel],
               "channel_to_noise": grid.channel_to_noise, "faint_percent": grid.faint_percent})
    };
    outcome.put("grids", json!(found.grids.iter().map(grid).collect::<Vec<_>>()));
    outcome.put("detection_limit_mm2", json!(found.limit_mm2));
    outcome.put("min_break_mm2", json!(min_break_mm2));
    outcome.put("flash_s", json!(found.flash_s));
    outcome.put("persist_s", json!(persist_s));
    outcome.put("lamp", json!(recipe.process().lamp()));
    outcome.put("channel_weights", json!(weights));
    outcome
}

fn tenth_up(seconds: f64) -> f64 {
    (10.0 * seconds - 1e-6).ceil() / 10.0
}

fn judged(review: Vec<Reason>) -> Judgement {
    Judgement::of(vec![], review)
}

fn thesis_told(advice: &Advice, elsewhere: Option<Reason>) -> Outcome {
    let best = advice.channels.iter().map(|channel| channel.contrast_to_noise()).fold(0.0, f64::max);
    let mut review: Vec<Reason> = elsewhere.into_iter().collect();
    review.extend(contrast_reason("the best channel", best));
    review.extend(light_reasons(advice));
    let mut outcome = Outcome::of(&judged(review));
    say_channels(advice, &mut outcome);
    say_light(advice, &mut outcome);
    let weights = advice.channels.map(|channel| channel.weight);
    outcome.say("for the recipe, [inspect]:");
    outcome.say(format!("  channel_weights = {weights:?}"));
    outcome.say(format!("  threshold = {}", advice.threshold));
    outcome.say(format!("  hsv_min = {:?}", advice.hsv[0]));
    outcome.say(format!("  hsv_max = {:?}", advice.hsv[1]));
    outcome.put("channel_weights", json!(weights));
    outcome.put("threshold", json!(advice.threshold));
    outcome.put("hsv_min", json!(advice.hsv[0]));
    outcome.put("hsv_max", json!(advice.hsv[1]));
    outcome
}

fn say_channels(advice: &Advice, outcome: &mut Outcome) {
    outcome.say("channel     dry    wet  noise  contrast/noise  weight");
    let mut rows = Vec::new();
    for (name, channel) in CHANNELS.iter().zip(&advice.channels) {
        let ratio = channel.contrast_to_noise();
        outcome.say(format!(
            "{name:7} {:7.1} {:6.1} {:6.2} {:>15} {:7.2}",
            channel.dry,
            channel.wet,
            channel.noise,
            fixed(ratio, 1).to_string(),
            channel.weight
        ));
        rows.push(json!({"name": name, "dry": channel.dry, "wet": channel.wet, "noise": channel.noise,
                         "contrast_to_noise": ratio, "weight": channel.weight}));
    }
    outcome.put("channels", json!(rows));
}

fn say_light(advice: &Advice, outcome: &mut Outcome) {
    outcome.say(format!(
        "light over the dry region: {:.2} to {:.2} of its mean; overexposed {:.2} %",
        advice.evenness[0],
        advice.evenness[1],
        100.0 * advice.overexposed
    ));
    outcome.put("evenness", json!(advice.evenness));
    outcome.put("overexposed", json!(advice.overexposed));
}
