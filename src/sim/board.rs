//! Rendered pictures of a calibration board: squares and markers through a lens with distortion, with pixel noise. Each
//! picture for a calibration has its ground truth: the flange's true pose and the pose that the robot reports.
//!
//! Each pixel is the mean of the board over the pixel's area: 16 × 16 rays if an edge passes through it, otherwise one
//! ray. The grey levels of the print are not black and white, and the light decreases towards one side, as in a
//! workshop.
//!
//! The fixed camera sees a board on the flange, the flange camera a board in the cell. Positions, tilts and rotations
//! are drawn at random, as a careful operator would choose them: widely distributed, with the whole board in the
//! picture.

use super::noise::{NormalStream, PixelNoise, RandomPurpose, STEPS_PER_GRAY_LEVEL, Seed, to_byte};
use super::scanner::{Projector, ScannerDistortion};
use super::{scanner, scene};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{
    Base, Board, Camera, Degrees, Flange, FlangeCamera, Frame, GrayPicture, OrganizedCloud, PinholeCamera, Pixel,
    Point, Rigid, Vector,
};
use rayon::prelude::*;

/// A marker in one square of the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Marker {
    /// Column of the marker's square, from the left.
    pub column: usize,
    /// Row of the marker's square, from the top.
    pub row: usize,
    /// The marker's cells including the black border, row by row; true is white.
    pub cells: Vec<bool>,
}

/// The print of a board: squares, and markers in some of them. The origin of frame `Board` is the first inner corner.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardPrint {
    /// Number of squares in a row.
    pub columns: usize,
    /// Number of rows of squares.
    pub rows: usize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Whether the square at the top left is white.
    pub is_first_square_white: bool,
    /// Side of a marker, mm.
    pub marker_mm: f64,
    /// The markers; a chessboard has none.
    pub markers: Vec<Marker>,
}

const RAYS_PER_SIDE: usize = 16;
const BLACK_GRAY: f64 = 35.0;
const WHITE_GRAY: f64 = 205.0;
const BACKGROUND_GRAY: f64 = 95.0;
/// Width of the white border around the squares, in squares.
const RIM_SQUARES: f64 = 0.7;

impl BoardPrint {
    /// Creates a chessboard with these numbers of inner corners.
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

    /// Returns the inner corners, row by row.
    pub fn corners(&self) -> Vec<Point<Board>> {
        let place =
            |column: usize, row: usize| Point::at(column as f64 * self.square_mm, row as f64 * self.square_mm, 0.0);
        (0..self.rows - 1).flat_map(|row| (0..self.columns - 1).map(move |column| place(column, row))).collect()
    }

    /// Returns the centre of the inner corners.
    pub fn centre(&self) -> Point<Board> {
        let half = |squares: usize| (squares - 2) as f64 * self.square_mm / 2.0;
        Point::at(half(self.columns), half(self.rows), 0.0)
    }

    /// Returns the outer corners of the white border.
    pub(super) fn rim(&self) -> [Point<Board>; 4] {
        let low = -(1.0 + RIM_SQUARES) * self.square_mm;
        let high = |squares: usize| (squares as f64 - 1.0 + RIM_SQUARES) * self.square_mm;
        let (right, down) = (high(self.columns), high(self.rows));
        [[low, low], [right, low], [right, down], [low, down]].map(|[x, y]| Point::at(x, y, 0.0))
    }

    /// Returns the grey level at a point of the board; `None` outside of the board.
    fn gray_at(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let (x, y) = (x_mm / self.square_mm + 1.0, y_mm / self.square_mm + 1.0);
        let (columns, rows) = (self.columns as f64, self.rows as f64);
        if x < -RIM_SQUARES || y < -RIM_SQUARES || x > columns + RIM_SQUARES || y > rows + RIM_SQUARES {
            return None;
        }
        if x < 0.0 || y < 0.0 || x >= columns || y >= rows {
            return Some(WHITE_GRAY);
        }
        let (column, row) = (x as usize, y as usize);
        let white = ((column + row) % 2 == 0) == self.is_first_square_white;
        let marker = self.markers.iter().find(|marker| marker.column == column && marker.row == row);
        let white = match marker {
            Some(marker) => self.cell(marker, x - column as f64, y - row as f64).unwrap_or(white),
            None => white,
        };
        Some(if white { WHITE_GRAY } else { BLACK_GRAY })
    }

