//! The drawing of the simulated panel: its visible surface as triangles, cut along its outline. The drawing's frame is
//! the sheet's.

use super::shape::Shape;
use nalgebra::Vector2;
use panelprep_base::geometry::{LengthUnit, TriangleMesh};
use std::collections::HashMap;

/// Side of the lattice that is cut, mm: its chords deviate from the surface by less than a micrometre.
const STEP_MM: f64 = 1.0;
/// Half the length of the lattice, mm: more than any panel.
const HALF_MM: f64 = 260.0;
/// Halvings until a side's crossing with the outline is known to a nanometre.
const HALVINGS: usize = 30;

/// The lattice with the vertices that were made so far.
struct CutLattice<'a> {
    shape: &'a Shape,
    mesh: TriangleMesh,
    of_node: HashMap<[i32; 2], u32>,
    of_side: HashMap<[[i32; 2]; 2], u32>,
}

impl CutLattice<'_> {
    fn node_position([i, j]: [i32; 2]) -> Vector2<f64> {
        Vector2::new(f64::from(i) * STEP_MM, f64::from(j) * STEP_MM)
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

    /// Returns the vertex at which a side crosses the outline, from its node inside to its node outside.
    fn outline_crossing(&mut self, inside: [i32; 2], outside: [i32; 2]) -> u32 {
        let side = [inside, outside];
        if let Some(&known) = self.of_side.get(&side) {
            return known;
        }
        let (mut within, mut beyond) = (Self::node_position(inside), Self::node_position(outside));
        for _ in 0..HALVINGS {
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

/// Returns the surface of a panel, mm, in sheet coordinates.
pub(super) fn mesh(shape: &Shape) -> TriangleMesh {
    let mesh = TriangleMesh { unit: Some(LengthUnit::Millimetre), ..TriangleMesh::default() };
    let mut cut = CutLattice { shape, mesh, of_node: HashMap::new(), of_side: HashMap::new() };
    cut.mesh.begin_object("panel");
    let half = (HALF_MM / STEP_MM) as i32;
    for j in -half..half {
        for i in -half..half {
            cut.add([[i, j], [i + 1, j], [i + 1, j + 1]]);
            cut.add([[i, j], [i + 1, j + 1], [i, j + 1]]);
        }
    }
    cut.mesh
}
