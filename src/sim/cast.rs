//! Determines what each pixel of a camera sees: panel or fixture, and the distance from the panel's edge, to a fraction
//! of a pixel.
//!
//! A pixel's ray is o + λ r, with r = (x, y, 1) in the camera's frame, so λ is the depth. It intersects the height
//! field at
//!     F(λ) = o_h + λ r_h − h(o_s + λ r_s, o_t + λ r_t) = 0,   F′ = r_h − ∂h/∂s r_s − ∂h/∂t r_t,           (1)
//! which Newton's method solves from the neighbour's depth. The surface continues smoothly beyond its outline, so the
//! distance d of the intersection from the outline changes its sign at the edge. With the gradient g of d in the
//! picture,
//!     edge = d / |g| px,                                                                                 (2)
//! and the fraction of the pixel that the panel covers is the part of a square pixel on the inner side of this straight
//! line.

use super::sanding::{Appearance, Sanding};
use super::scene;
use super::scene::Background;
use super::shape::Shape;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use panelprep_base::geometry::{Base, Camera, Frame, Panel, PinholeCamera, Pixel, Rigid};
use std::ops::Range;

/// The undistorted rays of a camera's pixels: exact at the nodes of a lattice, interpolated linearly between the nodes.
///
/// With the lenses of this cell the second derivative of the distortion is below 0.5. Therefore the error stays below
/// 0.5 · (8 px)² / (8 f) = 0.002 px.
#[derive(Debug, Clone)]
pub(super) struct Rays {
    columns: usize,
    nodes: Vec<[f64; 2]>,
}

const RAY_STEP_PX: usize = 8;

impl Rays {
    pub fn new(camera: &PinholeCamera) -> Self {
        let columns = camera.width_px.div_ceil(RAY_STEP_PX) + 1;
        let rows = camera.height_px.div_ceil(RAY_STEP_PX) + 1;
        let node = |index: usize| {
            let (column, row) = (index % columns * RAY_STEP_PX, index / columns * RAY_STEP_PX);
            let Some(ray) = camera.unproject::<Camera>(Pixel::at(column as f64, row as f64)) else {
                unreachable!("the distortion of the cell's lenses must be invertible in their whole pictures")
            };
            [ray.mm.x, ray.mm.y]
        };
        Rays { columns, nodes: (0..columns * rows).map(node).collect() }
    }

    /// Returns the nodes of the lattice along one row of the picture.
    fn row(&self, row: usize) -> Vec<[f64; 2]> {
        let (above, down) = (row / RAY_STEP_PX * self.columns, (row % RAY_STEP_PX) as f64 / RAY_STEP_PX as f64);
        (above..above + self.columns)
            .map(|i| interpolate(self.nodes[i], self.nodes[i + self.columns], down))
            .collect()
    }
}

#[inline]
fn interpolate(a: [f64; 2], b: [f64; 2], share: f64) -> [f64; 2] {
    [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
}

/// The intersection of a pixel's ray with the panel's surface, which is continued slightly beyond the panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct PanelHit {
    /// Position of the intersection on the sheet, mm.
    pub place: [f64; 2],
    /// Depth of the intersection in the camera's frame, mm.
    pub depth_mm: f64,
    /// Cosine of the angle between ray and normal.
    pub cos_incidence: f64,
    /// Outward normal in sheet coordinates.
    pub normal: Vector3<f64>,
    /// Distance from the panel's edge by (2), px, negative inside of the panel.
    pub edge_px: f64,
    /// The fraction of the pixel that the panel covers, 0…1.
    pub coverage: f64,
    /// The width of one pixel on the panel's surface, mm.
    pub pixel_mm: f64,
    /// The effect of sanding on the appearance at this position.
    pub appearance: Appearance,
}

/// Computes the fraction of a square pixel on the inner side of a straight edge. `edge_px` is the distance from the
/// pixel's centre to the edge, negative inside; `growth` is the unit vector across the edge. As a function of distance,
/// the density of the pixel's area is a trapezoid of the widths |g_u| and |g_v|.
fn covered_pixel_fraction(edge_px: f64, growth: Vector2<f64>) -> f64 {
    let (long, short) = (growth.abs().max(), growth.abs().min());
    let (reach, flat) = ((long + short) / 2.0, (long - short) / 2.0);
    let away = edge_px.abs();
    let beyond = if away >= reach {
        0.0
    } else if away <= flat {
        0.5 - away / long
    } else {
        (reach - away).powi(2) / (2.0 * long * short)
    };
    if edge_px > 0.0 { beyond } else { 1.0 - beyond }
}

