//! The TOML files of `--points` and `--poses`, which a person writes with the values on the pendant.
//!
//! - Mount of a camera: the touched points, or the poses of its pictures.
//! - Errors of the arm: pictures and touches, in poses that are stated by the flange, by the axis angles, or by both.
//! - Tool: poses that determine the TCP and the axis, and measurements of the force without contact.

mod pose;

use self::pose::{AXIS_RANGE_DEG, CORNER, POSITION_RANGE_MM, are_angles_in_radians, parse_pose_table, pose};
use panelprep_base::config::{self, Problems, Section};
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep_vision::calib::three_points::TouchedCorner;
use panelprep_vision::calib::tool::AxisTouch;
pub use pose::pose_keys;

/// The content of a points file (`--points`).
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// The three touched corners, and the fourth if the file has one.
    pub touched: Vec<TouchedCorner>,
    /// The axis angles at each corner, if the file states them.
    pub joints: Vec<Option<Joints>>,
    /// The flange pose of the picture.
    pub base_from_flange: Option<Rigid<Base, Flange>>,
    /// The axis angles of the picture, if the file states them.
    pub flange_joints: Option<Joints>,
}

/// Parses the text of a points file.
///
/// # Errors
/// If the file has problems; the error contains each problem with its line and key.
pub fn points(file: &str, text: &str) -> Result<Points, Problems> {
    const KEYS: [(&str, &str); 4] =
        [("p1_mm", "p1_corner"), ("p2_mm", "p2_corner"), ("p3_mm", "p3_corner"), ("p4_mm", "p4_corner")];
    config::parse_file(file, text, |top| {
        let touched = |(place, corner): (&'static str, &'static str)| {
            let place = top.parse::<[f64; 3]>(place, POSITION_RANGE_MM, None);
            let corner = top.parse::<[usize; 2]>(corner, CORNER, None);
            let ([x, y, z], [column, row]) = (place?, corner?);
            Some(TouchedCorner { corner: (column, row), place: Point::at(x, y, z) })
        };
        let three = [KEYS[0], KEYS[1], KEYS[2]].map(touched);
        let check_place = top.parse::<Option<[f64; 3]>>(KEYS[3].0, POSITION_RANGE_MM, Some(None));
        let check_corner = top.parse::<Option<[usize; 2]>>(KEYS[3].1, CORNER, Some(None));
        const AXES: [&str; 4] = ["p1_axes_deg", "p2_axes_deg", "p3_axes_deg", "p4_axes_deg"];
        let axes = |key| top.parse::<Option<[f64; 6]>>(key, AXIS_RANGE_DEG, Some(None));
        let joints: Option<Vec<Option<[f64; 6]>>> = AXES.into_iter().map(axes).collect();
        let flange_joints = axes("axes_deg");
        let flange = top.has_key("base_from_flange").then(|| parse_pose_table(top, "base_from_flange"));
        if flange.is_none() {
            // Known, and absent.
            let _ = top.section("base_from_flange");
        }
        top.finish();
        if flange.flatten().is_some_and(|pose| are_angles_in_radians(&pose)) {
            let message = "these angles look like radians; write A, B, C in degrees";
            top.problem("base_from_flange", message);
            return None;
        }
        let fourth = match (check_place?, check_corner?) {
            (Some([x, y, z]), Some([column, row])) => {
                Some(TouchedCorner { corner: (column, row), place: Point::at(x, y, z) })
            }
            (None, None) => None,
            _ => {
                top.problem("p4_mm", "p4_mm and p4_corner belong together; give both or none");
                return None;
            }
        };
        let [first, second, third] = three;
        let touched: Vec<TouchedCorner> = [first?, second?, third?].into_iter().chain(fourth).collect();
        let joints = joints?.into_iter().take(touched.len()).map(|axes| axes.map(Joints::from)).collect();
        let flange_joints = flange_joints?.map(Joints::from);
        let base_from_flange = match flange {
            Some(pose) => Some(pose?.to_rigid()),
            None => None,
        };
        Some(Points { touched, joints, base_from_flange, flange_joints })
    })
}

/// A picture of a poses file (`--poses`) and its pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PicturePose {
    /// The file name of the picture.
    pub image: String,
    /// The flange pose that the robot reported.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The axis angles that the robot reported, if the file states them.
    pub joints: Option<Joints>,
}

