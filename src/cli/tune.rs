//! `panelprep tune`: what a clip says about light, channel weights and thresholds.

use super::args::{Common, Tune};
use super::disk;
use super::fault::Fault;
use super::inspect::Placed;
use super::labels::Labels;
use super::load::{self, CellFiles};
use super::outcome::Outcome;
use crate::files::{self, ClipEntry};
use crate::geometry::ColorPicture;
use crate::inspect::{Advice, Demands, Sampler, Watch, best_threshold};
use crate::phase::Phase;
use crate::verdict::{Judgement, Reason, Verdict};
use crate::words::apart;
use serde_json::json;

/// Pictures of each phase that are looked at.
const LOOKED_AT: usize = 10;
/// Fewer times the noise is too little to tell wet from dry by.
const MIN_CONTRAST_TO_NOISE: f64 = 5.0;
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
        return Err(Fault::file(
            &list,
            std::io::Error::other("it has no picture of phase dry; without one nothing is compared"),
        ));
    };
    let mut outcome = told(&advice);
    if let (Some(folder), Some(last)) = (&args.truth, of(Phase::Wet).next_back()) {
        let truth = Labels::read(folder)?.mask;
        let last = picture(last)?;
        let (threshold, score) =
            best_threshold(settings, [&reference, &last], &truth, &region).map_err(Fault::stage)?;
        outcome.say(format!(
            "on the labels, the thesis's pipeline is best with threshold = {threshold}: intersection over union {:.3}, \
             precision {:.3}, recall {:.3}",
            score.iou, score.precision, score.recall
        ));
        outcome.put("best_threshold", json!({"threshold": threshold, "iou": score.iou}));
    }
    Ok(outcome)
}

fn told(advice: &Advice) -> Outcome {
    let mut review = Vec::new();
    let best = advice.channels.iter().map(|channel| channel.contrast_to_noise()).fold(0.0, f64::max);
    if best < MIN_CONTRAST_TO_NOISE {
        let [best, needed] = apart(best, MIN_CONTRAST_TO_NOISE, 1);
        let message = format!(
            "the film changes the best channel by {best} times the noise, needed are {needed}: more light, or a longer exposure"
        );
        review.push(Reason::new("contrast", message));
    }
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
    let verdict = if review.is_empty() { Verdict::Accept } else { Verdict::Review };
    let mut outcome = Outcome::of(&Judgement { verdict, reasons: review });
    outcome.say("channel     dry    wet  noise  contrast/noise  weight");
    let mut rows = Vec::new();
    for (name, channel) in ["red", "green", "blue"].iter().zip(&advice.channels) {
        let ratio = channel.contrast_to_noise();
        outcome.say(format!(
            "{name:7} {:7.1} {:6.1} {:6.2} {ratio:15.1} {:7.2}",
            channel.dry, channel.wet, channel.noise, channel.weight
        ));
        rows.push(json!({"name": name, "dry": channel.dry, "wet": channel.wet, "noise": channel.noise,
                         "contrast_to_noise": ratio, "weight": channel.weight}));
    }
    let weights = advice.channels.map(|channel| channel.weight);
    outcome.say(format!(
        "light over the dry region: {:.2} to {:.2} of its mean; overexposed {:.2} %",
        advice.evenness[0],
        advice.evenness[1],
        100.0 * advice.overexposed
    ));
    outcome.say("for the recipe:");
    outcome.say(format!("  channel_weights = {weights:?}"));
    outcome.say(format!("  threshold = {}        # the thesis's pipeline", advice.threshold));
    outcome.say(format!("  hsv_min = {:?}", advice.hsv[0]));
    outcome.say(format!("  hsv_max = {:?}", advice.hsv[1]));
    outcome.put("channels", json!(rows));
    outcome.put("channel_weights", json!(weights));
    outcome.put("threshold", json!(advice.threshold));
    outcome.put("hsv_min", json!(advice.hsv[0]));
    outcome.put("hsv_max", json!(advice.hsv[1]));
    outcome.put("evenness", json!(advice.evenness));
    outcome
}