/// The surfaces that one pixel shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelHit {
    /// The undistorted ray (x, y, 1) in the camera's frame.
    pub ray: Vector3<f64>,
    /// The panel at this pixel; present on the panel and up to `MAX_EDGE_REACH_PX` beside it.
    pub panel: Option<PanelHit>,
    /// The background behind or beside the panel.
    pub background: Background,
}

/// A camera at a pose in the cell, with an optional panel in its view.
pub(super) struct CastView<'a> {
    camera: &'a PinholeCamera,
    rays: &'a Rays,
    base_from_camera: Isometry3<f64>,
    panel: Option<PanelView<'a>>,
    sanding: Option<&'a Sanding>,
}

/// A panel in the view of a camera. A projector is treated as a camera.
pub(super) struct PanelView<'a> {
    shape: &'a Shape,
    /// The camera's centre and axes in sheet coordinates.
    origin: Point3<f64>,
    axes: [Vector3<f64>; 3],
    focal_px: [f64; 2],
    columns: Range<usize>,
    rows: Range<usize>,
}

/// Maximum distance from the panel's edge at which the ray of a pixel is intersected with the panel's surface, px.
const MAX_EDGE_REACH_PX: f64 = 3.0;

impl<'a> CastView<'a> {
    pub fn new<C: Frame>(
        camera: &'a PinholeCamera,
        rays: &'a Rays,
        base_from_camera: &Rigid<Base, C>,
        panel: Option<(&'a Shape, &Rigid<Base, Panel>)>,
    ) -> Self {
        let panel = panel.map(|(shape, base_from_panel)| {
            let camera_from_sheet =
                base_from_camera.isometry().inverse() * base_from_panel.isometry() * shape.panel_from_sheet();
            PanelView::new(camera, shape, &camera_from_sheet)
        });
        CastView { camera, rays, base_from_camera: *base_from_camera.isometry(), panel, sanding: None }
    }

    /// Returns the same view with the panel sanded.
    pub fn with_sanding(self, sanding: &'a Sanding) -> Self {
        CastView { sanding: Some(sanding).filter(|sanding| !sanding.is_empty()), ..self }
    }

    /// Returns the number of columns of the picture.
    pub fn width(&self) -> usize {
        self.camera.width_px
    }

    /// Returns the number of rows of the picture.
    pub fn height(&self) -> usize {
        self.camera.height_px
    }

    /// Returns the focal length along the picture's width, px.
    pub fn focal_px(&self) -> f64 {
        self.camera.fx_px
    }

    /// Calls `seen` for each pixel of a row, from left to right.
    pub fn cast_row(&self, row: usize, mut seen: impl FnMut(usize, PixelHit)) {
        let nodes = self.rays.row(row);
        let origin = Point3::from(self.base_from_camera.translation.vector);
        let base_axes = self.base_from_camera.rotation.to_rotation_matrix();
        let pixel_rad = 1.0 / self.camera.fx_px;
        let panel = self.panel.as_ref().filter(|panel| panel.rows.contains(&row));
        let mut depth_mm = None;
        for column in 0..self.camera.width_px {
            let node = column / RAY_STEP_PX;
            let [x, y] =
                interpolate(nodes[node], nodes[node + 1], (column % RAY_STEP_PX) as f64 / RAY_STEP_PX as f64);
            let ray = Vector3::new(x, y, 1.0);
            let hit = panel
                .filter(|panel| panel.columns.contains(&column))
                .and_then(|panel| panel.intersect_ray(ray, depth_mm));
            if let Some(hit) = hit {
                depth_mm = Some(hit.depth_mm);
            }
            let panel = hit.filter(|hit| hit.edge_px < MAX_EDGE_REACH_PX).map(|hit| match self.sanding {
                Some(sanding) => PanelHit { appearance: sanding.appearance_at(hit.place), ..hit },
                None => hit,
            });
            let background = scene::intersect_fixture(&origin, &(base_axes * ray), pixel_rad);
            seen(column, PixelHit { ray, panel, background });
        }
    }
}

impl<'a> PanelView<'a> {
    pub fn new(camera: &PinholeCamera, shape: &'a Shape, camera_from_sheet: &Isometry3<f64>) -> Self {
        let sheet_from_camera = camera_from_sheet.inverse();
        let (columns, rows) = bounds(camera, shape, camera_from_sheet);
        PanelView {
            shape,
            origin: Point3::from(sheet_from_camera.translation.vector),
            axes: [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| sheet_from_camera * axis),
            focal_px: [camera.fx_px, camera.fy_px],
            columns,
            rows,
        }
    }

