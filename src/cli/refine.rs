//! `panelprep refine`: what the corner pictures say about the place found.

use super::args::{Common, Refine};
use super::fault::Fault;
use super::load::{self, CellFiles, CornerShot, Taught};
use super::outcome::Outcome;
use super::pictures;
use crate::calib::{budget, health};
use crate::geometry::{Base, ColorPicture, Flange, FlangeCamera, KukaPose, Panel, PinholeCamera, Pixel, Rigid};
use crate::locate::corner;
use crate::locate::refine::{self, CornerView, Refined};
use crate::panel::TaughtCorner;
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
    claims_mm: Option<[f64; 2]>,
    sightings: Vec<Sighting>,
    camera: PinholeCamera,
    pictures: Vec<ColorPicture>,
}

/// A taught corner as a picture shows it.
struct Sighting {
    index: usize,
    corner: TaughtCorner,
    base_from_camera: Rigid<Base, FlangeCamera>,
    found_px: Pixel,
}

impl Sighting {
    fn view(&self) -> CornerView<'_> {
        let Sighting { index, corner, base_from_camera, found_px } = self;
        CornerView { corner: *index, taught: corner, base_from_camera: *base_from_camera, found_px: *found_px }
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
    let lens = files.flange_camera()?;
    let (camera, extent) = (lens.value, lens.extent);
    let flange_from_camera = files.flange_from_camera()?.value;
    let shots = load::corner_shots(&files, &args.corner, &args.flange, &camera)?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let located = (located, claims_mm(args, &files)?);
    let mut place = stage(&taught, located, shots, &camera, flange_from_camera, &recipe)?;
    let outside = health::outside_of_lens(&extent, place.sightings.iter().map(|sighting| sighting.found_px));
    place.judgement = place.judgement.and(Judgement::of(outside.into_iter().collect(), vec![]));
    if let Some(folder) = &args.pictures {
        for (index, (before, after)) in place.drawn()?.iter().enumerate() {
            pictures::save(folder, &format!("corner{}_before", index + 1), before)?;
            pictures::save(folder, &format!("corner{}_after", index + 1), after)?;
        }
    }
    let outcome = place.outcome();
    outcome.write(args.out.as_deref())?;
    Ok(outcome)
}

/// What the localization and both cameras' mounts claim, 95 %, mm; `None` where one of them states nothing.
fn claims_mm(args: &Refine, files: &CellFiles) -> Result<Option<[f64; 2]>, Fault> {
    let scanner = files.cell.calibration().base_from_camera.is_some().then(|| files.base_from_camera());
    let scanner_mm = scanner.transpose()?.and_then(|mount| mount.uncertainty_mm);
    let mounts_mm = [scanner_mm, files.flange_from_camera()?.uncertainty_mm];
    let hand_eye_mm = budget::parts(mounts_mm, None, None).hand_eye_mm;
    Ok(load::located_mm(&args.located)?.zip(hand_eye_mm).map(<[f64; 2]>::from))
}

/// Corrects a place by corner pictures; beside the place what it and the calibrations claim, 95 %, mm, where they do.
///
/// # Errors
/// Where there are more pictures than taught corners, or a picture shows no corner.
pub fn stage(
    taught: &Taught,
    (located, claims_mm): (Rigid<Base, Panel>, Option<[f64; 2]>),
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
        let expected = base_from_camera.inverse() * (located * corner.point);
        let found = corner::find_taught(&shot.picture.to_gray(), (recipe.corner(), index), camera, expected);
        let found_px = found.map_err(|error| Fault::file(&shot.file, error))?.corner_px;
        sightings.push(Sighting { index, corner: *corner, base_from_camera, found_px });
    }
    let views: Vec<CornerView<'_>> = sightings.iter().map(Sighting::view).collect();
    let refined = refine::refine(located, camera, &views).map_err(Fault::stage)?;
    let found = claims_mm.and_then(|claims_mm| refine::disagreement(&refined, &claims_mm));
    let judgement =
        refine::judge(&refined, recipe.corner()).and(Judgement::of(vec![], found.into_iter().collect()));
    let pictures = shots.into_iter().map(|shot| shot.picture).collect();
    Ok(RefinedPlace { refined, judgement, located, claims_mm, sightings, camera: *camera, pictures })
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
        if self.claims_mm.is_none() {
            outcome.say(
                "not held against what the 3D scan claims: that needs what `locate --json` printed, and uncertainty_mm of both \
                 cameras' mounts",
            );
        }
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