/// Parses the text of a poses file for hand-eye calibration; `is_there` returns whether a picture is in the folder.
///
/// # Errors
/// If the file has problems; the error contains each problem with its line and key, including pictures that are missing
/// or named twice.
pub fn picture_poses(
    file: &str,
    text: &str,
    is_there: &dyn Fn(&str) -> bool,
) -> Result<Vec<PicturePose>, Problems> {
    config::parse_file(file, text, |top| {
        let mut poses: Vec<PicturePose> = Vec::new();
        let mut whole = true;
        for section in top.sections("poses") {
            let image = section.parse::<String>("image", (), None);
            let base_from_flange = parse_pose_table(&section, "base_from_flange");
            let axes_deg = section.parse::<Option<[f64; 6]>>("axes_deg", AXIS_RANGE_DEG, Some(None));
            section.finish();
            let (Some(image), Some(base_from_flange), Some(axes_deg)) = (image, base_from_flange, axes_deg) else {
                whole = false;
                continue;
            };
            let known = poses.iter().any(|pose| pose.image == image);
            if known || !is_there(&image) {
                let problem = if known { "is named twice" } else { "is not in the folder of --images" };
                section.problem("image", format!("{image} {problem}"));
                whole = false;
                continue;
            }
            let joints = axes_deg.map(Joints::from);
            poses.push(PicturePose { image, base_from_flange: base_from_flange.to_rigid(), joints });
        }
        top.finish();
        if whole && poses.is_empty() {
            top.problem("poses", "is missing; write [[poses]] with image and base_from_flange for each picture");
            return None;
        }
        whole.then_some(poses)
    })
}

/// The pose of the robot as the controller reports it: by the flange, by the axis angles, or by both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StatedPose {
    Flange(Rigid<Base, Flange>),
    Axes(Joints),
    Both(Rigid<Base, Flange>, Joints),
}

/// The file name of a picture, and the pose of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPose {
    /// The picture.
    pub image: String,
    /// The pose.
    pub pose: StatedPose,
}

fn stated_pose(section: &Section<'_, '_>) -> Option<StatedPose> {
    let flange = section.section("base_from_flange");
    let base_from_flange = if flange.is_present() { Some(pose(&flange)?.to_rigid()) } else { None };
    let axes_deg = section.parse::<Option<[f64; 6]>>("axes_deg", AXIS_RANGE_DEG, Some(None))?;
    section.finish();
    match (base_from_flange, axes_deg.map(Joints::from)) {
        (Some(flange), None) => Some(StatedPose::Flange(flange)),
        (None, Some(joints)) => Some(StatedPose::Axes(joints)),
        (Some(flange), Some(joints)) => Some(StatedPose::Both(flange, joints)),
        (None, None) => {
            section.problem("axes_deg", "a pose must state base_from_flange, axes_deg = [A1, …, A6], or both");
            None
        }
    }
}

/// Parses the text of a poses file for an arm: `[[poses]]` with `image`, and `base_from_flange`, `axes_deg` or both.
///
/// # Errors
/// If the file has problems; the error contains each problem with its line and key, including pictures that are missing
/// or named twice.
pub fn arm_poses(file: &str, text: &str, is_there: &dyn Fn(&str) -> bool) -> Result<Vec<NamedPose>, Problems> {
    config::parse_file(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let image = section.parse::<String>("image", (), None)?;
            if !is_there(&image) {
                section.problem("image", format!("{image} is not in the folder of this file"));
                return None;
            }
            Some(NamedPose { image, pose: stated_pose(&section)? })
        };
        // All tables are read before an error is returned, so that every problem is reported.
        let all: Vec<Option<NamedPose>> = top.sections("poses").into_iter().map(read).collect();
        top.finish();
        let poses: Vec<NamedPose> = all.into_iter().collect::<Option<_>>()?;
        let twice =
            poses.iter().enumerate().find(|(index, pose)| poses[..*index].iter().any(|p| p.image == pose.image));
        if let Some((_, pose)) = twice {
            top.problem("poses", format!("{} is named twice", pose.image));
            return None;
        }
        Some(poses)
    })
}

/// The target of a touch, as a touches file states it.
#[derive(Debug, Clone, PartialEq)]
pub enum StatedTouch {
    /// A fixed point, by its number; touches of the same point have the same number.
    Spot(usize),
    /// A corner (column, row) of the fixed board in front of the flange camera.
    Corner(usize, usize),
    /// A corner (column, row) of the board in this picture of the fixed camera; the board did not move between picture
    /// and touch.
    CornerIn(usize, usize, String),
}

