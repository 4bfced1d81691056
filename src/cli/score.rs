//! Compares the results of a simulated cycle with the ground truth of the simulation. Apart from the tests, only this
//! module reads the ground truth, and no decision depends on it.
//!
//! The measured values are from the record, the executed motions from the mock controller's log, and the true values
//! from the simulated world. The log also shows whether each waypoint of a path was executed and acknowledged once: see
//! [`contact_runs`]. After an injected fault of the simulated tool, it shows when the sander was switched off and when
//! the disc was lifted.

use super::live::SimulatedController;
use super::output::Outcome;
use panelprep_base::geometry::{Base, KukaPose, Mask, Panel, Point, Rigid, Vector};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{Outcome as Ended, Path};
use panelprep_cell::panel::{Grid, TaughtPanel};
use panelprep_cell::record::{CycleRecord, Finding, Kind, MotionRecord, name};
use panelprep_devices::acf::PlannedToolFault;
use panelprep_devices::mock::{ContactSample, ExecutedMotion};
use panelprep_devices::world::{ContactErrors, TouchedPoints, contact_errors, measure_step_over};
use panelprep_service::report::page::{Row, Section};
use panelprep_sim as sim;
use panelprep_sim::{CellTruth, PlacementError};
use panelprep_toolpath::path::StepOver;
use panelprep_vision::inspect::{Inspection, score};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::Arc;

/// Spacing of the sample points with which coverage is measured, mm.
const SAMPLE_SPACING_MM: f64 = 1.0;

/// The comparison of a cycle with the ground truth of the simulation.
pub struct Score {
    located: Option<PlacementError>,
    refined: Option<PlacementError>,
    locate_ms: Option<f64>,
    moves: Option<f64>,
    inspections: Vec<InspectionScore>,
    abrasions: Vec<AbrasionScore>,
    /// The reaction to an injected tool fault, if one was requested; `Some(None)` if the path did not reach the
    /// waypoint of the fault.
    after_tool_fault: Option<Option<AfterToolFault>>,
    /// The difference between the executed waypoints and those that were sent, if there is one.
    pub lost: Option<Reason>,
}

struct InspectionScore {
    pass: bool,
    iou: Option<f64>,
    grids_failed: usize,
    grids_true: Option<usize>,
    grids_wrong: Option<usize>,
    ms_per_frame: Option<f64>,
}

struct AbrasionScore {
    pass: u8,
    waypoints: u32,
    executed: usize,
    /// Number of executed waypoints with the disc in contact.
    in_contact: usize,
    coverage: f64,
    /// Area of the grids that the disc has covered, mm².
    sanded_mm2: f64,
    /// Time from the first waypoint of the path to the last one, s.
    path_s: f64,
    step_over: Option<StepOver>,
    errors: Option<ContactErrors>,
}

impl Score {
    /// Compares the results of a cycle, and the executed motions, with the ground truth of the simulated world.
    pub fn compute(
        record: &CycleRecord,
        inspections: &[Arc<Inspection>],
        (panel, disc_diameter_mm): (&TaughtPanel, f64),
        (simulated, planned): (&SimulatedController, Option<PlannedToolFault>),
    ) -> Self {
        let truth = simulated.world.truth();
        let log = simulated.server.handle();
        let (executed, trace) =
            log.with_controller(|mock| (mock.executed_motions().to_vec(), mock.trace().to_vec()));
        let last_of = |kind: Kind| record.findings.iter().rfind(move |finding| finding.kind == kind);
        let error = |kind: Kind| Some(truth.placement_error_mm(&pose_from_finding(last_of(kind)?)?));
        let (runs, lost) = match contact_runs(&record.motions, &executed) {
            Ok(runs) => (runs, None),
            Err(reason) => (Vec::new(), Some(reason)),
        };
        Score {
            located: error(Kind::Locate),
            refined: error(Kind::Refine),
            locate_ms: last_of(Kind::Locate).and_then(|finding| finding.number(name::SCAN_TO_VERDICT)),
            moves: last_of(Kind::Refine).and_then(|finding| finding.number(name::CORRECTION_MOVES_NAME)),
            inspections: score_inspections(record, inspections, &simulated.world.true_breaks()),
            abrasions: score_abrasions(record, (&runs, &trace), (panel, disc_diameter_mm), truth),
            after_tool_fault: planned.map(|planned| AfterToolFault::compute(planned, &executed, &trace)),
            lost,
        }
    }

