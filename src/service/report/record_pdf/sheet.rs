//! The sheet: the content of the signed page in tables of text, from the stored data of a cycle, and its HTML.
//!
//! The HTML is the first part of a cycle's page; the browser prints it on one sheet of A4.

use super::tables::{
    Block, EarlierCycle, GridMap, GridState, RecordSources, check_table, deviation_list, equipment_table,
    event_list, failed_rows, film_list, format_uncertainty, map, reason_list, short_hash, shorten_for_page,
    signature_line, signatures, value_list,
};
use maud::{Markup, PreEscaped, html as markup};
use panelprep_base::number_text::{fixed_decimals, utc_text};
use panelprep_base::verdict::Verdict;
use panelprep_cell::recipe;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{Check, Clock, CycleRecord, Kind, name};
use panelprep_store::signing::StatedValues;
use panelprep_vision::inspect::picture_interval_s;

/// The page.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordSheet {
    /// Its title.
    pub title: String,
    /// The verdict with which the cycle ended.
    pub verdict: Verdict,
    /// The consequence of the verdict in one sentence.
    pub disposition: String,
    /// Pairs of name and value above the map, two pairs in each line.
    pub facts: Vec<(String, String)>,
    /// The map of the panel, or the reason why there is none.
    pub map: Result<GridMap, String>,
    /// Tables of the page.
    pub blocks: Vec<Block>,
    /// Tables of the annex.
    pub annex: Vec<Block>,
}

/// Number of rows on the page that are reserved for each table; the annex contains all rows.
const GUARANTEED_ROWS: usize = 5;
const UNNAMED_TEXT: &str = "not stated at the start";

/// Indices of the tables that receive the rows that other tables do not use, in this order: values, equipment, failed
/// grids. A row of these tables is one line.
const ROW_PRIORITY: [usize; 3] = [2, 3, 0];

/// Returns the number of rows of each table on the page. All tables together have at most as many rows as if each had
/// [`GUARANTEED_ROWS`].
fn page_row_counts(rows: [usize; 6]) -> [usize; 6] {
    let mut shown = rows.map(|count| count.min(GUARANTEED_ROWS));
    let mut free = shown.iter().map(|count| GUARANTEED_ROWS - count).sum::<usize>();
    for table in ROW_PRIORITY {
        let more = (rows[table] - shown[table]).min(free);
        shown[table] += more;
        free -= more;
    }
    shown
}

