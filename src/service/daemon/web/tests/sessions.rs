//! Tests log-in, wrong passwords, sessions, and requests in a person's name. Every route is tested with every role of
//! the table, and no route exists outside of the table.

use super::{Browser, PASSWORD, PageFixture};
use crate::daemon::web::guard::{Access, Method};
use crate::daemon::web::routes::ROUTES;
use axum::http::StatusCode;
use panelprep_cell::accounts::{Account, AuditEntry, Permission, Role};
use panelprep_store::store::Store;
use std::time::{Duration, Instant};
use strum::VariantArray;

#[tokio::test]
async fn a_log_in_creates_a_new_session_that_ends_with_logging_out() {
    let site = PageFixture::new();
    let set = Browser { cookie: Some("panelprep=chosen-by-somebody-else".to_owned()), csrf: String::new() };
    let body = format!("{{\"name\":\"operator\",\"password\":\"{PASSWORD}\"}}");
    let told = site.post(&set, "/login", &body).await;
    let cookie = told.cookie().expect("a session");
    assert!(!cookie.contains("chosen") && cookie.len() == "panelprep=".len() + 64, "{cookie}");
    let whole = told.headers.get("set-cookie").and_then(|value| value.to_str().ok()).expect("set");
    assert!(whole.ends_with("; Path=/; HttpOnly; SameSite=Strict"), "{whole}");
    assert_eq!(site.get(&set, "/setup").await.status, StatusCode::SEE_OTHER, "the chosen one is no session");
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    assert_eq!(site.get(&operator, "/setup").await.status, StatusCode::OK);
    assert_eq!(site.post(&operator, "/logout", "{}").await.status, StatusCode::OK);
    assert_eq!(site.get(&operator, "/setup").await.status, StatusCode::SEE_OTHER);
}

#[tokio::test]
async fn five_wrong_passwords_lock_the_account_and_are_in_the_audit_trail() {
    let site = PageFixture::new();
    for name in ["operator", "nobody", "O'Brien"] {
        let told = site.log_in(name, "wrong horse").await.expect_err("refused");
        assert_eq!(told.status, StatusCode::UNAUTHORIZED);
        assert!(
            told.body.contains("Name or password is wrong"),
            "which of them are accounts is not told: {}",
            told.body
        );
    }
    for _ in 0..4 {
        site.log_in("operator", "wrong horse").await.expect_err("refused");
    }
    let told = site.log_in("operator", PASSWORD).await.expect_err("pauses");
    assert!(told.body.contains("Too many wrong passwords. Try again in 60 s"), "{}", told.body);
    site.log_in("engineer", PASSWORD).await.expect("another account continues");
    let store = Store::open(&site.folder.path().join("store")).expect("open");
    let audit = store.audit(None, 100).expect("read");
    let refused = audit.iter().filter(|line| line.entry.what == "log in" && line.entry.refused.is_some());
    assert_eq!(refused.count(), 6, "O'Brien is no name of an account, and is not kept");
    assert!(audit.iter().all(|line| line.entry.from == "127.0.0.1" || line.entry.from == "terminal"));
}