    /// Adds the score to the JSON object of the outcome.
    pub fn add_to_outcome(&self, outcome: &mut Outcome) {
        outcome.add_value(
            "locate",
            json!({
                "error_mean_mm": self.located.map(|error| error.mean_mm),
                "error_max_mm": self.located.map(|error| error.max_mm),
                "elapsed_ms": self.locate_ms,
            }),
        );
        let moves = self.moves.map_or(0, |moves| moves as u64);
        outcome
            .add_value("refine", json!({"error_max_mm": self.refined.map(|error| error.max_mm), "moves": moves}));
        let inspect = self.inspections.iter().map(|one| {
            json!({
                "pass": one.pass, "iou": one.iou, "grids_failed": one.grids_failed, "grids_true": one.grids_true,
                "grids_wrong": one.grids_wrong, "ms_per_frame": one.ms_per_frame,
            })
        });
        outcome.add_value("inspect", inspect.collect());
        let abrade = self.abrasions.iter().map(|one| {
            json!({
                "pass": one.pass, "waypoints": one.waypoints, "waypoints_done": one.executed,
                "waypoints_in_contact": one.in_contact,
                "coverage": one.coverage, "sanded_mm2": one.sanded_mm2, "path_s": one.path_s,
                "step_over_mm": one.step_over.map(|step| json!({"min": step.min_mm, "max": step.max_mm})),
                "normal_error_max_deg": one.errors.map(|errors| errors.normal_max_deg),
                "surface_error_max_mm": one.errors.map(|errors| errors.surface_max_mm),
            })
        });
        outcome.add_value("abrade", abrade.collect::<Vec<Value>>().into());
        if let Some(after) = self.after_tool_fault {
            outcome.add_value("after_tool_fault", after.map_or(Value::Null, AfterToolFault::json));
        }
        outcome.add_value("noise", json!(sim::scanner_noise()));
    }

    /// Returns the lines of the score for a person, each with a name and a value.
    fn lines(&self) -> Vec<(String, String)> {
        let mut lines = Vec::new();
        if let Some(error) = self.located {
            let value = format!("mean {:.2} mm, maximum {:.2} mm", error.mean_mm, error.max_mm);
            lines.push(("located by 3D, error over the panel".to_owned(), value));
        }
        if let Some(error) = self.refined {
            let value = format!("mean {:.2} mm, maximum {:.2} mm", error.mean_mm, error.max_mm);
            lines.push(("after the corner pictures, error over the panel".to_owned(), value));
        }
        for (index, one) in self.inspections.iter().enumerate() {
            let shown = |number: Option<usize>| number.map_or("unknown".to_owned(), |number| number.to_string());
            // Without a break that counts, the ratio compares only spots that are too small to fail a grid.
            let has_break = one.grids_failed > 0 || one.grids_true != Some(0);
            let iou = match one.iou {
                Some(iou) if has_break => format!("{iou:.3}"),
                Some(_) => "not applicable (no break)".to_owned(),
                None => "unknown".to_owned(),
            };
            let value = format!(
                "intersection over union {iou}; {} grids failed, {} are truly broken, {} wrongly judged",
                one.grids_failed,
                shown(one.grids_true),
                shown(one.grids_wrong)
            );
            lines.push((format!("inspection {}", index + 1), value));
        }
        for one in &self.abrasions {
            let errors = one.errors.map_or("no contact".to_owned(), |errors| {
                format!(
                    "tool axis at most {:.2}° from the normal, contact at most {:.2} mm from the surface",
                    errors.normal_max_deg, errors.surface_max_mm
                )
            });
            let step = one
                .step_over
                .map_or(String::new(), |step| format!(", rows {:.1} to {:.1} mm apart", step.min_mm, step.max_mm));
            let value = format!(
                "{} of {} waypoints executed, coverage {:.3}, {errors}{step}",
                one.executed, one.waypoints, one.coverage
            );
            lines.push((format!("abrasion, pass {}", one.pass), value));
        }
        if let Some(after) = self.after_tool_fault {
            let value = after.map_or(
                "no sanding path reached the waypoint of the injected fault: choose a smaller waypoint number"
                    .to_owned(),
                AfterToolFault::describe_reaction,
            );
            lines.push(("reaction to the injected tool fault".to_owned(), value));
        }
        lines
    }

