//! Divides a path in contact into segments, each with the position of the disc, its pressure, and the length over which
//! a grain rubs.
//!
//! A path consists of poses with their times, planned or as the robot reported them. Each line between two poses is
//! divided into segments of at most half of the disc's radius; the contact at a segment's middle is used for the whole
//! segment. A pose that is marked as in contact is used only if its tip is not higher above the surface than the limit
//! in `dwell`. The swept area of the disc increases by its diameter times the length, as in the store.
//!
//! The surface below the disc is a point with its tangent plane: the axes, the normal and the curvature. With E, F, G
//! and L, M, N of the first and second form, x along S_u and y = n × x, the curvature in these axes is
//!     K₁₁ = L/E,  K₁₂ = (M − F/E · L)/A,  K₂₂ = (N − 2 F/E · M + (F/E)² L)/(A²/E),   A² = E G − F²,
//! positive if the surface bends away from the tool. Source: do Carmo, Differential Geometry of Curves and Surfaces,
//! 3.3.

use super::pad::{ContactGeometry, DiscStroke, PadWithDisc, SupportMask};
use super::speed::Orbit;
use crate::surface::dwell::{ExecutedPose, MAX_CONTACT_HEIGHT_MM, surface_foot};
use crate::surface::{BSplineSurface, Parameter};
use nalgebra::{Matrix2, Vector2, Vector3};
use panelprep_base::geometry::{Panel, Point, Rigid, Tool, Vector};
use std::f64::consts::TAU;

/// Maximum length of a segment, in disc radii.
const MAX_SEGMENT_RADII: f64 = 0.5;
/// Number of directions in which two points, on the rim and half-way to the rim, are checked to find whether the whole
/// disc has panel material below it.
const RIM_DIRECTIONS: usize = 16;

/// Minimum cosine of the tilt against the surface at which the tool is treated as lying on the surface: 60°.
const MIN_COSINE: f64 = 0.5;

/// A function that returns whether there is panel material at this point of the surface.
pub type IsPanelAt<'a> = &'a (dyn Fn(Parameter) -> bool + Sync);

/// The disc on its pad, with its motion and wear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// The disc on its pad.
    pub pad: PadWithDisc,
    /// The orbital motion of the disc.
    pub orbit: Orbit,
    /// Whether the calculation of the pressure includes the rim's orbital motion; simpler models do not include it.
    pub rim_orbits: bool,
    /// Area that the disc has swept before this path, mm².
    pub swept_mm2: f64,
}

impl Disc {
    /// Returns the radius of the circle on which the rim's centre moves, mm.
    fn rim_orbit_mm(&self) -> f64 {
        if self.rim_orbits { self.orbit.diameter_mm / 2.0 } else { 0.0 }
    }
}

/// A short straight motion of the disc in contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscStretch {
    /// The tangent frame of the surface at the segment's middle.
    pub frame: TangentFrame,
    /// The disc's contact at the middle of the segment, and its motion along the segment.
    pub stroke: DiscStroke,
    /// Length of the segment, mm.
    pub length_mm: f64,
    /// Length over which a grain rubs during the segment, mm.
    pub rubbed_mm: f64,
    /// Index of the pose at the end of the segment, from 0.
    pub pose: usize,
    /// Area that the disc has swept when it is at the segment's middle, mm².
    pub swept_mm2: f64,
}

/// Returns the segments of a path. If the force of a pose was not measured, `nominal_n`, N, is used for the motion to
/// this pose.
pub fn path_stretches(
    surface: &BSplineSurface,
    executed: &[ExecutedPose],
    (disc, nominal_n): (&Disc, f64),
    ground: IsPanelAt<'_>,
) -> Vec<DiscStretch> {
    let mut all = Vec::new();
    let (mut guess, mut swept_mm2) = (Parameter { u: 0.5, v: 0.5 }, disc.swept_mm2);
    for (index, pair) in executed.windows(2).enumerate().filter(|(_, pair)| pair[1].contact) {
        let (from, to) = (pair[0].panel_from_tool.origin(), pair[1].panel_from_tool.origin());
        let way_mm = from.distance_mm(to);
        let count = (way_mm / (MAX_SEGMENT_RADII * disc.pad.radius_mm)).ceil().max(1.0);
        let (length_mm, seconds) = (way_mm / count, pair[1].seconds / count);
        let force_n = pair[1].force_n.unwrap_or(nominal_n);
        let at = |share: f64| from + (to - from) * (share / count);
        for step in 0..count as usize {
            swept_mm2 += length_mm * disc.pad.radius_mm;
            let ends = [at(step as f64), at(step as f64 + 1.0)];
            let Some(frame) = surface_frame_below(surface, &mut guess, at(step as f64 + 0.5)) else { continue };
            let tool = pair[if 2 * step < count as usize { 0 } else { 1 }].panel_from_tool;
            let seat =
                frame.tilt(&tool).map(|tilt| ContactGeometry { tilt, curvature_per_mm: frame.curvature_per_mm });
            let pressed = seat.and_then(|seat| contact(&frame, seat, (disc, force_n), ground));
            if let Some(contact) = pressed {
                let ends_mm = ends.map(|end| frame.offset_mm(end));
                let stroke = DiscStroke::new(contact, ends_mm, (disc.rim_orbit_mm(), all.len()));
                let rubbed_mm = rubbed_mm(&disc.orbit, length_mm, seconds);
                all.push(DiscStretch { frame, stroke, length_mm, rubbed_mm, pose: index + 1, swept_mm2 });
            }
            swept_mm2 += length_mm * disc.pad.radius_mm;
        }
    }
    all
}

