//! The newest cycle in three dimensions: the scan's points as bytes, the planned paths and their executed parts as
//! JSON, and the part of a page that shows them. If the browser cannot draw the scene, the text next to the scene
//! states the same.

use super::answers::{Answer, reading};
use super::guard::not_found_page;
use super::page_texts::Language;
use super::sessions::Visitor;
use super::state::Web;
use crate::daemon::live_view::ScenePath;
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::IntoResponse;
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_cell::record::{CycleId, CycleRecord};
use serde_json::{Value, json};
use std::sync::Arc;

/// Returns the number of the newest cycle, if the requested cycle is the newest one.
fn newest_cycle_number(web: &Web, number: &str) -> Option<CycleId> {
    let asked: i64 = number.parse().ok()?;
    web.live.borrow().cycle.filter(|newest| *newest == asked).map(CycleId)
}

/// Serves the points of the scan.
pub(super) async fn points(State(web): State<Arc<Web>>, Path(number): Path<String>) -> Answer {
    let points = newest_cycle_number(&web, &number).and_then(|_| web.scene.newest_scan().0);
    match points {
        Some(points) => Ok(([(header::CONTENT_TYPE, "application/octet-stream")], points.to_vec()).into_response()),
        None => Err(not_found_page().await),
    }
}

/// Returns the planned paths with the executed part of each, as the robot reported it.
pub(super) async fn paths(
    State(web): State<Arc<Web>>,
    Extension(visitor): Extension<Visitor>,
    Path(number): Path<String>,
) -> Answer {
    let Some(id) = newest_cycle_number(&web, &number) else { return Err(not_found_page().await) };
    let (points, paths) = web.scene.newest_scan();
    if points.is_none() && paths.is_empty() {
        return Err(not_found_page().await);
    }
    let record = reading(&web, &visitor, move |store| store.cycle(id)).await?;
    Ok(Json(scene_json(&record, &paths, points.is_some())).into_response())
}

fn scene_json(record: &CycleRecord, paths: &[ScenePath], has_points: bool) -> Value {
    let of_path = |path: &ScenePath| {
        let at = path.waypoints.iter().flat_map(|(at, _)| at.map(|mm| (f64::from(mm) * 100.0).round() / 100.0));
        let contact: Vec<u8> = path.waypoints.iter().map(|(_, contact)| u8::from(*contact)).collect();
        json!({
            "pass": path.pass, "at_mm": at.collect::<Vec<f64>>(), "contact": contact,
            "executed": executed_waypoints(record, path.plan),
        })
    };
    let facing = paths.last().map_or([0.0, 0.0, 1.0], |path| path.facing);
    json!({ "has_points": has_points, "facing": facing, "paths": paths.iter().map(of_path).collect::<Vec<_>>() })
}

/// Returns how many waypoints of a plan were executed; the first waypoint is not counted.
fn executed_waypoints(record: &CycleRecord, plan: u64) -> u32 {
    let of_plan = record.motions.iter().filter(|motion| motion.motion.plan == plan);
    of_plan.filter_map(|motion| motion.contact.as_ref()).map(|contact| contact.told).max().unwrap_or(0)
}

/// Returns the part of a page that shows the scene when a person opens it; with `None`, the script selects the cycle.
pub(super) fn show_scene(words: Language<'_>, cycle: Option<CycleId>) -> Markup {
    let word = |key| words.text(key);
    html! {
        details.scene data-cycle=[cycle] {
            summary { (word("scene.title")) }
            p.note { (word("scene.note")) }
            div.buttons {
                @for (view, key) in [("reset", "scene.reset"), ("top", "scene.top"), ("side", "scene.side")] {
                    button type="button" data-view=(view) { (word(key)) }
                }
            }
            canvas tabindex="0" role="img" aria-label=(word("scene.canvas")) {}
            p.told role="status" {}
            ul.legend {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;

    #[test]
    fn the_part_of_the_page_names_its_cycle_where_it_has_one() {
        let words = Translations::read(None).expect("the program's own");
        let page = |cycle| show_scene(words.language(Some("de"), None), cycle).into_string();
        assert!(page(Some(CycleId(4))).contains("data-cycle=\"4\"") && !page(None).contains("data-cycle"));
        assert!(!page(None).contains("scene."), "each word is there: {}", page(None));
    }
}
