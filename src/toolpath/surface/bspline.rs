//! The tensor-product B-spline surface of a panel, with derivatives and normals.
//!
//!     S(u, v) = Σᵢ Σⱼ N_{i,k}(u) N_{j,l}(v) p_{ij}                                                          (4.12)
//! with degrees k and l; S_u has N'_{i,k} in place of N_{i,k} (4.14, 4.15), and so on. The normal is
//!     N = ± S_u × S_v / |S_u × S_v|.                                                                        (4.13)
//! The sign is chosen once, so that the normal points to the side of the camera. The thesis's form depends on the
//! handedness of (u, v); with a wrong sign the tool's Z axis and the retraction would be reversed. Points are in the
//! panel's frame, mm.
//!
//! For fast evaluation the surface is stored as one polynomial for each pair of spans. With N_r(t) = Σ_k c_rk t^k on a
//! span (`basis`), Eq. 4.12 becomes S = Σ_kl a_kl s^k t^l, a_kl = Σ_ij c_ik c_jl p_ij: two Horner schemes without a
//! division, 25 ns for a point with five derivatives. x, y, z and an unused fourth number are stored side by side for
//! the processor's vector instructions. Degrees up to 3 are supported.

use nalgebra::Vector3;
use panelprep_base::geometry::basis::{Basis, KnotVector, SpanFunctions};
use panelprep_base::geometry::{Panel, Point, Vector};
use std::ops::RangeInclusive;

/// Minimum sine of the angle between S_u and S_v at which a normal is defined.
const MIN_TANGENT_SINE: f64 = 1e-6;

/// Number of coefficients of a span's polynomial along one parameter.
const SIDE: usize = 4;

/// A point of a surface, given by its parameters; no unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Parameter along the region's columns, 0…1 inside the region.
    pub u: f64,
    /// Parameter along the region's rows, 0…1 inside the region.
    pub v: f64,
}

/// A point of a surface with its first derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointTangents {
    /// The point S, mm.
    pub point: Point<Panel>,
    /// The derivative S_u, mm.
    pub s_u: Vector<Panel>,
    /// The derivative S_v, mm.
    pub s_v: Vector<Panel>,
}

impl PointTangents {
    /// Returns |S_u × S_v|: the surface area per unit of u and v, mm².
    pub fn area_mm2(&self) -> f64 {
        self.s_u.mm.cross(&self.s_v.mm).norm()
    }
}

/// A point of a surface with its first and second derivatives, all mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// The point S with S_u and S_v.
    pub tangents: PointTangents,
    /// The second derivative S_uu.
    pub s_uu: Vector<Panel>,
    /// The second derivative S_uv.
    pub s_uv: Vector<Panel>,
    /// The second derivative S_vv.
    pub s_vv: Vector<Panel>,
}

/// The reason why control points do not form a surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// The number of control points does not agree with the knots.
    #[error("the knots need {needed} control points, found {found}")]
    ControlCount {
        /// Number of control points that were given.
        found: usize,
        /// Number of control points that the knots require.
        needed: usize,
    },
    /// The direction of the normal cannot be determined from the camera's position.
    #[error(
        "the direction of the surface's normal cannot be determined: the camera's view is parallel to the \
        surface, or the surface is degenerate; scan the panel again"
    )]
    NoSide,
}

/// An immutable B-spline surface.
#[derive(Debug, Clone, PartialEq)]
pub struct BSplineSurface {
    knots_u: KnotVector,
    knots_v: KnotVector,
    // The control point p_{ij} at index i · (controls along v) + j.
    controls: Vec<Point<Panel>>,
    // The sign of Eq. 4.13: +1 or −1.
    side: f64,
    // The same surface as polynomials; `None` above degree 3.
    spans: Option<SpanSurface>,
}

