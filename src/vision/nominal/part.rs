//! The part of a drawing that is the panel, in mm: its unit is known, and it is the only part or was selected by name.
//! The module also checks whether its triangles form one surface without gaps, and how fine they are.
//!
//! A part is a connected component of one object of the file: its triangles have common vertices. Vertices of one
//! object that are nearer to each other than [`WELD_MM`] are treated as one vertex.
//!
//! An edge with one triangle is a border: of the panel, of a hole, or of a gap between faces that should meet. At a
//! gap, two borders are beside each other.

use super::error::{ListedPart, NominalError};
use nalgebra::{Point3, Vector3};
use panelprep_base::geometry::{Base, Drawing, LengthUnit, Point, Rigid, TriangleMesh};
use std::collections::HashMap;

/// Maximum distance between vertices of one object that are joined to one vertex, mm; below the rounding of an exported
/// number.
const WELD_MM: f64 = 0.002;
/// Maximum side of the bounding box of a panel, mm. `MAX_REACH_MM` is the maximum coordinate: the origin of an
/// aircraft's frame is nearer than this.
const MAX_SIZE_MM: f64 = 20_000.0;
const MAX_REACH_MM: f64 = 200_000.0;
/// Maximum ratio of a side of the part to that of the search box; beyond it, the part has another unit, since all units
/// differ by a larger factor.
const MAX_BOX_RATIO: f64 = 4.0;
/// Side of the cells for the search for near vertices, in multiples of [`WELD_MM`].
const CELL_WELD_DISTANCES: f64 = 16.0;

/// One part of a drawing.
#[derive(Debug, Clone)]
pub struct Part {
    /// Name of the part, by which it can be selected.
    pub name: String,
    /// The vertices in the drawing frame, mm.
    pub vertices: Vec<Point3<f64>>,
    /// The triangles, each as three vertex indices.
    pub triangles: Vec<[u32; 3]>,
}

impl Part {
    /// Selects the part of a drawing that is the panel.
    ///
    /// # Errors
    /// If the unit is unknown or contradictory, no part has this name, or there are several parts and no name.
    pub fn choose(mesh: TriangleMesh, unit: Option<LengthUnit>, name: Option<&str>) -> Result<Part, NominalError> {
        let unit = match (mesh.unit, unit) {
            (Some(stated), Some(given)) if stated != given => {
                return Err(NominalError::OtherUnit { stated, given });
            }
            (stated, given) => stated.or(given),
        };
        let (low, high) =
            bounds(mesh.triangles.iter().flatten().map(|&corner| mesh.vertices[corner as usize].into()));
        let unit = unit.ok_or(NominalError::NoUnit { size: (high - low).into() })?;
        let (size_mm, reach_mm) =
            ((high - low) * unit.to_mm(), low.coords.amax().max(high.coords.amax()) * unit.to_mm());
        if !(size_mm.amax() <= MAX_SIZE_MM && reach_mm <= MAX_REACH_MM) {
            let (limit_mm, reach_limit_mm) = (MAX_SIZE_MM, MAX_REACH_MM);
            return Err(NominalError::TooLarge { size_mm: size_mm.into(), limit_mm, reach_mm, reach_limit_mm });
        }
        let mut parts = parts(&mesh, unit);
        drop(mesh);
        // Parts of the same size stay in the order of the file.
        parts.sort_by(|a, b| b.area_mm2().total_cmp(&a.area_mm2()));
        number_duplicates(&mut parts);
        let listed = |parts: &[Part]| parts.iter().map(Part::to_listed).collect();
        match name {
            None if parts.len() > 1 => Err(NominalError::SeveralParts { parts: listed(&parts) }),
            None => parts.pop().ok_or(NominalError::NothingLeft { weld_mm: WELD_MM, size_mm: size_mm.into() }),
            Some(name) => match parts.iter().position(|part| part.name == name) {
                Some(index) => Ok(parts.swap_remove(index)),
                None => Err(NominalError::NoPart { name: name.to_owned(), parts: listed(&parts) }),
            },
        }
    }

    /// Returns the corners of the bounding box of the part at its nominal pose with the smallest and the largest
    /// coordinates, mm.
    pub fn box_mm(&self, base_from_drawing: &Rigid<Base, Drawing>) -> [[f64; 3]; 2] {
        let placed = |vertex: &Point3<f64>| (*base_from_drawing * Point::<Drawing>::new(*vertex)).mm;
        let (low, high) = bounds(self.vertices.iter().map(placed));
        [low.into(), high.into()]
    }

