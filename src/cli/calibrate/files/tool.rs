//! The tool: poses that determine its point and axis, and readings of its force without contact.

use super::pose::{AXIS_DEG, POSITION_RANGE_MM, pose};
use panelprep_base::config::{self, Problems, Section};
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep_vision::calib::tool::AxisTouch;

const FORCE_N: std::ops::RangeInclusive<f64> = -2_000.0..=2_000.0;

/// Checks the text of a file with readings of a compliant tool: the flange and the force, N, of each.
///
/// # Errors
/// Every problem with its line and key.
pub fn force_readings(file: &str, text: &str) -> Result<Vec<(Rigid<Base, Flange>, f64)>, Problems> {
    config::parse_file(file, text, |top| {
        let read = |section: Section<'_, '_>| {
            let flange = pose(&section.section("base_from_flange"));
            let force_n = section.parse("force_n", FORCE_N, None);
            section.finish();
            Some((flange?.to_rigid(), force_n?))
        };
        // Every table is read, so that every problem is reported.
        let all: Vec<_> = top.sections("readings").into_iter().map(read).collect();
        top.finish();
        all.into_iter().collect()
    })
}

/// The content of the `--poses` file of `tcp`.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPoses {
    /// Poses with the tip at one spot.
    pub tip: Vec<Rigid<Base, Flange>>,
    /// The data that determine the axis.
    pub axis: Option<AxisTouch>,
}

/// Gives the true pose of the flange for this report of the robot, or a problem as text if that is not possible.
pub type TrueFlange<'a> = &'a dyn Fn(Rigid<Base, Flange>, Option<&Joints>) -> Result<Rigid<Base, Flange>, String>;

/// Checks the text of a poses file for a tool: `[[poses]]`, and `[[axis]]` or `[[plate]]` with `[[flat]]`.
///
/// # Errors
/// Every problem with its line and key.
pub fn tool_poses(file: &str, text: &str, true_flange: TrueFlange<'_>) -> Result<ToolPoses, Problems> {
    config::parse_file(file, text, |top| {
        let flange = |key: &'static str| -> Option<Vec<Rigid<Base, Flange>>> {
            let read = |section: Section<'_, '_>| {
                let _ = section.parse::<Option<String>>("image", (), Some(None));
                let read = pose(&section.section("base_from_flange"));
                let axes_deg = section.parse::<Option<[f64; 6]>>("axes_deg", AXIS_DEG, Some(None));
                section.finish();
                match true_flange(read?.to_rigid(), axes_deg?.map(Joints::from).as_ref()) {
                    Ok(flange) => Some(flange),
                    Err(problem) => {
                        section.problem("axes_deg", problem);
                        None
                    }
                }
            };
            // Every table is read, so that every problem is reported.
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
    use super::super::tests::{POSE, problems};
    use super::*;

    fn as_reported(flange: Rigid<Base, Flange>, _: Option<&Joints>) -> Result<Rigid<Base, Flange>, String> {
        Ok(flange)
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