    /// Returns whether the marker is white at a position in its square, 0…1 in each direction; `None` around the
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

    /// Renders a picture of the board; `shot` is the seed of the picture's noise.
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
                    BACKGROUND_GRAY
                };
                let light = 0.85 + 0.3 * column as f64 / camera.width_px as f64;
                *byte = to_byte((seen * light * f64::from(STEPS_PER_GRAY_LEVEL)).round() as u16, noise[column]);
            }
        });
        picture
    }

    /// Returns the points that the 3D camera measures on the board. A point is missing if its pixel does not see the
    /// board, or if the projector does not light it. The noise lies along the ray and depends on the position on the
    /// board and the depth.
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

    /// Returns the ranges of columns and rows of the picture that the board may cover.
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
            // The lens distortion moves the border's edges outwards by less than 30 pixels.
            (low - 30.0).clamp(0.0, size as f64) as usize..(high + 30.0).clamp(0.0, size as f64) as usize
        };
        (range(|pixel| pixel.u, camera.width_px), range(|pixel| pixel.v, camera.height_px))
    }

    fn mean_gray(&self, camera: &PinholeCamera, plane: &Plane, u: f64, v: f64) -> f64 {
        let corner = |u: f64, v: f64| plane.intersect_ray(camera, Pixel::at(u, v));
        let [Some(low), Some(right), Some(down)] =
            [corner(u - 0.5, v - 0.5), corner(u + 0.5, v - 0.5), corner(u - 0.5, v + 0.5)]
        else {
            return BACKGROUND_GRAY;
        };
        let at = |across: f64, along: f64| {
            let place =
                |axis: usize| low[axis] + across * (right[axis] - low[axis]) + along * (down[axis] - low[axis]);
            self.gray_at(place(0), place(1)).unwrap_or(BACKGROUND_GRAY)
        };
        let middle = at(0.5, 0.5);
        if [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)].iter().all(|gray| *gray == middle) {
            return middle;
        }
        let place = |index: usize| (index as f64 + 0.5) / RAYS_PER_SIDE as f64;
        let sum: f64 = (0..RAYS_PER_SIDE * RAYS_PER_SIDE)
            .map(|index| at(place(index % RAYS_PER_SIDE), place(index / RAYS_PER_SIDE)))
            .sum();
        sum / (RAYS_PER_SIDE * RAYS_PER_SIDE) as f64
    }
}

/// The plane of the board in the camera's frame.
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

    /// Returns the intersection of a pixel's ray with the plane, as the board's x and y.
    fn intersect_ray(&self, camera: &PinholeCamera, pixel: Pixel) -> Option<[f64; 2]> {
        let ray: Vector<Camera> = camera.unproject(pixel)?;
        let depth = self.axes[2].dot(&self.origin) / self.axes[2].dot(&ray.mm);
        let offset = ray.mm * depth - self.origin;
        (depth > 0.0).then(|| [self.axes[0].dot(&offset), self.axes[1].dot(&offset)])
    }
}

/// The error of the pose that the robot reports: standard deviations of the rotation about and the translation along
/// each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotNoise {
    /// Standard deviation of the translation along each axis, mm.
    pub shift_mm: f64,
    /// Standard deviation of the rotation about each axis, degrees.
    pub turn_deg: f64,
}

/// The poses of flange and board at one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardShot<C: Frame> {
    /// The picture's number, which selects the picture's noise.
    pub index: u64,
    /// The flange's pose that the robot reports.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The board's true pose.
    pub camera_from_board: Rigid<C, Board>,
}

/// A board in front of one of the cell's cameras.
#[derive(Debug, Clone)]
pub struct BoardCell {
    seed: Seed,
    print: BoardPrint,
    robot: RobotNoise,
    pixels: PixelNoise,
    reduction: usize,
}

/// Returns the board's pose on the flange. A bracket holds the board beside the arm with its print facing backwards
/// along the arm, because the fixed camera is behind the arm. The bracket is slightly tilted.
fn flange_from_board(print: &BoardPrint) -> Rigid<Flange, Board> {
    // The board's Z axis points away from the viewer, like the flange's Z axis.
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(1.5, 1.0, 2.0).map(f64::to_radians));
    board_pose_in_hand(Vector3::new(BRACKET_DISTANCE_MM, -9.0, 55.0), turn, print)
}