/// Calculates the length, mm, over which a grain rubs during a motion of this length and duration.
fn rubbed_mm(orbit: &Orbit, length_mm: f64, seconds: f64) -> f64 {
    // If the duration is 0, the same report was received twice, and the disc has not moved.
    if seconds > 0.0 { orbit.grain_mm_s(length_mm / seconds) * seconds } else { length_mm }
}

/// Returns the tangent frame of the surface below a contact point.
fn surface_frame_below(
    surface: &BSplineSurface,
    guess: &mut Parameter,
    point: Point<Panel>,
) -> Option<TangentFrame> {
    let at = surface_foot(surface, *guess, point)?;
    *guess = at;
    let normal = surface.normal(at)?;
    let height_mm = normal.mm.dot(&(point - surface.point(at)).mm);
    if height_mm > MAX_CONTACT_HEIGHT_MM { None } else { TangentFrame::compute(surface, at) }
}

/// Calculates the contact at a tangent frame; parts of the disc beyond the panel bear no force.
fn contact(
    frame: &TangentFrame,
    seat: ContactGeometry,
    (disc, force_n): (&Disc, f64),
    ground: IsPanelAt<'_>,
) -> Option<super::pad::Contact> {
    let has_panel = |offset: Vector2<f64>| ground(frame.parameter(offset));
    let look = |index: usize, share: f64| {
        let angle = TAU * index as f64 / RIM_DIRECTIONS as f64;
        has_panel(Vector2::new(angle.cos(), angle.sin()) * (share * disc.pad.radius_mm))
    };
    let is_whole =
        has_panel(Vector2::zeros()) && (0..RIM_DIRECTIONS).all(|index| look(index, 1.0) && look(index, 0.5));
    let below: SupportMask<'_> = &has_panel;
    // The closed form applies if the whole disc is on the panel; at the edge, the pressure is summed over the part on
    // the panel.
    disc.pad.contact_at_force(force_n, seat, (!is_whole).then_some(below))
}

/// A point of the surface with its tangent plane; in the panel's frame, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentFrame {
    /// The parameters of the point.
    pub at: Parameter,
    /// The point of the surface, the origin of the tangent frame.
    pub point: Point<Panel>,
    x: Vector3<f64>,
    y: Vector3<f64>,
    normal: Vector3<f64>,
    /// The curvature K in the axes of the tangent plane, 1/mm.
    pub curvature_per_mm: Matrix2<f64>,
    // Maps an offset in the tangent plane, mm, to an offset of the parameters.
    parameter_per_mm: Matrix2<f64>,
}

impl TangentFrame {
    /// Returns the tangent frame at these parameters; `None` if the surface has no normal.
    pub fn compute(surface: &BSplineSurface, at: Parameter) -> Option<Self> {
        let there = surface.derivatives(at);
        let normal = surface.unit_normal(&there.tangents)?.mm;
        let (s_u, s_v) = (there.tangents.s_u.mm, there.tangents.s_v.mm);
        let (e, f, g) = (s_u.dot(&s_u), s_u.dot(&s_v), s_v.dot(&s_v));
        let [l, m, n] = [there.s_uu, there.s_uv, there.s_vv].map(|second| -second.mm.dot(&normal));
        let (area2, slant) = (e * g - f * f, f / e);
        let x = s_u / e.sqrt();
        // The y axis points to the side of S_v for right-handed and left-handed (u, v).
        let y = (s_v - s_u * slant) / (area2 / e).sqrt();
        let across = (m - slant * l) / area2.sqrt();
        let curvature_per_mm =
            Matrix2::new(l / e, across, across, (n - 2.0 * slant * m + slant * slant * l) / (area2 / e));
        let (per_x, per_y) = (1.0 / e.sqrt(), (e / area2).sqrt());
        let parameter_per_mm = Matrix2::new(per_x, -slant * per_y, 0.0, per_y);
        Some(TangentFrame { at, point: there.tangents.point, x, y, normal, curvature_per_mm, parameter_per_mm })
    }

