//! The kinematic chain from camera to board: how a corner in a station's view moves with camera mount, board, flange
//! and lens. This is equation (1) of `adjust` with its derivatives, summed for each station as its part of the normal
//! equations.
//!
//! Camera and board have two arrangements (thesis Fig. 3.8): camera in the cell and board on the flange, or the
//! reverse. In both, `camera_from_board = to_from_camera⁻¹ · to_from_holder · holder_from_board` (Eq. 3.18, 3.19). Only
//! the middle factor moves: `base_from_flange` for a fixed camera, `flange_from_base` for a camera on the flange.
//!
//! The pose of the board in one picture is that of perspective-n-point (thesis 3.7); in one 3D scan it is that of
//! Kabsch.

use super::error::CalibError;
use super::foreign;
use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, SVector, Vector3};
use panelprep_base::geometry::{Base, Board, Flange, Frame, PinholeCamera, Pixel, Point, Rigid, fit_rigid_motion};
use panelprep_cell::cell::{FlangeCameraMount, Mount, ScannerMount};

/// The arrangement of camera and board: which of them moves with the flange.
pub trait Arrangement: Mount + Copy + std::fmt::Debug {
    /// The frame of the part that carries the board.
    type Holder: Frame;
    /// Whether the camera moves with the flange.
    const EYE_IN_HAND: bool;

    /// Returns the moving factor of the chain.
    fn to_from_holder(base_from_flange: &Rigid<Base, Flange>) -> Rigid<Self::To, Self::Holder>;
}

impl Arrangement for ScannerMount {
    type Holder = Flange;
    const EYE_IN_HAND: bool = false;

    fn to_from_holder(base_from_flange: &Rigid<Base, Flange>) -> Rigid<Base, Flange> {
        *base_from_flange
    }
}

impl Arrangement for FlangeCameraMount {
    type Holder = Base;
    const EYE_IN_HAND: bool = true;

    fn to_from_holder(base_from_flange: &Rigid<Base, Flange>) -> Rigid<Flange, Base> {
        base_from_flange.inverse()
    }
}

/// A small motion (ω, v): a rotation by `ω` rad and a shift by `v` mm.
pub(super) type Twist = nalgebra::Vector6<f64>;

pub(super) fn exp_map(twist: &Twist) -> Isometry3<f64> {
    Isometry3::new(twist.fixed_rows::<3>(3).into_owned(), twist.fixed_rows::<3>(0).into_owned())
}

