//! What stands on the page, in tables of text, from what is kept of a cycle.

use super::grids::{GridMap, failed_rows, film_name, map};
use super::numbers::{row, uncertainty};
use crate::cycle::Request;
use crate::recipe::Recipe;
use crate::record::{Answer, Check, Clock, CycleRecord, Finding, Kind, PartNames, Wanted, name};
use crate::verdict::Verdict;
use crate::words::{fixed, utc};

/// What the page is made from.
#[derive(Debug, Clone, Copy)]
pub struct Sources<'s> {
    /// The cycle.
    pub record: &'s CycleRecord,
    /// Its part; `None` where none was named.
    pub part: Option<&'s PartNames>,
    /// Its recipe; `None` where what was kept of it is missing.
    pub recipe: Option<&'s Recipe>,
    /// What measured.
    pub equipment: &'s [Equipment],
    /// Earlier cycles that abraded the same part; `None` where no serial number was named.
    pub earlier: Option<&'s [EarlierCycle]>,
    /// Who signed, in order.
    pub signatures: &'s [Signatory],
}

/// A camera, a tool or a mount with its calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equipment {
    /// What it is, such as "scanner, lens".
    pub what: String,
    /// Its serial number; `None` where its calibration names none.
    pub serial: Option<String>,
    /// The day of its calibration.
    pub calibrated: Option<String>,
    /// SHA-256 of the calibration file.
    pub hash: String,
    /// The last verification before the cycle; `None` where there is none.
    pub verified: Option<LastVerification>,
}

/// A verification against a known target, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LastVerification {
    /// The day.
    pub day: String,
    /// The error found and what was allowed.
    pub error: String,
}

/// An earlier cycle that abraded the same part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EarlierCycle {
    /// Its number.
    pub cycle: i64,
    /// When it began, s since 1970.
    pub started_unix_s: i64,
    /// Its passes.
    pub passes: usize,
}

/// A signature, as it is printed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signatory {
    /// The printed name.
    pub name: String,
    /// The time.
    pub time: String,
    /// What it means.
    pub meaning: String,
    /// Its number on the chain of signed records, and the record's hash.
    pub bound: String,
    /// A person who says whether the part is released.
    pub decides: bool,
}

/// A table under a heading.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Its heading.
    pub heading: String,
    /// The heads of its columns, each with its share of the width.
    pub columns: Vec<(&'static str, f32)>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

/// The page.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Its title.
    pub title: String,
    /// How the cycle ended.
    pub verdict: Verdict,
    /// The same in a sentence.
    pub disposition: String,
    /// Names and values before the map, two to a line.
    pub facts: Vec<(String, String)>,
    /// The map of the panel; else why there is none.
    pub map: Result<GridMap, String>,
    /// Tables of the page.
    pub blocks: Vec<Block>,
    /// Tables of the annex.
    pub annex: Vec<Block>,
}

/// Rows of a table on the page; the annex has all.
const MOST_ROWS: usize = 5;
const NOT_NAMED: &str = "not named at the start";
const TABLE: [(&str, f32); 4] = [("what", 0.42), ("found", 0.2), ("allowed", 0.18), ("allowed by", 0.2)];

impl Sheet {
    /// The page of a cycle.
    pub fn of(sources: &Sources<'_>) -> Self {
        let record = sources.record;
        let failed = Block {
            heading: "Grids on which the film broke".to_owned(),
            columns: vec![
                ("grid", 0.1),
                ("film", 0.15),
                ("time to break", 0.14),
                ("broken area", 0.14),
                ("passes", 0.09),
                ("area, last film", 0.14),
                ("result", 0.24),
            ],
            rows: failed_rows(record),
        };
        let mut annex = Vec::new();
        let mut blocks = Vec::new();
        let mut put = |block: Block| {
            let (rest, heading) = (block.rows.len().saturating_sub(MOST_ROWS), block.heading.clone());
            if block.rows.is_empty() {
                return;
            }
            let mut shown = block.clone();
            if rest > 0 {
                shown.rows.truncate(MOST_ROWS);
                shown.heading =
                    format!("{heading}: the first {MOST_ROWS} of {}, all in the annex", block.rows.len());
                annex.push(block);
            }
            blocks.push(shown);
        };
        put(failed);
        put(attempts(record));
        put(numbers(record));
        put(equipment(sources.equipment));
        put(deviations(record));
        put(signatures(sources));
        // Beside those who signed, in whatever number, there is a line for whoever decides.
        if let (Some(line), Some(block)) = (line_to_sign(sources), blocks.last_mut()) {
            block.rows.push(line);
        }
        annex.extend(reasons(record));
        annex.extend(record.findings.iter().filter(|finding| !finding.checks.is_empty()).map(all_checks));
        Sheet {
            title: format!("Water-break test, panel {}, cycle {}", record.panel, record.id),
            verdict: record.judgement.as_ref().map_or(Verdict::Invalid, |judgement| judgement.verdict),
            disposition: disposition(record),
            facts: facts(sources),
            map: match sources.recipe {
                Some(recipe) if !record.is_air_run() => {
                    Ok(map(record, recipe.region().rows(), recipe.region().columns()))
                }
                Some(_) => Err("an air-run tests no grid".to_owned()),
                None => Err("the recipe that the cycle used is missing or damaged in the store".to_owned()),
            },
            blocks,
            annex,
        }
    }
}

