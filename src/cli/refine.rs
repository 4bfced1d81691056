//! `panelprep refine`: what the corner pictures say about the place found.

use super::args::{Common, Refine};
use super::fault::Fault;
use super::load::{self, CellFiles, CornerShot, Taught};
use super::outcome::Outcome;
use super::pictures;
use crate::geometry::{Base, ColorPicture, Flange, FlangeCamera, KukaPose, Panel, PinholeCamera, Pixel, Rigid};
use crate::locate::corner;
use crate::locate::refine::{self, CornerView, Refined};
use crate::panel::{TaughtCorner, TaughtPanel};
use crate::recipe::Recipe;
use crate::report;
use crate::verdict::Judgement;
use serde_json::json;

/// A correction with its verdict.
pub struct RefinedPlace {
    /// The correction.
    pub refined: Refined,
    /// The verdict.
    pub judgement: Judgement,
    located: Rigid<Base, Panel>,
    sightings: Vec<Sighting>,
    camera: PinholeCamera,
    pictures: Vec<ColorPicture>,
}

/// A taught corner as a picture shows it.
struct Sighting {
    corner: TaughtCorner,
    base_from_camera: Rigid<Base, FlangeCamera>,
    found_px: Pixel,
}

impl Sighting {
    fn view(&self) -> CornerView<'_> {
        CornerView { taught: &self.corner, base_from_camera: self.base_from_camera, found_px: self.found_px }
    }
}

/// Corrects the place found and tells.
///
/// # Errors
/// Where a file is not what it must be, no corner was taught, or a picture shows none.
pub fn run(args: &Refine, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let located = load::located(Some(&args.located))?;
    let camera = files.flange_camera()?.value;
    let flange_from_camera = files.flange_from_camera()?.value;
    let shots = load::corner_shots(&args.corner, &args.flange, &camera)?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let place = stage(&taught, located, shots, &camera, flange_from_camera, &recipe)?;
    if let Some(folder) = &args.pictures {
        for (index, (before, after)) in place.drawn()?.iter().enumerate() {
            pictures::save(folder, &format!("corner{}_before", index + 1), before)?;
            pictures::save(folder, &format!("corner{}_after", index + 1), after)?;
        }
    }
    Ok(place.outcome())
}

/// The pixel of a taught corner, counted from 0, in a picture taken from where the camera should see it.
///
/// # Errors
/// Where the picture shows no such corner.
pub fn find_corner(
    picture: &ColorPicture,
    (recipe, index): (&Recipe, usize),
    camera: &PinholeCamera,
    panel: &TaughtPanel,
    panel_from_camera: Rigid<Panel, FlangeCamera>,
) -> Result<Pixel, Fault> {
    let depth_mm = (panel_from_camera.inverse() * panel.centre()).mm.z;
    let which = recipe.corner().which().of(index);
    let found = corner::find(&picture.to_gray(), recipe.corner(), which, camera.px_per_mm_at(depth_mm).0);
    Ok(found.map_err(Fault::stage)?.corner_px)
}

/// Corrects a place by corner pictures.
///
/// # Errors
/// Where there are more pictures than taught corners, or a picture shows no corner.
pub fn stage(
    taught: &Taught,
    located: Rigid<Base, Panel>,
    shots: Vec<CornerShot>,
    camera: &PinholeCamera,
    flange_from_camera: Rigid<Flange, FlangeCamera>,
    recipe: &Recipe,
) -> Result<RefinedPlace, Fault> {
    if shots.len() > taught.corners.len() {
        return Err(Fault::CornersNotTaught { found: shots.len(), taught: taught.corners.len() });
    }
    let mut sightings = Vec::with_capacity(shots.len());
    for (index, (shot, corner)) in shots.iter().zip(&taught.corners).enumerate() {
        let base_from_flange: Rigid<Base, Flange> = shot.base_from_flange.to_rigid();
        let base_from_camera = base_from_flange * flange_from_camera;
        let panel_from_camera = located.inverse() * base_from_camera;
        let found_px = find_corner(&shot.picture, (recipe, index), camera, &taught.panel, panel_from_camera)
            .map_err(|fault| Fault::file(&shot.file, fault))?;
        sightings.push(Sighting { corner: *corner, base_from_camera, found_px });
    }
    let views: Vec<CornerView<'_>> = sightings.iter().map(Sighting::view).collect();
    let refined = refine::refine(located, camera, &views).map_err(Fault::stage)?;
    let judgement = refine::judge(&refined, recipe.corner());
    let pictures = shots.into_iter().map(|shot| shot.picture).collect();
    Ok(RefinedPlace { refined, judgement, located, sightings, camera: *camera, pictures })
}

impl RefinedPlace {
    /// Each corner before and after the correction.
    ///
    /// # Errors
    /// Where OpenCV refuses to draw.
    pub fn drawn(&self) -> Result<Vec<(ColorPicture, ColorPicture)>, Fault> {
        let one = |(sighting, picture): (&Sighting, &ColorPicture)| {
            let draw = |base_from_panel: Rigid<Base, Panel>, title: &str| {
                let in_camera = sighting.base_from_camera.inverse() * (base_from_panel * sighting.corner.point);
                let view = report::CornerView {
                    picture,
                    expected_px: self.camera.project(in_camera).unwrap_or_default(),
                    found_px: sighting.found_px,
                    px_per_mm: self.camera.px_per_mm_at(in_camera.mm.z).0,
                };
                view.drawn(title).map_err(Fault::stage)
            };
            Ok((draw(self.located, "by 3D alone")?, draw(self.refined.base_from_panel, "corrected")?))
        };
        self.sightings.iter().zip(&self.pictures).map(one).collect()
    }

    fn outcome(&self) -> Outcome {
        let mut outcome = Outcome::of(&self.judgement);
        let pose = KukaPose::from_rigid(&self.refined.base_from_panel);
        let [x_mm, y_mm] = self.refined.shift_mm;
        outcome.say(format!("base from panel: {pose}"));
        outcome.say(format!(
            "the corner was {:.2} px from where it was expected: corrected by {x_mm:.3} mm in camera x, {y_mm:.3} mm in y",
            self.refined.error_px
        ));
        if self.refined.corners.len() > 1 {
            let left_mm = self.refined.corners.iter().map(|corner| corner.left_mm).fold(0.0, f64::max);
            outcome.say(format!(
                "turned by {:.3}°; the corners are left {left_mm:.3} mm off, at most",
                self.refined.turned.0
            ));
        }
        outcome.put("base_from_panel", json!(pose));
        outcome.put("shift_mm", json!(self.refined.shift_mm));
        outcome.put("error_px", json!(self.refined.error_px));
        outcome
    }
}
