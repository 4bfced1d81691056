//! The region as the camera sees it at the panel's present pose: the pixels that show the region, and the surface area
//! that each pixel shows.
//!
//! Each taught pixel of the region has a point P on the panel and represents a surface area in mm². The point is
//! transformed to the camera by  P_camera = camera_from_base · base_from_panel · P  (Eq. 4.6, 4.7) and projected to a
//! pixel by Eq. 3.11. The area is then assigned to the nearest pixel. If this pixel breaks, the assigned area is
//! treated as broken. Area is therefore measured on the curved panel, at the taught pose, and does not depend on the
//! present pose of the panel.
//!
//! If the panel appears larger than at teaching, some pixels between the projected ones have no assigned area; they
//! belong to the region as well. A gap of one pixel is closed, so the panel may appear up to twice as large.

use super::error::InspectError;
use nalgebra::Point2;
use opencv::core::{Mat, MatTraitConstManual};
use opencv::imgproc;
use panelprep_base::geometry::{
    ALL_NEIGHBOURS, Camera, Mask, Panel, PinholeCamera, Pixel, Point, RasterSize, Rigid, polygon,
};
use panelprep_cell::imaging::{ImagingError, with_operation};
use panelprep_cell::panel::{GridId, TaughtPanel};
use panelprep_cell::recipe;

/// Minimum fraction of a grid's surface in the picture, for the grid to be inspected; the rest is rounding at its
/// edges.
const MIN_SEEN_FRACTION: f64 = 0.99;

/// Minimum number of pixels of a break that both methods detect reliably; a smaller break may be missed because of its
/// blurred rim. `make bench-inspect` prints the miss rate as a function of the size.
const MIN_DETECTABLE_PX: f64 = 12.0;

/// Side of the squares over which the surface area of a pixel is averaged, px.
const AVERAGING_BLOCK_PX: usize = 16;

/// Minimum margin of the window around the region, px, so that the closing of the mask does not reach the edge of the
/// window.
const MIN_MARGIN_PX: usize = 2;

/// A rectangle of the picture, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

impl Window {
    /// Returns the size of the window.
    pub fn raster(&self) -> RasterSize {
        RasterSize { width: self.width, height: self.height }
    }
}

/// The surface area of a taught pixel, assigned to a pixel of the picture.
#[derive(Debug, Clone, Copy)]
struct Patch {
    grid: u32,
    /// Index of the pixel in the taught picture, row by row.
    taught: u32,
    area_mm2: f32,
    sanded: bool,
}

/// Defines which part of the taught region is inspected.
#[derive(Debug, Clone, Copy, Default)]
pub struct InspectedPart<'a> {
    /// Margin of the window around the region, px.
    pub margin_px: usize,
    /// Quadrilaterals of the taught picture that are excluded.
    pub masked_px: &'a [[[f64; 2]; 4]],
    /// Taught pixels that were sanded after the dry picture was captured.
    pub sanded: Option<&'a Mask>,
}

/// A grid in the camera picture.
#[derive(Debug, Clone)]
pub struct GridFootprint {
    /// Name of the grid.
    pub id: GridId,
    /// Surface area of the whole grid, mm².
    pub area_mm2: f64,
    /// Fraction of the grid that is in the picture and not masked, 0…1.
    pub seen_share: f64,
    /// Fraction of the grid that the recipe masks, 0…1.
    pub masked_share: f64,
    /// Area in the picture without information, mm²: overexposed, or hidden by a static reflection.
    pub lost_mm2: f64,
    /// The closed outline of the grid in the picture, px: curved for a curved panel or a lens with distortion.
    pub edge_px: Vec<Pixel>,
}

impl GridFootprint {
    /// Returns whether the whole grid is in the picture and not masked, even if parts of it contain no information.
    /// Otherwise the grid cannot pass.
    pub fn is_inspected(&self) -> bool {
        self.inspected_share() >= MIN_SEEN_FRACTION
    }

    fn inspected_share(&self) -> f64 {
        self.seen_share + if self.area_mm2 > 0.0 { self.lost_mm2 / self.area_mm2 } else { 0.0 }
    }

    /// Returns whether the recipe masks a part of the grid, and no part is excluded for another reason.
    pub fn is_only_masked(&self) -> bool {
        self.masked_share > 0.0 && self.inspected_share() + self.masked_share >= MIN_SEEN_FRACTION
    }
}

