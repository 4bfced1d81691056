//! The page of one cycle: the results of every phase, the limits, the files used, the conditions, the treatment of the
//! panel, and the requests to the cell. A fact that was not recorded is stated as unknown.

use super::page::{Figure, NOT_MEASURED_TEXT, Page, Row, Section, check_row, format_value};
use panelprep_base::geometry::KukaPose;
use panelprep_base::number_text::utc_text;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Path, Request};
use panelprep_cell::record::{
    AbradedGrid, AbrasionExtent, Answer, Bounds, Check, Clock, CycleRecord, Disposition, Finding, Kind,
    MotionRecord, ProofsResult, RequestRecord, RequestedAction, finding_dispositions, name,
};
use serde_json::Value;
use std::collections::BTreeMap;

/// A blank that a person fills in on the printed page.
const BLANK: &str = "……………………………………";
const AIR_RUN_TEXT: &str = "This was an air-run: the path was run above the panel with water and tool off. The panel \
                            was neither tested nor sanded, and this page does not release it. ";
const ON_FOAM_TEXT: &str =
    "This cycle was run on a sheet of foam, as an acceptance test of the cell: this page releases no panel. ";

/// Returns the page of a cycle; `pictures` contains its JPEGs by their hash. A missing picture is reported as missing.
pub fn cycle_page(record: &CycleRecord, pictures: &BTreeMap<String, Vec<u8>>) -> Page {
    let running = || Judgement {
        verdict: Verdict::Invalid,
        reasons: vec![Reason::new("running", "the cycle has not ended: this page does not show its final result")],
    };
    let times = ClockKind::from_record(record);
    let mut sections: Vec<Section> = record
        .findings
        .iter()
        .zip(finding_dispositions(&record.findings, &record.asked))
        .map(|(finding, disposition)| section((finding, disposition), pictures, times))
        .collect();
    sections.extend([abrasion_list(record), motions(record), budget(record)]);
    sections.extend(request_list(record));
    sections.push(used_inputs(record));
    // An air-run tests no panel, so its page has no test conditions.
    let is_air_run = record.is_air_run();
    sections.extend((!is_air_run).then(|| conditions(record, times)));
    let (kind, warning) = match (is_air_run, record.is_on_foam()) {
        (true, _) => (", air-run", AIR_RUN_TEXT),
        (_, true) => (", on foam", ON_FOAM_TEXT),
        _ => ("", ""),
    };
    Page {
        first: String::new(),
        title: format!("Panel {}, cycle {}{kind}", record.panel, record.id),
        subtitle: format!("{warning}{}", duration(record)),
        judgement: record.judgement.clone().unwrap_or_else(running),
        sections,
        made: String::new(),
    }
}

/// Returns the sections about the sanding and the requests of the cycle; the PDF of the record contains them too.
pub(super) fn event_sections(record: &CycleRecord) -> Vec<Section> {
    std::iter::once(abrasion_list(record)).chain(request_list(record)).collect()
}

/// The clock by which the times of films and motions are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ClockKind {
    /// The computer's clock: the page adds no remark to a duration.
    Wall,
    /// The simulated cell's.
    Simulated,
    /// The clock was not recorded.
    Unknown,
}

impl ClockKind {
    fn from_record(record: &CycleRecord) -> Self {
        match record.clocks[0] {
            Some(Clock::Wall) => ClockKind::Wall,
            Some(Clock::Simulated { .. }) => ClockKind::Simulated,
            None => ClockKind::Unknown,
        }
    }

    /// Returns the remark after a duration, so that a reader does not confuse the two clocks.
    fn clock_remark(self, kind: Kind, check: &Check) -> &'static str {
        match (self, check.unit.as_str()) {
            // The time of a plan is computed, not measured by a clock.
            (_, "s") if kind == Kind::Plan => ", planned",
            (ClockKind::Simulated, "s") => " of simulated time",
            (ClockKind::Simulated, "ms") => " of wall time",
            _ => "",
        }
    }
}