impl BSplineSurface {
    /// Creates a surface from the knots along u and v and from its control net; v is the fastest index. `viewer` is the
    /// camera's position, towards which the normals point.
    ///
    /// # Errors
    /// If the number of control points does not agree with the knots, or if the camera's view is parallel to the
    /// surface.
    pub fn new(
        [knots_u, knots_v]: [KnotVector; 2],
        controls: Vec<Point<Panel>>,
        viewer: Point<Panel>,
    ) -> Result<Self, SurfaceError> {
        let needed = knots_u.controls() * knots_v.controls();
        if controls.len() != needed {
            return Err(SurfaceError::ControlCount { found: controls.len(), needed });
        }
        let spans = SpanSurface::new([&knots_u, &knots_v], &controls);
        let mut surface = BSplineSurface { knots_u, knots_v, controls, side: 1.0, spans };
        let towards = surface.count_facing_viewer(viewer);
        if towards == 0.0 || !towards.is_finite() {
            return Err(SurfaceError::NoSide);
        }
        surface.side = towards.signum();
        Ok(surface)
    }

    /// Takes the normal as computed, before its direction is chosen. Returns the number of points, among 5 × 5, at
    /// which the normal points to the viewer, minus the number of points at which it points away. Several points are
    /// used because a single point could lie in a fold.
    fn count_facing_viewer(&self, viewer: Point<Panel>) -> f64 {
        let place = |knots: &KnotVector, step: i32| {
            let (start, end) = (*knots.domain().start(), *knots.domain().end());
            start + (end - start) * (0.5 + f64::from(step)) / 5.0
        };
        let at = |index: i32| Parameter { u: place(&self.knots_u, index / 5), v: place(&self.knots_v, index % 5) };
        let side = |at| self.normal(at).map_or(0.0, |normal| normal.mm.dot(&(viewer - self.point(at)).mm).signum());
        (0..25).map(|index| side(at(index))).sum()
    }

    /// Returns the knot vector along u.
    pub fn knots_u(&self) -> &KnotVector {
        &self.knots_u
    }

    /// Returns the knot vector along v.
    pub fn knots_v(&self) -> &KnotVector {
        &self.knots_v
    }

    /// Returns the control points; v is the fastest index.
    pub fn controls(&self) -> &[Point<Panel>] {
        &self.controls
    }

    /// Returns the ranges of u and v over which the surface is defined. Outside, the polynomials of the border spans
    /// continue.
    pub fn domain(&self) -> [RangeInclusive<f64>; 2] {
        [self.knots_u.domain(), self.knots_v.domain()]
    }

    /// Returns the point S(u, v), Eq. 4.12.
    pub fn point(&self, at: Parameter) -> Point<Panel> {
        match &self.spans {
            Some(spans) => spans.point(self.span_indices(at), at),
            None => self.evaluate_derivatives(at).tangents.point,
        }
    }

    /// Returns the point S with S_u and S_v, Eq. 4.12 and 4.14.
    pub fn tangents(&self, at: Parameter) -> PointTangents {
        match &self.spans {
            Some(spans) => spans.tangents(self.span_indices(at), at),
            None => self.evaluate_derivatives(at).tangents,
        }
    }

    /// Returns the point S with its first and second derivatives.
    pub fn derivatives(&self, at: Parameter) -> Derivatives {
        match &self.spans {
            Some(spans) => spans.derivatives(self.span_indices(at), at),
            None => self.evaluate_derivatives(at),
        }
    }

    /// Returns the points and their first and second derivatives at many parameters, in the same order.
    pub fn derivatives_at_many(&self, places: &[Parameter]) -> Vec<Derivatives> {
        places.iter().map(|at| self.derivatives(*at)).collect()
    }

    fn span_indices(&self, at: Parameter) -> [usize; 2] {
        [self.knots_u.span(at.u), self.knots_v.span(at.v)]
    }

    // Evaluates the surface with its basis functions, for degrees without precomputed polynomials.
    fn evaluate_derivatives(&self, at: Parameter) -> Derivatives {
        let (u, v): (Basis, Basis) =
            (self.knots_u.with_second_derivatives(at.u), self.knots_v.with_second_derivatives(at.v));
        let [mut point, mut s_u, mut s_v, mut s_uu, mut s_uv, mut s_vv] = [Vector3::zeros(); 6];
        for (i, row) in self.rows((u.first_control_index, v.first_control_index)).enumerate() {
            let [mut across, mut slope, mut bend] = [Vector3::zeros(); 3];
            for (j, control) in row.iter().enumerate() {
                across += control.mm.coords * v.values[j];
                slope += control.mm.coords * v.first_derivatives[j];
                bend += control.mm.coords * v.second_derivatives[j];
            }
            point += across * u.values[i];
            s_u += across * u.first_derivatives[i];
            s_uu += across * u.second_derivatives[i];
            s_v += slope * u.values[i];
            s_uv += slope * u.first_derivatives[i];
            s_vv += bend * u.values[i];
        }
        Derivatives {
            tangents: PointTangents {
                point: Point::new(point.into()),
                s_u: Vector::new(s_u),
                s_v: Vector::new(s_v),
            },
            s_uu: Vector::new(s_uu),
            s_uv: Vector::new(s_uv),
            s_vv: Vector::new(s_vv),
        }
    }

