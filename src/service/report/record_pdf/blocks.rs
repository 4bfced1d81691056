//! The tables of the page and of its annex.

use super::grids::film_name;
use super::numbers::row;
use super::sources::{Equipment, RecordSources};
use crate::report::cycle::event_sections;
use crate::report::page::Section;
use panelprep_base::verdict::Verdict;
use panelprep_cell::record::{CycleRecord, Disposition, Finding, Kind, finding_dispositions, name};

/// A table under a heading.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Its heading.
    pub heading: String,
    /// The headings of the table's columns, each with its share of the width.
    pub columns: Vec<(&'static str, f32)>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

const TABLE: [(&str, f32); 4] = [("check", 0.42), ("measured", 0.2), ("limit", 0.18), ("limit set by", 0.2)];

/// Lists every film, including invalid films.
pub(super) fn film_list(record: &CycleRecord) -> Block {
    let films = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let attempt = |film: &Finding| {
        let failed = film.names("failed");
        let watched = film.checks.iter().find(|check| check.name == name::WATCHED_TIME_NAME);
        let reasons: Vec<&str> = film.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        vec![
            film_name(film.pass),
            film.judgement.verdict.keyword().to_owned(),
            watched.map_or(String::new(), |check| row(check, "")[1].clone()),
            if failed.is_empty() { "none".to_owned() } else { shorten_for_page(&failed.join(", "), 45) },
            shorten_for_page(&reasons.join("; "), 75),
        ]
    };
    Block {
        heading: "All observed films".to_owned(),
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

/// Lists the values by which a reader judges the treatment; if there are several values of one kind, the last one.
pub(super) fn numbers(record: &CycleRecord) -> Block {
    // In the record, a check's name may only be understandable after the name of the check before it; here each name
    // is complete.
    let wanted = [
        (Kind::Inspect, name::SMALLEST_BREAK, name::SMALLEST_BREAK),
        (Kind::Locate, name::RESIDUAL, name::RESIDUAL),
        (Kind::Plan, name::COVERAGE, "coverage, worst grid"),
        (Kind::Abrade, name::REMOVED_BOUND, "removed depth over all passes, deepest place, 95 %"),
        (Kind::Abrade, name::REMOVED_MEAN, "removed depth on the treated grids, mean"),
        (Kind::Plan, name::REMOVED_EVEN, "planned removal, deviation from the target"),
        (Kind::Plan, name::DWELL_RATIO, "ratio of longest to shortest dwell time"),
        (Kind::Plan, name::WORN_BY_A_GRID, name::WORN_BY_A_GRID),
        (Kind::Abrade, name::PATH_DEVIATION_NAME, "largest distance of a reported pose from the path"),
        (Kind::Reach, name::PROFILE_FROM_DRAWING, name::PROFILE_FROM_DRAWING),
        (Kind::Reach, name::PROFILE, name::PROFILE),
        (Kind::Reach, name::PROFILE_UNCERTAINTY, name::PROFILE_UNCERTAINTY),
        (Kind::Reach, name::FLATNESS, name::FLATNESS),
        (Kind::Reach, name::FLATNESS_UNCERTAINTY, name::FLATNESS_UNCERTAINTY),
    ];
    let last = |(kind, name, label): (Kind, &str, &str)| {
        let findings = record.findings.iter().rev().filter(|finding| finding.kind == kind);
        let mut checks =
            findings.filter_map(|finding| Some((finding, finding.checks.iter().find(|it| it.name == name)?)));
        let (finding, check) = checks.next()?;
        let of = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
        let mut row = row(check, "");
        row[0] = format!("{label} ({}{of})", kind_text(kind));
        Some(row)
    };
    Block {
        heading: "Measured values with their limits".to_owned(),
        columns: TABLE.to_vec(),
        rows: wanted.into_iter().filter_map(last).collect(),
    }
}

fn kind_text(kind: Kind) -> &'static str {
    match kind {
        Kind::Locate => "localization",
        Kind::Refine => "corner",
        Kind::Reach => "reach",
        Kind::Inspect => "film",
        Kind::Plan => "path",
        Kind::Verify => "corner before contact",
        Kind::Abrade => "abrasion",
        Kind::Gate => "checks before a motion",
        Kind::Robot => "robot",
        Kind::SelfTest => "self-test",
        Kind::Tool => "compliant tool",
    }
}

pub(super) fn equipment_table(all: &[Equipment]) -> Block {
    let line = |one: &Equipment| {
        let verified = one.verified.as_ref();
        vec![
            one.what.clone(),
            one.serial.clone().unwrap_or_else(|| "not named".to_owned()),
            one.calibrated.clone().unwrap_or_else(|| "not dated".to_owned()),
            verified.map_or("not verified".to_owned(), |last| format!("{}, {}", last.day, last.error)),
            short_hash(&one.hash),
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

/// Lists the results on which a person had to decide, and who decided.
pub(super) fn deviations(record: &CycleRecord) -> Block {
    let all = record.findings.iter().zip(finding_dispositions(&record.findings, &record.asked));
    let reviews = all.filter(|(finding, _)| finding.judgement.verdict == Verdict::Review);
    let review = |(finding, disposition): (&Finding, Disposition<'_>)| {
        let reasons: Vec<&str> = finding.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        let pass = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
        let decision = disposition.describe().unwrap_or_else(|| "no person decided".to_owned());
        [
            vec![format!("review: {}{pass}", kind_text(finding.kind)), shorten_for_page(&reasons.join("; "), 100)],
            vec!["decision".to_owned(), decision],
        ]
    };
    Block {
        heading: "Deviations, and who accepted them".to_owned(),
        columns: vec![("what", 0.22), ("reasons or decision", 0.78)],
        rows: reviews.flat_map(review).collect(),
    }
}

pub(super) fn signatures(sources: &RecordSources<'_>) -> Block {
    let mut rows: Vec<Vec<String>> = sources
        .signatures
        .iter()
        .map(|one| vec![one.name.clone(), one.time.clone(), one.meaning.clone(), one.chain_position.clone()])
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

/// Returns the line to sign by hand; `None` for a cycle that examined no part, which has nothing to release, or if a
/// signature already decides.
pub(super) fn signature_line(sources: &RecordSources<'_>) -> Option<Vec<String>> {
    let is_open = sources.record.has_examined_part() && !sources.signatures.iter().any(|one| one.is_deciding);
    let line = "……………………………".to_owned();
    is_open.then(|| vec![line.clone(), line.clone(), "released / not released".to_owned(), line])
}

/// Lists what was abraded, and every request to the cell with its author and result: holds, a new disc, decisions. The
/// sections are those of the cycle's page.
pub(super) fn events(record: &CycleRecord) -> Vec<Block> {
    let block = |section: Section| {
        let text = vec![String::new(), section.text];
        let rows = section.rows.into_iter().map(|row| vec![row.name, row.value]);
        Block {
            heading: section.heading,
            columns: vec![("what", 0.22), ("words", 0.78)],
            rows: std::iter::once(text).chain(rows).collect(),
        }
    };
    event_sections(record).into_iter().map(block).collect()
}

/// Lists every reason in full, because the page has no space for long ones.
pub(super) fn reasons(record: &CycleRecord) -> Option<Block> {
    let row = |what: String, verdict: Verdict, message: &str| {
        vec![what, verdict.keyword().to_owned(), message.to_owned()]
    };
    let of_cycle = record.judgement.iter().flat_map(|judgement| {
        judgement.reasons.iter().map(|reason| row("the cycle".to_owned(), judgement.verdict, &reason.message))
    });
    let of_findings = record.findings.iter().flat_map(|finding| {
        let what = format!("{}, pass {}", kind_text(finding.kind), finding.pass);
        let judgement = &finding.judgement;
        judgement.reasons.iter().map(move |reason| row(what.clone(), judgement.verdict, &reason.message))
    });
    let rows: Vec<Vec<String>> = of_cycle.chain(of_findings).collect();
    let columns = vec![("finding", 0.22), ("verdict", 0.1), ("reason", 0.68)];
    (!rows.is_empty()).then(|| Block { heading: "All reasons".to_owned(), columns, rows })
}

pub(super) fn check_table(finding: &Finding) -> Block {
    let pass = if finding.pass == 0 { String::new() } else { format!(", pass {}", finding.pass) };
    Block {
        heading: format!("All numbers: {}{pass}, {}", kind_text(finding.kind), finding.judgement.verdict.keyword()),
        columns: TABLE.to_vec(),
        rows: finding.checks.iter().map(|check| row(check, "")).collect(),
    }
}

/// Shortens a text to what fits on the page; the annex has the full text.
pub(super) fn shorten_for_page(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}… (see the annex)", &text[..end]),
        None => text.to_owned(),
    }
}

/// Returns the first digits of a hash: enough to compare by eye; the signed record has all digits.
pub(super) fn short_hash(hash: &str) -> String {
    hash.get(..16).map_or(hash.to_owned(), |digits| format!("{digits}…"))
}
