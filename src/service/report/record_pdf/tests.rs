//! Tests that the page shows the content of the record, and that it fits on one sheet.

use super::pdf::{FontFaces, PageElement, pages};
use super::*;
use crate::report::page::Figure;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::Request;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{
    Answer, Budget, Check, CycleId, CycleRecord, Finding, Kind, LimitSource, PartNames, RequestAuthor,
    RequestRecord, RequestSource, RequestedAction, name,
};
use panelprep_store::signing::StatedValues;

const RECIPE: &str = "panel = \"wing\"\n[process]\nmax_passes_per_part = 3\nprocedure = \"ASTM F22-21, PS 4711 rev. C\"\n\
    [locate]\nbox_min_mm = [300, -400, 100]\nbox_max_mm = [700, 400, 800]\n\
    [region]\ncorners_px = [[700, 350], [1250, 350], [1250, 850], [700, 850]]\nrows = 2\ncolumns = 3\n\
    [inspect]\nmin_break_mm2 = 30\n[path]\ndisc_diameter_mm = 16\nstep_over_mm = 8\n";

fn recipe() -> Recipe {
    Recipe::check("recipe.toml", RECIPE).unwrap_or_else(|problems| panic!("{problems}"))
}

fn judged(verdict: Verdict, words: &str) -> Judgement {
    let reasons = if words.is_empty() { vec![] } else { vec![Reason::new("why", words.to_owned())] };
    Judgement { verdict, reasons }
}

/// Returns the finding of a film of 2 by 3 grids; for each grid the broken area, mm², or `None` if the grid was not
/// visible.
fn film(pass: u8, verdict: Verdict, areas_mm2: [Option<f64>; 6]) -> Finding {
    let names = ["r1c1", "r1c2", "r1c3", "r2c1", "r2c2", "r2c3"];
    let mut finding = Finding::new(Kind::Inspect, pass, judged(verdict, "")).with_checks([Check::new(
        name::WATCHED_TIME_NAME,
        "s",
        61.27,
    )
    .with_min(59.8, LimitSource::Program)]);
    let mut failed = Vec::new();
    for (name, area_mm2) in names.into_iter().zip(areas_mm2) {
        finding.checks.push(
            Check::new(format!("broken film in {name}"), "mm²", area_mm2).with_limit(
                panelprep_cell::record::Limit::Below(30.0),
                LimitSource::recipe("inspect.min_break_mm2"),
            ),
        );
        if area_mm2.is_some_and(|mm2| mm2 >= 30.0) {
            failed.push(name);
            finding.checks.push(Check::new(format!("{name} failed after"), "s", 5.32));
        }
    }
    finding.with_detail("failed", failed)
}

fn record(findings: Vec<Finding>) -> CycleRecord {
    let who = RequestAuthor {
        uid: Some(1_000),
        user: Some("ada".to_owned()),
        ..RequestAuthor::from_source(RequestSource::Socket)
    };
    CycleRecord {
        id: CycleId(7),
        started_unix_s: 1_700_000_000,
        ended_unix_s: Some(1_700_000_090),
        panel: "wing <2>".to_owned(),
        taught_version: "0123456789abcdef".to_owned(),
        recipe_hash: "cafe".repeat(16),
        files: vec![],
        program_version: "0.1.0".to_owned(),
        judgement: Some(judged(Verdict::Pass, "")),
        budget: Some(Budget { hand_eye_mm: Some(0.304), locate_mm: Some(0.1234), ..Budget::default() }),
        findings,
        motions: vec![],
        asked_before: vec![],
        asked: vec![RequestRecord {
            unix_ms: 1_700_000_030_999,
            wanted: RequestedAction::For(Request::Accept),
            who: Some(who),
            answer: Some(Answer::Done),
            reasons: vec![],
            findings: Some(9),
        }],
        clocks: [None, None],
        recording: None,
        events: 321,
    }
}

/// Returns two films. The first film broke on two grids. One of them was sanded and did not break again, the other
/// broke again; a third grid was not visible.
fn films() -> Vec<Finding> {
    vec![
        film(0, Verdict::Fail, [Some(0.0), Some(203.4), Some(45.0), Some(0.0), Some(1.25), Some(0.0)]),
        Finding::new(Kind::Abrade, 1, judged(Verdict::Review, "the robot executed 9 of 10 waypoints"))
            .with_detail("grids", vec!["r1c2", "r1c3"]),
        film(1, Verdict::Invalid, [None; 6]),
        film(1, Verdict::Fail, [Some(0.0), Some(0.0), Some(31.5), Some(0.0), Some(1.25), None]),
    ]
}

