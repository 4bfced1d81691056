//! Lengths, offsets and axes of an arm.

/// A number for each axis, axis 1 first.
pub type PerAxis = [f64; 6];

/// The time in which an axis reaches its speed if the file does not state it, s. Data sheets do not state
/// accelerations.
pub(super) const AXIS_ACCELERATION_TIME_S: f64 = 0.3;

/// The arm's geometry; lengths as Brandstötter, Angerer and Hofbaur (2014) name them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmGeometry {
    /// Axis 1 to axis 2, forward, mm.
    pub a1_mm: f64,
    /// Axis 3 to the forearm, mm.
    pub a2_mm: f64,
    /// Axis 1 to axis 2, sideways, mm.
    pub b_mm: f64,
    /// Height of axis 2, mm.
    pub c1_mm: f64,
    /// The upper arm, mm.
    pub c2_mm: f64,
    /// The forearm, mm.
    pub c3_mm: f64,
    /// Wrist to flange, mm.
    pub c4_mm: f64,
    /// The angle of each axis at which the model's arm points straight up, degrees.
    pub offsets_deg: PerAxis,
    /// 1 or −1 for each axis.
    pub signs: [i8; 6],
}

/// The limits of the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmAxes {
    /// Lowest angles, degrees.
    pub min_deg: PerAxis,
    /// Highest angles, degrees.
    pub max_deg: PerAxis,
    /// Highest speeds, degrees a second.
    pub max_speed_deg_s: PerAxis,
    /// Highest accelerations, degrees a second squared.
    pub max_acceleration_deg_s2: PerAxis,
}