    /// Returns whether this pixel may show the panel.
    pub fn is_candidate_pixel(&self, column: usize, row: usize) -> bool {
        self.columns.contains(&column) && self.rows.contains(&row)
    }

    /// Transforms a direction of the camera's frame to sheet coordinates.
    pub fn to_sheet_direction(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.axes[0] * direction.x + self.axes[1] * direction.y + self.axes[2] * direction.z
    }

    /// Returns the intersection of a ray (x, y, 1) with the surface by (1). The iteration starts at `guess_mm`, the
    /// depth of the neighbouring pixel; without it, at the plane of the sheet.
    pub fn intersect_ray(&self, ray: Vector3<f64>, guess_mm: Option<f64>) -> Option<PanelHit> {
        const STEPS: usize = 20;
        let r = self.to_sheet_direction(&ray);
        let o = &self.origin;
        let mut depth = guess_mm.unwrap_or(-o.z / r.z);
        for _ in 0..STEPS {
            let (s, t) = (o.x + depth * r.x, o.y + depth * r.y);
            let [height, slope_s, slope_t] = self.shape.height(s, t);
            let slope = r.z - slope_s * r.x - slope_t * r.y;
            // The ray meets the surface from behind or at a grazing angle: the panel's front is not visible.
            if slope > -0.02 * r.norm() {
                return None;
            }
            let step = (o.z + depth * r.z - height) / slope;
            depth -= step;
            if step.abs() < 1e-9 {
                let met = [o.x + depth * r.x, o.y + depth * r.y];
                return (depth > 0.0).then(|| self.surface_hit(met, depth, &r, [slope_s, slope_t]));
            }
        }
        None
    }

    fn surface_hit(&self, place: [f64; 2], depth: f64, r: &Vector3<f64>, slopes: [f64; 2]) -> PanelHit {
        let across = Vector3::new(-slopes[0], -slopes[1], 1.0);
        let (distance, growth) = self.shape.outline().distance(Vector2::new(place[0], place[1]));
        // The derivative of the intersection's position on the sheet with respect to the pixel.
        let per_px = |axis: usize| {
            let step = self.axes[axis] * (depth / self.focal_px[axis]);
            let moved = step - r * (across.dot(&step) / across.dot(r));
            growth.dot(&moved.xy())
        };
        let growth_px = Vector2::new(per_px(0), per_px(1)); // mm of distance to the outline per px
        let edge_px = distance / growth_px.norm();
        PanelHit {
            place,
            depth_mm: depth,
            cos_incidence: -across.dot(r) / (across.norm() * r.norm()),
            normal: across.normalize(),
            edge_px,
            coverage: covered_pixel_fraction(edge_px, growth_px.normalize()),
            pixel_mm: depth / self.focal_px[0],
            appearance: Appearance::UNTREATED,
        }
    }
}

/// Returns the ranges of columns and rows that may show the panel: those around its projected outline.
fn bounds(
    camera: &PinholeCamera,
    shape: &Shape,
    camera_from_sheet: &Isometry3<f64>,
) -> (Range<usize>, Range<usize>) {
    let everything = (0..camera.width_px, 0..camera.height_px);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for place in shape.outline().polyline(10.0) {
        let point = camera_from_sheet * Point3::new(place.x, place.y, shape.height(place.x, place.y)[0]);
        // A lens model is valid only near its picture. If the panel extends far outside, the whole picture is searched.
        let wide = point.x.abs().max(point.y.abs()) > 1.2 * point.z;
        let Some(pixel) = camera.project(panelprep_base::geometry::Point::<Camera>::new(point)).filter(|_| !wide)
        else {
            return everything;
        };
        for (axis, px) in [pixel.u, pixel.v].into_iter().enumerate() {
            (low[axis], high[axis]) = (low[axis].min(px), high[axis].max(px));
        }
    }
    let span = |axis: usize, size: usize| {
        let clip = |px: f64| px.clamp(0.0, size as f64) as usize;
        clip((low[axis] - MAX_EDGE_REACH_PX - 2.0).floor())..clip((high[axis] + MAX_EDGE_REACH_PX + 3.0).ceil())
    };
    (span(0, camera.width_px), span(1, camera.height_px))
}

#[cfg(test)]
mod tests {
    use super::super::noise::Seed;
    use super::super::scene;
    use super::*;

