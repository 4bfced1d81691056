//! The second renderer of a film, by optics, and what the test says of its clips.
//!
//! A film is a mirror that moves: it reflects a diffuser, the room, the robot and dark gaps by Fresnel's laws on normals of its
//! own, over a panel that is darker for the water on it ([`light`]); it drains, waves run on it, and it opens on greasy places
//! up to a wedge of the contact angle ([`water`]). A dry place is dull: diffuse, with a blurred gloss and a weave. Whether a
//! break is darker or brighter than the film, or looks the same, follows from that. Mains tint the pictures by channel, slow
//! cameras take two to four a second, a projector may be seen in the film ([`scene`]). Numbers have their sources there.
//!
//! It shares no line with `src/sim`, and it judges: for work on the program take seeds from 1000 on, never those of the judgement,
//! 1 to 60.

mod light;
mod random;
mod scene;
mod water;

use panelprep::geometry::{ColorPicture, Mask};
use panelprep::inspect::{ByCell, Demands, Footprint, Inspection, Watch, score_within};
use panelprep::verdict::Verdict;
use scene::Scene;
use std::time::{Duration, Instant};
use water::WET_FROM_S;

/// Less contrast than this is no test.
const MIN_CONTRAST_LEVELS: f64 = 6.0;

#[derive(Debug, Default)]
struct Tally {
    clips: usize,
    invalid: usize,
    false_pass: usize,
    broken_grids: usize,
    false_fail: usize,
    clean_grids: usize,
    faint_passed: usize,
    faint_clips: usize,
    iou: Vec<f64>,
    codes: std::collections::BTreeMap<String, usize>,
    judging: Vec<Duration>,
}

/// Runs the clips of these seeds.
pub fn run(seeds: std::ops::RangeInclusive<u64>, reduction: usize, observed_s: f64, kind: Option<&str>) {
    println!("optics seed kind   fields fps spots faint% verdict  IoU    TF FF FP TP  reasons");
    let mut tally = Tally::default();
    for seed in seeds {
        one(seed, reduction, observed_s, kind, &mut tally);
    }
    tally.print();
}

fn one(seed: u64, reduction: usize, observed_s: f64, kind: Option<&str>, tally: &mut Tally) {
    if kind.is_some_and(|kind| scene::Spec::new(seed).name != kind) {
        return;
    }
    let scene = Scene::new(seed, reduction, observed_s);
    let settings = scene.recipe.inspect();
    let limit_mm2 = Footprint::taught_detection_limit_mm2(&scene.taught, settings).expect("in view");
    let demands = Demands {
        observation_s: observed_s,
        frames_per_second: scene.spec.frames_per_second,
        min_break_mm2: (1.2 * limit_mm2).max(5.0),
        persist_s: settings.persist_s(),
        by_cell: ByCell::default(),
    };
    let mut watch =
        Watch::new(&scene.taught, &scene.camera, scene.camera_from_panel, settings, demands).expect("in view");
    let mut last = None;
    for time_s in scene.times_s(demands.filmed_s()) {
        let picture = scene.picture(time_s);
        save_every(&picture, seed, time_s);
        let begun = Instant::now();
        watch.push(&picture, time_s, Scene::phase(time_s)).expect("in order");
        if time_s >= WET_FROM_S + 1.0 {
            tally.judging.push(begun.elapsed());
        }
        last = Some(picture);
    }
    let inspection = watch.finish().expect("wet pictures");
    // What broke by one time: the film is watched for a little longer, and a break may still grow then.
    let (found, truth) = (inspection.mask_at(observed_s), scene.broken(WET_FROM_S + observed_s));
    if let Some(picture) = last {
        save(&picture, seed, &found, &truth, &inspection.footprint.region());
    }
    let later = scene.broken(WET_FROM_S + demands.filmed_s());
    tally.take(seed, &scene, &inspection, [&found, &truth, &later]);
}