/// Parses the text of a touches file: `[[touches]]` with a pose, and with `spot` or `corner`. With `image`, the corner
/// belongs to the board in this picture of the fixed camera; without it, to the fixed board in front of the flange
/// camera.
///
/// # Errors
/// If the file has problems; the error contains each problem with its line and key.
pub fn arm_touches(
    file: &str,
    text: &str,
    is_there: &dyn Fn(&str) -> bool,
) -> Result<Vec<(StatedTouch, StatedPose)>, Problems> {
    config::parse_file(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let spot = section.parse::<Option<usize>>("spot", 0..=99, Some(None))?;
            let corner = section.parse::<Option<[usize; 2]>>("corner", CORNER, Some(None))?;
            let image = section.parse::<Option<String>>("image", (), Some(None))?;
            if let Some(image) = image.as_ref().filter(|image| !is_there(image)) {
                section.problem("image", format!("{image} is not in the folder of this file"));
                return None;
            }
            let touched = match (spot, corner, image) {
                (Some(spot), None, None) => StatedTouch::Spot(spot),
                (None, Some([column, row]), None) => StatedTouch::Corner(column, row),
                (None, Some([column, row]), Some(image)) => StatedTouch::CornerIn(column, row, image),
                _ => {
                    let allowed = "a touch must state spot = N, or corner = [COLUMN, ROW] of a board at rest, with \
                                   image = \"FILE\" if the fixed camera sees it";
                    section.problem("spot", allowed);
                    return None;
                }
            };
            Some((touched, stated_pose(&section)?))
        };
        let all: Vec<_> = top.sections("touches").into_iter().map(read).collect();
        top.finish();
        all.into_iter().collect()
    })
}

const FORCE_RANGE_N: std::ops::RangeInclusive<f64> = -2_000.0..=2_000.0;

/// Parses the text of a file with force measurements of a compliant tool: for each, the flange pose and the force, N.
///
/// # Errors
/// If the file has problems; the error contains each problem with its line and key.
pub fn force_readings(file: &str, text: &str) -> Result<Vec<(Rigid<Base, Flange>, f64)>, Problems> {
    config::parse_file(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let flange = pose(&section.section("base_from_flange"));
            let force_n = section.parse("force_n", FORCE_RANGE_N, None);
            section.finish();
            Some((flange?.to_rigid(), force_n?))
        };
        // All tables are read before an error is returned, so that every problem is reported.
        let all: Vec<_> = top.sections("readings").into_iter().map(read).collect();
        top.finish();
        all.into_iter().collect()
    })
}

/// The content of a poses file for `calibrate tcp`.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPoses {
    /// The flange poses in which the tool's tip is at the same fixed point.
    pub tip: Vec<Rigid<Base, Flange>>,
    /// The poses that determine the axis of the tool.
    pub axis: Option<AxisTouch>,
}

/// A function that returns the true flange pose for the pose that the robot reported; the error states why it cannot be
/// computed.
pub type TrueFlange<'a> = &'a dyn Fn(Rigid<Base, Flange>, Option<&Joints>) -> Result<Rigid<Base, Flange>, String>;

