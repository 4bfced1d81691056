//! Trends: the development of one quantity of a panel over its cycles, and the locations at which its film breaks.

use super::answers;
use super::answers::{Answer, read_store};
use super::guard::VisitorExtension;
use super::layout::Frame;
use super::page_texts::Language;
use super::sessions::Visitor;
use super::state::Web;
use crate::report::{ChartTexts, format_value, heat_chart, trend_chart};
use axum::Extension;
use axum::extract::{Query, State};
use axum::response::Response;
use maud::{Markup, html};
use panelprep_base::number_text::utc_text;
use panelprep_store::history::{HeatMap, KnownQuantity, Quantity, Trend, heat_map, heat_table, trend, trend_table};
use panelprep_store::store::{Store, StoreError};
use serde::Deserialize;
use std::sync::Arc;

/// Maximum number of shown values: of the newest cycles of a panel, or of the newest verifications.
const MAX_SHOWN_CYCLES: usize = 200;

/// The selection of a person; for empty fields the page chooses a value.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct TrendQuery {
    panel: String,
    name: String,
    check: String,
}

/// The selected trend.
struct TrendSelection {
    panels: Vec<String>,
    panel: String,
    name: String,
    trend: Trend,
    heat: HeatMap,
}

impl TrendQuery {
    /// Returns the selected panel; if none is selected, the panel of the newest cycle.
    fn panel(&self, store: &Store, panels: &[String]) -> Result<String, StoreError> {
        if !self.panel.is_empty() {
            return Ok(self.panel.clone());
        }
        let newest = store.search(&panelprep_store::history::Query { limit: 1, ..Default::default() })?;
        let newest = newest.hits.into_iter().next().map(|hit| hit.panel);
        Ok(newest.or_else(|| panels.first().cloned()).unwrap_or_default())
    }

    /// Returns the name of the selected value: a check's name that was typed in has priority over the list.
    fn value_name(&self) -> String {
        let names = [self.check.trim(), self.name.as_str(), KnownQuantity::LocalizationResidual.keyword()];
        names.into_iter().find(|name| !name.is_empty()).unwrap_or_default().to_owned()
    }

    fn read(&self, store: &Store) -> Result<TrendSelection, StoreError> {
        let panels = store.cycle_panels()?;
        let (panel, name) = (self.panel(store, &panels)?, self.value_name());
        let cycles = store.past_cycles(&panel, MAX_SHOWN_CYCLES)?;
        let quantity = Quantity::from_keyword(&name);
        let trend = match &quantity {
            Quantity::Known(known) if known.verified_subject().is_some() => {
                let (title, unit) = known.title_and_unit();
                let subject = known.verified_subject().unwrap_or_default();
                Trend::from_points(
                    (title.to_owned(), unit.to_owned()),
                    store.verification_points(subject, MAX_SHOWN_CYCLES)?,
                    0,
                )
            }
            _ => trend(&quantity, &cycles),
        };
        Ok(TrendSelection { panels, panel, name, trend, heat: heat_map(&cycles) })
    }
}

async fn read(web: &Arc<Web>, visitor: &Visitor, query: TrendQuery) -> Result<TrendSelection, Response> {
    read_store(web, visitor, move |store| query.read(store)).await
}

pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(query): Query<TrendQuery>,
) -> Answer {
    let shown = read(&web, &visitor, query).await?;
    let words = visitor.language();
    let frame = Frame { visitor: &visitor, title: words.text("trends.title"), here: "/trends", scripts: &[] };
    Ok(frame.page(&body(words, &shown)))
}

pub(super) async fn csv(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(query): Query<TrendQuery>,
) -> Answer {
    let shown = read(&web, &visitor, query).await?;
    Ok(answers::csv(&visitor, "trend", &trend_table(&shown.trend)))
}

pub(super) async fn json(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(query): Query<TrendQuery>,
) -> Answer {
    Ok(answers::json(&read(&web, &visitor, query).await?.trend))
}

pub(super) async fn heat_csv(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(query): Query<TrendQuery>,
) -> Answer {
    let shown = read(&web, &visitor, query).await?;
    Ok(answers::csv(&visitor, "grids", &heat_table(&shown.heat)))
}

pub(super) async fn heat_json(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(query): Query<TrendQuery>,
) -> Answer {
    Ok(answers::json(&read(&web, &visitor, query).await?.heat))
}

fn body(words: Language<'_>, shown: &TrendSelection) -> Markup {
    let word = |key| words.text(key);
    let TrendSelection { panel, trend, heat, .. } = shown;
    let query = [("panel", panel), ("name", &shown.name)];
    let address = form_urlencoded::Serializer::new(String::new()).extend_pairs(query).finish();
    html! {
        section.card {
            h2 { (word("trends.title")) }
            (fields(words, shown))
        }
        section.card {
            h2 { (trend.title) @if !trend.unit.is_empty() { " [" (trend.unit) "]" } }
            p.links { a href={ "/trends.csv?" (address) } { "CSV" } " · " a href={ "/trends.json?" (address) } { "JSON" } }
            @if trend.points.is_empty() { p { (word("trends.no_values")) } } @else {
                (trend_chart(trend, chart_texts(words)))
                (show_hints(words, trend))
            }
            @if trend.without > 0 { p.note { (word("trends.without")) " " (trend.without) } }
        }
        section.card {
            h2 { (panel) }
            p.note { (word("trends.films")) " " (heat.films) }
            p.links { a href={ "/heat.csv?" (address) } { "CSV" } " · " a href={ "/heat.json?" (address) } { "JSON" } }
            div.scroll tabindex="0" { (heat_chart(heat, word("trends.heat"))) }
        }
    }
}

