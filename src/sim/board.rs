//! A calibration board as a camera sees it: squares and markers through a distorting lens, with pixel noise.
//!
//! Each pixel is the mean of the board over its area: 16 × 16 rays if an edge passes through it, else one ray. Grey
//! levels of the print are not black and white, and the light falls off towards one side, as in a workshop.

use super::noise::{LEVEL, PixelNoise, Seed, to_byte};
use super::projector::Projector;
use panelprep_base::geometry::{Board, Camera, Frame, GrayPicture, PinholeCamera, Pixel, Point, Rigid, Vector};
use rayon::prelude::*;

/// A marker in one square of the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Marker {
    /// Column of the marker's square, from the left.
    pub column: usize,
    /// Row of the marker's square, from the top.
    pub row: usize,
    /// The marker's cells with the black rim, row by row; true means white.
    pub cells: Vec<bool>,
}

/// The print of a board: squares, and markers in some of them. The origin of frame `Board` is the first inner
/// corner.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardPrint {
    /// Squares in a row.
    pub columns: usize,
    /// Rows of squares.
    pub rows: usize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Whether the square at the top left is white.
    pub is_first_square_white: bool,
    /// Side of a marker, mm.
    pub marker_mm: f64,
    /// The markers; none on a chessboard.
    pub markers: Vec<Marker>,
}

const RAYS: usize = 16;
const BLACK: f64 = 35.0;
const WHITE: f64 = 205.0;
const GROUND: f64 = 95.0;
/// Width of the white rim around the squares, in squares.
const RIM: f64 = 0.7;

impl BoardPrint {
    /// Creates a chessboard from its number of inner corners.
    pub fn chessboard(columns: usize, rows: usize, square_mm: f64) -> Self {
        BoardPrint {
            columns: columns + 1,
            rows: rows + 1,
            square_mm,
            is_first_square_white: false,
            marker_mm: 0.0,
            markers: vec![],
        }
    }

    /// The inner corners, row by row.
    pub fn corners(&self) -> Vec<Point<Board>> {
        let place =
            |column: usize, row: usize| Point::at(column as f64 * self.square_mm, row as f64 * self.square_mm, 0.0);
        (0..self.rows - 1).flat_map(|row| (0..self.columns - 1).map(move |column| place(column, row))).collect()
    }

    /// The middle of the inner corners.
    pub fn centre(&self) -> Point<Board> {
        let half = |squares: usize| (squares - 2) as f64 * self.square_mm / 2.0;
        Point::at(half(self.columns), half(self.rows), 0.0)
    }

    /// The corners of the white rim.
    pub(super) fn rim(&self) -> [Point<Board>; 4] {
        let low = -(1.0 + RIM) * self.square_mm;
        let high = |squares: usize| (squares as f64 - 1.0 + RIM) * self.square_mm;
        let (right, down) = (high(self.columns), high(self.rows));
        [[low, low], [right, low], [right, down], [low, down]].map(|[x, y]| Point::at(x, y, 0.0))
    }

    /// Returns the grey level at a point of the board; `None` beside the board.
    fn gray_at(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let (x, y) = (x_mm / self.square_mm + 1.0, y_mm / self.square_mm + 1.0);
        let (columns, rows) = (self.columns as f64, self.rows as f64);
        if x < -RIM || y < -RIM || x > columns + RIM || y > rows + RIM {
            return None;
        }
        if x < 0.0 || y < 0.0 || x >= columns || y >= rows {
            return Some(WHITE);
        }
        let (column, row) = (x as usize, y as usize);
        let white = ((column + row) % 2 == 0) == self.is_first_square_white;
        let marker = self.markers.iter().find(|marker| marker.column == column && marker.row == row);
        let white = match marker {
            Some(marker) => self.cell(marker, x - column as f64, y - row as f64).unwrap_or(white),
            None => white,
        };
        Some(if white { WHITE } else { BLACK })
    }

    /// Returns the colour of the marker's cell at a point of its square, 0…1 in each direction; `None` around the
    /// marker.
    fn cell(&self, marker: &Marker, x: f64, y: f64) -> Option<bool> {
        let side = (marker.cells.len() as f64).sqrt();
        let share = self.marker_mm / self.square_mm;
        let at = |place: f64| {
            let cell = (place - (1.0 - share) / 2.0) / share * side;
            (0.0..side).contains(&cell).then_some(cell as usize)
        };
        Some(marker.cells[at(y)? * side as usize + at(x)?])
    }