    /// Returns the principal curvatures, 1/mm, the larger one first; positive if the surface bends away from the
    /// camera, like a ball seen from outside. `None` if there is no normal.
    pub fn principal_curvatures(&self, there: &Derivatives) -> Option<[f64; 2]> {
        let normal = self.unit_normal(&there.tangents)?.mm;
        let (s_u, s_v) = (there.tangents.s_u.mm, there.tangents.s_v.mm);
        let (e, f, g) = (s_u.dot(&s_u), s_u.dot(&s_v), s_v.dot(&s_v));
        // The minus sign is needed because the second fundamental form is positive for a bowl seen from inside.
        let [l, m, n] = [there.s_uu, there.s_uv, there.s_vv].map(|second| -second.mm.dot(&normal));
        let area2 = e * g - f * f;
        let (mean, gauss) = ((e * n - 2.0 * f * m + g * l) / (2.0 * area2), (l * n - m * m) / area2);
        let half_gap = (mean * mean - gauss).max(0.0).sqrt();
        Some([mean + half_gap, mean - half_gap])
    }

    /// Returns the unit normal that points to the camera's side; `None` if S_u and S_v are parallel.
    pub fn normal(&self, at: Parameter) -> Option<Vector<Panel>> {
        self.unit_normal(&self.tangents(at))
    }

    /// Returns the unit normal for these tangents of the surface.
    pub fn unit_normal(&self, tangents: &PointTangents) -> Option<Vector<Panel>> {
        let cross = tangents.s_u.mm.cross(&tangents.s_v.mm); // Eq. 4.13
        let length = cross.norm();
        let straight = length > MIN_TANGENT_SINE * tangents.s_u.mm.norm() * tangents.s_v.mm.norm();
        straight.then(|| Vector::new(cross * (self.side / length)))
    }

    // Returns the k + 1 rows of l + 1 control points that influence one pair of spans.
    fn rows(&self, (i, j): (usize, usize)) -> impl Iterator<Item = &[Point<Panel>]> {
        let (stride, width) = (self.knots_v.controls(), self.knots_v.degree() + 1);
        (i..=i + self.knots_u.degree()).map(move |i| &self.controls[i * stride + j..i * stride + j + width])
    }
}

/// The components x, y, z, 0 of a vector.
type VectorLanes = [f64; 4];

#[derive(Debug, Clone, PartialEq)]
struct SpanSurface {
    axes: [Vec<Span>; 2],
    // The coefficients a_kl of span (i, j) at index i · (spans along v) + j.
    cells: Vec<[[VectorLanes; SIDE]; SIDE]>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    start: f64,
    per_length: f64,
}

impl SpanSurface {
    pub fn new([knots_u, knots_v]: [&KnotVector; 2], controls: &[Point<Panel>]) -> Option<Self> {
        if knots_u.degree().max(knots_v.degree()) >= SIDE {
            return None;
        }
        let functions =
            |knots: &KnotVector| (0..knots.spans()).map(|i| knots.span_polynomials(i)).collect::<Vec<_>>();
        let (on_u, on_v) = (functions(knots_u), functions(knots_v));
        let stride = knots_v.controls();
        let mut cells = Vec::with_capacity(on_u.len() * on_v.len());
        for (i, u) in on_u.iter().enumerate() {
            for (j, v) in on_v.iter().enumerate() {
                let control = |r: usize, q: usize| controls[(i + r) * stride + j + q].mm.coords;
                cells.push(coefficients((u, knots_u.degree()), (v, knots_v.degree()), control));
            }
        }
        let span = |functions: &SpanFunctions| Span {
            start: functions.start,
            per_length: if functions.length > 0.0 { 1.0 / functions.length } else { 0.0 },
        };
        Some(SpanSurface { axes: [on_u.iter().map(span).collect(), on_v.iter().map(span).collect()], cells })
    }

