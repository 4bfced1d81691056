//! The simulated cell's scan, corner pictures and clip as files, and the results of the stages for these files and for
//! damaged copies.

use super::{Damage, damaged, random_index};
use panelprep::cell::LensExtent;
use panelprep::files;
use panelprep::geometry::{Base, ColorPicture, Flange, Panel, Point, Rigid};
use panelprep::inspect::{CellDemands, Demands, Footprint};
use panelprep::locate::{ScanView, TaughtModel};
use panelprep::panel::{TaughtCorner, TaughtPanel};
use panelprep::recipe::Recipe;
use panelprep::sim::{self, Cell, FilmSpec, Grease, PanelPosition, Scene, WET_FROM_S};
use panelprep::stages::corners::CornerReference;
use panelprep::stages::film::{FilmRun, FilmSetup};
use panelprep::stages::learn;
use panelprep::stages::locate::locate;
use panelprep::verdict::Verdict;
use rand_pcg::Pcg64;
use std::sync::Arc;

const FRAMES_PER_SECOND: f64 = 5.0;
const OBSERVED_S: f64 = 4.0;

/// The result for damaged files.
#[derive(Debug)]
pub enum Found {
    /// A file was refused.
    Refused,
    /// The damage was reported: the verdict is not accept, or the test failed for another reason.
    Reported,
    /// A pose was accepted that differs from the undamaged files' pose by this distance, mm.
    Pose { moved_mm: f64 },
    /// The film with breaks fails, as without damage.
    StillFails,
    /// The film with breaks passes.
    Passed,
}

/// A corner picture, and the pose of the flange at which it was captured.
struct CornerFile {
    png: Vec<u8>,
    picture: ColorPicture,
    base_from_flange: Rigid<Base, Flange>,
}

/// A picture of the clip.
struct Frame {
    png: Vec<u8>,
    picture: Arc<ColorPicture>,
}

/// The files, the taught panel, and the results with undamaged files.
pub struct UndamagedFiles {
    cell: Cell,
    recipe: Recipe,
    panel: TaughtPanel,
    corners: Vec<TaughtCorner>,
    scan: Vec<u8>,
    pictures: Vec<CornerFile>,
    clip: Vec<Frame>,
    list: String,
    demands: Demands,
    located: Rigid<Base, Panel>,
    refined: Rigid<Base, Panel>,
}