/// Distance from the flange's axis to the board's centre, mm: at this distance the arm does not hide the board.
const BRACKET_DISTANCE_MM: f64 = 190.0;

/// Returns the board's pose in the cell: in front of the robot, facing up.
fn base_from_board(print: &BoardPrint) -> Rigid<Base, Board> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(180.0, 0.0, 0.0).map(f64::to_radians))
        * UnitQuaternion::from_scaled_axis(Vector3::new(1.0, -2.0, 25.0).map(f64::to_radians));
    board_pose_in_hand(Vector3::new(560.0, 40.0, 220.0), turn, print)
}

fn board_pose_in_hand<To: Frame>(
    middle_mm: Vector3<f64>,
    turn: UnitQuaternion<f64>,
    print: &BoardPrint,
) -> Rigid<To, Board> {
    let shift = middle_mm - turn * print.centre().mm.coords;
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::from(shift), turn))
}

fn organized_cloud(camera: &PinholeCamera, points: Vec<[f32; 3]>, picture: &GrayPicture) -> OrganizedCloud<Camera> {
    let colors = picture.gray.iter().map(|&gray| [gray; 3]).collect();
    match OrganizedCloud::new(camera.width_px, camera.height_px, points, colors) {
        Ok(cloud) => cloud,
        Err(error) => unreachable!("the cloud must have one point and one colour per pixel: {error}"),
    }
}

const MAX_DRAWS: usize = 10_000;
/// First index of the pictures for the lens calibration, so that these have noise of their own.
const LENS_INDEX: u64 = 1_000;
/// First index of the scans for the calibration of the 3D camera's depth error, so that these have noise of their own.
const SCANNER_INDEX: u64 = 2_000;
/// Maximum distance of the board's centre from the optical axis along the picture's width and height, as fractions of
/// the depth.
const MAX_CENTRE_OFFSET: [f64; 2] = [0.22, 0.14];
const MAX_CENTRE_OFFSET_WIDE: [f64; 2] = [0.42, 0.25];
/// Minimum distance of the board's border from the picture's edge, px.
const MIN_RIM_MARGIN_PX: f64 = 12.0;

impl BoardCell {
    /// Creates a cell with a board of this print and a robot with these errors.
    pub fn new(seed: u64, print: BoardPrint, robot: RobotNoise) -> Self {
        BoardCell { seed: Seed(seed), print, robot, pixels: PixelNoise::new(Seed(seed)), reduction: 1 }
    }

    /// Returns the same cell with cameras whose pictures are smaller by this factor in each direction.
    pub fn with_reduction(self, reduction: usize) -> Self {
        BoardCell { reduction, ..self }
    }

    /// Returns the fixed camera.
    pub fn scanner(&self) -> PinholeCamera {
        scene::scanner(self.reduction)
    }

    /// Returns the camera on the flange.
    pub fn flange_camera(&self) -> PinholeCamera {
        scene::flange_camera(self.reduction)
    }

    /// Returns the fixed camera's true pose.
    pub fn base_from_camera(&self) -> Rigid<Base, Camera> {
        scene::base_from_camera()
    }

    /// Returns the true mount of the flange camera.
    pub fn flange_from_camera(&self) -> Rigid<Flange, FlangeCamera> {
        scene::flange_from_camera()
    }

    /// Returns the true pose of the board in the cell, which the flange camera sees.
    pub fn base_from_board(&self) -> Rigid<Base, Board> {
        base_from_board(&self.print)
    }

    /// Returns the print of the board.
    pub fn print(&self) -> &BoardPrint {
        &self.print
    }

    /// Returns shots of the fixed camera with the board on the flange.
    pub fn fixed_shots(&self, count: usize) -> Vec<BoardShot<Camera>> {
        let flange_from_board = flange_from_board(&self.print);
        self.take_shots(count, 0, (&self.scanner(), 760.0, MAX_CENTRE_OFFSET), |camera_from_board| {
            scene::base_from_camera() * *camera_from_board * flange_from_board.inverse()
        })
    }