/// The region in the camera picture, with its grids.
#[derive(Debug, Clone)]
pub struct Footprint {
    width_px: usize,
    height_px: usize,
    /// Number of columns and rows of the taught picture.
    taught_px: [usize; 2],
    window: Window,
    /// For each pixel of the window, whether it belongs to the region.
    inside: Vec<bool>,
    /// The patches of the window's pixel `i` are `patches[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    patches: Vec<Patch>,
    grids: Vec<GridFootprint>,
}

impl Footprint {
    /// Projects the taught pixels of the region, except the excluded ones. The window is the bounding box of the
    /// projected pixels with a margin.
    pub(super) fn new(
        taught: &TaughtPanel,
        camera: &PinholeCamera,
        camera_from_panel: Rigid<Camera, Panel>,
        InspectedPart { margin_px, masked_px, sanded }: InspectedPart<'_>,
    ) -> Result<Self, InspectError> {
        let samples = region_samples(taught, masked_px, sanded);
        let mean_mm2 = mean_areas(&samples, taught.grids.len());
        let [mut whole_mm2, mut seen_mm2, mut masked_mm2] = [(); 3].map(|()| vec![0.0; mean_mm2.len()]);
        let mut held: Vec<(PixelPosition, Patch)> = Vec::with_capacity(samples.len());
        for Sample { grid, taught, point, area_mm2, masked, sanded } in samples {
            let area_mm2 = area_mm2.unwrap_or(mean_mm2[grid]);
            whole_mm2[grid] += area_mm2;
            if masked {
                masked_mm2[grid] += area_mm2;
                continue;
            }
            let pixel = point.and_then(|point| camera.project(camera_from_panel * point)); // Eq. 4.6, 4.7, 3.11
            if let Some((column, row)) = pixel.and_then(|px| px.nearest_whole(camera.width_px, camera.height_px)) {
                seen_mm2[grid] += area_mm2;
                held.push((
                    PixelPosition { row, column },
                    Patch { grid: grid as u32, taught: taught as u32, area_mm2: area_mm2 as f32, sanded },
                ));
            }
        }
        held.sort_by_key(|(place, _)| *place);
        let window =
            window_around(&held, camera, margin_px.max(MIN_MARGIN_PX)).ok_or(InspectError::RegionNotInPicture)?;
        let starts = patch_starts(&held, &window);
        let inside = closed(&window, |index| starts[index] < starts[index + 1])?;
        let share = |part_mm2: f64, index: usize| {
            if whole_mm2[index] > 0.0 { part_mm2 / whole_mm2[index] } else { 0.0 }
        };
        let grids = taught.grids.iter().enumerate().map(|(index, grid)| GridFootprint {
            id: grid.id,
            area_mm2: whole_mm2[index],
            seen_share: share(seen_mm2[index], index),
            masked_share: share(masked_mm2[index], index),
            lost_mm2: 0.0,
            edge_px: grid.edge.iter().filter_map(|&point| camera.project(camera_from_panel * point)).collect(),
        });
        Ok(Footprint {
            width_px: camera.width_px,
            height_px: camera.height_px,
            taught_px: [taught.mask.width, taught.mask.height],
            window,
            inside,
            grids: grids.collect(),
            starts,
            patches: held.into_iter().map(|(_, patch)| patch).collect(),
        })
    }

    /// Returns the region as a camera sees it with the panel at this pose, without the areas that the recipe masks.
    ///
    /// # Errors
    /// If the region is outside the picture.
    pub fn of_view(
        taught: &TaughtPanel,
        (camera, camera_from_panel): (&PinholeCamera, Rigid<Camera, Panel>),
        settings: &recipe::Inspect,
    ) -> Result<Self, InspectError> {
        let masked_px = &settings.masked_px();
        Footprint::new(taught, camera, camera_from_panel, InspectedPart { masked_px, ..InspectedPart::default() })
    }

    /// Returns the area of the smallest break that is reliably detected, mm², with the taught panel at its nominal
    /// pose.
    ///
    /// # Errors
    /// If the region is outside the picture.
    pub fn taught_detection_limit_mm2(
        taught: &TaughtPanel,
        settings: &recipe::Inspect,
    ) -> Result<f64, InspectError> {
        let nominal = taught.panel_from_camera.inverse();
        Ok(Footprint::of_view(taught, (&taught.camera, nominal), settings)?.detection_limit_mm2())
    }