    pub fn point(&self, spans: [usize; 2], at: Parameter) -> Point<Panel> {
        let (cell, [s, t], _) = self.span_coefficients(spans, at);
        let rows = cell.map(|row| evaluate_polynomial(&row, t));
        point(evaluate_polynomial(&rows, s))
    }

    pub fn tangents(&self, spans: [usize; 2], at: Parameter) -> PointTangents {
        let (cell, [s, t], per_length) = self.span_coefficients(spans, at);
        let (rows, slopes) =
            (cell.map(|row| evaluate_polynomial(&row, t)), cell.map(|row| evaluate_derivative(&row, t)));
        PointTangents {
            point: point(evaluate_polynomial(&rows, s)),
            s_u: vector(evaluate_derivative(&rows, s), per_length[0]),
            s_v: vector(evaluate_polynomial(&slopes, s), per_length[1]),
        }
    }

    pub fn derivatives(&self, spans: [usize; 2], at: Parameter) -> Derivatives {
        let (cell, [s, t], [per_u, per_v]) = self.span_coefficients(spans, at);
        let (rows, slopes) =
            (cell.map(|row| evaluate_polynomial(&row, t)), cell.map(|row| evaluate_derivative(&row, t)));
        let bends = cell.map(|row| second(&row, t));
        Derivatives {
            tangents: PointTangents {
                point: point(evaluate_polynomial(&rows, s)),
                s_u: vector(evaluate_derivative(&rows, s), per_u),
                s_v: vector(evaluate_polynomial(&slopes, s), per_v),
            },
            s_uu: vector(second(&rows, s), per_u * per_u),
            s_uv: vector(evaluate_derivative(&slopes, s), per_u * per_v),
            s_vv: vector(evaluate_polynomial(&bends, s), per_v * per_v),
        }
    }

    #[inline]
    fn span_coefficients(
        &self,
        [i, j]: [usize; 2],
        at: Parameter,
    ) -> (&[[VectorLanes; SIDE]; SIDE], [f64; 2], [f64; 2]) {
        let (u, v) = (self.axes[0][i], self.axes[1][j]);
        let cell = &self.cells[i * self.axes[1].len() + j];
        let local = [(at.u - u.start) * u.per_length, (at.v - v.start) * v.per_length];
        (cell, local, [u.per_length, v.per_length])
    }
}

fn coefficients(
    (u, degree_u): (&SpanFunctions, usize),
    (v, degree_v): (&SpanFunctions, usize),
    control: impl Fn(usize, usize) -> Vector3<f64>,
) -> [[VectorLanes; SIDE]; SIDE] {
    let mut sums = [[[0.0; 4]; SIDE]; SIDE];
    for r in 0..=degree_u {
        for q in 0..=degree_v {
            let control = control(r, q);
            for (k, row) in sums.iter_mut().enumerate() {
                for (l, lanes) in row.iter_mut().enumerate() {
                    let weight = u.coefficients[r][k] * v.coefficients[q][l];
                    for axis in 0..3 {
                        lanes[axis] += weight * control[axis];
                    }
                }
            }
        }
    }
    sums
}

#[inline]
fn evaluate_polynomial(c: &[VectorLanes; SIDE], t: f64) -> VectorLanes {
    std::array::from_fn(|axis| ((c[3][axis] * t + c[2][axis]) * t + c[1][axis]) * t + c[0][axis])
}

#[inline]
fn evaluate_derivative(c: &[VectorLanes; SIDE], t: f64) -> VectorLanes {
    let (two, three) = (2.0 * t, 3.0 * t * t);
    std::array::from_fn(|axis| c[3][axis] * three + c[2][axis] * two + c[1][axis])
}

#[inline]
fn second(c: &[VectorLanes; SIDE], t: f64) -> VectorLanes {
    let six = 6.0 * t;
    std::array::from_fn(|axis| c[3][axis] * six + 2.0 * c[2][axis])
}

#[inline]
fn point([x, y, z, _]: VectorLanes) -> Point<Panel> {
    Point::at(x, y, z)
}