pub(super) fn log(motion: &Isometry3<f64>) -> Twist {
    let (turn, shift) = (motion.rotation.scaled_axis(), motion.translation.vector);
    Twist::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

/// The observation of the board by a camera.
#[derive(Debug, Clone, PartialEq)]
pub enum BoardObservation<C: Frame> {
    /// Corners in a picture, each as a point on the board and its pixel.
    Pixels(Vec<(Point<Board>, Pixel)>),
    /// Corners measured by a 3D camera, each as a point on the board and the measured point.
    Points(Vec<(Point<Board>, Point<C>)>),
}

impl<C: Frame> BoardObservation<C> {
    /// Returns the mean side of the board's squares as the 3D camera measured them, mm; `None` for a picture, or
    /// without neighbouring corners.
    pub fn square_mm(&self, board: &super::board::Board) -> Option<f64> {
        let BoardObservation::Points(points) = self else { return None };
        let is_neighbour = |a: &Point<Board>, b: &Point<Board>| {
            let step = (b.mm - a.mm) / board.square_mm();
            (step.norm() - 1.0).abs() < 0.1 && (step.x > 0.5 || step.y > 0.5)
        };
        let pairs = points.iter().flat_map(|a| points.iter().map(move |b| (a, b)));
        let sides = pairs.filter(|(a, b)| is_neighbour(&a.0, &b.0)).map(|(a, b)| a.1.distance_mm(b.1));
        let (sum, count) = sides.fold((0.0, 0), |(sum, count), side| (sum + side, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }
}

/// One picture of the board with the reported flange pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Station<C: Frame> {
    /// Name of the picture in messages.
    pub name: String,
    /// The flange pose that the robot reported.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The camera's observation of the board.
    pub observation: BoardObservation<C>,
}

/// A matrix over mount and board, in this order, each with the six components (ω, v).
pub(super) type MountBoardMatrix = SMatrix<f64, 12, 12>;
type NormalMatrix = SMatrix<f64, 18, 18>;

/// The part of one station in the normal equations, for X, Y and e in this order.
pub(super) struct StationGram {
    pub normal: NormalMatrix,
    pub gradient: SVector<f64, 18>,
    /// Sum of the squared residuals, px² or mm².
    pub square: f64,
    pub rows: usize,
}

impl StationGram {
    fn empty() -> Self {
        StationGram { normal: NormalMatrix::zeros(), gradient: SVector::zeros(), square: 0.0, rows: 0 }
    }

    fn add<const R: usize>(&mut self, slope: &SMatrix<f64, R, 3>, at: &Corner, residual: &SVector<f64, R>) {
        let jacobian = at.jacobian(slope);
        self.normal += jacobian.transpose() * jacobian;
        self.gradient += jacobian.transpose() * residual;
        self.square += residual.norm_squared();
        self.rows += R;
    }

    pub fn flange(&self) -> Matrix6<f64> {
        self.normal.fixed_view::<6, 6>(12, 12).into_owned()
    }

    pub fn cross(&self) -> SMatrix<f64, 12, 6> {
        self.normal.fixed_view::<12, 6>(0, 12).into_owned()
    }

    pub fn mount_and_board(&self) -> MountBoardMatrix {
        self.normal.fixed_view::<12, 12>(0, 0).into_owned()
    }
}

/// A stated length that may be wrong by a scale factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LengthFactor {
    /// The side of the board's squares.
    Square,
    /// The focal lengths of the lens.
    Focal,
}

/// The part of one station in the normal equations of a scale factor.
pub(super) struct ScaleGram {
    /// Cross terms of the factor with X, Y and e.
    pub cross_terms: SVector<f64, 18>,
    pub square: f64,
    pub pull: f64,
    /// Cross terms of the factor with the lens parameters.
    pub lens: SMatrix<f64, 1, 9>,
}

impl ScaleGram {
    fn empty() -> Self {
        ScaleGram { cross_terms: SVector::zeros(), square: 0.0, pull: 0.0, lens: SMatrix::zeros() }
    }
}

/// The derivatives of a corner in the camera frame with respect to small rotations and shifts of camera, board and
/// flange.
struct Corner {
    camera: (Matrix3<f64>, Matrix3<f64>),
    board: (Matrix3<f64>, Matrix3<f64>),
    flange: (Matrix3<f64>, Matrix3<f64>),
}

impl Corner {
    fn jacobian<const R: usize>(&self, slope: &SMatrix<f64, R, 3>) -> SMatrix<f64, R, 18> {
        let mut jacobian = SMatrix::<f64, R, 18>::zeros();
        for (index, (turn, shift)) in [self.camera, self.board, self.flange].into_iter().enumerate() {
            jacobian.fixed_columns_mut::<3>(6 * index).copy_from(&(slope * turn));
            jacobian.fixed_columns_mut::<3>(6 * index + 3).copy_from(&(slope * shift));
        }
        jacobian
    }
}

/// The transforms of (1) for one station.
pub(super) struct Chain {
    camera_from_to: Isometry3<f64>,
    flange_from_base: Isometry3<f64>,
    holder_from_board: Isometry3<f64>,
    eye_in_hand: bool,
}

impl Chain {
    pub fn new<A: Arrangement>(
        mount: &Isometry3<f64>,
        board: &Isometry3<f64>,
        base_from_flange: &Rigid<Base, Flange>,
        deviation: &Isometry3<f64>,
    ) -> Self {
        Chain {
            camera_from_to: mount.inverse(),
            flange_from_base: (base_from_flange.isometry() * deviation).inverse(),
            holder_from_board: *board,
            eye_in_hand: A::EYE_IN_HAND,
        }
    }

    fn camera_from_holder(&self) -> Isometry3<f64> {
        let base_from_flange = self.flange_from_base.inverse();
        self.camera_from_to * if self.eye_in_hand { self.flange_from_base } else { base_from_flange }
    }

    fn corner(&self, camera_from_holder: &Isometry3<f64>, q: &Point<Board>) -> (Vector3<f64>, Corner) {
        let camera_from_board = camera_from_holder * self.holder_from_board;
        let seen = (camera_from_board * q.mm).coords;
        let board_turn = camera_from_board.rotation.to_rotation_matrix().into_inner();
        let in_holder = self.holder_from_board * q.mm;
        // exp(e) acts on the point in the flange frame; if the camera is on the flange, the inverse of exp(e) acts on
        // it.
        let (in_flange, flange_turn) = if self.eye_in_hand {
            let turn = -self.camera_from_to.rotation.to_rotation_matrix().into_inner();
            ((self.flange_from_base * in_holder).coords, turn)
        } else {
            (in_holder.coords, camera_from_holder.rotation.to_rotation_matrix().into_inner())
        };
        let corner = Corner {
            camera: (seen.cross_matrix(), -Matrix3::identity()),
            board: (-board_turn * q.mm.coords.cross_matrix(), board_turn),
            flange: (-flange_turn * in_flange.cross_matrix(), flange_turn),
        };
        (seen, corner)
    }

    /// Returns the part of this station in the normal equations; `None` if a corner would be behind the camera.
    pub fn gram<C: Frame>(&self, camera: &PinholeCamera, seen: &BoardObservation<C>) -> Option<StationGram> {
        let (mut gram, camera_from_holder) = (StationGram::empty(), self.camera_from_holder());
        match seen {
            BoardObservation::Pixels(corners) => {
                for (q, found) in corners {
                    let (p, corner) = self.corner(&camera_from_holder, q);
                    let (pixel, slope) = camera.project_with_jacobian(Point::<C>::new(p.into()))?;
                    gram.add(&slope, &corner, &nalgebra::Vector2::new(found.u - pixel.u, found.v - pixel.v));
                }
            }
            BoardObservation::Points(corners) => {
                for (q, found) in corners {
                    let (p, corner) = self.corner(&camera_from_holder, q);
                    gram.add(&Matrix3::identity(), &corner, &(found.mm.coords - p));
                }
            }
        }
        Some(gram)
    }

    /// Returns the part of this station in the normal equations of a factor 1 + s, as an unknown in addition to mount,
    /// board and flange. The factor scales either the squares of the board, so that every corner is at (1 + s) · q, or
    /// the focal lengths. The points of a 3D camera do not depend on the focal lengths.
    pub fn factor_gram<C: Frame>(
        &self,
        camera: &PinholeCamera,
        seen: &BoardObservation<C>,
        factor: LengthFactor,
    ) -> Option<ScaleGram> {
        let (mut gram, camera_from_holder) = (ScaleGram::empty(), self.camera_from_holder());
        let turn = (camera_from_holder * self.holder_from_board).rotation;
        match seen {
            BoardObservation::Pixels(corners) => {
                for (q, found) in corners {
                    let (p, corner) = self.corner(&camera_from_holder, q);
                    let point = Point::<C>::new(p.into());
                    let (pixel, slope) = camera.project_with_jacobian(point)?;
                    let lens_jacobian = camera.lens_jacobian(point)?;
                    let along = match factor {
                        LengthFactor::Square => slope * (turn * q.mm.coords),
                        LengthFactor::Focal => {
                            lens_jacobian.column(0) * camera.fx_px + lens_jacobian.column(1) * camera.fy_px
                        }
                    };
                    let residual = nalgebra::Vector2::new(found.u - pixel.u, found.v - pixel.v);
                    gram.cross_terms += corner.jacobian(&slope).transpose() * along;
                    gram.lens += along.transpose() * lens_jacobian;
                    gram.square += along.norm_squared();
                    gram.pull += along.dot(&residual);
                }
            }
            BoardObservation::Points(_) if factor == LengthFactor::Focal => return None,
            BoardObservation::Points(corners) => {
                for (q, found) in corners {
                    let (p, corner) = self.corner(&camera_from_holder, q);
                    let along = turn * q.mm.coords;
                    gram.cross_terms += corner.jacobian(&Matrix3::identity()).transpose() * along;
                    gram.square += along.norm_squared();
                    gram.pull += along.dot(&(found.mm.coords - p));
                }
            }
        }
        Some(gram)
    }

    /// Returns the cross terms of the lens with mount, board and flange in the normal equations: they state how an
    /// error of the lens changes mount, board and flange. The points of a 3D camera have no cross terms.
    pub fn lens_cross<C: Frame>(
        &self,
        camera: &PinholeCamera,
        seen: &BoardObservation<C>,
    ) -> Option<SMatrix<f64, 18, 9>> {
        let (mut cross, camera_from_holder) = (SMatrix::zeros(), self.camera_from_holder());
        let BoardObservation::Pixels(corners) = seen else { return Some(cross) };
        for (q, _) in corners {
            let (p, corner) = self.corner(&camera_from_holder, q);
            let point = Point::<C>::new(p.into());
            let (_, slope) = camera.project_with_jacobian(point)?;
            cross += corner.jacobian(&slope).transpose() * camera.lens_jacobian(point)?;
        }
        Some(cross)
    }
}

/// The pose of a board with the residual of its corners: px for pixels, mm for points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPose<C: Frame> {
    /// The pose of the board in the camera frame.
    pub camera_from_board: Rigid<C, Board>,
    /// Root mean square distance between measured and computed corners.
    pub rms: f64,
}

