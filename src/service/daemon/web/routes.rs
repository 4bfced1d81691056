//! The table of all routes: each route with its method and the required access. A route that is not in the table is not
//! served.

use super::guard::{Access, Method, Route};
use super::state::Web;
use super::{
    accounts, alarms, audit, cameras, cycle, guard, history, layout, messages, requests, run_page, setup, trends,
};
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::from_fn_with_state;
use axum::routing::{MethodRouter, get, post};
use panelprep_cell::accounts::Permission;
use std::sync::Arc;

/// Maximum size of a request body, bytes: that of an edited recipe with escaped characters.
pub(super) const MAX_BODY_BYTES: usize = 512 * 1_024;

const fn view_route(path: &'static str, access: Access, handler: fn() -> MethodRouter<Arc<Web>>) -> Route {
    Route { path, method: Method::Get, access, handler }
}

const fn change(path: &'static str, access: Access, handler: fn() -> MethodRouter<Arc<Web>>) -> Route {
    Route { path, method: Method::Post, access, handler }
}

use Access::{Needs, Open};
use Permission::{Accept, Acknowledge, Audit, Configure, ManagePeople, Operate, Sign, View};

/// Every route.
pub(super) static ROUTES: &[Route] = &[
    view_route("/", Open, || get(run_page::page)),
    view_route("/events", Open, || get(run_page::events)),
    view_route("/message/{code}", Open, || get(messages::json)),
    view_route("/assets/{name}", Open, || get(layout::serve_asset)),
    view_route("/login", Open, || get(accounts::page)),
    change("/login", Open, || post(accounts::login)),
    change("/logout", Open, || post(accounts::logout)),
    view_route("/password", Needs(View), || get(accounts::own_password_page)),
    change("/password", Needs(View), || post(accounts::change_password)),
    view_route("/language/{name}", Open, || get(accounts::language)),
    change("/request/stop", Open, || post(requests::stop)),
    change("/request/abort", Open, || post(requests::abort)),
    change("/request/hold", Needs(Operate), || post(requests::hold)),
    change("/request/unhold", Needs(Operate), || post(requests::unhold)),
    change("/request/clear", Needs(Operate), || post(requests::clear)),
    change("/request/reset", Needs(Operate), || post(requests::reset)),
    change("/request/new-disc", Needs(Operate), || post(requests::new_disc)),
    change("/request/identify", Needs(Operate), || post(requests::identify)),
    change("/request/start", Needs(Operate), || post(requests::start)),
    change("/request/accept", Needs(Accept), || post(requests::accept)),
    view_route("/frame.jpg", Needs(View), || get(run_page::frame)),
    view_route("/now.json", Needs(View), || get(run_page::now)),
    view_route("/review", Needs(View), || get(run_page::review)),
    view_route("/cycle/{number}", Needs(View), || get(cycle::page)),
    view_route("/cycle/{number}/record", Needs(View), || get(cycle::record)),
    view_route("/cycle/{number}/record.pdf", Needs(View), || get(cycle::pdf)),
    change("/cycle/{number}/sign", Needs(Sign), || post(cycle::sign)),
    view_route("/cycle/{number}/record.json", Needs(View), || get(cycle::json)),
    view_route("/cycle/{number}/signed/{name}", Needs(View), || get(cycle::signed_file)),
    view_route("/cycle/{number}/picture/{finding}/{picture}", Needs(View), || get(cycle::picture)),
    view_route("/cycle/{number}/scene.bin", Needs(View), || get(run_page::points)),
    view_route("/cycle/{number}/scene.json", Needs(View), || get(run_page::paths)),
    view_route("/history", Needs(View), || get(history::page)),
    view_route("/history.csv", Needs(View), || get(history::csv)),
    view_route("/history.json", Needs(View), || get(history::json)),
    view_route("/compare", Needs(View), || get(history::compare_page)),
    view_route("/compare.csv", Needs(View), || get(history::compare_csv)),
    view_route("/compare.json", Needs(View), || get(history::compare_json)),
    view_route("/trends", Needs(View), || get(trends::page)),
    view_route("/trends.csv", Needs(View), || get(trends::csv)),
    view_route("/trends.json", Needs(View), || get(trends::json)),
    view_route("/heat.csv", Needs(View), || get(trends::heat_csv)),
    view_route("/heat.json", Needs(View), || get(trends::heat_json)),
    view_route("/alarms", Needs(View), || get(alarms::page)),
    view_route("/alarms.csv", Needs(View), || get(alarms::csv)),
    view_route("/alarms.json", Needs(View), || get(alarms::json)),
    change("/alarms/acknowledge", Needs(Acknowledge), || post(alarms::acknowledge)),
    view_route("/setup", Needs(View), || get(setup::page)),
    view_route("/setup/recipe/{name}", Needs(View), || get(setup::recipe)),
    change("/setup/check", Needs(Configure), || post(setup::check_text)),
    change("/setup/recipe/{name}", Needs(Configure), || post(setup::save)),
    view_route("/setup/recipe/{name}/draw", Needs(Configure), || get(setup::draw_page)),
    view_route("/setup/recipe/{name}/picture.png", Needs(Configure), || get(setup::picture)),
    view_route("/setup/recipe/{name}/drawing.json", Needs(Configure), || get(setup::drawing)),
    change("/setup/recipe/{name}/proposal", Needs(Configure), || post(setup::propose)),
    view_route("/setup/cameras", Needs(View), || get(cameras::page)),
    view_route("/setup/cameras/{name}", Needs(View), || get(cameras::picture)),
    change("/setup/cameras/{name}", Needs(Configure), || post(cameras::capture)),
    view_route("/setup/doctor", Needs(Configure), || get(setup::doctor_page)),
    view_route("/people", Needs(ManagePeople), || get(accounts::people_page)),
    change("/people", Needs(ManagePeople), || post(accounts::save_account)),
    view_route("/audit", Needs(Audit), || get(audit::page)),
    view_route("/audit.csv", Needs(Audit), || get(audit::csv)),
];

/// Returns the router with all routes of the table, each behind the access check.
pub(super) fn router(web: &Arc<Web>) -> Router {
    let router = ROUTES.iter().fold(Router::new(), |router, route| {
        let guarded = (web.clone(), route);
        router.route(route.path, (route.handler)().layer(from_fn_with_state(guarded, guard::identify_visitor)))
    });
    let router = router.fallback(guard::not_found_page).layer(DefaultBodyLimit::max(MAX_BODY_BYTES));
    router.layer(from_fn_with_state(web.clone(), guard::headers)).with_state(web.clone())
}