    /// Returns shots of the fixed camera of a hand-held board at positions all over the picture.
    pub fn scanner_shots(&self, count: usize) -> Vec<BoardShot<Camera>> {
        let nowhere = |_: &Rigid<Camera, Board>| Rigid::from_isometry_unchecked(Isometry3::identity());
        let mut shots = self.take_shots(count, 3, (&self.scanner(), 700.0, MAX_CENTRE_OFFSET_WIDE), nowhere);
        shots.iter_mut().for_each(|shot| shot.index += SCANNER_INDEX);
        shots
    }

    /// Returns shots of the flange camera with the board in the cell.
    pub fn flange_shots(&self, count: usize) -> Vec<BoardShot<FlangeCamera>> {
        let base_from_board = base_from_board(&self.print);
        self.take_shots(count, 1, (&self.flange_camera(), 440.0, MAX_CENTRE_OFFSET), |camera_from_board| {
            base_from_board * camera_from_board.inverse() * scene::flange_from_camera().inverse()
        })
    }

    /// Returns the fixed camera's shot of the board on the flange at this true pose of the flange; the robot reports
    /// this pose without an error.
    pub fn fixed_view(&self, index: u64, base_from_flange: Rigid<Base, Flange>) -> BoardShot<Camera> {
        let camera_from_board =
            scene::base_from_camera().inverse() * base_from_flange * flange_from_board(&self.print);
        BoardShot { index, base_from_flange, camera_from_board }
    }

    /// Returns the flange camera's shot of the board in the cell at this pose of the flange.
    pub fn flange_view(&self, index: u64, base_from_flange: Rigid<Base, Flange>) -> BoardShot<FlangeCamera> {
        let base_from_camera = base_from_flange * scene::flange_from_camera();
        let camera_from_board = base_from_camera.inverse() * base_from_board(&self.print);
        BoardShot { index, base_from_flange, camera_from_board }
    }

    /// Returns shots for the lens calibration: the hand-held board is near this camera and fills the picture.
    pub fn lens_shots<C: Frame>(&self, camera: &PinholeCamera, count: usize) -> Vec<BoardShot<C>> {
        // If the board faces the camera, its border fills about 0.8 of the picture's width.
        let [low, right, ..] = self.print.rim();
        let distance_mm = low.distance_mm(right) * camera.fx_px / (0.8 * camera.width_px as f64);
        let nowhere = |_: &Rigid<C, Board>| Rigid::from_isometry_unchecked(Isometry3::identity());
        let mut shots = self.take_shots(count, 2, (camera, distance_mm, MAX_CENTRE_OFFSET), nowhere);
        shots.iter_mut().for_each(|shot| shot.index += LENS_INDEX);
        shots
    }

    /// Returns the panel's centre in the frame of the fixed camera.
    pub fn panel_middle(&self) -> Point<Camera> {
        scene::base_from_camera().inverse() * Point::new(super::shape::CENTRE_MM.into())
    }