fn sheet(record: &CycleRecord, signatures: &[PrintedSignature]) -> RecordSheet {
    let part = PartNames { serial: Some("SN 17".to_owned()), order: None, operator: Some("Ada".to_owned()) };
    let earlier = [EarlierCycle { cycle: 3, started_unix_s: 0, passes: 2 }];
    let verified = LastVerification { day: "2026-05-30".to_owned(), error: "0.24 mm (limit 0.8 mm)".to_owned() };
    let equipment = [Equipment {
        what: "scanner, lens".to_owned(),
        serial: Some("2214".to_owned()),
        calibrated: Some("2026-05-01".to_owned()),
        hash: "beef".repeat(16),
        verified: Some(verified),
    }];
    let recipe = recipe();
    RecordSheet::from_sources(&RecordSources {
        record,
        part: Some(&part),
        recipe: Some(&recipe),
        recipe_approval: Some("approved by eva, 2026-05-29"),
        equipment: &equipment,
        earlier: Some(&earlier),
        signatures,
    })
}

fn rows<'s>(sheet: &'s RecordSheet, heading: &str) -> &'s [Vec<String>] {
    let block = sheet.blocks.iter().chain(&sheet.annex).find(|block| block.heading.starts_with(heading));
    &block.unwrap_or_else(|| panic!("no {heading}")).rows
}

/// Expected results, determined by hand from `films`; the invalid film gives no result for any grid.
#[test]
fn the_map_shows_the_result_of_each_grid() {
    use GridState::{Failed, NotTested, Passed, PassedAfterAbrasion};
    let sheet = sheet(&record(films()), &[]);
    let map = sheet.map.as_ref().expect("a map");
    assert_eq!(map.rows, [[Passed, PassedAfterAbrasion, Failed], [Passed, Passed, NotTested]]);
    let failed = rows(&sheet, "Grids on which");
    assert_eq!(failed[0], ["r1c2", "first", "5.3 s", "203 mm²", "1", "0.0 mm²", "failed, sanded, then passed"]);
    assert_eq!(failed[1][5..], ["32 mm²", "failed"]);
    let films = rows(&sheet, "All observed films");
    assert_eq!(films.len(), 3, "the invalid one too");
    assert_eq!(films[1][..3], ["after pass 1", "invalid", "61.3 s"]);
}

#[test]
fn the_page_names_part_criteria_deviations_and_who_accepted_them() {
    let sheet = sheet(&record(films()), &[]);
    let fact = |name: &str| sheet.facts.iter().find(|(found, _)| found == name).map(|(_, value)| value.as_str());
    assert_eq!(fact("part, serial number"), Some("SN 17"));
    assert_eq!(fact("work order"), Some("not stated at the start"));
    assert_eq!(fact("procedure"), Some("ASTM F22-21, PS 4711 rev. C"));
    assert!(fact("recipe, SHA-256").is_some_and(|text| text.ends_with(", approved by eva, 2026-05-29")));
    assert_eq!(fact("earlier passes on this part"), Some("2 (cycle 3: 2)"));
    assert_eq!(fact("abrasion"), Some("at most 2 sanding passes per grid, 3 passes per part"));
    assert_eq!(fact("acceptance"), Some("no grid with 30.0 mm² of broken film or more within 60.0 s"));
    // An uncertainty has two digits; a value that was not measured has no number.
    let budget = "total unknown (hand-eye 0.30 mm, localization 0.12 mm, fit not measured, robot not measured)";
    assert_eq!(fact("error at the tool, 95 %"), Some(budget));
    assert!(fact("water").is_some_and(|water| water.contains("not measured, not stated")));
    let deviations = rows(&sheet, "Deviations");
    assert_eq!(deviations[0], ["review: abrasion, pass 1", "the robot executed 9 of 10 waypoints"]);
    assert!(deviations[1][1].starts_with("accepted 2023-11-14 22:13:50 UTC, by ada (user 1000)"), "{deviations:?}");
    // A person who accepted an earlier finding has not accepted this one.
    let mut earlier = record(films());
    earlier.asked[0].findings = Some(0);
    let sheet = self::sheet(&earlier, &[]);
    assert_eq!(rows(&sheet, "Deviations")[1], ["decision", "no person decided"]);
}

