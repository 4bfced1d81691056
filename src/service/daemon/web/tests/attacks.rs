//! One test for each attack that OWASP lists for such a page; and tests of the page's server: its address, and
//! connections that keep it waiting.

use super::{Browser, PASSWORD, PageFixture};
use crate::daemon::web::routes::{MAX_BODY_BYTES, ROUTES};
use crate::daemon::web::server::{OperatorPage, PageParts};
use axum::http::StatusCode;
use panelprep_cell::cell;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

const JSON: (&str, &str) = ("content-type", "application/json");

/// Requests from another site, from a form of another site, and from a browser that states no origin.
#[tokio::test]
async fn another_site_cannot_cause_a_change() {
    let site = PageFixture::new();
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    let cookie = ("cookie", operator.cookie.as_deref().expect("a session"));
    let csrf = ("x-csrf-token", operator.csrf.as_str());
    let refused: [(&str, &[(&str, &str)]); 7] = [
        ("another site", &[cookie, csrf, JSON, ("sec-fetch-site", "cross-site")]),
        ("a site beside", &[cookie, csrf, JSON, ("sec-fetch-site", "same-site")]),
        ("another origin", &[cookie, csrf, JSON, ("origin", "http://evil.example")]),
        ("no origin", &[cookie, csrf, JSON]),
        ("a file", &[cookie, csrf, JSON, ("origin", "null")]),
        ("no token", &[cookie, JSON, ("sec-fetch-site", "same-origin")]),
        ("a token of another session", &[cookie, ("x-csrf-token", "0"), JSON, ("sec-fetch-site", "same-origin")]),
    ];
    for (what, headers) in refused {
        let reply = site.send("POST", "/request/hold", headers, "{}").await;
        assert_eq!(reply.status, StatusCode::FORBIDDEN, "{what}");
    }
    for (what, headers) in refused.iter().take(5) {
        let reply = site.send("POST", "/request/stop", headers, "{}").await;
        assert_eq!(reply.status, StatusCode::FORBIDDEN, "{what}");
    }
    let form = [cookie, csrf, ("sec-fetch-site", "same-origin"), ("content-type", "text/plain")];
    let reply = site.send("POST", "/request/hold", &form, "{}").await;
    assert_eq!(reply.status, StatusCode::UNSUPPORTED_MEDIA_TYPE);
    let own = [cookie, csrf, JSON, ("origin", "http://127.0.0.1:8090")];
    assert_eq!(site.send("POST", "/request/hold", &own, "{}").await.status, StatusCode::OK);
    assert_eq!(site.asked().len(), 1);
    // A foreign host name that resolves to this computer.
    let reply = site.send("GET", "/", &[("host", "evil.example:8090")], "").await;
    assert_eq!(reply.status, StatusCode::MISDIRECTED_REQUEST);
}

#[tokio::test]
async fn names_are_text_and_never_a_script() {
    let site = PageFixture::new();
    for role in ["administrator", "operator", "inspector"] {
        let person = site.log_in(role, PASSWORD).await.expect("logged in");
        for route in ROUTES.iter().filter(|route| !route.path.contains('{')) {
            let told = site.get(&person, route.path).await;
            assert!(!told.body.contains("<script>alert"), "{}", route.path);
        }
        let page = site.get(&person, "/").await.body;
        assert!(page.contains("&lt;script&gt;alert('"), "the name is shown as it stands");
    }
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    let recipe = site.get(&engineer, "/setup/recipe/panel.toml").await.body;
    assert!(recipe.contains("&lt;b&gt;p&lt;/b&gt;") && !recipe.contains("<b>p"));
    let login = site.get(&engineer, "/login?next=%22%3E%3Cscript%3Ealert(1)%3C/script%3E").await.body;
    assert!(!login.contains("<script>alert"));
}

