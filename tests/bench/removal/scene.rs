//! Panels, discs and paths of the removal bench.

use panelprep::geometry::{Panel, Point, Rigid, Tool};
use panelprep::panel::Region;
use panelprep::recipe::Recipe;
use panelprep::removal::model::Model;
use panelprep::removal::pad::PadWithDisc;
use panelprep::removal::speed::Orbit;
use panelprep::removal::track::Disc;
use panelprep::surface::dwell::ExecutedPose;
use panelprep::surface::{BSplineSurface, KnotVector};

pub const ORBIT: Orbit = Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 };
pub const PAD: PadWithDisc = PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 };
pub const FORCE_N: f64 = 20.0;
pub const PRESTON_MM2_PER_N: f64 = 4e-4;

pub fn disc(rim_orbits: bool) -> Disc {
    Disc { pad: PAD, orbit: ORBIT, rim_orbits, swept_mm2: 0.0 }
}

/// Returns a model without uncertainty.
pub fn exact_model() -> Model {
    Model {
        preston_mm2_per_n: PRESTON_MM2_PER_N,
        decay_per_mm2: 0.0,
        covariance: nalgebra::Matrix2::zeros(),
        coupon_deviation: 0.0,
        disc_deviation: 0.0,
        redundancy: 1e4,
        orbit: ORBIT,
        pad_n_mm3: PAD.stiffness_n_mm3,
        forces_n: Some([FORCE_N; 2]),
        force_power: None,
    }
}

/// Returns z = −½ (k₁ x² + k₂ y²) over a rectangle around the origin, as cubic splines, which represent a parabola
/// exactly.
pub fn bent([width_mm, height_mm]: [f64; 2], [k1, k2]: [f64; 2]) -> BSplineSurface {
    let knots = || KnotVector::uniform(3, 1, 0.0..=1.0).expect("knots");
    // The control points of t and of t² on 0…1 as cubic functions.
    let (line, square) = ([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0], [0.0, 0.0, 1.0 / 3.0, 1.0]);
    // (t − ½)² = t² − t + ¼
    let centred = |n: usize| square[n] - line[n] + 0.25;
    let control = |n: usize| {
        let (i, j) = (n / 4, n % 4);
        let z = -0.5 * (k1 * width_mm * width_mm * centred(i) + k2 * height_mm * height_mm * centred(j));
        Point::at((line[i] - 0.5) * width_mm, (line[j] - 0.5) * height_mm, z)
    };
    let viewer = Point::at(0.0, 0.0, 1_000.0);
    BSplineSurface::new([knots(), knots()], (0..16).map(control).collect(), viewer).expect("a surface")
}

/// Returns a recipe with a region of this number of grids, and the additional lines `more`.
pub fn recipe([rows, columns]: [usize; 2], more: &str) -> Recipe {
    let text = format!(
        "panel = \"p\"\n[region]\ncorners_px = [[100, 100], [500, 100], [500, 400], [100, 400]]\nrows = {rows}\ncolumns = {columns}\n\
         [locate]\nbox_min_mm = [-900, -900, -900]\nbox_max_mm = [900, 900, 900]\n{more}"
    );
    Recipe::check("bench.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

pub fn region(grids: [usize; 2]) -> Region {
    Region::new(recipe(grids, "").region()).expect("convex")
}

/// Returns the pose with the tool's point at this position and the pad along the surface's normal, tilted by an angle
/// about Y.
pub fn pose(at: [f64; 3], normal: [f64; 3], (lean_deg, seconds): (f64, f64)) -> ExecutedPose {
    use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
    let away = Vector3::from(normal).normalize();
    let turn = Rotation3::rotation_between(&Vector3::z(), &-away)
        .unwrap_or(Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let lean = Rotation3::from_axis_angle(&Vector3::y_axis(), lean_deg.to_radians());
    let panel_from_tool: Rigid<Panel, Tool> = Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::new(at[0], at[1], at[2]),
        UnitQuaternion::from_rotation_matrix(&(lean * turn)),
    ));
    ExecutedPose { panel_from_tool, seconds, contact: true, force_n: None }
}
