//! `--points` and `--poses`: TOML files that a person writes from the teach pendant.

use crate::calib::three_points::Touched;
use crate::calib::tool::AxisTouch;
use crate::config::{self, Problems, Section};
use crate::files::ReportedFlange;
use crate::geometry::{Base, Flange, Joints, KukaPose, Point, Rigid};

const PLACE_MM: std::ops::RangeInclusive<f64> = -20_000.0..=20_000.0;
const ANGLE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;
const AXIS_DEG: std::ops::RangeInclusive<f64> = -720.0..=720.0;
const FORCE_N: std::ops::RangeInclusive<f64> = -2_000.0..=2_000.0;
const CORNER: std::ops::RangeInclusive<usize> = 0..=60;

fn pose(section: &Section<'_, '_>) -> Option<KukaPose> {
    let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| section.take(key, PLACE_MM, None));
    let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| section.take(key, ANGLE_DEG, None));
    section.done();
    Some(KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? })
}

/// Do these angles look like radians? Not proof: the caller asks only where the tool cannot be upright.
fn like_radians(pose: &KukaPose) -> bool {
    let angles = [pose.a_deg, pose.b_deg, pose.c_deg];
    let circle = [std::f64::consts::PI, std::f64::consts::FRAC_PI_2];
    angles.iter().all(|angle| angle.abs() < 3.15)
        && angles.iter().any(|angle| circle.iter().any(|turn| (angle.abs() - turn).abs() < 0.05))
}

/// Checks the text of a file with readings of a compliant tool: the flange and the force, N, of each.
///
/// # Errors
/// Every problem with its line and key.
pub fn force_readings(file: &str, text: &str) -> Result<Vec<(Rigid<Base, Flange>, f64)>, Problems> {
    config::check(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let flange = pose(&section.section("base_from_flange"));
            let force_n = section.take("force_n", FORCE_N, None);
            section.done();
            Some((flange?.to_rigid(), force_n?))
        };
        // Every table is read, so that every problem is told.
        let all: Vec<_> = top.sections("readings").into_iter().map(read).collect();
        top.done();
        all.into_iter().collect()
    })
}

/// What `--points` holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// Three corners, and a fourth where the file has one.
    pub touched: Vec<Touched>,
    /// The axes at each of them, where the file has them.
    pub joints: Vec<Option<Joints>>,
    /// The flange at the picture.
    pub base_from_flange: Option<Rigid<Base, Flange>>,
    /// The axes there, where the file has them.
    pub flange_joints: Option<Joints>,
}

/// Checks the text of a points file.
///
/// # Errors
/// Every problem with its line and key.
pub fn points(file: &str, text: &str) -> Result<Points, Problems> {
    const KEYS: [(&str, &str); 4] =
        [("p1_mm", "p1_corner"), ("p2_mm", "p2_corner"), ("p3_mm", "p3_corner"), ("p4_mm", "p4_corner")];
    config::check(file, text, |top| {
        let touched = |(place, corner): (&'static str, &'static str)| {
            let place = top.take::<[f64; 3]>(place, PLACE_MM, None);
            let corner = top.take::<[usize; 2]>(corner, CORNER, None);
            let ([x, y, z], [column, row]) = (place?, corner?);
            Some(Touched { corner: (column, row), place: Point::at(x, y, z) })
        };
        let three = [KEYS[0], KEYS[1], KEYS[2]].map(touched);
        let check_place = top.take::<Option<[f64; 3]>>(KEYS[3].0, PLACE_MM, Some(None));
        let check_corner = top.take::<Option<[usize; 2]>>(KEYS[3].1, CORNER, Some(None));
        const AXES: [&str; 4] = ["p1_axes_deg", "p2_axes_deg", "p3_axes_deg", "p4_axes_deg"];
        let axes = |key| top.take::<Option<[f64; 6]>>(key, AXIS_DEG, Some(None));
        let joints: Option<Vec<Option<[f64; 6]>>> = AXES.into_iter().map(axes).collect();
        let flange_joints = axes("axes_deg");
        let flange = top.section("base_from_flange");
        let flange = if flange.is_present() { Some(pose(&flange)) } else { None };
        top.done();
        if flange.flatten().is_some_and(|pose| like_radians(&pose)) {
            let message = "these angles look like radians; A, B, C are written in degrees";
            top.problem("base_from_flange", message);
            return None;
        }
        let fourth = match (check_place?, check_corner?) {
            (Some([x, y, z]), Some([column, row])) => {
                Some(Touched { corner: (column, row), place: Point::at(x, y, z) })
            }
            (None, None) => None,
            _ => {
                top.problem("p4_mm", "p4_mm and p4_corner belong together");
                return None;
            }
        };
        let [first, second, third] = three;
        let touched: Vec<Touched> = [first?, second?, third?].into_iter().chain(fourth).collect();
        let joints = joints?.into_iter().take(touched.len()).map(|axes| axes.map(Joints::from)).collect();
        let flange_joints = flange_joints?.map(Joints::from);
        let base_from_flange = match flange {
            Some(pose) => Some(pose?.to_rigid()),
            None => None,
        };
        Some(Points { touched, joints, base_from_flange, flange_joints })
    })
}

