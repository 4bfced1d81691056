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
use crate::daemon::request::{Reply, Request as CellRequest, RequestResult, StartRequest};
use crate::daemon::request_queue::request_queue;
use crate::daemon::sources::{Equipment, ExaminedItem, RecipeText, RecordPdf, RecordSource, SetupSource};
use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::ConnectInfo;
use axum::http::{HeaderMap, Request, StatusCode};
use panelprep_base::geometry::ColorPicture;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::accounts;
use panelprep_cell::accounts::{Account, AuditEntry, Role};
use panelprep_cell::record::CycleId;
use panelprep_store::office::RecipeOffer;
use panelprep_store::store::{PersonSigningRequest, Store};
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

/// A source of recipes, one of which can be changed.
#[derive(Default)]
struct Source {
    door: Mutex<Option<String>>,
}

impl SetupSource for Source {
    fn recipes(&self) -> Result<Vec<String>, String> {
        Ok(vec!["panel.toml".to_owned()])
    }

    fn recipe(&self, name: &str) -> Result<RecipeText, String> {
        match name {
            "door.toml" => {
                let text = self.door.lock().expect("whole").clone().unwrap_or_else(|| DOOR.to_owned());
                Ok(RecipeText { name: name.to_owned(), text })
            }
            "panel.toml" => Ok(RecipeText { name: name.to_owned(), text: "panel = \"<b>p</b>\"".to_owned() }),
            _ => Err(format!("there is no recipe {name}")),
        }
    }

    fn recipe_offer(&self, name: &str) -> Result<Option<RecipeOffer>, String> {
        let of_door =
            || RecipeOffer::new("door", &DOOR.replace("rows = 2", "rows = 3"), ("Anna <b>", "finer film"), 1_000);
        Ok((name == "door.toml").then(|| of_door().expect("an offer")))
    }

    fn problems(&self, _: &str, text: &str) -> Vec<String> {
        if text.contains("wrong") { vec!["line 1: wrong".to_owned()] } else { vec![] }
    }

    fn not_taught(&self, _: &str, text: &str) -> Option<String> {
        text.contains("rows = 4").then(|| "taught with another [region]".to_owned())
    }

    fn save(&self, name: &str, text: &str) -> Result<Option<String>, String> {
        self.recipe(name)?;
        if let Some(problem) = self.problems(name, text).pop() {
            return Err(problem);
        }
        // Simulates the time that a disk needs.
        thread::sleep(Duration::from_millis(50));
        *self.door.lock().expect("whole") = Some(text.to_owned());
        Ok(Some("before".to_owned()))
    }

    fn taught_picture(&self, name: &str) -> Result<ColorPicture, String> {
        self.recipe(name).map(|_| ColorPicture::uniform(100, 80, [9, 9, 9]))
    }

    fn cycle_obstacles(&self) -> Vec<Reason> {
        vec![Reason::new("disk_scarce", "5 MB are free")]
    }

    fn examine_cell(&self) -> Vec<ExaminedItem> {
        let of = |name: &str, is_right| ExaminedItem {
            name: name.to_owned(),
            is_right,
            found: "found".to_owned(),
            advice: String::new(),
        };
        vec![of("disk", true), of("robot", false)]
    }

    fn list_equipment(&self) -> Result<(Verdict, Vec<String>, Vec<Equipment>), String> {
        Ok((Verdict::Accept, vec![], vec![]))
    }
}

impl RecordSource for Source {
    fn page(&self, _: CycleId) -> Result<String, String> {
        Ok("<!DOCTYPE html>".to_owned())
    }

    fn pdf(&self, _: CycleId) -> Result<Option<RecordPdf>, String> {
        Ok(None)
    }

    fn sign(&self, _: &PersonSigningRequest) -> Result<u64, String> {
        Ok(1)
    }
}

/// Test bench: a page on a new store, with an account for each role.
pub(super) struct PageFixture {
    router: Router,
    pub web: Arc<Web>,
    gateway: Gateway,
    pub asked: Arc<Mutex<Vec<String>>>,
    pub folder: TempDir,
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
        let store = Store::create(&folder.path().join("store")).expect("a store");
        drop(store);
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
        let loader = Arc::new(|start: StartRequest| {
            let message = format!("no cell here; stated clear: {}", start.is_stated_clear);
            Err(vec![Reason::new("bad_input", message)])
        });
        let (_, live) = tokio::sync::watch::channel(Arc::new(LiveState::default()));
        let gateway = Gateway::new(sender, loader, None);
        let people = Arc::new(AccountService::new(folder_of_store));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let web = Arc::new(Web::new(WebParts {
            front: InterfaceContext {
                gateway: gateway.clone(),
                people,
                alarms,
                setup: Arc::new(Source::default()),
            },
            live,
            frames: Arc::new(FrameEncoder::new(LiveView::default())),
            translations: Translations::read(None).expect("the program's own"),
            records: Arc::new(Source::default()),
            is_tls: false,
            hosts: Some(["127.0.0.1:8090".to_owned(), "localhost:8090".to_owned()]),
            idle_min: 30,
            sessions: 2,
        }));
        let router = routes::router(&web);
        let from = ConnectInfo(SocketAddr::from(([127, 0, 0, 1], 5_000)));
        PageFixture { router: router.layer(axum::Extension(from)), web, gateway, asked, folder }
    }

    /// Returns the parts from which a real server of this page is started.
    pub fn parts(&self, page: panelprep_cell::cell::Page) -> PageParts {
        let (folder, gateway) = (self.folder.path().join("store"), self.gateway.clone());
        let people = Arc::new(AccountService::new(folder.clone()));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let front = InterfaceContext { gateway, people, alarms, setup: Arc::new(Source::default()) };
        PageParts { page, folder, front, view: LiveView::default(), records: Arc::new(Source::default()) }
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
