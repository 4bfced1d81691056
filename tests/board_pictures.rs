//! Renders boards in poor pictures: out of focus, noisy, with low contrast, with glare, tilted, small, in the dark,
//! among clutter; for the tests and for `make bench-calib`.
//!
//! This renderer shares only the camera model with the simulator. At edges of the print, a pixel is the mean of 36
//! rays; then illumination, glare, blur and noise are applied, in this order.
#![allow(dead_code)] // Each of the two uses its part.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep::calib::{Board, detect, marker_cells};
use panelprep::geometry::statistics::rms;
use panelprep::geometry::{Board as BoardFrame, Camera, GrayPicture, PinholeCamera, Pixel, Point, Vector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// The difficulties of a rendered picture.
#[derive(Debug, Clone, Copy)]
pub struct Hard {
    /// Defocus: the standard deviation of a Gaussian blur, px.
    pub blur_px: f64,
    /// Standard deviation of the pixel noise, grey levels.
    pub noise: f64,
    /// Contrast: white minus black, grey levels.
    pub contrast: f64,
    /// Whether glare covers a tenth of the board.
    pub glare: bool,
    /// Tilt of the board, degrees.
    pub tilt_deg: f64,
    /// Whether only the board is lit.
    pub dark: bool,
    /// Width of the board as a fraction of the picture's width, if the board faces the camera.
    pub width_share: f64,
}

impl Hard {
    /// An easy picture.
    #[rustfmt::skip]
    pub const EASY: Hard = Hard { blur_px: 0.6, noise: 2.0, contrast: 170.0, glare: false, tilt_deg: 25.0, dark: false, width_share: 0.5 };
}

/// A rendered picture with its ground truth.
pub struct Rendered {
    /// The picture.
    pub picture: GrayPicture,
    /// For each corner: its point on the board, its position in the picture, and whether it is visible despite the
    /// glare.
    pub truth: Vec<(Point<BoardFrame>, Pixel, bool)>,
}

/// Returns a camera with this number of pixels across, and with lens distortion.
pub fn camera(width_px: usize) -> PinholeCamera {
    let width = width_px as f64;
    PinholeCamera {
        width_px,
        height_px: width_px * 5 / 8,
        fx_px: 1.1 * width,
        fy_px: 1.1 * width,
        cx_px: 0.507 * width,
        cy_px: 0.308 * width,
        k1: -0.09,
        k2: 0.05,
        p1: 0.0004,
        p2: -0.0003,
        k3: 0.0,
    }
}

/// The print of a board: returns the ink at a point in squares from the upper left printed corner. 0 is black, 1 is
/// white; outside of the board's rim there is no ink (`None`).
struct Print {
    board: Board,
    cells: Vec<Vec<bool>>,
    squares: Vec<(usize, usize)>,
    corners: Vec<Point<BoardFrame>>,
}

const RIM_SQUARES: f64 = 0.8;
const CIRCLE_SQUARES: f64 = 0.27;

impl Print {
    fn new(board: &Board) -> Self {
        let cells = marker_cells(board).expect("a dictionary");
        Print { board: board.clone(), cells, squares: board.marker_squares(), corners: board.corners() }
    }

    /// Returns the lower and upper corner of the printed part, mm.
    fn size(&self) -> ([f64; 2], [f64; 2]) {
        let side = self.board.square_mm();
        let by = |n: fn(&Point<BoardFrame>) -> f64| self.corners.iter().map(n).fold(0.0, f64::max);
        let far = [by(|q| q.mm.x), by(|q| q.mm.y)];
        ([-side * (1.0 + RIM_SQUARES); 2], far.map(|far| far + side * (1.0 + RIM_SQUARES)))
    }

    fn ink(&self, x: f64, y: f64) -> Option<f64> {
        let (low, high) = self.size();
        if x < low[0] || y < low[1] || x > high[0] || y > high[1] {
            return None;
        }
        let side = self.board.square_mm();
        if let Some(asymmetric) = self.board.circles() {
            let row = (y / side).round();
            let (step, first) = if asymmetric { (2.0, row.rem_euclid(2.0)) } else { (1.0, 0.0) };
            let column = ((x / side - first) / step).round();
            let is_one = row >= 0.0
                && column >= 0.0
                && (row as usize) < self.board.rows()
                && (column as usize) < self.board.columns();
            let away = (x - (column * step + first) * side).hypot(y - row * side);
            return Some(if is_one && away < CIRCLE_SQUARES * side * step.sqrt() { 0.0 } else { 1.0 });
        }
        let (u, v) = (x / side + 1.0, y / side + 1.0);
        let (columns, rows) = (self.board.columns() + 1, self.board.rows() + 1);
        if u < 0.0 || v < 0.0 || u >= columns as f64 || v >= rows as f64 {
            return Some(1.0);
        }
        let (column, row) = (u as usize, v as usize);
        let Some(markers) = self.board.markers() else { return Some(((column + row) % 2) as f64) };
        let Some(number) = self.squares.iter().position(|square| *square == (column, row)) else {
            return Some(0.0);
        };
        let share = markers.marker_mm / side;
        let cells = (self.cells[number].len() as f64).sqrt();
        let at = |place: f64| (place.fract() - (1.0 - share) / 2.0) / share * cells;
        let (across, down) = (at(u), at(v));
        let is_in = |at: f64| (0.0..cells).contains(&at);
        if !is_in(across) || !is_in(down) {
            return Some(1.0);
        }
        Some(f64::from(self.cells[number][down as usize * cells as usize + across as usize]))
    }
}

fn normal(random: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Draws a random pose at which the whole board is in the picture.
fn random_pose(print: &Print, camera: &PinholeCamera, hard: &Hard, random: &mut Pcg64) -> Isometry3<f64> {
    let (low, high) = print.size();
    let wide = high[0] - low[0];
    let middle = Vector3::new((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, 0.0);
    let mut depth = wide * camera.fx_px / (hard.width_share * camera.width_px as f64);
    for draw in 0..10_000 {
        let mut share = || random.random::<f64>() * 2.0 - 1.0;
        let about = std::f64::consts::PI * share();
        let turn = UnitQuaternion::from_scaled_axis(
            Vector3::new(about.cos(), about.sin(), 0.0) * hard.tilt_deg.to_radians(),
        ) * UnitQuaternion::from_scaled_axis(Vector3::z() * 0.6 * share());
        let at = Vector3::new(0.45 * share(), 0.28 * share(), 1.0) * depth;
        let pose = Isometry3::from_parts(Translation3::from(at - turn * middle), turn);
        let is_inside = [[low[0], low[1]], [high[0], low[1]], high, [low[0], high[1]]].into_iter().all(|[x, y]| {
            let point = Point::<Camera>::new(pose * nalgebra::Point3::new(x, y, 0.0));
            camera.project(point).is_some_and(|p| {
                p.u > 6.0 && p.v > 6.0 && p.u < camera.width_px as f64 - 6.0 && p.v < camera.height_px as f64 - 6.0
            })
        });
        if is_inside {
            return pose;
        }
        if draw % 50 == 49 {
            depth *= 1.03;
        }
    }
    panic!("a board of this size fits into the picture somewhere")
}

/// Draws random shapes of all grey levels behind the board.
fn draw_clutter(camera: &PinholeCamera, random: &mut Pcg64) -> Vec<f32> {
    let (width, height) = (camera.width_px, camera.height_px);
    let mut ground = vec![0.35f32; width * height];
    for _ in 0..60 {
        let mut at = |size: usize| (random.random::<f64>() * size as f64) as usize;
        let (left, top, wide, high) = (at(width), at(height), at(width / 4), at(height / 4));
        let (gray, slant) = (random.random::<f32>(), random.random::<f64>() - 0.5);
        for row in top..(top + high).min(height) {
            let from = (left as f64 + slant * (row - top) as f64).max(0.0) as usize;
            ground[row * width + from.min(width)..row * width + (from + wide).min(width)].fill(gray);
        }
    }
    ground
}

/// Renders a picture with these difficulties.
pub fn render(board: &Board, camera: &PinholeCamera, hard: &Hard, seed: u64) -> Rendered {
    let mut random = Pcg64::seed_from_u64(seed);
    let print = Print::new(board);
    let pose = random_pose(&print, camera, hard, &mut random);
    let (width, height) = (camera.width_px, camera.height_px);
    let black = if hard.contrast < 80.0 { 60.0 } else { 30.0 };
    let mut picture: Vec<f32> = match hard.dark {
        true => vec![4.0; width * height],
        false => draw_clutter(camera, &mut random)
            .into_iter()
            .map(|share| (black + share as f64 * hard.contrast.max(60.0)) as f32)
            .collect(),
    };
    let inverse = pose.inverse();
    let meet = |u: f64, v: f64| -> Option<[f64; 2]> {
        let ray: Vector<Camera> = camera.unproject(Pixel::at(u, v))?;
        let (from, along) = (inverse * nalgebra::Point3::origin(), inverse * ray.mm);
        let times = -from.z / along.z;
        (times > 0.0).then(|| [from.x + along.x * times, from.y + along.y * times])
    };
    let (low, high) = print.size();
    // The glare is an ellipse over a tenth of the board, at a random position.
    let glare_at = [0, 1].map(|axis| low[axis] + (0.25 + 0.5 * random.random::<f64>()) * (high[axis] - low[axis]));
    let area = 0.1 * (high[0] - low[0]) * (high[1] - low[1]);
    let long = 0.6 + 1.2 * random.random::<f64>();
    let radius = [(area / std::f64::consts::PI * long).sqrt(), (area / std::f64::consts::PI / long).sqrt()];
    let glare = |[x, y]: [f64; 2]| {
        let far = ((x - glare_at[0]) / radius[0]).hypot((y - glare_at[1]) / radius[1]);
        // Full glare inside, no glare outside, with a soft edge.
        if hard.glare { ((1.15 - far) / 0.3).clamp(0.0, 1.0) } else { 0.0 }
    };
    picture.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        for (column, value) in line.iter_mut().enumerate() {
            let (u, v) = (column as f64, row as f64);
            let Some(middle) = meet(u, v) else { continue };
            let near = board.square_mm();
            if middle[0] < low[0] - near
                || middle[0] > high[0] + near
                || middle[1] < low[1] - near
                || middle[1] > high[1] + near
            {
                continue;
            }
            let (Some(origin), Some(right), Some(down)) =
                (meet(u - 0.5, v - 0.5), meet(u + 0.5, v - 0.5), meet(u - 0.5, v + 0.5))
            else {
                continue;
            };
            let at = |across: f64, along: f64| {
                [0, 1].map(|axis| {
                    origin[axis] + across * (right[axis] - origin[axis]) + along * (down[axis] - origin[axis])
                })
            };
            let behind = f64::from(*value);
            let shown = |[x, y]: [f64; 2]| print.ink(x, y).map_or(behind, |ink| black + hard.contrast * ink);
            let first = shown(middle);
            let corners = [at(0.02, 0.02), at(0.98, 0.02), at(0.02, 0.98), at(0.98, 0.98)].map(shown);
            let mean = if corners.iter().all(|gray| *gray == first) {
                first
            } else {
                (0..36)
                    .map(|ray| shown(at((f64::from(ray % 6) + 0.5) / 6.0, (f64::from(ray / 6) + 0.5) / 6.0)))
                    .sum::<f64>()
                    / 36.0
            };
            let shine = if print.ink(middle[0], middle[1]).is_some() { glare(middle) } else { 0.0 };
            *value = (mean * (1.0 - shine) + 262.0 * shine) as f32;
        }
    });
    let lamp = |column: usize| (0.88 + 0.24 * column as f64 / width as f64) as f32;
    picture.iter_mut().enumerate().for_each(|(index, value)| *value *= lamp(index % width));
    let blurred = blur(&picture, width, hard.blur_px);
    let seeds: Vec<u64> = (0..height).map(|_| random.random()).collect();
    let mut gray = vec![0u8; width * height];
    gray.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        let mut random = Pcg64::seed_from_u64(seeds[row]);
        for (column, byte) in line.iter_mut().enumerate() {
            let value = f64::from(blurred[row * width + column]) + hard.noise * normal(&mut random);
            *byte = value.round().clamp(0.0, 255.0) as u8;
        }
    });
    let side = board.square_mm();
    let truth = board.corners().into_iter().map(|q| {
        let pixel = camera.project(Point::<Camera>::new(pose * q.mm)).expect("in front");
        // A corner is treated as visible if the glare around it leaves two thirds of the contrast; the circles of an
        // asymmetric board are larger.
        let reach = if board.circles() == Some(true) { 0.3 * std::f64::consts::SQRT_2 } else { 0.3 };
        let around = (0..9).map(|index| {
            let (x, y) = (f64::from(index % 3) - 1.0, f64::from(index / 3) - 1.0);
            glare([q.mm.x + reach * side * x, q.mm.y + reach * side * y])
        });
        let most = around.fold(0.0, f64::max);
        (q, pixel, most < 0.35)
    });
    Rendered { truth: truth.collect(), picture: GrayPicture { width, height, gray } }
}