    /// Returns the offset of a point from the frame's origin, in the tangent plane, mm.
    pub fn offset_mm(&self, point: Point<Panel>) -> Vector2<f64> {
        let away = (point - self.point).mm;
        Vector2::new(away.dot(&self.x), away.dot(&self.y))
    }

    /// Returns the parameters at an offset in the tangent plane, to first order.
    pub fn parameter(&self, offset_mm: Vector2<f64>) -> Parameter {
        let step = self.parameter_per_mm * offset_mm;
        Parameter { u: self.at.u + step.x, v: self.at.v + step.y }
    }

    /// Returns the extent along u and v, in units of the parameters, of a circle of this radius, mm, around the frame's
    /// origin.
    pub fn reach(&self, radius_mm: f64) -> [f64; 2] {
        [0, 1].map(|row| radius_mm * self.parameter_per_mm.row(row).norm())
    }

    /// Returns the tilt of a tool: the additional depth of its disc per mm along x and y. `None` if the tilt is too
    /// large for a tool that lies on the surface. The tool's Z axis points out of its pad.
    pub fn tilt(&self, panel_from_tool: &Rigid<Panel, Tool>) -> Option<Vector2<f64>> {
        let away = -(*panel_from_tool * Vector::<Tool>::new(Vector3::z())).mm;
        let cosine = away.dot(&self.normal);
        (cosine > MIN_COSINE).then(|| Vector2::new(away.dot(&self.x), away.dot(&self.y)) / cosine)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::examples::MODEL;
    use super::*;
    use crate::surface::KnotVector;
    use panelprep_base::geometry::KukaPose;
    use proptest::prelude::*;

    pub(in crate::removal) const DISC: Disc = Disc {
        pad: PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 },
        orbit: MODEL.orbit,
        rim_orbits: false,
        swept_mm2: 0.0,
    };

    /// Returns a plane square surface with sides of this length, mm.
    pub(in crate::removal) fn level(side_mm: f64) -> BSplineSurface {
        let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("knots");
        let corner = |(x, y): (f64, f64)| Point::at(x * side_mm, y * side_mm, 0.0);
        let controls = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(corner);
        BSplineSurface::new([knots(), knots()], controls.to_vec(), Point::at(0.0, 0.0, 500.0)).expect("a surface")
    }

    /// Returns a pose with the tool's point at this position and the pad down.
    pub(in crate::removal) fn pose([x_mm, y_mm, z_mm]: [f64; 3], seconds: f64) -> ExecutedPose {
        let tool = KukaPose { x_mm, y_mm, z_mm, c_deg: 180.0, ..KukaPose::default() };
        ExecutedPose { panel_from_tool: tool.to_rigid(), seconds, contact: true, force_n: None }
    }

    /// Expected values, calculated by hand: 60 mm in 1 s are 8 segments of 7.5 mm; a grain rubs over 2618.3 mm during
    /// this time; the disc of 30 mm sweeps 1800 mm².
    #[test]
    fn a_line_is_cut_into_stretches() {
        let line = [pose([20.0, 50.0, 0.0], 0.0), pose([80.0, 50.0, 0.0], 1.0)];
        let all = path_stretches(&level(100.0), &line, (&DISC, 20.0), &|_| true);
        assert_eq!((all.len(), all[0].pose), (8, 1));
        let sum = |of: fn(&DiscStretch) -> f64| all.iter().map(of).sum::<f64>();
        assert!((sum(|stretch| stretch.rubbed_mm) - 2_618.34).abs() < 0.01, "{}", sum(|s| s.rubbed_mm));
        assert!((all[7].swept_mm2 - 1_800.0 * 7.5 / 8.0).abs() < 0.1, "{}", all[7].swept_mm2);
        assert!((all[3].stroke.contact.depth_mm - 0.565_884).abs() < 1e-4);
    }

