//! Panels of many shapes, drawn from a seed: outlines of four to eight straight sides with windows and notches,
//! surfaces from flat to deeply curved. On each panel one corner is cut off more than the others, so that only one pose
//! fits.

use super::noise::Seed;
use super::shape::{Outline, ROUNDING_MM, Relief, Shape};
use nalgebra::Vector2;
use rand::RngExt;
use rand_pcg::Pcg64;
use strum::VariantArray;

/// Minimum and maximum length of a panel, mm.
const LENGTH_RANGE_MM: [f64; 2] = [140.0, 390.0];
/// Minimum and maximum width of a panel, mm.
const WIDTH_RANGE_MM: [f64; 2] = [100.0, 260.0];
/// Maximum height of a surface at its ends, mm.
const MAX_RISE_MM: f64 = 22.0;

/// Length of the cut on both sides of a corner, mm; the next constants are the length of the strip that a shorter panel
/// lacks, and the additional rise of the ends of a bowed panel.
const CORNER_CUT_MM: f64 = 15.0;
const SHORTER_MM: f64 = 5.0;
const BOW_MM: f64 = 6.0;

/// How a panel differs from the original of its family.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray, strum::IntoStaticStr)]
pub enum PanelVariant {
    /// Not at all.
    #[strum(serialize = "original")]
    Original,
    /// One more corner is cut off, by 15 mm.
    #[strum(serialize = "a corner cut")]
    CornerCut,
    /// It is the mirror image.
    #[strum(serialize = "mirrored")]
    Mirrored,
    /// It is 5 mm shorter.
    #[strum(serialize = "5 mm shorter")]
    Shorter,
    /// Its ends rise by 6 mm more.
    #[strum(serialize = "bowed by 6 mm")]
    Bowed,
}

impl PanelVariant {
    /// Every variant.
    pub const ALL: &'static [PanelVariant] = <Self as VariantArray>::VARIANTS;

    /// Returns the panel of a family that differs in this way.
    pub(super) fn panel(self, family: u64) -> Panel {
        let original = Panel::random(&mut trial_generator(Seed(family), 0));
        match self {
            PanelVariant::Original => original,
            PanelVariant::CornerCut => original.corner_cut_copy(CORNER_CUT_MM),
            PanelVariant::Mirrored => original.mirror_image(),
            PanelVariant::Shorter => original.trimmed_copy(SHORTER_MM),
            PanelVariant::Bowed => original.bent_copy(BOW_MM),
        }
    }
}

/// A panel with the parts from which it was made.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    relief: Relief,
    corners: Vec<Vector2<f64>>,
    cuts: Vec<Vec<Vector2<f64>>>,
    /// Length and width of the rectangle from which the panel is cut, mm.
    pub size_mm: [f64; 2],
}

impl Panel {
    /// Draws a panel at random.
    pub fn random(random: &mut Pcg64) -> Panel {
        let length = random.random_range(LENGTH_RANGE_MM[0]..LENGTH_RANGE_MM[1]);
        let width = random.random_range(WIDTH_RANGE_MM[0]..WIDTH_RANGE_MM[1]).min(0.95 * length);
        let mut panel = Panel {
            relief: draw_relief(random, [length, width]),
            corners: draw_corners(random, [length, width]),
            cuts: Vec::new(),
            size_mm: [length, width],
        };
        if random.random::<f64>() < 0.35 {
            panel.cuts.push(draw_window(random, panel.size_mm));
        }
        if random.random::<f64>() < 0.25 {
            panel.cuts.push(draw_notch(random, panel.size_mm));
        }
        panel
    }

    /// Draws a flat rectangle, which looks the same after a rotation by 180°.
    pub fn random_symmetric(random: &mut Pcg64) -> Panel {
        let length = random.random_range(200.0..360.0);
        let width = random.random_range(120.0..180.0);
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let corners = corners.map(|[s, t]: [f64; 2]| Vector2::new(s * length / 2.0, t * width / 2.0)).to_vec();
        let bend = random.random_range(-1.0..1.0) / 1_500.0;
        let relief = Relief { bend_ss: bend, ..Relief::FLAT };
        Panel { relief, corners, cuts: Vec::new(), size_mm: [length, width] }
    }

    /// Returns a flat panel with the same outline.
    pub fn flat_copy(&self) -> Panel {
        Panel { relief: Relief::FLAT, ..self.clone() }
    }

    /// Returns the panel's shape for the renderer.
    pub fn shape(&self) -> Shape {
        let mut outline = Outline::new(self.corners.clone(), ROUNDING_MM);
        for cut in &self.cuts {
            outline = outline.with_hole(Outline::new(cut.clone(), 3.0));
        }
        Shape::from_parts(self.relief, outline)
    }

