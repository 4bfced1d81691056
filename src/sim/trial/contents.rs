//! The contents of a trial's scene: the space in which the panel may be, objects, missing patches, printed marks and
//! defects.
//!
//! The marks are bright discs, as on the dark plate of public scans: the camera measures the discs, but hardly a point
//! of the dark surface around them.

use crate::appearance::FixedColor;
use crate::noise::{STEPS_PER_GRAY_LEVEL, ValueNoise};
use crate::scene::Slab;
use crate::shape::Shape;
use nalgebra::Vector2;
use rand::RngExt;
use rand_pcg::Pcg64;
use strum::{IntoStaticStr, VariantArray};

/// The box that contains a trial's panel, mm in the base frame; the fixture lies behind the box.
pub const TRIAL_BOX_MM: [[f64; 3]; 2] = [[250.0, -420.0, 10.0], [640.0, 420.0, 720.0]];

/// Grey level of a disc.
const DISC_GRAY: f64 = 185.0;
/// Range of the radii of the discs, mm.
const DISC_RADII_MM: std::ops::Range<f64> = 3.5..8.0;
/// Minimum distance between two discs, mm.
const MIN_DISC_DISTANCE_MM: f64 = 10.0;
/// Minimum distance between a disc and the panel's edge, mm.
const MIN_DISC_EDGE_DISTANCE_MM: f64 = 16.0;
/// Maximum number of discs on a panel.
const MAX_DISCS: usize = 24;

/// The objects of a scene besides the panel.
#[derive(Clone, Copy, Default)]
pub(super) struct SceneContents<'a> {
    pub slabs: &'a [Slab],
    pub glints: &'a [([f64; 2], f64)],
    pub wet: bool,
    pub smear_px: usize,
    pub patches: Option<&'a MissingPatches>,
    pub marks: Option<&'a PrintedDiscs>,
}

/// The areas of the panel without points.
#[derive(Debug, Clone)]
pub(super) struct MissingPatches {
    pub noise: ValueNoise,
    /// Points are missing where the noise is below this value.
    pub threshold: f64,
}

impl MissingPatches {
    pub fn contains(&self, place: [f64; 2]) -> bool {
        self.noise.value_at(place) < self.threshold
    }
}

/// Bright discs on the sheet, each with centre and radius, mm.
#[derive(Debug, Clone)]
pub(super) struct PrintedDiscs {
    discs: Vec<([f64; 2], f64)>,
}

impl PrintedDiscs {
    /// Draws the discs on a panel.
    pub fn random_on_panel(shape: &Shape, mut random: Pcg64) -> PrintedDiscs {
        let places = sheet_points(shape);
        let from_edge = |at: [f64; 2]| -shape.outline().distance(at.into()).0;
        let mut discs: Vec<([f64; 2], f64)> = Vec::new();
        for _ in 0..40 * MAX_DISCS {
            let [s, t] = places[random.random_range(0..places.len())];
            let at = [s + random.random_range(-4.0..4.0), t + random.random_range(-4.0..4.0)];
            let radius_mm = random.random_range(DISC_RADII_MM);
            let is_apart = |(other, other_mm): &([f64; 2], f64)| {
                (at[0] - other[0]).hypot(at[1] - other[1]) > radius_mm + other_mm + MIN_DISC_DISTANCE_MM
            };
            if discs.len() < MAX_DISCS
                && from_edge(at) > MIN_DISC_EDGE_DISTANCE_MM + radius_mm
                && discs.iter().all(is_apart)
            {
                discs.push((at, radius_mm));
            }
        }
        PrintedDiscs { discs }
    }

    /// Returns the mirror image of the discs.
    pub fn mirrored_discs(&self) -> PrintedDiscs {
        PrintedDiscs { discs: self.discs.iter().map(|([s, t], radius_mm)| ([-s, *t], *radius_mm)).collect() }
    }

    /// Returns the fraction of a pixel of this width that a disc covers at this point of the sheet, 0…1.
    pub fn share(&self, [s, t]: [f64; 2], pixel_mm: f64) -> f64 {
        let inside_mm = |([x, y], radius_mm): &([f64; 2], f64)| radius_mm - (s - x).hypot(t - y);
        let deepest = self.discs.iter().map(inside_mm).fold(f64::NEG_INFINITY, f64::max);
        (deepest / pixel_mm + 0.5).clamp(0.0, 1.0)
    }

    /// Returns a colour of the panel mixed with the discs' colour; `share` is the fraction of the pixel that a disc
    /// covers.
    pub fn blend_paint(color: FixedColor, share: f64) -> FixedColor {
        color.map(|level| {
            (f64::from(level) + share * (DISC_GRAY * f64::from(STEPS_PER_GRAY_LEVEL) - f64::from(level))).round()
                as u16
        })
    }
}