/// Describes when the cycle began and ended, and its duration by each clock.
fn duration(record: &CycleRecord) -> String {
    let began = utc_text(record.started_unix_s);
    let reasons = record.judgement.iter().flat_map(|judgement| &judgement.reasons);
    let is_interrupted = reasons.into_iter().any(|reason| reason.code == "interrupted");
    let wall = match record.ended_unix_s {
        None => format!("{began}, not ended"),
        Some(end) if is_interrupted => format!(
            "began {began}; the program stopped during the cycle at an unrecorded time, and concluded the cycle at \
             its next start, {}",
            utc_text(end)
        ),
        Some(end) => format!("{began} to {}, {} s", utc_text(end), end - record.started_unix_s),
    };
    match record.clocks {
        [Some(Clock::Wall), _] => format!("Wall time: {wall}."),
        [Some(Clock::Simulated { at_ms: from }), Some(Clock::Simulated { at_ms: to })] if to >= from => {
            let simulated_s = format_value((to - from) as f64 / 1_000.0);
            format!("Simulated cell. Simulated time: {simulated_s} s. Wall time: {wall}.")
        }
        [Some(Clock::Simulated { .. }), _] => {
            format!(
                "Simulated cell. Simulated time: unknown, because the program stopped during the cycle. Wall time: \
                 {wall}."
            )
        }
        [None, _] => format!("Wall time: {wall}. It was not recorded whether the cell was simulated."),
    }
}