    /// Renders a picture of the board; `shot` is the picture's own seed.
    pub(super) fn picture<C: Frame>(
        &self,
        camera: &PinholeCamera,
        camera_from_board: &Rigid<C, Board>,
        (pixels, shot): (&PixelNoise, Seed),
    ) -> GrayPicture {
        let mut picture = GrayPicture::uniform(camera.width_px, camera.height_px, 0);
        let plane = Plane::from_pose(camera_from_board);
        let (columns, rows) = self.span(camera, camera_from_board);
        picture.gray.par_chunks_mut(camera.width_px).enumerate().for_each(|(row, bytes)| {
            let noise = pixels.row(shot, row, bytes.len());
            for (column, byte) in bytes.iter_mut().enumerate() {
                let seen = if columns.contains(&column) && rows.contains(&row) {
                    self.mean_gray(camera, &plane, column as f64, row as f64)
                } else {
                    GROUND
                };
                let light = 0.85 + 0.3 * column as f64 / camera.width_px as f64;
                *byte = to_byte((seen * light * f64::from(LEVEL)).round() as u16, noise[column]);
            }
        });
        picture
    }

    /// The points that the 3D camera measures on the board. Points are missing beside the board and where its
    /// projector does not reach. The noise lies along the ray and depends on the place on the board and its depth.
    pub(super) fn points(
        &self,
        camera: &PinholeCamera,
        camera_from_board: &Rigid<Camera, Board>,
        mut noise_mm: impl FnMut([f64; 2], f64) -> f64,
    ) -> Vec<[f32; 3]> {
        let plane = Plane::from_pose(camera_from_board);
        let (columns, rows) = self.span(camera, camera_from_board);
        let mut points = vec![[f32::NAN; 3]; camera.width_px * camera.height_px];
        let projector = Projector::without_occluders();
        for row in rows {
            for column in columns.clone() {
                let pixel = Pixel::at(column as f64, row as f64);
                let Some([x, y]) = plane.intersect_ray(camera, pixel) else { continue };
                if self.gray_at(x, y).is_none() {
                    continue;
                }
                let point = (*camera_from_board * Point::at(x, y, 0.0)).mm.coords;
                if !projector.is_lit(&point, None) {
                    continue;
                }
                let point = point * (1.0 + noise_mm([x, y], point.z) / point.norm());
                points[row * camera.width_px + column] = [point.x as f32, point.y as f32, point.z as f32];
            }
        }
        points
    }

    /// Returns the columns and rows of the picture that the board may cover.
    fn span<C: Frame>(
        &self,
        camera: &PinholeCamera,
        camera_from_board: &Rigid<C, Board>,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let rim: Vec<Pixel> =
            self.rim().iter().filter_map(|&corner| camera.project(*camera_from_board * corner)).collect();
        let range = |value: fn(&Pixel) -> f64, size: usize| {
            let (low, high) =
                rim.iter().map(value).fold((f64::INFINITY, 0.0_f64), |(l, h), n| (l.min(n), h.max(n)));
            // The lens bends the rim's edges outwards by less than 30 pixels.
            (low - 30.0).clamp(0.0, size as f64) as usize..(high + 30.0).clamp(0.0, size as f64) as usize
        };
        (range(|pixel| pixel.u, camera.width_px), range(|pixel| pixel.v, camera.height_px))
    }

    fn mean_gray(&self, camera: &PinholeCamera, plane: &Plane, u: f64, v: f64) -> f64 {
        let corner = |u: f64, v: f64| plane.intersect_ray(camera, Pixel::at(u, v));
        let [Some(low), Some(right), Some(down)] =
            [corner(u - 0.5, v - 0.5), corner(u + 0.5, v - 0.5), corner(u - 0.5, v + 0.5)]
        else {
            return GROUND;
        };
        let at = |across: f64, along: f64| {
            let place =
                |axis: usize| low[axis] + across * (right[axis] - low[axis]) + along * (down[axis] - low[axis]);
            self.gray_at(place(0), place(1)).unwrap_or(GROUND)
        };
        let middle = at(0.5, 0.5);
        if [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)].iter().all(|gray| *gray == middle) {
            return middle;
        }
        let place = |index: usize| (index as f64 + 0.5) / RAYS as f64;
        let sum: f64 = (0..RAYS * RAYS).map(|index| at(place(index % RAYS), place(index / RAYS))).sum();
        sum / (RAYS * RAYS) as f64
    }
}

/// The board's plane in front of the camera.
struct Plane {
    origin: nalgebra::Vector3<f64>,
    axes: [nalgebra::Vector3<f64>; 3],
}

impl Plane {
    fn from_pose<C: Frame>(camera_from_board: &Rigid<C, Board>) -> Self {
        let turn = camera_from_board.rotation();
        let axes = [0, 1, 2].map(|axis| turn.matrix().column(axis).into_owned());
        Plane { origin: camera_from_board.origin().mm.coords, axes }
    }

    /// The intersection of a pixel's ray with the plane, in the board's x and y.
    fn intersect_ray(&self, camera: &PinholeCamera, pixel: Pixel) -> Option<[f64; 2]> {
        let ray: Vector<Camera> = camera.unproject(pixel)?;
        let depth = self.axes[2].dot(&self.origin) / self.axes[2].dot(&ray.mm);
        let offset = ray.mm * depth - self.origin;
        (depth > 0.0).then(|| [self.axes[0].dot(&offset), self.axes[1].dot(&offset)])
    }
}
