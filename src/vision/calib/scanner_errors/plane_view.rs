//! A scan of the flat board, reduced to blocks, each with a robust mean of 1/z and the deviation of a pixel from it;
//! and for the parts of the camera's picture, the number of scans that show the board there and the residuals of its
//! plane.
//!
//! A plane in front of the camera has a 1/z that is linear in (1, x, y). The plane is fitted by least squares.

use super::super::board::{Board, Corners};
use super::super::chain::{BoardObservation, board_pose};
use super::super::detect;
use super::super::error::CalibError;
use nalgebra::{DMatrix, Matrix3, Vector3};
use panelprep_base::geometry::statistics::SIGMA_OF_MEDIAN;
use panelprep_base::geometry::{
    Camera, DepthField, FieldRectangle, OrganizedCloud, PinholeCamera, Point, REFERENCE_DEPTH_MM,
    interpolated_median,
};
use panelprep_base::number_text::fixed_decimals;
use std::collections::BTreeMap;

/// A block of points on the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Direction of the block, (X/Z, Y/Z).
    pub direction: [f64; 2],
    /// Position of the block on the board, relative to the centre of the board, mm.
    pub position_mm: [f64; 2],
    /// Robust mean of the inverse depth 1/z, 1/mm.
    pub per_depth: f64,
}

/// Number of blocks along each side of the board.
const BLOCKS_PER_SIDE: usize = 16;
/// Fraction of the outer squares that is treated as part of the board as well.
const OUTER_SQUARE_FRACTION: f64 = 0.8;
/// Maximum distance of a point from the board pose, relative to its depth; a point farther away belongs to another
/// object.
const MAX_RELATIVE_DEPTH_DEVIATION: f64 = 0.02;
/// Maximum relative difference between the size of the squares that the 3D camera measures and the stated size. With a
/// larger one, the board pose from the picture would not be at the measured points.
const MAX_RELATIVE_SQUARE_DIFFERENCE: f64 = 0.01;
/// Minimum number of points in a block, as a fraction of the usual number.
const MIN_FILLED_FRACTION: f64 = 0.3;
/// Minimum number of blocks with enough points.
const MIN_BLOCKS: usize = 40;

/// A scan that shows the board.
pub struct BoardScan<'a> {
    /// The points of the scan.
    pub cloud: &'a OrganizedCloud<Camera>,
    /// The lens model of the camera.
    pub camera: &'a PinholeCamera,
    /// The calibration board.
    pub board: &'a Board,
    /// The corners of the board in the picture of the scan.
    pub corners: &'a Corners,
}

/// A scan of the board as blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneView {
    /// The blocks with enough points.
    pub blocks: Vec<Block>,
    /// White noise of a pixel at the reference depth, mm.
    pub white_mm: f64,
    /// Depth of the centre of the board, mm.
    pub depth_mm: f64,
    /// Rotation of the board in its plane, degrees.
    pub turn_deg: f64,
    /// Half of the diagonal of the board, mm.
    pub half_diagonal_mm: f64,
    corners: Vec<([f64; 2], Point<Camera>)>,
}

/// A scanned point on the board.
struct Sample {
    direction: [f64; 2],
    position_mm: [f64; 2],
    per_depth: f64,
    block: usize,
}