fn disposition(record: &CycleRecord) -> String {
    if record.is_air_run() {
        return "AIR-RUN: the path was run above the panel; nothing was tested and nothing is released".to_owned();
    }
    let Some(judgement) = &record.judgement else {
        return "NOT OVER: this is not the result of the cycle".to_owned();
    };
    let words = match judgement.verdict {
        Verdict::Pass => "the film held on every tested grid",
        Verdict::Fail => "the film broke, and no further abrasion was allowed",
        Verdict::Invalid => "the test says nothing; repeat it",
        Verdict::Review => "a person has to decide",
        Verdict::Reject => "the panel was not treated further",
        Verdict::Aborted => "the cycle was ended before its result",
        Verdict::Accept => "accepted",
    };
    let reasons: Vec<&str> = judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
    let why = if reasons.is_empty() { String::new() } else { format!(": {}", shortened(&reasons.join("; "), 260)) };
    format!("{}, {words}{why}", judgement.verdict.word().to_uppercase())
}

/// No more than fits; the annex has the rest.
fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}… (see the annex)", &text[..end]),
        None => text.to_owned(),
    }
}

fn facts(sources: &Sources<'_>) -> Vec<(String, String)> {
    let Sources { record, part, recipe, .. } = *sources;
    let named = |name: Option<&String>| name.cloned().unwrap_or_else(|| NOT_NAMED.to_owned());
    let stated = |detail: &str| {
        let value = record.findings.iter().find_map(|finding| finding.details.get(detail));
        let value = value.and_then(|value| value.as_str()).map(|text| format!("{text} (stated by the recipe)"));
        value.unwrap_or_else(|| "……………… (not measured, not stated by the recipe)".to_owned())
    };
    let process = recipe.map(Recipe::process);
    let procedure = process.and_then(|process| process.procedure());
    let passes = process.map(|process| {
        format!(
            "at most {} abrasions of a grid, {} passes of a part",
            process.max_passes_per_grid(),
            process.passes_of_a_part()
        )
    });
    let fact = |name: &str, value: String| (name.to_owned(), value);
    vec![
        fact("part, serial number", named(part.and_then(|part| part.serial.as_ref()))),
        fact("work order", named(part.and_then(|part| part.order.as_ref()))),
        fact("operator", named(part.and_then(|part| part.operator.as_ref()))),
        fact("earlier passes on this part", earlier(sources.earlier)),
        fact("panel, taught version", format!("{}, {}", record.panel, record.taught_version)),
        fact("recipe, SHA-256", short(&record.recipe_hash)),
        fact(
            "procedure",
            procedure.unwrap_or_else(|| "ASTM F22; its edition is not stated by the recipe".to_owned()),
        ),
        fact("program", format!("panelprep {}", record.program_version)),
        fact("time", time(record)),
        fact("acceptance", criterion(record)),
        fact("abrasion", passes.unwrap_or_else(|| "not known: the recipe is missing".to_owned())),
        fact("error at the tool, 95 %", budget(record)),
        fact("water", stated(name::WATER)),
        fact("lamp", stated(name::LAMP)),
        fact("ambient temperature, humidity", "……………… (not measured by the cell)".to_owned()),
    ]
}

fn earlier(earlier: Option<&[EarlierCycle]>) -> String {
    let Some(earlier) = earlier else { return "not known: no serial number was named".to_owned() };
    let cycles: Vec<String> = earlier.iter().map(|one| format!("cycle {}: {}", one.cycle, one.passes)).collect();
    match cycles.is_empty() {
        true => "none".to_owned(),
        false => {
            format!(
                "{} ({})",
                earlier.iter().map(|one| one.passes).sum::<usize>(),
                shortened(&cycles.join(", "), 60)
            )
        }
    }
}

