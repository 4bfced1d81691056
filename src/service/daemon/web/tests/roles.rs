//! Tests every route with every role, as in the table; and that no other route exists.

use super::{Browser, PageFixture};
use crate::daemon::web::access::{Access, Method};
use crate::daemon::web::routes::ROUTES;
use axum::http::StatusCode;
use panelprep_cell::accounts::{Permission, Role};
use strum::VariantArray;

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
            // Choosing a language leads back to the page, for every visitor.
            let leads_back = route.path.starts_with("/language/");
            assert!(leads_back || is_refused != may, "{role:?} at {}: {} {}", route.path, reply.status, reply.body);
            assert!(reply.status != StatusCode::INTERNAL_SERVER_ERROR, "{}: {}", route.path, reply.body);
        }
    }
}

/// The router is made only from the table.
#[test]
fn no_route_is_beside_the_table() {
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

/// Each permission is needed somewhere. A request that moves the cell needs a permission; a request that stops it
/// needs none.
#[test]
fn what_stops_is_open_and_what_moves_is_not() {
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

/// A viewer that repeats requests that it may not make is refused each time, and writes a few lines.
#[tokio::test]
async fn a_flood_of_refused_requests_is_a_few_lines_of_the_audit_trail() {
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