    /// Returns the grids, row by row.
    pub fn grids(&self) -> &[GridFootprint] {
        &self.grids
    }

    /// Returns the pixels of the picture that belong to the region.
    pub fn region(&self) -> Mask {
        self.to_picture(|index| self.inside[index])
    }

    /// Returns for each pixel of the window whether it shows a place that was sanded after the dry picture. Pixels
    /// between such pixels are included.
    pub(super) fn sanded_pixels(&self) -> Vec<bool> {
        let own: Vec<Option<bool>> = (0..self.inside.len())
            .map(|index| {
                let patches = &self.patches[self.starts[index] as usize..self.starts[index + 1] as usize];
                (!patches.is_empty()).then(|| patches.iter().any(|patch| patch.sanded))
            })
            .collect();
        let raster = self.window.raster();
        let near = |index: usize| raster.neighbours(index, &ALL_NEIGHBOURS).any(|next| own[next] == Some(true));
        (0..own.len()).map(|index| own[index].unwrap_or_else(|| self.inside[index] && near(index))).collect()
    }

    /// Returns for each grid the fraction of its inspected area that was sanded after the dry picture.
    pub(super) fn sanded_fractions(&self) -> Vec<f64> {
        let mut areas = vec![(0.0, 0.0); self.grids.len()];
        for patch in &self.patches {
            let (sanded, all) = &mut areas[patch.grid as usize];
            *all += f64::from(patch.area_mm2);
            *sanded += if patch.sanded { f64::from(patch.area_mm2) } else { 0.0 };
        }
        areas.into_iter().map(|(sanded, all)| sanded / all.max(f64::MIN_POSITIVE)).collect()
    }

    /// Returns the broken area of each grid, mm², in the order of the grids, for a mask of broken pixels. The mask has
    /// the size of the picture.
    pub fn broken_mm2(&self, mask: &Mask) -> Vec<f64> {
        let mut broken_mm2 = vec![0.0; self.grids.len()];
        for index in 0..self.inside.len() {
            let (column, row) = self.pixel_position(index);
            if self.inside[index] && mask.contains(column, row) {
                self.add_area(index, &mut broken_mm2);
            }
        }
        broken_mm2
    }

    /// Returns the pixels of the taught picture that these pixels of the picture show. A place in the film picture is
    /// thereby converted to a place on the panel. The mask has the size of the picture. The taught pixels have exactly
    /// the surface area that [`Footprint::broken_mm2`] returns.
    pub fn taught_pixels(&self, mask: &Mask) -> Mask {
        let [width, height] = self.taught_px;
        let mut taught = Mask::all_outside(width, height);
        for index in 0..self.inside.len() {
            let (column, row) = self.pixel_position(index);
            if self.inside[index] && mask.contains(column, row) {
                let shown = &self.patches[self.starts[index] as usize..self.starts[index + 1] as usize];
                shown.iter().for_each(|patch| taught.inside[patch.taught as usize] = true);
            }
        }
        taught
    }

    /// Returns the area of the smallest break that is reliably detected on this panel from the position of the camera,
    /// mm²: the area of [`MIN_DETECTABLE_PX`] pixels where the resolution is coarsest. Because one of two neighbouring
    /// pixels may contain two taught pixels and the other none, the area is averaged over many pixels.
    pub fn detection_limit_mm2(&self) -> f64 {
        let across = self.window.width.div_ceil(AVERAGING_BLOCK_PX);
        let mut blocks = vec![(0.0, 0usize); across * self.window.height.div_ceil(AVERAGING_BLOCK_PX)];
        for index in (0..self.inside.len()).filter(|&index| self.inside[index]) {
            let (column, row) = (index % self.window.width, index / self.window.width);
            let (area_mm2, pixels) = &mut blocks[row / AVERAGING_BLOCK_PX * across + column / AVERAGING_BLOCK_PX];
            let patches = &self.patches[self.starts[index] as usize..self.starts[index + 1] as usize];
            *area_mm2 += patches.iter().map(|patch| f64::from(patch.area_mm2)).sum::<f64>();
            *pixels += 1;
        }
        let is_full = |block: &&(f64, usize)| 2 * block.1 >= AVERAGING_BLOCK_PX * AVERAGING_BLOCK_PX;
        let coarsest =
            blocks.iter().filter(is_full).map(|(area_mm2, pixels)| area_mm2 / *pixels as f64).reduce(f64::max);
        // A region with few pixels has no complete block.
        let all = self.inside.iter().filter(|inside| **inside).count().max(1) as f64;
        MIN_DETECTABLE_PX * coarsest.unwrap_or_else(|| self.region_mm2() / all)
    }

