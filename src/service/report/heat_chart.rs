//! Where the film breaks, over many parts: the panel's grids in their arrangement on the panel, each with its number
//! of breaks and the time after which it broke. The shade repeats the number.

use maud::{Markup, html};
use panelprep_base::number_text::fixed_decimals;
use panelprep_store::history::{HeatCell, HeatMap};

/// Number of shades, without the shade of a grid that never broke.
const SHADE_COUNT: f64 = 4.0;

/// Returns the table; `words` explains the content of a cell, for readers who do not see it.
pub fn heat_chart(map: &HeatMap, words: &str) -> Markup {
    let of = |part: fn(&HeatCell) -> u32| map.grids.iter().map(part).max().unwrap_or(0);
    let (rows, columns) = (of(|cell| cell.row), of(|cell| cell.column));
    let cell = |row, column| map.grids.iter().find(move |cell| (cell.row, cell.column) == (row, column));
    html! {
        table.heat {
            caption { (words) }
            thead { tr { td {} @for column in 1..=columns { th scope="col" { "c" (column) } } } }
            tbody { @for row in 1..=rows {
                tr {
                    th scope="row" { "r" (row) }
                    @for column in 1..=columns {
                        @match cell(row, column) {
                            Some(cell) => td class={ "shade-" (shade_index(cell)) } {
                                strong { (cell.breaks) "/" (cell.films) }
                                @if let Some(median_s) = cell.median_s { br; (fixed_decimals(median_s, 1)) " s" }
                            },
                            None => td { "–" },
                        }
                    }
                }
            } }
        }
    }
}

/// Returns 0 for a grid that never broke, otherwise 1 to 4 by the share of films that broke on it.
fn shade_index(cell: &HeatCell) -> u8 {
    if cell.breaks == 0 || cell.films == 0 {
        return 0;
    }
    (cell.breaks as f64 / cell.films as f64 * SHADE_COUNT).ceil().clamp(1.0, SHADE_COUNT) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(grid: &str, at: (u32, u32), breaks: usize, median_s: Option<f64>) -> HeatCell {
        HeatCell { grid: grid.to_owned(), row: at.0, column: at.1, films: 12, breaks, median_s }
    }

    /// Calculated by hand: 1 and 3 of 12 films are at most a quarter, 4 are more than a quarter, 12 are all.
    #[test]
    fn the_shade_states_what_the_number_states() {
        let shades = [0, 1, 3, 4, 12].map(|breaks| shade_index(&cell("r1c1", (1, 1), breaks, None)));
        assert_eq!(shades, [0, 1, 1, 2, 4]);
    }

    #[test]
    fn the_grids_lie_as_on_the_panel() {
        let grids = vec![cell("r1c1", (1, 1), 0, None), cell("r2c2", (2, 2), 3, Some(6.04))];
        let html = heat_chart(&HeatMap { films: 12, grids }, "breaks").into_string();
        assert!(html.contains("<td class=\"shade-1\"><strong>3/12</strong><br>6.0 s</td>"), "{html}");
        assert_eq!(html.matches("<td>–</td>").count(), 2, "grids that no film tells of");
        assert!(html.find("shade-0") < html.find("shade-1") && !html.contains("style="));
    }
}