fn section(
    (finding, disposition): (&Finding, Disposition<'_>),
    pictures: &BTreeMap<String, Vec<u8>>,
    times: ClockKind,
) -> Section {
    let heading = match finding.kind {
        Kind::Locate => "The panel's pose",
        Kind::Refine => "The corner",
        Kind::Reach => "Reach of the arm",
        Kind::Inspect => "The film",
        Kind::Plan => "The sanding path",
        Kind::Verify => "The corner, before contact",
        Kind::Abrade => "The abrasion",
        Kind::Gate => "Checks before a motion",
        Kind::Robot => "The robot",
        Kind::SelfTest => "The self-test",
        Kind::Tool => "The compliant tool",
    };
    let pass = match finding.pass {
        0 => String::new(),
        pass => format!(", pass {pass}"),
    };
    let reasons = finding.judgement.reasons.iter().map(|reason| format!("; {} ({})", reason.message, reason.code));
    let became = disposition.describe().map_or(String::new(), |words| format!(", {words}"));
    let details = finding.details.iter().map(|(name, value)| Row::new(name, format_detail(value), ""));
    let shots = finding.shots.iter().map(|shot| Row::new(&format!("picture {}", shot.name), &shot.hash, ""));
    let figure = |picture: &panelprep_cell::record::Picture| match pictures.get(&picture.hash) {
        Some(jpeg) => Ok(Figure { caption: picture.caption.clone(), jpeg: jpeg.clone() }),
        None => Err(Row::new(&picture.caption, format!("the picture {} is missing", picture.hash), "")),
    };
    let (mut figures, mut missing) = (Vec::new(), Vec::new());
    for found in finding.pictures.iter().map(figure) {
        match found {
            Ok(figure) => figures.push(figure),
            Err(row) => missing.push(row),
        }
    }
    let numbers = finding.checks.iter().flat_map(|number| {
        let to_execute = Some(number).filter(|number| finding.kind == Kind::Plan && number.name == name::PLANNED);
        let to_execute = to_execute.and_then(|number| number.value).map(|all| {
            let words = format!(
                "{}: all but the first waypoint, which is in air at the end of the approach",
                format_value((all - 1.0).max(0.0))
            );
            Row::new("of these, of the path over the panel", words, "")
        });
        std::iter::once(row(number, finding.kind, times)).chain(to_execute)
    });
    Section {
        heading: format!("{heading}{pass}"),
        text: format!("{}{became}{}", finding.judgement.verdict.keyword(), reasons.collect::<String>()),
        rows: numbers.chain(details).chain(shots).chain(missing).collect(),
        figures,
    }
}

/// Formats a detail for people: a pose with its units, names as a list, and any other value as it is stored.
fn format_detail(value: &Value) -> String {
    let pose = serde_json::from_value::<KukaPose>(value.clone()).ok();
    let names = serde_json::from_value::<Vec<String>>(value.clone()).ok();
    match (pose, names, value) {
        (Some(pose), ..) => pose.to_string(),
        (_, Some(names), _) if names.is_empty() => "none".to_owned(),
        (_, Some(names), _) => names.join(", "),
        (.., Value::String(text)) => text.clone(),
        _ => value.to_string(),
    }
}

fn row(check: &Check, kind: Kind, times: ClockKind) -> Row {
    check_row(check, times.clock_remark(kind, check))
}

fn budget(record: &CycleRecord) -> Section {
    let budget = record.budget.unwrap_or_default();
    let total = budget.total_mm();
    let part = |name: &str, value: Option<f64>| {
        Row::new(
            name,
            value.map_or(NOT_MEASURED_TEXT.to_owned(), |value| format!("{} mm", format_value(value))),
            "",
        )
    };
    let is_corrected = record.files.iter().any(|file| file.name == "robot_correction");
    let robot = if is_corrected { "robot, corrected by robot_correction, and tool" } else { "robot and tool" };
    let mut rows = vec![
        part("hand-eye calibration", budget.hand_eye_mm),
        part("localization", budget.locate_mm),
        part("surface fit", budget.fit_mm),
        part(robot, budget.robot_mm),
        part("total", total),
    ];
    if total.is_none() {
        let stated = budget.stated_mm.map_or("not stated".to_owned(), |value| {
            format!("{} mm, from the cell's file, not measured", format_value(value))
        });
        rows.push(Row::new("used instead of the total: [limits] tool_error_mm", stated, ""));
    }
    Section {
        heading: "Error at the tool".to_owned(),
        text:
            "At 95 % confidence. The total is the root of the sum of squares; it is stated if every component was \
               measured."
                .to_owned(),
        rows,
        figures: Vec::new(),
    }
}

fn used_inputs(record: &CycleRecord) -> Section {
    let mut rows =
        vec![Row::new("taught version", &record.taught_version, ""), Row::new("recipe", &record.recipe_hash, "")];
    rows.extend(record.files.iter().map(|file| Row::new(&file.name, &file.hash, "")));
    rows.push(Row::new("panelprep", &record.program_version, ""));
    rows.push(Row::new("entries in the journal", record.events.to_string(), ""));
    Section {
        heading: "What was used".to_owned(),
        text: "Each file with the SHA-256 of its content. The store keeps the files.".to_owned(),
        rows,
        figures: Vec::new(),
    }
}

fn conditions(record: &CycleRecord, times: ClockKind) -> Section {
    let film = |number: &&Check| number.name == name::WATCHED_TIME_NAME;
    let inspections = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let films = inspections.map(|finding| {
        let seconds = finding
            .checks
            .iter()
            .find(film)
            .map_or(NOT_MEASURED_TEXT.to_owned(), |number| row(number, Kind::Inspect, times).value);
        let pass = format!("film watched after pass {}", finding.pass);
        Row::new(if finding.pass == 0 { "film watched first" } else { &pass }, seconds, "")
    });
    let stated = |detail: &str| {
        let value = record.findings.iter().find_map(|finding| finding.details.get(detail));
        value.map_or(BLANK.to_owned(), |value| format!("{} (from the recipe)", format_detail(value)))
    };
    let mut rows = vec![
        Row::new("water: kind, conductivity, temperature", stated(name::WATER), ""),
        Row::new("lamp: kind, brightness at the panel", stated(name::LAMP), ""),
    ];
    rows.extend(films);
    Section {
        heading: "Water, lamp and films".to_owned(),
        text: "Water and lamp are not measured by the cell: the inspector fills in these values, or signs the \
               values that the recipe states (ASTM F22). The signature is on the first page."
            .to_owned(),
        rows,
        figures: Vec::new(),
    }
}

/// Text that explains how the list counts the grids beside the planned ones.
const OVERLAPPED_GRIDS_TEXT: &str = "The disc also overlaps the grids beside them, by up to 0.8 of its radius: they \
                                     are listed as \"beside\", with the fraction under the disc, as far as the robot \
                                     reported its poses. These passes are not counted for max_passes_per_grid.";

/// Lists the grids beside the planned ones that the disc overlapped, each with its number of passes and the fraction
/// under the disc in each pass.
fn overlapped_grids(findings: &[Finding]) -> Vec<Row> {
    let mut passes: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for finding in findings.iter().filter(|finding| finding.kind == Kind::Abrade) {
        for check in &finding.checks {
            let (Some(grid), Some(share)) = (name::overlapped_grid(&check.name), check.value) else { continue };
            let percent = 100.0 * share;
            // A fraction above zero must not be printed as zero.
            let share = if percent < 1.0 { "less than 1 %".to_owned() } else { format!("{percent:.0} %") };
            passes.entry(grid).or_default().push(format!("pass {}: {share}", finding.pass));
        }
    }
    let row = |(grid, passes): (&str, Vec<String>)| {
        let times = if passes.len() == 1 { "once".to_owned() } else { format!("{} times", passes.len()) };
        Row::new(&format!("{grid}, beside"), format!("overlapped {times}: {}", passes.join("; ")), "")
    };
    passes.into_iter().map(row).collect()
}

/// Lists each grid with the passes that sanded it completely or in part, or may have sanded it.
fn abrasion_list(record: &CycleRecord) -> Section {
    let all = panelprep_cell::record::abraded_grids(&record.findings, &record.motions);
    let mut passes: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for AbradedGrid { grid, pass, how } in &all {
        let how = match how {
            AbrasionExtent::Whole => "",
            AbrasionExtent::InPart => " in part",
            AbrasionExtent::Touched => ": touched, extent unknown",
            AbrasionExtent::PossiblyTouched => ": possibly touched, not confirmed",
        };
        let grid = grid.clone().unwrap_or_else(|| "any grid (it was not recorded which grids)".to_owned());
        passes.entry(grid).or_default().push(format!("pass {pass}{how}"));
    }
    let left = record.motions.iter().filter(|one| one.motion.path == Path::Contact && !one.is_end_reported());
    let worn_mm2: f64 = left.filter_map(|one| one.contact.as_ref()).map(|contact| contact.path.wears_mm2).sum();
    let is_unsure =
        all.iter().any(|one| matches!(one.how, AbrasionExtent::Touched | AbrasionExtent::PossiblyTouched));
    let mut text = match (passes.is_empty(), is_unsure) {
        (true, _) => "Nothing: the tool touched no grid.".to_owned(),
        (false, false) => {
            format!("Each grid that was planned to be sanded, with its passes. {OVERLAPPED_GRIDS_TEXT}")
        }
        (false, true) => {
            "Each grid with the passes that touched it or may have touched it, because the robot did not report how \
                          far it moved. A grid that may have been touched is counted as sanded for \
                          max_passes_per_grid, also in later cycles of this panel, until a cycle ends with pass or \
                          fail, or ends because no further sanding pass is permitted. "
                .to_owned()
                + OVERLAPPED_GRIDS_TEXT
        }
    };
    if worn_mm2 > 0.0 {
        text += &format!(" The wear of the disc includes the whole interrupted path, {worn_mm2:.0} mm².");
    }
    Section {
        heading: "What was abraded".to_owned(),
        text,
        rows: passes
            .iter()
            .map(|(grid, passes)| Row::new(grid, passes.join("; "), ""))
            .chain(overlapped_grids(&record.findings))
            .collect(),
        figures: Vec::new(),
    }
}

/// Lists the requests of people and programs to the cell before and during the cycle: time, request, result and author.
fn request_list(record: &CycleRecord) -> Vec<Section> {
    let section = |heading: &str, text: &str, asked: &[RequestRecord]| Section {
        heading: heading.to_owned(),
        text: if asked.is_empty() { "Nothing.".to_owned() } else { text.to_owned() },
        rows: asked.iter().map(request).collect(),
        figures: Vec::new(),
    };
    let before = section(
        "Requests before this cycle",
        "Each request between the previous cycle and this cycle.",
        &record.asked_before,
    );
    let during = section(
        "Requests in this cycle",
        "Each request with its time, its result, and who sent it.",
        &record.asked,
    );
    [before, during].into_iter().filter(|section| !section.rows.is_empty()).collect()
}

fn request(asked: &RequestRecord) -> Row {
    let reasons: Vec<&str> = asked.reasons.iter().map(|reason| reason.message.as_str()).collect();
    let because = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join("; ")) };
    let (what, meant) = describe_request(&asked.wanted);
    let came = match asked.answer {
        Some(Answer::Done) => format!("{what}: done{meant}{because}"),
        Some(Answer::Refused) => format!("REFUSED: {what}. Nothing was done{because}"),
        Some(Answer::Failed) => format!("FAILED: {what}. The cell could not execute the request{because}"),
        None => format!("{what}: its result was not recorded"),
    };
    let who = asked.who.as_ref().map_or("not recorded".to_owned(), ToString::to_string);
    Row::new(&utc_text(asked.unix_ms.div_euclid(1_000)), format!("{came}. Requested by: {who}"), "")
}