impl Tally {
    fn take(&mut self, seed: u64, scene: &Scene, inspection: &Inspection, [found, truth, later]: [&Mask; 3]) {
        let region = inspection.footprint.region();
        let contrast = scene.contrast();
        let faint = |index: usize| contrast[index] < MIN_CONTRAST_LEVELS;
        let all = region.count().max(1) as f64;
        let faint_share = (0..contrast.len()).filter(|&i| region.inside[i] && faint(i)).count() as f64 / all;
        let clear = Mask { inside: (0..contrast.len()).map(|i| region.inside[i] && !faint(i)).collect(), ..region };
        let valid = inspection.judgement.verdict != Verdict::Invalid;
        let iou = score_within(found, truth, &clear).expect("one size").iou;
        let real_mm2 = inspection.footprint.broken_mm2(truth);
        let later_mm2 = inspection.footprint.broken_mm2(later);
        let min_mm2 = inspection.observation.min_break_mm2;
        let [mut tf, mut ff, mut fp, mut tp] = [0; 4];
        // A grid is clean whose film holds until the film ends: what breaks after the window is no mistake, found or not.
        let areas_mm2 = real_mm2.iter().zip(&later_mm2);
        for (grid, (real_mm2, later_mm2)) in inspection.grids.iter().zip(areas_mm2).filter(|_| valid) {
            let tell = || {
                let (id, found_mm2) = (grid.id, grid.broken_mm2);
                println!(
                    "      {id}: {found_mm2:.1} mm² found, {real_mm2:.1} mm² broken; a grid fails from {min_mm2:.1} mm²"
                );
                1
            };
            match (*real_mm2 >= min_mm2, *later_mm2 >= min_mm2, grid.failed) {
                (true, _, true) => tf += 1,
                (false, false, true) => ff += tell(),
                (true, _, false) => fp += tell(),
                (false, false, false) => tp += 1,
                (false, true, _) => {}
            }
        }
        let has_break = truth.inside.iter().zip(&clear.inside).any(|(open, clear)| *open && *clear);
        let codes: Vec<&str> = inspection.judgement.reasons.iter().map(|reason| &*reason.code).collect();
        println!(
            "{seed:11} {:6} {:6} {:3.0} {:5} {:6.1} {:8} {:.3} {tf:4}{ff:3}{fp:3}{tp:4}  {}{}",
            scene.spec.name,
            format!("{:?}", scene.spec.field),
            scene.spec.frames_per_second,
            scene.spec.spots,
            100.0 * faint_share,
            inspection.judgement.verdict.word(),
            if valid && has_break { iou } else { f64::NAN },
            codes.join(" "),
            if ff + fp > 0 { "  <-" } else { "" },
        );
        if std::env::var("REASONS").is_ok() {
            inspection
                .judgement
                .reasons
                .iter()
                .for_each(|reason| println!("      {}: {}", reason.code, reason.message));
        }
        self.clips += 1;
        self.invalid += usize::from(!valid);
        self.false_pass += fp;
        self.false_fail += ff;
        self.broken_grids += tf + fp;
        self.clean_grids += ff + tp;
        if valid && has_break {
            self.iou.push(iou);
        }
        // A grid that passes although a break of its size could hide where there is too little contrast.
        let faint_mask =
            Mask { inside: (0..contrast.len()).map(|i| region.inside[i] && faint(i)).collect(), ..region };
        let faint_mm2 = inspection.footprint.broken_mm2(&faint_mask);
        if faint_mm2.iter().any(|mm2| *mm2 >= 4.0 * min_mm2) {
            self.faint_clips += 1;
            self.faint_passed += usize::from(inspection.judgement.verdict == Verdict::Pass);
        }
        if !valid {
            codes.first().into_iter().for_each(|code| *self.codes.entry((*code).to_owned()).or_default() += 1);
        }
    }

    fn print(&mut self) {
        let mean = self.iou.iter().sum::<f64>() / self.iou.len().max(1) as f64;
        let least = self.iou.iter().copied().fold(f64::INFINITY, f64::min);
        self.judging.sort();
        let at = |share: f64| {
            let index = (self.judging.len().max(1) - 1) as f64 * share;
            self.judging.get(index as usize).map_or(f64::NAN, |time| time.as_secs_f64() * 1e3)
        };
        println!("\noptics: {} clips, {} of them invalid {:?}", self.clips, self.invalid, self.codes);
        println!(
            "failed grids called passed: {} of {} (needed 0)\nclean grids failed: {} of {}, {:.2} % (needed 0.5 %)",
            self.false_pass,
            self.broken_grids,
            self.false_fail,
            self.clean_grids,
            100.0 * self.false_fail as f64 / self.clean_grids.max(1) as f64
        );
        println!(
            "intersection over union, ±1 px, from {MIN_CONTRAST_LEVELS} grey levels on, {} clips: mean {mean:.4}, least {least:.4} \
             (needed 0.95)",
            self.iou.len()
        );
        println!(
            "clips with places below {MIN_CONTRAST_LEVELS} levels: {}, of them passed: {} (needed 0)",
            self.faint_clips, self.faint_passed
        );
        println!("a picture: median {:.2} ms, 95 % {:.2} ms", at(0.5), at(0.95));
    }
}

/// Every picture of a clip, where `CLIP` names a folder for them.
fn save_every(picture: &ColorPicture, seed: u64, time_s: f64) {
    if let Ok(folder) = std::env::var("CLIP") {
        let png = panelprep::files::write_color_png(picture).expect("a picture");
        std::fs::write(format!("{folder}/{seed}_{:05.0}.png", 1000.0 * time_s), png).expect("a folder");
    }
}

/// The last picture with what was found and what is true: green both, orange found alone, blue true alone.
fn save(picture: &ColorPicture, seed: u64, found: &Mask, truth: &Mask, region: &Mask) {
    let Ok(folder) = std::env::var("PICTURES") else { return };
    let mut drawn = picture.clone();
    for index in (0..drawn.rgb.len()).filter(|&index| region.inside[index]) {
        match (found.inside[index], truth.inside[index]) {
            (true, true) => drawn.rgb[index] = [0, 158, 115],
            (true, false) => drawn.rgb[index] = [230, 159, 0],
            (false, true) => drawn.rgb[index] = [86, 180, 233],
            _ => {}
        }
    }
    let png = panelprep::files::write_color_png(&drawn).expect("a picture");
    std::fs::write(format!("{folder}/optics{seed:04}.png"), png).expect("a folder");
}