/// A missing value is printed as "not measured" beside its limit. A value beyond its limit is printed so that it
/// differs from the limit, and a small value so that it differs from zero.
#[test]
fn numbers_and_limits_have_one_format() {
    let locate = |value: Option<f64>| {
        let check = Check::new("residual, point to plane, rms", "mm", value);
        let check = check.with_max(0.25, LimitSource::recipe("locate.max_rms_mm"));
        let mut findings = films();
        findings.push(Finding::new(Kind::Locate, 0, judged(Verdict::Accept, "")).with_checks([check]));
        rows(&sheet(&record(findings), &[]), "Measured values")[0].clone()
    };
    let what = "residual, point to plane, rms (localization)";
    assert_eq!(locate(Some(0.0912)), [what, "0.09 mm", "≤ 0.25 mm", "recipe, locate.max_rms_mm"]);
    assert_eq!(
        locate(Some(0.2504)),
        [what, "0.2504 mm, outside of the limit", "≤ 0.25 mm", "recipe, locate.max_rms_mm"]
    );
    assert_eq!(locate(None), [what, "not measured", "≤ 0.25 mm", "recipe, locate.max_rms_mm"]);
    assert_eq!(locate(Some(0.0031))[1..3], ["0.003 mm", "≤ 0.250 mm"]);
    assert_eq!(locate(Some(0.0))[1..3], ["0.00 mm", "≤ 0.25 mm"]);
    let share = Check::new("coverage", "", 1.0).with_min(0.99, LimitSource::Program);
    assert_eq!(super::tables::row(&share, "")[1..], ["1.00", "≥ 0.99", "program"]);
}

#[test]
fn the_line_to_sign_remains_until_a_person_has_decided() {
    let signed = |decides| PrintedSignature {
        name: "Grace Hopper (grace)".to_owned(),
        time: "2026-05-31 09:00:00 UTC".to_owned(),
        meaning: "reviewed".to_owned(),
        chain_position: "number 2".to_owned(),
        is_deciding: decides,
        values: StatedValues::default(),
    };
    let lines = |signatures: &[PrintedSignature]| {
        let sheet = sheet(&record(films()), signatures);
        rows(&sheet, "Signatures").iter().filter(|row| row[2] == "released / not released").count()
    };
    assert_eq!((lines(&[]), lines(&[signed(false)]), lines(&[signed(false), signed(true)])), (1, 1, 0));
    // The statement of a person about the water is printed on the page; a value that no person stated remains blank.
    let water = StatedValues { water: Some("deionised, 21 °C".to_owned()), ..StatedValues::default() };
    let sheet = sheet(&record(films()), &[PrintedSignature { values: water, ..signed(true) }]);
    let fact = |name: &str| sheet.facts.iter().find(|(found, _)| found == name).map(|(_, value)| value.clone());
    assert!(fact("water").is_some_and(|text| text.contains("deionised, 21 °C (stated by Grace Hopper (grace))")));
    assert!(fact("abrasive: product, grit, lot").is_some_and(|text| text.starts_with('…')));
}

/// In the HTML, the text is escaped, and every state is shown by a letter and by lines, not only by colour.
#[test]
fn the_map_is_readable_without_colour() {
    let html = html(&sheet(&record(films()), &[]));
    assert!(html.contains("wing &lt;2&gt;") && !html.contains("wing <2>"));
    for letter in [">P<", ">A<", ">F<", ">–<"] {
        assert!(html.contains(letter), "{letter}");
    }
    // Expected number of lines, by hand: the map has one A with one line and one F with two lines, and so has the
    // legend.
    assert_eq!(html.matches("<line").count(), 6);
}

/// A cycle with more content than the page can show: long reasons, many failed grids, many reviews and signatures.
#[test]
fn the_page_fits_on_one_sheet_and_the_rest_is_the_annex() {
    let long = "the outline of the panel lies elsewhere than it was found by the scan ".repeat(9);
    let mut findings = Vec::new();
    for pass in 0..9_u8 {
        let mut film = film(pass, Verdict::Fail, [Some(99.0); 6]);
        film.judgement = judged(Verdict::Fail, &long);
        findings.push(film);
        findings.push(Finding::new(Kind::Verify, pass, judged(Verdict::Review, &long)));
    }
    let who = PrintedSignature {
        name: "Maria Magdalena von Sonnenberg-Hohenstein (mmvsonnenberg)".to_owned(),
        time: "2026-05-31 09:00:00 UTC".to_owned(),
        meaning: "deviation accepted".to_owned(),
        chain_position: "number 2, SHA-256 0123456789abcdef…, key 0123456789abcdef…".to_owned(),
        is_deciding: false,
        values: StatedValues::default(),
    };
    let full = CycleRecord { judgement: Some(judged(Verdict::Fail, &long)), ..record(findings) };
    let sheet = sheet(&full, &vec![who; 5]);
    let faces = FontFaces::new().expect("the fonts");
    let (laid, first) = pages(&sheet, &[], &faces);
    assert_eq!(first, 1, "one page to sign");
    assert!(
        laid.len() > 1
            && rows(&sheet, "All observed films").len() == 5
            && sheet
                .annex
                .iter()
                .any(|block| block.heading.starts_with("All observed films") && block.rows.len() == 9),
        "and an annex"
    );
    for mark in laid.iter().flatten() {
        if let PageElement::Text { at: [x, y], text, .. } = mark {
            assert!((30.0..565.0).contains(x) && (30.0..830.0).contains(y), "off the page: {text}");
        }
    }
}