impl RecordSheet {
    /// Creates the sheet of a cycle.
    pub fn from_sources(sources: &RecordSources<'_>) -> Self {
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
        let all = [
            failed,
            film_list(record),
            value_list(record),
            equipment_table(sources.equipment),
            deviation_list(record),
            signatures(sources),
        ];
        let most_rows = page_row_counts(all.each_ref().map(|block| block.rows.len()));
        let (mut annex, mut blocks) = (Vec::new(), Vec::new());
        for (block, max_rows) in all.into_iter().zip(most_rows).filter(|(block, _)| !block.rows.is_empty()) {
            let mut shown = block.clone();
            if block.rows.len() > max_rows {
                shown.rows.truncate(max_rows);
                shown.heading = format!(
                    "{}: the first {max_rows} of {}; all are in the annex",
                    block.heading,
                    block.rows.len()
                );
                annex.push(block);
            }
            blocks.push(shown);
        }
        // The line for the person who must decide follows the rows of all people who have signed.
        if let (Some(line), Some(block)) = (signature_line(sources), blocks.last_mut()) {
            block.rows.push(line);
        }
        annex.extend(event_list(record));
        annex.extend(reason_list(record));
        annex.extend(record.findings.iter().filter(|finding| !finding.checks.is_empty()).map(check_table));
        RecordSheet {
            title: format!("Water-break test, panel {}, cycle {}", record.panel, record.id),
            verdict: record.judgement.as_ref().map_or(Verdict::Invalid, |judgement| judgement.verdict),
            disposition: disposition_text(record),
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

fn disposition_text(record: &CycleRecord) -> String {
    if record.is_air_run() {
        return "AIR-RUN: the path was run above the panel; nothing was tested and nothing is released".to_owned();
    }
    if record.is_on_foam() {
        return "ON FOAM: an acceptance test of the cell with foam instead of a panel; nothing is released"
            .to_owned();
    }
    let Some(judgement) = &record.judgement else {
        return "NOT ENDED: this is not the final result of the cycle".to_owned();
    };
    if record.has_no_part() {
        return "NO PART: nothing, or an object that is not recognised as the taught panel, was in the cell; the part with \
                this serial number was not examined. If it was in the cell, an inspector must examine it"
            .to_owned();
    }
    let words = match judgement.verdict {
        Verdict::Pass => "the film held on every tested grid",
        Verdict::Fail => "the film broke, and no further sanding pass was permitted",
        Verdict::Invalid => "the test gives no result; repeat it",
        Verdict::Review => "a person must decide",
        Verdict::Reject => "the panel was not treated further",
        Verdict::Aborted => "the cycle ended without a result",
        Verdict::Accept => "accepted",
    };
    let reasons: Vec<&str> = judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
    let why = if reasons.is_empty() {
        String::new()
    } else {
        format!(": {}", shorten_for_page(&reasons.join("; "), 260))
    };
    format!("{}, {words}{why}", judgement.verdict.keyword().to_uppercase())
}

fn facts(sources: &RecordSources<'_>) -> Vec<(String, String)> {
    let RecordSources { record, part, recipe, .. } = *sources;
    let named = |name: Option<&String>| name.cloned().unwrap_or_else(|| UNNAMED_TEXT.to_owned());
    let by_recipe = |detail: &str| {
        let value = record.findings.iter().find_map(|finding| finding.details.get(detail));
        value.and_then(|value| value.as_str()).map(|text| format!("{text} (from the recipe)"))
    };
    // If several people stated a value, the last statement is used.
    let by_person = |value: fn(&StatedValues) -> Option<&String>| {
        let mut last_first = sources.signatures.iter().rev();
        last_first.find_map(|one| {
            let text = stated_text(value(&one.values)?);
            Some(format!("{text} (stated by {})", one.name))
        })
    };
    let stated = |values: [Option<String>; 2], blank: &str| {
        let known: Vec<String> = values.into_iter().flatten().collect();
        if known.is_empty() { format!("……………… ({blank})") } else { known.join("; ") }
    };
    let unstated = "not measured, not stated in the recipe";
    let process = recipe.map(Recipe::process);
    let procedure = process.and_then(|process| process.procedure());
    let passes = process.map(|process| {
        format!(
            "at most {} sanding passes per grid, {} passes per part",
            process.max_passes_per_grid(),
            process.effective_passes_per_part()
        )
    });
    let fact = |name: &str, value: String| (name.to_owned(), value);
    vec![
        fact("part, serial number", named(part.and_then(|part| part.serial.as_ref()))),
        fact("work order", named(part.and_then(|part| part.order.as_ref()))),
        fact("operator", named(part.and_then(|part| part.operator.as_ref()))),
        fact("earlier passes on this part", earlier_removal_text(sources.earlier)),
        fact("panel, taught version", format!("{}, {}", record.panel, record.taught_version)),
        fact(
            "recipe, SHA-256",
            format!("{}, {}", short_hash(&record.recipe_hash), sources.recipe_approval.unwrap_or(NO_APPROVAL)),
        ),
        fact(
            "procedure",
            procedure.unwrap_or_else(|| "ASTM F22; its edition is not stated in the recipe".to_owned()),
        ),
        fact("program", format!("panelprep {}", record.program_version)),
        fact("time", observation_time(record)),
        fact("acceptance", criterion(record, process)),
        fact("abrasion", passes.unwrap_or_else(|| "not known: the recipe is missing".to_owned())),
        fact("error at the tool, 95 %", budget(record)),
        fact("water", stated([by_recipe(name::WATER), by_person(|one| one.water.as_ref())], unstated)),
        fact("lamp", stated([by_recipe(name::LAMP), by_person(|one| one.lamp.as_ref())], unstated)),
        fact(
            "ambient temperature, humidity",
            stated([None, by_person(|one| one.ambient.as_ref())], "not measured by the cell"),
        ),
        fact(
            "abrasive: product, grit, lot",
            stated([None, by_person(|one| one.abrasive.as_ref())], "not known to the cell"),
        ),
    ]
}

/// Maximum length on the page of a value that a person stated, characters; the signed file of the signature contains
/// the whole value.
const MAX_STATED_CHARACTERS: usize = 90;

/// Returns the printed form of a value that a person stated.
fn stated_text(text: &str) -> String {
    match text.char_indices().nth(MAX_STATED_CHARACTERS) {
        Some((end, _)) => format!("{}… (see the signed file)", &text[..end]),
        None => text.to_owned(),
    }
}

/// Text that is printed if the store contains no approval of the recipe's text.
const NO_APPROVAL: &str = "no approval in the store";

fn earlier_removal_text(earlier: Option<&[EarlierCycle]>) -> String {
    let Some(earlier) = earlier else { return "unknown: no serial number was stated".to_owned() };
    let cycles: Vec<String> = earlier.iter().map(|one| format!("cycle {}: {}", one.cycle, one.passes)).collect();
    match cycles.is_empty() {
        true => "none".to_owned(),
        false => {
            format!(
                "{} ({})",
                earlier.iter().map(|one| one.passes).sum::<usize>(),
                shorten_for_page(&cycles.join(", "), 60)
            )
        }
    }
}

fn observation_time(record: &CycleRecord) -> String {
    let began = utc_text(record.started_unix_s);
    let took =
        record.ended_unix_s.map_or("not ended".to_owned(), |end| format!("{} s", end - record.started_unix_s));
    let simulated = if matches!(record.clocks[0], Some(Clock::Simulated { .. })) { "; SIMULATED CELL" } else { "" };
    format!("{began}, {took}{simulated}")
}

/// Describes the criterion by which a grid fails, as it was applied to the films. The time is the observation window in
/// the recipe or the cell's file. The limit of the check is shorter by the interval between two pictures, because the
/// window begins and ends between two pictures.
fn criterion(record: &CycleRecord, process: Option<&recipe::Process>) -> String {
    let films = record.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
    let checks: Vec<&Check> = films.flat_map(|film| &film.checks).collect();
    let area = checks
        .iter()
        .find(|check| name::broken_film_grid(&check.name).is_some())
        .and_then(|check| check.limit.value());
    let watched =
        checks.iter().find(|check| check.name == name::WATCHED_TIME_NAME).and_then(|check| check.limit.value());
    let window = |watched: f64| match process {
        Some(process) => watched + picture_interval_s(process.frames_per_second()),
        None => watched,
    };
    match (area, watched.map(window)) {
        (Some(mm2), Some(s)) => {
            format!(
                "no grid with {} mm² of broken film or more within {} s",
                fixed_decimals(mm2, 1),
                fixed_decimals(s, 1)
            )
        }
        _ => "no film was evaluated".to_owned(),
    }
}

fn budget(record: &CycleRecord) -> String {
    let budget = record.budget.unwrap_or_default();
    let part = |name: &str, mm: Option<f64>| match mm {
        Some(mm) => format!("{name} {}", format_uncertainty(mm, "mm")),
        None => format!("{name} not measured"),
    };
    let total = match (budget.total_mm(), budget.stated_mm) {
        (Some(total), _) => format_uncertainty(total, "mm"),
        (None, Some(stated)) => format!("{}, stated in the cell's file", format_uncertainty(stated, "mm")),
        (None, None) => "total unknown".to_owned(),
    };
    let parts = [
        part("hand-eye", budget.hand_eye_mm),
        part("localization", budget.locate_mm),
        part("fit", budget.fit_mm),
        part("robot", budget.robot_mm),
    ];
    format!("{total} ({})", parts.join(", "))
}

/// The sheet's own style, in addition to the style of the page around the sheet.
const STYLE_SHEET: &str = "@page{size:A4;margin:12mm}.sheet{font-size:12px;line-height:1.35}.sheet h1{font-size:20px}.sheet h2{\
font-size:13px;margin:.7em 0 .1em}.sheet table{width:100%;margin:0}.sheet th,.sheet td{padding:.05rem .5rem .05rem 0;\
vertical-align:top;overflow-wrap:anywhere;white-space:normal}.sheet .facts{display:grid;grid-template-columns:1fr 1fr;gap:0 1.5rem}\
.sheet .facts div{border-bottom:1px solid #ddd;display:flex;gap:.6rem}.sheet .facts b{flex:0 0 38%;font-weight:normal;color:#555}\
.sheet .map table{width:auto}.sheet .map{display:flex;gap:1rem;align-items:flex-start;margin-top:.6em}@media print{.sheet{font-size:7.6pt;break-after:page}}";
/// Maximum side of a cell of the map, px; the cells of a region with many grids are smaller.
const MAX_CELL_SIDE_PX: usize = 34;
const MAX_MAP_SIDE_PX: usize = 380;

/// Returns the sheet as HTML, without the annex.
pub fn html(sheet: &RecordSheet) -> String {
    let page = markup! {
        style { (PreEscaped(STYLE_SHEET)) }
        section.sheet {
            h1 { (sheet.title) }
            p.verdict { b { (sheet.disposition) } }
            div.facts {
                @for (name, value) in &sheet.facts { div { b { (name) } span { (value) } } }
            }
            @match &sheet.map {
                Ok(map) => div.map { (draw_grid_map(map)) (draw_legend(map)) },
                Err(why) => p { "No map of the panel: " (why) "." },
            }
            @for block in &sheet.blocks { (table(block)) }
        }
    };
    page.into_string()
}

fn table(block: &Block) -> Markup {
    markup! {
        h2 { (block.heading) }
        table {
            thead { tr { @for (name, _) in &block.columns { th { (name) } } } }
            tbody { @for row in &block.rows { tr { @for cell in row { td { (cell) } } } } }
        }
    }
}

/// Draws the map: each grid with its letter and hatch, so that the map is readable without colour and on a poor copy.
fn draw_grid_map(map: &GridMap) -> Markup {
    let most = map.columns.max(map.rows.len()).max(1);
    let side = MAX_CELL_SIDE_PX.min(MAX_MAP_SIDE_PX / most).max(4);
    let (width, height) = (map.columns * side, map.rows.len() * side);
    let cells = map.rows.iter().enumerate().flat_map(|(row, states)| {
        states.iter().enumerate().map(move |(column, state)| (column * side, row * side, *state))
    });
    markup! {
        svg width=(width + 2) height=(height + 2) viewBox=(format!("-1 -1 {} {}", width + 2, height + 2)) role="img"
            aria-label="map of the panel: the state of each grid" {
            @for (x, y, state) in cells { (cell([x, y], side, state)) }
        }
    }
}

// In an SVG, each element needs its own closing tag; otherwise it would contain all following elements.
fn cell([x, y]: [usize; 2], side: usize, state: GridState) -> Markup {
    let [red, green, blue] = state.state_color();
    let [down, up] = state.hatch_directions();
    let fill = format!("rgb({red},{green},{blue})");
    markup! {
        rect x=(x) y=(y) width=(side) height=(side) fill=(fill) stroke="#333" {}
        @if down { line x1=(x) y1=(y) x2=(x + side) y2=(y + side) stroke="#333" stroke-width="0.7" {} }
        @if up { line x1=(x) y1=(y + side) x2=(x + side) y2=(y) stroke="#333" stroke-width="0.7" {} }
        @if side >= 12 {
            text x=(x + side / 2) y=(y + side / 2 + 4) text-anchor="middle" font-size=(side.min(14)) font-weight="bold" {
                (state.state_letter())
            }
        }
    }
}

fn draw_legend(map: &GridMap) -> Markup {
    let count = |state: GridState| map.rows.iter().flatten().filter(|one| **one == state).count();
    markup! {
        table { tbody {
            @for state in GridState::ALL {
                tr {
                    td { svg width="20" height="20" viewBox="-1 -1 20 20" { (cell([0, 0], 18, state)) } }
                    td { (state.describe()) }
                    td { (count(state)) }
                }
            }
        } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected counts of the first case, by hand: the film table leaves 3 rows free, and the signatures leave 4. The
    /// values use 4 of these 7 rows. The equipment uses the other 3, although it needs 4 more.
    #[test]
    fn free_rows_go_to_numbers_and_equipment_first() {
        assert_eq!(page_row_counts([9, 2, 9, 9, 5, 1]), [5, 2, 9, 8, 5, 1]);
        assert_eq!(page_row_counts([24, 1, 3, 7, 0, 1]), [18, 1, 3, 7, 0, 1]);
        assert_eq!(page_row_counts([9; 6]), [5; 6]);
    }

    #[test]
    fn each_grid_of_the_map_is_a_closed_svg_element() {
        let rows = vec![vec![GridState::Passed, GridState::Failed], vec![GridState::PassedAfterAbrasion; 2]];
        let svg = draw_grid_map(&GridMap { rows, columns: 2 }).into_string();
        assert_eq!((svg.matches("<rect").count(), svg.matches("></rect>").count()), (4, 4), "{svg}");
        assert_eq!(svg.matches("<line").count(), svg.matches("></line>").count(), "{svg}");
    }
}