    /// Returns the pixels of the picture that belong to each grid. A pixel with patches of two grids belongs to the
    /// grid of its first patch.
    pub(super) fn grid_pixels(&self) -> Vec<(GridId, Vec<usize>)> {
        let mut held: Vec<(GridId, Vec<usize>)> = self.grids.iter().map(|grid| (grid.id, Vec::new())).collect();
        for index in 0..self.inside.len() {
            if let Some(patch) = self.patches[self.starts[index] as usize..self.starts[index + 1] as usize].first()
            {
                let (column, row) = self.pixel_position(index);
                held[patch.grid as usize].1.push(row * self.width_px + column);
            }
        }
        held
    }

    /// Returns the surface area of the region in the picture, mm².
    pub(super) fn region_mm2(&self) -> f64 {
        self.patches.iter().map(|patch| f64::from(patch.area_mm2)).sum()
    }

    /// Returns the surface area of some pixels of the window, mm².
    pub(super) fn surface_mm2(&self, pixels: impl Iterator<Item = usize>) -> f64 {
        let mut area_mm2 = vec![0.0; self.grids.len()];
        pixels.for_each(|index| self.add_area(index, &mut area_mm2));
        area_mm2.iter().sum()
    }

    /// Returns the average number of pixels for this surface area.
    pub(super) fn pixels_for_area(&self, area_mm2: f64) -> usize {
        let inside = self.inside.iter().filter(|inside| **inside).count() as f64;
        (area_mm2 * inside / self.region_mm2().max(f64::MIN_POSITIVE)) as usize
    }

    /// Subtracts the area of unseen pixels from the seen area of their grids.
    pub(super) fn subtract_unseen(&mut self, unseen: impl Fn(usize) -> bool) {
        let mut lost_mm2 = vec![0.0; self.grids.len()];
        for index in (0..self.inside.len()).filter(|&index| self.inside[index] && unseen(index)) {
            self.add_area(index, &mut lost_mm2);
        }
        for (grid, lost_mm2) in self.grids.iter_mut().zip(lost_mm2).filter(|(grid, _)| grid.area_mm2 > 0.0) {
            grid.seen_share -= lost_mm2 / grid.area_mm2;
            grid.lost_mm2 += lost_mm2;
        }
    }

    pub(super) fn window(&self) -> &Window {
        &self.window
    }

    /// Returns for each pixel of the window whether it belongs to the region, row by row.
    pub(super) fn region_pixels(&self) -> &[bool] {
        &self.inside
    }

    /// Adds the area of one pixel of the window to the area of its grids.
    pub(super) fn add_area(&self, index: usize, area_mm2: &mut [f64]) {
        for patch in &self.patches[self.starts[index] as usize..self.starts[index + 1] as usize] {
            area_mm2[patch.grid as usize] += f64::from(patch.area_mm2);
        }
    }

    /// Returns the column and the row of the picture for a pixel index of the window.
    pub(super) fn pixel_position(&self, index: usize) -> (usize, usize) {
        (self.window.left + index % self.window.width, self.window.top + index / self.window.width)
    }

    /// Returns the index in the window of a pixel of the picture; `None` outside of the window.
    pub(super) fn window_index(&self, column: usize, row: usize) -> Option<usize> {
        let (column, row) = (column.checked_sub(self.window.left)?, row.checked_sub(self.window.top)?);
        (column < self.window.width && row < self.window.height).then_some(row * self.window.width + column)
    }

    /// Converts a mask of the window to a mask of the whole picture.
    pub(super) fn to_picture(&self, inside: impl Fn(usize) -> bool) -> Mask {
        let mut mask = Mask::all_outside(self.width_px, self.height_px);
        for index in (0..self.inside.len()).filter(|&index| inside(index)) {
            let (column, row) = self.pixel_position(index);
            mask.inside[row * self.width_px + column] = true;
        }
        mask
    }
}