fn chart_texts(words: Language<'_>) -> ChartTexts<'_> {
    ChartTexts {
        cycle: words.text("run.cycle"),
        usual: words.text("trends.usual"),
        unusual: words.text("trends.unusual"),
        beyond: words.text("trends.beyond"),
        limit: words.text("trends.limit"),
        mean: words.text("trends.mean"),
    }
}

fn fields(words: Language<'_>, shown: &TrendSelection) -> Markup {
    let word = |key| words.text(key);
    let is_known = KnownQuantity::keywords().contains(&shown.name.as_str());
    html! {
        form.search method="get" action="/trends" {
            label {
                (word("history.panel"))
                select name="panel" {
                    @for panel in &shown.panels { option value=(panel) selected[*panel == shown.panel] { (panel) } }
                }
            }
            label {
                (word("trends.number"))
                select name="name" {
                    @for name in KnownQuantity::keywords() { option value=(name) selected[name == shown.name] { (name.replace('-', " ")) } }
                }
            }
            label { (word("trends.named")) input name="check" value=(if is_known { "" } else { &shown.name }) maxlength="200" autocomplete="off"; }
            button.primary type="submit" { (word("trends.show")) }
        }
    }
}

/// Shows the unusual values in words, which explain the triangles.
fn show_hints(words: Language<'_>, trend: &Trend) -> Markup {
    let of = |at: usize| trend.points.get(at);
    html! {
        @if trend.usual.is_none() { p.note { (words.text("trends.too_few")) } }
        @else if !trend.hints.is_empty() {
            details {
                summary { (words.text("trends.hints")) " (" (trend.hints.len()) ")" }
                ul { @for hint in &trend.hints { @if let Some(point) = of(hint.at) {
                    li {
                        @if let Some(cycle) = point.cycle { a href={ "/cycle/" (cycle) } { (words.text("run.cycle")) " " (cycle) } ", " }
                        (utc_text(point.at_unix_s)) ": " (format_value(point.value)) " " (trend.unit) " – " (hint.rule.describe())
                    }
                } } }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;
    use panelprep_base::verdict::Limit;
    use panelprep_cell::record::CycleId;
    use panelprep_store::history::{HeatCell, TrendPoint};

    fn shown_of(points: usize) -> TrendSelection {
        let point = |at: usize| TrendPoint {
            cycle: Some(CycleId(at as i64 + 1)),
            at_unix_s: 0,
            serial: None,
            value: if at == 11 { 9.0 } else { 1.0 + (at % 2) as f64 },
            limit: Limit::AtMost(8.0),
        };
        let grids =
            vec![HeatCell { grid: "r1c1".to_owned(), row: 1, column: 1, films: 3, breaks: 1, median_s: Some(5.0) }];
        TrendSelection {
            panels: vec!["a&b".to_owned(), "wing".to_owned()],
            panel: "a&b".to_owned(),
            name: "passes".to_owned(),
            trend: Trend::from_points(("passes".to_owned(), String::new()), (0..points).map(point).collect(), 2),
            heat: HeatMap { films: 3, grids },
        }
    }

    #[test]
    fn a_trend_is_drawn_with_its_hints_in_words_in_every_language() {
        let words = Translations::read(None).expect("the program's own");
        for language in ["en", "de"] {
            let html = body(words.language(Some(language), None), &shown_of(12)).into_string();
            assert!(html.contains("href=\"/trends.csv?panel=a%26b&amp;name=passes\""), "{html}");
            assert!(html.contains("<option value=\"a&amp;b\" selected>"), "{html}");
            assert!(
                html.contains("class=\"beyond\"") && html.contains("one value is more than 3 standard deviations")
            );
            assert!(html.contains("<strong>1/3</strong><br>5.0 s") && !html.contains("style="));
            assert!(
                !html.contains("trends.") || html.matches("trends.").count() == html.matches("/trends.").count()
            );
        }
        let html = body(words.language(None, None), &shown_of(0)).into_string();
        assert!(html.contains("No cycle of this panel has this value.") && !html.contains("<svg.chart"));
    }

    #[test]
    fn a_typed_check_name_has_priority_over_the_list() {
        let query = |name: &str, check: &str| TrendQuery {
            name: name.to_owned(),
            check: check.to_owned(),
            ..TrendQuery::default()
        };
        assert_eq!(query("passes", "").value_name(), "passes");
        assert_eq!(query("passes", " overlap ").value_name(), "overlap");
        assert_eq!(query("", "").value_name(), "localization-residual");
    }
}