fn blur(picture: &[f32], width: usize, sigma: f64) -> Vec<f32> {
    if sigma < 0.2 {
        return picture.to_vec();
    }
    let reach = (3.5 * sigma).ceil() as isize;
    let weights: Vec<f32> = (-reach..=reach).map(|at| (-0.5 * (at as f64 / sigma).powi(2)).exp() as f32).collect();
    let sum: f32 = weights.iter().sum();
    let height = picture.len() / width;
    let pass = |from: &[f32], (step, size): (usize, usize)| -> Vec<f32> {
        let mut to = vec![0.0f32; from.len()];
        to.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            for (column, value) in line.iter_mut().enumerate() {
                let (index, at) = (row * width + column, if step == 1 { column } else { row } as isize);
                let mut total = 0.0;
                for (offset, weight) in weights.iter().enumerate() {
                    let away = offset as isize - reach;
                    let there = (at + away).clamp(0, size as isize - 1) - at;
                    total += weight * from[(index as isize + there * step as isize) as usize];
                }
                *value = total / sum;
            }
        });
        to
    };
    let across = pass(picture, (1, width));
    pass(&across, (width, height))
}

/// Renders a picture without a board: clutter, fine texture, or stripes, with noise.
pub fn no_board(camera: &PinholeCamera, seed: u64) -> GrayPicture {
    let mut random = Pcg64::seed_from_u64(seed);
    let (width, height) = (camera.width_px, camera.height_px);
    let mut ground = draw_clutter(camera, &mut random);
    match seed % 3 {
        1 => ground.iter_mut().for_each(|gray| *gray = 0.5 * *gray + 0.5 * random.random::<f32>()),
        2 => ground.iter_mut().enumerate().for_each(|(index, gray)| {
            let (u, v) = ((index % width) as f32, (index / width) as f32);
            *gray = 0.5 * *gray + 0.25 * (1.0 + (0.21 * u + 0.13 * v).sin().signum());
        }),
        _ => {}
    }
    let ground = blur(&ground, width, 0.7);
    let gray =
        ground.iter().map(|gray| (20.0 + 200.0 * f64::from(*gray) + 2.0 * normal(&mut random)).round() as u8);
    GrayPicture { width, height, gray: gray.collect() }
}

