//! The page of the running cell, readable from two metres. A script updates it with the events: the state of the cell
//! is requested once, and sent to all viewers.
//!
//! The newest cycle is also shown in three dimensions: the points of the scan as bytes, the planned paths and their
//! executed parts as JSON, and the part of a page that shows them. If the browser cannot draw the scene, a text next to
//! the scene contains the same information.

use super::answers::{Answer, read_store};
use super::guard::{VisitorExtension, not_found_page};
use super::layout::{Frame, Script};
use super::live_state::{FrameEncoder, LiveState};
use super::messages;
use super::page_texts::Language;
use super::sessions::Visitor;
use super::state::{Web, connection_owner, run_blocking};
use crate::daemon::gateway::Gateway;
use crate::daemon::live_view::ScenePath;
use crate::daemon::request::RequestKind;
use crate::report::check_row;
use axum::extract::{ConnectInfo, Path, State};
use axum::http::{StatusCode, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::{Extension, Json};
use futures_util::stream;
use futures_util::stream::Stream;
use maud::{Markup, html};
use panelprep_base::verdict::Verdict;
use panelprep_cell::accounts::Permission;
use panelprep_cell::cell::{NameDemand, PartRules};
use panelprep_cell::record::{CycleId, CycleRecord, Finding, RequestAuthor, RequestSource};
use panelprep_interfaces::packml::RecipeHash;
use panelprep_store::history::{grid_states, touched_grids, touching_passes};
use panelprep_store::store::Store;
use serde::Serialize;
use serde_json::{Value, json};
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// The phases of a cycle in their usual order.
const PHASES: [&str; 11] =
    ["locate", "refine", "dry", "wet", "inspect", "plan", "verify", "abrade", "retract", "assess", "rinse"];

/// Returns the page.
pub(super) async fn page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Response {
    let source = web.front.setup.clone();
    let rules = source.cell.part().clone();
    let recipes = match visitor.has_permission(Permission::Operate) {
        true => run_blocking(move || source.recipe_hashes()).await.unwrap_or_else(|| Ok(vec![])),
        false => Ok(vec![]),
    };
    let words = visitor.language();
    let word = |key| words.text(key);
    let phase = |name: &'static str| (name, format!("phase.{name}"));
    let phases = PHASES.map(phase);
    let body = html! {
        section.state #state data-state="" aria-live="polite" {
            p.panel #panel {}
            p.word #state-word { "…" }
            p.why #why {}
            p.sentence #sentence lang="en" {}
            p.remedy hidden { (word("alarms.remedy")) ": " span #remedy {} }
            ol.reasons #reasons {}
        }
        section.review #review hidden aria-live="polite" {}
        section.actions.card {
            h2 { (word("run.actions")) }
            @if visitor.has_permission(Permission::Operate) || visitor.has_permission(Permission::Accept) { (actions(&visitor)) }
            @else { p { (word("run.no_actions")) } }
            p.told #told role="status" {}
            @if visitor.has_permission(Permission::Operate) { (start(&visitor, &recipes, &rules)) }
        }
        section.progress.card {
            h2 { (word("run.progress")) }
            ol.phases #phases {
                @for (name, key) in &phases { li data-phase=(name) { (words.text(key)) } }
            }
            dl.numbers {
                div { dt { (word("run.film")) } dd #film { "–" } }
                div { dt { (word("run.waypoint")) } dd #waypoint { "–" } }
                div { dt { (word("run.left")) } dd #left { "–" } }
                div { dt { (word("run.pass")) } dd #pass { "–" } }
                div { dt { (word("run.cycle")) } dd #cycle { "–" } }
            }
            progress #bar max="1" value="0" aria-label=(word("run.progress")) {}
        }
        section.view.card {
            h2 { (word("run.view")) }
            @if visitor.has_permission(Permission::View) {
                figure { img #frame alt=(word("js.picture.none")) hidden; figcaption #frame-name { (word("js.picture.none")) } }
                (show_scene(words, None))
            } @else { p { (word("run.log_in_to_see")) } }
        }
        section.grids.card {
            h2 { (word("run.grids")) }
            @if visitor.has_permission(Permission::View) {
                div #grids {}
                ul.key {
                    @for (class, key) in [("untested", "grid.untested"), ("whole", "grid.whole"), ("broke", "grid.broke"), ("abraded", "grid.abraded"), ("touched", "grid.touched")] {
                        li { span class={ "grid " (class) } aria-hidden="true" {} (word(key)) }
                    }
                }
            } @else { p { (word("run.log_in_to_see")) } }
        }
    };
    Frame {
        visitor: &visitor,
        title: word("nav.run"),
        here: "/",
        scripts: &[Script::Run, Script::Forms, Script::Scene],
    }
    .page(&body)
}

fn actions(visitor: &Visitor) -> Markup {
    let words = visitor.language();
    let word = |key| words.text(key);
    let plain = [
        ("hold", "action.hold"),
        ("clear", "action.clear"),
        ("reset", "action.reset"),
        ("new-disc", "action.new_disc"),
    ];
    html! {
        div.buttons {
            @if visitor.has_permission(Permission::Operate) {
                @for (name, key) in plain { button type="button" data-request=(name) disabled { (word(key)) } }
                label.inline { (word("run.why")) input #why-held maxlength="200" autocomplete="off"; }
                button type="button" data-request="unhold" data-body=r#"{"dried":false}"# disabled { (word("action.unhold")) }
                button type="button" data-request="unhold" data-body=r#"{"dried":true}"# data-needs="unhold --dried" disabled { (word("action.unhold_dried")) }
            }
            @if visitor.has_permission(Permission::Accept) { button type="button" data-request="accept" disabled { (word("action.accept")) } }
        }
    }
}

/// Shows the form for a start. It has two buttons: the first one asks whether the guard is closed and no person is
/// inside; the second one, which the script enables a moment later, sends the form.
fn start(visitor: &Visitor, recipes: &Result<Vec<RecipeHash>, String>, rules: &PartRules) -> Markup {
    let words = visitor.language();
    let word = |key| words.text(key);
    html! {
        form #start data-post="/request/start" {
            h3 { (word("run.start")) }
            @match recipes {
                Err(problem) => p.told.bad { (problem) },
                Ok(recipes) => label { (word("run.recipe")) select name="recipe" required {
                    @for recipe in recipes { option value=(recipe.name) data-sha256=(recipe.sha256) { (recipe.name) } }
                } }
            }
            @for (name, key, rule) in [("serial", "run.serial", &rules.serial), ("order", "run.order", &rules.order)] {
                label { (word(key)) input name=(name) maxlength="120" autocomplete="off" required[rule.demand == NameDemand::Required] placeholder=[rule.pattern.as_deref()]; }
            }
            button type="submit" data-post="/request/identify" formnovalidate data-needs="start" disabled { (word("run.identify")) }
            label.inline { input type="checkbox" name="another_part"; (word("run.another_part")) }
            p.told role="status" {}
            input type="hidden" name="is_clear" value="true";
            button.primary #start-first type="button" data-needs="start" disabled { (word("action.start")) }
            div #start-second role="group" aria-label=(word("run.clear")) hidden {
                p role="alert" { (word("run.clear")) }
                div.buttons {
                    button.primary type="submit" data-needs="start" disabled { (word("run.start_now")) }
                    button #start-cancel type="button" { (word("run.start_cancel")) }
                }
            }
        }
    }
}

/// Serves the newest picture of the camera.
pub(super) async fn frame(State(web): State<Arc<Web>>) -> Response {
    match run_blocking(move || web.frames.newest_jpeg()).await.flatten() {
        Some(jpeg) => ([(header::CONTENT_TYPE, "image/jpeg")], jpeg.to_vec()).into_response(),
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

/// Returns the shown cycle from its record so far: its part and panel, its sanding passes, and the state of each grid.
pub(super) async fn now(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let cycle = web.live.borrow().cycle;
    let Some(id) = cycle.map(CycleId) else { return Ok(Json(json!({ "cycle": null })).into_response()) };
    let (part, record) =
        read_store(&web, &visitor, move |store: &Store| Ok((store.cycle_part(id)?, store.cycle(id)?))).await?;
    let (mut grids, passes) = (grid_states(&record.findings), touching_passes(&record));
    grids.extend(touched_grids(&record).into_iter().map(|grid| (grid, "touched")));
    let no_part = record.has_no_part();
    let told = json!({
        "cycle": id, "part": part, "panel": record.panel, "passes": passes, "grids": grids, "no_part": no_part,
    });
    Ok(Json(told).into_response())
}

/// Shows the question for a person's decision: the values to decide on and the pictures, next to the buttons.
pub(super) async fn review(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let cycle = web.live.borrow().cycle;
    let Some(id) = cycle.map(CycleId) else { return Err(not_found_page().await) };
    let record = read_store(&web, &visitor, move |store| store.cycle(id)).await?;
    let asked = record.findings.iter().enumerate().rev();
    let mut asked = asked.filter(|(_, finding)| finding.judgement.verdict == Verdict::Review);
    match asked.next() {
        Some(found) => Ok(Html(question(&visitor, id, found).into_string()).into_response()),
        None => Err(not_found_page().await),
    }
}

fn question(visitor: &Visitor, id: CycleId, (number, finding): (usize, &Finding)) -> Markup {
    let words = visitor.language();
    let word = |key| words.text(key);
    let judged = finding.checks.iter().filter(|check| check.limit.value().is_some());
    html! {
        h2 { (word("review.title")) }
        (messages::show_by_code(words, &finding.judgement.reasons))
        div.evidence {
            @for (at, picture) in finding.pictures.iter().enumerate() {
                figure {
                    img src={ "/cycle/" (id) "/picture/" (number) "/" (at) } alt=(picture.caption);
                    figcaption { (picture.caption) }
                }
            }
            table {
                thead { tr { td {} th { (word("review.found")) } th { (word("review.allowed")) } } }
                tbody { @for row in judged.map(|check| check_row(check, "")) { tr { td { (row.name) } td { (row.value) } td { (row.allowed) } } } }
            }
        }
    }
}

/// Interval at which the state is requested from the loop.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Maximum time without a change until the connected pages are informed that the server is still working.
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(1);

/// Requests the state from the loop and sends changes, until no receiver is left.
pub(super) async fn poll_loop(gateway: Gateway, frames: Arc<FrameEncoder>, tell: watch::Sender<Arc<LiveState>>) {
    let mut last_sent = tokio::time::Instant::now();
    loop {
        let reply = gateway.request(RequestKind::State, RequestAuthor::from_source(RequestSource::Page)).await;
        let was = tell.borrow().clone();
        let now = match reply.state {
            // If the page itself is the only receiver, there is no viewer; then no picture is requested or drawn.
            Some(_) if tell.receiver_count() <= 1 => {
                LiveState::from_reply(reply, (was.frame, was.frame_name.clone()))
            }
            Some(_) => LiveState::from_reply(reply, frames.newest_frame()),
            // The last known values are kept, with their time.
            None => LiveState { answers: false, reasons: reply.reasons, possible: vec![], ..(*was).clone() },
        };
        if !now.is_unchanged(&was) || last_sent.elapsed() >= KEEP_ALIVE_INTERVAL {
            last_sent = tokio::time::Instant::now();
            if tell.send(Arc::new(now)).is_err() {
                return;
            }
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}

/// The data of an event that is sent to a page.
#[derive(Serialize)]
struct Seen<'l> {
    #[serde(flatten)]
    live: &'l LiveState,
    /// The account of the page's session; `None` after the end of the session. A page for another account shows nothing
    /// more.
    by: Option<String>,
}

/// Sends the events to a page: the state of the cell, now and at each change. A browser that does not read only
/// occupies its connection: it receives the newest state when it reads again. If there are too many viewers, the one
/// that has been connected for the longest time is disconnected; a browser reconnects automatically.
pub(super) async fn events(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let place = web.viewer_slots.acquire(connection_owner(from.ip()));
    let mut live = web.live.clone();
    live.mark_changed();
    let token = visitor.person.map(|person| person.token);
    let stream = stream::unfold((live, place, web, token), |(mut live, mut place, web, token)| async move {
        tokio::select! {
            biased;
            () = place.wait_until_wanted() => return None,
            changed = live.changed() => changed.ok()?,
        }
        let now = live.borrow_and_update().clone();
        let session = token.as_deref().and_then(|token| web.sessions().find(token, web.now_s(), false));
        let now = if session.is_some() { now } else { Arc::new(now.without_names()) };
        let seen = Seen { live: &now, by: session.map(|session| session.name) };
        let event = Event::default().json_data(seen).unwrap_or_default();
        Some((Ok(event), (live, place, web, token)))
    });
    Sse::new(stream).keep_alive(KeepAlive::new().interval(Duration::from_secs(15)))
}

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
    let record = read_store(&web, &visitor, move |store| store.cycle(id)).await?;
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

/// Returns the number of executed waypoints of a plan, without the first waypoint.
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
    fn the_part_of_the_page_names_its_cycle_if_it_has_one() {
        let words = Translations::read(None).expect("the program's own");
        let page = |cycle| show_scene(words.language(Some("de"), None), cycle).into_string();
        assert!(page(Some(CycleId(4))).contains("data-cycle=\"4\"") && !page(None).contains("data-cycle"));
        assert!(!page(None).contains("scene."), "each word is there: {}", page(None));
    }
}