    /// Checks that the part is in the search box; a part of it may be outside.
    ///
    /// # Errors
    /// If its centre is outside of the box, or a side is more than [`MAX_BOX_RATIO`] times as long as that of the box.
    pub fn check_in_search_box(
        &self,
        base_from_drawing: &Rigid<Base, Drawing>,
        search_box_mm: [[f64; 3]; 2],
    ) -> Result<(), NominalError> {
        let [low, high] = self.box_mm(base_from_drawing);
        let [from, to] = search_box_mm;
        let is_there = |axis: usize| {
            let middle = (low[axis] + high[axis]) / 2.0;
            let is_short = high[axis] - low[axis] <= MAX_BOX_RATIO * (to[axis] - from[axis]);
            is_short && (from[axis]..=to[axis]).contains(&middle)
        };
        match (0..3).all(is_there) {
            true => Ok(()),
            false => Err(NominalError::OutsideSearchBox { min_mm: low, max_mm: high, from_mm: from, to_mm: to }),
        }
    }

    /// Returns the surface area of the part, mm².
    pub fn area_mm2(&self) -> f64 {
        self.triangles.iter().map(|triangle| self.area_vector(triangle).norm()).sum()
    }

    /// Returns the normal of a triangle; its length is the area of the triangle, mm².
    fn area_vector(&self, triangle: &[u32; 3]) -> nalgebra::Vector3<f64> {
        let [a, b, c] = triangle.map(|corner| self.vertices[corner as usize]);
        (b - a).cross(&(c - a)) / 2.0
    }

    fn to_listed(&self) -> ListedPart {
        let (low, high) = bounds(self.vertices.iter().copied());
        ListedPart { name: self.name.clone(), size_mm: (high - low).into(), area_mm2: self.area_mm2() }
    }
}

/// Returns the corners of the bounding box of points with the smallest and the largest coordinates.
pub(super) fn bounds(points: impl Iterator<Item = Point3<f64>>) -> (Point3<f64>, Point3<f64>) {
    let start = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    points.fold(start, |(low, high), point| (low.inf(&point), high.sup(&point)))
}

/// Gives each part a unique name: parts of one object, or of objects with the same name, are numbered.
fn number_duplicates(parts: &mut [Part]) {
    let mut counts: HashMap<String, (usize, usize)> = HashMap::new();
    parts.iter().for_each(|part| counts.entry(part.name.clone()).or_default().0 += 1);
    for part in parts {
        let Some((count, number)) = counts.get_mut(&part.name) else { continue };
        *number += 1;
        part.name = match (part.name.as_str(), *count) {
            ("", _) => number.to_string(),
            (_, 1) => continue,
            (name, _) => format!("{name}:{number}"),
        };
    }
}

/// Returns the connected components of each object.
fn parts(mesh: &TriangleMesh, unit: LengthUnit) -> Vec<Part> {
    let mut parts = Vec::new();
    // One vector for all objects: a file may have as many objects as triangles.
    let mut new_index: Vec<u32> = vec![u32::MAX; mesh.vertices.len()];
    for (name, triangles) in mesh.objects() {
        let used = triangles;
        let (vertices, triangles) = weld_vertices(mesh, triangles, (unit, &mut new_index));
        used.iter().flatten().for_each(|&corner| new_index[corner as usize] = u32::MAX);
        let mut pieces = VertexUnion { parent: (0..vertices.len() as u32).collect() };
        triangles.iter().for_each(|&[a, b, c]| {
            pieces.merge(a, b);
            pieces.merge(a, c);
        });
        let mut of_root: HashMap<u32, usize> = HashMap::new();
        let first = parts.len();
        // For each vertex, its index in its part.
        let mut index_in_part: Vec<u32> = vec![u32::MAX; vertices.len()];
        for triangle in triangles {
            let at = *of_root.entry(pieces.root(triangle[0])).or_insert_with(|| {
                parts.push(Part { name: name.to_owned(), vertices: Vec::new(), triangles: Vec::new() });
                parts.len() - 1 - first
            });
            let part = &mut parts[first + at];
            let triangle = triangle.map(|corner| {
                let index = &mut index_in_part[corner as usize];
                if *index == u32::MAX {
                    *index = part.vertices.len() as u32;
                    part.vertices.push(vertices[corner as usize]);
                }
                *index
            });
            part.triangles.push(triangle);
        }
    }
    parts
}