/// One pose of `--poses` with its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PicturePose {
    /// The picture's name in its folder.
    pub image: String,
    /// Where the robot says that the flange was.
    pub base_from_flange: Rigid<Base, Flange>,
    /// Where it says that the axes were, where the file does.
    pub joints: Option<Joints>,
}

/// The keys of a pose as a poses file has them, with the axes where they are known: what [`picture_poses`] reads.
pub fn pose_keys(flange: &ReportedFlange) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = flange.base_from_flange;
    let axes = flange.joints.map(|joints| format!("axes_deg = {:?}\n", joints.degrees()));
    format!(
        "base_from_flange = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = {b_deg:?}, \
         c_deg = {c_deg:?} }}\n"
    ) + &axes.unwrap_or_default()
}

/// Checks the text of a poses file for hand-eye calibration; `is_there` says whether a picture is in the folder.
///
/// # Errors
/// Every problem with its line and key; also a picture that is missing or named twice.
pub fn picture_poses(
    file: &str,
    text: &str,
    is_there: &dyn Fn(&str) -> bool,
) -> Result<Vec<PicturePose>, Problems> {
    config::check(file, text, |top| {
        let mut poses: Vec<PicturePose> = Vec::new();
        let mut whole = true;
        for section in top.sections("poses") {
            let image = section.take::<String>("image", (), None);
            let base_from_flange = pose(&section.section("base_from_flange"));
            let axes_deg = section.take::<Option<[f64; 6]>>("axes_deg", AXIS_DEG, Some(None));
            section.done();
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
        top.done();
        if whole && poses.is_empty() {
            top.problem("poses", "is missing; write [[poses]] with image and base_from_flange for each picture");
            return None;
        }
        whole.then_some(poses)
    })
}

/// Where the controller says that the robot was: by the flange, by the axes, or by both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StatedPose {
    Flange(Rigid<Base, Flange>),
    Axes(Joints),
    Both(Rigid<Base, Flange>, Joints),
}

/// A picture's name in its folder, and where the robot was.
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
    let axes_deg = section.take::<Option<[f64; 6]>>("axes_deg", AXIS_DEG, Some(None))?;
    section.done();
    match (base_from_flange, axes_deg.map(Joints::from)) {
        (Some(flange), None) => Some(StatedPose::Flange(flange)),
        (None, Some(joints)) => Some(StatedPose::Axes(joints)),
        (Some(flange), Some(joints)) => Some(StatedPose::Both(flange, joints)),
        (None, None) => {
            section.problem("axes_deg", "a pose states base_from_flange, axes_deg = [A1, …, A6], or both");
            None
        }
    }
}

