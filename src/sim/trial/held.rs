//! Properties of real scans of a dark plate on an adapter: a holder in the panel's own plane that touches its edge,
//! and large patches without points, which differ from scan to scan.
//!
//! A structured-light camera 1.1 m above such a plate, 300×300 mm, measured points on 54 to 79 % of the plate.
//! Large patches and whole corners were missing, and the adapter at the upper edge caused no step of depth.

use super::TrialScene;
use super::contents::{MissingPatches, PrintedDiscs, sheet_points};
use crate::fixture::Slab;
use crate::noise::{NormalStream, RandomPurpose, ValueNoise};
use crate::scanner::LATTICE_HALF_WIDTH_MM;
use crate::scene;
use crate::shape::Shape;
use nalgebra::{Point3, Vector2};
use panelprep_base::geometry::{Base, Panel, Pixel, Rigid};

/// Half the holder's size along and across the panel's edge, mm.
const HOLDER_HALF_MM: [f64; 2] = [32.0, 45.0];
/// Distance of the holder behind the panel's surface, mm: so small that the scan shows no step of depth;
/// `HOLDER_UNDER_MM` is how far the holder reaches under the panel's edge.
const HOLDER_DISTANCE_MM: f64 = 0.15;
const HOLDER_UNDER_MM: f64 = 1.5;
/// Width that a person marks beside the holder, mm; `MARKED_ACROSS_MM` is the width on each side of the edge.
const MARKED_MARGIN_MM: f64 = 6.0;
const MARKED_ACROSS_MM: f64 = 9.0;
/// Grey level of the holder.
const HOLDER_GRAY: f64 = 120.0;
/// Size of a patch without points, mm.
const PATCH_MM: f64 = 55.0;
/// Error of a corner of the outline that a person draws, px, one standard deviation.
const DRAWING_ERROR_PX: f64 = 1.0;

/// A straight side of the panel's outline on its sheet: its middle, the directions along the side and outwards, and
/// its length, mm.
struct PanelSide {
    centre: Vector2<f64>,
    direction: Vector2<f64>,
    outward_direction: Vector2<f64>,
}

impl TrialScene {
    /// Returns the same panel with a holder at its longest side, which moves with the panel.
    pub fn with_holder(self) -> TrialScene {
        TrialScene { is_held: true, ..self }
    }

    /// Returns the same panel with this share of points missing, 0…1, in patches that differ from scan to scan.
    pub fn with_missing_patches(self, missing: f64) -> TrialScene {
        TrialScene { missing_share: missing, ..self }
    }

    /// The areas without points in a scan.
    pub(super) fn missing_patches(&self, shot: u64) -> Option<MissingPatches> {
        if self.missing_share <= 0.0 {
            return None;
        }
        let noise =
            ValueNoise::new(self.seed.stream(RandomPurpose::Trial, 40 + shot), PATCH_MM, LATTICE_HALF_WIDTH_MM);
        let mut levels: Vec<f64> = sheet_points(&self.taught).into_iter().map(|at| noise.value_at(at)).collect();
        levels.sort_by(f64::total_cmp);
        let below = *levels.get((self.missing_share * levels.len() as f64) as usize)?;
        Some(MissingPatches { noise, threshold: below })
    }

    /// Returns the same panel with marks on it.
    pub fn with_marks(self) -> TrialScene {
        let marks = Some(PrintedDiscs::random_on_panel(&self.taught, self.seed.stream(RandomPurpose::Trial, 60)));
        TrialScene { taught_marks: marks.clone(), present_marks: marks, ..self }
    }

    /// Returns the same panel with marks on it, but with the mirrored marks on the panel that is present.
    pub(super) fn with_mirrored_marks(self) -> TrialScene {
        let marked = self.with_marks();
        TrialScene { present_marks: marked.taught_marks.as_ref().map(PrintedDiscs::mirrored_discs), ..marked }
    }

    /// Returns the same panel, scanned by a camera with a smooth error that is correlated within squares of this side,
    /// mm.
    pub fn with_correlated_error(self, alike_mm: f64) -> TrialScene {
        TrialScene { correlation_length_mm: Some(alike_mm), ..self }
    }

    /// Returns the same panel, scanned by a camera that measures distances too long by these fractions, at teaching
    /// and now.
    pub fn with_scale_error(self, scale: [f64; 2]) -> TrialScene {
        TrialScene { scale, ..self }
    }