impl PlaneView {
    /// Reduces a scan to blocks.
    ///
    /// # Errors
    /// If the corners give no pose, or the board has too few points.
    pub fn from_scan(scan: &BoardScan<'_>) -> Result<Self, CalibError> {
        let pose = board_pose::<Camera>(scan.camera, &BoardObservation::Pixels(scan.corners.clone()))?;
        let middle = scan.board.centre();
        let seen = detect::measured(scan.cloud, scan.camera, scan.corners);
        let differs = |measured_mm: f64| (measured_mm / scan.board.square_mm() - 1.0).abs();
        if let Some(measured_mm) = seen.square_mm(scan.board)
            && (differs(measured_mm).is_nan() || differs(measured_mm) > MAX_RELATIVE_SQUARE_DIFFERENCE)
        {
            return Err(CalibError::Points(format!(
                "the 3D camera measures squares of {} mm, but --square-mm states {} mm, a difference of more than \
                 {} %: measure the board over many squares",
                fixed_decimals(measured_mm, 2),
                scan.board.square_mm(),
                fixed_decimals(100.0 * MAX_RELATIVE_SQUARE_DIFFERENCE, 0)
            )));
        }
        let samples = samples(scan, &pose.camera_from_board);
        let few = || {
            CalibError::Points(
                "too few points on the board in the scan; check the exposure, and look for glare on the board"
                    .to_owned(),
            )
        };
        let found = fit_robust_plane(&samples).ok_or_else(few)?;
        let off_mm =
            |sample: &Sample| -(sample.per_depth - value_at(&found, sample.direction)) / sample.per_depth.powi(2);
        let mut by_block: Vec<Vec<&Sample>> = (0..BLOCKS_PER_SIDE * BLOCKS_PER_SIDE).map(|_| Vec::new()).collect();
        samples.iter().for_each(|sample| by_block[sample.block].push(sample));
        let mut counts: Vec<f64> =
            by_block.iter().filter(|all| !all.is_empty()).map(|all| all.len() as f64).collect();
        let usual = interpolated_median(&mut counts).ok_or_else(few)?;
        let filled = by_block.iter().filter(|all| all.len() as f64 >= MIN_FILLED_FRACTION * usual && all.len() > 4);
        let (mut blocks, mut apart) = (Vec::new(), Vec::new());
        for all in filled {
            let mut off: Vec<f64> = all.iter().map(|sample| off_mm(sample)).collect();
            let Some(middle_mm) = interpolated_median(&mut off) else { continue };
            let mean = |value: fn(&Sample) -> f64| all.iter().map(|one| value(one)).sum::<f64>() / all.len() as f64;
            let direction = [mean(|one| one.direction[0]), mean(|one| one.direction[1])];
            let on_plane = value_at(&found, direction);
            apart.extend(
                all.iter()
                    .map(|one| (off_mm(one) - middle_mm).abs() * (one.per_depth * REFERENCE_DEPTH_MM).powi(2)),
            );
            blocks.push(Block {
                direction,
                position_mm: [mean(|one| one.position_mm[0]), mean(|one| one.position_mm[1])],
                per_depth: on_plane - middle_mm * on_plane * on_plane,
            });
        }
        if blocks.len() < MIN_BLOCKS {
            return Err(few());
        }
        let white_mm = SIGMA_OF_MEDIAN * interpolated_median(&mut apart).ok_or_else(few)?;
        let turn = pose.camera_from_board.rotation();
        let corners = match detect::measured(scan.cloud, scan.camera, scan.corners) {
            BoardObservation::Points(points) => {
                points.into_iter().map(|(at, point)| ([at.mm.x, at.mm.y], point)).collect()
            }
            BoardObservation::Pixels(_) => Vec::new(),
        };
        let first = scan.board.corner(0, 0).unwrap_or(middle);
        Ok(PlaneView {
            blocks,
            white_mm,
            depth_mm: (pose.camera_from_board * middle).mm.z,
            turn_deg: turn.matrix()[(1, 0)].atan2(turn.matrix()[(0, 0)]).to_degrees(),
            half_diagonal_mm: (first - middle).mm.norm(),
            corners,
        })
    }

    /// Returns the measured corners relative to their mean, mm, and the mean.
    fn centred_corners(&self, field: Option<&DepthField>) -> (Vec<Vector3<f64>>, Vector3<f64>) {
        let corrected = |point: &Point<Camera>| field.map_or(*point, |field| field.corrected_point(*point));
        let measured: Vec<Vector3<f64>> =
            self.corners.iter().map(|(_, point)| corrected(point).mm.coords).collect();
        let mean = measured.iter().sum::<Vector3<f64>>() / measured.len() as f64;
        (measured.iter().map(|point| point - mean).collect(), mean)
    }

