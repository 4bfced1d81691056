//! Writes a plan as a KRL program (`.src`) that a person starts manually.
//!
//! The program sets `$TOOL` and `$BASE` itself, so that it does not depend on the values that were active before. It
//! begins with a PTP to the axis angles from which the arm can follow the path, in the air above the first point. A PTP
//! to axis angles gives the block coincidence (BCO) that a controller requires, and defines the configuration
//! unambiguously. All other motions are linear motions in the panel's frame. The program switches no outputs: the
//! person who runs it in T1 controls tool, water and extraction.

use super::planned::Plan;
use panelprep_base::geometry::{Joints, KukaPose};
use panelprep_cell::recipe;
use panelprep_kuka::krl::RESERVED_WORDS;
use std::fmt::Write;

/// Minimum rounding of a corner, mm; a smaller rounding is written as none.
const MIN_BLEND_MM: f64 = 0.1;
/// Maximum number of characters in the name of a KRL module.
const MAX_PROGRAM_NAME_LENGTH: usize = 24;
/// Speed and acceleration of the axes on the motion to the first point, percent.
const PTP_SPEED_PERCENT: u8 = 20;
/// Keywords of KRL, in addition to [`RESERVED_WORDS`], that cannot be the name of a program.
const ADDITIONAL_KEYWORDS: [&str; 38] = [
    "ANIN", "ANOUT", "AXIS", "BAS", "BOOL", "CCLOSE", "CHANNEL", "CIRC_REL", "CONFIRM", "COPEN", "CREAD", "CWRITE",
    "C_DIS", "C_ORI", "C_PTP", "C_VEL", "DIGIN", "E6AXIS", "E6POS", "FRAME", "IMPORT", "INT", "IS", "LIN_REL",
    "MAXIMUM", "MINIMUM", "OFF", "ON", "POS", "PRIO", "PTP_REL", "PUBLIC", "PULSE", "REAL", "SEC", "SREAD",
    "SWRITE", "TO",
];

/// The name of a KRL program, which is also the name of its file: letters, digits and underscores, beginning with a
/// letter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramName(String);

/// The reason why a text cannot be the name of a KRL program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{found}\" is not a valid KRL program name: 1 to {MAX_PROGRAM_NAME_LENGTH} letters, digits and underscores, a letter first, \
     and not a reserved word"
)]
pub struct ProgramNameError {
    /// The text that was given as a name.
    pub found: String,
}

impl std::str::FromStr for ProgramName {
    type Err = ProgramNameError;

    fn from_str(text: &str) -> Result<Self, ProgramNameError> {
        let letters = text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let is_keyword =
            RESERVED_WORDS.iter().chain(&ADDITIONAL_KEYWORDS).any(|keyword| keyword.eq_ignore_ascii_case(text));
        let good = letters
            && !is_keyword
            && text.len() <= MAX_PROGRAM_NAME_LENGTH
            && text.starts_with(|c: char| c.is_ascii_alphabetic());
        if good { Ok(ProgramName(text.to_owned())) } else { Err(ProgramNameError { found: text.to_owned() }) }
    }
}

/// The contents of a KRL program.
#[derive(Debug, Clone)]
pub struct Program<'a> {
    /// The name of the program.
    pub name: &'a ProgramName,
    /// The plan whose paths the program executes.
    pub plan: &'a Plan,
    /// The sanding tool on the flange, written as `$TOOL`.
    pub flange_from_tool: KukaPose,
    /// The panel's pose, written as `$BASE`.
    pub base_from_panel: KukaPose,
    /// The axis angles at the plan's first waypoint, from which the arm can follow the plan.
    pub start: Joints,
    /// Notes for the person who runs the program, one line each.
    pub remarks: &'a [String],
}

/// Returns the text of the KRL program.
#[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
pub fn to_krl(program: &Program<'_>, settings: &recipe::Path) -> String {
    let mut text = format!(
        "&ACCESS RVP\n&REL 1\nDEF {}()\n\
         ; Sanding paths in the frame of the panel. The program does not switch the tool or the water. Run it in T1 first.\n",
        program.name.0
    );
    for remark in program.remarks {
        // In KRL, a comment ends at the end of its line.
        let _ = writeln!(text, "; {}", remark.replace(['\n', '\r'], " "));
    }
    let _ = write!(
        text,
        "BAS(#INITMOV, 0)\n$IPO_MODE = #BASE\n$ORI_TYPE = #VAR\n$TOOL = {} ; the sanding tool, its Z out of the \
         pad; its load data is not set here\n$BASE = {} ; the pose of the panel\nBAS(#VEL_PTP, \
         {PTP_SPEED_PERCENT})\nBAS(#ACC_PTP, {PTP_SPEED_PERCENT})\n$ACC.CP = {:.3} ; m/s2\n; In the air above the first \
         place. The motion to this point has not been checked.\nPTP {}\n",
        format_frame(&program.flange_from_tool),
        format_frame(&program.base_from_panel),
        settings.acceleration_mm_s2() / 1_000.0,
        format_axes(&program.start),
    );
    let (mut feed, mut blend) = (String::new(), String::new());
    for path in &program.plan.paths {
        let grids = path.grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        let _ = writeln!(text, "; grid {grids}");
        let mut contact = false;
        for waypoint in &path.waypoints {
            if waypoint.contact != contact {
                contact = waypoint.contact;
                text.push_str(if contact { "; contact\n" } else { "; air\n" });
            }
            // The controller's advance run processes these assignments without a stop. An assignment is written only if
            // its value changes.
            let next_feed = format!("$VEL.CP = {:.4} ; m/s\n", waypoint.feed_mm_s / 1_000.0);
            let next_blend = format!("$APO.CDIS = {:.1} ; mm\n", waypoint.blend_mm);
            write_if_changed(&mut text, &mut feed, next_feed);
            let rounds = waypoint.blend_mm >= MIN_BLEND_MM;
            if rounds {
                write_if_changed(&mut text, &mut blend, next_blend);
            }
            let _ = writeln!(text, "LIN {}{}", format_frame(&waypoint.pose()), if rounds { " C_DIS" } else { "" });
        }
    }
    text.push_str("END\n");
    text
}

fn write_if_changed(text: &mut String, now: &mut String, next: String) {
    if *now != next {
        text.push_str(&next);
        *now = next;
    }
}

fn format_frame(pose: &KukaPose) -> String {
    format!(
        "{{X {}, Y {}, Z {}, A {}, B {}, C {}}}",
        format_number(pose.x_mm, 3),
        format_number(pose.y_mm, 3),
        format_number(pose.z_mm, 3),
        format_number(pose.a_deg, 4),
        format_number(pose.b_deg, 4),
        format_number(pose.c_deg, 4)
    )
}

fn format_axes(joints: &Joints) -> String {
    let angles = joints.degrees();
    let words: Vec<String> = angles
        .iter()
        .enumerate()
        .map(|(axis, angle)| format!("A{} {}", axis + 1, format_number(*angle, 4)))
        .collect();
    format!("{{{}}}", words.join(", "))
}

/// Formats a number with this number of decimals, and without a minus sign for zero.
fn format_number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_nothing = text.chars().all(|c| !('1'..='9').contains(&c));
    if is_nothing { text.trim_start_matches('-').to_owned() } else { text }
}
