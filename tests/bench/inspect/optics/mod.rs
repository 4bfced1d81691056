//! The second renderer of a film, based on optics, and the results of the water-break test on its clips.
//!
//! A film is a moving mirror. It reflects a diffuser, the room, the robot and dark gaps by Fresnel's laws with its own
//! normals, over a panel that is darker because of the water ([`light`]). The film drains, waves run over it, and it
//! opens on greasy spots, with a rim that is a wedge with the contact angle ([`water`]). A dry spot of the panel is
//! matt: it reflects diffusely, with a blurred gloss, and shows the weave. The difference in brightness between a break
//! and the film follows from these properties and may have either sign or be zero. The mains frequency modulates the
//! brightness of each channel, a projector may be mirrored in the film ([`scene`]), and sanding changes the panel's
//! appearance ([`sanding`]). The sources of the numbers are in these modules.
//!
//! This renderer shares no code with `src/sim`, and its clips are used to assess the program. For work on the program
//! use seeds from 1000 on; the seeds below 1000 are reserved for the assessment.

mod light;
mod random;
mod sanding;
mod scene;
mod water;

use crate::clips::SANDED_MARGIN_MM;
use crate::goal::Figure;
use crate::tally::{Clip, Figures, Tally, Truth};
use panelprep::geometry::ColorPicture;
use panelprep::inspect::{CellDemands, Demands, FilmView, FilmWatch, Footprint};
use scene::Scene;
use std::time::Instant;
use water::WET_FROM_S;

/// Runs the water-break test on the clips of these seeds.
pub fn run(seeds: std::ops::RangeInclusive<u64>, reduction: usize, observed_s: f64, kind: Option<&str>) {
    println!("renderer seed kind fps sanded verdict IoU | grids: failed passed not seen | reasons");
    let mut tally = Tally::default();
    for seed in seeds {
        if kind.is_none_or(|kind| scene::Spec::new(seed).name == kind) {
            one(seed, reduction, observed_s, &mut tally);
        }
    }
    tally.print("clips by optics");
    tally.report(&Figures {
        passed: Figure("film: second renderer: failed grids that passed"),
        failed: Figure("film: second renderer, clean grids that failed"),
        not_seen: None,
        iou: None,
        time: None,
    });
}

fn one(seed: u64, reduction: usize, observed_s: f64, tally: &mut Tally) {
    let scene = Scene::new(seed, reduction, observed_s);
    let settings = scene.recipe.inspect();
    let limit_mm2 = Footprint::taught_detection_limit_mm2(&scene.taught, settings).expect("in view");
    let demands = Demands {
        observation_s: observed_s,
        frames_per_second: crate::clips::FRAMES_PER_SECOND,
        min_break_mm2: (1.2 * limit_mm2).max(5.0),
        persist_s: settings.persist_s(),
        cell_demands: CellDemands::default(),
    };
    let sanded = scene.sanded_in_taught(SANDED_MARGIN_MM);
    let view = FilmView {
        taught: &scene.taught,
        camera: &scene.camera,
        camera_from_panel: scene.camera_from_panel,
        sanded: Some(&sanded),
    };
    let mut watch = FilmWatch::new(&view, settings, demands).expect("in view");
    let mut last = None;
    for time_s in scene.conditions.times_s(WET_FROM_S + demands.filmed_s()) {
        let picture = scene.picture(time_s);
        save_every(&picture, seed, time_s);
        let begun = Instant::now();
        watch.push(&picture, time_s, Scene::phase(time_s)).expect("in order");
        if time_s >= WET_FROM_S + 1.0 {
            tally.judged_in(begun.elapsed());
        }
        last = Some((picture, time_s));
    }
    let (picture, last_s) = last.expect("pictures");
    let inspection = watch.finish().expect("wet pictures");
    let wet_from_s = last_s - inspection.observation.observed_s;
    // The breaks at the end of the observation: the film is recorded slightly longer, and a break may still grow in
    // this time.
    let broken = scene.broken(last_s.min(wet_from_s + observed_s));
    if let Ok(folder) = std::env::var("PICTURES") {
        crate::clips::save(&folder, &format!("optics{seed:04}"), &picture, &inspection, &broken);
    }
    let contrast = scene.contrast();
    let truth = Truth { broken: &broken, later: &scene.broken(last_s), contrast: &contrast };
    let sanded = scene::grid_ids().into_iter().filter(|id| scene.conditions.passes_of(*id) > 0).count();
    let clip = Clip {
        renderer: "opt",
        seed,
        kind: &format!("{}/{:?}", scene.spec.name, scene.spec.field),
        frames_per_second: scene.spec.frames_per_second,
        sanded,
    };
    tally.add(&clip, &inspection, &truth, |id| scene.conditions.passes_of(id) > 0);
    let opens_s = scene.opens_s();
    tally.times(&inspection, &broken, |index| opens_s[index] - wet_from_s);
}

/// Saves every picture of a clip, if the environment variable `CLIP` names a folder.
fn save_every(picture: &ColorPicture, seed: u64, time_s: f64) {
    if let Ok(folder) = std::env::var("CLIP") {
        let png = panelprep::files::write_color_png(picture).expect("a picture");
        std::fs::write(format!("{folder}/{seed}_{:05.0}.png", 1000.0 * time_s), png).expect("a folder");
    }
}
