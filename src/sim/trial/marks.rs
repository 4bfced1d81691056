//! Bright discs printed on a trial's panel, as on the dark plate of public scans: the camera sees and measures them,
//! while it measures hardly a point of the dark surface around them.

use super::space::sheet_points;
use crate::appearance::FixedColor;
use crate::noise::LEVEL;
use crate::shape::Shape;
use rand::RngExt;
use rand_pcg::Pcg64;

/// Grey level of a disc; `RADIUS_MM` are the radii of the discs.
const GRAY: f64 = 185.0;
const RADIUS_MM: std::ops::Range<f64> = 3.5..8.0;
/// Minimum distance between two discs, mm; `MIN_EDGE_DISTANCE_MM` is that from the panel's edge.
const MIN_DISC_DISTANCE_MM: f64 = 10.0;
const MIN_EDGE_DISTANCE_MM: f64 = 16.0;
/// Maximum number of discs.
const MAX_DISCS: usize = 24;

/// Discs on the sheet: centre and radius, mm.
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
            let radius_mm = random.random_range(RADIUS_MM);
            let is_apart = |(other, other_mm): &([f64; 2], f64)| {
                (at[0] - other[0]).hypot(at[1] - other[1]) > radius_mm + other_mm + MIN_DISC_DISTANCE_MM
            };
            if discs.len() < MAX_DISCS
                && from_edge(at) > MIN_EDGE_DISTANCE_MM + radius_mm
                && discs.iter().all(is_apart)
            {
                discs.push((at, radius_mm));
            }
        }
        PrintedDiscs { discs }
    }

    /// Returns the discs as seen in a mirror.
    pub fn mirrored_discs(&self) -> PrintedDiscs {
        PrintedDiscs { discs: self.discs.iter().map(|([s, t], radius_mm)| ([-s, *t], *radius_mm)).collect() }
    }

    /// Returns the share of a pixel of this size at a point that is covered by a mark, 0…1.
    pub fn share(&self, [s, t]: [f64; 2], pixel_mm: f64) -> f64 {
        let inside_mm = |([x, y], radius_mm): &([f64; 2], f64)| radius_mm - (s - x).hypot(t - y);
        let deepest = self.discs.iter().map(inside_mm).fold(f64::NEG_INFINITY, f64::max);
        (deepest / pixel_mm + 0.5).clamp(0.0, 1.0)
    }

    /// Returns a colour of the panel when a mark covers this share of the pixel.
    pub fn blend_paint(color: FixedColor, share: f64) -> FixedColor {
        color.map(|level| (f64::from(level) + share * (GRAY * f64::from(LEVEL) - f64::from(level))).round() as u16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{RandomPurpose, Seed};

    /// By hand: a pixel of 0.4 mm with its middle 0.1 mm inside a disc's border is three quarters mark.
    #[test]
    fn a_pixel_at_the_border_is_mark_by_its_share() {
        let marks = PrintedDiscs { discs: vec![([10.0, 0.0], 5.0)] };
        let share = |s: f64| marks.share([s, 0.0], 0.4);
        assert!((share(5.1) - 0.75).abs() < 1e-9 && (share(5.0) - 0.5).abs() < 1e-9);
        assert_eq!((share(4.0), share(7.0)), (0.0, 1.0));
        assert_eq!(PrintedDiscs::blend_paint([0, 0, 12_800], 0.5), [11_840, 11_840, 18_240]);
    }

    /// Marks lie on the panel and apart from its edge; a mirror moves them.
    #[test]
    fn marks_lie_on_the_panel_and_a_mirror_moves_them() {
        let shape = Shape::taught(Seed(2));
        let marks = PrintedDiscs::random_on_panel(&shape, Seed(2).stream(RandomPurpose::Trial, 60));
        assert!(marks.discs.len() >= 6, "{}", marks.discs.len());
        for (([s, t], radius_mm), mirrored) in marks.discs.iter().zip(marks.mirrored_discs().discs) {
            assert!(-shape.outline().distance([*s, *t].into()).0 > radius_mm + MIN_EDGE_DISTANCE_MM);
            assert_eq!(mirrored, ([-s, *t], *radius_mm));
        }
    }
}