/// Defects of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
pub enum SceneDefect {
    /// There is no panel, only other objects.
    #[strum(serialize = "no panel")]
    Nothing,
    /// Another panel is in the fixture.
    #[strum(serialize = "another panel")]
    Another,
    /// The mirror image of the panel is in the fixture.
    #[strum(serialize = "mirror image")]
    Mirror,
    /// The panel shows its back.
    #[strum(serialize = "its back")]
    Back,
    /// The panel is 2 to 5 % larger or smaller.
    #[strum(serialize = "2 to 5 % off in size")]
    Size,
    /// The panel is bent by 2 to 5 mm.
    #[strum(serialize = "bent by 2 to 5 mm")]
    Bent,
    /// A strip of the panel's length is cut off.
    #[strum(serialize = "a strip cut off")]
    Trimmed,
    /// More than 40 % of the panel is hidden.
    #[strum(serialize = "over 40 % hidden")]
    Hidden,
    /// More than 35 % of the panel is outside of the picture.
    #[strum(serialize = "over 35 % out of view")]
    OutOfView,
    /// The panel looks the same after a rotation by 180°.
    #[strum(serialize = "symmetric")]
    Symmetric,
    /// The camera has moved since teaching, by 1 to 10 mm.
    #[strum(serialize = "camera moved")]
    CameraMoved,
    /// Water is on the panel: most points are missing, many are wrong.
    #[strum(serialize = "wet")]
    Wet,
    /// The panel moved during the scan: the picture has motion blur.
    #[strum(serialize = "moved while scanned")]
    Smeared,
    /// Two panels of the same kind are present.
    #[strum(serialize = "two panels")]
    TwoPanels,
    /// The panel is flat and has the outline of its mirror image, and its marks are those of the mirror image.
    #[strum(serialize = "mirrored marks")]
    MirroredMarks,
    /// The panel is flat and is held at a side other than at teaching.
    #[strum(serialize = "holder moved")]
    HolderMoved,
    /// The panel's warp has grown by 1 to 2 mm.
    #[strum(serialize = "warp grown by 1 to 2 mm")]
    Warped,
}

impl SceneDefect {
    /// All defects, in the order of the enumeration.
    pub const ALL: &'static [SceneDefect] = <Self as VariantArray>::VARIANTS;

    /// Returns the defect's description for messages.
    pub fn describe(self) -> &'static str {
        self.into()
    }
}

/// Returns a lattice of points of the sheet inside of the panel's outline, 8 mm apart.
pub(super) fn sheet_points(shape: &Shape) -> Vec<[f64; 2]> {
    let places = (-26..=26).flat_map(|j| (-26..=26).map(move |i| [f64::from(i) * 8.0, f64::from(j) * 8.0]));
    places.filter(|&at| shape.outline().distance(Vector2::from(at)).0 < 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{RandomPurpose, Seed};

    /// Expected value, calculated by hand: a pixel of 0.4 mm whose middle is 0.1 mm inside of a disc's border is
    /// covered by three quarters.
    #[test]
    fn a_pixel_at_a_marks_border_is_covered_by_its_share() {
        let marks = PrintedDiscs { discs: vec![([10.0, 0.0], 5.0)] };
        let share = |s: f64| marks.share([s, 0.0], 0.4);
        assert!((share(5.1) - 0.75).abs() < 1e-9 && (share(5.0) - 0.5).abs() < 1e-9);
        assert_eq!((share(4.0), share(7.0)), (0.0, 1.0));
        assert_eq!(PrintedDiscs::blend_paint([0, 0, 12_800], 0.5), [11_840, 11_840, 18_240]);
    }

    /// Discs lie on the panel with a distance from its edge; the mirror image has them at other positions.
    #[test]
    fn marks_lie_on_the_panel_and_a_mirror_moves_them() {
        let shape = Shape::taught(Seed(2));
        let marks = PrintedDiscs::random_on_panel(&shape, Seed(2).stream(RandomPurpose::Trial, 60));
        assert!(marks.discs.len() >= 6, "{}", marks.discs.len());
        for (([s, t], radius_mm), mirrored) in marks.discs.iter().zip(marks.mirrored_discs().discs) {
            assert!(-shape.outline().distance([*s, *t].into()).0 > radius_mm + MIN_DISC_EDGE_DISTANCE_MM);
            assert_eq!(mirrored, ([-s, *t], *radius_mm));
        }
    }
}
