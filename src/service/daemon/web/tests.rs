//! Tests of the page as a browser or an attacker uses it: the router of the page, with a queue in place of the loop.

mod attacks;
mod drawing;
mod sessions;

use super::live_state::{FrameEncoder, LiveState};
use super::page_texts::Translations;
use super::routes;
use super::server::PageParts;
use super::state::{Web, WebParts};
use crate::daemon::alarms::Alarms;
use crate::daemon::gateway::{Gateway, InterfaceContext};
use crate::daemon::live_view::LiveView;
use crate::daemon::people::AccountService;
use crate::daemon::request::{Reply, Request as CellRequest, RequestResult};
use crate::daemon::request_queue::request_queue;
use crate::daemon::transfer::RecordTransfers;
use crate::setup::{CellFiles, testing::write_cell};
use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::ConnectInfo;
use axum::http::{HeaderMap, Request, StatusCode};
use panelprep_base::geometry::{Camera, OrganizedCloud};
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts;
use panelprep_cell::accounts::{Account, AuditEntry, Role};
use panelprep_cell::files;
use panelprep_store::store::{Store, TeachingInputs};
use std::net::SocketAddr;
use std::sync::{Arc, LazyLock, Mutex};
use std::thread;
use std::time::Duration;
use strum::VariantArray;
use tempfile::TempDir;
use tower::ServiceExt;

pub(super) const PASSWORD: &str = "correct horse";
/// The hash is computed once for all accounts, because this takes some time.
static HASH: LazyLock<String> =
    LazyLock::new(|| accounts::hash_password(PASSWORD, "nobody", [3; 16]).expect("allowed"));

/// A valid recipe with a comment that must not be lost.
pub(super) const DOOR: &str = "panel = \"door\" # the left one\n\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\n\
                               [region]\ncorners_px = [[10, 10], [90, 10], [90, 60], [10, 60]]\nrows = 2\ncolumns = 3\n";

/// A recipe with a name that must not become a script.
const PANEL: &str = "panel = \"<b>p</b>\"";

/// The teaching of the door: a scan of 100×80 pixels.
fn door_teaching() -> TeachingInputs {
    let points = vec![[0.0, 0.0, 1_000.0]; 100 * 80];
    let scan = OrganizedCloud::<Camera>::new(100, 80, points, vec![[9; 3]; 100 * 80]).expect("a cloud");
    TeachingInputs {
        name: "door".to_owned(),
        scan: files::write_pcd(&scan),
        recipe_text: DOOR.to_owned(),
        scanner_calibration_text: String::new(),
        base_from_camera_text: String::new(),
        corners: vec![],
        flange_camera_text: String::new(),
        flange_from_camera_text: String::new(),
    }
}

/// Test bench: a page on a new store, with an account for each role.
pub(super) struct PageFixture {
    router: Router,
    pub web: Arc<Web>,
    gateway: Gateway,
    pub asked: Arc<Mutex<Vec<String>>>,
    pub folder: TempDir,
    pub setup: Arc<CellFiles>,
    pub transfers: RecordTransfers,
}

/// A complete response.
#[derive(Debug)]
pub(super) struct FullResponse {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: String,
}

impl FullResponse {
    /// Returns the session cookie that the response sets.
    pub fn cookie(&self) -> Option<String> {
        let set = self.headers.get_all("set-cookie").iter().filter_map(|value| value.to_str().ok());
        set.map(|value| value.split(';').next().unwrap_or("").to_owned())
            .find(|value| value.starts_with("panelprep="))
    }
}

/// A person with a browser.
#[derive(Debug, Clone, Default)]
pub(super) struct Browser {
    pub cookie: Option<String>,
    pub csrf: String,
}

