//! The path of the tool in contact, as the robot reported it.
//!
//! The robot reports its pose about every 100 ms, together with the number of waypoints that it has executed. If more
//! than two waypoints lie between two reports, these waypoints replace the missing reports, because the robot reported
//! that it had executed them. The distance of the reports from the planned lines is recorded, too.

use super::dwell::ExecutedPose;
use super::planned::Waypoint;
use panelprep_base::geometry::{KukaPose, Panel, Point, Rigid, Tool};

/// A pose that the controller reported during a contact path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseReport {
    /// Time by the controller's clock, ms.
    pub time_ms: u32,
    /// The tool's pose in the panel's frame, which is the base set in the controller.
    pub tip: KukaPose,
    /// Number of executed waypoints, without the plan's first waypoint, at which the arm already was.
    pub done: u32,
    /// The contact force that a compliant tool measured at this time, N.
    pub force_n: Option<f64>,
}

/// All reports of one contact path.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace(Vec<PoseReport>);

/// The executed path, reconstructed from the reports.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExecutedPath {
    /// The poses in the order of time.
    pub poses: Vec<ExecutedPose>,
    /// Number of the robot's reports among the poses.
    pub reports: usize,
    /// Largest distance of a reported pose from the planned lines nearby, mm.
    pub off_mm: f64,
    /// Length of the path in contact, mm.
    pub contact_mm: f64,
}

impl Trace {
    /// Adds a report of the controller.
    pub fn push(&mut self, report: PoseReport) {
        self.0.push(report);
    }

    /// Adds the force that a compliant tool measured to the last report, N; only the first measurement of a report is
    /// used.
    pub fn add_force(&mut self, force_n: f64) {
        if let Some(last) = self.0.last_mut() {
            last.force_n.get_or_insert(force_n);
        }
    }

    /// Returns the executed path, at whose end `done` of all waypoints were executed.
    pub fn executed_path(&self, all: &[Waypoint], done: u32) -> ExecutedPath {
        let mut walked = ExecutedPath { reports: self.0.len(), ..ExecutedPath::default() };
        // The arm starts at the first waypoint.
        let (mut passed, mut time_ms) = (0_usize, self.0.first().map_or(0, |report| report.time_ms));
        let time_of_last_ms = self.0.last().map_or(0, |report| report.time_ms);
        let last = PoseReport { time_ms: time_of_last_ms, tip: KukaPose::default(), done, force_n: None };
        for (report, is_report) in self.0.iter().map(|report| (*report, true)).chain([(last, false)]) {
            let reached = (report.done as usize).min(all.len().saturating_sub(1));
            let missed = reached.saturating_sub(passed);
            let mut places: Vec<(Rigid<Panel, Tool>, bool)> = Vec::new();
            // With one or two corners between two reports, the straight line between the reports deviates from the path
            // by less than the rounding of the corners.
            if missed > MAX_WAYPOINTS_BETWEEN_REPORTS || !is_report {
                let stand_in =
                    |index: usize| (all[index].panel_from_tool, all[index].contact && all[index - 1].contact);
                places.extend((passed + 1..=reached).map(stand_in));
            }
            if is_report {
                let towards = current_target(all, report.done);
                let rubs = all.get(towards).is_some_and(|waypoint| waypoint.contact) && all[towards - 1].contact;
                let tip: Rigid<Panel, Tool> = report.tip.to_rigid();
                walked.off_mm = walked.off_mm.max(path_deviation_mm(all, report.done, tip.origin()));
                places.push((tip, rubs));
            }
            let seconds = f64::from(report.time_ms.saturating_sub(time_ms)) / 1_000.0 / places.len().max(1) as f64;
            for (panel_from_tool, contact) in places {
                let before = walked.poses.last().map(|last: &ExecutedPose| last.panel_from_tool.origin());
                let step_mm = before.map_or(0.0, |before| before.distance_mm(panel_from_tool.origin()));
                walked.contact_mm += if contact { step_mm } else { 0.0 };
                walked.poses.push(ExecutedPose { panel_from_tool, seconds, contact, force_n: report.force_n });
            }
            (passed, time_ms) = (reached.max(passed), report.time_ms);
        }
        walked
    }
}

/// Maximum number of waypoints between two reports at which no report is treated as missing.
const MAX_WAYPOINTS_BETWEEN_REPORTS: usize = 2;
/// Number of lines before and after the current line on which a reported pose may lie, because the pose and the number
/// of executed waypoints are not from the same time.
const MAX_LINES_AWAY: usize = 3;