/// The first digits of a hash: enough to compare by eye, and the signed record has all.
fn short(hash: &str) -> String {
    hash.get(..16).map_or(hash.to_owned(), |digits| format!("{digits}…"))
}

fn time(record: &CycleRecord) -> String {
    let began = utc(record.started_unix_s);
    let took =
        record.ended_unix_s.map_or("not over".to_owned(), |end| format!("{} s", end - record.started_unix_s));
    let simulated = if matches!(record.clocks[0], Some(Clock::Simulated { .. })) { "; SIMULATED CELL" } else { "" };
    format!("{began}, {took}{simulated}")
}

/// What a grid fails by, as the films were held against it.
fn criterion(record: &CycleRecord) -> String {
    let films = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let checks: Vec<&Check> = films.flat_map(|film| &film.checks).collect();
    let area = checks
        .iter()
        .find(|check| name::grid_of_broken_film(&check.name).is_some())
        .and_then(|check| check.limit.bound());
    let watched = checks.iter().find(|check| check.name == name::WATCHED).and_then(|check| check.limit.bound());
    match (area, watched) {
        (Some(mm2), Some(s)) => {
            format!("no grid with {} mm² of broken film or more within {} s", fixed(mm2, 1), fixed(s, 1))
        }
        _ => "no film was judged".to_owned(),
    }
}

fn budget(record: &CycleRecord) -> String {
    let budget = record.budget.unwrap_or_default();
    let part = |name: &str, mm: Option<f64>| match mm {
        Some(mm) => format!("{name} {}", uncertainty(mm, "mm")),
        None => format!("{name} not measured"),
    };
    let total = match (budget.total_mm(), budget.stated_mm) {
        (Some(total), _) => uncertainty(total, "mm"),
        (None, Some(stated)) => format!("{} stated by the cell's file", uncertainty(stated, "mm")),
        (None, None) => "total not known".to_owned(),
    };
    let parts = [
        part("hand-eye", budget.hand_eye_mm),
        part("localization", budget.locate_mm),
        part("fit", budget.fit_mm),
        part("robot", budget.robot_mm),
    ];
    format!("{total} ({})", parts.join(", "))
}

/// Every film, invalid ones too.
fn attempts(record: &CycleRecord) -> Block {
    let films = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let attempt = |film: &Finding| {
        let failed = film.names("failed");
        let watched = film.checks.iter().find(|check| check.name == name::WATCHED);
        let reasons: Vec<&str> = film.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        vec![
            film_name(film.pass),
            film.judgement.verdict.word().to_owned(),
            watched.map_or(String::new(), |check| row(check, "")[1].clone()),
            if failed.is_empty() { "none".to_owned() } else { shortened(&failed.join(", "), 45) },
            shortened(&reasons.join("; "), 75),
        ]
    };
    Block {
        heading: "Every film that was watched".to_owned(),
        columns: vec![
            ("film", 0.12),
            ("verdict", 0.09),
            ("watched", 0.09),
            ("grids that failed", 0.26),
            ("reasons", 0.44),
        ],
        rows: films.map(attempt).collect(),
    }
}

/// The numbers by which a reader judges the treatment; of a kind the last one.
fn numbers(record: &CycleRecord) -> Block {
    // In the record a check's name may lean on the one before it; here each stands by itself.
    let wanted = [
        (Kind::Inspect, name::SMALLEST_BREAK, name::SMALLEST_BREAK),
        (Kind::Locate, name::RESIDUAL, name::RESIDUAL),
        (Kind::Plan, name::COVERAGE, "coverage, worst grid"),
        (Kind::Plan, name::DWELL_RATIO, "longest to shortest dwell"),
        (Kind::Plan, name::WORN_BY_A_GRID, name::WORN_BY_A_GRID),
        (Kind::Abrade, name::OFF_PATH, "reported position off the planned path, largest"),
    ];
    let last = |(kind, name, label): (Kind, &str, &str)| {
        let findings = record.findings.iter().rev().filter(|finding| finding.kind == kind);
        let mut checks =
            findings.filter_map(|finding| Some((finding, finding.checks.iter().find(|it| it.name == name)?)));
        let (finding, check) = checks.next()?;
        let of = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
        let mut row = row(check, "");
        row[0] = format!("{label} ({}{of})", kind_word(kind));
        Some(row)
    };
    Block {
        heading: "Numbers with their limits".to_owned(),
        columns: TABLE.to_vec(),
        rows: wanted.into_iter().filter_map(last).collect(),
    }
}

