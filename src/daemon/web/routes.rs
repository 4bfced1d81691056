//! The table of all routes: each route with its method and the access that it needs. A route that is not in the table
//! is not served.

use super::access::{Access, Method, Route};
use super::state::Web;
use super::{
    alarms, assets, audit, cameras, compare, cycle, doctor, draw, guard, history, live, login, messages, people,
    requests, run_page, scene, setup, trends,
};
use crate::accounts::Permission;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::from_fn_with_state;
use axum::routing::{MethodRouter, get, post};
use std::sync::Arc;

/// The longest body that is read: an edited recipe, with its escapes.
pub(super) const MAX_BODY_BYTES: usize = 512 * 1_024;

const fn look(path: &'static str, access: Access, handler: fn() -> MethodRouter<Arc<Web>>) -> Route {
    Route { path, method: Method::Get, access, handler }
}

const fn change(path: &'static str, access: Access, handler: fn() -> MethodRouter<Arc<Web>>) -> Route {
    Route { path, method: Method::Post, access, handler }
}

use Access::{Needs, Open};
use Permission::{Accept, Acknowledge, Audit, Configure, ManagePeople, Operate, Sign, View};

/// Every route.
pub(super) static ROUTES: &[Route] = &[
    look("/", Open, || get(run_page::page)),
    look("/events", Open, || get(live::events)),
    look("/message/{code}", Open, || get(messages::json)),
    look("/assets/{name}", Open, || get(assets::asset)),
    look("/login", Open, || get(login::page)),
    change("/login", Open, || post(login::log_in)),
    change("/logout", Open, || post(login::log_out)),
    look("/password", Needs(View), || get(login::own)),
    change("/password", Needs(View), || post(login::change_password)),
    look("/language/{name}", Open, || get(login::language)),
    change("/request/stop", Open, || post(requests::stop)),
    change("/request/abort", Open, || post(requests::abort)),
    change("/request/hold", Needs(Operate), || post(requests::hold)),
    change("/request/unhold", Needs(Operate), || post(requests::unhold)),
    change("/request/clear", Needs(Operate), || post(requests::clear)),
    change("/request/reset", Needs(Operate), || post(requests::reset)),
    change("/request/new-disc", Needs(Operate), || post(requests::new_disc)),
    change("/request/start", Needs(Operate), || post(requests::start)),
    change("/request/accept", Needs(Accept), || post(requests::accept)),
    look("/frame.jpg", Needs(View), || get(run_page::frame)),
    look("/now.json", Needs(View), || get(run_page::now)),
    look("/review", Needs(View), || get(run_page::review)),
    look("/cycle/{number}", Needs(View), || get(cycle::page)),
    look("/cycle/{number}/record", Needs(View), || get(cycle::record)),
    look("/cycle/{number}/record.pdf", Needs(View), || get(cycle::pdf)),
    change("/cycle/{number}/sign", Needs(Sign), || post(cycle::sign)),
    look("/cycle/{number}/record.json", Needs(View), || get(cycle::json)),
    look("/cycle/{number}/picture/{finding}/{picture}", Needs(View), || get(cycle::picture)),
    look("/cycle/{number}/scene.bin", Needs(View), || get(scene::points)),
    look("/cycle/{number}/scene.json", Needs(View), || get(scene::paths)),
    look("/history", Needs(View), || get(history::page)),
    look("/history.csv", Needs(View), || get(history::csv)),
    look("/history.json", Needs(View), || get(history::json)),
    look("/compare", Needs(View), || get(compare::page)),
    look("/compare.csv", Needs(View), || get(compare::csv)),
    look("/compare.json", Needs(View), || get(compare::json)),
    look("/trends", Needs(View), || get(trends::page)),
    look("/trends.csv", Needs(View), || get(trends::csv)),
    look("/trends.json", Needs(View), || get(trends::json)),
    look("/heat.csv", Needs(View), || get(trends::heat_csv)),
    look("/heat.json", Needs(View), || get(trends::heat_json)),
    look("/alarms", Needs(View), || get(alarms::page)),
    look("/alarms.csv", Needs(View), || get(alarms::csv)),
    look("/alarms.json", Needs(View), || get(alarms::json)),
    change("/alarms/acknowledge", Needs(Acknowledge), || post(alarms::acknowledge)),
    look("/setup", Needs(View), || get(setup::page)),
    look("/setup/recipe/{name}", Needs(View), || get(setup::recipe)),
    change("/setup/check", Needs(Configure), || post(setup::check)),
    change("/setup/recipe/{name}", Needs(Configure), || post(setup::save)),
    look("/setup/recipe/{name}/draw", Needs(Configure), || get(draw::page)),
    look("/setup/recipe/{name}/picture.png", Needs(Configure), || get(draw::picture)),
    look("/setup/recipe/{name}/drawing.json", Needs(Configure), || get(draw::drawing)),
    change("/setup/recipe/{name}/proposal", Needs(Configure), || post(draw::propose)),
    look("/setup/cameras", Needs(View), || get(cameras::page)),
    look("/setup/cameras/{name}", Needs(View), || get(cameras::picture)),
    change("/setup/cameras/{name}", Needs(Configure), || post(cameras::capture)),
    look("/setup/doctor", Needs(Configure), || get(doctor::page)),
    look("/people", Needs(ManagePeople), || get(people::page)),
    change("/people", Needs(ManagePeople), || post(people::save)),
    look("/audit", Needs(Audit), || get(audit::page)),
    look("/audit.csv", Needs(Audit), || get(audit::csv)),
];

/// Returns the router of the table, each route behind the guard.
pub(super) fn router(web: &Arc<Web>) -> Router {
    let router = ROUTES.iter().fold(Router::new(), |router, route| {
        let guarded = (web.clone(), route);
        router.route(route.path, (route.handler)().layer(from_fn_with_state(guarded, guard::pass)))
    });
    let router = router.fallback(guard::not_found).layer(DefaultBodyLimit::max(MAX_BODY_BYTES));
    router.layer(from_fn_with_state(web.clone(), guard::headers)).with_state(web.clone())
}