/// Returns the waypoint to which the arm moves after this number of executed waypoints.
fn current_target(all: &[Waypoint], done: u32) -> usize {
    (done as usize + 1).min(all.len().saturating_sub(1)).max(1)
}

/// Returns the distance of a point from the planned lines near the arm's current line, mm; infinite if there is no
/// planned line. The current line follows from the number of executed waypoints.
pub fn path_deviation_mm(all: &[Waypoint], done: u32, point: Point<Panel>) -> f64 {
    let towards = current_target(all, done);
    let place = |index: usize| all[index].panel_from_tool.origin();
    let lines = towards.saturating_sub(MAX_LINES_AWAY).max(1)..(towards + MAX_LINES_AWAY).min(all.len());
    let distance_mm = |end: usize| {
        let (from, way) = (place(end - 1), (place(end) - place(end - 1)).mm);
        let along = (point - from).mm.dot(&way) / way.norm_squared().max(1e-12);
        (from + panelprep_base::geometry::Vector::new(way) * along.clamp(0.0, 1.0)).distance_mm(point)
    };
    lines.map(distance_mm).reduce(f64::min).unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waypoint(x_mm: f64, contact: bool) -> Waypoint {
        let pose = KukaPose { x_mm, z_mm: if contact { 0.0 } else { 40.0 }, ..KukaPose::default() };
        Waypoint { panel_from_tool: pose.to_rigid(), contact, feed_mm_s: 60.0, blend_mm: 2.0 }
    }

    fn pose_report(time_ms: u32, x_mm: f64, y_mm: f64, done: u32) -> PoseReport {
        PoseReport { time_ms, tip: KukaPose { x_mm, y_mm, ..KukaPose::default() }, done, force_n: None }
    }

    fn ways(walked: &ExecutedPath) -> Vec<(f64, f64, bool)> {
        let way = |pose: &ExecutedPose| (pose.panel_from_tool.origin().mm.x, pose.seconds, pose.contact);
        walked.poses.iter().map(way).collect()
    }

    /// Calculated by hand: down at 0, along to 50, up. Reports on the way, half a millimetre beside the line, are used
    /// without a change.
    #[test]
    fn reports_are_used_as_the_path() {
        let all: Vec<Waypoint> =
            [(0.0, false), (0.0, true), (10.0, true), (20.0, true), (30.0, true), (40.0, true), (50.0, true)]
                .map(|(x, contact)| waypoint(x, contact))
                .into();
        let mut trace = Trace::default();
        trace.push(pose_report(1_000, 0.0, 0.0, 1));
        trace.push(pose_report(1_100, 6.0, 0.5, 1));
        trace.push(pose_report(1_200, 12.0, 0.0, 2));
        let walked = trace.executed_path(&all, 2);
        assert_eq!(ways(&walked), [(0.0, 0.0, true), (6.0, 0.1, true), (12.0, 0.1, true)]);
        assert_eq!((walked.reports, walked.off_mm), (3, 0.5));
        assert!((walked.contact_mm - 2.0 * 36.25f64.sqrt()).abs() < 1e-9, "{}", walked.contact_mm);
    }

    /// After a gap in the reports, the waypoints that were reported as executed replace the missing reports; the time
    /// of the gap is distributed over the waypoints.
    #[test]
    fn waypoints_replace_missing_reports() {
        let all: Vec<Waypoint> = (0..8).map(|n| waypoint(10.0 * f64::from(n), n > 0 && n < 7)).collect();
        let mut trace = Trace::default();
        trace.push(pose_report(1_000, 12.0, 0.0, 1));
        trace.push(pose_report(2_000, 55.0, 0.0, 5));
        let expected = [
            (12.0, 0.0, true),
            (20.0, 0.2, true),
            (30.0, 0.2, true),
            (40.0, 0.2, true),
            (50.0, 0.2, true),
            (55.0, 0.2, true),
        ];
        assert_eq!(ways(&trace.executed_path(&all, 5)), expected);
        // The remaining waypoints are reported with the path's end; the retraction is not in contact.
        let whole = trace.executed_path(&all, 7);
        assert_eq!(ways(&whole)[6..], [(60.0, 0.0, true), (70.0, 0.0, false)]);
        assert_eq!(Trace::default().executed_path(&all, 0), ExecutedPath::default(), "nothing moved");
    }
}