    fn take_shots<C: Frame>(
        &self,
        count: usize,
        arrangement: u64,
        (camera, distance_mm, reach): (&PinholeCamera, f64, [f64; 2]),
        flange: impl Fn(&Rigid<C, Board>) -> Rigid<Base, Flange>,
    ) -> Vec<BoardShot<C>> {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::BoardPose, arrangement));
        (0..count as u64)
            .map(|index| {
                let camera_from_board = self.draw(&mut normal, camera, (distance_mm, reach));
                let shift = Vector3::from_fn(|_, _| normal.next()) * self.robot.shift_mm;
                let turn = Vector3::from_fn(|_, _| normal.next()) * Degrees(self.robot.turn_deg).to_rad();
                let off: Rigid<Flange, Flange> = Rigid::from_isometry_unchecked(Isometry3::new(shift, turn));
                BoardShot { index, base_from_flange: flange(&camera_from_board) * off, camera_from_board }
            })
            .collect()
    }

    fn draw<C: Frame>(
        &self,
        normal: &mut NormalStream,
        camera: &PinholeCamera,
        (distance_mm, [across, down]): (f64, [f64; 2]),
    ) -> Rigid<C, Board> {
        for _ in 0..MAX_DRAWS {
            let mut spread = |reach: f64| (2.0 * normal.next_uniform() - 1.0) * reach;
            let depth = distance_mm * (1.0 + spread(0.15));
            let middle = Vector3::new(spread(across) * depth, spread(down) * depth, depth);
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(spread(0.65), spread(0.65), 0.0))
                * UnitQuaternion::from_scaled_axis(Vector3::z() * spread(1.5));
            let camera_from_board: Rigid<C, Board> = board_pose_in_hand(middle, turn, &self.print);
            let inside = |pixel: Pixel| {
                let within = |at: f64, size: usize| at > MIN_RIM_MARGIN_PX && at < size as f64 - MIN_RIM_MARGIN_PX;
                within(pixel.u, camera.width_px) && within(pixel.v, camera.height_px)
            };
            let seen = |corner: &Point<Board>| camera.project(camera_from_board * *corner).is_some_and(inside);
            if self.print.rim().iter().all(seen) {
                return camera_from_board;
            }
        }
        unreachable!("no pose was found at which the whole board is in the picture")
    }

    /// Renders the picture of the shot.
    pub fn picture<C: Frame>(&self, camera: &PinholeCamera, shot: &BoardShot<C>) -> GrayPicture {
        let seed = self.seed.child(RandomPurpose::BoardPicture, shot.index);
        self.print.picture(camera, &shot.camera_from_board, (&self.pixels, seed))
    }

    /// Computes the corners of the shot without rendering, with noise of this standard deviation in each direction.
    pub fn corners<C: Frame>(
        &self,
        camera: &PinholeCamera,
        shot: &BoardShot<C>,
        noise_px: f64,
    ) -> Vec<(Point<Board>, Pixel)> {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::BoardCorners, shot.index));
        let corners = self.print.corners().into_iter().map(|corner| {
            let (du, dv) = (normal.next() * noise_px, normal.next() * noise_px);
            let Some(pixel) = camera.project(shot.camera_from_board * corner) else {
                unreachable!("every corner of the board must be in front of the camera")
            };
            (corner, Pixel::at(pixel.u + du, pixel.v + dv))
        });
        corners.collect()
    }

    /// Returns the fixed camera's shot as a scan, with white noise along the ray.
    pub fn scan(&self, shot: &BoardShot<Camera>, noise_mm: f64) -> OrganizedCloud<Camera> {
        let (camera, picture) = (self.scanner(), self.picture(&self.scanner(), shot));
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::BoardScan, shot.index));
        let points = self.print.points(&camera, &shot.camera_from_board, |_, _| normal.next() * noise_mm);
        organized_cloud(&camera, points, &picture)
    }

    /// Returns the fixed camera's shot as a scan with all errors of a panel's scan: white noise that increases with the
    /// depth, noise that is correlated over centimetres, and this camera's constant distortion.
    pub fn real_scan(&self, shot: &BoardShot<Camera>, distortion: &ScannerDistortion) -> OrganizedCloud<Camera> {
        let (camera, picture) = (self.scanner(), self.picture(&self.scanner(), shot));
        let seed = self.seed.child(RandomPurpose::BoardScan, shot.index);
        let (mut normal, correlated) =
            (NormalStream::new(seed.stream(RandomPurpose::ScanRow, 0)), scanner::draw_correlated_noise(seed, None));
        let middle = self.print.centre().mm;
        let points = self.print.points(&camera, &shot.camera_from_board, |[x, y], depth_mm| {
            scanner::range_error_mm(normal.next(), depth_mm, correlated.value_at([x - middle.x, y - middle.y]))
        });
        distortion.distort_scan(&organized_cloud(&camera, points, &picture))
    }

    /// Returns points of the board in the base frame, as measured by touching them with the tool's tip, with noise of
    /// this standard deviation along each axis.
    pub fn touch_points(
        &self,
        base_from_board: &Rigid<Base, Board>,
        places: &[Point<Board>],
        noise_mm: f64,
    ) -> Vec<Point<Base>> {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::Touch, 0));
        places
            .iter()
            .map(|&place| {
                let noise = Vector3::from_fn(|_, _| normal.next()) * noise_mm;
                Point::new((*base_from_board * place).mm + noise)
            })
            .collect()
    }
}
