//! `panelprep locate`: where the panel stands now, by the 3D camera.

use super::args::{Common, Locate};
use super::fault::Fault;
use super::load::{self, CellFiles, Taught};
use super::outcome::Outcome;
use super::pictures;
use crate::geometry::KukaPose;
use crate::locate::{self, Fit, LocateError, Prepared, gate};
use crate::report::{View, reason_pictures};
use crate::verdict::Judgement;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// A localization with its verdict.
struct Located {
    /// The evidence; `None` where nothing like the panel was found.
    fit: Option<Fit>,
    /// The verdict.
    judgement: Judgement,
    /// From the scan in memory to the verdict, ms.
    elapsed_ms: f64,
}

/// Locates the panel and tells.
///
/// # Errors
/// Where a file is not what it must be, or the panel was not taught.
pub fn run(args: &Locate, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let camera = files.scanner()?.value;
    let base_from_camera = files.base_from_camera()?.value;
    let scan = load::scan(&args.scan, &camera)?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let view = locate::View { scan: &scan, camera: &camera, base_from_camera };
    let begin = Instant::now();
    let prepared = Prepared::new(&taught.panel, &view, recipe.locate());
    let found = prepared.as_ref().map_err(LocateError::clone).and_then(Prepared::locate);
    let (fit, judgement) = match found {
        Ok(fit) => {
            let judgement = gate::judge(&fit, recipe.locate());
            (Some(fit), judgement)
        }
        Err(error) => (None, gate::refusal(&error)),
    };
    let located = Located { fit, judgement, elapsed_ms: begin.elapsed().as_secs_f64() * 1e3 };
    if let (Some(folder), Ok(prepared)) = (&args.pictures, &prepared) {
        located.draw(prepared, (&taught, &view), folder)?;
    }
    let outcome = located.outcome();
    outcome.write(args.out.as_deref())?;
    Ok(outcome)
}

impl Located {
    /// Writes the place found, drawn over the scan, and a picture for each reason that shows in it.
    fn draw(
        &self,
        prepared: &Prepared<'_>,
        (taught, seen): (&Taught, &locate::View<'_>),
        folder: &Path,
    ) -> Result<(), Fault> {
        let (picture, fit) = (seen.scan.picture(), self.fit.as_ref());
        if let Some(fit) = fit {
            let camera_from_panel = seen.base_from_camera.inverse() * fit.base_from_panel;
            let view = View { picture: &picture, camera: seen.camera, camera_from_panel };
            pictures::save(folder, "located", &view.located(&taught.panel).map_err(Fault::stage)?)?;
        }
        if self.judgement.reasons.is_empty() {
            return Ok(());
        }
        let explained = (&prepared.explain(fit), fit);
        for reason in reason_pictures(&taught.panel, (&picture, seen), explained, &self.judgement) {
            let drawn = reason.picture.map_err(Fault::stage)?;
            pictures::save(folder, &format!("reason_{}", reason.code), &drawn)?;
        }
        Ok(())
    }

    fn outcome(&self) -> Outcome {
        let mut outcome = Outcome::of(&self.judgement);
        let fit = self.fit.as_ref();
        let pose = fit.map(|fit| KukaPose::from_rigid(&fit.base_from_panel));
        outcome.put("base_from_panel", json!(pose));
        outcome.put("rms_mm", json!(fit.map(|fit| fit.rms_mm)));
        outcome.put("overlap", json!(fit.map(Fit::overlap)));
        outcome.put("outline_rms_px", json!(fit.map(|fit| fit.outline_rms_px)));
        outcome.put("uncertainty_mm", json!(fit.map(|fit| fit.uncertainty_mm)));
        outcome.put("weakest_mm", json!(fit.map(|fit| fit.weakest_mm)));
        outcome.put("elapsed_ms", json!(self.elapsed_ms));
        if let (Some(fit), Some(pose)) = (fit, pose) {
            outcome.say(format!("base from panel: {pose}"));
            outcome.say(format!(
                "rms {:.3} mm, outline {:.2} px, overlap {:.3}, within {:.2} mm (95 %); weakest {}, {:.2} mm",
                fit.rms_mm,
                fit.outline_rms_px,
                fit.overlap(),
                fit.uncertainty_mm,
                fit.weakest.words(),
                fit.weakest_mm
            ));
            outcome.say(format!(
                "independent starts end {:.3} mm apart; {}; {}",
                fit.agreement_mm,
                fit.rival.map_or_else(
                    || "no other placement comes near".to_owned(),
                    |rival| format!(
                        "the next best is turned by {:.0}°, {:.0} times less speaks for it",
                        rival.turned.0,
                        rival.margin()
                    )
                ),
                fit.camera.map_or_else(
                    || "too little fixture is seen to check the camera".to_owned(),
                    |camera| format!(
                        "by the fixture the camera has moved the panel by {:.2} ± {:.2} mm",
                        camera.moved_mm, camera.uncertainty_mm
                    )
                )
            ));
            outcome.say(format!(
                "shift {:.1} mm, turn {:.2}°, tilt {:.2}° at the panel's centre; {:.0} ms",
                fit.shift_mm, fit.turn.0, fit.tilt.0, self.elapsed_ms
            ));
        }
        outcome
    }
}
