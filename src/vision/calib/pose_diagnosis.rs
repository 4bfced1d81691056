//! Describes what poses that fit no mount were probably meant to be.

use panelprep_base::number_text::fixed_decimals;

/// A possible intended meaning of poses that fit no mount.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PoseInterpretation {
    /// The poses are `flange_from_base`, or the camera has the other mount.
    Inverted {
        /// Whether the other mount is more probable: the nearer one of camera and board is on the flange.
        other_mount: bool,
    },
    /// Three angles in another order or about other axes; the text names them.
    Angles(&'static str),
    /// A rotation vector.
    RotationVector {
        /// Whether the vector is in radians.
        radians: bool,
    },
    /// A quaternion with its four numbers in another order.
    Quaternion(&'static str),
    /// Only the rotation is inverted.
    Transposed,
    /// The axes are those of a left-handed frame.
    LeftHanded,
    /// Angles in radians.
    Radians,
    /// Each picture is paired with the pose of its neighbour.
    Shifted {
        /// Whether each picture is paired with the previous pose.
        late: bool,
    },
    /// The pictures are mirrored.
    Mirrored,
    /// Lengths of board and robot differ by a factor.
    Lengths {
        /// Ratio of the robot's lengths to the board's.
        ratio: f64,
        /// The side of a square as stated, mm.
        square_mm: f64,
    },
}

/// An interpretation of the poses in which they fit.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseReading {
    /// Interpretation of the numbers.
    pub interpretation: PoseInterpretation,
    /// The median distance of the boards, mm.
    pub median_mm: f64,
    /// The residual of the best of the other interpretations, mm.
    pub runner_up_mm: f64,
}

/// The unit of length that a scale factor indicates.
fn unit_from_scale(ratio: f64) -> Option<&'static str> {
    let units = [("metres", 1e-3), ("centimetres", 0.1), ("inches", 1.0 / 25.4), ("micrometres", 1e3)];
    units.into_iter().find(|(_, unit)| (ratio / unit - 1.0).abs() < 0.02).map(|(name, _)| name)
}

impl std::fmt::Display for PoseInterpretation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            PoseInterpretation::Inverted { other_mount: false } => write!(
                f,
                "the poses are inverted: they are flange_from_base; write base_from_flange (if they are right, --mount is wrong)"
            ),
            PoseInterpretation::Inverted { other_mount: true } => write!(
                f,
                "--mount is wrong: these poses fit a camera of the other mount (if --mount is right, the poses are \
                 inverted: flange_from_base)"
            ),
            PoseInterpretation::Angles(words) => write!(f, "{words}"),
            PoseInterpretation::RotationVector { radians } => {
                let unit = if *radians { "radians" } else { "degrees" };
                write!(f, "the three angles are a rotation vector in {unit}; write A, B, C in degrees")
            }
            PoseInterpretation::Quaternion(words) => {
                write!(f, "the angles come from a quaternion in another order: {words}")
            }
            PoseInterpretation::Transposed => {
                write!(
                    f,
                    "the rotations are transposed (inverted), but the positions are not; write base_from_flange"
                )
            }
            PoseInterpretation::LeftHanded => {
                write!(f, "the frames are left-handed, because one axis is negated; write right-handed frames")
            }
            PoseInterpretation::Radians => write!(f, "the angles are in radians; write A, B, C in degrees"),
            PoseInterpretation::Shifted { late } => {
                let where_to = if *late { "before" } else { "after" };
                write!(f, "each picture matches the pose {where_to} its own: the list is shifted by one picture")
            }
            PoseInterpretation::Mirrored => {
                write!(
                    f,
                    "the pictures are mirrored, left to right; use the pictures as the camera's sensor sees them"
                )
            }
            PoseInterpretation::Lengths { ratio, square_mm } => {
                let (found, stated) = (fixed_decimals(ratio * square_mm, 3), *square_mm);
                write!(
                    f,
                    "according to the robot's motions, the board's squares measure {found} mm, but the stated side \
                     is {stated} mm"
                )?;
                match unit_from_scale(*ratio) {
                    Some(unit) => write!(f, "; or the positions of the poses are in {unit}, not in mm"),
                    None => write!(f, "; measure the board and correct --square-mm"),
                }
            }
        }
    }
}

impl std::fmt::Display for PoseReading {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (left, next) = (fixed_decimals(self.median_mm, 3), fixed_decimals(self.runner_up_mm, 1));
        write!(
            f,
            "{}. With this interpretation, the poses fit to {left} mm; the next best interpretation leaves {next} \
             mm",
            self.interpretation
        )
    }
}