#[test]
fn the_pdf_is_pdf_a_3_and_equal_for_the_same_record() {
    let mut record = record(films());
    record.panel = "翼 \u{1F6E9} Flügel\tleft".to_owned();
    let mut jpeg = Vec::new();
    jpeg_encoder::Encoder::new(&mut jpeg, 90)
        .encode(&[120; 8 * 8 * 3], 8, 8, jpeg_encoder::ColorType::Rgb)
        .expect("a JPEG");
    let figures = [Figure { caption: "film".to_owned(), jpeg }];
    let attached = [AttachedFile {
        name: "cycle-7.json".to_owned(),
        description: "The signed record".to_owned(),
        mime_type: "application/json",
        bytes: b"{}".to_vec(),
    }];
    let sheet = sheet(&record, &[]);
    let made = || pdf(&sheet, &figures, &attached, 1_700_000_100).unwrap_or_else(|error| panic!("{error}"));
    let bytes = made();
    let text = String::from_utf8_lossy(&bytes);
    assert!(bytes.starts_with(b"%PDF-1.7"));
    for words in
        ["<pdfaid:part>3</pdfaid:part>", "cycle-7.json", "/AFRelationship/Source", "2023-11-14T22:15:00+00:00"]
    {
        assert!(text.replace(' ', "").contains(&words.replace(' ', "")), "no {words}");
    }
    assert_eq!(bytes, made());
    let broken = [Figure { caption: "film".to_owned(), jpeg: vec![1, 2, 3] }];
    assert!(pdf(&sheet, &broken, &attached, 0).is_err(), "no JPEG");
}

/// Limits are printed as they are stated in the recipe and the program: 0.995 is not printed as 0.99, and a window of
/// 60 s at five pictures per second is not printed as 59.8 s.
#[test]
fn criteria_are_printed_as_they_are_stated() {
    let check = Check::new("coverage", "", 0.9981).with_min(0.995, LimitSource::Program);
    assert_eq!(super::tables::row(&check, "")[1..3], ["0.998", "≥ 0.995"]);
    let fps = recipe().process().frames_per_second();
    let limit_s = 60.0 - 1.001 / fps;
    let mut films = films();
    for check in
        films.iter_mut().flat_map(|film| &mut film.checks).filter(|check| check.name == name::WATCHED_TIME_NAME)
    {
        *check = Check::new(name::WATCHED_TIME_NAME, "s", 61.27).with_min(limit_s, LimitSource::Program);
    }
    let sheet = sheet(&record(films), &[]);
    let criterion = sheet.facts.iter().find(|(name, _)| name == "acceptance").map(|(_, value)| value.as_str());
    assert_eq!(criterion, Some("no grid with 30.0 mm² of broken film or more within 60.0 s"));
}

/// The signed record contains the sanded grids and the requests, as the page does.
#[test]
fn the_annex_contains_the_requests_and_the_sanded_grids() {
    let mut record = record(films());
    record.asked.push(RequestRecord { wanted: RequestedAction::NewDisc, ..record.asked[0].clone() });
    let sheet = sheet(&record, &[]);
    assert!(rows(&sheet, "What was abraded").iter().any(|row| row[0] == "r1c2" && row[1].starts_with("pass 1")));
    // A grid beside the planned ones is listed with its fraction under the disc in each pass.
    let beside = |pass: u8, share: f64| {
        let checks = [Check::new(name::overlapped_share("r1c3"), "", share)];
        Finding::new(Kind::Abrade, pass, judged(Verdict::Accept, "")).with_checks(checks)
    };
    let overlapped = self::sheet(&self::record(vec![beside(1, 0.124), beside(2, 0.004)]), &[]);
    let text = "overlapped 2 times: pass 1: 12 %; pass 2: less than 1 %";
    assert!(rows(&overlapped, "What was abraded").iter().any(|row| row[0] == "r1c3, beside" && row[1] == text));
    let asked = rows(&sheet, "Requests in this cycle");
    assert!(asked.iter().any(|row| row[1].starts_with("new-disc: done") && row[1].contains("ada")), "{asked:?}");
}