fn kind_word(kind: Kind) -> &'static str {
    match kind {
        Kind::Locate => "localization",
        Kind::Refine => "corner",
        Kind::Reach => "reach",
        Kind::Inspect => "film",
        Kind::Plan => "path",
        Kind::Verify => "corner before contact",
        Kind::Abrade => "abrasion",
        Kind::Gate => "gate before a motion",
        Kind::Robot => "robot",
        Kind::SelfTest => "self-test",
    }
}

fn equipment(all: &[Equipment]) -> Block {
    let line = |one: &Equipment| {
        let verified = one.verified.as_ref();
        vec![
            one.what.clone(),
            one.serial.clone().unwrap_or_else(|| "not named".to_owned()),
            one.calibrated.clone().unwrap_or_else(|| "not dated".to_owned()),
            verified.map_or("not verified".to_owned(), |last| format!("{}, {}", last.day, last.error)),
            short(&one.hash),
        ]
    };
    Block {
        heading: "Equipment".to_owned(),
        columns: vec![
            ("what", 0.24),
            ("serial number", 0.16),
            ("calibrated", 0.14),
            ("last verification", 0.28),
            ("SHA-256", 0.18),
        ],
        rows: all.iter().map(line).collect(),
    }
}

/// What was for a person to decide, and who decided.
fn deviations(record: &CycleRecord) -> Block {
    let reviews = record.findings.iter().filter(|finding| finding.judgement.verdict == Verdict::Review);
    let review = |finding: &Finding| {
        let reasons: Vec<&str> = finding.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        let pass = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
        vec![format!("review: {}{pass}", kind_word(finding.kind)), shortened(&reasons.join("; "), 100)]
    };
    let accepts = record
        .asked
        .iter()
        .filter(|asked| matches!(asked.wanted, Wanted::For(Request::Accept)) && asked.answer == Some(Answer::Done));
    let accepted = accepts.map(|asked| {
        let who = asked.who.as_ref().map_or("not recorded".to_owned(), ToString::to_string);
        vec!["accepted".to_owned(), format!("{}, by {who}", utc(asked.unix_ms.div_euclid(1_000)))]
    });
    Block {
        heading: "Deviations, and who accepted them".to_owned(),
        columns: vec![("what", 0.22), ("words", 0.78)],
        rows: reviews.map(review).chain(accepted).collect(),
    }
}

fn signatures(sources: &Sources<'_>) -> Block {
    let mut rows: Vec<Vec<String>> = sources
        .signatures
        .iter()
        .map(|one| vec![one.name.clone(), one.time.clone(), one.meaning.clone(), one.bound.clone()])
        .collect();
    if sources.signatures.is_empty() {
        rows.push(vec!["the cell".to_owned(), String::new(), "not signed yet".to_owned(), String::new()]);
    }
    Block {
        heading: "Signatures".to_owned(),
        columns: vec![("name", 0.24), ("time", 0.22), ("meaning", 0.24), ("record", 0.3)],
        rows,
    }
}

/// The line to sign by hand. Of an air-run there is nothing to release.
fn line_to_sign(sources: &Sources<'_>) -> Option<Vec<String>> {
    let is_open = !sources.record.is_air_run() && !sources.signatures.iter().any(|one| one.decides);
    let line = "……………………………".to_owned();
    is_open.then(|| vec![line.clone(), line.clone(), "released / not released".to_owned(), line])
}

/// Every reason in full: the page has no room for long ones.
fn reasons(record: &CycleRecord) -> Option<Block> {
    let row =
        |what: String, verdict: Verdict, message: &str| vec![what, verdict.word().to_owned(), message.to_owned()];
    let of_cycle = record.judgement.iter().flat_map(|judgement| {
        judgement.reasons.iter().map(|reason| row("the cycle".to_owned(), judgement.verdict, &reason.message))
    });
    let of_findings = record.findings.iter().flat_map(|finding| {
        let what = format!("{}, pass {}", kind_word(finding.kind), finding.pass);
        let judgement = &finding.judgement;
        judgement.reasons.iter().map(move |reason| row(what.clone(), judgement.verdict, &reason.message))
    });
    let rows: Vec<Vec<String>> = of_cycle.chain(of_findings).collect();
    let columns = vec![("of", 0.22), ("verdict", 0.1), ("reason", 0.68)];
    (!rows.is_empty()).then(|| Block { heading: "Every reason".to_owned(), columns, rows })
}

fn all_checks(finding: &Finding) -> Block {
    let pass = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
    Block {
        heading: format!("All numbers: {}{pass}, {}", kind_word(finding.kind), finding.judgement.verdict.word()),
        columns: TABLE.to_vec(),
        rows: finding.checks.iter().map(|check| row(check, "")).collect(),
    }
}