    /// The holder of a panel at this pose: at the panel's longest side or, if the holder was moved, at the second
    /// longest side.
    pub(super) fn holder_of(&self, base_from_panel: &Rigid<Base, Panel>, is_moved: bool) -> Option<Slab> {
        if !self.is_held {
            return None;
        }
        let mut sides = sides(&self.taught);
        let side = if is_moved { sides.nth(1) } else { sides.next() }?;
        let place = |at: Vector2<f64>| self.taught.point([at.x, at.y]).mm;
        let (edge, inner) = (place(side.centre), place(side.centre - side.outward_direction * 10.0));
        let outward = (edge - inner).normalize();
        let along =
            (place(side.centre + side.direction * 10.0) - place(side.centre - side.direction * 10.0)).normalize();
        let mut normal = self.taught.normal([side.centre.x, side.centre.y]).mm;
        normal = (normal - outward * normal.dot(&outward)).normalize();
        let centre: Point3<f64> =
            edge + outward * (HOLDER_HALF_MM[1] - HOLDER_UNDER_MM) - normal * HOLDER_DISTANCE_MM;
        let rotation = nalgebra::Rotation3::from_matrix(&nalgebra::Matrix3::from_columns(&[
            along,
            normal.cross(&along),
            normal,
        ]));
        let in_panel = nalgebra::Isometry3::from_parts(centre.into(), rotation.into());
        let gray = HOLDER_GRAY;
        Some(Slab {
            base_from_slab: base_from_panel.isometry() * in_panel,
            half_mm: HOLDER_HALF_MM,
            color: [gray, gray, gray],
        })
    }

    /// The area that a person marks in the taught scan's picture because the holder touches the panel there.
    pub fn marked_holder_px(&self) -> Vec<[Pixel; 4]> {
        if !self.is_held {
            return Vec::new();
        }
        let Some(PanelSide { centre: middle, direction: along, outward_direction: outward }) =
            sides(&self.taught).next()
        else {
            return Vec::new();
        };
        let reach = HOLDER_HALF_MM[0] + MARKED_MARGIN_MM;
        let corner =
            |s: f64, t: f64| self.taught_px(middle + along * (s * reach) + outward * (t * MARKED_ACROSS_MM));
        vec![[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]]
    }

    /// Returns the outline as a person draws it on the taught scan's picture.
    pub fn outline_px(&self) -> Vec<Pixel> {
        let mut hand = NormalStream::new(self.seed.stream(RandomPurpose::Trial, 50));
        let off = |pixel: Pixel, hand: &mut NormalStream| {
            Pixel::at(pixel.u + DRAWING_ERROR_PX * hand.next(), pixel.v + DRAWING_ERROR_PX * hand.next())
        };
        self.taught.outline().corners().iter().map(|&corner| off(self.taught_px(corner), &mut hand)).collect()
    }

    fn taught_px(&self, at: Vector2<f64>) -> Pixel {
        let seen = scene::base_from_camera().inverse() * (scene::nominal() * self.taught.point([at.x, at.y]));
        self.camera.project(seen).unwrap_or_default()
    }
}

/// Returns the sides of a panel, the longest first.
fn sides(shape: &Shape) -> impl Iterator<Item = PanelSide> {
    let corners = shape.outline().corners();
    let mut sides: Vec<[Vector2<f64>; 2]> =
        corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| [*a, *b]).collect();
    sides.sort_by(|[a, b], [c, d]| (d - c).norm().total_cmp(&(b - a).norm()));
    sides.into_iter().map(|[a, b]| {
        let along = (b - a).normalize();
        PanelSide { centre: (a + b) / 2.0, direction: along, outward_direction: Vector2::new(along.y, -along.x) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A third of a good scan's points on the panel are missing, and the holder continues the panel's surface beyond
    /// its end, without a step.
    #[test]
    fn a_held_dark_panel_has_patches_and_no_step_at_its_holder() {
        let trial = TrialScene::flat_scene(3, 4).with_holder().with_missing_patches(0.33);
        let scan = trial.taught_scan();
        let whole = TrialScene::flat_scene(3, 4).with_holder().taught_scan();
        let on_panel = |cloud: &panelprep_base::geometry::OrganizedCloud<panelprep_base::geometry::Camera>| {
            let outline = TrialScene::flat_scene(3, 4).outline_px();
            let (width, height) = (cloud.width(), cloud.height());
            (0..width * height)
                .filter(|i| {
                    let pixel = Pixel::at((i % width) as f64, (i / width) as f64);
                    panelprep_base::geometry::polygon::contains(&outline, pixel) && cloud.point_at(*i).is_some()
                })
                .count() as f64
        };
        let share = on_panel(&scan) / on_panel(&whole);
        assert!((share - 0.67).abs() < 0.05, "{share}");
        let side = sides(&trial.taught).next().expect("a side");
        let depth = |way_mm: f64| {
            let pixel = trial.taught_px(side.centre + side.outward_direction * way_mm);
            let (column, row) = pixel.nearest_whole(whole.width(), whole.height()).expect("inside");
            whole.point(column, row).map(|point| point.mm.z)
        };
        let (inside, outside) = (depth(-6.0).expect("panel"), depth(6.0).expect("holder"));
        assert!((inside - outside).abs() < 12.0 * 0.6, "one plane: {inside} and {outside}");
    }
}