    /// Returns the score as lines of text.
    pub fn describe_score(&self) -> Vec<String> {
        self.lines().into_iter().map(|(name, value)| format!("{name}: {value}")).collect()
    }

    /// Returns the score as a section for the page of the cycle.
    pub fn section(&self, simulation: &str) -> Section {
        Section {
            heading: "Comparison with the true values of the simulation".to_owned(),
            text: format!(
                "{simulation}. The cycle above had no access to these values; the executed motion is from the mock \
                 controller's log."
            ),
            rows: self.lines().into_iter().map(|(name, value)| Row::new(&name, value, "")).collect(),
            figures: Vec::new(),
        }
    }
}

/// Compares the mask of each film with the pixels at which the film was truly broken in its last picture.
fn score_inspections(
    record: &CycleRecord,
    inspections: &[Arc<Inspection>],
    films: &[Mask],
) -> Vec<InspectionScore> {
    // An abandoned film has a true mask but no inspection. The true masks can then not be assigned to the inspections,
    // and none is used.
    let films = if films.len() == inspections.len() { films } else { &[] };
    let watched =
        |finding: &&Finding| finding.kind == Kind::Inspect && finding.number(name::WATCHED_TIME_NAME).is_some();
    let findings = record.findings.iter().filter(watched);
    let one = |(index, (inspection, finding)): (usize, (&Arc<Inspection>, &Finding))| {
        let truth = films.get(index);
        let region = inspection.footprint.region();
        let confusion = truth.and_then(|mask| inspection.compare_with_truth(mask).ok());
        InspectionScore {
            pass: inspection.judgement.verdict == Verdict::Pass,
            iou: truth.and_then(|mask| score(&inspection.mask(), mask, &region).ok()).map(|score| score.iou),
            grids_failed: inspection.grids.iter().filter(|grid| grid.failed).count(),
            grids_true: confusion.map(|grids| grids.true_fail + grids.false_pass),
            grids_wrong: confusion.map(|grids| grids.false_fail + grids.false_pass),
            ms_per_frame: finding.number(name::PER_PICTURE),
        }
    };
    inspections.iter().zip(findings).enumerate().map(one).collect()
}

/// Compares each contact path, as the controller executed it, with the true surface.
fn score_abrasions(
    record: &CycleRecord,
    (runs, trace): (&[&[ExecutedMotion]], &[ContactSample]),
    (panel, disc_diameter_mm): (&TaughtPanel, f64),
    truth: &CellTruth,
) -> Vec<AbrasionScore> {
    let begun =
        |finding: &&Finding| finding.number(name::EXECUTED_WAYPOINTS_NAME).is_some_and(|waypoints| waypoints > 0.0);
    let findings = record.findings.iter().filter(begun);
    let mut before_ms = 0;
    let one = |((motion, run), finding): ((&MotionRecord, &&[ExecutedMotion]), &Finding)| {
        let until_ms = run.last().map_or(before_ms, |last| last.time_ms);
        let during = |sample: &&ContactSample| before_ms < sample.time_ms && sample.time_ms <= until_ms;
        let part: Vec<ContactSample> = trace.iter().filter(during).copied().collect();
        before_ms = until_ms;
        let from_ms = run.first().map_or(until_ms, |first| first.time_ms);
        let touched = TouchedPoints::reached_by_disc(&part, truth, disc_diameter_mm);
        let grids = grids(finding, panel);
        let points: Vec<Point<Panel>> = grids.into_iter().flat_map(|grid| surface_grid(grid, truth)).collect();
        AbrasionScore {
            pass: finding.pass,
            waypoints: motion.motion.waypoints,
            executed: run.len(),
            in_contact: run.iter().filter(|command| command.contact).count(),
            coverage: touched.share(&points),
            sanded_mm2: panel.grids.iter().map(|grid| sanded_mm2(grid, &touched, truth)).sum(),
            path_s: (until_ms - from_ms) as f64 / 1_000.0,
            step_over: measure_step_over(&part, truth),
            errors: contact_errors(&part, truth),
        }
    };
    contact(&record.motions).zip(runs).zip(findings).map(one).collect()
}