#[inline]
fn vector([x, y, z, _]: VectorLanes, scale: f64) -> Vector<Panel> {
    Vector::new(Vector3::new(x * scale, y * scale, z * scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn net(heights_mm: impl Fn(usize, usize) -> f64) -> BSplineSurface {
        let knots = || KnotVector::uniform(3, 3, 0.0..=1.0).expect("open");
        // Control points over the Greville abscissae 0, 1/9, 3/9, 6/9, 8/9, 1 give exactly x = 100 u and y = 60 v.
        let greville = [0.0, 1.0, 3.0, 6.0, 8.0, 9.0].map(|ninths: f64| ninths / 9.0);
        let control =
            |n: usize| Point::at(100.0 * greville[n / 6], 60.0 * greville[n % 6], heights_mm(n / 6, n % 6));
        BSplineSurface::new([knots(), knots()], (0..36).map(control).collect(), Point::at(0.0, 0.0, 500.0))
            .expect("a surface")
    }

    /// Expected values, calculated by hand: over Greville abscissae a linear net gives the plane itself; S_u = (100, 0,
    /// 0), S_v = (0, 60, 0).
    #[test]
    fn a_linear_net_is_a_plane_up_to_its_corners() {
        let plane = net(|_, _| 7.0);
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.3, 0.8)] {
            let there = plane.derivatives(Parameter { u, v });
            assert!(there.tangents.point.distance_mm(Point::at(100.0 * u, 60.0 * v, 7.0)) < 1e-12);
            assert!((there.tangents.s_u.mm - Vector3::new(100.0, 0.0, 0.0)).norm() < 1e-11);
            assert!((there.tangents.area_mm2() - 6_000.0).abs() < 1e-8);
            assert!(there.s_uu.mm.norm() < 1e-9 && there.s_uv.mm.norm() < 1e-10);
        }
    }

    #[test]
    fn normals_point_to_the_viewer_whatever_the_handedness() {
        let plane = net(|_, _| 0.0);
        let knots = || KnotVector::uniform(3, 3, 0.0..=1.0).expect("open");
        for viewer_z_mm in [500.0, -500.0] {
            let viewer = Point::at(0.0, 0.0, viewer_z_mm);
            let swapped = (0..36).map(|n| plane.controls()[(n % 6) * 6 + n / 6]).collect();
            for controls in [plane.controls().to_vec(), swapped] {
                let surface = BSplineSurface::new([knots(), knots()], controls, viewer).expect("a surface");
                let normal = surface.normal(Parameter { u: 0.2, v: 0.9 }).expect("not degenerate");
                assert!((normal.mm - Vector3::z() * viewer_z_mm.signum()).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn a_net_that_does_not_fit_or_shows_its_edge_is_refused() {
        let knots = || [0, 1].map(|_| KnotVector::uniform(3, 3, 0.0..=1.0).expect("open"));
        let short = BSplineSurface::new(knots(), vec![Point::at(0.0, 0.0, 0.0); 35], Point::at(0.0, 0.0, 1.0));
        assert_eq!(short, Err(SurfaceError::ControlCount { found: 35, needed: 36 }));
        let point = BSplineSurface::new(knots(), vec![Point::at(0.0, 0.0, 0.0); 36], Point::at(0.0, 0.0, 1.0));
        assert_eq!(point, Err(SurfaceError::NoSide));
    }

    /// Expected values, calculated by hand: over Greville abscissae the spline of z = −x²/2R agrees with it to second
    /// order in the middle of x. A cylinder of radius 500 mm that bulges towards the camera has curvatures 1/500 and 0.
    #[test]
    fn a_bulge_has_positive_curvature() {
        // The control values of x², from its blossom at the knots of each control point: the mean of the products of
        // two of its three inner knots.
        let knots = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 2.0], [1.0, 2.0, 3.0], [2.0, 3.0, 3.0], [3.0; 3]];
        let square = |[a, b, c]: [f64; 3]| (a * b + a * c + b * c) / 27.0 * 1e4;
        let bulge = net(|i, _| -square(knots[i]) / 1_000.0);
        let there = bulge.derivatives(Parameter { u: 0.0, v: 0.5 });
        let [largest, least] = bulge.principal_curvatures(&there).expect("a normal");
        assert!((largest - 1.0 / 500.0).abs() < 1e-9 && least.abs() < 1e-12, "{largest} {least}");
    }

    /// Expected values, calculated by hand: a net that is linear in u and v gives z = 9 u v. With three spans along u
    /// and two along v, S_u = (100, 0, 9 v), S_v = (0, 60, 9 u) and S_uv = (0, 0, 9) at every point.
    #[test]
    fn a_twisted_net_has_the_same_derivatives_with_any_spans() {
        let knots = [3, 2].map(|spans| KnotVector::uniform(3, spans, 0.0..=1.0).expect("open"));
        let (along_u, along_v) = (knots[0].greville_abscissa(), knots[1].greville_abscissa());
        let control = |u: &f64, v: &f64| Point::at(100.0 * u, 60.0 * v, 9.0 * u * v);
        let controls = along_u.iter().flat_map(|u| along_v.iter().map(move |v| control(u, v))).collect();
        let surface = BSplineSurface::new(knots, controls, Point::at(0.0, 0.0, 500.0)).expect("a surface");
        for (u, v) in [(0.1, 0.2), (0.5, 0.5), (0.9, 1.0)] {
            let there = surface.derivatives(Parameter { u, v });
            assert!((there.tangents.s_u.mm - Vector3::new(100.0, 0.0, 9.0 * v)).norm() < 1e-10);
            assert!((there.tangents.s_v.mm - Vector3::new(0.0, 60.0, 9.0 * u)).norm() < 1e-10);
            assert!((there.s_uv.mm - Vector3::new(0.0, 0.0, 9.0)).norm() < 1e-9);
        }
    }

    proptest! {
        /// The polynomial evaluation agrees with the evaluation by basis functions.
        #[test]
        fn polynomials_and_basis_functions_agree(
            heights in prop::collection::vec(-20.0..20.0f64, 36), u in -0.1..1.1f64, v in -0.1..1.1f64,
        ) {
            let surface = net(|i, j| heights[i * 6 + j]);
            let at = Parameter { u, v };
            let (quick, slow) = (surface.derivatives(at), surface.evaluate_derivatives(at));
            prop_assert!(quick.tangents.point.distance_mm(slow.tangents.point) < 1e-9);
            for (quick, slow) in [(quick.tangents.s_u, slow.tangents.s_u), (quick.tangents.s_v, slow.tangents.s_v),
                (quick.s_uu, slow.s_uu), (quick.s_uv, slow.s_uv), (quick.s_vv, slow.s_vv)] {
                prop_assert!((quick.mm - slow.mm).norm() < 1e-7, "{:?} {:?}", quick, slow);
            }
        }

        #[test]
        fn derivatives_agree_with_finite_differences(
            heights in prop::collection::vec(-20.0..20.0f64, 36), u in 0.01..0.99f64, v in 0.01..0.99f64,
        ) {
            let (surface, step) = (net(|i, j| heights[i * 6 + j]), 1e-6);
            let at = |du: f64, dv: f64| surface.derivatives(Parameter { u: u + du * step, v: v + dv * step });
            let here = at(0.0, 0.0);
            let place = Parameter { u, v };
            prop_assert_eq!(surface.tangents(place), here.tangents);
            prop_assert!(surface.point(place).distance_mm(here.tangents.point) < 1e-10);
            let [east, west, north, south] = [at(1.0, 0.0), at(-1.0, 0.0), at(0.0, 1.0), at(0.0, -1.0)];
            let slope = |a: Vector3<f64>, b: Vector3<f64>| (a - b) / (2.0 * step);
            let coords = |d: &Derivatives| d.tangents.point.mm.coords;
            prop_assert!((slope(coords(&east), coords(&west)) - here.tangents.s_u.mm).norm() < 1e-4);
            prop_assert!((slope(coords(&north), coords(&south)) - here.tangents.s_v.mm).norm() < 1e-4);
            let s_u = |d: &Derivatives| d.tangents.s_u.mm;
            let s_v = |d: &Derivatives| d.tangents.s_v.mm;
            // The tolerance across a knot is a third derivative of a few 1e4 mm times the step.
            prop_assert!((slope(s_u(&east), s_u(&west)) - here.s_uu.mm).norm() < 0.1);
            prop_assert!((slope(s_u(&north), s_u(&south)) - here.s_uv.mm).norm() < 0.1);
            prop_assert!((slope(s_v(&north), s_v(&south)) - here.s_vv.mm).norm() < 0.1);
        }
    }
}
