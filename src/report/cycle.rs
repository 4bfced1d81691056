//! The page of one cycle: what every phase found and was allowed, what was used, and a line to sign.

use super::page::{Figure, Page, Row, Section};
use crate::cell::Date;
use crate::cycle::{Outcome, Path, Request};
use crate::geometry::KukaPose;
use crate::record::{Budget, CycleRecord, Finding, Kind, Limit, Number, name};
use crate::verdict::{Judgement, Reason, Verdict};
use crate::words::{apart, fixed, plain};
use serde_json::Value;
use std::collections::BTreeMap;

/// What a person fills in by hand.
const BLANK: &str = "……………………………………";
const NOT_MEASURED: &str = "not measured";

/// The page of a cycle; `pictures` holds its JPEGs by their hash. One that is missing is said to be.
pub fn cycle_page(record: &CycleRecord, pictures: &BTreeMap<String, Vec<u8>>) -> Page {
    let running = || Judgement {
        verdict: Verdict::Invalid,
        reasons: vec![Reason::new("running", "the cycle is not over: this page is not its result")],
    };
    let findings = record.findings.iter().map(|finding| section(finding, pictures));
    let mut sections: Vec<Section> = findings.collect();
    sections.extend([abraded(record), motions(record), budget(record.budget), asked(record), used(record)]);
    sections.push(signature(record));
    let ended = record.ended_unix_s.map_or("running".to_owned(), utc);
    Page {
        title: format!("Panel {}, cycle {}", record.panel, record.id),
        subtitle: format!("{} to {ended}", utc(record.started_unix_s)),
        judgement: record.judgement.clone().unwrap_or_else(running),
        sections,
    }
}