fn pose_from_finding(finding: &Finding) -> Option<Rigid<Base, Panel>> {
    let pose = finding.details.get("base_from_panel")?;
    Some(serde_json::from_value::<KukaPose>(pose.clone()).ok()?.to_rigid())
}

/// Returns the grids that a sanding pass touched.
fn grids<'a>(finding: &Finding, panel: &'a TaughtPanel) -> Vec<&'a Grid> {
    let named = ["grids", "grids_in_part"].into_iter().filter_map(|name| finding.details.get(name)?.as_array());
    let names: Vec<&str> = named.flatten().filter_map(Value::as_str).collect();
    panel.grids.iter().filter(|grid| names.contains(&grid.id.to_string().as_str())).collect()
}

/// Returns the area of a grid that the disc has covered, mm².
fn sanded_mm2(grid: &Grid, touched: &TouchedPoints, truth: &CellTruth) -> f64 {
    let [a, b, c, d] = grid.corners.map(|corner| corner.mm.coords);
    let points = surface_grid(grid, truth);
    let covered = points.par_iter().filter(|point| touched.was_touched(**point)).count();
    // The area is half of the cross product of the diagonals.
    let area_mm2 = (c - a).cross(&(d - b)).norm() / 2.0;
    area_mm2 * covered as f64 / points.len().max(1) as f64
}

/// Returns sample points of a grid on the true surface; each represents nearly the same area.
fn surface_grid(grid: &Grid, truth: &CellTruth) -> Vec<Point<Panel>> {
    let [a, b, c, d] = grid.corners.map(|corner| corner.mm.coords);
    let steps = |length_mm: f64| (length_mm / SAMPLE_SPACING_MM).ceil().max(1.0) as usize;
    let (across, down) = (steps((b - a).norm().max((c - d).norm())), steps((d - a).norm().max((c - b).norm())));
    let at = |index: usize| {
        let share = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        let (s, t) = (share(index % across, across), share(index / across, down));
        let flat = (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t;
        let point = Point::<Panel>::new(flat.into());
        let down: Vector<Panel> = truth.normal(point) * -truth.distance_mm(point);
        point + down
    };
    (0..across * down).map(at).collect()
}

/// Returns the contact paths of which at least one waypoint was executed.
fn contact(motions: &[MotionRecord]) -> impl Iterator<Item = &MotionRecord> {
    motions.iter().filter(|record| record.motion.path == Path::Contact && record.done > 0)
}

/// Returns the contact paths as the controller executed them, in order, one for each contact path in the store.
///
/// The commands of a path have consecutive ids. Paths are separated, because a speed is set before each path and an
/// output is switched after it.
///
/// # Errors
/// If a command was executed twice, or the number of executed waypoints of a path differs from the number that was sent
/// and acknowledged.
fn contact_runs<'a>(
    motions: &[MotionRecord],
    executed: &'a [ExecutedMotion],
) -> Result<Vec<&'a [ExecutedMotion]>, Reason> {
    let lost = |message: String| Reason::new("waypoints", message);
    let mut ids: Vec<(i32, i32)> = executed.iter().map(|command| (command.epoch, command.id)).collect();
    ids.sort_unstable();
    if let Some(pair) = ids.windows(2).find(|pair| pair[0] == pair[1]) {
        let (epoch, id) = pair[0];
        return Err(lost(format!("command {id} of epoch {epoch} was executed twice")));
    }
    let follows =
        |before: &ExecutedMotion, after: &ExecutedMotion| before.epoch == after.epoch && after.id == before.id + 1;
    let touches = |run: &&[ExecutedMotion]| run.iter().any(|command| command.contact);
    let runs: Vec<&[ExecutedMotion]> = executed.chunk_by(follows).filter(touches).collect();
    let contact: Vec<&MotionRecord> = contact(motions).collect();
    if runs.len() != contact.len() {
        let message = format!("{} paths in contact were executed, {} were sent", runs.len(), contact.len());
        return Err(lost(message));
    }
    for (run, motion) in runs.iter().zip(contact) {
        let (sent, done) = (motion.motion.waypoints, motion.done);
        let is_whole = motion.outcome == Some(Ended::Done);
        let max_done = if is_whole { done } else { done + MAX_ACKS_IN_TRANSIT };
        if !(done as usize..=max_done as usize).contains(&run.len())
            || (is_whole && done != sent)
            || run.first().map(|one| one.epoch) != Some(motion.motion.epoch as i32)
        {
            let message = format!(
                "path of {sent} waypoints in epoch {}: the controller executed {} waypoints, {done} were acknowledged",
                motion.motion.epoch,
                run.len()
            );
            return Err(lost(message));
        }
    }
    Ok(runs)
}