/// The position of a pixel in the picture; positions are sorted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct PixelPosition {
    row: usize,
    column: usize,
}

fn window_around(held: &[(PixelPosition, Patch)], camera: &PinholeCamera, margin_px: usize) -> Option<Window> {
    let (top, bottom) = (held.first()?.0.row, held.last()?.0.row);
    let left = held.iter().map(|(place, _)| place.column).min()?;
    let right = held.iter().map(|(place, _)| place.column).max()?;
    let (left, top) = (left.saturating_sub(margin_px), top.saturating_sub(margin_px));
    let width = (right + margin_px + 1).min(camera.width_px) - left;
    let height = (bottom + margin_px + 1).min(camera.height_px) - top;
    Some(Window { left, top, width, height })
}

fn patch_starts(held: &[(PixelPosition, Patch)], window: &Window) -> Vec<u32> {
    let mut starts = vec![0u32; window.width * window.height + 1];
    for (place, _) in held {
        starts[(place.row - window.top) * window.width + place.column - window.left + 1] += 1;
    }
    for index in 1..starts.len() {
        starts[index] += starts[index - 1];
    }
    starts
}

/// Returns for each pixel of the window whether `holds` is true; gaps of one pixel are closed.
fn closed(window: &Window, holds: impl Fn(usize) -> bool) -> Result<Vec<bool>, ImagingError> {
    let bytes: Vec<u8> = (0..window.width * window.height).map(|index| u8::from(holds(index))).collect();
    with_operation("the closing of the region's mask", closed_bytes(window, &bytes))
}

fn closed_bytes(window: &Window, bytes: &[u8]) -> opencv::Result<Vec<bool>> {
    let mask = Mat::new_rows_cols_with_data(window.height as i32, window.width as i32, bytes)?;
    let kernel = imgproc::get_structuring_element_def(imgproc::MORPH_RECT, opencv::core::Size::new(3, 3))?;
    let mut closed = Mat::default();
    imgproc::morphology_ex_def(&mask, &mut closed, imgproc::MORPH_CLOSE, &kernel)?;
    Ok(closed.data_bytes()?.iter().map(|&byte| byte > 0).collect())
}

/// Maximum distance of the neighbouring pixels from which the area of a pixel is calculated, px: large enough to
/// average the noise of the scanner, small enough for the curvature of the panel.
const AREA_REACH_PX: usize = 3;

/// A taught pixel of the region before its projection.
pub struct Sample {
    pub grid: usize,
    /// Index of the pixel in the taught picture, row by row.
    pub taught: usize,
    pub point: Option<Point<Panel>>,
    pub area_mm2: Option<f64>,
    pub masked: bool,
    /// Whether the pixel was sanded after the dry picture was captured.
    pub sanded: bool,
}

/// Returns the taught pixels of the region. The area of a pixel without a measured point is calculated from its
/// neighbours.
pub fn region_samples(taught: &TaughtPanel, masked_px: &[[[f64; 2]; 4]], sanded: Option<&Mask>) -> Vec<Sample> {
    let masks: Vec<Vec<Pixel>> =
        masked_px.iter().map(|corners| corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect()).collect();
    let corners =
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(s, t)| taught.region.pixel(Point2::new(s, t)));
    let columns = pixel_range(corners.map(|corner| corner.u), taught.mask.width);
    let rows = pixel_range(corners.map(|corner| corner.v), taught.mask.height);
    let sample = |(column, row): (usize, usize)| {
        let pixel = Pixel::at(column as f64, row as f64);
        let id = taught.region.grid_at(pixel)?;
        let grid = (id.row - 1) * taught.region.columns + id.column - 1;
        let own = taught.scan.point(column, row).filter(|_| taught.mask.contains(column, row));
        let area_mm2 = own
            .filter(|_| has_valid_neighbours(&taught.mask, column, row))
            .and_then(|_| taught.scan.smoothed_pixel_area_mm2(column, row, AREA_REACH_PX));
        let masked = masks.iter().any(|mask| polygon::contains(mask, pixel));
        let sanded = sanded.is_some_and(|sanded| sanded.contains(column, row));
        let (taught_px, point) = (row * taught.mask.width + column, own.or_else(|| taught.surface_point_at(pixel)));
        Some(Sample { grid, taught: taught_px, point, area_mm2, masked, sanded })
    };
    rows.flat_map(|row| columns.clone().map(move |column| (column, row))).filter_map(sample).collect()
}

