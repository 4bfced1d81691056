//! The events on the panel and the requests to the cell, as far as they are known; the page states if they are not
//! known.

use crate::report::page::{Row, Section};
use panelprep_base::number_text::utc_text;
use panelprep_cell::cycle::{Path, Request};
use panelprep_cell::record::{
    AbradedGrid, AbrasionExtent, Answer, Bounds, CycleRecord, Finding, Kind, MotionRecord, RequestRecord,
    RequestedAction, name,
};
use std::collections::BTreeMap;

/// How the list counts the grids beside the planned ones.
const BESIDE: &str = "The disc also overlaps the grids beside them, by up to 0.8 of its radius: they are listed as beside, with \
                      the share under the disc, as far as the robot reported its poses. These passes do not count for \
                      max_passes_per_grid.";

/// Lists the grids beside the planned ones that the disc overlapped: for each one, in how many passes, and the share
/// under the disc in each.
fn overlapped_grids(findings: &[Finding]) -> Vec<Row> {
    let mut passes: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for finding in findings.iter().filter(|finding| finding.kind == Kind::Abrade) {
        for check in &finding.checks {
            let (Some(grid), Some(share)) = (name::overlapped_grid(&check.name), check.value) else { continue };
            let percent = 100.0 * share;
            // A share above zero must not be printed as zero.
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

/// Lists how often each grid was abraded, completely or in part, or may have been abraded.
pub(super) fn abrasion_list(record: &CycleRecord) -> Section {
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
        (false, false) => format!("Each grid that was planned to be sanded, with its passes. {BESIDE}"),
        (false, true) => {
            "Each grid with the passes that touched it, or may have touched it: the robot did not \
                          report how far it came. What it may have touched counts as abraded for \
                          max_passes_per_grid, in later cycles of this panel too. This ends with a cycle that ends \
                          with pass or fail, or because nothing more is allowed. "
                .to_owned()
                + BESIDE
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

/// The requests of people and programs to the cell: the time, the request, the sender and the result; before the
/// cycle, and in it.
pub(super) fn request_list(record: &CycleRecord) -> Vec<Section> {
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

/// Returns a request in words, and its meaning if it was done.
fn describe_request(wanted: &RequestedAction) -> (String, String) {
    let plain = |what: &str, meant: &str| (what.to_owned(), meant.to_owned());
    match wanted {
        RequestedAction::NewDisc => plain("new-disc", ", a new disc was mounted and its wear counts from 0"),
        RequestedAction::Start { recipe } => (format!("start by {recipe}"), String::new()),
        RequestedAction::Proofs { stage, programs_sum, by, is_signed, .. } => {
            let done = if *is_signed { "the page was signed" } else { "each row was proven" };
            (
                format!("proofs of stage {stage}"),
                format!(", {done} by {by}, programs with the checksum {programs_sum}"),
            )
        }
        RequestedAction::For(request) => match request {
            Request::Reset => plain("reset", ""),
            Request::Start { max_passes, max_moves, dries } => {
                let reference = if *dries { ", and a new dry picture after each abrasion" } else { "" };
                let limits = format!("at most {max_passes} abrasions and {max_moves} moves for corner pictures");
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
            Request::Clear => plain(
                "clear",
                ", a person confirmed that the cause is gone and the pad is off the \
                                              panel",
            ),
        },
    }
}

/// Lists every motion and how it ended.
pub(super) fn motions(record: &CycleRecord) -> Section {
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