/// Maximum number of acknowledgements of a path that were in transit when its epoch ended early.
const MAX_ACKS_IN_TRANSIT: u32 = 2;

/// The reaction of the cell to an injected tool fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AfterToolFault {
    /// Time from the fault until the output of the tool was off, ms; `None` if it was on as long as the disc was on the
    /// panel.
    pub off_ms: Option<u64>,
    /// Time from the fault until the retract began, or until the path left the panel, ms.
    pub lifted_ms: u64,
}

impl AfterToolFault {
    /// Computes the reaction from the executed waypoints and from the state of the tool at each tick of a contact.
    /// `None` if the path did not reach the waypoint of the fault, or there was no contact after it.
    pub fn compute(
        planned: PlannedToolFault,
        executed: &[ExecutedMotion],
        trace: &[ContactSample],
    ) -> Option<Self> {
        let mut touching = executed.iter().filter(|command| command.contact);
        let begun_ms = touching.nth(planned.from.checked_sub(1)? as usize)?.time_ms;
        let mut after = trace.iter().filter(|sample| sample.time_ms > begun_ms).peekable();
        // A gap in the samples separates this contact from the next path of the same cycle.
        let mut before_ms = after.peek()?.time_ms;
        let path: Vec<&ContactSample> = after
            .take_while(|sample| sample.time_ms - std::mem::replace(&mut before_ms, sample.time_ms) < MAX_GAP_MS)
            .collect();
        let off = path.iter().find(|sample| !sample.tool_on);
        Some(AfterToolFault {
            off_ms: off.map(|sample| sample.time_ms - begun_ms),
            lifted_ms: path.last()?.time_ms - begun_ms,
        })
    }

    /// Returns a text about the reaction for a person.
    pub fn describe_reaction(self) -> String {
        let off = self
            .off_ms
            .map_or("the sander was not switched off".to_owned(), |ms| format!("sander off after {ms} ms"));
        format!("{off}, disc lifted after {} ms", self.lifted_ms)
    }

    /// Returns the reaction as JSON.
    pub fn json(self) -> Value {
        json!({"off_ms": self.off_ms, "lifted_ms": self.lifted_ms})
    }
}

