//! Locates the circles of a board by their print (`print`) and the smooth surface through all of them (`surface`).

use super::board::{Board, Corners};
use super::crossings::noise;
use super::foreign;
use super::print::{MatchWindow, Print, best_candidate};
use super::surface::{
    BLUR_CORNERS, CornerEstimate, MAX_SURFACE_STD_PX, PRINT_PX, START_PX, Surface, fit_surface, inflate_uncertainty,
};
use nalgebra::Matrix3;
use panelprep_base::geometry::{GrayPicture, Pixel};

/// Maximum standard deviation of a located circle along each axis, px; with a larger one the circle counts as
/// absent.
const MAX_CENTRE_STD_PX: f64 = 3.0;
/// The factors by which a circle's radius may differ from its first estimate.
const RADII: [f64; 5] = [0.9, 0.95, 1.0, 1.05, 1.1];

/// The input for circles that are located only by their print.
pub(super) struct PrintLocator<'a> {
    pub picture: &'a GrayPicture,
    /// The factor by which the picture is reduced for the search.
    pub times: usize,
    pub reach_mm: f64,
    /// The contrast's sign: 1 if the print is darker than the background.
    pub sign: f64,
}

impl PrintLocator<'_> {
    /// Finds the circles of a board, from the approximate positions of some of them and their radius. `None` if there
    /// are too few to compare, or fewer than half of the circles are found.
    pub fn circles(&self, board: &Board, rough: &Corners, radius_mm: f64) -> Option<Corners> {
        let small =
            if self.times == 1 { None } else { Some(foreign::reduce_picture(self.picture, self.times).ok()?) };
        let small = small.as_ref().unwrap_or(self.picture);
        let noise = noise(small);
        let known = vec![MAX_SURFACE_STD_PX; rough.len()];
        let mut surface = Surface::fit(rough, &known, self.picture.width as f64)?;
        let step = (rough.len() / BLUR_CORNERS).max(1);
        let view =
            |surface: &Surface, q, blur_px| self.reduced_view(surface.view(q, self.reach_mm, blur_px), small);
        let views: Vec<MatchWindow> = rough.iter().step_by(step).map(|(q, _)| view(&surface, *q, 1.0)).collect();
        let blur_px = Print::from_circles(board, radius_mm).blur_px(small, &views, noise);
        let tried = RADII.map(|by| {
            (by, Print::from_circles(board, by * radius_mm).match_statistics(small, &views, (blur_px, noise)))
        });
        let print = Print::from_circles(board, best_candidate(tried)? * radius_mm);
        let blur_px = print.blur_px(small, &views, noise);
        let all: Corners = board.corners().into_iter().map(|q| (q, Pixel::at(0.0, 0.0))).collect();
        let mut placed: Vec<Option<CornerEstimate>> = vec![None; all.len()];
        for _ in 0..3 {
            for ((q, _), placed) in all.iter().zip(&mut placed).filter(|(_, placed)| placed.is_none()) {
                let found = print.match_near(small, &view(&surface, *q, blur_px), noise);
                let Some(found) = found.filter(|found| self.sign * found.contrast > 0.0) else { continue };
                let own = CornerEstimate::from_match(&found, noise);
                let deviation_px = own.deviation_px * self.times as f64;
                let own = CornerEstimate { pixel: self.full_size_pixel(own.pixel, small), deviation_px, ..own };
                // The first surface is only as good as the middles of the circles, and a glare shifts some of them.
                let start_px = START_PX * self.times as f64;
                let is_near =
                    own.pixel.distance_px(surface.pixel_at(*q)) <= surface.limit_px(*q, &own).max(start_px);
                *placed = (own.deviation_px < MAX_CENTRE_STD_PX && is_near).then_some(own);
            }
            surface = fit_surface(&all, &placed, self.picture)?;
            for ((q, _), placed) in all.iter().zip(&mut placed) {
                *placed = placed.filter(|placed| {
                    placed.pixel.distance_px(surface.pixel_at(*q)) <= surface.limit_px(*q, placed)
                });
            }
        }
        let placed = inflate_uncertainty(&all, placed, board.square_mm());
        let surface = fit_surface(&all, &placed, self.picture)?;
        let drawn = all
            .iter()
            .zip(&placed)
            .filter_map(|((q, _), placed)| Some((*q, surface.blend_with_surface(*q, (*placed)?)?)));
        let corners: Corners = drawn.collect();
        (2 * corners.len() >= all.len()).then_some(corners)
    }

    fn scale_to(&self, small: &GrayPicture) -> [f64; 2] {
        [small.width as f64 / self.picture.width as f64, small.height as f64 / self.picture.height as f64]
    }

    fn reduced_view(&self, view: MatchWindow, small: &GrayPicture) -> MatchWindow {
        let [across, down] = self.scale_to(small);
        let scale = Matrix3::new(across, 0.0, (across - 1.0) / 2.0, 0.0, down, (down - 1.0) / 2.0, 0.0, 0.0, 1.0);
        let start = Pixel::at((view.start.u + 0.5) * across - 0.5, (view.start.v + 0.5) * down - 0.5);
        MatchWindow { plane: scale * view.plane, start, most_px: 3.0 * PRINT_PX, ..view }
    }

    fn full_size_pixel(&self, pixel: Pixel, small: &GrayPicture) -> Pixel {
        let [across, down] = self.scale_to(small);
        Pixel::at((pixel.u + 0.5) / across - 0.5, (pixel.v + 0.5) / down - 0.5)
    }
}