/// Returns the vertices of an object in mm, with near ones joined, and its triangles without those that then have no
/// area. `new_index` has one `u32::MAX` for each vertex of the mesh.
fn weld_vertices(
    mesh: &TriangleMesh,
    triangles: &[[u32; 3]],
    (unit, new_index): (LengthUnit, &mut [u32]),
) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let cell_mm = CELL_WELD_DISTANCES * WELD_MM;
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut join = |corner: u32| {
        let known = new_index[corner as usize];
        if known != u32::MAX {
            return known;
        }
        let point = Point3::from(mesh.vertices[corner as usize].map(|number| number * unit.to_mm()));
        let cell = |by_mm: f64| [0, 1, 2].map(|axis| ((point[axis] + by_mm) / cell_mm).floor() as i64);
        let (low, high) = (cell(-WELD_MM), cell(WELD_MM));
        let near = (low[0]..=high[0])
            .flat_map(|x| (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z])))
            .filter_map(|key| cells.get(&key))
            .flatten()
            .copied()
            .find(|&other| (vertices[other as usize] - point).norm() <= WELD_MM);
        let index = near.unwrap_or_else(|| {
            vertices.push(point);
            let index = (vertices.len() - 1) as u32;
            cells.entry(cell(0.0)).or_default().push(index);
            index
        });
        new_index[corner as usize] = index;
        index
    };
    let joined: Vec<[u32; 3]> = triangles
        .iter()
        .map(|triangle| triangle.map(&mut join))
        .filter(|[a, b, c]| a != b && b != c && a != c)
        .collect();
    (vertices, joined)
}

/// Connected sets of vertices (Tarjan, "union-find" with path halving).
struct VertexUnion {
    parent: Vec<u32>,
}

impl VertexUnion {
    fn root(&mut self, mut of: u32) -> u32 {
        while self.parent[of as usize] != of {
            let above = self.parent[self.parent[of as usize] as usize];
            self.parent[of as usize] = above;
            of = above;
        }
        of
    }

