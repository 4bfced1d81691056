//! The reason why data do not determine a calibration: what was found, what is needed, and how to correct it. If no
//! mount matches the poses, the error also states their probable intended meaning.

use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_cell::imaging::ImagingError;

/// An error of a calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibError {
    /// The text of `--board` or `--square-mm` does not describe a board.
    #[error("--board {text}: {message}")]
    Board {
        /// The text of the option.
        text: String,
        /// The problem, and the valid values.
        message: String,
    },
    /// OpenCV refused its input.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
    /// The picture shows no board.
    #[error(
        "{picture} shows no board with {columns}×{rows} inner corners; check --board, and check that the whole \
         board is in the picture, sharp, with a white rim"
    )]
    NoBoard {
        /// Name of the picture.
        picture: String,
        /// Inner corners in a row.
        columns: usize,
        /// Rows of inner corners.
        rows: usize,
    },
    /// A picture does not show the expected circles.
    #[error(
        "{picture} shows no grid of {columns} circles in each of {rows} rows; check --board, and check that all \
         circles are in the picture, sharp, and apart from each other"
    )]
    NoCircles {
        /// Name of the picture.
        picture: String,
        /// Circles in a row.
        columns: usize,
        /// Number of rows.
        rows: usize,
    },
    /// A picture shows another board.
    #[error(
        "{picture}: found a {}x{} board, expected {columns}x{rows} (inner corners along its sides); correct \
         --board, or take a picture of the right board", found[0], found[1]
    )]
    OtherBoard {
        /// Name of the picture.
        picture: String,
        /// Inner corners along the sides of the board in the picture, the longer side first.
        found: [usize; 2],
        /// Inner corners in a row of the requested board.
        columns: usize,
        /// Rows of inner corners of the requested board.
        rows: usize,
    },
    /// A picture shows a ChArUco board of another layout, dictionary or side.
    #[error("{picture} does not show the board as --board names it; {what}")]
    OtherCharuco {
        /// Name of the picture.
        picture: String,
        /// The board in the picture, and how to correct the input.
        what: String,
    },
    /// The pictures have different sizes.
    #[error("{picture} has {found} pixels, but {first} has {expected}; all pictures must have the same size")]
    MixedSizes {
        /// Name of the picture that differs from the first.
        picture: String,
        /// Size of this picture.
        found: String,
        /// Name of the first picture.
        first: String,
        /// Size of the first picture.
        expected: String,
    },
    /// There are too few pictures with a board.
    #[error("{found} of {given} pictures can be used, at least {needed} are needed{}", reason_suffix(first_reason))]
    TooFewPictures {
        /// Number of usable pictures.
        found: usize,
        /// Number of pictures given.
        given: usize,
        /// Minimum number of pictures.
        needed: usize,
        /// The reason why the first unusable picture cannot be used.
        first_reason: Option<String>,
    },
    /// The touched points do not define a frame.
    #[error("{0}")]
    Points(String),
    /// The robot poses rotate the board too little.
    #[error(
        "the poses rotate the board too little: {}° about the second axis, at least {}° are needed; these data do \
         not determine a camera mount: tilt the flange about two axes, by 20° and more", distinguishable_texts(*about_second_axis_deg, *needed_deg, 1)[0],
        distinguishable_texts(*about_second_axis_deg, *needed_deg, 1)[1]
    )]
    TooLittleRotation {
        /// Spread of the rotations about the second of their principal axes, degrees.
        about_second_axis_deg: f64,
        /// Minimum spread of the rotations, degrees.
        needed_deg: f64,
    },
    /// No mount matches most of the poses.
    #[error(
        "no camera mount fits half of the {poses} poses: the median residual of the best is {median_mm:.1} mm; {}",
        describe_readings(readings)
    )]
    NoConsensus {
        /// Number of poses.
        poses: usize,
        /// Median distance of the boards in the best consensus, mm.
        median_mm: f64,
        /// The interpretations that match the poses.
        readings: Vec<PoseReading>,
    },
    /// The angles of the poses are probably in radians.
    #[error(
        "every angle of the poses lies within ±3.15 although the board rotates by {seen_deg:.0}° between pictures: \
         these look like radians; write A, B, C in degrees"
    )]
    Radians {
        /// The largest rotation between two pictures, degrees.
        seen_deg: f64,
    },
    /// The iteration did not converge.
    #[error(
        "{what} did not converge, because the data contradict each other; check the input, or take the pictures again"
    )]
    NotSettled {
        /// The computation that did not converge.
        what: &'static str,
    },
    /// The poses do not determine a tool.
    #[error("{0}")]
    Tool(String),
}

fn reason_suffix(reason: &Option<String>) -> String {
    reason.as_ref().map_or(String::new(), |reason| format!("; {reason}"))
}

fn describe_readings(readings: &[PoseReading]) -> String {
    if readings.is_empty() {
        let words = "no other interpretation of the poses fits either: check that they are base_from_flange in mm \
                     and degrees, that each picture belongs to its pose, that the lens file is this camera's, and \
                     that the board was not moved";
        return words.to_owned();
    }
    readings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; or ")
}

/// A possible intended meaning of poses that match no mount.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PoseInterpretation {
    /// The poses are `flange_from_base`, or the camera has the other mount.
    Inverted {
        /// Whether the other mount is more probable: of camera and board, the one on the flange is the nearer one.
        other_mount: bool,
    },
    /// Three angles in another order or about other axes; the text names them.
    Angles(&'static str),
    /// The angles are those of a rotation vector.
    RotationVector {
        /// Whether the vector is in radians.
        radians: bool,
    },
    /// A quaternion with its four components in another order.
    Quaternion(&'static str),
    /// Only the rotation is inverted.
    Transposed,
    /// The axes are those of a left-handed frame.
    LeftHanded,
    /// The angles are in radians.
    Radians,
    /// Each picture is paired with the pose of the next or previous picture.
    Shifted {
        /// Whether each picture is paired with the previous pose.
        late: bool,
    },
    /// The pictures are mirrored.
    Mirrored,
    /// The lengths of board and robot differ by a factor.
    Lengths {
        /// Ratio of the robot's lengths to the board's.
        ratio: f64,
        /// The stated side of a square, mm.
        square_mm: f64,
    },
}

/// An interpretation that matches the poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseReading {
    /// The interpretation of the values.
    pub interpretation: PoseInterpretation,
    /// Median distance of the boards, mm.
    pub median_mm: f64,
    /// Residual of the best of the other interpretations, mm.
    pub runner_up_mm: f64,
}

/// Returns the unit of length that a scale factor indicates.
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
                write!(
                    f,
                    "each picture matches the pose {where_to} its own: the list of poses is shifted by one picture; \
                     correct the list"
                )
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
            "{}. With this interpretation, the residual of the poses is {left} mm; with the next best one it is \
             {next} mm",
            self.interpretation
        )
    }
}
