//! The mount of a camera: the touched points, or the poses at its pictures.

use super::pose::{AXIS_DEG, CORNER, POSITION_RANGE_MM, like_radians, parse_pose_table};
use panelprep_base::config::{self, Problems};
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep_vision::calib::three_points::TouchedCorner;

/// Content of the file of `--points`.
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// Three corners, and a fourth if the file has one.
    pub touched: Vec<TouchedCorner>,
    /// The axes at each corner, if the file has them.
    pub joints: Vec<Option<Joints>>,
    /// The flange's pose at the picture.
    pub base_from_flange: Option<Rigid<Base, Flange>>,
    /// The axes at the picture, if the file has them.
    pub flange_joints: Option<Joints>,
}

/// Checks the text of a points file.
///
/// # Errors
/// Every problem with its line and key.
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
        let axes = |key| top.parse::<Option<[f64; 6]>>(key, AXIS_DEG, Some(None));
        let joints: Option<Vec<Option<[f64; 6]>>> = AXES.into_iter().map(axes).collect();
        let flange_joints = axes("axes_deg");
        let flange = top.has_key("base_from_flange").then(|| parse_pose_table(top, "base_from_flange"));
        if flange.is_none() {
            // Known, and absent.
            let _ = top.section("base_from_flange");
        }
        top.finish();
        if flange.flatten().is_some_and(|pose| like_radians(&pose)) {
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

/// One pose of `--poses` with its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PicturePose {
    /// The picture's name in its folder.
    pub image: String,
    /// The flange's pose as reported by the robot.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The reported axes, if the file has them.
    pub joints: Option<Joints>,
}

/// Checks the text of a poses file for hand-eye calibration; `is_there` returns whether a picture is in the folder.
///
/// # Errors
/// Every problem with its line and key; also a picture that is missing or named twice.
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
            let axes_deg = section.parse::<Option<[f64; 6]>>("axes_deg", AXIS_DEG, Some(None));
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

#[cfg(test)]
mod tests {
    use super::super::pose_keys;
    use super::super::tests::{POSE, problems};
    use super::*;
    use panelprep_base::geometry::KukaPose;
    use panelprep_cell::files::ReportedFlange;

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

    /// A pose in the form of a pendant or of KRL, with its type and its status and turn values.
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

    /// A pose in the form of Zivid's hand-eye calibration. Calculated by hand: a quarter turn about Z is A 90.
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
            ("[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [400.5, -2, 600, 1]", "transposed"),
            ("[0, -2, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]", "orthonormal"),
        ] {
            let found = problems(read(rows));
            assert!(found.contains(words), "{rows}: {found}");
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
}
