//! The panel's shape: a smooth height field over a plane sheet, bounded by an outline; and its drawing.
//!
//! Sheet coordinates (s, t, h): s to the right and t up as seen from the robot, h towards the robot, mm, origin at the
//! panel's centre. The visible side is h(s, t), its outward normal ∝ (−∂h/∂s, −∂h/∂t, 1). The height is
//!     h = h₀ + a s²/2 + b s t + c t²/2 + d s³/6 + e s t²/2 + A sin(s/λ + φ) cos(t/μ + ψ).                  (1)
//!
//! The outline is a convex polygon of straight edges with rounded corners. With outward unit normals nᵢ and offsets cᵢ
//! the straight edges are nᵢ·p = cᵢ. The rounded outline is the set of points at distance r from the polygon that is
//! moved inwards by r; every straight edge keeps its position.
//!
//! The drawing is a triangle mesh of the visible surface inside of the outline. Its frame is the sheet's frame.

use super::noise::{RandomPurpose, Seed};
use nalgebra::{Isometry3, Matrix2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use panelprep_base::geometry::{LengthUnit, Panel, Point, TriangleMesh, Vector};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::collections::HashMap;

/// The panel's centre in the panel's frame, mm. At the nominal pose this frame coincides with the base.
pub(super) const CENTRE_MM: [f64; 3] = [560.0, 0.0, 360.0];

/// Approximate distance from the middle of the taught panel to its ends along s, mm.
const HALF_LENGTH_MM: f64 = 165.0;

/// Radius of the outline's corners, mm.
pub(super) const ROUNDING_MM: f64 = 6.0;

/// The coefficients of (1); curvatures in 1/mm, wave numbers in rad/mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relief {
    pub lift_mm: f64,
    pub bend_ss: f64,
    pub twist_st: f64,
    pub bend_tt: f64,
    pub cubic_sss: f64,
    pub cubic_stt: f64,
    pub wave_mm: f64,
    pub wave_s: f64,
    pub wave_t: f64,
    pub phase_s_rad: f64,
    pub phase_t_rad: f64,
}

impl Relief {
    /// A plane surface with the height zero.
    pub const FLAT: Relief = Relief {
        lift_mm: 0.0,
        bend_ss: 0.0,
        twist_st: 0.0,
        bend_tt: 0.0,
        cubic_sss: 0.0,
        cubic_stt: 0.0,
        wave_mm: 0.0,
        wave_s: 0.0,
        wave_t: 0.0,
        phase_s_rad: 0.0,
        phase_t_rad: 0.0,
    };

    /// Returns the mirrored surface, h(−s, t).
    pub fn mirror_s(self) -> Relief {
        Relief {
            twist_st: -self.twist_st,
            cubic_sss: -self.cubic_sss,
            cubic_stt: -self.cubic_stt,
            wave_s: -self.wave_s,
            ..self
        }
    }

    /// Returns the negated surface, −h(s, t).
    pub fn negated(self) -> Relief {
        Relief {
            lift_mm: -self.lift_mm,
            bend_ss: -self.bend_ss,
            twist_st: -self.twist_st,
            bend_tt: -self.bend_tt,
            cubic_sss: -self.cubic_sss,
            cubic_stt: -self.cubic_stt,
            wave_mm: -self.wave_mm,
            ..self
        }
    }
}

/// The bend of a panel after it was taught: a bow, with the middle in front of both ends, and a wave.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PanelBend {
    /// Distance of the panel's middle in front of its ends, mm.
    pub bow_mm: f64,
    /// Distance from the panel's middle to its ends, mm.
    pub half_mm: f64,
    /// The direction from one end to the other, as an angle from the sheet's s axis, rad.
    pub along_rad: f64,
    /// Amplitude of the wave, mm.
    pub wave_mm: f64,
    /// Wavelength of the wave, mm.
    pub length_mm: f64,
    /// The wave's direction, as an angle from the sheet's s axis, rad.
    pub runs_rad: f64,
    /// The wave's phase at the panel's centre, rad.
    pub phase_rad: f64,
}