    /// Returns the mirror image of the panel.
    pub fn mirror_image(&self) -> Panel {
        let mirror = |corners: &[Vector2<f64>]| {
            corners.iter().rev().map(|corner| Vector2::new(-corner.x, corner.y)).collect::<Vec<_>>()
        };
        Panel {
            relief: self.relief.mirror_s(),
            corners: mirror(&self.corners),
            cuts: self.cuts.iter().map(|cut| mirror(cut)).collect(),
            size_mm: self.size_mm,
        }
    }

    /// Returns the panel turned over: its back faces the viewer.
    pub fn turned_over(&self) -> Panel {
        Panel { relief: self.relief.mirror_s().negated(), ..self.mirror_image() }
    }

    /// Returns the panel with its outline scaled by this factor.
    pub fn scaled_copy(&self, factor: f64) -> Panel {
        let larger = |corners: &[Vector2<f64>]| corners.iter().map(|corner| corner * factor).collect::<Vec<_>>();
        Panel {
            corners: larger(&self.corners),
            cuts: self.cuts.iter().map(|cut| larger(cut)).collect(),
            size_mm: self.size_mm.map(|mm| mm * factor),
            ..self.clone()
        }
    }

    /// Returns the panel with both ends of its length bent up by this height, mm.
    pub fn bent_copy(&self, rise_mm: f64) -> Panel {
        let bend = 8.0 * rise_mm / (self.size_mm[0] * self.size_mm[0]);
        Panel { relief: Relief { bend_ss: self.relief.bend_ss + bend, ..self.relief }, ..self.clone() }
    }

    /// Returns the panel without a strip of this length, mm.
    pub fn trimmed_copy(&self, cut_mm: f64) -> Panel {
        let [length, width] = self.size_mm;
        let reach = self.corners.iter().map(|corner| corner.x).fold(0.0, f64::max);
        let (from, half) = (reach - cut_mm, width);
        let cut = [[from, -half], [length, -half], [length, half], [from, half]];
        let mut panel = self.clone();
        panel.cuts.push(cut.map(|[s, t]| Vector2::new(s, t)).to_vec());
        panel
    }

    /// Returns the same panel with one more corner cut off by this length of both its sides, mm: the corner with the
    /// longest sides.
    fn corner_cut_copy(&self, cut_mm: f64) -> Panel {
        let count = self.corners.len();
        let sides = |i: usize| {
            [i + count - 1, i + 1].map(|neighbour| self.corners[neighbour % count] - self.corners[i % count])
        };
        let shorter_mm = |i: usize| sides(i).iter().map(|side| side.norm()).fold(f64::INFINITY, f64::min);
        let chosen = (0..count).max_by(|&a, &b| shorter_mm(a).total_cmp(&shorter_mm(b))).unwrap_or_default();
        let corner = self.corners[chosen];
        let [before, after] = sides(chosen).map(|side| corner + side.normalize() * cut_mm);
        // The area beyond the new side: a panel is convex, so that the extension of this side lies outside of it.
        let (along, outward) = ((after - before).normalize(), (corner - (before + after) / 2.0).normalize());
        let (from, to) = (before - along * cut_mm, after + along * cut_mm);
        let mut panel = self.clone();
        panel.cuts.push(vec![from, from + outward * 2.0 * cut_mm, to + outward * 2.0 * cut_mm, to]);
        panel
    }
}

fn draw_corners(random: &mut Pcg64, [length, width]: [f64; 2]) -> Vec<Vector2<f64>> {
    // The corner that is cut off more than the others.
    let marked = random.random_range(0..4);
    let mut corners = Vec::new();
    for (index, [s, t]) in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].into_iter().enumerate() {
        let inset = |random: &mut Pcg64, size: f64| size * (0.5 - random.random_range(0.0..0.05));
        let corner = Vector2::new(s * inset(random, length), t * inset(random, width));
        let cut_mm = if index == marked {
            random.random_range(0.24..0.38) * width
        } else if random.random::<f64>() < 0.35 {
            random.random_range(0.08..0.14) * width
        } else {
            0.0
        };
        let slant = random.random_range(0.7..1.4);
        let (along_s, along_t) = (Vector2::new(-s * cut_mm * slant, 0.0), Vector2::new(0.0, -t * cut_mm / slant));
        if cut_mm == 0.0 {
            corners.push(corner);
        } else {
            corners.extend([corner + along_s, corner + along_t]);
        }
    }
    order_corners(corners)
}

/// Sorts the corners counter-clockwise about the middle. For a convex outline this order is unique.
fn order_corners(mut corners: Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
    corners.sort_by(|a, b| a.y.atan2(a.x).total_cmp(&b.y.atan2(b.x)));
    corners
}

/// Draws an eight-sided window away from the panel's middle.
fn draw_window(random: &mut Pcg64, [length, width]: [f64; 2]) -> Vec<Vector2<f64>> {
    let radius = random.random_range(7.0..0.09 * width);
    let side = if random.random::<bool>() { 1.0 } else { -1.0 };
    let middle = Vector2::new(side * 0.36 * length, random.random_range(-0.2..0.2) * width);
    (0..8)
        .map(|i| f64::from(i) * std::f64::consts::FRAC_PI_4)
        .map(|a| middle + Vector2::new(a.cos(), a.sin()) * radius)
        .collect()
}

