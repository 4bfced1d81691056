//! The view of both cameras between cycles, with the quality values of the pictures. While a cycle is running no
//! picture is captured, and the reason is shown.

use super::answers::panic_response;
use super::guard::{VisitorExtension, not_found_page, refusal};
use super::layout::{Frame, Script, local_time};
use super::messages;
use super::page_texts::Language;
use super::state::{CameraShot, Web, entry, run_blocking};
use crate::daemon::camera_lease::CameraEye;
use crate::report::canvas::resize_to_width;
use crate::setup::clock::now_unix_ms;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_base::geometry::ColorPicture;
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::{AuditEntry, Permission};
use panelprep_cell::files;
use panelprep_devices::cameras::PictureQuality;
use serde_json::json;
use std::sync::Arc;

/// Maximum width of a picture that is sent, px.
const MAX_WIDTH_PX: usize = 1_280;
/// Each camera with its name in addresses and the key of its displayed name.
const CAMERA_EYES: [(&str, &str, CameraEye); 2] =
    [("scanner", "cameras.scanner", CameraEye::Scanner), ("flange", "cameras.flange", CameraEye::Flange)];

fn parse_camera(name: &str) -> Option<usize> {
    CAMERA_EYES.iter().position(|(word, ..)| *word == name)
}

/// Returns the page with both cameras.
pub(super) async fn page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Response {
    let words = visitor.language();
    let may = visitor.has_permission(Permission::Configure);
    let title = words.text("cameras.title");
    let body = html! {
        section.card { h2 { (title) } p.note { (words.text("cameras.note")) } }
        @for (at, (name, key, _)) in CAMERA_EYES.into_iter().enumerate() {
            section.card {
                h2 { (words.text(key)) }
                @match web.views.last_shot(at) {
                    Some(view) => (show_shot(words, name, &view)),
                    None => p { (words.text("cameras.none")) },
                }
                @if may {
                    form data-post={ "/setup/cameras/" (name) } data-then="/setup/cameras" {
                        p.told role="status" {}
                        button type="submit" { (words.text("cameras.take")) }
                    }
                }
            }
        }
    };
    Frame { visitor: &visitor, title, here: "/setup", scripts: &[Script::Forms] }.page(&body)
}

fn show_shot(words: Language<'_>, name: &str, view: &CameraShot) -> Markup {
    let word = |key| words.text(key);
    html! {
        div.evidence {
            figure {
                img src={ "/setup/cameras/" (name) "?" (view.unix_ms) } alt=(word("cameras.picture"));
                figcaption { (local_time(view.unix_ms)) " · " (view.size_px[0]) "×" (view.size_px[1]) " px" }
            }
            table { tbody { @for (key, figure) in quality_values(view) { tr { th scope="row" { (word(key)) } td { (figure) } } } } }
        }
    }
}

/// Returns the quality values of a picture, which `panelprep shoot` reports as well.
fn quality_values(view: &CameraShot) -> Vec<(&'static str, String)> {
    let CameraShot { quality, conditions, .. } = view;
    let percent = |share: f64| format!("{} %", fixed_decimals(100.0 * share, 2));
    let of_camera = [
        conditions.exposure_us.map(|us| ("cameras.exposure", format!("{} ms", fixed_decimals(us / 1_000.0, 2)))),
        conditions.camera_c.map(|celsius| ("cameras.temperature", format!("{} °C", fixed_decimals(celsius, 1)))),
        conditions.throttled_ms.map(|ms| ("cameras.throttled", format!("{} ms", fixed_decimals(ms, 0)))),
    ];
    let of_picture = [
        ("cameras.saturated", percent(quality.saturated_share)),
        ("cameras.dark", percent(quality.dark_share)),
        ("cameras.mean", format!("{} / 255", fixed_decimals(quality.mean_gray, 0))),
        ("cameras.sharpness", format!("{} / px", fixed_decimals(quality.sharpness_gray_per_px, 1))),
    ];
    of_picture.into_iter().chain(of_camera.into_iter().flatten()).collect()
}

/// Serves the last picture of a camera.
pub(super) async fn picture(State(web): State<Arc<Web>>, Path(name): Path<String>) -> Response {
    match parse_camera(&name).and_then(|at| web.views.last_shot(at)) {
        Some(view) => ([(header::CONTENT_TYPE, "image/jpeg")], view.jpeg.clone()).into_response(),
        None => not_found_page().await,
    }
}

/// Captures a picture with a camera, if no cycle is running.
pub(super) async fn capture(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(name): Path<String>,
) -> Response {
    let Some(at) = parse_camera(&name) else { return not_found_page().await };
    let line = AuditEntry { subject: Some(name), ..entry(&visitor, "take a picture") };
    let taken = run_blocking(move || {
        let taken = take_shot(&web, at);
        let refused = taken.as_ref().err().map(|reason| reason.message.clone());
        web.audit(&AuditEntry { refused, ..line });
        taken
    });
    match taken.await {
        Some(Ok(())) => Json(json!({ "message": visitor.language().text("js.done") })).into_response(),
        Some(Err(reason)) => refusal(
            StatusCode::CONFLICT,
            &reason.code,
            &messages::text(visitor.language(), std::slice::from_ref(&reason)),
        ),
        None => panic_response(),
    }
}

/// Returns why no shot can be taken before the service has opened its cameras.
pub(super) fn not_opened_reason() -> Reason {
    Reason::new("not_now", "the service has not opened its cameras yet; check the state of the service")
}

fn take_shot(web: &Web, at: usize) -> Result<(), Reason> {
    let cameras = web.front.gateway.cameras.as_ref().ok_or_else(not_opened_reason)?;
    let taken = cameras.capture(CAMERA_EYES[at].2)?;
    let jpeg = encoded(&taken.picture).map_err(|problem| Reason::new("camera", problem))?;
    let view = CameraShot {
        jpeg,
        unix_ms: now_unix_ms(),
        size_px: [taken.picture.width, taken.picture.height],
        quality: PictureQuality::compute(&taken.picture),
        conditions: taken.conditions,
    };
    web.views.store(at, view);
    Ok(())
}

fn encoded(picture: &ColorPicture) -> Result<Vec<u8>, String> {
    let small = match picture.width > MAX_WIDTH_PX {
        true => &resize_to_width(picture, MAX_WIDTH_PX).map_err(|error| error.to_string())?,
        false => picture,
    };
    files::write_color_jpeg(small).map_err(|error| error.to_string())
}