/// Maximum time between two samples of the same contact, ms.
const MAX_GAP_MS: u64 = 1_000;

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
    use panelprep_cell::cycle::Motion;
    use panelprep_devices::acf::ToolFault;

    fn command(id: i32, contact: bool) -> ExecutedMotion {
        let base_from_flange: Rigid<Base, Flange> = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        ExecutedMotion { epoch: 3, id, joints: Joints::default(), base_from_flange, time_ms: id as u64, contact }
    }

    fn motion(waypoints: u32, done: u32) -> MotionRecord {
        let motion = Motion { epoch: 3, path: Path::Contact, plan: 7, waypoints };
        let outcome = Some(if done == waypoints { Ended::Done } else { Ended::Held });
        MotionRecord { motion, outcome, done, contact: None }
    }

    /// The commands 5 to 8 are a contact path, part of which is without contact; 2 and 11 are motions without contact.
    #[test]
    fn each_waypoint_is_executed_and_acknowledged_once() {
        let log = [(2, false), (5, true), (6, false), (7, true), (8, false), (11, false)];
        let log = log.map(|(id, contact)| command(id, contact));
        let runs = contact_runs(&[motion(4, 4)], &log).expect("whole");
        assert_eq!(runs.len(), 1);
        assert_eq!(runs[0].iter().map(|one| one.id).collect::<Vec<_>>(), [5, 6, 7, 8]);
        let held = contact_runs(&[motion(9, 4)], &log).expect("the rest was never executed");
        assert_eq!(held[0].len(), 4);
        // The last acknowledgements were in transit when the path was ended.
        assert!(contact_runs(&[motion(9, 2)], &log).is_ok());
        let wrong = |motions: &[MotionRecord], log: &[ExecutedMotion]| {
            contact_runs(motions, log).expect_err("wrong").message
        };
        assert!(wrong(&[motion(5, 5)], &log).contains("executed 4 waypoints, 5 were acknowledged"));
        assert!(wrong(&[motion(3, 3)], &log).contains("executed 4 waypoints, 3"));
        assert!(wrong(&[motion(9, 1)], &log).contains("executed 4 waypoints, 1"));
        assert!(wrong(&[motion(9, 5)], &log).contains("executed 4 waypoints, 5"));
        assert!(wrong(&[], &log).contains("1 paths in contact were executed, 0 were sent"));
        assert!(wrong(&[motion(4, 4), motion(4, 4)], &log).contains("2 were sent"));
        let twice = [log[0], log[1], log[2], log[2], log[3], log[4]];
        assert!(wrong(&[motion(4, 4)], &twice).contains("command 6 of epoch 3 was executed twice"));
    }

    fn executed(time_ms: u64, contact: bool) -> ExecutedMotion {
        let base_from_flange = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        ExecutedMotion { epoch: 3, id: 1, joints: Joints::default(), base_from_flange, time_ms, contact }
    }

    fn sample(time_ms: u64, tool_on: bool) -> ContactSample {
        let base_from_flange = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        let base_from_tool = Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity());
        ContactSample { time_ms, base_from_flange, base_from_tool, sanding: true, tool_on }
    }

    /// Expected times, calculated by hand: the second waypoint in contact ends at 200 ms. The sander is off at 310 ms,
    /// and the last sample of this contact is at 420 ms.
    #[test]
    fn times_count_from_the_waypoint_at_which_the_fault_begins() {
        let planned = PlannedToolFault { fault: ToolFault::Silent, from: 2 };
        let log = [executed(50, false), executed(100, true), executed(200, true), executed(300, true)];
        let trace = [190, 205, 300, 310, 420, 5_000].map(|ms| sample(ms, ms < 310));
        let found = AfterToolFault::compute(planned, &log, &trace);
        assert_eq!(found, Some(AfterToolFault { off_ms: Some(110), lifted_ms: 220 }));
        let ran_on = trace.map(|one| ContactSample { tool_on: true, ..one });
        assert_eq!(
            AfterToolFault::compute(planned, &log, &ran_on),
            Some(AfterToolFault { off_ms: None, lifted_ms: 220 })
        );
        assert_eq!(AfterToolFault::compute(PlannedToolFault { from: 9, ..planned }, &log, &trace), None);
    }
}