impl UndamagedFiles {
    /// Renders and teaches a cell. Asserts that the undamaged files are accepted, and that the film has breaks.
    pub fn new(seed: u64, reduction: usize) -> Self {
        let cell = Cell::new(seed, Scene::Good, reduction);
        let recipe = recipe(&cell);
        let mount = cell.calibrated_base_from_camera();
        let panel = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), mount, &recipe).expect("a panel");
        let mut corners = Vec::new();
        let mut pictures = Vec::new();
        for (number, view) in cell.corner_views().into_iter().enumerate() {
            let taught = cell.flange_picture(&view.base_from_flange, PanelPosition::Nominal);
            let lens = (cell.flange_camera(), cell.calibrated_flange_from_camera());
            let settings = (recipe.corner(), number);
            corners.push(
                learn::teach_corner(&panel, settings, (&taught, view.base_from_flange), lens).expect("a corner"),
            );
            let base_from_flange = cell.displaced_corner_pose(&view);
            let picture = cell.flange_picture(&base_from_flange, PanelPosition::Displaced);
            let png = files::write_color_png(&picture).expect("a picture");
            pictures.push(CornerFile { png, picture, base_from_flange });
        }
        let limit_mm2 = Footprint::taught_detection_limit_mm2(&panel, recipe.inspect()).expect("in view");
        let demands = Demands {
            observation_s: OBSERVED_S,
            frames_per_second: FRAMES_PER_SECOND,
            min_break_mm2: (1.2 * limit_mm2).max(5.0),
            persist_s: recipe.inspect().persist_s(),
            cell_demands: CellDemands::default(),
        };
        let (clip, list) = clip(&cell, &demands);
        let scan = files::write_pcd(&cell.scan());
        let nowhere = cell.truth().base_from_panel;
        let mut held = UndamagedFiles {
            cell,
            recipe,
            panel,
            corners,
            scan,
            pictures,
            clip,
            list,
            demands,
            located: nowhere,
            refined: nowhere,
        };
        held.located = held.locate(&held.scan).expect("it reads").expect("accepted");
        let whole: Vec<&ColorPicture> = held.pictures.iter().map(|file| &file.picture).collect();
        held.refined = held.refine(&whole).expect("accepted");
        let whole: Vec<_> = held.clip.iter().map(|frame| frame.picture.clone()).collect();
        assert_eq!(held.inspect(&whole, &held.list), Some(Verdict::Fail), "the film is broken");
        held
    }

    /// Returns the largest distance of a point of the panel between two poses, mm.
    fn moved_mm(&self, one: &Rigid<Base, Panel>, other: &Rigid<Base, Panel>) -> f64 {
        let points = self.panel.points().step_by(101).map(|(_, point)| point);
        let corners = self.corners.iter().map(|corner| corner.point);
        points
            .chain(corners)
            .map(|point: Point<Panel>| (*one * point).distance_mm(*other * point))
            .fold(0.0, f64::max)
    }

    /// Locates the panel. Returns `None` if the file is refused, otherwise the pose if it is accepted.
    fn locate(&self, scan: &[u8]) -> Option<Option<Rigid<Base, Panel>>> {
        let camera = self.cell.scanner();
        let scan = files::read_cloud(scan, camera).ok()?;
        let view = ScanView {
            scan: &scan,
            camera,
            base_from_camera: self.cell.calibrated_base_from_camera(),
            range: panelprep::locate::RangeErrors::default(),
        };
        let model = TaughtModel::from_panel(&self.panel, view.range);
        let located = locate((&self.panel, &model), view, &self.recipe);
        let accepted = located.judgement.verdict == Verdict::Accept;
        Some(located.fit.filter(|_| accepted).map(|fit| fit.base_from_panel))
    }

    /// Locates the panel with the scan's file damaged.
    pub fn located(&self, damage: &Damage, draw: &mut Pcg64) -> Found {
        match self.locate(&damaged(&self.scan, damage, draw)) {
            None => Found::Refused,
            Some(None) => Found::Reported,
            Some(Some(pose)) => Found::Pose { moved_mm: self.moved_mm(&pose, &self.located) },
        }
    }

    /// Returns the panel's pose from the corners; `None` if it is not accepted.
    fn refine(&self, pictures: &[&ColorPicture]) -> Option<Rigid<Base, Panel>> {
        let camera = self.cell.flange_camera();
        let held = CornerReference {
            corners: &self.corners,
            camera,
            lens: &LensExtent::default(),
            limits: self.recipe.corner(),
        };
        let views = self.corners.iter().enumerate().zip(&self.pictures).zip(pictures);
        let sightings = views.map(|((corner, file), picture)| {
            let base_from_camera = file.base_from_flange * self.cell.calibrated_flange_from_camera();
            held.find(corner, picture, (self.located, base_from_camera)).ok()
        });
        let sightings: Vec<_> = sightings.collect::<Option<_>>()?;
        let correction = held.refine(self.located, &sightings, (None, None)).ok()?;
        (correction.judgement.verdict == Verdict::Accept).then_some(correction.refined.base_from_panel)
    }

    /// Refines the pose with one of the corner pictures' files damaged.
    pub fn refined(&self, damage: &Damage, draw: &mut Pcg64) -> Found {
        let which = random_index(self.pictures.len(), draw);
        let bytes = damaged(&self.pictures[which].png, damage, draw);
        match files::read_measured(&bytes, self.cell.flange_camera()) {
            Ok(spoilt) => self.refined_with(which, &spoilt),
            Err(_) => Found::Refused,
        }
    }

    /// Refines the pose with the pixels of one corner picture damaged before the picture was written to a file.
    pub fn refined_by_pixels(&self, damage: &Damage, draw: &mut Pcg64) -> Found {
        let which = random_index(self.pictures.len(), draw);
        self.refined_with(which, &damage_pixels(&self.pictures[which].picture, damage, draw))
    }

    fn refined_with(&self, which: usize, spoilt: &ColorPicture) -> Found {
        let pictures = self.pictures.iter().enumerate();
        let pictures: Vec<_> =
            pictures.map(|(index, file)| if index == which { spoilt } else { &file.picture }).collect();
        match self.refine(&pictures) {
            None => Found::Reported,
            Some(pose) => Found::Pose { moved_mm: self.moved_mm(&pose, &self.refined) },
        }
    }

    /// Returns the verdict on a clip with this list of pictures; `None` if one of its parts is refused.
    fn inspect(&self, pictures: &[Arc<ColorPicture>], list: &str) -> Option<Verdict> {
        let listed = files::read_clip(list.as_bytes()).ok()?;
        let camera_from_panel =
            self.cell.calibrated_base_from_camera().inverse() * self.cell.truth().base_from_panel;
        let camera = self.cell.scanner();
        let setup = FilmSetup {
            panel: &self.panel,
            camera,
            camera_from_panel,
            sanded: None,
            demands: self.demands,
            recipe: &self.recipe,
        };
        let mut filming = FilmRun::begin_test(&setup, OBSERVED_S).ok()?;
        for shot in listed.entries() {
            let picture = pictures.get(shot.file.strip_suffix(".png")?.parse::<usize>().ok()?)?;
            filming.push(picture, shot.time_s, shot.phase).ok()?;
        }
        Some(filming.finish().ok()?.inspection.judgement.verdict)
    }

    /// Inspects the clip with one of its pictures' files, or the file of its list, damaged.
    pub fn inspected(&self, damage: &Damage, draw: &mut Pcg64) -> Found {
        let mut pictures: Vec<_> = self.clip.iter().map(|frame| frame.picture.clone()).collect();
        let which = random_index(pictures.len() + pictures.len() / 10, draw);
        let mut list = self.list.clone();
        match self.clip.get(which) {
            Some(frame) => {
                let bytes = damaged(&frame.png, damage, draw);
                let Ok(spoilt) = files::read_color_of(&bytes, self.cell.scanner()) else { return Found::Refused };
                pictures[which] = Arc::new(spoilt);
            }
            None => {
                let bytes = damaged(self.list.as_bytes(), damage, draw);
                let Ok(text) = String::from_utf8(bytes) else { return Found::Refused };
                list = text;
            }
        }
        self.classify(&pictures, &list)
    }

    /// Inspects the clip with the pixels of one picture damaged before the picture was written to a file.
    pub fn inspected_by_pixels(&self, damage: &Damage, draw: &mut Pcg64) -> Found {
        let mut pictures: Vec<_> = self.clip.iter().map(|frame| frame.picture.clone()).collect();
        let which = random_index(pictures.len(), draw);
        pictures[which] = Arc::new(damage_pixels(&pictures[which], damage, draw));
        self.classify(&pictures, &self.list)
    }

    fn classify(&self, pictures: &[Arc<ColorPicture>], list: &str) -> Found {
        match self.inspect(pictures, list) {
            None => Found::Refused,
            Some(Verdict::Pass) => Found::Passed,
            Some(Verdict::Fail) => Found::StillFails,
            Some(_) => Found::Reported,
        }
    }
}