impl PanelBend {
    /// Returns the height of the bend at a point of the sheet, mm, and its two slopes.
    fn height(&self, [s, t]: [f64; 2]) -> [f64; 3] {
        let (mut height, mut slope_s, mut slope_t) = (0.0, 0.0, 0.0);
        if self.half_mm > 0.0 {
            let (sin, cos) = self.along_rad.sin_cos();
            let way = (s * cos + t * sin) / self.half_mm;
            let slope = -2.0 * self.bow_mm * way / self.half_mm;
            (height, slope_s, slope_t) = (self.bow_mm * (1.0 - way * way), slope * cos, slope * sin);
        }
        if self.length_mm > 0.0 {
            let (sin, cos) = self.runs_rad.sin_cos();
            let number = std::f64::consts::TAU / self.length_mm;
            let phase = number * (s * cos + t * sin) + self.phase_rad;
            let slope = self.wave_mm * number * phase.cos();
            height += self.wave_mm * phase.sin();
            (slope_s, slope_t) = (slope_s + slope * cos, slope_t + slope * sin);
        }
        [height, slope_s, slope_t]
    }
}

/// A panel: its surface and its outline.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    relief: Relief,
    bend: Option<PanelBend>,
    outline: Outline,
    panel_from_sheet: Isometry3<f64>,
}

impl Shape {
    /// Draws the taught panel; curvatures and outline vary with the seed.
    pub fn taught(seed: Seed) -> Self {
        let mut random = seed.stream(RandomPurpose::Shape, 0);
        let mut about = |middle: f64, share: f64| middle * random.random_range(1.0 - share..1.0 + share);
        let relief = Relief {
            lift_mm: 4.0,
            bend_ss: -about(1.0 / 1_100.0, 0.2),
            twist_st: about(1.0 / 1_900.0, 0.2),
            bend_tt: about(1.0 / 1_000.0, 0.3),
            cubic_sss: about(2.0e-6, 0.5),
            cubic_stt: about(3.0e-6, 0.5),
            wave_mm: about(1.2, 0.3),
            wave_s: about(1.0 / 32.0, 0.15),
            wave_t: about(1.0 / 36.0, 0.15),
            phase_s_rad: about(1.5, 0.9),
            phase_t_rad: about(1.5, 0.9),
        };
        let corners = [(-166.0, -110.0), (168.0, -116.0), (164.0, 62.0), (122.0, 116.0), (-154.0, 112.0)];
        Shape::new(relief, &corners, &mut random)
    }

    /// Returns the same panel with a bow: its middle lies in front of its ends along s by this distance, mm.
    pub fn with_bow(self, bow_mm: f64) -> Self {
        let bend_ss = self.relief.bend_ss - 2.0 * bow_mm / HALF_LENGTH_MM.powi(2);
        let relief = Relief { bend_ss, lift_mm: self.relief.lift_mm + bow_mm, ..self.relief };
        Shape { relief, ..self }
    }

    /// Returns the same panel with this bend added to its surface.
    pub fn with_bend(self, bend: PanelBend) -> Self {
        Shape { bend: Some(bend), ..self }
    }

    /// Draws another panel, with another outline and other curvatures.
    pub fn random_other(seed: Seed) -> Self {
        let mut random = seed.stream(RandomPurpose::Shape, 1);
        let mut about = |middle: f64, share: f64| middle * random.random_range(1.0 - share..1.0 + share);
        let relief = Relief {
            lift_mm: 8.0,
            bend_ss: -about(1.0 / 520.0, 0.1),
            twist_st: -about(1.0 / 2_500.0, 0.2),
            bend_tt: -about(1.0 / 800.0, 0.1),
            cubic_sss: 0.0,
            cubic_stt: -about(2.0e-6, 0.5),
            wave_mm: about(0.8, 0.3),
            wave_s: 1.0 / 45.0,
            wave_t: 1.0 / 30.0,
            phase_s_rad: about(1.5, 0.9),
            phase_t_rad: about(1.5, 0.9),
        };
        let corners =
            [(-128.0, -122.0), (96.0, -118.0), (134.0, -70.0), (128.0, 120.0), (-92.0, 128.0), (-131.0, 40.0)];
        Shape::new(relief, &corners, &mut random)
    }

    fn new(relief: Relief, corners_mm: &[(f64, f64)], random: &mut Pcg64) -> Self {
        let mut near = |mm: f64| mm + random.random_range(-2.0..2.0);
        let corners = corners_mm.iter().map(|&(s, t)| Vector2::new(near(s), near(t))).collect();
        Shape::from_parts(relief, Outline::new(corners, ROUNDING_MM))
    }

