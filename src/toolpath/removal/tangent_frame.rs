//! A point of the surface with its tangent plane: the axes, the normal and the curvature below the disc.
//!
//! With E, F, G and L, M, N of the first and second form, x along S_u and y = n × x, the curvature in these axes is
//!     K₁₁ = L/E,  K₁₂ = (M − F/E · L)/A,  K₂₂ = (N − 2 F/E · M + (F/E)² L)/(A²/E),   A² = E G − F²,
//! positive if the surface bends away from the tool. Source: do Carmo, Differential Geometry of Curves and Surfaces,
//! 3.3.

use crate::surface::{BSplineSurface, Parameter};
use nalgebra::{Matrix2, Vector2, Vector3};
use panelprep_base::geometry::{Panel, Point, Rigid, Tool, Vector};

/// If a tool is tilted by a larger angle against the surface, it no longer lies on the surface: the cosine of 60°.
const MIN_COSINE: f64 = 0.5;

/// A point of the surface with its tangent plane; in the panel's frame, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentFrame {
    /// Its parameters.
    pub at: Parameter,
    /// The point.
    pub point: Point<Panel>,
    x: Vector3<f64>,
    y: Vector3<f64>,
    normal: Vector3<f64>,
    /// The curvature K in the axes of the tangent plane, 1/mm.
    pub curvature_per_mm: Matrix2<f64>,
    // Maps an offset in the plane, mm, to an offset of the parameters.
    parameter_per_mm: Matrix2<f64>,
}

impl TangentFrame {
    /// Returns the frame at these parameters; `None` if the surface has no normal.
    pub fn compute(surface: &BSplineSurface, at: Parameter) -> Option<Self> {
        let there = surface.derivatives(at);
        let normal = surface.unit_normal(&there.tangents)?.mm;
        let (s_u, s_v) = (there.tangents.s_u.mm, there.tangents.s_v.mm);
        let (e, f, g) = (s_u.dot(&s_u), s_u.dot(&s_v), s_v.dot(&s_v));
        let [l, m, n] = [there.s_uu, there.s_uv, there.s_vv].map(|second| -second.mm.dot(&normal));
        let (area2, slant) = (e * g - f * f, f / e);
        let x = s_u / e.sqrt();
        // The axis on the side of S_v, whether u and v are right- or left-handed.
        let y = (s_v - s_u * slant) / (area2 / e).sqrt();
        let across = (m - slant * l) / area2.sqrt();
        let curvature_per_mm =
            Matrix2::new(l / e, across, across, (n - 2.0 * slant * m + slant * slant * l) / (area2 / e));
        let (per_x, per_y) = (1.0 / e.sqrt(), (e / area2).sqrt());
        let parameter_per_mm = Matrix2::new(per_x, -slant * per_y, 0.0, per_y);
        Some(TangentFrame { at, point: there.tangents.point, x, y, normal, curvature_per_mm, parameter_per_mm })
    }

    /// Returns the coordinates of a point in the tangent plane, mm from the frame's point.
    pub fn offset_mm(&self, point: Point<Panel>) -> Vector2<f64> {
        let away = (point - self.point).mm;
        Vector2::new(away.dot(&self.x), away.dot(&self.y))
    }

    /// Returns the parameters at an offset in the tangent plane, to first order.
    pub fn parameter(&self, offset_mm: Vector2<f64>) -> Parameter {
        let step = self.parameter_per_mm * offset_mm;
        Parameter { u: self.at.u + step.x, v: self.at.v + step.y }
    }

    /// Returns how far a circle of this radius, mm, around the point reaches along u and v.
    pub fn reach(&self, radius_mm: f64) -> [f64; 2] {
        [0, 1].map(|row| radius_mm * self.parameter_per_mm.row(row).norm())
    }

    /// Returns how much deeper the disc of a tool reaches per mm along x and y: its tilt; `None` if the tool does not
    /// lie on the surface at all. The tool's Z points out of its pad.
    pub fn tilt(&self, panel_from_tool: &Rigid<Panel, Tool>) -> Option<Vector2<f64>> {
        let away = -(*panel_from_tool * Vector::<Tool>::new(Vector3::z())).mm;
        let cosine = away.dot(&self.normal);
        (cosine > MIN_COSINE).then(|| Vector2::new(away.dot(&self.x), away.dot(&self.y)) / cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::KnotVector;
    use panelprep_base::geometry::KukaPose;
    use proptest::prelude::*;

    /// Makes a surface with control points at the Greville abscissae: x = 100 u + lean · 60 v, y = 60 v, and these
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

    /// By hand: a tool with its Z down on a level plane has no tilt; leant by 2° about Y, its X goes down or up by
    /// tan 2° = 0.034 92 per mm.
    #[test]
    fn a_leant_tool_reaches_deeper_on_one_side() {
        let frame = TangentFrame::compute(&net(0.0, &[0.0; 36]), Parameter { u: 0.5, v: 0.5 }).expect("a normal");
        let tool = |b_deg: f64| KukaPose { b_deg, c_deg: 180.0, ..KukaPose::default() }.to_rigid();
        assert!(frame.tilt(&tool(0.0)).expect("on it").norm() < 1e-12);
        let leant = frame.tilt(&tool(2.0)).expect("on it");
        // The tool's back tilts by +2° about Y towards +X, so its disc is lower on this side.
        assert!((leant - Vector2::new(0.034_920_8, 0.0)).norm() < 1e-6, "{leant}");
        assert_eq!(frame.tilt(&tool(180.0)), None, "from behind");
    }

    proptest! {
        /// The eigenvalues are the principal curvatures for any slant of the parameter lines, and an offset converts
        /// back to the same parameters.
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
