//! The true position of the tool's tip at each touch: computed from the axes and the cell's own tool, not from the
//! pendant's display.
//!
//!     base_from_tip = base_from_flange(axes) · flange_from_tool
//! The pendant shows the tip of the tool that is selected there, for an arm with its nominal geometry. A touch must
//! show how well the cell's tool and the arm's correction agree with the board. So the pendant's position is used only
//! to check that axes and touch belong together.

use super::super::fault::Fault;
use super::super::load::CellFiles;
use super::files::Points;
use panelprep_base::geometry::{Flange, Point, Rigid, Tool};
use panelprep_base::number_text;
use panelprep_toolpath::path::Kinematics;
use std::path::Path;

/// Maximum difference between the pendant's tool and the cell's tool, mm: a new calibration changes the tool by
/// less.
const MAX_TOOL_DIFFERENCE_MM: f64 = 3.0;

/// Moves the tips to the positions that follow from axes and tool. Without axes, a position stays as the pendant shows
/// it, which is that of an arm with its nominal geometry.
///
/// # Errors
/// If axes are missing although the arm has a correction, or if the pendant shows another tip than these axes and the
/// cell's tool give for an arm with its nominal geometry.
pub fn place_tips_by_axes(
    files: &CellFiles,
    flange_from_tool: &Rigid<Flange, Tool>,
    (file, points): (&Path, &mut Points),
) -> Result<(), Fault> {
    let arm = Kinematics::new(files.cell.arm());
    for (index, (touched, joints)) in points.touched.iter_mut().zip(&points.joints).enumerate() {
        let number = index + 1;
        let Some(joints) = joints else {
            if files.cell.arm().correction().is_none() {
                continue;
            }
            let why = "the arm's correction needs the axis angles at each touch";
            return Err(Fault::file_fault(file, format!("p{number}_axes_deg = [A1, …, A6] is missing: {why}")));
        };
        let drawn = arm.nominal_flange(joints);
        let drawn = drawn.ok_or_else(|| {
            Fault::file_fault(file, format!("p{number}_axes_deg: not valid axis angles of this arm"))
        })?;
        let tip = Point::at(0.0, 0.0, 0.0);
        let apart_mm = touched.place.distance_mm(drawn * *flange_from_tool * tip);
        if apart_mm > MAX_TOOL_DIFFERENCE_MM {
            let [off, allowed] = number_text::distinguishable_texts(apart_mm, MAX_TOOL_DIFFERENCE_MM, 1);
            return Err(Fault::file_fault(
                file,
                format!(
                    "p{number}_mm is {off} mm from the tip of the cell's tool at p{number}_axes_deg (limit {allowed} mm). \
                     Select the cell's own tool on the pendant, and write position and axis angles of the same touch"
                ),
            ));
        }
        touched.place = arm.true_flange(drawn, joints) * *flange_from_tool * tip;
    }
    Ok(())
}