/// Returns the picture with damaged pixels; pixels without data are black.
fn damage_pixels(picture: &ColorPicture, damage: &Damage, draw: &mut Pcg64) -> ColorPicture {
    let mut bytes = damaged(picture.rgb.as_flattened(), damage, draw);
    bytes.resize(picture.rgb.len() * 3, 0);
    ColorPicture { rgb: bytes.as_chunks().0.to_vec(), ..*picture }
}

/// Returns the files of a film with breaks, and the list of its pictures.
fn clip(cell: &Cell, demands: &Demands) -> (Vec<Frame>, String) {
    let spots = cell.with_other_grease(&Grease::Mixed { count: 3, until_s: WET_FROM_S + 2.0 }, 1);
    let film = cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, 1);
    let end_s = WET_FROM_S + demands.filmed_s();
    let mut list = String::from("file,time_s,phase\n");
    let frames = (0..=(end_s * FRAMES_PER_SECOND).round() as u32).map(|number| {
        let time_s = f64::from(number) / FRAMES_PER_SECOND;
        let word = match film.phase(time_s) {
            sim::Phase::Dry => "dry",
            sim::Phase::Spray => "spray",
            sim::Phase::Wet => "wet",
        };
        let picture = film.picture(time_s);
        let png = files::write_color_png(&picture).expect("a picture");
        list += &format!("{number:04}.png,{time_s},{word}\n");
        Frame { png, picture: Arc::new(picture) }
    });
    let frames: Vec<Frame> = frames.collect();
    (frames, list)
}

fn recipe(cell: &Cell) -> Recipe {
    let region = cell.region();
    let corners = region.corners_px.map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = sim::SEARCH_BOX_MM;
    let text = format!(
        "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
         [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n\
         [corner]\nwhich = [\"top-left\", \"bottom-right\"]\n",
        region.rows, region.columns,
    );
    Recipe::check("bench.toml", &text).expect("a valid recipe")
}
