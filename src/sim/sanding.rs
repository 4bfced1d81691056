//! The change of the panel's appearance by sanding.
//!
//! A disc removes the gloss and the weave and leaves scratches. The sanded area becomes lighter or darker, and a film
//! darkens it by a different factor. Each pass of the disc has its own factors, and they differ between the border and
//! the middle of the pass. The factors are drawn from a range that extends from harmless to worse than reported for
//! real panels: no measurements of sanded composite under a film are known.

use super::noise::{RandomPurpose, Seed};
use rand::RngExt;

/// Number of cells along each side of the lattice over the sheet. A cell is 1 mm wide; the lattice covers −256 to 256
/// mm in both directions.
const LATTICE_CELLS_PER_SIDE: usize = 512;
const LATTICE_HALF_MM: f64 = 256.0;
/// Width of the transition of the appearance at the border of the sanded area, mm.
const EDGE_TRANSITION_MM: f64 = 0.8;

/// The appearance of a point relative to the panel before sanding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Appearance {
    /// Factor of the dry brightness, per channel.
    pub albedo: [f64; 3],
    /// Fraction of the weave's contrast that remains.
    pub weave: f64,
    /// Exponent of the film factor: the factor by which a film darkens the unsanded panel is raised to this power.
    pub film: f64,
}

impl Appearance {
    /// The appearance of an untreated point.
    pub const UNTREATED: Appearance = Appearance { albedo: [1.0; 3], weave: 1.0, film: 1.0 };

    fn blend(self, other: &Appearance, share: f64) -> Appearance {
        let mix = |a: f64, b: f64| a + share * (b - a);
        Appearance {
            albedo: std::array::from_fn(|channel| mix(self.albedo[channel], other.albedo[channel])),
            weave: mix(self.weave, other.weave),
            film: mix(self.film, other.film),
        }
    }
}

/// One pass of the disc: the area that it covered, and its effect.
#[derive(Debug, Clone)]
struct SandingPass {
    /// Distance of each cell to the border of the sanded area, mm, positive inside; row by row from the lower left.
    depth_mm: Vec<f32>,
    middle: Appearance,
    rim: Appearance,
    rim_mm: f64,
}

/// All sanding passes over one panel, in their order.
#[derive(Debug, Clone, Default)]
pub struct Sanding {
    passes: Vec<SandingPass>,
}

/// The range of the factors by which sanding changes the appearance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SandingStrength {
    /// Minimum and maximum factor of the dry brightness.
    pub albedo: [f64; 2],
}

impl SandingStrength {
    /// The range that is expected of a real disc.
    pub const TYPICAL: SandingStrength = SandingStrength { albedo: [0.7, 1.4] };
    /// Factors from less than half of the dry brightness to almost twice the dry brightness.
    pub const EXTREME: SandingStrength = SandingStrength { albedo: [0.4, 1.8] };
}

impl Sanding {
    /// Adds a pass of a disc of this radius whose centre moves through these points of the sheet, mm. The effect of the
    /// pass is drawn from the seed and the number of the pass.
    pub(super) fn add_track(
        &mut self,
        centres_mm: &[[f64; 2]],
        radius_mm: f64,
        (seed, strength): (Seed, SandingStrength),
    ) {
        let mut depth_mm = vec![f32::NEG_INFINITY; LATTICE_CELLS_PER_SIDE * LATTICE_CELLS_PER_SIDE];
        for [s, t] in centres_mm {
            let reach = |mm: f64| {
                let cell =
                    |mm: f64| (mm + LATTICE_HALF_MM).clamp(0.0, (LATTICE_CELLS_PER_SIDE - 1) as f64) as usize;
                cell(mm - radius_mm)..cell(mm + radius_mm) + 1
            };
            for row in reach(*t) {
                for column in reach(*s) {
                    let [u, v] = [column, row].map(|cell| cell as f64 + 0.5 - LATTICE_HALF_MM);
                    let depth = (radius_mm - (u - s).hypot(v - t)) as f32;
                    let cell = &mut depth_mm[row * LATTICE_CELLS_PER_SIDE + column];
                    *cell = cell.max(depth);
                }
            }
        }
        self.add(depth_mm, seed, strength);
    }

    /// Adds a pass over these quadrilaterals of the sheet, mm.
    pub(super) fn add_quads(&mut self, quads_mm: &[[[f64; 2]; 4]], (seed, strength): (Seed, SandingStrength)) {
        let depth = |index: usize| {
            let place = [index % LATTICE_CELLS_PER_SIDE, index / LATTICE_CELLS_PER_SIDE]
                .map(|cell| cell as f64 + 0.5 - LATTICE_HALF_MM);
            quads_mm.iter().map(|quad| inside_distance(quad, place)).fold(f64::NEG_INFINITY, f64::max) as f32
        };
        self.add((0..LATTICE_CELLS_PER_SIDE * LATTICE_CELLS_PER_SIDE).map(depth).collect(), seed, strength);
    }

    fn add(&mut self, depth_mm: Vec<f32>, seed: Seed, SandingStrength { albedo: [least, most] }: SandingStrength) {
        let mut random = seed.stream(RandomPurpose::Sanding, self.passes.len() as u64);
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let albedo = least * (most / least).powf(between(0.0, 1.0));
        let mut tinted = |albedo: f64| [0; 3].map(|_| albedo * between(0.96, 1.04));
        let (middle, rim) = (tinted(albedo), tinted(albedo));
        let darker = between(0.85, 1.15);
        let middle = Appearance { albedo: middle, weave: between(0.0, 0.3), film: between(0.85, 1.25) };
        let rim = Appearance { albedo: rim.map(|albedo| albedo * darker), weave: between(0.2, 0.8), ..middle };
        self.passes.push(SandingPass { depth_mm, middle, rim, rim_mm: between(1.5, 6.0) });
    }

