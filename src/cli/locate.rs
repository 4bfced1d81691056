//! `panelprep locate`: where the panel stands now, by the 3D camera.

use super::args::{Common, Locate};
use super::fault::Fault;
use super::load::{self, CellFiles, Taught};
use super::outcome::Outcome;
use super::pictures;
use crate::geometry::{Base, Camera, ColorPicture, KukaPose, OrganizedCloud, Panel, PinholeCamera, Rigid};
use crate::locate::{self, Fit, explain, gate};
use crate::panel::panel_from_base_at_teaching;
use crate::recipe::Recipe;
use crate::report::View;
use crate::verdict::Judgement;
use serde_json::json;
use std::time::Instant;

/// A localization with its verdict.
pub struct Located {
    /// The evidence; `None` where nothing like the panel was found.
    pub fit: Option<Fit>,
    /// The verdict.
    pub judgement: Judgement,
    /// From the scan in memory to the verdict, ms.
    pub elapsed_ms: f64,
    /// The scan's colours.
    pub picture: ColorPicture,
    /// The camera.
    pub camera: PinholeCamera,
    /// Where it stands.
    pub base_from_camera: Rigid<Base, Camera>,
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
    let located = stage(&taught, &scan, camera, base_from_camera, &recipe)?;
    if let Some(folder) = &args.pictures {
        if let Some(picture) = located.drawn(&taught.panel)? {
            pictures::save(folder, "located", &picture)?;
        }
        located.draw_reasons(&taught, &scan, &recipe, folder)?;
    }
    Ok(located.outcome())
}

/// Locates the panel in a scan.
///
/// # Errors
/// Where the localization cannot begin for a reason that is not the panel's.
pub fn stage(
    taught: &Taught,
    scan: &OrganizedCloud<Camera>,
    camera: PinholeCamera,
    base_from_camera: Rigid<Base, Camera>,
    recipe: &Recipe,
) -> Result<Located, Fault> {
    let begin = Instant::now();
    let view = locate::View { scan, camera: &camera, base_from_camera };
    let found = locate::locate(&taught.panel, &view, recipe.locate());
    let (fit, judgement) = match found {
        Ok(fit) => {
            let judgement = gate::judge(&fit, recipe.locate());
            (Some(fit), judgement)
        }
        Err(error) => (None, gate::refusal(&error)),
    };
    let elapsed_ms = begin.elapsed().as_secs_f64() * 1e3;
    Ok(Located { fit, judgement, elapsed_ms, picture: scan.picture(), camera, base_from_camera })
}

impl Located {
    /// The place found, drawn over the scan; `None` where none was found.
    ///
    /// # Errors
    /// Where OpenCV refuses to draw.
    pub fn drawn(&self, panel: &crate::panel::TaughtPanel) -> Result<Option<ColorPicture>, Fault> {
        let Some(fit) = &self.fit else { return Ok(None) };
        self.drawn_at(panel, fit.base_from_panel).map(Some)
    }

    /// A place drawn over the scan.
    ///
    /// # Errors
    /// Where OpenCV refuses to draw.
    pub fn drawn_at(
        &self,
        panel: &crate::panel::TaughtPanel,
        base_from_panel: Rigid<Base, Panel>,
    ) -> Result<ColorPicture, Fault> {
        let camera_from_panel = self.base_from_camera.inverse() * base_from_panel;
        View { picture: &self.picture, camera: &self.camera, camera_from_panel }
            .located(panel)
            .map_err(Fault::stage)
    }

    /// Writes a picture for each reason that shows in the scan.
    fn draw_reasons(
        &self,
        taught: &Taught,
        scan: &OrganizedCloud<Camera>,
        recipe: &Recipe,
        folder: &std::path::Path,
    ) -> Result<(), Fault> {
        if self.judgement.reasons.is_empty() {
            return Ok(());
        }
        let (fit, base_from_camera) = (self.fit.as_ref(), self.base_from_camera);
        let seen = locate::View { scan, camera: &self.camera, base_from_camera };
        let explained = explain::explain(&taught.panel, &seen, recipe.locate(), fit).map_err(Fault::stage)?;
        let place = fit.map_or_else(|| panel_from_base_at_teaching().inverse(), |fit| fit.base_from_panel);
        let camera_from_panel = base_from_camera.inverse() * place;
        let view = View { picture: &self.picture, camera: &self.camera, camera_from_panel };
        for reason in &self.judgement.reasons {
            let drawn = view.reason(&taught.panel, (&explained, fit), reason).map_err(Fault::stage)?;
            if let Some((picture, _)) = drawn {
                pictures::save(folder, &format!("reason_{}", reason.code), &picture)?;
            }
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