    /// Returns the ratio of measured to printed distances between corners, minus one, percent.
    pub fn scale_percent(&self, field: Option<&DepthField>) -> f64 {
        let count = self.corners.len() as f64;
        let spread: f64 = self.centred_corners(field).0.iter().map(Vector3::norm_squared).sum();
        let middle = [0, 1].map(|axis| self.corners.iter().map(|(at, _)| at[axis]).sum::<f64>() / count);
        let printed: f64 =
            self.corners.iter().map(|(at, _)| (at[0] - middle[0]).powi(2) + (at[1] - middle[1]).powi(2)).sum();
        100.0 * ((spread / printed).sqrt() - 1.0)
    }

    /// Returns the derivative of the scale of this scan with respect to the depth of each corner, 1/mm. With the
    /// corners r relative to their mean and their rays d, depth errors e change the scale by Σ e (r · d) / Σ |r|².
    fn scale_depth_gradient(&self) -> impl Iterator<Item = (&[f64; 2], Vector3<f64>, f64)> {
        let (about, mean) = self.centred_corners(None);
        let squares: f64 = about.iter().map(Vector3::norm_squared).sum();
        self.corners.iter().zip(about).map(move |((printed, _), from_mean)| {
            let point = mean + from_mean;
            (printed, point, from_mean.dot(&(point / point.z)) / squares)
        })
    }

    /// Returns the change of the scale of this scan due to a depth error of this form over the directions, percent per
    /// mm at the reference depth.
    pub fn scale_change_percent(&self, form: impl Fn([f64; 2]) -> f64) -> f64 {
        let of = |point: Vector3<f64>| {
            form([point.x / point.z, point.y / point.z]) * (point.z / REFERENCE_DEPTH_MM).powi(2)
        };
        100.0 * self.scale_depth_gradient().map(|(_, point, part)| of(point) * part).sum::<f64>()
    }

    /// Returns the variance of the scale of this scan that its smooth error and the errors of the corners explain,
    /// squared percent. All corners in one square of the side `correlation_mm` have the same depth error.
    pub fn variance_of_scale(&self, deviation_mm: f64, correlation_mm: f64) -> f64 {
        let mut cells: BTreeMap<[i64; 2], f64> = BTreeMap::new();
        for (printed, _, part) in self.scale_depth_gradient() {
            *cells.entry(printed.map(|mm| (mm / correlation_mm).floor() as i64)).or_default() += part;
        }
        let by_depth = deviation_mm.powi(2) * cells.values().map(|part| part * part).sum::<f64>();
        100.0_f64.powi(2) * (by_depth + self.variance_of_scale_from_corners().unwrap_or(0.0))
    }

    /// Returns the variance of the scale that independent errors of the corners cause. After an affine map from the
    /// printed corners to the measured ones, a remainder is left in their plane. The result is the variance of each
    /// coordinate of this remainder divided by Σ |r|². The corners are not corrected, so a bend of the board is
    /// included here. The part that a correction does not remove differs from position to position, and would appear as
    /// a scale that differs from scan to scan.
    fn variance_of_scale_from_corners(&self) -> Option<f64> {
        let (about, _) = self.centred_corners(None);
        let printed = DMatrix::from_fn(about.len(), 3, |row, column| match column {
            2 => 1.0,
            axis => self.corners[row].0[axis],
        });
        let measured = DMatrix::from_fn(about.len(), 3, |row, axis| about[row][axis]);
        let map = (printed.transpose() * &printed).try_inverse()? * printed.transpose() * &measured;
        let axis = |row: usize| Vector3::new(map[(row, 0)], map[(row, 1)], map[(row, 2)]);
        let normal = axis(0).cross(&axis(1)).try_normalize(f64::MIN_POSITIVE)?;
        let left = measured - printed * map;
        let in_plane = left.row_iter().map(|row| {
            let left = Vector3::new(row[0], row[1], row[2]);
            left.norm_squared() - left.dot(&normal).powi(2)
        });
        let free = (2 * about.len()).checked_sub(6).filter(|free| *free > 0)?;
        let squares: f64 = about.iter().map(Vector3::norm_squared).sum();
        Some(in_plane.sum::<f64>() / free as f64 / squares)
    }
}