    #[test]
    fn a_lifted_tool_or_one_without_force_removes_nothing() {
        let surface = level(100.0);
        let count = |z: f64, forces_n: [Option<f64>; 2]| {
            let line = [pose([20.0, 50.0, z], 0.0), pose([80.0, 50.0, z], 1.0)];
            let line = [0, 1].map(|index| ExecutedPose { force_n: forces_n[index], ..line[index] });
            path_stretches(&surface, &line, (&DISC, 20.0), &|_| true).len()
        };
        assert_eq!([count(1.5, [None; 2]), count(0.5, [None; 2])], [0, 8]);
        // The force that is measured at a pose applies to the motion to this pose.
        assert_eq!([count(0.0, [Some(0.0), Some(20.0)]), count(0.0, [Some(20.0), Some(0.0)])], [8, 0]);
    }

    /// Calculated by hand: with the disc's middle above the panel's edge, half of the disc bears the whole force.
    #[test]
    fn the_part_on_the_panel_bears_the_whole_force() {
        let line = [pose([20.0, 50.0, 0.0], 0.0), pose([80.0, 50.0, 0.0], 1.0)];
        let all = path_stretches(&level(100.0), &line, (&DISC, 20.0), &|at| at.v < 0.5);
        assert!(
            (all[0].stroke.contact.depth_mm / 1.131_768 - 1.0).abs() < 0.03,
            "{}",
            all[0].stroke.contact.depth_mm
        );
    }

    /// Returns a surface with control points at the Greville abscissae: x = 100 u + lean · 60 v, y = 60 v, and these
    /// heights.
    fn net(lean: f64, heights_mm: &[f64]) -> BSplineSurface {
        let knots = || KnotVector::uniform(3, 3, 0.0..=1.0).expect("open");
        let greville = [0.0, 1.0, 3.0, 6.0, 8.0, 9.0].map(|ninths: f64| ninths / 9.0);
        let control = |n: usize| {
            let (u, v) = (greville[n / 6], greville[n % 6]);
            Point::at(100.0 * u + lean * 60.0 * v, 60.0 * v, heights_mm[n])
        };
        BSplineSurface::new([knots(), knots()], (0..36).map(control).collect(), Point::at(0.0, 0.0, 500.0))
            .expect("a surface")
    }

    /// Expected values, calculated by hand: a tool with its Z axis down on a horizontal plane has no tilt; tilted by
    /// ±2° about Y, its disc is lower or higher along X by tan 2° = 0.034 92 per mm.
    #[test]
    fn a_tilted_tool_is_deeper_on_one_side() {
        let frame = TangentFrame::compute(&net(0.0, &[0.0; 36]), Parameter { u: 0.5, v: 0.5 }).expect("a normal");
        let tool = |b_deg: f64| KukaPose { b_deg, c_deg: 180.0, ..KukaPose::default() }.to_rigid();
        assert!(frame.tilt(&tool(0.0)).expect("on it").norm() < 1e-12);
        let leant = frame.tilt(&tool(2.0)).expect("on it");
        // At +2° about Y the rear of the tool leans towards +X, so its disc is lower on this side.
        assert!((leant - Vector2::new(0.034_920_8, 0.0)).norm() < 1e-6, "{leant}");
        assert_eq!(frame.tilt(&tool(180.0)), None, "from behind");
    }

    proptest! {
        /// The eigenvalues are the principal curvatures for any slant of the parameter lines, and an offset is
        /// converted back to the same parameters.
        #[test]
        fn curvature_and_offsets_agree_with_the_surface(
            heights in prop::collection::vec(-4.0..4.0f64, 36), lean in -0.8..0.8f64, u in 0.2..0.8f64, v in 0.2..0.8f64,
        ) {
            let surface = net(lean, &heights);
            let at = Parameter { u, v };
            let frame = TangentFrame::compute(&surface, at).expect("a normal");
            let [high, low] = surface.principal_curvatures(&surface.derivatives(at)).expect("a normal");
            let own = frame.curvature_per_mm.symmetric_eigenvalues();
            prop_assert!((own.max() - high).abs() < 1e-9 && (own.min() - low).abs() < 1e-9, "{} {} {}", own, high, low);
            let near = Parameter { u: u + 1e-4, v: v - 2e-4 };
            let again = frame.parameter(frame.offset_mm(surface.point(near)));
            prop_assert!((again.u - near.u).abs() < 1e-6 && (again.v - near.v).abs() < 1e-6);
            // The surface falls below the tangent plane by ½ xᵀ K x.
            let step = Parameter { u: u + 3e-3, v: v + 3e-3 };
            let offset = frame.offset_mm(surface.point(step));
            let fall = -(surface.point(step) - frame.point).mm.dot(&frame.normal);
            let expected = 0.5 * offset.dot(&(frame.curvature_per_mm * offset));
            prop_assert!((fall - expected).abs() < 2e-4, "{} {}", fall, expected);
        }
    }
}