/// Returns the name of a request, and the text that follows it if the request was executed.
fn describe_request(wanted: &RequestedAction) -> (String, String) {
    let plain = |what: &str, meant: &str| (what.to_owned(), meant.to_owned());
    match wanted {
        RequestedAction::NewDisc => plain("new-disc", ", a new disc was mounted and its wear is counted from zero"),
        RequestedAction::Start { recipe } => (format!("start by {recipe}"), String::new()),
        RequestedAction::Proofs { stage, programs_sum, by, result, .. } => {
            let done = match result {
                ProofsResult::Wrong => "a row failed",
                ProofsResult::Proven => "each row passed",
                ProofsResult::Signed => "the page was signed",
            };
            (
                format!("acceptance tests of stage {stage}"),
                format!(", {done} by {by}, programs with the checksum {programs_sum}"),
            )
        }
        RequestedAction::For(request) => match request {
            Request::Reset => plain("reset", ""),
            Request::Start { max_passes, max_moves, dries } => {
                let reference = if *dries { ", and a new dry picture after each sanding pass" } else { "" };
                let limits =
                    format!("at most {max_passes} sanding passes and {max_moves} moves for corner pictures");
                ("start".to_owned(), format!(", with {limits}{reference}"))
            }
            Request::AirRun { max_moves } => {
                ("air-run".to_owned(), format!(", with at most {max_moves} moves for corner pictures"))
            }
            Request::Hold => plain("hold", ""),
            Request::Unhold { dried: false } => plain("unhold", ", the cycle continued"),
            Request::Unhold { dried: true } => plain(
                "unhold --dried",
                ", a person confirmed that the panel was \
                                                                        dried",
            ),
            Request::Accept => plain("accept", ", the result that waited for review was accepted"),
            Request::Stop => plain("stop", ""),
            Request::Abort => plain("abort", ""),
            Request::Clear => {
                plain("clear", ", a person confirmed that the cause is removed and the pad is off the panel")
            }
        },
    }
}