/// Checks the text of a poses file for an arm: `[[poses]]` with `image`, and `base_from_flange`, `axes_deg` or both.
///
/// # Errors
/// Every problem with its line and key; also a picture that is missing or named twice.
pub fn arm_poses(file: &str, text: &str, is_there: &dyn Fn(&str) -> bool) -> Result<Vec<NamedPose>, Problems> {
    config::check(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let image = section.take::<String>("image", (), None)?;
            if !is_there(&image) {
                section.problem("image", format!("{image} is not in the folder of this file"));
                return None;
            }
            Some(NamedPose { image, pose: stated_pose(&section)? })
        };
        // Every table is read, so that every problem is told.
        let all: Vec<Option<NamedPose>> = top.sections("poses").into_iter().map(read).collect();
        top.done();
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

/// What a touches file says was touched.
#[derive(Debug, Clone, PartialEq)]
pub enum StatedTouch {
    /// A spot by its number; touches of one spot share it.
    Spot(usize),
    /// A corner (column, row) of the board before the camera on the flange.
    Corner(usize, usize),
    /// A corner of the board that lay still in a picture of the fixed camera.
    CornerIn(usize, usize, String),
}

/// Checks the text of a touches file: `[[touches]]` with `spot`, or with `corner` of a board that stands still, and a pose.
/// With `image` the board is the one in that picture of the fixed camera, without it that of the camera on the flange.
///
/// # Errors
/// Every problem with its line and key.
pub fn arm_touches(
    file: &str,
    text: &str,
    is_there: &dyn Fn(&str) -> bool,
) -> Result<Vec<(StatedTouch, StatedPose)>, Problems> {
    config::check(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let spot = section.take::<Option<usize>>("spot", 0..=99, Some(None))?;
            let corner = section.take::<Option<[usize; 2]>>("corner", CORNER, Some(None))?;
            let image = section.take::<Option<String>>("image", (), Some(None))?;
            if let Some(image) = image.as_ref().filter(|image| !is_there(image)) {
                section.problem("image", format!("{image} is not in the folder of this file"));
                return None;
            }
            let touched = match (spot, corner, image) {
                (Some(spot), None, None) => StatedTouch::Spot(spot),
                (None, Some([column, row]), None) => StatedTouch::Corner(column, row),
                (None, Some([column, row]), Some(image)) => StatedTouch::CornerIn(column, row, image),
                _ => {
                    let allowed = "a touch states spot = N, or corner = [COLUMN, ROW] of a board that stands still, with image = \
                                   \"FILE\" where it is the fixed camera that sees it";
                    section.problem("spot", allowed);
                    return None;
                }
            };
            Some((touched, stated_pose(&section)?))
        };
        let all: Vec<_> = top.sections("touches").into_iter().map(read).collect();
        top.done();
        all.into_iter().collect()
    })
}

/// What `--poses` of `tcp` holds.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPoses {
    /// Poses that hold the tip at one spot.
    pub tip: Vec<Rigid<Base, Flange>>,
    /// What tells the axis.
    pub axis: Option<AxisTouch>,
}

/// Where the flange truly was when the robot reported this; a problem in words where that cannot be said.
pub type TrueFlange<'a> = &'a dyn Fn(Rigid<Base, Flange>, Option<&Joints>) -> Result<Rigid<Base, Flange>, String>;

/// Checks the text of a poses file for a tool: `[[poses]]`, and `[[axis]]` or `[[plate]]` with `[[flat]]`.
///
/// # Errors
/// Every problem with its line and key.
pub fn tool_poses(file: &str, text: &str, true_flange: TrueFlange<'_>) -> Result<ToolPoses, Problems> {
    config::check(file, text, |top| {
        let flange = |key: &'static str| -> Option<Vec<Rigid<Base, Flange>>> {
            let read = |section: Section<'_, '_>| {
                let _ = section.take::<Option<String>>("image", (), Some(None));
                let read = pose(&section.section("base_from_flange"));
                let axes_deg = section.take::<Option<[f64; 6]>>("axes_deg", AXIS_DEG, Some(None));
                section.done();
                match true_flange(read?.to_rigid(), axes_deg?.map(Joints::from).as_ref()) {
                    Ok(flange) => Some(flange),
                    Err(problem) => {
                        section.problem("axes_deg", problem);
                        None
                    }
                }
            };
            // Every table is read, so that every problem is told.
            let all: Vec<_> = top.sections(key).into_iter().map(read).collect();
            all.into_iter().collect()
        };
        let place = |section: Section<'_, '_>| {
            let place = section.take::<[f64; 3]>("place_mm", PLACE_MM, None);
            section.done();
            place.map(|[x, y, z]| Point::at(x, y, z))
        };
        let (tip, behind, flat) = (flange("poses"), flange("axis"), flange("flat"));
        let plate: Vec<_> = top.sections("plate").into_iter().map(place).collect();
        top.done();
        let plate: Vec<Point<Base>> = plate.into_iter().collect::<Option<_>>()?;
        let (tip, behind, flat) = (tip?, behind?, flat?);
        let axis = match (behind.is_empty(), plate.is_empty(), flat.is_empty()) {
            (true, true, true) => None,
            (false, true, true) => Some(AxisTouch::Behind(behind)),
            (true, false, false) => Some(AxisTouch::Plate { places: plate, flat }),
            _ => {
                top.problem("axis", "allowed is [[axis]] alone, or [[plate]] and [[flat]] together");
                return None;
            }
        };
        Some(ToolPoses { tip, axis })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn points_name_their_corners_and_radians_are_noticed() {
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

    fn as_reported(flange: Rigid<Base, Flange>, _: Option<&Joints>) -> Result<Rigid<Base, Flange>, String> {
        Ok(flange)
    }

    /// A spot, a corner, or a corner in a picture; two of them, or none, is a problem with its line.
    #[test]
    fn a_touch_is_of_one_thing() {
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

    #[test]
    fn a_tool_has_one_way_to_its_axis() {
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
