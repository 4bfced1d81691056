//! A plan as a KRL program, for those who run it by hand: pure text, `.src`.
//!
//! Poses are the tool's in the panel's frame, so `$BASE` is where the panel stands and `$TOOL` the sanding tool. The
//! program switches nothing: tool, water and extraction stay with whoever runs it, in T1.

use super::plan::Plan;
use crate::geometry::KukaPose;
use crate::recipe;
use std::fmt::Write;

/// A smaller rounding of a corner is none, mm.
const MIN_BLEND_MM: f64 = 0.1;
/// Longest name of a KRL module.
const MAX_NAME: usize = 24;

/// The name of a KRL program, which is that of its file: letters, digits and underscores, a letter first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramName(String);

/// Why a text names no KRL program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{found}\" names no KRL program: 1 to {MAX_NAME} letters, digits and underscores, a letter first")]
pub struct ProgramNameError {
    /// The text.
    pub found: String,
}

impl std::str::FromStr for ProgramName {
    type Err = ProgramNameError;

    fn from_str(text: &str) -> Result<Self, ProgramNameError> {
        let letters = text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let good = letters && text.len() <= MAX_NAME && text.starts_with(|c: char| c.is_ascii_alphabetic());
        if good { Ok(ProgramName(text.to_owned())) } else { Err(ProgramNameError { found: text.to_owned() }) }
    }
}

/// The program; `base_from_panel` is where the panel stands, the nominal place where it is `None`.
pub fn krl(name: &ProgramName, plan: &Plan, base_from_panel: Option<KukaPose>, settings: &recipe::Path) -> String {
    let mut text = format!(
        "&ACCESS RVP\n&REL 1\nDEF {}()\n\
         ; Sanding paths in the frame of the panel. Check $TOOL, run in T1 first.\n\
         BAS(#INITMOV, 0)\n\
         ; $TOOL = TOOL_DATA[1] ; the sanding tool, Z out of the pad\n\
         $BASE = {} ; where the panel stands\n\
         $ACC.CP = {:.3} ; m/s2\n\
         PTP $AXIS_ACT ; block coincidence, no motion\n",
        name.0,
        frame(&base_from_panel.unwrap_or_default()),
        settings.acceleration_mm_s2() / 1_000.0,
    );
    let (mut feed, mut blend) = (String::new(), String::new());
    for path in &plan.paths {
        let grids = path.grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        // A String takes every write.
        let _ = writeln!(text, "; grid {grids}");
        let mut contact = false;
        for waypoint in &path.waypoints {
            if waypoint.contact != contact {
                contact = waypoint.contact;
                text.push_str(if contact { "; contact\n" } else { "; air\n" });
            }
            // The advance run takes both over without a stop; each only where it changes.
            let next_feed = format!("$VEL.CP = {:.4} ; m/s\n", waypoint.feed_mm_s / 1_000.0);
            let next_blend = format!("$APO.CDIS = {:.1} ; mm\n", waypoint.blend_mm);
            change(&mut text, &mut feed, next_feed);
            let rounds = waypoint.blend_mm >= MIN_BLEND_MM;
            if rounds {
                change(&mut text, &mut blend, next_blend);
            }
            let _ = writeln!(text, "LIN {}{}", frame(&waypoint.pose), if rounds { " C_DIS" } else { "" });
        }
    }
    text.push_str("END\n");
    text
}

fn change(text: &mut String, now: &mut String, next: String) {
    if *now != next {
        text.push_str(&next);
        *now = next;
    }
}

fn frame(pose: &KukaPose) -> String {
    format!(
        "{{X {:.3}, Y {:.3}, Z {:.3}, A {:.4}, B {:.4}, C {:.4}}}",
        pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg
    )
}
