//! `[limits]`: values that are valid for every panel of the cell. A recipe may override a number if its description
//! states this.

use panelprep_base::config::{Section, settings};
use panelprep_base::geometry::{Base, Point};
use panelprep_base::number_text::list;

settings! {
    /// `[limits]`. The upper limits are the program's own: a cell may be stricter, never less strict.
    pub struct Limits {
        /// Maximum duration of motion that is sent and not yet executed, s: the motion that the arm can still make
        /// when the link fails.
        window_s: f64, 0.1..=1.0, default 1.0;
        /// Maximum number of commands that are sent and not yet executed.
        window_commands: usize, 5..=50, default 50;
        /// Minimum number of points that are queued before a path starts.
        min_points: usize, 2..=50, default 5;
        /// Time between heartbeats of the application, in both directions, ms.
        heartbeat_ms: usize, 10..=100, default 100;
        /// Silence after which either end stops if anything is queued, ms.
        watchdog_ms: usize, 40..=400, default 400;
        /// How long a localization may be used before Verify must renew it, s.
        token_s: f64, 10.0..=600.0, default 600.0;
        /// The time limit for a stop, after which it is a fault, s.
        stop_deadline_s: f64, 0.5..=10.0, default 10.0;
        /// How long the output `warning` of `[io.outputs]` is on before the first motion after a standstill, s.
        warning_s: f64, 0.5..=30.0, default 3.0;
        /// How long a film is watched after it is fully wet, s (ASTM F22: up to a minute); a recipe may override it.
        observation_s: f64, 5.0..=600.0, default 60.0;
        /// Area of broken film from which a grid fails, mm²; a recipe may override it.
        min_break_mm2: f64, 0.1..=10_000.0, default 5.0;
        /// Error at the tool that is used while not all parts of the error budget are measured, mm; stated, not
        /// measured.
        tool_error_mm: Option<f64>, 0.01..=20.0, default None;
        /// Largest error of the last verification of a calibration with which a cycle may start, mm.
        verify_limit_mm: f64, 0.05..=10.0, default 0.5;
        /// Largest age of the last verification with which a cycle may start, h.
        verify_max_age_h: f64, 0.1..=8_760.0, default 24.0;
        /// Lower corner of the box that the tool's tip must not leave, in the base frame, mm.
        box_min_mm: Option<[f64; 3]>, -5_000.0..=5_000.0, default None;
        /// Upper corner of the box that the tool's tip must not leave, in the base frame, mm.
        box_max_mm: Option<[f64; 3]>, -5_000.0..=5_000.0, default None;
        /// Longest distance from one waypoint to the next, mm.
        max_step_mm: f64, 1.0..=1_000.0, default 100.0;
        /// Largest turn of the tool from one waypoint to the next, degrees.
        max_turn_deg: f64, 0.1..=180.0, default 15.0;
        /// Largest angle between the tool's axis and the direction in which it was taught, degrees.
        max_tilt_deg: f64, 1.0..=90.0, default 45.0;
        /// Fastest speed of the tool's tip, mm/s.
        max_speed_mm_s: f64, 1.0..=2_000.0, default 250.0;
    }
}

/// The box that the tool's tip must not leave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    /// Lower corner, mm.
    pub min: Point<Base>,
    /// Upper corner, mm; it exceeds the lower corner in every axis.
    pub max: Point<Base>,
}

impl Workspace {
    /// Returns whether the box contains this point.
    pub fn contains(&self, point: Point<Base>) -> bool {
        (0..3).all(|axis| (self.min.mm[axis]..=self.max.mm[axis]).contains(&point.mm[axis]))
    }
}

impl Limits {
    /// Returns the box for waypoints, `box_min_mm` to `box_max_mm`; `None` if the file states none.
    pub fn workspace(&self) -> Option<Workspace> {
        let corner = |[x_mm, y_mm, z_mm]: [f64; 3]| Point::at(x_mm, y_mm, z_mm);
        Some(Workspace { min: corner(self.box_min_mm?), max: corner(self.box_max_mm?) })
    }
}

pub(super) fn parse_limits(section: &Section<'_, '_>) -> Option<Limits> {
    let limits = Limits::parse(section)?;
    let mut wrong = Vec::new();
    if limits.min_points > limits.window_commands {
        let (found, allowed) = (limits.min_points, limits.window_commands);
        wrong.push(("min_points", format!("found {found}, the limit is window_commands, {allowed}")));
    }
    if limits.watchdog_ms < 2 * limits.heartbeat_ms {
        let (found, allowed) = (limits.watchdog_ms, 2 * limits.heartbeat_ms);
        wrong.push(("watchdog_ms", format!("found {found}, the minimum is {allowed}, twice heartbeat_ms")));
    }
    match (limits.box_min_mm, limits.box_max_mm) {
        (Some(low), Some(high)) if (0..3).any(|axis| low[axis] >= high[axis]) => {
            wrong.push((
                "box_max_mm",
                format!("{} must exceed box_min_mm {} in every axis", list(&high), list(&low)),
            ));
        }
        (Some(_), None) => wrong.push(("box_max_mm", "is missing; box_min_mm is given".to_owned())),
        (None, Some(_)) => wrong.push(("box_min_mm", "is missing; box_max_mm is given".to_owned())),
        _ => {}
    }
    wrong.iter().for_each(|(key, message)| section.problem(key, message));
    wrong.is_empty().then_some(limits)
}