    /// Creates a panel from its parts.
    pub fn from_parts(relief: Relief, outline: Outline) -> Self {
        let [x, y, z] = CENTRE_MM;
        let axes = Rotation3::from_basis_unchecked(&[-Vector3::y(), Vector3::z(), -Vector3::x()]);
        let panel_from_sheet =
            Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_rotation_matrix(&axes));
        Shape { relief, bend: None, outline, panel_from_sheet }
    }

    /// Returns the outline on the sheet.
    pub fn outline(&self) -> &Outline {
        &self.outline
    }

    /// Returns the transformation from sheet coordinates to the panel's frame.
    pub fn panel_from_sheet(&self) -> &Isometry3<f64> {
        &self.panel_from_sheet
    }

    /// Returns the height of the surface above the sheet, mm, and its two slopes ∂h/∂s, ∂h/∂t.
    pub fn height(&self, s: f64, t: f64) -> [f64; 3] {
        let r = &self.relief;
        let bent = self.bend.map_or([0.0; 3], |bend| bend.height([s, t]));
        let (sin_s, cos_s) = (r.wave_s * s + r.phase_s_rad).sin_cos();
        let (sin_t, cos_t) = (r.wave_t * t + r.phase_t_rad).sin_cos();
        let taught = [
            r.lift_mm
                + s * s * (r.bend_ss / 2.0 + r.cubic_sss * s / 6.0)
                + t * (r.twist_st * s + t * (r.bend_tt + r.cubic_stt * s) / 2.0)
                + r.wave_mm * sin_s * cos_t, // (1)
            s * (r.bend_ss + r.cubic_sss * s / 2.0)
                + t * (r.twist_st + r.cubic_stt * t / 2.0)
                + r.wave_mm * r.wave_s * cos_s * cos_t,
            r.twist_st * s + t * (r.bend_tt + r.cubic_stt * s) - r.wave_mm * r.wave_t * sin_s * sin_t,
        ];
        std::array::from_fn(|n| taught[n] + bent[n])
    }

    /// Returns the point of the surface above a point of the sheet.
    pub fn point(&self, [s, t]: [f64; 2]) -> Point<Panel> {
        Point::new(self.panel_from_sheet * Point3::new(s, t, self.height(s, t)[0]))
    }

    /// Returns the outward unit normal above a point of the sheet.
    pub fn normal(&self, [s, t]: [f64; 2]) -> Vector<Panel> {
        Vector::new(self.panel_from_sheet * self.sheet_normal([s, t]))
    }

    fn sheet_normal(&self, [s, t]: [f64; 2]) -> Vector3<f64> {
        let [_, slope_s, slope_t] = self.height(s, t);
        Vector3::new(-slope_s, -slope_t, 1.0).normalize()
    }

    /// Returns the point of the surface that is nearest to a point, in sheet coordinates, and the signed distance
    /// between the two points along the outward normal, mm. Valid for points within about 100 mm of the surface,
    /// because these have only one nearest point.
    pub fn nearest(&self, point: Point<Panel>) -> ([f64; 2], f64) {
        let target = self.panel_from_sheet.inverse() * point.mm;
        let (mut s, mut t) = (target.x, target.y);
        for _ in 0..30 {
            let away = target - Point3::new(s, t, self.height(s, t)[0]);
            let normal = self.sheet_normal([s, t]);
            let aside = away - normal * normal.dot(&away);
            (s, t) = (s + aside.x, t + aside.y);
            if aside.norm() < 1e-10 {
                break;
            }
        }
        let foot = Point3::new(s, t, self.height(s, t)[0]);
        ([s, t], self.sheet_normal([s, t]).dot(&(target - foot)))
    }
}

#[derive(Debug, Clone, Copy)]
struct Edge {
    normal: Vector2<f64>,
    offset_mm: f64,
}

/// A convex outline; its corners are counter-clockwise as seen from the outside of the panel.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    corners: Vec<Vector2<f64>>,
    rounding_mm: f64,
    edges: Vec<Edge>,
    core: Vec<Vector2<f64>>,
    /// Outlines of windows and notches.
    cuts: Vec<Outline>,
}