/// Lists every motion with its end.
fn motions(record: &CycleRecord) -> Section {
    let rows = record.motions.iter().map(|motion| {
        let path = match motion.motion.path {
            Path::Park => "to the park pose".to_owned(),
            Path::Corner { view } => format!("to corner pose {}", view + 1),
            Path::Approach => "to the approach".to_owned(),
            Path::Contact => "contact".to_owned(),
            Path::Air => "the path in the air".to_owned(),
            Path::Retract => "retract from the panel".to_owned(),
        };
        let plan = match motion.motion.plan {
            0 => String::new(),
            _ => format!(", plan {}", motion.motion.plan_keyword()),
        };
        Row::new(&format!("{path}, epoch {}{plan}", motion.motion.epoch), end(motion), "")
    });
    Section {
        heading: "Motions".to_owned(),
        text: "Each motion with its end, if the robot reported it. A path over the panel begins at the end of the \
               approach, which is the first waypoint of its plan. Therefore it has one waypoint less than the \
               plan."
            .to_owned(),
        rows: rows.collect(),
        figures: Vec::new(),
    }
}

fn end(motion: &MotionRecord) -> String {
    let all = motion.motion.waypoints;
    let is_counted = matches!(motion.motion.path, Path::Contact | Path::Air);
    match (motion.outcome.filter(|_| motion.is_end_reported()), motion.executed_bounds()) {
        (Some(outcome), _) if is_counted => {
            format!("{}, {} of {all} waypoints", outcome.keyword(), motion.done)
        }
        (Some(outcome), _) => outcome.keyword().to_owned(),
        (None, Some(Bounds { at_most: 0, .. })) => {
            "the end of the motion was not reported; no part of the motion was released for sending".to_owned()
        }
        (None, Some(Bounds { at_least, at_most })) => {
            format!(
                "the end of the motion is unknown: at least {at_least} and at most {at_most} of {all} waypoints \
                 were executed"
            )
        }
        (None, None) => "the end of the motion is unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests;