fn samples(
    scan: &BoardScan<'_>,
    camera_from_board: &panelprep_base::geometry::Rigid<Camera, panelprep_base::geometry::Board>,
) -> Vec<Sample> {
    let (board, middle) = (scan.board, scan.board.centre().mm);
    let board_from_camera = camera_from_board.inverse();
    let outer_mm = OUTER_SQUARE_FRACTION * board.square_mm();
    let least = [-outer_mm, -outer_mm];
    let span = [board.columns(), board.rows()].map(|count| (count - 1) as f64 * board.square_mm() + 2.0 * outer_mm);
    let sample = |point: Point<Camera>| {
        let on = (board_from_camera * point).mm;
        let share = [(on.x - least[0]) / span[0], (on.y - least[1]) / span[1]];
        let inside = share.iter().all(|share| (0.0..1.0).contains(share))
            && on.z.abs() < MAX_RELATIVE_DEPTH_DEVIATION * point.mm.z;
        inside.then(|| Sample {
            direction: [point.mm.x / point.mm.z, point.mm.y / point.mm.z],
            position_mm: [on.x - middle.x, on.y - middle.y],
            per_depth: 1.0 / point.mm.z,
            block: (share[1] * BLOCKS_PER_SIDE as f64) as usize * BLOCKS_PER_SIDE
                + (share[0] * BLOCKS_PER_SIDE as f64) as usize,
        })
    };
    scan.cloud.valid_points().filter_map(|(_, point)| sample(point)).collect()
}

/// Returns the plane through most of the points.
fn fit_robust_plane(samples: &[Sample]) -> Option<Vector3<f64>> {
    let all = || samples.iter().map(|one| (one.direction, one.per_depth));
    let mut found = fit_plane(all())?;
    for _ in 0..2 {
        let off = |(direction, per_depth): ([f64; 2], f64)| (per_depth - value_at(&found, direction)).abs();
        let most = 4.0 * SIGMA_OF_MEDIAN * interpolated_median(&mut all().map(off).collect::<Vec<f64>>())?;
        found = fit_plane(all().filter(|one| off(*one) <= most))?;
    }
    Some(found)
}

/// Returns the coefficients of 1, x and y through these values; `None` if the directions do not determine them.
pub(super) fn fit_plane(values: impl IntoIterator<Item = ([f64; 2], f64)>) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ([x, y], value) in values {
        let row = Vector3::new(1.0, x, y);
        normal += row * row.transpose();
        right += row * value;
    }
    normal.cholesky().map(|found| found.solve(&right))
}

/// Returns the value of the plane in a direction.
pub(super) fn value_at(plane: &Vector3<f64>, [x, y]: [f64; 2]) -> f64 {
    plane.dot(&Vector3::new(1.0, x, y))
}

/// Returns the derivatives of the depths of these blocks with respect to each coefficient of the plane, mm.
pub(super) fn depths(blocks: &[Block]) -> DMatrix<f64> {
    DMatrix::from_fn(blocks.len(), 3, |row, column| {
        let Block { direction: [x, y], per_depth, .. } = blocks[row];
        [1.0, x, y][column] / per_depth.powi(2)
    })
}

/// A projection that removes every linear combination of given columns.
pub(super) struct Projection(DMatrix<f64>);

impl Projection {
    /// Creates the projection that removes these columns.
    pub fn orthogonal_to(columns: DMatrix<f64>) -> Self {
        Projection(columns.qr().q())
    }