#[tokio::test]
async fn a_path_cannot_leave_its_folder() {
    let site = PageFixture::new();
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    for path in [
        "/assets/../Cargo.toml",
        "/assets/..%2f..%2fCargo.toml",
        "/assets/page.css",
        "/setup/recipe/..%2Fcell.toml",
        "/setup/recipe/%2Fetc%2Fpasswd",
        "/cycle/0",
        "/cycle/-1",
        "/cycle/1%2F..%2F2",
        "/cycle/99999999999999999999",
        "/cycle/1/picture/0/..%2f0",
        "/cycle/1/picture/18446744073709551616/0",
        "/nowhere",
        "//evil.example",
    ] {
        assert_eq!(site.get(&engineer, path).await.status, StatusCode::NOT_FOUND, "{path}");
    }
    let told = site.post(&engineer, "/setup/recipe/..%2Fcell.toml", r#"{"text":"a","why":"b"}"#).await;
    assert_eq!(told.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(told.body.contains("there is no recipe"));
}

#[tokio::test]
async fn a_request_cannot_add_a_header() {
    let site = PageFixture::new();
    let told = site.get(&Browser::default(), "/language/de%0d%0aSet-Cookie:%20a=b").await;
    assert_eq!(told.status, StatusCode::NOT_FOUND);
    let told = site.get(&Browser::default(), "/language/de?next=/%0d%0aX:%20y").await;
    assert_eq!(told.headers.get("location").and_then(|value| value.to_str().ok()), Some("/"));
    let told = site.get(&Browser::default(), "/language/de?next=//evil.example/").await;
    assert_eq!(told.headers.get("location").and_then(|value| value.to_str().ok()), Some("/"));
    let told = site.get(&Browser::default(), "/setup/recipe/a%22b").await;
    assert_eq!(
        told.headers.get("location").and_then(|value| value.to_str().ok()),
        Some("/login?next=%2Fsetup%2Frecipe%2Fa%2522b")
    );
}

#[tokio::test]
async fn long_and_malformed_bodies_are_refused() {
    let site = PageFixture::new();
    let engineer = site.log_in("engineer", PASSWORD).await.expect("logged in");
    let long = format!("{{\"text\":\"{}\"}}", "x".repeat(MAX_BODY_BYTES));
    assert_eq!(site.post(&engineer, "/setup/check", &long).await.status, StatusCode::PAYLOAD_TOO_LARGE);
    for body in [
        "",
        "{",
        "[]",
        r#"{"dried":"yes"}"#,
        r#"{"dried":true,"step":3,"force":true}"#,
        r#"{"dried":true}"#,
        r#"{"dried":true,"step":3}{}"#,
    ] {
        let status = site.post(&engineer, "/request/unhold", body).await.status;
        assert!([400, 422].contains(&status.as_u16()), "{body}: {status}");
    }
    let deep = "[".repeat(100_000);
    assert!(site.post(&engineer, "/setup/check", &deep).await.status.is_client_error());
    assert_eq!(site.asked(), Vec::<String>::new());
}

#[tokio::test]
async fn every_response_states_what_a_browser_may_do_with_it() {
    let site = PageFixture::new();
    let viewer = site.log_in("viewer", PASSWORD).await.expect("logged in");
    for path in ["/", "/login", "/setup", "/nowhere", "/people", "/now.json", "/history", "/alarms"] {
        let told = site.get(&viewer, path).await;
        let header = |name: &str| told.headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or("");
        let policy = header("content-security-policy");
        assert!(policy.starts_with("default-src 'none'; script-src 'self';"), "{path}: {policy}");
        assert!(!policy.contains("unsafe") && policy.contains("frame-ancestors 'none'"), "{path}: {policy}");
        assert_eq!(header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(header("cache-control"), "no-store", "{path}");
        assert_eq!(header("x-frame-options"), "DENY", "{path}");
    }
}

/// The files that a browser loads first: the page of the cell and its files.
#[tokio::test]
async fn the_first_load_is_small() {
    let site = PageFixture::new();
    let operator = site.log_in("operator", PASSWORD).await.expect("logged in");
    let page = site.get(&operator, "/").await.body;
    let mut bytes = page.len();
    let assets: Vec<&str> = page.split('"').filter(|part| part.starts_with("/assets/")).collect();
    assert_eq!(assets.len(), 6, "{assets:?}");
    for asset in assets {
        let told = site.get(&operator, asset).await;
        assert_eq!(told.status, StatusCode::OK, "{asset}");
        assert!(
            !told.body.contains("http://") || asset.ends_with("icon.svg"),
            "{asset}: nothing comes from elsewhere"
        );
        assert!(!told.body.contains("https://") && !told.body.contains("PAGE_JS"), "{asset}");
        bytes += told.body.len();
    }
    assert!(bytes <= 250_000, "{bytes}");
    println!("first load: {bytes} bytes");
}

fn parts(site: &PageFixture, listen: SocketAddr) -> PageParts {
    let page = cell::Page {
        listen: Some(listen),
        certificate: None,
        recipes: site.folder.path().to_owned(),
        translations: None,
        idle_min: 30,
        sessions: 3,
    };
    site.parts(page)
}

/// Returns the response to a request for the page of the cell; `None` if no server answers.
fn page_response(address: SocketAddr) -> Option<String> {
    answered(address, &format!("GET /login HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n"))
}

/// Returns the response to a stop by a visitor without an account.
fn stop_response(address: SocketAddr) -> Option<String> {
    let head = format!(
        "POST /request/stop HTTP/1.1\r\nhost: {address}\r\norigin: http://{address}\r\nconnection: close\r\n"
    );
    answered(address, &format!("{head}content-type: application/json\r\ncontent-length: 2\r\n\r\n{{}}"))
}

fn answered(address: SocketAddr, request: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(20))).ok()?;
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    Some(answer)
}

#[test]
fn an_address_in_use_delays_nothing_and_is_served_later() {
    let site = PageFixture::new();
    let other = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = other.local_addr().expect("its address");
    let page = OperatorPage::serve(parts(&site, address)).expect("it continues").expect("an address");
    drop(other);
    let since = Instant::now();
    while !page_response(address).is_some_and(|answer| answer.starts_with("HTTP/1.1 200")) {
        assert!(since.elapsed() < Duration::from_secs(30), "never served");
        std::thread::sleep(Duration::from_millis(50));
    }
    drop(page);
    assert_eq!(page_response(address), None, "it ends with the service");
}

fn response_of_served_page(site: &PageFixture) -> (OperatorPage, SocketAddr) {
    let page = OperatorPage::serve(parts(site, ([127, 0, 0, 1], 0).into())).expect("served").expect("an address");
    let address = page.url.trim_start_matches("http://").trim_end_matches('/').parse().expect("one");
    (page, address)
}

/// Opens this number of connections, and sends this text on each of them.
fn open_connections(count: usize, address: SocketAddr, begins: &str) -> Vec<TcpStream> {
    let one = |_| {
        let mut stream = TcpStream::connect(address).expect("it listens");
        // The first connections may already be closed.
        drop(stream.write_all(begins.as_bytes()));
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("set");
        stream
    };
    (0..count).map(one).collect()
}

/// Requests whose bodies never arrive do not block a slot: a stop at this time is executed immediately, and these
/// requests are ended automatically.
#[test]
fn unfinished_bodies_do_not_delay_a_stop() {
    let site = PageFixture::new();
    let (_page, address) = response_of_served_page(&site);
    let head = format!("POST /login HTTP/1.1\r\nhost: {address}\r\norigin: http://{address}\r\n");
    let begins = format!("{head}content-type: application/json\r\ncontent-length: 50\r\n\r\n{{");
    let mut silent = open_connections(520, address, &begins);
    let since = Instant::now();
    let answer = stop_response(address).expect("answered beside them");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(since.elapsed() < Duration::from_secs(10), "{:?}", since.elapsed());
    assert_eq!(site.asked().iter().filter(|asked| asked.starts_with("stop")).count(), 1);
    let mut rest = String::new();
    silent.last_mut().expect("one of them").read_to_string(&mut rest).expect("it is ended");
    assert!(rest.starts_with("HTTP/1.1 4"), "{rest}");
}

/// Viewers of the events without an account do not block other visitors.
#[test]
fn many_viewers_do_not_delay_a_stop() {
    let site = PageFixture::new();
    let (_page, address) = response_of_served_page(&site);
    let begins = format!("GET /events HTTP/1.1\r\nhost: {address}\r\n\r\n");
    let mut lookers = open_connections(100, address, &begins);
    let mut rest = String::new();
    lookers[0].read_to_string(&mut rest).expect("the first one has given way");
    assert!(rest.starts_with("HTTP/1.1 200") && rest.contains("text/event-stream"), "{rest}");
    lookers.extend(open_connections(520, address, &begins));
    let since = Instant::now();
    let answer = stop_response(address).expect("answered beside them");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(since.elapsed() < Duration::from_secs(10), "{:?}", since.elapsed());
    let mut bytes = [0; 1_024];
    assert!(lookers.last_mut().expect("one").read(&mut bytes).expect("open") > 0, "the last one looks on");
}

/// Two hundred unfinished requests do not delay other clients, and are closed.
#[test]
fn slow_clients_delay_no_other_client() {
    let site = PageFixture::new();
    let (_page, address) = response_of_served_page(&site);
    let mut slow: Vec<TcpStream> = (0..200)
        .map(|_| {
            let mut stream = TcpStream::connect(address).expect("it listens");
            stream.write_all(b"POST /request/stop HTTP/1.1\r\nhost: ").expect("sent");
            stream
        })
        .collect();
    let answer = page_response(address).expect("answered beside them");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    let stream = slow.last_mut().expect("one of them");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("set");
    let mut rest = String::new();
    stream.read_to_string(&mut rest).expect("it is ended");
    assert!(!rest.contains("200 OK"), "{rest}");
    assert_eq!(site.asked().iter().filter(|asked| asked.starts_with("stop")).count(), 0);
}