/// Checks whether the neighbouring pixels from which the area of a pixel is calculated are on the panel. Points of the
/// background beyond the edge or behind a hole are far away.
fn has_valid_neighbours(mask: &Mask, column: usize, row: usize) -> bool {
    let reach = AREA_REACH_PX as isize;
    [(-reach, 0), (reach, 0), (0, -reach), (0, reach)].into_iter().all(|(right, down)| {
        let (column, row) = (column.checked_add_signed(right), row.checked_add_signed(down));
        column
            .zip(row)
            .is_some_and(|(column, row)| column < mask.width && row < mask.height && mask.contains(column, row))
    })
}

/// Returns the range of whole pixels from the minimum to the maximum of these values, limited to the size of the
/// picture.
fn pixel_range(ends: [f64; 4], length: usize) -> std::ops::Range<usize> {
    let low = ends.into_iter().fold(f64::INFINITY, f64::min).max(0.0) as usize;
    let high = ends.into_iter().fold(0.0, f64::max) as usize + 1;
    low..high.min(length)
}

/// Returns the mean area of a pixel in each grid; it is used for pixels beside a missing point.
pub fn mean_areas(samples: &[Sample], grids: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0usize); grids];
    for sample in samples {
        if let Some(area_mm2) = sample.area_mm2 {
            sums[sample.grid].0 += area_mm2;
            sums[sample.grid].1 += 1;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1) as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::panel::flat::{FlatPanelOptions, taught};
    use panelprep_cell::recipe::Recipe;

    /// Expected values, calculated by hand: at the taught pose each pixel of the picture shows the taught pixel with
    /// the same position. With the panel 5 mm (5 px) to the right, the pixel (105, 60) shows the taught pixel (100,
    /// 60). A pixel outside of the region shows no taught pixel.
    #[test]
    fn a_place_in_the_film_is_a_place_on_the_panel() {
        let taught = taught(&FlatPanelOptions::default());
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        let recipe = Recipe::check("test.toml", text).unwrap_or_else(|e| panic!("{e}"));
        for (shift_mm, shown) in [(0.0, [105, 60]), (5.0, [100, 60])] {
            let step = panelprep_base::geometry::Vector::new(nalgebra::Vector3::x() * shift_mm);
            let pose = taught.panel_from_camera.inverse().followed_by_displacement(step);
            let view = Footprint::of_view(&taught, (&taught.camera, pose), recipe.inspect()).expect("in view");
            let mut mask = Mask::all_outside(taught.camera.width_px, taught.camera.height_px);
            for (column, row) in [(105, 60), (3, 3)] {
                mask.inside[row * mask.width + column] = true;
            }
            let on_panel = view.taught_pixels(&mask);
            assert_eq!(on_panel.count(), 1, "{shift_mm}");
            assert!(on_panel.contains(shown[0], shown[1]), "{shift_mm}");
            assert!((view.broken_mm2(&mask).iter().sum::<f64>() - 1.0).abs() < 0.1);
        }
    }

    /// Expected values, calculated by hand: a pixel of a flat panel that faces the camera has 1 mm², so twelve pixels
    /// have 12 mm², at any position of the region. The background beyond the edge or behind a hole lies 160 mm farther
    /// away and does not belong to the panel. If it were included, pixels at the edge would have up to 27 mm² each.
    #[test]
    fn the_background_is_not_part_of_the_surface() {
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        let recipe = Recipe::check("test.toml", text).unwrap_or_else(|e| panic!("{e}"));
        let limit_mm2 = |flat: FlatPanelOptions| {
            Footprint::taught_detection_limit_mm2(&taught(&flat), recipe.inspect()).expect("in view")
        };
        for flat in [
            FlatPanelOptions::default(),
            FlatPanelOptions { notch: Some(140), ..FlatPanelOptions::default() },
            FlatPanelOptions { hole_px: 17, ..FlatPanelOptions::default() },
            FlatPanelOptions { region_right_px: 250.0, ..FlatPanelOptions::default() },
        ] {
            let limit_mm2 = limit_mm2(flat);
            assert!((limit_mm2 - 12.0).abs() < 1.0, "{limit_mm2} mm²");
        }
    }
}