/// Computes the pose of the board from the observation.
///
/// # Errors
/// If fewer than four corners were seen, or OpenCV finds no pose.
pub fn board_pose<C: Frame>(
    camera: &PinholeCamera,
    seen: &BoardObservation<C>,
) -> Result<BoardPose<C>, CalibError> {
    match seen {
        BoardObservation::Pixels(corners) => {
            let camera_from_board: Rigid<C, Board> =
                Rigid::from_isometry_unchecked(foreign::solve_pnp(camera, corners)?);
            let error = |&(q, found): &(Point<Board>, Pixel)| {
                camera.project(camera_from_board * q).map_or(f64::INFINITY, |pixel| pixel.distance_px(found))
            };
            let rms =
                (corners.iter().map(|corner| error(corner).powi(2)).sum::<f64>() / corners.len() as f64).sqrt();
            Ok(BoardPose { camera_from_board, rms })
        }
        BoardObservation::Points(corners) => kabsch(corners),
    }
}

/// Returns the least-squares pose that maps the points of the board onto the measured ones.
fn kabsch<C: Frame>(corners: &[(Point<Board>, Point<C>)]) -> Result<BoardPose<C>, CalibError> {
    if corners.len() < 4 {
        let words = format!(
            "{} points of the board were measured; at least 4 are needed, show more of the board",
            corners.len()
        );
        return Err(CalibError::Points(words));
    }
    let on_a_line =
        || CalibError::Points("the measured points of the board lie on a line; show more of the board".to_owned());
    let camera_from_board = fit_rigid_motion(corners).ok_or_else(on_a_line)?;
    let square: f64 = corners.iter().map(|(q, p)| (camera_from_board * *q).distance_mm(*p).powi(2)).sum();
    Ok(BoardPose { camera_from_board, rms: (square / corners.len() as f64).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Camera;

    /// Expected result, calculated by hand: a rotation by 90° about Z, then a shift of 100 mm along Z. The mirror image
    /// of the plane is not a solution.
    #[test]
    fn measured_points_give_the_pose() {
        let places = [[0.0, 0.0], [200.0, 0.0], [200.0, 125.0], [0.0, 125.0], [75.0, 50.0]];
        let corners: Vec<_> = places
            .iter()
            .map(|&[x, y]| (Point::<Board>::at(x, y, 0.0), Point::<Camera>::at(-y, x, 100.0)))
            .collect();
        let pose = kabsch(&corners).expect("a pose");
        assert!(pose.rms < 1e-9);
        let ahead = pose.camera_from_board * Point::<Board>::at(1.0, 2.0, 3.0);
        assert!(ahead.distance_mm(Point::at(-2.0, 1.0, 103.0)) < 1e-9, "{ahead:?}");
        assert!(kabsch(&corners[..3]).expect_err("three").to_string().contains("4 are needed"));
    }
}