impl Outline {
    /// Creates an outline from the corners at which its straight edges would meet without rounding.
    pub fn new(corners: Vec<Vector2<f64>>, rounding_mm: f64) -> Self {
        let edges: Vec<Edge> = edge_pairs(&corners)
            .map(|(a, b)| {
                let along = (b - a).normalize();
                let normal = Vector2::new(along.y, -along.x);
                Edge { normal, offset_mm: normal.dot(&a) }
            })
            .collect();
        let core = inset_corners_from(&edges, rounding_mm);
        Outline { corners, rounding_mm, edges, core, cuts: Vec::new() }
    }

    /// Returns the same outline without the area inside another outline.
    pub fn with_hole(mut self, cut: Outline) -> Self {
        self.cuts.push(cut);
        self
    }

    /// Returns the points where the straight edges would intersect without rounding.
    pub fn corners(&self) -> &[Vector2<f64>] {
        &self.corners
    }

    /// Returns the corners of the polygon whose edges are moved inwards by this distance.
    pub fn inset_corners(&self, by_mm: f64) -> Vec<Vector2<f64>> {
        inset_corners_from(&self.edges, by_mm)
    }

    /// Returns the signed distance to the outline, negative inside, mm, and the direction in which this distance
    /// increases. If there are windows or notches, their edges are included.
    pub fn distance(&self, point: Vector2<f64>) -> (f64, Vector2<f64>) {
        let outer = self.outer_distance(point);
        self.cuts.iter().fold(outer, |farthest, cut| {
            let (distance, direction) = cut.distance(point);
            if -distance > farthest.0 { (-distance, -direction) } else { farthest }
        })
    }

    fn outer_distance(&self, point: Vector2<f64>) -> (f64, Vector2<f64>) {
        let (mut deepest, mut normal) = (f64::NEG_INFINITY, Vector2::zeros());
        for edge in &self.edges {
            let distance = edge.normal.dot(&point) - edge.offset_mm;
            if distance > deepest {
                (deepest, normal) = (distance, edge.normal);
            }
        }
        if deepest <= -self.rounding_mm {
            return (deepest, normal);
        }
        let away = self.vector_from_core(point);
        let distance = away.norm();
        if distance < 1e-9 { (-self.rounding_mm, normal) } else { (distance - self.rounding_mm, away / distance) }
    }

    /// Returns the vector from the nearest point of the inner polygon to a point outside of the inner polygon.
    fn vector_from_core(&self, point: Vector2<f64>) -> Vector2<f64> {
        let mut nearest = Vector2::repeat(f64::INFINITY);
        for (a, b) in edge_pairs(&self.core) {
            let along = b - a;
            let share = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let away = point - (a + along * share);
            if away.norm_squared() < nearest.norm_squared() {
                nearest = away;
            }
        }
        nearest
    }

    /// Returns the outline as a closed polyline; its points are at most this distance apart.
    pub fn polyline(&self, spacing_mm: f64) -> Vec<Vector2<f64>> {
        let dense = edge_pairs(&self.corners).flat_map(|(a, b)| {
            let steps = ((b - a).norm() / spacing_mm).ceil().max(1.0) as usize;
            (0..steps).map(move |i| a + (b - a) * (i as f64 / steps as f64))
        });
        // Near a corner the straight edges lie outside of the rounding: these points are moved inwards onto the
        // rounding, against the gradient of the distance.
        dense
            .map(|point| {
                let (distance, direction) = self.outer_distance(point);
                point - direction * distance
            })
            .collect()
    }
}

fn edge_pairs(corners: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

fn inset_corners_from(edges: &[Edge], by_mm: f64) -> Vec<Vector2<f64>> {
    let count = edges.len();
    (0..count)
        .filter_map(|i| {
            let (before, after) = (&edges[(i + count - 1) % count], &edges[i]);
            let normals = Matrix2::from_rows(&[before.normal.transpose(), after.normal.transpose()]);
            Some(normals.try_inverse()? * Vector2::new(before.offset_mm - by_mm, after.offset_mm - by_mm))
        })
        .collect()
}

/// Spacing of the lattice from which the drawing is made, mm: its chords deviate from the surface by less than a
/// micrometre.
const DRAWING_STEP_MM: f64 = 1.0;
/// Half of the lattice's side, mm: larger than half of any panel.
const DRAWING_HALF_MM: f64 = 260.0;
/// Number of bisections after which the intersection of a lattice side with the outline is known to a nanometre.
const DRAWING_BISECTIONS: usize = 30;

/// The lattice with the vertices that were created so far.
struct CutLattice<'a> {
    shape: &'a Shape,
    mesh: TriangleMesh,
    of_node: HashMap<[i32; 2], u32>,
    of_side: HashMap<[[i32; 2]; 2], u32>,
}