/// The result of comparing a detection with the ground truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Judged {
    /// Every visible corner was detected, and no corner at a wrong position; the value is their rms error, px.
    Found(f64),
    /// At most a tenth of the visible corners is missing; the values are the rms error of the others, px, and the
    /// number of missing ones.
    Nearly(f64, usize),
    /// More corners are missing; the value is their number.
    Part(usize),
    /// Some corners are at a wrong position; the value is the largest error, px.
    Wrong(f64),
    /// No corner was detected.
    Nothing,
}

/// Minimum error at which a corner is treated as being at a wrong position, px.
pub const MIN_WRONG_PX: f64 = 0.5;

/// Compares detected corners with the ground truth; for boards that look the same after a rotation, rotated corners are
/// accepted.
pub fn judge(board: &Board, rendered: &Rendered, found: Option<&detect::Corners>) -> Judged {
    let Some(found) = found else { return Judged::Nothing };
    let far = rendered.truth.last().map(|(q, ..)| q.mm).unwrap_or_default();
    let same = |q: Point<BoardFrame>| q;
    let turned = |q: Point<BoardFrame>| Point::at(far.x - q.mm.x, far.y - q.mm.y, 0.0);
    let quarter = |q: Point<BoardFrame>| Point::at(far.x - q.mm.y, q.mm.x, 0.0);
    let third = |q: Point<BoardFrame>| Point::at(q.mm.y, far.y - q.mm.x, 0.0);
    let mut ways: Vec<&dyn Fn(Point<BoardFrame>) -> Point<BoardFrame>> = vec![&same];
    if !board.is_unique() {
        ways.push(&turned);
        if board.columns() == board.rows() {
            ways.extend::<[&dyn Fn(Point<BoardFrame>) -> Point<BoardFrame>; 2]>([&quarter, &third]);
        }
    }
    let judged = ways.into_iter().map(|way| {
        let off = |q: Point<BoardFrame>, pixel: Pixel| {
            let there = rendered.truth.iter().find(|(t, ..)| t.distance_mm(way(q)) < 0.01);
            there.map_or(f64::INFINITY, |(_, truth, _)| truth.distance_px(pixel))
        };
        let errors: Vec<f64> = found.iter().map(|(q, pixel)| off(*q, *pixel)).collect();
        let is_there = |q: &Point<BoardFrame>| found.iter().any(|(f, _)| way(*f).distance_mm(*q) < 0.01);
        let missing = rendered.truth.iter().filter(|(q, _, seen)| *seen && !is_there(q)).count();
        let worst = errors.iter().copied().fold(0.0, f64::max);
        let rms = rms(errors.iter().copied());
        (worst, missing, rms)
    });
    let seen = rendered.truth.iter().filter(|(_, _, seen)| *seen).count();
    match judged.min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((worst, ..)) if worst > MIN_WRONG_PX => Judged::Wrong(worst),
        Some((_, 0, rms)) => Judged::Found(rms),
        Some((_, missing, rms)) if 10 * missing <= seen => Judged::Nearly(rms, missing),
        Some((_, missing, _)) => Judged::Part(missing),
        None => Judged::Nothing,
    }
}