impl PageFixture {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::create(&folder.path().join("store")).expect("a store");
        store.teach(&door_teaching()).expect("taught");
        drop(store);
        let setup = write_cell(folder.path(), "", &[("door.toml", DOOR), ("panel.toml", PANEL)]);
        let folder_of_store = folder.path().join("store");
        let mut store = Store::open_for_accounts(&folder_of_store).expect("open");
        let entry = AuditEntry::for_completed_action(None, None, "terminal".to_owned(), "change account");
        for role in Role::VARIANTS {
            let name = role.keyword().to_owned();
            let printed_name = format!("<script>alert('{name}')</script>");
            let account =
                Account { name, printed_name, role: *role, password_hash: HASH.clone(), is_enabled: true };
            store.store_account(&account, &entry).expect("kept");
        }
        drop(store);
        let (sender, queue) = request_queue();
        let asked = Arc::new(Mutex::new(Vec::new()));
        let heard = asked.clone();
        thread::spawn(move || {
            loop {
                let Some(CellRequest { what, requester: who, reply }) = queue.next(Duration::from_secs(60)) else {
                    return;
                };
                if !matches!(what, crate::daemon::request::RequestKind::State) {
                    heard.lock().expect("whole").push(format!("{} by {who}", what.describe()));
                }
                let done = Reply { state: Some("idle".to_owned()), ..Reply::refused(RequestResult::Done, vec![]) };
                if let Some(reply) = reply {
                    drop(reply.send(done));
                }
            }
        });
        let (_, live) = tokio::sync::watch::channel(Arc::new(LiveState::default()));
        let gateway = Gateway::without_cell(sender, Reason::new("bad_input", "no cell here"));
        let people = Arc::new(AccountService::new(folder_of_store));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let transfers = RecordTransfers::default();
        let web = Arc::new(Web::new(WebParts {
            front: InterfaceContext {
                gateway: gateway.clone(),
                people,
                alarms,
                setup: setup.clone(),
                transfers: transfers.clone(),
            },
            live,
            frames: Arc::new(FrameEncoder::new(LiveView::default())),
            translations: Translations::read(None).expect("the program's own"),
            is_tls: false,
            hosts: Some(["127.0.0.1:8090".to_owned(), "localhost:8090".to_owned()]),
            idle_min: 30,
            sessions: 2,
        }));
        let router = routes::router(&web);
        let from = ConnectInfo(SocketAddr::from(([127, 0, 0, 1], 5_000)));
        PageFixture { router: router.layer(axum::Extension(from)), web, gateway, asked, folder, setup, transfers }
    }

    /// Returns the parts from which a real server of this page is started.
    pub fn parts(&self, page: panelprep_cell::cell::Page) -> PageParts {
        let (folder, gateway) = (self.folder.path().join("store"), self.gateway.clone());
        let people = Arc::new(AccountService::new(folder.clone()));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let front = InterfaceContext {
            gateway,
            people,
            alarms,
            setup: self.setup.clone(),
            transfers: self.transfers.clone(),
        };
        PageParts { page, folder, front, view: LiveView::default() }
    }

    /// Sends a request with these headers.
    pub async fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> FullResponse {
        let mut request = Request::builder().method(method).uri(path);
        if !headers.iter().any(|(name, _)| *name == "host") {
            request = request.header("host", "127.0.0.1:8090");
        }
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::from(body.to_owned())).expect("a request");
        let response = self.router.clone().oneshot(request).await.expect("infallible");
        let (parts, body) = response.into_parts();
        // The stream of events has no end, so it is not read.
        let is_endless = parts.headers.get("content-type").is_some_and(|kind| kind == "text/event-stream");
        let body = if is_endless { Default::default() } else { to_bytes(body, 1 << 24).await.expect("whole") };
        let body = String::from_utf8_lossy(&body).into_owned();
        FullResponse { status: parts.status, headers: parts.headers, body }
    }

    pub async fn get(&self, browser: &Browser, path: &str) -> FullResponse {
        let cookie = browser.cookie.clone().unwrap_or_default();
        self.send("GET", path, &[("cookie", &cookie)], "").await
    }

    /// Sends a change as the script of the page does.
    pub async fn post(&self, browser: &Browser, path: &str, body: &str) -> FullResponse {
        let cookie = browser.cookie.clone().unwrap_or_default();
        let headers = [
            ("cookie", cookie.as_str()),
            ("sec-fetch-site", "same-origin"),
            ("content-type", "application/json"),
            ("x-csrf-token", &browser.csrf),
        ];
        self.send("POST", path, &headers, body).await
    }

    pub async fn log_in(&self, name: &str, password: &str) -> Result<Browser, FullResponse> {
        let body = format!("{{\"name\":\"{name}\",\"password\":\"{password}\"}}");
        let told = self.post(&Browser::default(), "/login", &body).await;
        let Some(cookie) = told.cookie().filter(|_| told.status == StatusCode::OK) else { return Err(told) };
        let browser = Browser { cookie: Some(cookie), csrf: String::new() };
        let page = self.get(&browser, "/").await.body;
        let (_, rest) = page.split_once("name=\"csrf\" content=\"").expect("a token");
        Ok(Browser { csrf: rest.split('"').next().expect("its end").to_owned(), ..browser })
    }

    pub fn asked(&self) -> Vec<String> {
        self.asked.lock().expect("whole").clone()
    }
}
