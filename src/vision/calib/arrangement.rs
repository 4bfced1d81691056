//! The two arrangements of camera and board (thesis Fig. 3.8): camera in the cell and board on the flange, or the
//! reverse.
//!
//! In both, `camera_from_board = to_from_camera⁻¹ · to_from_holder · holder_from_board` (Eq. 3.18, 3.19). Only the
//! middle factor moves: `base_from_flange` for a fixed camera, `flange_from_base` for one on the flange.

use nalgebra::Isometry3;
use panelprep_base::geometry::{Base, Flange, Frame, Rigid};
use panelprep_cell::cell::{FlangeCameraMount, Mount, ScannerMount};

/// States which of camera and board moves with the flange.
pub trait Arrangement: Mount + Copy + std::fmt::Debug {
    /// The frame of the part that carries the board.
    type Holder: Frame;
    /// Whether the camera moves with the flange.
    const EYE_IN_HAND: bool;

    /// Returns the part of the chain that moves.
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

/// A small motion, a rotation by `ω` rad and a shift by `v` mm, written (ω, v).
pub(super) type Twist = nalgebra::Vector6<f64>;

pub(super) fn exp_map(twist: &Twist) -> Isometry3<f64> {
    Isometry3::new(twist.fixed_rows::<3>(3).into_owned(), twist.fixed_rows::<3>(0).into_owned())
}

pub(super) fn log(motion: &Isometry3<f64>) -> Twist {
    let (turn, shift) = (motion.rotation.scaled_axis(), motion.translation.vector);
    Twist::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}
