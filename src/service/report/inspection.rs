//! The page of one water-break test for the signature of a quality inspector (ASTM F22).

use super::page::{Figure, Page, Row, Section, check_row};
use panelprep_cell::recipe::Recipe;
use panelprep_vision::inspect::{ComparisonReference, Inspection, name};

/// A blank that a person fills in on the printed page.
const BLANK: &str = "……………………………………";

/// Creates the page of a test: verdict, grids, observation of the film, pictures, and lines for the signature. `clip`
/// names the tested part.
pub fn inspection_page(inspection: &Inspection, recipe: &Recipe, clip: &str, figures: Vec<Figure>) -> Page {
    Page {
        first: String::new(),
        made: String::new(),
        title: format!("Water-break test, panel {}", recipe.panel()),
        subtitle: format!("Clip {clip}"),
        judgement: inspection.judgement.clone(),
        sections: vec![
            inspection_section(inspection, figures),
            grids(inspection),
            film_numbers(inspection),
            signature(inspection, recipe),
        ],
    }
}

fn section(heading: &str, text: String, rows: Vec<Row>) -> Section {
    Section { heading: heading.to_owned(), text, rows, figures: Vec::new() }
}

fn inspection_section(inspection: &Inspection, figures: Vec<Figure>) -> Section {
    let row = |(index, found): (usize, &panelprep_vision::inspect::Break)| {
        let grids: Vec<String> = found.grids.iter().map(ToString::to_string).collect();
        let closed = if found.has_closed_again() { "; the film closed again" } else { "" };
        let value = format!(
            "{:.1} mm², first seen at {:.1} s, in {}{closed}",
            found.area_mm2,
            found.first_seen_s,
            grids.join(", ")
        );
        Row::new(&format!("break {}", index + 1), value, "")
    };
    let rows = inspection.breaks.iter().enumerate().map(row).collect();
    let text = format!(
        "The film broke at {} places. Times are counted from the first fully wet picture; areas are measured on the \
         curved surface.",
        inspection.breaks.len()
    );
    Section { figures, ..section("What broke", text, rows) }
}

fn grids(inspection: &Inspection) -> Section {
    let limit = format!("< {:.1} mm²", inspection.observation.min_break_mm2);
    let row = |(grid, footprint): (
        &panelprep_vision::inspect::GridInspection,
        &panelprep_vision::inspect::GridFootprint,
    )| {
        let word = match (grid.failed, grid.seen) {
            (true, _) => "failed",
            (false, true) => "passed",
            (false, false) if grid.wet_when_dry => "not passed: already wet in the dry picture",
            (false, false) => "not passed: not completely visible",
        };
        let when = grid.time_to_break_s.map(|time_s| format!(" from {time_s:.1} s")).unwrap_or_default();
        let share =
            if grid.seen { String::new() } else { format!(", {:.0} % visible", 100.0 * footprint.seen_share) };
        let by = match grid.reference {
            ComparisonReference::DryAndWet => String::new(),
            reference => format!("; evaluated by its {}", reference.describe()),
        };
        let value =
            format!("{word}; {:.1} of {:.0} mm² broke{when}{share}{by}", grid.broken_mm2, footprint.area_mm2);
        Row::new(&grid.id.to_string(), value, &limit)
    };
    let rows = inspection.grids.iter().zip(inspection.footprint.grids()).map(row).collect();
    section("Grids", "Area of broken film in each grid.".to_owned(), rows)
}

/// Lists the values by which the film as a whole was evaluated; the results of the grids are in another section.
fn film_numbers(inspection: &Inspection) -> Section {
    let of_film = inspection.checks.iter().take_while(|check| check.name != name::UNSEEN_GRIDS);
    let rows = of_film.map(|check| check_row(check, "")).collect();
    let text = "Every measured value with its limit. A test that is not complete has no result.".to_owned();
    section("How the film was observed", text, rows)
}

fn signature(inspection: &Inspection, recipe: &Recipe) -> Section {
    let process = recipe.process();
    let stated =
        |value: Option<String>| value.map_or(BLANK.to_owned(), |value| format!("{value} (from the recipe)"));
    let temperature = process.water_temperature_c().map(|celsius| format!("{celsius} °C"));
    let mut rows = vec![
        Row::new("water: kind, conductivity", stated(process.water()), ""),
        Row::new("water: temperature", stated(temperature), ""),
        Row::new("lamp: kind, brightness at the panel", stated(process.lamp()), ""),
        Row::new("film watched", format!("{:.1} s", inspection.observation.observed_s), ""),
    ];
    rows.extend(["inspector", "date", "signature"].map(|name| Row::new(name, BLANK, "")));
    section(
        "Inspector",
        "With the signature, the inspector confirms that he or she has examined the pictures (ASTM F22)."
            .to_owned(),
        rows,
    )
}
