//! A parameter point of a surface, and the values computed there.

use panelprep_base::geometry::{Panel, Point, Vector};

/// A point of a surface, given by its parameters; no unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Along the columns of the region, 0…1 inside the region.
    pub u: f64,
    /// Along the rows of the region, 0…1 inside the region.
    pub v: f64,
}

/// A point of a surface with its first derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointTangents {
    /// S, mm.
    pub point: Point<Panel>,
    /// S_u, mm.
    pub s_u: Vector<Panel>,
    /// S_v, mm.
    pub s_v: Vector<Panel>,
}

impl PointTangents {
    /// |S_u × S_v|: the surface area for a unit of u and v, mm².
    pub fn area_mm2(&self) -> f64 {
        self.s_u.mm.cross(&self.s_v.mm).norm()
    }
}

/// A point of a surface with its first and second derivatives, all mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// S, S_u, S_v.
    pub tangents: PointTangents,
    /// S_uu.
    pub s_uu: Vector<Panel>,
    /// S_uv.
    pub s_uv: Vector<Panel>,
    /// S_vv.
    pub s_vv: Vector<Panel>,
}
