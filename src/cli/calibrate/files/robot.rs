//! The data for the arm's own errors: pictures and touches, in poses that are stated by the flange, the axes, or
//! both.

use super::pose::{AXIS_DEG, CORNER, pose};
use panelprep_base::config::{self, Problems, Section};
use panelprep_base::geometry::{Base, Flange, Joints, Rigid};

/// The robot's pose as the controller reports it: by the flange, by the axes, or by both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StatedPose {
    Flange(Rigid<Base, Flange>),
    Axes(Joints),
    Both(Rigid<Base, Flange>, Joints),
}

/// A picture's name in its folder, and the pose of the robot.
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
    let axes_deg = section.parse::<Option<[f64; 6]>>("axes_deg", AXIS_DEG, Some(None))?;
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

/// Checks the text of a poses file for an arm: `[[poses]]` with `image`, and `base_from_flange`, `axes_deg` or both.
///
/// # Errors
/// Every problem with its line and key; also a picture that is missing or named twice.
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
        // Every table is read, so that every problem is reported.
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

/// A touched target, as a touches file states it.
#[derive(Debug, Clone, PartialEq)]
pub enum StatedTouch {
    /// A spot by its number; touches of one spot have the same number.
    Spot(usize),
    /// A corner (column, row) of the board in front of the camera on the flange.
    Corner(usize, usize),
    /// A corner of the board that was at rest in a picture of the fixed camera.
    CornerIn(usize, usize, String),
}

/// Checks the text of a touches file: `[[touches]]` with `spot`, or with `corner` of a fixed board, and a pose.
/// With `image`, the board is the one in that picture of the fixed camera; without it, it is the board of the
/// camera on the flange.
///
/// # Errors
/// Every problem with its line and key.
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

#[cfg(test)]
mod tests {
    use super::super::tests::{POSE, problems};
    use super::*;

    /// A touch names a spot, a corner, or a corner in a picture; a touch that names two of them, or none, is a problem
    /// with its line.
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
}