impl CutLattice<'_> {
    fn node_position([i, j]: [i32; 2]) -> Vector2<f64> {
        Vector2::new(f64::from(i) * DRAWING_STEP_MM, f64::from(j) * DRAWING_STEP_MM)
    }

    fn is_inside(&self, place: Vector2<f64>) -> bool {
        self.shape.outline().distance(place).0 < 0.0
    }

    fn push(&mut self, place: Vector2<f64>) -> u32 {
        self.mesh.vertices.push([place.x, place.y, self.shape.height(place.x, place.y)[0]]);
        (self.mesh.vertices.len() - 1) as u32
    }

    fn node(&mut self, node: [i32; 2]) -> u32 {
        if let Some(&known) = self.of_node.get(&node) {
            return known;
        }
        let vertex = self.push(Self::node_position(node));
        self.of_node.insert(node, vertex);
        vertex
    }

    /// Returns the vertex at which a lattice side intersects the outline, from its inner to its outer node.
    fn outline_crossing(&mut self, inside: [i32; 2], outside: [i32; 2]) -> u32 {
        let side = [inside, outside];
        if let Some(&known) = self.of_side.get(&side) {
            return known;
        }
        let (mut within, mut beyond) = (Self::node_position(inside), Self::node_position(outside));
        for _ in 0..DRAWING_BISECTIONS {
            let middle = (within + beyond) / 2.0;
            if self.is_inside(middle) { within = middle } else { beyond = middle }
        }
        let vertex = self.push(within);
        self.of_side.insert(side, vertex);
        vertex
    }

    /// Adds the part of a lattice triangle that is inside of the outline.
    fn add(&mut self, triangle: [[i32; 2]; 3]) {
        let is_inside = triangle.map(|node| self.is_inside(Self::node_position(node)));
        let mut polygon = Vec::with_capacity(4);
        for index in 0..3 {
            let next = (index + 1) % 3;
            if is_inside[index] {
                polygon.push(self.node(triangle[index]));
            }
            match (is_inside[index], is_inside[next]) {
                (true, false) => polygon.push(self.outline_crossing(triangle[index], triangle[next])),
                (false, true) => polygon.push(self.outline_crossing(triangle[next], triangle[index])),
                _ => {}
            }
        }
        if let [first, rest @ ..] = polygon.as_slice() {
            self.mesh.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        }
    }
}

