//! A trial's scan: the panel among other objects, with glints, water or motion blur.

use super::TrialScene;
use super::contents::{PrintedDiscs, SceneContents};
use crate::appearance::dry_and_wet;
use crate::cast::{CastView, PixelHit};
use crate::fixture::{Background, SlabHit};
use crate::noise::{LEVEL, NormalStream, RandomPurpose, ValueNoise, to_bytes};
use crate::projector::Projector;
use crate::scanner::{LATTICE_HALF_WIDTH_MM, correlated_noise, measured};
use crate::shape::Shape;
use panelprep_base::geometry::{Base, Camera, OrganizedCloud, Panel, Rigid};
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
        let correlated = correlated_noise(seed, self.correlation_length_mm);
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
                    line[column] = [255 * LEVEL as u16; 3];
                }
                let mut point = measured(&sight, &projector, &correlated, &mut normal);
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
                *color = to_bytes(smear_pixel(&line, column, smear_px), noise, column);
            }
        });
        let scale = self.scale[usize::from(shot > 0)];
        match OrganizedCloud::new(width, height, points, colors) {
            Ok(cloud) if scale == 0.0 => cloud,
            Ok(cloud) => cloud.scaled_along_rays(|_| 1.0 + scale),
            Err(error) => unreachable!("one point and one colour a pixel were made: {error}"),
        }
    }
}

/// Returns the mean of a pixel and its neighbours along the row.
fn smear_pixel(line: &[[u16; 3]], column: usize, smear_px: usize) -> [u16; 3] {
    let (from, to) = (column.saturating_sub(smear_px / 2), (column + smear_px / 2).min(line.len() - 1));
    let count = (to - from + 1) as u32;
    std::array::from_fn(|channel| {
        (line[from..=to].iter().map(|c| u32::from(c[channel])).sum::<u32>() / count) as u16
    })
}

/// Adds slabs in front of and behind the panel to a pixel. Returns the pixel, and the share that the nearest slab
/// in front of the panel fills.
fn add_occluders(mut sight: PixelHit, hits: &[SlabHit]) -> (PixelHit, Option<f64>) {
    let panel_mm = sight.panel.map_or(f64::INFINITY, |panel| panel.depth_mm);
    let paint = |under: [f64; 3], slab: &SlabHit| {
        std::array::from_fn(|channel| under[channel] + slab.share * (slab.color[channel] - under[channel]))
    };
    let mut veil: Option<f64> = None;
    // Far slabs first, so that near slabs are painted over them.
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
            // A pixel that a slab half fills shows one of the two surfaces, with the slab's colour mixed over the
            // background.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Slab;
    use crate::projector::tests::before_the_plate;
    use nalgebra::{Point3, Vector3};
    use panelprep_base::geometry::{Pixel, Point};

    /// Returns the share of a column's pixels without a point, among these rows.
    fn missing(scan: &OrganizedCloud<Camera>, column: usize, rows: std::ops::Range<usize>) -> f64 {
        let count = rows.len() as f64;
        rows.filter(|&row| scan.point(column, row).is_none()).count() as f64 / count
    }

    /// Calculated by hand, as in `projector`: an object of ±40 mm, 600 mm in front of the lens and 100 mm in front of
    /// the plate, hides the plate to the right of x = −46.67 mm. Its shadow begins at −65.61: 18.95 mm or 48.3 px;
    /// equation (1) there gives 18.5 mm. On the right there is no shadow. Up and down, at x = 0, the light ends
    /// 0.30769 · 698.44 = 214.9 mm from the middle.
    #[test]
    fn a_thing_before_a_wall_throws_a_shadow_away_from_the_projector() {
        let trial = TrialScene::good_scene(1, 1);
        let thing = Slab::facing(Point3::new(565.0, 0.0, 360.0), -Vector3::x(), 0.0, [40.0, 40.0], [100.0; 3]);
        let scan = trial.capture(
            None,
            &before_the_plate(),
            SceneContents { slabs: &[thing], ..SceneContents::default() },
            0,
        );
        let pixel = |x: f64, y: f64, z: f64| -> Pixel {
            trial.camera.project(Point::<Camera>::at(x, y, z)).expect("before the lens")
        };
        let (left, right) = (pixel(-40.0, 0.0, 600.0).u, pixel(40.0, 0.0, 600.0).u);
        let rows = 560..640;
        // Columns between the fixture's posts, which have their own shadows.
        let dark: Vec<usize> = (790..1_160).filter(|&u| missing(&scan, u, rows.clone()) > 0.9).collect();
        let shadow = (pixel(-65.61, 0.0, 700.0).u, left);
        assert!((shadow.1 - shadow.0 - 48.3).abs() < 0.3, "{shadow:?}");
        assert!((dark.len() as f64 - (shadow.1 - shadow.0)).abs() <= 1.0, "{} columns", dark.len());
        assert!((dark[0] as f64 - shadow.0).abs() <= 1.0 && dark[dark.len() - 1] as f64 <= left, "{dark:?}");
        assert!(missing(&scan, right.ceil() as usize + 2, rows.clone()) < 0.1);
        assert!(missing(&scan, 972, rows) < 0.1, "the thing itself is lit");
        // The plate's colour is also seen in its shadow, and above the projector's light.
        let colors = scan.picture();
        let gray = |column: usize, row: usize| colors.rgb[row * scan.width() + column][0];
        assert!(gray(dark[20], 600) > 150 && gray(972, 20) > 150);
        for (middle, sign) in [(214.9, 1.0), (-214.9, -1.0)] {
            let edge = pixel(0.0, middle, 700.0).v;
            let row = |off: f64| (edge + sign * off).round() as usize;
            assert!((962..982).all(|u| missing(&scan, u, row(1.0)..row(1.0) + 1) == 1.0), "row {}", row(1.0));
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
}
