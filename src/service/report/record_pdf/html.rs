//! The sheet as HTML, the first of a cycle's pages; the browser prints the sheet on one page of A4.

use super::blocks::Block;
use super::content::RecordSheet;
use super::grids::{GridMap, GridState};
use maud::{Markup, PreEscaped, html as markup};

/// The sheet's own style, in addition to the style of the page around it.
const STYLE_SHEET: &str = "@page{size:A4;margin:12mm}.sheet{font-size:12px;line-height:1.35}.sheet h1{font-size:20px}.sheet h2{\
font-size:13px;margin:.7em 0 .1em}.sheet table{width:100%;margin:0}.sheet th,.sheet td{padding:.05rem .5rem .05rem 0;\
vertical-align:top;overflow-wrap:anywhere;white-space:normal}.sheet .facts{display:grid;grid-template-columns:1fr 1fr;gap:0 1.5rem}\
.sheet .facts div{border-bottom:1px solid #ddd;display:flex;gap:.6rem}.sheet .facts b{flex:0 0 38%;font-weight:normal;color:#555}\
.sheet .map table{width:auto}.sheet .map{display:flex;gap:1rem;align-items:flex-start;margin-top:.6em}@media print{.sheet{font-size:7.6pt;break-after:page}}";
/// The side of a cell of the map, px, if the region has few grids; if there are more, they are drawn smaller.
const CELL_PX: usize = 34;
const MAP_PX: usize = 380;

/// Returns the page; it comes before the annex.
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

/// Draws the map: each grid with its letter and hatch, so that the map is readable without colour and on a bad
/// copy.
fn draw_grid_map(map: &GridMap) -> Markup {
    let most = map.columns.max(map.rows.len()).max(1);
    let side = CELL_PX.min(MAP_PX / most).max(4);
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

// Inside an SVG, each element needs its own closing tag; otherwise it would contain all elements that follow.
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

    #[test]
    fn each_grid_of_the_map_is_an_element_of_its_own() {
        let rows = vec![vec![GridState::Passed, GridState::Failed], vec![GridState::PassedAfterAbrasion; 2]];
        let svg = draw_grid_map(&GridMap { rows, columns: 2 }).into_string();
        assert_eq!((svg.matches("<rect").count(), svg.matches("></rect>").count()), (4, 4), "{svg}");
        assert_eq!(svg.matches("<line").count(), svg.matches("></line>").count(), "{svg}");
    }
}
