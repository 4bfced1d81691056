//! The whole test on a plane panel with pixels that represent 2 × 2 mm.

mod model;
mod pipeline;

use super::*;
use nalgebra::{Isometry3, Translation3};
use panelprep_base::geometry::{Camera, ColorPicture, Mask, OrganizedCloud, Panel, PinholeCamera, Pixel, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Verdict;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::{self, Recipe};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const WET: [u8; 3] = [60, 55, 50];
const DRY: [u8; 3] = [110, 105, 100];
/// Twelve pixels of 4 mm², which are surely found, and a small margin.
const MIN_BREAK_MM2: f64 = 50.0;

const CAMERA: PinholeCamera = PinholeCamera {
    width_px: WIDTH,
    height_px: HEIGHT,
    fx_px: 400.0,
    fy_px: 400.0,
    cx_px: 79.5,
    cy_px: 59.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

fn recipe(inspect: &str) -> Recipe {
    let text = format!(
        "panel = \"plane\"\n[locate]\nbox_min_mm = [-500, -500, 700]\nbox_max_mm = [500, 500, 900]\n\
         [region]\ncorners_px = [[19.5, 19.5], [139.5, 19.5], [139.5, 99.5], [19.5, 99.5]]\nrows = 2\ncolumns = 3\n\
         [inspect]\n{inspect}\n"
    );
    Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Parses and checks an `[inspect]` table.
pub fn inspect_table(text: &str) -> recipe::Inspect {
    recipe(text).inspect().clone()
}

/// Returns a picture of noise; the same seed gives the same picture.
pub fn pseudo_random(width: usize, height: usize, seed: u32) -> ColorPicture {
    let byte = |i: u32| {
        let mixed = (i ^ (seed << 24)).wrapping_mul(0x9E37_79B1);
        let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85EB_CA6B);
        (mixed >> 20) as u8
    };
    let rgb = (0..(width * height) as u32).map(|i| [byte(3 * i), byte(3 * i + 1), byte(3 * i + 2)]).collect();
    ColorPicture { width, height, rgb }
}

/// Returns the wall in front of the camera, 800 mm away, with some missing points.
fn taught(recipe: &Recipe) -> TaughtPanel {
    let point = |i: usize| {
        let (column, row) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
        let x_mm = ((column - CAMERA.cx_px) * 2.0) as f32;
        if i % 997 == 5 { [f32::NAN; 3] } else { [x_mm, ((row - CAMERA.cy_px) * 2.0) as f32, 800.0] }
    };
    let points = (0..WIDTH * HEIGHT).map(point).collect();
    let scan =
        OrganizedCloud::<Camera>::new(WIDTH, HEIGHT, points, vec![DRY; WIDTH * HEIGHT]).expect("counts agree");
    TaughtPanel::learn(&scan, CAMERA, Rigid::from_isometry_unchecked(Isometry3::identity()), recipe)
        .expect("a panel")
}

fn shifted(x_mm: f64) -> Rigid<Camera, Panel> {
    moved([x_mm, 0.0, 0.0])
}

fn moved([x_mm, y_mm, z_mm]: [f64; 3]) -> Rigid<Camera, Panel> {
    Rigid::from_isometry_unchecked(Translation3::new(x_mm, y_mm, z_mm).into())
}

/// The thesis's method with a median of 3 × 3 px, so that a block loses only its corners.
const SHARP: &str = "method = \"thesis\"\nmedian_px = 3\nmedian_passes = 1\npersist_frames = 2";

/// The default method.
const FILM: &str = "method = \"film\"";

fn demands() -> Demands {
    Demands {
        observation_s: 5.0,
        frames_per_second: 1.0,
        min_break_mm2: MIN_BREAK_MM2,
        persist_s: 1.0,
        cell_demands: CellDemands::default(),
    }
}

fn view(taught: &TaughtPanel, camera_from_panel: Rigid<Camera, Panel>) -> FilmView<'_> {
    FilmView { taught, camera: &CAMERA, camera_from_panel, sanded: None }
}

fn watch(x_mm: f64, settings: &str) -> FilmWatch {
    let recipe = recipe(settings);
    FilmWatch::new(&view(&taught(&recipe), shifted(x_mm)), recipe.inspect(), demands()).expect("in view")
}

/// Returns a picture of a wet panel with dry blocks, each from left, top to right, bottom (exclusive).
fn picture(blocks: &[[usize; 4]]) -> ColorPicture {
    let mut picture = ColorPicture::uniform(WIDTH, HEIGHT, WET);
    for &[left, top, right, bottom] in blocks {
        for row in top..bottom {
            picture.rgb[row * WIDTH + left..row * WIDTH + right].fill(DRY);
        }
    }
    picture
}

/// Returns the picture with the noise of one exposure, of one level: pictures of a frozen camera do not have this
/// noise.
fn exposed(mut picture: ColorPicture, exposure: usize) -> ColorPicture {
    for (index, pixel) in picture.rgb.iter_mut().enumerate() {
        *pixel = pixel.map(|gray| gray + ((index * 7 + exposure * 13 + index / 160 * exposure) % 2) as u8);
    }
    picture
}

/// A dry picture, and six wet ones a second apart; the blocks that `dry_at` returns are dry then.
fn run(mut watch: FilmWatch, dry_at: impl Fn(usize) -> Vec<[usize; 4]>) -> Inspection {
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    watched(watch, dry_at)
}

fn watched(mut watch: FilmWatch, dry_at: impl Fn(usize) -> Vec<[usize; 4]>) -> Inspection {
    for second in 0..6 {
        let picture = exposed(picture(&dry_at(second)), second);
        watch.push(&picture, 10.0 + second as f64, Phase::Wet).expect("in order");
    }
    watch.finish().expect("wet pictures")
}

fn codes(inspection: &Inspection) -> Vec<&str> {
    inspection.judgement.reasons.iter().map(|reason| &*reason.code).collect()
}
