//! The edges of a part: whether its triangles form one surface without gaps, and how fine they are.
//!
//! An edge with one triangle is a border: of the panel, of a hole, or of a gap between faces that should meet. At a
//! gap, two borders run beside each other.

use super::error::NominalError;
use super::part::Part;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Borders beside each other within this distance are a gap and no slot of the panel, mm: about a pixel of a scan.
const GAP_MM: f64 = 0.5;
/// A narrower gap hides less than a tenth of a pixel, mm.
pub const HARMLESS_GAP_MM: f64 = 0.05;
/// Cosine of the largest angle between two borders of a gap.
const MIN_PARALLEL: f64 = 0.97;
/// Faces at a larger angle meet at an edge of the panel, rad; at a smaller one they approximate a curved surface. A
/// real edge of a smaller angle counts as coarse triangles, which a person reviews.
const SMOOTH_RAD: f64 = 0.55;

/// The edges of a part.
pub struct PartEdges {
    /// Each edge once, by its two vertices.
    pub all: Vec<[u32; 2]>,
    /// The edges with one triangle; none if the part is watertight.
    pub borders: Vec<[u32; 2]>,
    /// The approximate distance of the triangles from the curved surface that they replace, largest, mm.
    pub facet_error_mm: f64,
}

impl PartEdges {
    /// Finds the edges of a part.
    ///
    /// # Errors
    /// If three or more triangles meet at an edge, or faces that should meet do not.
    pub fn find(part: &Part) -> Result<PartEdges, NominalError> {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * part.triangles.len());
        for (index, &[a, b, c]) in part.triangles.iter().enumerate() {
            sides.extend([[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], index as u32)));
        }
        sides.sort_unstable();
        let mut edges = PartEdges { all: Vec::new(), borders: Vec::new(), facet_error_mm: 0.0 };
        let mut many = Vec::new();
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            let edge = same[0].0;
            edges.all.push(edge);
            match *same {
                [_] => edges.borders.push(edge),
                [(_, a), (_, b)] => {
                    let error_mm = facet_error_mm(part, edge, [a, b]);
                    edges.facet_error_mm = edges.facet_error_mm.max(error_mm);
                }
                _ => many.push(edge),
            }
        }
        if let Some(first) = many.first() {
            return Err(NominalError::ManyFaces { count: many.len(), at_mm: edge_middle(part, first).into() });
        }
        check_gaps(part, &edges.borders)?;
        Ok(edges)
    }
}

fn edge_middle(part: &Part, edge: &[u32; 2]) -> Point3<f64> {
    let [a, b] = edge.map(|corner| part.vertices[corner as usize]);
    nalgebra::center(&a, &b)
}

/// Estimates the distance of two triangles from the curved surface that they replace: over a facet of the width L
/// that turns by the angle θ towards the next, an arc rises by θ L / 8.
fn facet_error_mm(part: &Part, edge: [u32; 2], triangles: [u32; 2]) -> f64 {
    let areas = triangles.map(|index| part.area_vector(&part.triangles[index as usize]));
    let [a, b] = edge.map(|corner| part.vertices[corner as usize]);
    let length_mm = (b - a).norm();
    let [first, second] = areas;
    // Triangles of one surface may run around their edge in either direction.
    let angle_rad = first.angle(&second);
    let angle_rad = angle_rad.min(std::f64::consts::PI - angle_rad);
    if length_mm == 0.0 || !angle_rad.is_finite() || angle_rad > SMOOTH_RAD {
        return 0.0;
    }
    let width_mm = 2.0 * first.norm().min(second.norm()) / length_mm;
    angle_rad * width_mm / 8.0
}

/// Refuses borders beside each other.
fn check_gaps(part: &Part, borders: &[[u32; 2]]) -> Result<(), NominalError> {
    let cell = |point: &Point3<f64>| [0, 1, 2].map(|axis| (point[axis] / GAP_MM).floor() as i64);
    let mut middles: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (index, border) in borders.iter().enumerate() {
        middles.entry(cell(&edge_middle(part, border))).or_default().push(index);
    }
    let (mut widest, mut count) = (None::<(f64, Point3<f64>)>, 0);
    for (index, border) in borders.iter().enumerate() {
        let [a, b] = border.map(|corner| part.vertices[corner as usize]);
        let along = b - a;
        let steps = (along.norm() / GAP_MM).ceil().max(1.0) as usize;
        let mut beside: Vec<usize> = Vec::new();
        for step in 0..=steps {
            let [x, y, z] = cell(&(a + along * (step as f64 / steps as f64)));
            let around = (x - 1..=x + 1)
                .flat_map(|x| (y - 1..=y + 1).flat_map(move |y| (z - 1..=z + 1).map(move |z| [x, y, z])));
            beside.extend(around.filter_map(|key| middles.get(&key)).flatten().filter(|&&other| other != index));
        }
        beside.sort_unstable();
        beside.dedup();
        let widths = beside.iter().filter_map(|&other| gap_mm(part, &borders[other], (&a, &along)));
        if let Some(width_mm) = widths.reduce(f64::max) {
            count += 1;
            if widest.is_none_or(|(mm, _)| width_mm > mm) {
                widest = Some((width_mm, nalgebra::center(&a, &b)));
            }
        }
    }
    match widest {
        Some((width_mm, at)) => {
            Err(NominalError::Gap { width_mm, limit_mm: HARMLESS_GAP_MM, at_mm: at.into(), count })
        }
        None => Ok(()),
    }
}

/// Returns the width of the gap between a border's middle and another border from this point along this vector;
/// `None` if they do not run beside each other, or the gap is harmless.
fn gap_mm(part: &Part, border: &[u32; 2], (from, along): (&Point3<f64>, &Vector3<f64>)) -> Option<f64> {
    let [a, b] = border.map(|corner| part.vertices[corner as usize]);
    let is_parallel = (b - a).dot(along).abs() >= MIN_PARALLEL * (b - a).norm() * along.norm();
    let away = nalgebra::center(&a, &b) - from;
    let share = away.dot(along) / along.norm_squared();
    let width_mm = (away - along * share).norm();
    let is_beside = is_parallel && (0.0..=1.0).contains(&share);
    (is_beside && (HARMLESS_GAP_MM..=GAP_MM).contains(&width_mm)).then_some(width_mm)
}