/// Draws a random mixture of difficulties with which a person can still see the board. The blur is limited to a
/// fraction of the foreshortened side of a square, or of a marker's cell.
pub fn random_difficulties(board: &Board, camera: &PinholeCamera, seed: u64) -> Hard {
    let mut random = Pcg64::seed_from_u64(seed ^ 0xB0A2D);
    let mut between = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let mut hard = Hard {
        blur_px: between(0.4, 3.0),
        noise: between(1.0, 8.0),
        contrast: between(25.0, 170.0),
        glare: between(0.0, 1.0) < 0.4,
        tilt_deg: between(0.0, 60.0),
        dark: between(0.0, 1.0) < 0.3,
        width_share: between(0.15, 0.7),
    };
    let across = (board.columns() + 1) as f64 + 2.0 * RIM_SQUARES;
    let side_px = hard.width_share * camera.width_px as f64 / across * hard.tilt_deg.to_radians().cos();
    let detail_px = match board.markers() {
        Some(markers) => side_px * markers.marker_mm / board.square_mm() / 6.0,
        None => side_px * if board.circles().is_some() { 0.5 } else { 1.0 },
    };
    hard.blur_px = hard.blur_px.min(if board.markers().is_some() { 0.45 } else { 0.2 } * detail_px);
    hard
}