/// Parses the text of a poses file for a tool: `[[poses]]`, and `[[axis]]` or `[[plate]]` with `[[flat]]`.
///
/// # Errors
/// If the file has problems; the error contains each problem with its line and key.
pub fn tool_poses(file: &str, text: &str, true_flange: TrueFlange<'_>) -> Result<ToolPoses, Problems> {
    config::parse_file(file, text, |top| {
        let flange = |key: &'static str| -> Option<Vec<Rigid<Base, Flange>>> {
            let read = |section: Section<'_, '_>| {
                let _ = section.parse::<Option<String>>("image", (), Some(None));
                let read = pose(&section.section("base_from_flange"));
                let axes_deg = section.parse::<Option<[f64; 6]>>("axes_deg", AXIS_RANGE_DEG, Some(None));
                section.finish();
                match true_flange(read?.to_rigid(), axes_deg?.map(Joints::from).as_ref()) {
                    Ok(flange) => Some(flange),
                    Err(problem) => {
                        section.problem("axes_deg", problem);
                        None
                    }
                }
            };
            // All tables are read before an error is returned, so that every problem is reported.
            let all: Vec<_> = top.sections(key).into_iter().map(read).collect();
            all.into_iter().collect()
        };
        let place = |section: Section<'_, '_>| {
            let place = section.parse::<[f64; 3]>("place_mm", POSITION_RANGE_MM, None);
            section.finish();
            place.map(|[x, y, z]| Point::at(x, y, z))
        };
        let (tip, behind, flat) = (flange("poses"), flange("axis"), flange("flat"));
        let plate: Vec<_> = top.sections("plate").into_iter().map(place).collect();
        top.finish();
        let plate: Vec<Point<Base>> = plate.into_iter().collect::<Option<_>>()?;
        let (tip, behind, flat) = (tip?, behind?, flat?);
        let axis = match (behind.is_empty(), plate.is_empty(), flat.is_empty()) {
            (true, true, true) => None,
            (false, true, true) => Some(AxisTouch::Behind(behind)),
            (true, false, false) => Some(AxisTouch::Plate { touched_points: plate, flat_poses: flat }),
            _ => {
                top.problem("axis", "valid: [[axis]] alone, or [[plate]] and [[flat]] together");
                return None;
            }
        };
        Some(ToolPoses { tip, axis })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::config::Problems;
    use panelprep_base::geometry::KukaPose;
    use panelprep_cell::files::ReportedFlange;

    const POSE: &str = "base_from_flange = { x_mm = 1, y_mm = 2, z_mm = 3, a_deg = 90, b_deg = 0, c_deg = 180 }\n";

    fn problems<T: std::fmt::Debug>(found: Result<T, Problems>) -> String {
        found.expect_err("a problem").to_string()
    }

    #[test]
    fn a_missing_or_repeated_picture_is_named_with_its_line() {
        let text = format!("[[poses]]\nimage = \"1.png\"\n{POSE}\n[[poses]]\nimage = \"2.png\"\n{POSE}");
        let read = |is_there: &dyn Fn(&str) -> bool| picture_poses("poses.toml", &text, is_there);
        assert_eq!(read(&|_| true).expect("right").len(), 2);
        let problem = problems(read(&|image| image == "1.png"));
        assert!(problem.contains("poses.toml:6") && problem.contains("2.png is not in the folder"), "{problem}");
        let twice = text.replace("2.png", "1.png");
        assert!(problems(picture_poses("f", &twice, &|_| true)).contains("1.png is named twice"));
        assert!(problems(picture_poses("f", "", &|_| true)).contains("write [[poses]]"));
    }

    #[test]
    fn a_pose_is_written_as_it_is_read() {
        let base_from_flange = KukaPose { x_mm: 1.5, y_mm: -2.0, z_mm: 3.0, a_deg: 10.0, b_deg: 20.0, c_deg: 30.0 };
        let joints = Some(Joints::from([1.0, -90.0, 90.0, 0.0, 5.0, 6.5]));
        for joints in [joints, None] {
            let keys = pose_keys(&ReportedFlange { base_from_flange, joints });
            let text = format!("[[poses]]\nimage = \"a.png\"\n{keys}");
            let read = picture_poses("poses.toml", &text, &|image| image == "a.png").expect("right");
            assert_eq!((read.len(), read[0].joints), (1, joints));
            let origin = Point::at(0.0, 0.0, 0.0);
            assert!(read[0].base_from_flange.distance_at_mm(base_from_flange.to_rigid(), origin) < 1e-9);
        }
    }

    /// A pose in the notation of the pendant or of KRL is accepted, with its type and its status and turn values.
    #[test]
    fn a_pose_of_krl_is_read() {
        let read = |pose: &str| {
            let text = format!("[[poses]]\nimage = \"1.png\"\nbase_from_flange = \"{pose}\"\n");
            picture_poses("poses.toml", &text, &|_| true)
        };
        let expected = KukaPose { x_mm: 400.5, y_mm: -2.0, z_mm: 600.0, a_deg: 90.0, b_deg: 0.25, c_deg: -180.0 };
        for text in [
            "{X 400.5, Y -2, Z 600, A 90, B 0.25, C -180}",
            "{FRAME: X 400.5,Y -2.0,Z 600.0,A 90.0,B 0.25,C -180.0}",
            "{E6POS: X 400.5, Y -2, Z 600, A 90, B 0.25, C -180, S 2, T 35, E1 0.0}",
        ] {
            let poses = read(text).expect(text);
            let off_mm = poses[0].base_from_flange.distance_at_mm(expected.to_rigid(), Point::at(100.0, 0.0, 0.0));
            assert!(off_mm < 1e-9, "{text}: {off_mm}");
        }
        for text in [
            "{X 400.5, Y -2, Z 600, A 90, B 0.25}",
            "400.5 -2 600 90 0.25 -180",
            "{X 1, X 2, Y 3, Z 4, A 5, B 6, C 7}",
        ] {
            assert!(problems(read(text)).contains("valid:"), "{text}");
        }
    }

    /// A pose in the format of Zivid's hand-eye calibration is accepted. Expected value, calculated by hand: a rotation
    /// by 90° about Z is A = 90°.
    #[test]
    fn a_matrix_is_read() {
        let read = |rows: &str| {
            let text = format!("[[poses]]\nimage = \"1.png\"\nbase_from_flange = [{rows}]\n");
            picture_poses("poses.toml", &text, &|_| true)
        };
        let poses = read("[0, -1, 0, 400.5], [1, 0, 0, -2], [0, 0, 1, 600], [0, 0, 0, 1]").expect("a pose");
        let expected = KukaPose { x_mm: 400.5, y_mm: -2.0, z_mm: 600.0, a_deg: 90.0, b_deg: 0.0, c_deg: 0.0 };
        let off_mm = poses[0].base_from_flange.distance_at_mm(expected.to_rigid(), Point::at(100.0, 0.0, 0.0));
        assert!(off_mm < 1e-9, "{off_mm}");
        for (rows, words) in [
            ("[0, -1, 0, 400.5], [1, 0, 0, -2], [0, 0, 1, 600]", "four rows of four"),
            ("[0, 1, 0, 400.5], [1, 0, 0, -2], [0, 0, 1, 600], [0, 0, 0, 1]", "right-handed"),
            ("[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [400.5, -2, 600, 1]", "row by row"),
            ("[0, -2, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]", "orthonormal"),
        ] {
            let found = problems(read(rows));
            assert!(found.contains(words), "{rows}: {found}");
        }
    }

    #[test]
    fn points_name_their_corners_and_radians_are_reported() {
        let text = "p1_mm = [0, 0, 0]\np1_corner = [0, 0]\np2_mm = [200, 0, 0]\np2_corner = [8, 0]\n\
                    p3_mm = [200, 125, 0]\np3_corner = [8, 5]\n";
        let read = points("f", text).expect("right");
        assert_eq!((read.touched.len(), read.touched[1].corner, read.base_from_flange), (3, (8, 0), None));
        assert!(problems(points("f", &text.replace("p2_corner", "p2_corners"))).contains("did you mean p2_corner"));
        assert!(problems(points("f", &format!("{text}p4_mm = [0, 125, 0]\n"))).contains("belong together"));
        assert!(points("f", &format!("{text}{POSE}")).expect("right").base_from_flange.is_some());
        let radians = POSE.replace("90", "1.5708").replace("180", "3.1416");
        assert!(problems(points("f", &format!("{text}{radians}"))).contains("look like radians"));
    }

    /// A touch states a fixed point, a corner, or a corner in a picture. A touch that states two of these, or none, is
    /// a problem with its line.
    #[test]
    fn a_touch_states_exactly_one_target() {
        let read = |touch: &str| arm_touches("t.toml", &format!("[[touches]]\n{touch}\n{POSE}"), &|_| true);
        let first = |touch: &str| read(touch).expect(touch)[0].0.clone();
        assert_eq!(first("spot = 3"), StatedTouch::Spot(3));
        assert_eq!(first("corner = [8, 5]"), StatedTouch::Corner(8, 5));
        assert_eq!(first("corner = [0, 5]\nimage = \"a.png\""), StatedTouch::CornerIn(0, 5, "a.png".to_owned()));
        for wrong in ["spot = 3\ncorner = [0, 0]", "", "image = \"a.png\""] {
            let problem = problems(read(wrong));
            assert!(problem.contains("t.toml:") && problem.contains("or corner = [COLUMN, ROW]"), "{problem}");
        }
        let text = format!("[[touches]]\ncorner = [0, 5]\nimage = \"a.png\"\n{POSE}");
        assert!(problems(arm_touches("t", &text, &|_| false)).contains("a.png is not in the folder"));
    }

    fn as_reported(flange: Rigid<Base, Flange>, _: Option<&Joints>) -> Result<Rigid<Base, Flange>, String> {
        Ok(flange)
    }

    #[test]
    fn a_tool_axis_is_determined_by_one_method_only() {
        let tip = format!("[[poses]]\n{POSE}");
        assert_eq!(tool_poses("f", &tip, &as_reported).expect("right").axis, None);
        let behind = tool_poses("f", &format!("{tip}[[axis]]\n{POSE}"), &as_reported).expect("right").axis;
        assert!(matches!(behind, Some(AxisTouch::Behind(poses)) if poses.len() == 1));
        let flat =
            tool_poses("f", &format!("{tip}[[plate]]\nplace_mm = [1, 2, 3]\n[[flat]]\n{POSE}"), &as_reported);
        assert!(matches!(flat.expect("right").axis, Some(AxisTouch::Plate { .. })));
        assert!(problems(tool_poses("f", &format!("{tip}[[flat]]\n{POSE}"), &as_reported)).contains("together"));
    }
}