    fn merge(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

/// Maximum distance between two borders that form a gap, mm: about a pixel of a scan. Borders farther apart are a slot
/// of the panel.
const MAX_GAP_MM: f64 = 0.5;
/// Minimum width of a gap that is refused, mm; a narrower gap hides less than a tenth of a pixel.
pub const HARMLESS_GAP_MM: f64 = 0.05;
/// Cosine of the maximum angle between two borders of a gap.
const MIN_PARALLEL_COSINE: f64 = 0.97;
/// Maximum angle between faces that approximate a curved surface, rad; faces at a larger angle meet at an edge of the
/// panel. A real edge with a smaller angle is treated as coarse triangles, which a person reviews.
const MAX_SMOOTH_ANGLE_RAD: f64 = 0.55;

/// The edges of a part.
pub struct PartEdges {
    /// Each edge once, by its two vertices.
    pub all: Vec<[u32; 2]>,
    /// The edges with one triangle; empty if the part is watertight.
    pub borders: Vec<[u32; 2]>,
    /// Maximum approximate distance of the triangles from the curved surface that they replace, mm.
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

/// Estimates the distance of two triangles from the curved surface that they replace: an arc over a facet of the width
/// L, at an angle θ to the next facet, rises by θ L / 8.
fn facet_error_mm(part: &Part, edge: [u32; 2], triangles: [u32; 2]) -> f64 {
    let areas = triangles.map(|index| part.area_vector(&part.triangles[index as usize]));
    let [a, b] = edge.map(|corner| part.vertices[corner as usize]);
    let length_mm = (b - a).norm();
    let [first, second] = areas;
    // The triangles of one surface may list their vertices in either direction.
    let angle_rad = first.angle(&second);
    let angle_rad = angle_rad.min(std::f64::consts::PI - angle_rad);
    if length_mm == 0.0 || !angle_rad.is_finite() || angle_rad > MAX_SMOOTH_ANGLE_RAD {
        return 0.0;
    }
    let width_mm = 2.0 * first.norm().min(second.norm()) / length_mm;
    angle_rad * width_mm / 8.0
}

/// Refuses a part with gaps: borders beside each other.
fn check_gaps(part: &Part, borders: &[[u32; 2]]) -> Result<(), NominalError> {
    let cell = |point: &Point3<f64>| [0, 1, 2].map(|axis| (point[axis] / MAX_GAP_MM).floor() as i64);
    let mut middles: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (index, border) in borders.iter().enumerate() {
        middles.entry(cell(&edge_middle(part, border))).or_default().push(index);
    }
    let (mut widest, mut count) = (None::<(f64, Point3<f64>)>, 0);
    for (index, border) in borders.iter().enumerate() {
        let [a, b] = border.map(|corner| part.vertices[corner as usize]);
        let along = b - a;
        let steps = (along.norm() / MAX_GAP_MM).ceil().max(1.0) as usize;
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

/// Returns the width of the gap between the centre of a border and another border that begins at `from` and extends
/// along `along`; `None` if they are not beside each other, or the gap is harmless.
fn gap_mm(part: &Part, border: &[u32; 2], (from, along): (&Point3<f64>, &Vector3<f64>)) -> Option<f64> {
    let [a, b] = border.map(|corner| part.vertices[corner as usize]);
    let is_parallel = (b - a).dot(along).abs() >= MIN_PARALLEL_COSINE * (b - a).norm() * along.norm();
    let away = nalgebra::center(&a, &b) - from;
    let share = away.dot(along) / along.norm_squared();
    let width_mm = (away - along * share).norm();
    let is_beside = is_parallel && (0.0..=1.0).contains(&share);
    (is_beside && (HARMLESS_GAP_MM..=MAX_GAP_MM).contains(&width_mm)).then_some(width_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::files::read_mesh;

    /// A rectangle of 2 × 1 as one triangle in each of two objects, `skin` and `rib`; `rib` also has a triangle far
    /// away.
    const OBJ: &str = "o skin\nv 0 0 0\nv 2 0 0\nv 2 1 0\nf 1 2 3\no rib\nv 0 0 0.001\nv 2 1 0\nv 0 1 0\nf 4 5 6\n\
                       v 9 9 9\nv 9 8 9\nv 8 9 9\nf 7 8 9\n";

    fn choose(text: &str, unit: Option<LengthUnit>, name: Option<&str>) -> Result<Part, NominalError> {
        Part::choose(read_mesh(text.as_bytes()).expect("a mesh"), unit, name)
    }

    #[test]
    fn a_unit_is_never_guessed() {
        let words = choose(OBJ, None, None).expect_err("no unit").to_string();
        assert!(
            words.contains("9.00 × 9.00 × 9.00 mm with --unit mm, 229 × 229 × 229 mm with --unit in, 9000 ×"),
            "{words}"
        );
        let stated = format!("# unit: mm\n{OBJ}");
        let words = choose(&stated, Some(LengthUnit::Inch), None).expect_err("two").to_string();
        assert!(words.contains("states the unit mm, but --unit is in"), "{words}");
        let words = choose(&OBJ.replace("2 1 0", "2e9 1 0"), Some(LengthUnit::Metre), None)
            .expect_err("2e12 mm")
            .to_string();
        assert!(
            words.contains("extends 2000000000000 mm from its origin (limits 20000 mm and 200000 mm)"),
            "{words}"
        );
        let inches = choose(OBJ, Some(LengthUnit::Inch), Some("skin")).expect("a part");
        assert!((inches.area_mm2() - 25.4 * 25.4).abs() < 1e-9, "{}", inches.area_mm2());
    }

    #[test]
    fn one_of_several_parts_must_be_named() {
        let mm = Some(LengthUnit::Millimetre);
        let words = choose(OBJ, mm, None).expect_err("three").to_string();
        assert!(words.contains("has 3 parts that do not touch: \"rib:1\" (2.00 × 1.00 × 0.00 mm"), "{words}");
        assert!(words.contains("\"skin\"") && words.contains("\"rib:2\" (1.00 × 1.00 × 0.00"), "{words}");
        let words = choose(OBJ, mm, Some("door")).expect_err("none").to_string();
        assert!(words.contains("no part \"door\"; its parts are: \"rib:1\""), "{words}");
        let far = choose(OBJ, mm, Some("rib:2")).expect("it exists");
        assert!((far.area_mm2() - 0.5).abs() < 1e-9 && far.vertices.len() == 3);
    }

    /// Expected values, calculated by hand: the triangle of 2 × 1 mm is in the search box, which extends from −1 to 3
    /// mm. Read in inches it is 51 mm long, more than four times the box. Shifted by 3 mm, its centre is at 4 mm,
    /// outside of the box.
    #[test]
    fn another_unit_or_place_is_not_in_the_search_box() {
        let place = |by_mm: f64| Rigid::from_isometry_unchecked(nalgebra::Isometry3::translation(by_mm, 0.0, 0.0));
        let search_box_mm = [[-1.0; 3], [3.0; 3]];
        let part = |unit| choose(OBJ, Some(unit), Some("skin")).expect("a part");
        assert_eq!(part(LengthUnit::Millimetre).check_in_search_box(&place(0.0), search_box_mm), Ok(()));
        for (unit, by_mm) in [(LengthUnit::Inch, -25.0), (LengthUnit::Millimetre, 3.0)] {
            let words =
                part(unit).check_in_search_box(&place(by_mm), search_box_mm).expect_err("elsewhere").to_string();
            assert!(words.contains("search box") && words.contains("check the unit"), "{words}");
        }
    }

    /// If the file has no objects, the two triangles have a common edge within a micrometre, and are one part.
    #[test]
    fn near_vertices_are_joined() {
        let text = OBJ.replace("o skin\n", "").replace("o rib\n", "").replace("f 7 8 9\n", "");
        let part = choose(&text, Some(LengthUnit::Millimetre), None).expect("one part");
        assert_eq!((part.vertices.len(), part.triangles.len(), part.name.as_str()), (4, 2, "1"));
    }
}