    /// Projects points of the panel with the camera model: the nearest pixel must see the same point. The distance to
    /// the edge in the picture must agree with the projected distance to a hundredth of a pixel.
    #[test]
    fn a_pixel_sees_the_point_that_projects_onto_it() {
        let camera = scene::scanner(2);
        let rays = Rays::new(&camera);
        let shape = Shape::taught(Seed(5));
        let base_from_camera = scene::base_from_camera();
        let view = CastView::new(&camera, &rays, &base_from_camera, Some((&shape, &scene::nominal())));
        for place in [[0.0, 0.0], [-120.0, 60.0], [130.0, -80.0]] {
            let pixel = camera
                .project(base_from_camera.inverse() * (scene::nominal() * shape.point(place)))
                .expect("in front");
            let mut found = None;
            view.cast_row(pixel.v.round() as usize, |column, sight| {
                if column == pixel.u.round() as usize {
                    found = sight.panel;
                }
            });
            let found = found.expect("the panel is seen");
            let (du, dv) = (pixel.u.round() - pixel.u, pixel.v.round() - pixel.v);
            let moved = (found.place[0] - place[0]).hypot(found.place[1] - place[1]);
            let expected = du.hypot(dv) * found.pixel_mm;
            assert!(moved < 1.4 * expected + 0.01 && moved > 0.9 * expected - 0.01, "{moved} mm for {expected} mm");
        }
    }

    /// Expected fractions, calculated by hand. A vertical edge a quarter of a pixel from the centre: ¾. A diagonal edge
    /// through a corner of the pixel, at the distance √½: the whole pixel. A diagonal edge at half of this distance
    /// cuts off a triangle of base √½ and height √⅛: ⅛.
    #[test]
    fn covered_fractions_agree_with_hand_calculation() {
        let diagonal = Vector2::new(1.0, -1.0).normalize();
        assert!((covered_pixel_fraction(-0.25, Vector2::x()) - 0.75).abs() < 1e-12);
        assert!((covered_pixel_fraction(0.25, Vector2::y()) - 0.25).abs() < 1e-12);
        assert!((covered_pixel_fraction(-0.5_f64.sqrt(), diagonal) - 1.0).abs() < 1e-12);
        assert!((covered_pixel_fraction(-0.125_f64.sqrt(), diagonal) - 0.875).abs() < 1e-12);
        assert!((covered_pixel_fraction(0.0, diagonal) - 0.5).abs() < 1e-12);
    }

    /// The sum of all pixels' fractions is the area of the projected outline: the mean error of the edge over its
    /// length is below 0.01 px.
    #[test]
    fn the_edge_lies_on_the_projected_outline() {
        let camera = scene::scanner(2);
        let rays = Rays::new(&camera);
        let shape = Shape::taught(Seed(5));
        let base_from_camera = scene::base_from_camera();
        let view = CastView::new(&camera, &rays, &base_from_camera, Some((&shape, &scene::nominal())));
        let project = |p: &Vector2<f64>| {
            camera.project(base_from_camera.inverse() * (scene::nominal() * shape.point([p.x, p.y])))
        };
        let outline: Vec<Pixel> = shape.outline().polyline(0.2).iter().filter_map(project).collect();
        let length_px: f64 = outline.windows(2).map(|pair| pair[0].distance_px(pair[1])).sum();
        let mut shares = vec![0.0; camera.height_px];
        for (row, share) in shares.iter_mut().enumerate() {
            view.cast_row(row, |_, sight| *share += sight.panel.map_or(0.0, |panel| panel.coverage));
        }
        let area_px2 = panelprep_base::geometry::polygon::signed_area_px2(&outline).abs();
        let error_px = (shares.iter().sum::<f64>() - area_px2) / length_px;
        assert!(length_px > 1_000.0 && error_px.abs() < 0.01, "{error_px} px");
        // In each row away from corners, the sum of the pixels' fractions is the length of the row inside of the
        // outline.
        for row in [240, 300, 360] {
            let crossings: Vec<f64> = (0..outline.len())
                .map(|i| (outline[i], outline[(i + 1) % outline.len()]))
                .filter(|(a, b)| (a.v > f64::from(row)) != (b.v > f64::from(row)))
                .map(|(a, b)| a.u + (f64::from(row) - a.v) / (b.v - a.v) * (b.u - a.u))
                .collect();
            let inside_px = (crossings[0] - crossings[1]).abs();
            let error_px = shares[row as usize] - inside_px;
            assert!(crossings.len() == 2 && error_px.abs() < 0.02, "row {row}: {error_px} px");
        }
    }
}