/// Draws a notch in one of the long sides.
fn draw_notch(random: &mut Pcg64, [length, width]: [f64; 2]) -> Vec<Vector2<f64>> {
    let side = if random.random::<bool>() { 1.0 } else { -1.0 };
    let (middle, half) = (random.random_range(-0.3..0.3) * length, random.random_range(0.04..0.08) * length);
    let depth = random.random_range(0.06..0.13) * width;
    let (inner, outer) = (side * (0.47 * width - depth), side * width);
    let (low, high) = (inner.min(outer), inner.max(outer));
    [[middle - half, low], [middle + half, low], [middle + half, high], [middle - half, high]]
        .map(|[s, t]| Vector2::new(s, t))
        .to_vec()
}

fn draw_relief(random: &mut Pcg64, [length, width]: [f64; 2]) -> Relief {
    if random.random::<f64>() < 0.15 {
        return Relief { wave_mm: random.random_range(0.0..0.3), wave_s: 0.03, wave_t: 0.028, ..Relief::FLAT };
    }
    let within = |random: &mut Pcg64, size: f64| {
        let most = (8.0 * MAX_RISE_MM / (size * size)).min(1.0 / 350.0);
        random.random_range(-most..most)
    };
    Relief {
        lift_mm: 0.0,
        bend_ss: within(random, length),
        twist_st: random.random_range(-1.0..1.0) / 1_500.0,
        bend_tt: within(random, width),
        cubic_sss: random.random_range(-2.0e-6..2.0e-6),
        cubic_stt: random.random_range(-4.0e-6..4.0e-6),
        wave_mm: random.random_range(0.0..1.5),
        wave_s: 1.0 / random.random_range(28.0..60.0),
        wave_t: 1.0 / random.random_range(28.0..60.0),
        phase_s_rad: random.random_range(0.0..6.0),
        phase_t_rad: random.random_range(0.0..6.0),
    }
}

/// Creates the random number generator for a trial's panel.
pub(super) fn trial_generator(seed: Seed, index: u64) -> Pcg64 {
    seed.stream(super::noise::RandomPurpose::Trial, index)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A polygon is convex if it turns to the left at every corner.
    #[test]
    fn outlines_are_convex_and_have_their_size() {
        for seed in 0..200 {
            let panel = Panel::random(&mut trial_generator(Seed(seed), 0));
            let (corners, count) = (&panel.corners, panel.corners.len());
            for i in 0..count {
                let [a, b, c] = [corners[i], corners[(i + 1) % count], corners[(i + 2) % count]];
                assert!((b - a).perp(&(c - b)) > 0.0, "seed {seed}: {corners:?}");
            }
            let reach = corners.iter().map(|corner| corner.x).fold(0.0, f64::max);
            assert!(reach <= panel.size_mm[0] / 2.0 && reach > 0.3 * panel.size_mm[0], "seed {seed}: {reach}");
            let rise = panel.shape().height(panel.size_mm[0] / 2.0, 0.0)[0].abs();
            assert!(rise < MAX_RISE_MM + 8.0, "seed {seed}: {rise}");
        }
    }

    /// By hand: of a square of 100 mm a corner is cut by 20 mm of both sides. The place at 0.98 of the corner, (49, 49),
    /// was 1 mm inside of the outline and is now beyond the new side x + y = 80: (49 + 49 − 80) / √2 = 12.73 mm.
    #[test]
    fn a_corner_is_cut_off() {
        let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]];
        let mut panel = Panel::random_symmetric(&mut trial_generator(Seed(1), 0)).flat_copy();
        panel.corners = corners.map(|[s, t]: [f64; 2]| Vector2::new(s, t)).to_vec();
        let cut = panel.corner_cut_copy(20.0);
        let distances = corners.map(|[s, t]| cut.shape().outline().distance(Vector2::new(0.98 * s, 0.98 * t)).0);
        let outside: Vec<f64> = distances.into_iter().filter(|&mm| mm > 5.0).collect();
        assert!(outside.len() == 1 && (outside[0] - 12.73).abs() < 0.01, "{distances:?}");
        assert!(cut.shape().outline().distance(Vector2::zeros()).0 < -40.0, "the rest is as before");
    }

    /// Calculated by hand: in the mirror image the point (30, 10) has the height of (−30, 10); the back has minus
    /// that height.
    #[test]
    fn mirror_image_and_back_have_the_correct_heights() {
        let panel = Panel::random(&mut trial_generator(Seed(3), 0));
        let height = |panel: &Panel, s: f64| panel.shape().height(s, 10.0)[0];
        assert!((height(&panel.mirror_image(), 30.0) - height(&panel, -30.0)).abs() < 1e-12);
        assert!((height(&panel.turned_over(), 30.0) + height(&panel, -30.0)).abs() < 1e-12);
    }
}