#[tokio::test]
async fn requests_go_to_the_loop_in_the_persons_name_and_a_stop_needs_none() {
    let site = PageFixture::new();
    assert_eq!(site.post(&Browser::default(), "/request/stop", "{}").await.status, StatusCode::OK);
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    assert_eq!(site.post(&operator, "/request/unhold", "{\"dried\":true,\"step\":3}").await.status, StatusCode::OK);
    let reply = site.post(&operator, "/request/hold", "{\"why\":\"water\\nleaks\"}").await;
    assert_eq!(reply.status, StatusCode::OK);
    // A page that was loaded before the session can still stop the cell.
    let stale = Browser { csrf: "old".to_owned(), ..operator.clone() };
    assert_eq!(site.post(&stale, "/request/abort", "{}").await.status, StatusCode::OK);
    assert_eq!(site.post(&stale, "/request/reset", "{}").await.status, StatusCode::FORBIDDEN);
    // An operator has no permission to accept a deviation.
    assert_eq!(site.post(&operator, "/request/accept", "{\"step\":3}").await.status, StatusCode::FORBIDDEN);
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    for decision in ["accept", "unhold", "clear"] {
        let told = site.post(&engineer, &format!("/request/{decision}"), "{\"dried\":true}").await;
        assert_eq!(told.status, StatusCode::UNPROCESSABLE_ENTITY, "{decision} without its step");
    }
    // A proposal needs the cameras, which this service does not have, and is no request to the loop.
    let proposed = site.post(&operator, "/request/identify", r#"{"recipe":"panel.toml","serial":"7"}"#).await;
    assert!(
        proposed.status == StatusCode::CONFLICT && proposed.body.contains("\"code\":\"not_now\""),
        "{}",
        proposed.body
    );
    let sha256 = site.setup.recipe("panel.toml").expect("it is offered").sha256();
    let start =
        |sha256: &str| format!(r#"{{"recipe":"panel.toml","sha256":"{sha256}","serial":"7","is_clear":true}}"#);
    // The recipe was changed after the page was loaded: no request reaches the loop.
    let stale = site.post(&operator, "/request/start", &start(&"0".repeat(64))).await;
    assert!(stale.status == StatusCode::CONFLICT && stale.body.contains(&sha256), "{}", stale.body);
    assert!(stale.body.contains("\"code\":\"bad_input\""), "{}", stale.body);
    // Without the confirmation that no person is inside, no start reaches the loop either.
    let unsaid = start(&sha256).replace(",\"is_clear\":true", "");
    let unsaid = site.post(&operator, "/request/start", &unsaid).await;
    assert!(
        unsaid.status == StatusCode::CONFLICT && unsaid.body.contains("no person is inside"),
        "{}",
        unsaid.body
    );
    let start = site.post(&operator, "/request/start", &start(&sha256)).await;
    assert_eq!(start.status, StatusCode::CONFLICT, "this test has no cell");
    assert!(start.body.contains("no cell here"), "{}", start.body);
    let by = "operator, on the operator's page at 127.0.0.1";
    // A refused start reaches the loop only to be recorded; no client waits for this.
    let since = std::time::Instant::now();
    while site.asked().len() < 7 && since.elapsed() < std::time::Duration::from_secs(20) {
        tokio::task::yield_now().await;
    }
    let asked = site.asked();
    let asked: Vec<&str> = asked.iter().map(String::as_str).collect();
    let start = format!("start by panel.toml by {by}");
    // The loader reads the recipe by its file.
    let loaded = format!("start by {} by {by}", site.setup.recipe("panel.toml").expect("it is offered").name);
    assert_eq!(
        asked,
        [
            "stop by a person who was not logged in, on the operator's page at 127.0.0.1",
            &format!("unhold --dried by {by}"),
            &format!("hold: waterleaks by {by}"),
            &format!("abort by {by}"),
            // The refusals because of the changed recipe, because of the missing confirmation, and by the loader: each
            // is one line of the audit page, among the requests.
            &start,
            &start,
            &loaded,
        ]
    );
    let store = Store::open(&site.folder.path().join("store")).expect("open");
    let trail = store.audit(None, 100).expect("read");
    assert!(trail.iter().all(|line| line.entry.what != "start"), "not a second time: {trail:?}");
}

#[tokio::test]
async fn a_changed_account_logs_in_again_and_the_last_administrator_stays() {
    let site = PageFixture::new();
    let administrator = site.log_in("administrator", PASSWORD).await.expect("logged in");
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    let change = |name: &str, role: &str, is_enabled: bool| {
        format!(
            r#"{{"name":"{name}","printed_name":"Anna B","role":"{role}","password":"","is_enabled":{is_enabled}}}"#
        )
    };
    let reply = site.post(&administrator, "/people", &change("operator", "viewer", true)).await;
    assert_eq!(reply.status, StatusCode::OK, "{}", reply.body);
    assert_eq!(site.get(&operator, "/setup").await.status, StatusCode::SEE_OTHER, "its session ended");
    let viewer = site.log_in("operator", PASSWORD).await.expect("the password stayed");
    assert_eq!(site.post(&viewer, "/request/hold", "{}").await.status, StatusCode::FORBIDDEN);
    for change in [change("administrator", "viewer", true), change("administrator", "administrator", false)] {
        let reply = site.post(&administrator, "/people", &change).await;
        assert!(reply.body.contains("the last enabled account that may manage accounts"), "{}", reply.body);
    }
    // "Add" never changes an account that already exists.
    let add = r#"{"is_new":true,"name":"inspector","printed_name":"Paul","role":"viewer","password":"a new password","is_enabled":true}"#;
    let reply = site.post(&administrator, "/people", add).await;
    assert!(reply.status == StatusCode::UNPROCESSABLE_ENTITY && reply.body.contains("exists"), "{}", reply.body);
    let inspector = site.log_in("inspector", PASSWORD).await.expect("as before");
    assert_eq!(site.get(&inspector, "/audit").await.status, StatusCode::OK, "the role stayed");
    let reply = site.post(&administrator, "/people", &change("New One", "viewer", true)).await;
    assert!(reply.body.contains("a to z"), "{}", reply.body);
    let reply = site.post(&administrator, "/people", &change("ben", "viewer", true)).await;
    assert!(reply.body.contains("0 characters"), "a new account has a password: {}", reply.body);
}

#[tokio::test]
async fn a_person_changes_the_own_password_with_the_old_one() {
    let site = PageFixture::new();
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    let told = site.post(&operator, "/password", r#"{"password":"wrong horse","new":"another horse"}"#).await;
    assert_eq!(told.status, StatusCode::UNPROCESSABLE_ENTITY);
    // A new password that is too short is not treated as a wrong password: the person does not have to wait, whatever
    // the number of attempts.
    for _ in 0..6 {
        let body = format!(r#"{{"password":"{PASSWORD}","new":"x"}}"#);
        assert_eq!(site.post(&operator, "/password", &body).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    }
    let body = format!(r#"{{"password":"{PASSWORD}","new":"another horse"}}"#);
    assert_eq!(site.post(&operator, "/password", &body).await.status, StatusCode::OK);
    site.log_in("operator", PASSWORD).await.expect_err("the old one");
    site.log_in("operator", "another horse").await.expect("the new one");
}

/// Changes an account in the store directly, as another process does.
fn change_from_outside(site: &PageFixture, name: &str, change: impl FnOnce(&mut Account)) {
    let mut store = Store::open_for_accounts(&site.folder.path().join("store")).expect("open");
    let mut account = store.accounts().expect("read").remove(name).expect("an account");
    change(&mut account);
    let entry = AuditEntry::for_completed_action(None, None, "terminal".to_owned(), "change account");
    store.store_account(&account, &entry).expect("kept");
}

/// Sends requests until the session has ended, which must happen within a few seconds.
async fn wait_for_session_end(site: &PageFixture, browser: &Browser) {
    let since = Instant::now();
    loop {
        let told = site.get(browser, "/frame.jpg").await;
        if told.status == StatusCode::UNAUTHORIZED {
            return;
        }
        assert!(since.elapsed() < Duration::from_secs(3), "{told:?}");
        tokio::time::sleep(Duration::from_millis(300)).await;
    }
}

#[tokio::test]
async fn an_account_changed_outside_the_page_signs_nothing_and_loses_its_sessions() {
    let site = PageFixture::new();
    let signs = format!(r#"{{"meaning":"reviewed","remark":"","password":"{PASSWORD}"}}"#);
    let inspector = site.log_in("inspector", PASSWORD).await.expect("logged in");
    // The store of this test has no cycle: a signature that the account permits ends there.
    let reply = site.post(&inspector, "/cycle/1/sign", &signs).await;
    assert!(reply.body.contains("has no cycle 1"), "{reply:?}");
    // The accounts were read a moment ago; for the signature they are read again.
    change_from_outside(&site, "inspector", |account| account.role = Role::Viewer);
    let reply = site.post(&inspector, "/cycle/1/sign", &signs).await;
    assert!(
        reply.body.contains("was changed since the log-in") || reply.status == StatusCode::UNAUTHORIZED,
        "{reply:?}"
    );
    wait_for_session_end(&site, &inspector).await;

    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    assert_eq!(site.get(&engineer, "/setup").await.status, StatusCode::OK);
    change_from_outside(&site, "engineer", |account| account.is_enabled = false);
    wait_for_session_end(&site, &engineer).await;
    assert_eq!(site.get(&engineer, "/setup").await.status, StatusCode::SEE_OTHER);
    // A stop never requires an account.
    assert_eq!(site.post(&engineer, "/request/stop", "{}").await.status, StatusCode::OK);

    // A person who logs in after the change can continue immediately.
    change_from_outside(&site, "engineer", |account| account.is_enabled = true);
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    assert_eq!(site.get(&engineer, "/setup").await.status, StatusCode::OK);
}

/// A page whose session has ended reports this. The session of a wall display continues after a restart of the service,
/// and ends with a new password.
#[tokio::test]
async fn a_page_without_its_session_reports_it_and_a_display_keeps_its_own() {
    let site = PageFixture::new();
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    let ended = "role=\"alert\">Your session has ended";
    assert!(!site.get(&operator, "/").await.body.contains(ended));
    site.web.sessions().end_account_sessions("operator");
    let page = site.get(&operator, "/").await.body;
    assert!(page.contains(ended) && page.contains("name=\"person\" content=\"\""), "{page}");
    assert!(!page.contains("id=\"grids\"") && !page.contains("id=\"frame\""), "{page}");
    assert!(!site.get(&Browser::default(), "/").await.body.contains(ended), "a stranger");

    let display = site.log_in("display", PASSWORD).await.expect("logged in");
    site.web.sessions().end_account_sessions("display");
    crate::daemon::web::accounts::begin_displays(&site.web);
    assert_eq!(site.get(&display, "/history").await.status, StatusCode::OK, "after a restart of the service");
    assert_eq!(site.post(&display, "/request/reset", "{}").await.status, StatusCode::FORBIDDEN);
    change_from_outside(&site, "display", |account| account.is_enabled = false);
    wait_for_session_end(&site, &display).await;
    crate::daemon::web::accounts::begin_displays(&site.web);
    assert_eq!(site.get(&display, "/history").await.status, StatusCode::SEE_OTHER);
}

/// An error response to a person who opens a page is a page with navigation and Stop.
#[tokio::test]
async fn an_error_is_a_page_with_its_head() {
    let site = PageFixture::new();
    let viewer = site.log_in("viewer", PASSWORD).await.expect("logged in");
    let cookie = viewer.cookie.clone().expect("a session");
    for (path, status, words) in [
        ("/nowhere", StatusCode::NOT_FOUND, "There is no such page."),
        ("/cycle/99", StatusCode::NOT_FOUND, "There is no such page."),
        ("/audit", StatusCode::FORBIDDEN, "Your role does not permit this. (Viewer)"),
        // The text of the page's own handler is kept, as it is.
        ("/setup/recipe/gone.toml", StatusCode::NOT_FOUND, "there is no recipe &quot;gone.toml&quot;"),
    ] {
        let told = site.send("GET", path, &[("cookie", &cookie), ("accept", "text/html,*/*")], "").await;
        assert_eq!(told.status, status, "{path}");
        assert!(told.body.contains("id=\"stop\"") && told.body.contains(words), "{path}: {}", told.body);
        assert!(told.body.contains("id=\"logout\""), "{path}");
        assert!(!site.get(&viewer, path).await.body.contains("<html"), "a script reads JSON");
    }
    assert!(site.get(&viewer, "/password").await.body.contains("data-post=\"/password\""));
}

fn path(template: &str) -> String {
    let values = [("{number}", "1"), ("{finding}", "0"), ("{picture}", "0"), ("{name}", "panel.toml")];
    values.iter().fold(template.to_owned(), |path, (name, value)| path.replace(name, value))
}

#[tokio::test]
async fn each_role_gets_what_the_table_gives_it_and_nothing_else() {
    let site = PageFixture::new();
    let mut visitors: Vec<(Option<Role>, Browser)> = vec![(None, Browser::default())];
    for role in Role::VARIANTS {
        visitors.push((Some(*role), site.log_in(role.keyword(), super::PASSWORD).await.expect("logged in")));
    }
    for route in ROUTES {
        for (role, browser) in &visitors {
            // A visitor who logs out cannot continue.
            if ["/logout", "/login"].contains(&route.path) {
                continue;
            }
            let reply = match route.method {
                Method::Get => site.get(browser, &path(route.path)).await,
                Method::Post => site.post(browser, &path(route.path), "{}").await,
            };
            let may = match route.access {
                Access::Open => true,
                Access::Needs(permission) => role.is_some_and(|role| role.has_permission(permission)),
            };
            let is_refused = match (role, route.method) {
                (None, Method::Get) => {
                    reply.status == StatusCode::SEE_OTHER || reply.status == StatusCode::UNAUTHORIZED
                }
                (None, Method::Post) => reply.status == StatusCode::UNAUTHORIZED,
                (Some(_), _) => reply.status == StatusCode::FORBIDDEN,
            };
            // The response to the choice of a language redirects every visitor back to the page.
            let leads_back = route.path.starts_with("/language/");
            assert!(leads_back || is_refused != may, "{role:?} at {}: {} {}", route.path, reply.status, reply.body);
            assert!(reply.status != StatusCode::INTERNAL_SERVER_ERROR, "{}: {}", route.path, reply.body);
        }
    }
}

/// The router contains only the routes of the table.
#[test]
fn no_route_exists_outside_of_the_table() {
    let folder = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("src/service/daemon/web");
    let mut files = 0;
    for entry in std::fs::read_dir(folder).expect("there") {
        let path = entry.expect("readable").path();
        if path.extension().is_some_and(|end| end == "rs") && path.file_stem().is_some_and(|stem| stem != "routes")
        {
            let text = std::fs::read_to_string(&path).expect("text");
            files += 1;
            for word in [".route(", ".nest(", ".merge(", ".fallback(", "Router::new("] {
                assert!(!text.contains(word), "{}: {word}", path.display());
            }
        }
    }
    assert!(files > 20, "{files}");
}

/// Each permission is required by at least one route. A request that moves the cell requires a permission; a request
/// that stops the cell requires none.
#[test]
fn a_stop_needs_no_permission_and_a_motion_needs_one() {
    let access = |path: &str| ROUTES.iter().find(|route| route.path == path).map(|route| route.access);
    for path in ["/request/stop", "/request/abort"] {
        assert_eq!(access(path), Some(Access::Open));
    }
    for path in ["start", "hold", "unhold", "clear", "reset", "new-disc"] {
        assert_eq!(access(&format!("/request/{path}")), Some(Access::Needs(Permission::Operate)), "{path}");
    }
    for permission in Permission::VARIANTS {
        assert!(ROUTES.iter().any(|route| route.access == Access::Needs(*permission)), "{permission:?}");
    }
}

/// A viewer who repeats requests without permission is refused each time, and only a few entries are written.
#[tokio::test]
async fn many_refused_requests_give_few_lines_of_the_audit_trail() {
    let site = PageFixture::new();
    let viewer = site.log_in("viewer", super::PASSWORD).await.expect("logged in");
    for _ in 0..1_000 {
        assert_eq!(site.post(&viewer, "/request/reset", "{}").await.status, StatusCode::FORBIDDEN);
    }
    site.web.count_refusals(site.web.now_ms() + 60_000);
    let lines = site.web.read(|store| store.audit(None, 2_000)).expect("read");
    let refused: Vec<_> = lines.iter().map(|line| &line.entry).filter(|entry| entry.refused.is_some()).collect();
    assert!((2..=20).contains(&refused.len()), "{} lines", refused.len());
    assert_eq!((refused[0].what.as_str(), refused[0].who.as_deref()), ("flood", Some("viewer")));
    let counted = format!("{} further refused requests", 1_001 - refused.len());
    assert!(refused[0].refused.as_deref().is_some_and(|told| told.contains(&counted)), "{:?}", refused[0]);
}
