//! A trial's scan: the panel among other objects, with glints, water or motion blur.
//!
//! A trial can have two properties of real scans of a dark plate on an adapter. A holder in the panel's own plane
//! touches the panel's edge, and large patches without points differ from scan to scan. A structured-light camera 1.1 m
//! above such a plate, 300×300 mm, measured points on 54 to 79 % of the plate. Large patches and whole corners were
//! missing, and the adapter at the upper edge caused no step of depth.

use super::TrialScene;
use super::contents::{MissingPatches, PrintedDiscs, SceneContents, sheet_points};
use crate::appearance::dry_and_wet;
use crate::cast::{CastView, PixelHit};
use crate::noise::{NormalStream, RandomPurpose, STEPS_PER_GRAY_LEVEL, ValueNoise, to_bytes};
use crate::scanner::{LATTICE_HALF_WIDTH_MM, Projector, draw_correlated_noise, measure_point};
use crate::scene;
use crate::scene::{Background, Slab, SlabHit};
use crate::shape::Shape;
use nalgebra::{Point3, Vector2};
use panelprep_base::geometry::{Base, Camera, OrganizedCloud, Panel, Pixel, Rigid};
use rand::RngExt;
use rayon::prelude::*;

impl TrialScene {
    pub(super) fn capture(
        &self,
        panel: Option<(&Shape, &Rigid<Base, Panel>)>,
        base_from_camera: &Rigid<Base, Camera>,
        SceneContents { slabs, glints, wet, smear_px, patches, marks }: SceneContents<'_>,
        shot: u64,
    ) -> OrganizedCloud<Camera> {
        let view = CastView::new(&self.camera, &self.rays, base_from_camera, panel);
        let projector = Projector::new(base_from_camera, panel, slabs);
        let seed = self.seed.child(RandomPurpose::Trial, 10 + shot);
        let (width, height) = (view.width(), view.height());
        let mut points = vec![[f32::NAN; 3]; width * height];
        let mut colors = vec![[0_u8; 3]; width * height];
        let correlated = draw_correlated_noise(seed, self.correlation_length_mm);
        let puddles = ValueNoise::new(seed.stream(RandomPurpose::Scan, 2), 14.0, LATTICE_HALF_WIDTH_MM);
        let (eye, turn) = (base_from_camera.origin().mm, base_from_camera.rotation());
        let pixel_rad = 1.0 / self.camera.fx_px;
        let rows = points.par_chunks_mut(width).zip(colors.par_chunks_mut(width)).enumerate();
        rows.for_each(|(row, (points, colors))| {
            let mut normal = NormalStream::new(seed.stream(RandomPurpose::ScanRow, row as u64));
            let mut chance = seed.stream(RandomPurpose::Trial, row as u64);
            let noise = self.pixels.row(seed, row, width);
            let mut line = vec![[0_u16; 3]; width];
            view.cast_row(row, |column, sight| {
                let ray = turn * sight.ray;
                let hits: Vec<SlabHit> =
                    slabs.iter().filter_map(|slab| slab.intersect(&eye, &ray, pixel_rad)).collect();
                let (sight, veil) = add_occluders(sight, &hits);
                let (dry, film) = dry_and_wet(&sight);
                line[column] = if wet { film } else { dry };
                let marked =
                    sight.panel.zip(marks).map_or(0.0, |(panel, marks)| marks.share(panel.place, panel.pixel_mm));
                if marked > 0.0 {
                    line[column] = PrintedDiscs::blend_paint(line[column], marked);
                }
                let glint = sight.panel.is_some_and(|panel| {
                    glints.iter().any(|(at, r)| (panel.place[0] - at[0]).hypot(panel.place[1] - at[1]) < *r)
                });
                if glint {
                    line[column] = [255 * STEPS_PER_GRAY_LEVEL as u16; 3];
                }
                let mut point = measure_point(&sight, &projector, &correlated, &mut normal);
                let lucky = chance.random::<f64>();
                if veil.is_some_and(|share| (0.05..0.95).contains(&share)) && lucky < 0.75 || glint && lucky < 0.8 {
                    point = None;
                } else if glint {
                    point = point.map(|p| p.map(|x| x * 0.996));
                }
                if let (true, Some(panel)) = (wet, sight.panel) {
                    let film = puddles.value_at(panel.place);
                    if film > -0.1 && lucky < 0.85 {
                        point = None;
                    } else if film > -0.4 {
                        point = point.map(|p| p.map(|x| x * (1.0 + 0.002 * film as f32)));
                    }
                }
                if marked < 0.5
                    && sight.panel.is_some_and(|panel| patches.is_some_and(|patches| patches.contains(panel.place)))
                {
                    point = None;
                }
                points[column] = point.unwrap_or([f32::NAN; 3]);
            });
            for (column, color) in colors.iter_mut().enumerate() {
                *color = to_bytes(blur_pixel(&line, column, smear_px), noise, column);
            }
        });
        let scale = self.scale[usize::from(shot > 0)];
        match OrganizedCloud::new(width, height, points, colors) {
            Ok(cloud) if scale == 0.0 => cloud,
            Ok(cloud) => cloud.scaled_along_rays(|_| 1.0 + scale),
            Err(error) => unreachable!("the cloud must have one point and one colour per pixel: {error}"),
        }
    }
}

