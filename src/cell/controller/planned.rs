//! Numbers of the controller's data list with which the PC plans: the data list must have the same.

/// At a stop in contact the controller's program lifts the tool off by this distance, mm: CELL_RETRACT_MM.
pub const RETRACT_MM: f64 = 50.0;
/// The speed of this retract, mm/s: CELL_RETRACT_VEL. In a cell whose own limit is lower, the retract may be slower.
pub const RETRACT_MM_S: f64 = 200.0;
/// The lowest acceleration of this retract, m/s²: CELL_RETRACT_ACC. The worst case of Abort in the safety concept counts
/// with it: 0.2 m/s are reached and lost in 0.2 / 2 = 0.1 s.
pub const RETRACT_M_S2: f64 = 2.0;
/// The acceleration of each motion in the air, m/s²: CELL_ACC_MAX must allow it.
pub const AIR_ACCELERATION_M_S2: f64 = 1.0;
