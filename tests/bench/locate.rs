//! Localization against the renderer's truth. In progress.
use panelprep::locate::{self, View, gate};
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{TRIAL_BOX_MM, Trial, Wrong};
use std::time::Instant;

fn recipe(trial: &Trial) -> Recipe {
    let corners = trial.region_px().map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = TRIAL_BOX_MM;
    let text = format!(
        "panel = \"trial\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\nmax_shift_mm = 900.0\n\
         turn_limit_deg = 180.0\nmax_tilt_deg = 35.0\n\
         [region]\ncorners_px = {corners:?}\nrows = 1\ncolumns = 1\n"
    );
    Recipe::check("bench.toml", &text).expect("a valid recipe")
}

fn main() {
    let args: Vec<u64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let (from, to, reduction) = (args[0], args[1], args[2] as usize);
    let bad = args.get(3).copied();
    for seed in from..=to {
        let kinds: Vec<Option<Wrong>> = match bad {
            None => vec![None],
            Some(99) => Wrong::ALL.iter().copied().map(Some).collect(),
            Some(k) => vec![Some(Wrong::ALL[k as usize])],
        };
        for kind in kinds {
            let trial = kind.map_or_else(|| Trial::good(seed, reduction), |kind| Trial::bad(seed, kind, reduction));
            let recipe = recipe(&trial);
            let taught =
                match TaughtPanel::learn(&trial.taught_scan(), *trial.camera(), trial.base_from_camera(), &recipe) {
                    Ok(t) => t,
                    Err(e) => {
                        println!("{seed} {kind:?}: teach: {e}");
                        continue;
                    }
                };
            let scan = trial.scan();
            let view = View { scan: &scan, camera: trial.camera(), base_from_camera: trial.base_from_camera() };
            let begun = Instant::now();
            let found = locate::locate(&taught, &view, recipe.locate());
            let ms = begun.elapsed().as_secs_f64() * 1e3;
            let word = kind.map_or("good", |k| k.words());
            let [l, w] = trial.size_mm();
            match found {
                Ok(fit) => {
                    let judgement = gate::judge(&fit, recipe.locate());
                    let error = trial.error_mm(&fit.base_from_panel);
                    {
                        let c = nalgebra::Point3::new(560.0, 0.0, 360.0);
                        let d = trial.base_from_panel().isometry().inverse() * fit.base_from_panel.isometry();
                        let s = (d * c) - c;
                        let r = d.rotation.scaled_axis() * 150.0;
                        println!("    shift n {:.3} y {:.3} z {:.3}  turn(at 150mm) n {:.3} y {:.3} z {:.3}", s.x, s.y, s.z, r.x, r.y, r.z);
                    }
                    println!(
                        "{seed:3} {word:12} {l:.0}x{w:.0} hid {:.2} {:6} mean {:.3} max {:.3} of {:.3} ({:.3} {:?}) rms {:.3} out {:.3}px found {:.2} {:.2} {:.2} thr {:.3} abs {:.3} meas {:.2} w {:.2}/{:.2} steps {} {:.4} agr {:.3} cam {:?} riv {:?} {ms:.0} ms {:?}",
                        trial.hidden(), judgement.verdict.word(), error.mean_mm, error.max_mm, fit.uncertainty_mm, fit.weakest_mm, fit.weakest, fit.rms_mm, fit.outline_rms_px,
                        fit.taught_found, fit.scan_found, fit.outline_found, fit.seen_through, fit.outline_absent, fit.measured,
                        fit.edge_width_px.unwrap_or(0.0), fit.taught_edge_width_px, fit.iterations, fit.last_step_mm, fit.agreement_mm,
                        fit.camera.map(|c| ((c.moved_mm * 1e3).round() / 1e3, (c.uncertainty_mm * 1e3).round() / 1e3, (c.same * 1e2).round() / 1e2)),
                        fit.rival.map(|r| (r.turned.0.round(), r.for_first_mm.round(), r.for_rival_mm.round())),
                        judgement.reasons.iter().map(|r| r.code.to_string()).collect::<Vec<_>>(),
                    );
                }
                Err(error) => println!("{seed:3} {word:12} {l:.0}x{w:.0} hid {:.2} none {error} {ms:.0} ms", trial.hidden()),
            }
        }
    }
}