/// Returns the mean of a pixel and its neighbours along the row: the motion blur.
fn blur_pixel(line: &[[u16; 3]], column: usize, smear_px: usize) -> [u16; 3] {
    let (from, to) = (column.saturating_sub(smear_px / 2), (column + smear_px / 2).min(line.len() - 1));
    let count = (to - from + 1) as u32;
    std::array::from_fn(|channel| {
        (line[from..=to].iter().map(|c| u32::from(c[channel])).sum::<u32>() / count) as u16
    })
}

/// Adds slabs in front of and behind the panel to a pixel. Returns the pixel, and the fraction of the pixel that the
/// nearest slab in front of the panel covers.
fn add_occluders(mut sight: PixelHit, hits: &[SlabHit]) -> (PixelHit, Option<f64>) {
    let panel_mm = sight.panel.map_or(f64::INFINITY, |panel| panel.depth_mm);
    let paint = |under: [f64; 3], slab: &SlabHit| {
        std::array::from_fn(|channel| under[channel] + slab.share * (slab.color[channel] - under[channel]))
    };
    let mut veil: Option<f64> = None;
    // The farthest slab is drawn first, so that near slabs cover far ones.
    let mut sorted: Vec<&SlabHit> = hits.iter().collect();
    sorted.sort_by(|a, b| b.depth_mm.total_cmp(&a.depth_mm));
    for slab in sorted {
        let behind = slab.depth_mm > panel_mm;
        let farther = sight.background.depth_mm.is_some_and(|depth_mm| depth_mm < slab.depth_mm);
        if behind && farther {
            continue;
        }
        if !behind {
            veil = Some(slab.share);
            // A pixel that a slab covers partly has the depth of one of the two surfaces, and the mixed colour.
            if slab.share < 0.5 {
                continue;
            }
            sight.panel = None;
        }
        let color = paint(sight.background.color, slab);
        sight.background = if slab.share >= 0.5 {
            Background { depth_mm: Some(slab.depth_mm), cos_incidence: slab.cos_incidence, color }
        } else {
            Background { color, ..sight.background }
        };
    }
    (sight, veil)
}

/// Half of the holder's size along and across the panel's edge, mm.
const HOLDER_HALF_MM: [f64; 2] = [32.0, 45.0];
/// Distance of the holder behind the panel's surface, mm: so small that the scan shows no step of depth.
const HOLDER_DISTANCE_MM: f64 = 0.15;
/// Width of the part of the holder under the panel's edge, mm.
const HOLDER_UNDER_MM: f64 = 1.5;
/// Width of the area beside the holder that a person marks, mm.
const MARKED_MARGIN_MM: f64 = 6.0;
/// Width of the area that a person marks on each side of the panel's edge, mm.
const MARKED_ACROSS_MM: f64 = 9.0;
/// Grey level of the holder.
const HOLDER_GRAY: f64 = 120.0;
/// Approximate size of a patch without points, mm: the lattice spacing of the noise from which the patches are made.
const PATCH_MM: f64 = 55.0;
/// Standard deviation of the corners of the outline that a person draws, px.
const DRAWING_ERROR_PX: f64 = 1.0;

/// A straight side of the panel's outline on the sheet: its middle, the directions along the side and outwards, and its
/// length, mm.
struct PanelSide {
    centre: Vector2<f64>,
    direction: Vector2<f64>,
    outward_direction: Vector2<f64>,
}

impl TrialScene {
    /// Returns the same trial with a holder at the panel's longest side, which moves with the panel.
    pub fn with_holder(self) -> TrialScene {
        TrialScene { is_held: true, ..self }
    }

    /// Returns the same trial with this fraction of the points missing, 0…1, in patches that differ from scan to scan.
    pub fn with_missing_patches(self, missing: f64) -> TrialScene {
        TrialScene { missing_share: missing, ..self }
    }

    /// Returns the patches without points of one scan.
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

    /// Returns the same trial with marks on the panel.
    pub fn with_marks(self) -> TrialScene {
        let marks = Some(PrintedDiscs::random_on_panel(&self.taught, self.seed.stream(RandomPurpose::Trial, 60)));
        TrialScene { taught_marks: marks.clone(), present_marks: marks, ..self }
    }

    /// Returns the same trial with marks on the taught panel, and their mirror image on the panel that is present.
    pub(super) fn with_mirrored_marks(self) -> TrialScene {
        let marked = self.with_marks();
        TrialScene { present_marks: marked.taught_marks.as_ref().map(PrintedDiscs::mirrored_discs), ..marked }
    }

