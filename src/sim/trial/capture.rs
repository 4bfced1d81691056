//! A trial's scan: the panel among things, with glints, water or smear.

use super::Trial;
use crate::geometry::{Base, Camera, OrganizedCloud, Rigid};
use crate::sim::appearance::dry_and_wet;
use crate::sim::cast::{Sight, View};
use crate::sim::clutter::{Met, Slab};
use crate::sim::fixture::Background;
use crate::sim::noise::{LEVEL, Normal, Purpose, ValueNoise, to_bytes};
use crate::sim::scanner::measured;
use rand::RngExt;
use rayon::prelude::*;

impl Trial {
    pub(super) fn capture(
        &self,
        view: &View<'_>,
        base_from_camera: &Rigid<Base, Camera>,
        (slabs, glints, wet, smear_px): (&[Slab], &[([f64; 2], f64)], bool, usize),
        shot: u64,
    ) -> OrganizedCloud<Camera> {
        let seed = self.seed.child(Purpose::Trial, 10 + shot);
        let (width, height) = (view.width(), view.height());
        let mut points = vec![[f32::NAN; 3]; width * height];
        let mut colors = vec![[0_u8; 3]; width * height];
        let lattice_mm = seed.stream(Purpose::Scan, 0).random_range(50.0..85.0);
        let correlated = ValueNoise::new(seed.stream(Purpose::Scan, 1), lattice_mm, 260.0);
        let puddles = ValueNoise::new(seed.stream(Purpose::Scan, 2), 14.0, 260.0);
        let (eye, turn) = (base_from_camera.origin().mm, base_from_camera.rotation());
        let pixel_rad = 1.0 / self.camera.fx_px;
        let rows = points.par_chunks_mut(width).zip(colors.par_chunks_mut(width)).enumerate();
        rows.for_each(|(row, (points, colors))| {
            let mut normal = Normal::new(seed.stream(Purpose::ScanRow, row as u64));
            let mut chance = seed.stream(Purpose::Trial, row as u64);
            let noise = self.pixels.row(seed, row, width);
            let mut line = vec![[0_u16; 3]; width];
            view.look_along_row(row, |column, sight| {
                let ray = turn * sight.ray;
                let met: Vec<Met> = slabs.iter().filter_map(|slab| slab.look(&eye, &ray, pixel_rad)).collect();
                let (sight, veil) = among(sight, &met);
                let (dry, film) = dry_and_wet(&sight);
                line[column] = if wet { film } else { dry };
                let glint = sight.panel.is_some_and(|panel| {
                    glints.iter().any(|(at, r)| (panel.place[0] - at[0]).hypot(panel.place[1] - at[1]) < *r)
                });
                if glint {
                    line[column] = [255 * LEVEL as u16; 3];
                }
                let mut point = measured(&sight, &correlated, &mut normal);
                let lucky = chance.random::<f64>();
                if veil.is_some_and(|share| (0.05..0.95).contains(&share)) && lucky < 0.75 || glint && lucky < 0.8 {
                    point = None;
                } else if glint {
                    point = point.map(|p| p.map(|x| x * 0.996));
                }
                if let (true, Some(panel)) = (wet, sight.panel) {
                    let film = puddles.at(panel.place);
                    if film > -0.1 && lucky < 0.85 {
                        point = None;
                    } else if film > -0.4 {
                        point = point.map(|p| p.map(|x| x * (1.0 + 0.002 * film as f32)));
                    }
                }
                points[column] = point.unwrap_or([f32::NAN; 3]);
            });
            for (column, color) in colors.iter_mut().enumerate() {
                *color = to_bytes(smeared(&line, column, smear_px), noise, column);
            }
        });
        match OrganizedCloud::new(width, height, points, colors) {
            Ok(cloud) => cloud,
            Err(error) => unreachable!("one point and one colour a pixel were made: {error}"),
        }
    }
}

/// The mean of a pixel and its neighbours along the row.
fn smeared(line: &[[u16; 3]], column: usize, smear_px: usize) -> [u16; 3] {
    let (from, to) = (column.saturating_sub(smear_px / 2), (column + smear_px / 2).min(line.len() - 1));
    let count = (to - from + 1) as u32;
    std::array::from_fn(|channel| {
        (line[from..=to].iter().map(|c| u32::from(c[channel])).sum::<u32>() / count) as u16
    })
}

/// What a pixel sees with slabs before and behind the panel; and the share that the nearest slab before it fills.
fn among(mut sight: Sight, met: &[Met]) -> (Sight, Option<f64>) {
    let panel_mm = sight.panel.map_or(f64::INFINITY, |panel| panel.depth_mm);
    let paint = |under: [f64; 3], slab: &Met| {
        std::array::from_fn(|channel| under[channel] + slab.share * (slab.color[channel] - under[channel]))
    };
    let mut veil: Option<f64> = None;
    // Far ones first, so that near ones are painted over them.
    let mut sorted: Vec<&Met> = met.iter().collect();
    sorted.sort_by(|a, b| b.depth_mm.total_cmp(&a.depth_mm));
    for slab in sorted {
        let behind = slab.depth_mm > panel_mm;
        let farther = sight.background.depth_mm.is_some_and(|depth_mm| depth_mm < slab.depth_mm);
        if behind && farther {
            continue;
        }
        if !behind {
            veil = Some(slab.share);
            // A pixel that is half slab shows one of the two, and the slab's colour over what is behind.
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