    /// Returns the residual of each column after the projection.
    pub fn residual_of(&self, values: &DMatrix<f64>) -> DMatrix<f64> {
        values - &self.0 * (self.0.transpose() * values)
    }

    /// Returns the trace of a covariance that remains after the projection.
    pub fn projected_trace(&self, covariance: &DMatrix<f64>) -> f64 {
        covariance.trace() - (self.0.transpose() * covariance * &self.0).trace()
    }
}

/// Number of parts of the picture, across and down.
const PARTS: [usize; 2] = [8, 6];
/// Minimum number of scans in a part of the picture; fewer give no information on this part.
pub const MIN_SCANS: usize = 2;

/// A part of the picture, with the scans that show the board there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PicturePart {
    /// Direction of the centre of the part, (X/Z, Y/Z).
    pub direction: [f64; 2],
    /// Number of scans that show the board in this part.
    pub scans: usize,
    /// Deviation of left-out scans from a plane in this part, rms, mm, after the correction if there is one; NaN
    /// without scans.
    pub residual_mm: f64,
}

/// All parts of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureParts {
    rectangle: FieldRectangle,
    parts: Vec<PicturePart>,
}

impl PictureParts {
    /// Creates the parts of a picture with these directions; `residuals_mm` contains for each view the residuals of its
    /// blocks.
    pub(super) fn from_views(views: &[PlaneView], residuals_mm: &[Vec<f64>], over: FieldRectangle) -> Self {
        let mut scans = vec![0_usize; PARTS[0] * PARTS[1]];
        let mut sums = vec![(0.0, 0.0); scans.len()];
        for (view, residuals_mm) in views.iter().zip(residuals_mm) {
            let mut is_here = vec![false; scans.len()];
            for (block, residual_mm) in view.blocks.iter().zip(residuals_mm) {
                if let Some(part) = part(block.direction, &over) {
                    is_here[part] = true;
                    let (squares, count) = sums[part];
                    sums[part] = (squares + residual_mm * residual_mm, count + 1.0);
                }
            }
            scans.iter_mut().zip(is_here).for_each(|(scans, is_here)| *scans += usize::from(is_here));
        }
        let middle = |index: usize, axis: usize| {
            let share = (index as f64 + 0.5) / PARTS[axis] as f64;
            over.min[axis] + share * (over.max[axis] - over.min[axis])
        };
        let all = scans.into_iter().zip(sums).enumerate();
        let parts = all.map(|(index, (scans, (squares, count)))| PicturePart {
            direction: [middle(index % PARTS[0], 0), middle(index / PARTS[0], 1)],
            scans,
            residual_mm: (squares / count).sqrt(),
        });
        PictureParts { parts: parts.collect(), rectangle: over }
    }

    /// Iterates over the parts, row by row.
    pub fn iter(&self) -> impl Iterator<Item = &PicturePart> {
        self.parts.iter()
    }

    /// Returns the part in this direction; `None` outside of the picture.
    pub fn part_at(&self, direction: [f64; 2]) -> Option<&PicturePart> {
        self.parts.get(part(direction, &self.rectangle)?)
    }

    /// Returns the fraction of the parts in which enough scans show the board.
    pub(super) fn covered_share(&self) -> f64 {
        self.iter().filter(|part| part.has_enough_scans()).count() as f64 / self.parts.len() as f64
    }
}

impl PicturePart {
    /// Returns whether enough scans show the board in this part.
    pub fn has_enough_scans(&self) -> bool {
        self.scans >= MIN_SCANS
    }
}

fn part(direction: [f64; 2], over: &FieldRectangle) -> Option<usize> {
    let share = |axis: usize| {
        let share = (direction[axis] - over.min[axis]) / (over.max[axis] - over.min[axis]);
        (0.0..1.0).contains(&share).then(|| (share * PARTS[axis] as f64) as usize)
    };
    Some(share(1)? * PARTS[0] + share(0)?)
}