    /// Returns the same trial with a camera whose smooth error is correlated over this distance, mm.
    pub fn with_correlated_error(self, alike_mm: f64) -> TrialScene {
        TrialScene { correlation_length_mm: Some(alike_mm), ..self }
    }

    /// Returns the same trial with a camera that measures distances too long by these fractions, at teaching and now.
    pub fn with_scale_error(self, scale: [f64; 2]) -> TrialScene {
        TrialScene { scale, ..self }
    }

    /// Returns the holder of a panel at this pose: at the panel's longest side, or at the second longest side if the
    /// holder was moved.
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

    /// Returns the areas around the holder that a person marks in the taught scan's picture.
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

    /// Returns the outline as a person would draw it in the taught scan's picture.
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

/// Returns the sides of a panel, the longest side first.
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
    use crate::scanner::tests::camera_pose_before_plate;
    use crate::scene::Slab;
    use nalgebra::{Point3, Vector3};
    use panelprep_base::geometry::{Pixel, Point};

    /// Returns the fraction of the pixels without a point in a column, among these rows.
    fn missing_fraction(scan: &OrganizedCloud<Camera>, column: usize, rows: std::ops::Range<usize>) -> f64 {
        let count = rows.len() as f64;
        rows.filter(|&row| scan.point(column, row).is_none()).count() as f64 / count
    }

    /// Expected values, calculated by hand as in `scanner` for an object of ±40 mm, 600 mm in front of the lens and 100
    /// mm in front of the plate. On the left the object hides the plate to x = −46.67 mm, and its shadow extends to
    /// −65.61 mm: 18.95 mm or 48.3 px; equation (1) there gives 18.5 mm. On the right there is no shadow. Vertically,
    /// at x = 0, the light ends 0.30769 · 698.44 = 214.9 mm from the middle.
    #[test]
    fn an_object_in_front_of_a_wall_casts_a_shadow_away_from_the_projector() {
        let trial = TrialScene::good_scene(1, 1);
        let thing = Slab::facing(Point3::new(565.0, 0.0, 360.0), -Vector3::x(), 0.0, [40.0, 40.0], [100.0; 3]);
        let scan = trial.capture(
            None,
            &camera_pose_before_plate(),
            SceneContents { slabs: &[thing], ..SceneContents::default() },
            0,
        );
        let pixel = |x: f64, y: f64, z: f64| -> Pixel {
            trial.camera.project(Point::<Camera>::at(x, y, z)).expect("before the lens")
        };
        let (left, right) = (pixel(-40.0, 0.0, 600.0).u, pixel(40.0, 0.0, 600.0).u);
        let rows = 560..640;
        // Only columns between the fixture's posts, because the posts have their own shadows.
        let dark: Vec<usize> = (790..1_160).filter(|&u| missing_fraction(&scan, u, rows.clone()) > 0.9).collect();
        let shadow = (pixel(-65.61, 0.0, 700.0).u, left);
        assert!((shadow.1 - shadow.0 - 48.3).abs() < 0.3, "{shadow:?}");
        assert!((dark.len() as f64 - (shadow.1 - shadow.0)).abs() <= 1.0, "{} columns", dark.len());
        assert!((dark[0] as f64 - shadow.0).abs() <= 1.0 && dark[dark.len() - 1] as f64 <= left, "{dark:?}");
        assert!(missing_fraction(&scan, right.ceil() as usize + 2, rows.clone()) < 0.1);
        assert!(missing_fraction(&scan, 972, rows) < 0.1, "the thing itself is lit");
        // The plate has its colour also in the shadow, and above the projector's light.
        let colors = scan.picture();
        let gray = |column: usize, row: usize| colors.rgb[row * scan.width() + column][0];
        assert!(gray(dark[20], 600) > 150 && gray(972, 20) > 150);
        for (middle, sign) in [(214.9, 1.0), (-214.9, -1.0)] {
            let edge = pixel(0.0, middle, 700.0).v;
            let row = |off: f64| (edge + sign * off).round() as usize;
            assert!(
                (962..982).all(|u| missing_fraction(&scan, u, row(1.0)..row(1.0) + 1) == 1.0),
                "row {}",
                row(1.0)
            );
            let lit = (962..982).filter(|&u| scan.point(u, row(-1.0)).is_some()).count();
            assert!(lit > 16, "{lit} of 20 in row {}", row(-1.0));
        }
    }

    #[test]
    fn scans_of_trials_are_bit_equal_for_any_number_of_threads() {
        let trial = TrialScene::defective_scene(2, crate::SceneDefect::Hidden, 8);
        let scan = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let scan = pool.install(|| trial.scan());
            let bits: Vec<u32> = scan.raw_points_mm().as_flattened().iter().map(|mm| mm.to_bits()).collect();
            (bits, scan.picture())
        };
        assert!(scan(1) == scan(2));
    }

    /// A third of the points that a good scan has on the panel are missing. The holder continues the panel's surface
    /// beyond its edge, without a step.
    #[test]
    fn a_held_dark_panel_has_missing_patches_and_no_step_at_its_holder() {
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