/// Returns the surface of a panel as a mesh, mm, in sheet coordinates.
pub(super) fn drawing_mesh(shape: &Shape) -> TriangleMesh {
    let mesh = TriangleMesh { unit: Some(LengthUnit::Millimetre), ..TriangleMesh::default() };
    let mut cut = CutLattice { shape, mesh, of_node: HashMap::new(), of_side: HashMap::new() };
    cut.mesh.begin_object("panel");
    let half = (DRAWING_HALF_MM / DRAWING_STEP_MM) as i32;
    for j in -half..half {
        for i in -half..half {
            cut.add([[i, j], [i + 1, j], [i + 1, j + 1]]);
            cut.add([[i, j], [i + 1, j + 1], [i, j + 1]]);
        }
    }
    cut.mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_the_derivatives_of_the_height() {
        let bend = PanelBend {
            bow_mm: 2.0,
            half_mm: 160.0,
            along_rad: 0.4,
            wave_mm: 0.3,
            length_mm: 200.0,
            runs_rad: 1.1,
            phase_rad: 0.5,
        };
        let shape = Shape::taught(Seed(3)).with_bend(bend);
        for (s, t) in [(0.0, 0.0), (-120.0, 80.0), (150.0, -90.0)] {
            let [_, slope_s, slope_t] = shape.height(s, t);
            let step = 1e-4;
            let along = |ds: f64, dt: f64| {
                (shape.height(s + ds, t + dt)[0] - shape.height(s - ds, t - dt)[0]) / (2.0 * step)
            };
            assert!((along(step, 0.0) - slope_s).abs() < 1e-8);
            assert!((along(0.0, step) - slope_t).abs() < 1e-8);
        }
    }

    /// The visible side faces the robot; a point 2 mm in front of the surface has the distance 2 mm.
    #[test]
    fn distance_is_measured_along_the_outward_normal() {
        let shape = Shape::taught(Seed(3));
        for place in [[0.0, 0.0], [-120.0, 80.0], [150.0, -90.0]] {
            let normal = shape.normal(place);
            assert!(normal.mm.x < -0.8, "{normal:?}");
            for distance_mm in [2.0, -30.0] {
                let (foot, found_mm) = shape.nearest(shape.point(place) + normal * distance_mm);
                assert!((found_mm - distance_mm).abs() < 1e-6, "{found_mm}");
                assert!((foot[0] - place[0]).hypot(foot[1] - place[1]) < 1e-6);
            }
        }
    }

    /// The panel is shallow enough to stay clear of the fixture, and no symmetry maps a corner to another corner.
    #[test]
    fn panels_are_shallow_and_have_no_symmetry() {
        for seed in 0..50 {
            let shape = Shape::taught(Seed(seed));
            let corners = shape.outline().corners();
            for corner in corners {
                assert!(shape.height(corner.x, corner.y)[0].abs() < 25.0, "seed {seed}");
            }
            let count = corners.len();
            let mut angles: Vec<f64> = (0..count)
                .map(|i| {
                    (corners[(i + 1) % count] - corners[i]).angle(&(corners[(i + count - 1) % count] - corners[i]))
                })
                .map(f64::to_degrees)
                .collect();
            angles.sort_by(f64::total_cmp);
            let differ = angles.windows(2).filter(|pair| pair[1] - pair[0] > 0.5).count();
            assert!(differ >= 3, "seed {seed}: {angles:?}");
        }
    }

    fn square() -> Outline {
        let corners = [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)];
        Outline::new(corners.map(|(s, t)| Vector2::new(s, t)).to_vec(), 4.0)
    }

    /// Expected values, calculated by hand for a square of 20 mm with the rounding radius 4 mm: the centre is 10 mm
    /// inside; (12, 0) is 2 mm outside. The corner (10, 10) is √2·4 − 4 = 1.657 mm outside of the arc about (6, 6).
    #[test]
    fn distances_to_an_outline_agree_with_hand_calculation() {
        let at = |s, t| square().distance(Vector2::new(s, t)).0;
        assert!((at(0.0, 0.0) + 10.0).abs() < 1e-12);
        assert!((at(12.0, 0.0) - 2.0).abs() < 1e-12);
        assert!((at(8.0, 1.0) + 2.0).abs() < 1e-12);
        assert!((at(10.0, 10.0) - 1.656_854).abs() < 1e-6);
    }

    #[test]
    fn the_polyline_lies_on_the_outline() {
        for point in square().polyline(1.0) {
            assert!(square().distance(point).0.abs() < 1e-9, "{point}");
        }
    }

    /// Expected values, calculated by hand for a window of 4 mm about the centre: (4, 0) is 2 mm from the window's
    /// edge, (0, 0) is 2 mm outside of the panel's material.
    #[test]
    fn a_window_is_outside_of_the_panel() {
        let window = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(|(s, t)| Vector2::new(s, t));
        let outline = square().with_hole(Outline::new(window.to_vec(), 0.5));
        assert!((outline.distance(Vector2::new(4.0, 0.0)).0 + 2.0).abs() < 1e-12);
        assert!((outline.distance(Vector2::zeros()).0 - 2.0).abs() < 1e-12);
        assert!((outline.distance(Vector2::new(4.0, 0.0)).1 + Vector2::x()).norm() < 1e-12, "grows inwards");
    }

    #[test]
    fn corners_move_inwards_in_order() {
        let inner = square().inset_corners(3.0);
        assert!((inner[0] - Vector2::new(-7.0, -7.0)).norm() < 1e-12, "{inner:?}");
        assert!((inner[2] - Vector2::new(7.0, 7.0)).norm() < 1e-12, "{inner:?}");
    }
}