    /// Returns whether no point was sanded.
    pub fn is_empty(&self) -> bool {
        self.passes.is_empty()
    }

    /// Returns whether the disc was at this point of the sheet, or within `margin_mm` of it.
    pub(super) fn was_touched(&self, place: [f64; 2], margin_mm: f64) -> bool {
        self.passes.iter().any(|pass| pass.depth_at(place) > -margin_mm)
    }

    /// Returns the appearance of a point of the sheet after all passes. The last pass over a point determines its
    /// appearance.
    pub(super) fn appearance_at(&self, place: [f64; 2]) -> Appearance {
        self.passes.iter().fold(Appearance::UNTREATED, |appearance, pass| {
            let depth = pass.depth_at(place);
            let own = pass.rim.blend(&pass.middle, ((depth - pass.rim_mm) / EDGE_TRANSITION_MM).clamp(0.0, 1.0));
            appearance.blend(&own, (depth / EDGE_TRANSITION_MM + 0.5).clamp(0.0, 1.0))
        })
    }
}

impl SandingPass {
    /// Returns the distance of a point to the border of the sanded area, mm, interpolated between the centres of four
    /// cells.
    fn depth_at(&self, place: [f64; 2]) -> f64 {
        let [(column, across), (row, up)] = place.map(|mm| {
            let at = (mm + LATTICE_HALF_MM - 0.5).clamp(0.0, (LATTICE_CELLS_PER_SIDE - 2) as f64);
            (at as usize, at.fract())
        });
        let cell = |dc: usize, dr: usize| {
            // The values of cells far from the disc are infinite and are limited: any large negative number is correct.
            f64::from(self.depth_mm[(row + dr) * LATTICE_CELLS_PER_SIDE + column + dc].max(-1_000.0))
        };
        let low = cell(0, 0) + across * (cell(1, 0) - cell(0, 0));
        let high = cell(0, 1) + across * (cell(1, 1) - cell(0, 1));
        low + up * (high - low)
    }
}

/// Returns the distance of a point to the nearest side of a convex quadrilateral, positive inside.
fn inside_distance(quad: &[[f64; 2]; 4], [s, t]: [f64; 2]) -> f64 {
    let area: f64 = (0..4).map(|i| cross(quad[i], quad[(i + 1) % 4])).sum();
    let side = |i: usize| {
        let ([a, b], [c, d]) = (quad[i], quad[(i + 1) % 4]);
        area.signum() * ((c - a) * (t - b) - (d - b) * (s - a)) / (c - a).hypot(d - b)
    };
    (0..4).map(side).fold(f64::INFINITY, f64::min)
}

fn cross([a, b]: [f64; 2], [c, d]: [f64; 2]) -> f64 {
    a * d - b * c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: a disc of 20 mm radius at (0, 0) and at (30, 0) has the depth 20 mm at
    /// these centres and 5 mm at the middle between them, (15, 0).
    #[test]
    fn the_depth_in_a_track_is_that_of_the_nearest_disc() {
        let mut sanding = Sanding::default();
        sanding.add_track(&[[0.0, 0.0], [30.0, 0.0]], 20.0, (Seed(1), SandingStrength::EXTREME));
        let pass = &sanding.passes[0];
        for (place, depth) in [([0.0, 0.0], 20.0), ([15.0, 0.0], 5.0), ([55.0, 0.0], -5.0)] {
            let found = pass.depth_at(place);
            assert!((found - depth).abs() < 0.8 || depth < 0.0 && found < -4.0, "{place:?}: {found}");
        }
        assert!(sanding.was_touched([48.0, 0.0], 0.0) && !sanding.was_touched([55.0, 0.0], 2.0));
        assert_eq!(sanding.appearance_at([-100.0, 0.0]), Appearance::UNTREATED);
        let appearance = sanding.appearance_at([0.0, 0.0]);
        assert!(
            (appearance.albedo[0] - pass.middle.albedo[0]).abs() + (appearance.weave - pass.middle.weave).abs()
                < 1e-12
        );
    }

    /// Expected value, calculated by hand: in a square of 40 mm about (0, 0) the point (15, 5) is 5 mm from the right
    /// side, for either order of the corners.
    #[test]
    fn depth_in_a_square_agrees_with_hand_calculation() {
        let quad = [[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]];
        let other_way = [quad[3], quad[2], quad[1], quad[0]];
        for quad in [quad, other_way] {
            assert!((inside_distance(&quad, [15.0, 5.0]) - 5.0).abs() < 1e-12);
            assert!((inside_distance(&quad, [0.0, 23.0]) + 3.0).abs() < 1e-12);
        }
    }

    #[test]
    fn each_pass_has_its_own_appearance_within_the_limits() {
        let mut sanding = Sanding::default();
        let square = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]];
        let appearances: Vec<Appearance> = (0..20)
            .map(|_| {
                sanding.add_quads(&[square], (Seed(7), SandingStrength::EXTREME));
                sanding.appearance_at([0.0, 0.0])
            })
            .collect();
        let albedos: Vec<f64> = appearances.iter().map(|appearance| appearance.albedo[1]).collect();
        assert!(albedos.iter().all(|albedo| (0.38..1.88).contains(albedo)), "{albedos:?}");
        assert!(albedos.iter().any(|albedo| *albedo < 0.6) && albedos.iter().any(|albedo| *albedo > 1.4));
    }
}