fn section(finding: &Finding, pictures: &BTreeMap<String, Vec<u8>>) -> Section {
    let heading = match finding.kind {
        Kind::Locate => "Where the panel stands",
        Kind::Refine => "The corner",
        Kind::Reach => "What the arm reaches",
        Kind::Inspect => "The film",
        Kind::Plan => "The sanding path",
        Kind::Verify => "The corner, before contact",
        Kind::Abrade => "The abrasion",
        Kind::Gate => "The gate before a motion",
        Kind::Robot => "The robot",
        Kind::SelfTest => "The self-test",
    };
    let pass = match finding.pass {
        0 => String::new(),
        pass => format!(", pass {pass}"),
    };
    let reasons = finding.judgement.reasons.iter().map(|reason| format!("; {} ({})", reason.message, reason.code));
    let details = finding.details.iter().map(|(name, value)| Row::new(name, words(value), ""));
    let shots = finding.shots.iter().map(|shot| Row::new(&format!("picture {}", shot.name), &shot.hash, ""));
    let figure = |picture: &crate::record::Picture| match pictures.get(&picture.hash) {
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
    Section {
        heading: format!("{heading}{pass}"),
        text: format!("{}{}", finding.judgement.verdict.word(), reasons.collect::<String>()),
        rows: finding.numbers.iter().map(row).chain(details).chain(shots).chain(missing).collect(),
        figures,
    }
}

/// A detail as a person reads it: a pose with its units, a list of names; else as it is kept.
fn words(value: &Value) -> String {
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

fn row(number: &Number) -> Row {
    let with_unit = |text: String| format!("{text} {}", number.unit).trim_end().to_owned();
    let (sign, limit) = match number.limit {
        Limit::Unlimited => ("", None),
        Limit::AtMost(limit) => ("≤ ", Some(limit)),
        Limit::AtLeast(limit) => ("≥ ", Some(limit)),
        Limit::Below(limit) => ("< ", Some(limit)),
    };
    let (mut value, mut allowed) = (number.value.map(shown), limit.map(shown));
    let is_beyond = number.value.is_some_and(|value| !number.limit.allows(value));
    if let (true, Some(found), Some(limit)) = (is_beyond && value == allowed, number.value, limit) {
        let [found, limit] = apart(found, limit, decimals(limit));
        (value, allowed) = (Some(found), Some(limit));
    }
    let value = match value {
        None => NOT_MEASURED.to_owned(),
        Some(value) if is_beyond => format!("{}, not allowed", with_unit(value)),
        Some(value) => with_unit(value),
    };
    Row::new(&number.name, value, allowed.map_or(String::new(), |limit| format!("{sign}{}", with_unit(limit))))
}

/// Four significant digits, or all before the point; the store has the rest.
fn shown(value: f64) -> String {
    if value == 0.0 || !value.is_finite() || value.fract() == 0.0 {
        return plain(value);
    }
    let text = fixed(value, decimals(value)).to_string();
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Digits after the point that make four significant ones.
fn decimals(value: f64) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize
}

/// How often each grid was abraded, whole or in part.
fn abraded(record: &CycleRecord) -> Section {
    let mut passes: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for finding in record.findings.iter().filter(|finding| finding.kind == Kind::Abrade) {
        for (detail, part) in [("grids", ""), ("grids_in_part", " in part")] {
            let grids = finding
                .details
                .get(detail)
                .and_then(|value| serde_json::from_value::<Vec<String>>(value.clone()).ok());
            for grid in grids.unwrap_or_default() {
                passes.entry(grid).or_default().push(format!("pass {}{part}", finding.pass));
            }
        }
    }
    let text = if passes.is_empty() {
        "Nothing: the tool touched no grid."
    } else {
        "Each grid with the passes that touched it."
    };
    Section {
        heading: "What was abraded".to_owned(),
        text: text.to_owned(),
        rows: passes.iter().map(|(grid, passes)| Row::new(grid, passes.join(", "), "")).collect(),
        figures: Vec::new(),
    }
}

/// What people and programs asked of the cell, with the time.
fn asked(record: &CycleRecord) -> Section {
    let rows = record.asked.iter().map(|asked| {
        let words = match asked.request {
            Request::Reset => "reset".to_owned(),
            Request::Start { max_passes, max_moves } => {
                format!("start, with at most {max_passes} abrasions and {max_moves} moves of the corner loop")
            }
            Request::AirRun { max_moves } => {
                format!("an air-run, with at most {max_moves} moves of the corner loop")
            }
            Request::Hold => "hold".to_owned(),
            Request::Unhold { dried: false } => "go on".to_owned(),
            Request::Unhold { dried: true } => "go on: the panel was dried, locate it again".to_owned(),
            Request::Accept => "accept: the result that waited for review was taken as good".to_owned(),
            Request::Stop => "stop".to_owned(),
            Request::Abort => "abort".to_owned(),
            Request::Clear => "clear: the cause of the abort is gone".to_owned(),
        };
        Row::new(&utc(asked.unix_ms.div_euclid(1_000)), words, "")
    });
    Section {
        heading: "What was asked of the cell".to_owned(),
        text: "Each request with its time; one that did not fit was refused.".to_owned(),
        rows: rows.collect(),
        figures: Vec::new(),
    }
}

fn motions(record: &CycleRecord) -> Section {
    let rows = record.motions.iter().map(|motion| {
        let path = match motion.motion.path {
            Path::Park => "to the park pose".to_owned(),
            Path::Corner { view } => format!("to corner pose {}", view + 1),
            Path::Approach => "to the approach".to_owned(),
            Path::Contact => "contact".to_owned(),
            Path::Air => "the path in the air".to_owned(),
            Path::Retract => "clear of the panel".to_owned(),
        };
        let plan = match motion.motion.plan {
            0 => String::new(),
            plan => format!(", plan {plan:016x}"),
        };
        let outcome = motion.outcome.map_or("open", Outcome::word);
        let done = format!("{outcome}, {} of {} waypoints", motion.done, motion.motion.waypoints);
        Row::new(&format!("{path}, epoch {}{plan}", motion.motion.epoch), done, "")
    });
    Section {
        heading: "Motions".to_owned(),
        text: "Each as the robot said that it ended.".to_owned(),
        rows: rows.collect(),
        figures: Vec::new(),
    }
}

fn budget(budget: Option<Budget>) -> Section {
    let budget = budget.unwrap_or_default();
    let total = budget.total_mm();
    let part = |name: &str, value: Option<f64>| {
        Row::new(name, value.map_or(NOT_MEASURED.to_owned(), |value| format!("{} mm", shown(value))), "")
    };
    let mut rows = vec![
        part("hand-eye calibration", budget.hand_eye_mm),
        part("localization", budget.locate_mm),
        part("surface fit", budget.fit_mm),
        part("robot and tool", budget.robot_mm),
        part("total", total),
    ];
    if total.is_none() {
        let stated = budget.stated_mm.map_or("not stated".to_owned(), |value| {
            format!("{} mm, stated by the cell's file, not measured", shown(value))
        });
        rows.push(Row::new("used instead of the total: [limits] tool_error_mm", stated, ""));
    }
    Section {
        heading: "Error at the tool".to_owned(),
        text: "At 95 %. The total is the root of the sum of squares, once every part is measured.".to_owned(),
        rows,
        figures: Vec::new(),
    }
}

fn used(record: &CycleRecord) -> Section {
    let mut rows =
        vec![Row::new("taught version", &record.taught_version, ""), Row::new("recipe", &record.recipe_hash, "")];
    rows.extend(record.files.iter().map(|file| Row::new(&file.name, &file.hash, "")));
    rows.push(Row::new("panelprep", &record.program_version, ""));
    rows.push(Row::new("lines in the journal", record.events.to_string(), ""));
    Section {
        heading: "What was used".to_owned(),
        text: "The files by the SHA-256 of their bytes, which the store keeps.".to_owned(),
        rows,
        figures: Vec::new(),
    }
}

fn signature(record: &CycleRecord) -> Section {
    let film = |number: &&Number| number.name == name::WATCHED;
    let inspections = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let films = inspections.map(|finding| {
        let seconds = finding.numbers.iter().find(film).map_or(NOT_MEASURED.to_owned(), |number| row(number).value);
        let pass = format!("film watched after pass {}", finding.pass);
        Row::new(if finding.pass == 0 { "film watched first" } else { &pass }, seconds, "")
    });
    let stated = |detail: &str| {
        let value = record.findings.iter().find_map(|finding| finding.details.get(detail));
        value.map_or(BLANK.to_owned(), |value| format!("{} (stated by the recipe)", words(value)))
    };
    let mut rows = vec![
        Row::new("water: kind, conductivity, temperature", stated(name::WATER), ""),
        Row::new("lamp: kind, brightness at the panel", stated(name::LAMP), ""),
    ];
    rows.extend(films);
    rows.extend(["inspector", "date", "signature"].map(|name| Row::new(name, BLANK, "")));
    Section {
        heading: "Inspector".to_owned(),
        text: "Water and lamp are not measured by the cell: the inspector fills them in, or signs what the recipe states \
               (ASTM F22)."
            .to_owned(),
        rows,
        figures: Vec::new(),
    }
}

/// Time since 1970 as date and time, UTC.
fn utc(unix_s: i64) -> String {
    let (date, second) = (Date::of_unix_s(unix_s), unix_s.rem_euclid(86_400));
    let (hour, minute) = (second / 3_600, second / 60 % 60);
    format!("{date} {hour:02}:{minute:02}:{:02} UTC", second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::{Motion, Outcome};
    use crate::record::{Asked, CycleId, KeptFile, MotionRecord, Picture};

    fn finding(kind: Kind, pass: u8, numbers: Vec<Number>) -> Finding {
        let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
        Finding::new(kind, pass, judgement).with(numbers)
    }

    fn record() -> CycleRecord {
        let rms = Number::new("residual", "mm", 0.123456).within(Limit::AtMost(0.25));
        let overlap = Number::new("overlap", "", 0.85).within(Limit::AtLeast(0.9));
        let mut located = finding(Kind::Locate, 0, vec![rms, overlap, Number::new("drift", "mm", None)]);
        let pose = KukaPose { x_mm: 1.5, a_deg: -3.0, ..KukaPose::default() };
        located.details.insert("base_from_panel".to_owned(), serde_json::json!(pose));
        located.shots.push(KeptFile { name: "scan".to_owned(), hash: "f00d".to_owned() });
        let picture = |caption: &str, hash: &str| Picture {
            name: "located".to_owned(),
            caption: caption.to_owned(),
            hash: hash.to_owned(),
        };
        located.pictures = vec![picture("outline", "aa"), picture("grids", "bb")];
        let watched = |seconds: f64| vec![Number::new(name::WATCHED, "s", seconds)];
        let part =
            finding(Kind::Abrade, 2, vec![]).detail("grids", vec!["r1c1"]).detail("grids_in_part", vec!["r2c4"]);
        let motion = Motion { epoch: 3, path: Path::Contact, plan: 0xAB, waypoints: 200 };
        CycleRecord {
            id: CycleId(7),
            started_unix_s: 1_700_000_000,
            ended_unix_s: Some(1_700_000_090),
            panel: "wing <2>".to_owned(),
            taught_version: "0123".to_owned(),
            recipe_hash: "cafe".to_owned(),
            files: vec![KeptFile { name: "base_from_camera".to_owned(), hash: "beef".to_owned() }],
            program_version: "0.1.0".to_owned(),
            judgement: Some(Judgement { verdict: Verdict::Pass, reasons: vec![] }),
            budget: Some(Budget { locate_mm: Some(0.15), stated_mm: Some(0.8), ..Budget::default() }),
            findings: vec![
                located,
                finding(Kind::Inspect, 0, watched(60.0)),
                finding(Kind::Abrade, 1, vec![]).detail("grids", vec!["r1c1"]),
                part,
                finding(Kind::Inspect, 1, watched(59.8)),
            ],
            asked: vec![Asked { unix_ms: 1_700_000_030_999, request: Request::Accept }],
            motions: vec![MotionRecord { motion, outcome: Some(Outcome::Done), done: 200 }],
            events: 321,
        }
    }

    #[test]
    fn the_page_shows_every_number_limit_hash_and_a_line_to_sign() {
        let pictures = BTreeMap::from([("aa".to_owned(), vec![1, 2, 3])]);
        let html = cycle_page(&record(), &pictures).html();
        for part in [
            "<h1>Panel wing &lt;2&gt;, cycle 7</h1>",
            "2023-11-14 22:13:20 UTC to 2023-11-14 22:14:50 UTC",
            "class=\"verdict good\"><b>pass</b>",
            "<td>residual</td><td>0.1235 mm</td><td>≤ 0.25 mm</td>",
            "<td>overlap</td><td>0.85, not allowed</td><td>≥ 0.9</td>",
            "<td>drift</td><td>not measured</td>",
            "<td>base_from_panel</td><td>X 1.500 Y 0.000 Z 0.000 mm, A -3.0000 B 0.0000 C 0.0000°</td>",
            "<td>picture scan</td><td>f00d</td>",
            "<td>r1c1</td><td>pass 1, pass 2</td>",
            "<td>r2c4</td><td>pass 2 in part</td>",
            "<td>2023-11-14 22:13:50 UTC</td><td>accept: ",
            "data:image/jpeg;base64,AQID",
            "<td>grids</td><td>the picture bb is missing</td>",
            "<td>contact, epoch 3, plan 00000000000000ab</td><td>done, 200 of 200 waypoints</td>",
            "<td>hand-eye calibration</td><td>not measured</td>",
            "<td>localization</td><td>0.15 mm</td>",
            "<td>total</td><td>not measured</td>",
            "0.8 mm, stated by the cell&#39;s file, not measured",
            "<td>recipe</td><td>cafe</td>",
            "<td>base_from_camera</td><td>beef</td>",
            "<td>film watched first</td><td>60 s</td>",
            "<td>film watched after pass 1</td><td>59.8 s</td>",
            "<td>signature</td><td>…",
        ] {
            let part = part.replace("&#39;", "'");
            assert!(html.contains(&part), "no {part} in\n{html}");
        }
        assert!(!html.contains("http"), "nothing is fetched");
    }

    #[test]
    fn a_number_that_is_not_allowed_differs_from_its_limit() {
        let shown = |value: f64, limit: Limit| {
            let row = row(&Number::new("n", "%", value).within(limit));
            [row.value, row.allowed]
        };
        assert_eq!(shown(8.000_4, Limit::AtMost(8.0)), ["8.0004 %, not allowed", "≤ 8 %"]);
        assert_eq!(shown(0.249_999, Limit::AtLeast(0.25)), ["0.249999 %, not allowed", "≥ 0.25 %"]);
        assert_eq!(shown(8.2, Limit::AtMost(8.0)), ["8.2 %, not allowed", "≤ 8 %"]);
        assert_eq!(shown(-0.0, Limit::AtMost(8.0)), ["0 %", "≤ 8 %"]);
    }

    #[test]
    fn a_whole_budget_needs_no_stated_error_and_a_running_cycle_is_no_result() {
        let part = Some(0.5);
        let whole =
            Budget { hand_eye_mm: part, locate_mm: part, fit_mm: part, robot_mm: part, stated_mm: Some(0.8) };
        let html = cycle_page(
            &CycleRecord { budget: Some(whole), judgement: None, ended_unix_s: None, ..record() },
            &BTreeMap::new(),
        )
        .html();
        // By hand: √(4 · 0.5²) = 1.
        assert!(html.contains("<td>total</td><td>1 mm</td>") && !html.contains("tool_error_mm"));
        assert!(html.contains("class=\"verdict doubt\"") && html.contains("not over"));
    }

    #[test]
    fn numbers_keep_four_digits() {
        let texts = [0.123456, 59.8, 123456.7, 0.00012344, -2.5, 0.0, 100.04, 3.0].map(shown);
        assert_eq!(texts, ["0.1235", "59.8", "123457", "0.0001234", "-2.5", "0", "100", "3"]);
    }

    /// Leap day of a century that is a leap year; the last second before 1970.
    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(utc(951_782_400), "2000-02-29 00:00:00 UTC");
        assert_eq!(utc(-1), "1969-12-31 23:59:59 UTC");
    }
}
