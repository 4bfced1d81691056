//! The alarms of the newest cycles as a list, and their acknowledgement.

use super::answers::{Answer, DownloadFormat, panic_response, read_store};
use super::guard::{VisitorExtension, refusal};
use super::layout::{Frame, Script, local_time};
use super::page_texts::Language;
use super::state::{Web, entry, run_blocking};
use super::{answers, messages};
use crate::daemon::alarms;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_cell::accounts::{AuditEntry, Permission};
use panelprep_cell::record::CycleId;
use panelprep_store::history::{Alarm, Priority, alarm_table};
use panelprep_store::store::StoreError;
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;

pub(super) async fn page(state: State<Arc<Web>>, by: VisitorExtension) -> Answer {
    list_alarms(state, by, DownloadFormat::Page).await
}

pub(super) async fn csv(state: State<Arc<Web>>, by: VisitorExtension) -> Answer {
    list_alarms(state, by, DownloadFormat::Csv).await
}

pub(super) async fn json(state: State<Arc<Web>>, by: VisitorExtension) -> Answer {
    list_alarms(state, by, DownloadFormat::Json).await
}

async fn list_alarms(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    as_what: DownloadFormat,
) -> Answer {
    let shared = web.clone();
    let alarms = read_store(&web, &visitor, move |store| shared.front.alarms.all_from_store(store)).await?;
    Ok(match as_what {
        DownloadFormat::Page => {
            let words = visitor.language();
            let frame = Frame {
                visitor: &visitor,
                title: words.text("alarms.title"),
                here: "/alarms",
                scripts: &[Script::Forms],
            };
            frame.page(&body(words, &alarms, visitor.has_permission(Permission::Acknowledge)))
        }
        DownloadFormat::Csv => answers::csv(&visitor, "alarms", &alarm_table(&alarms)),
        DownloadFormat::Json => answers::json(&json!({ "alarms": alarms })),
    })
}

fn body(words: Language<'_>, alarms: &[Alarm], may_acknowledge: bool) -> Markup {
    let word = |key| words.text(key);
    html! {
        section.card {
            h2 { (word("alarms.title")) }
            p.note { (word("alarms.help")) }
            p.links { a href="/alarms.csv" { "CSV" } " · " a href="/alarms.json" { "JSON" } }
            @if alarms.is_empty() { p { (word("alarms.none")) } }
            @for alarm in alarms { (show_alarm(words, alarm, may_acknowledge)) }
        }
    }
}

/// Returns the key of the word for a priority; the words have symbols, so that they are understood without colour.
fn priority_key(priority: Priority) -> &'static str {
    match priority {
        Priority::High => "alarms.priority.high",
        Priority::Medium => "alarms.priority.medium",
        Priority::Low => "alarms.priority.low",
        Priority::Note => "alarms.priority.note",
    }
}

fn show_alarm(words: Language<'_>, alarm: &Alarm, may_acknowledge: bool) -> Markup {
    let word = |key| words.text(key);
    let class = format!("alarm {}{}", alarm.priority.keyword(), if alarm.is_active() { " is-active" } else { "" });
    html! {
        article class=(class) {
            h3 { (alarm.code) " – " (word(priority_key(alarm.priority))) @if alarm.is_active() { ", " (word("alarms.active")) } }
            p {
                (word("alarms.raised")) " " (local_time(alarm.raised_unix_ms))
                @if let Some(gone) = alarm.gone_unix_ms { " · " (word("alarms.gone")) " " (local_time(gone)) }
                @match alarm.cycle {
                    Some(cycle) => { " · " a href={ "/cycle/" (cycle) } { (word("run.cycle")) " " (cycle) } },
                    None => { " · " (word("alarms.between")) },
                }
                @if let Some(kind) = alarm.phase { " · " (kind.keyword()) }
            }
            (messages::explain_code(words, &alarm.code, &[&alarm.message]))
            @match &alarm.acknowledged {
                Some(seen) => p { "✓ " (word("alarms.acknowledged")) ": " (seen.who) ", " (local_time(seen.unix_ms)) },
                None if may_acknowledge && alarm.priority > Priority::Note => form data-post="/alarms/acknowledge" data-then="/alarms" {
                    input type="hidden" name="cycle" value=[alarm.cycle];
                    input type="hidden" name="code" value=(alarm.code);
                    input type="hidden" name="raised_unix_ms" value=(alarm.raised_unix_ms);
                    button.plain type="submit" { (word("alarms.acknowledge")) }
                    p.told role="status" {}
                },
                None => {},
            }
        }
    }
}

/// The alarm that a person acknowledges; a form sends its fields as texts.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AcknowledgeForm {
    cycle: String,
    code: String,
    raised_unix_ms: String,
}

/// Records that the person has acknowledged an alarm, and adds this to the audit trail.
pub(super) async fn acknowledge(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(form): Json<AcknowledgeForm>,
) -> Response {
    let line = entry(&visitor, "acknowledge alarm");
    let person = visitor.person.as_ref();
    let who = person.map_or(String::new(), |person| format!("{} ({})", person.printed_name, person.name));
    match run_blocking(move || store_acknowledgement(&web, line, &form, who)).await {
        Some(Ok(true)) => Json(json!({ "message": visitor.language().text("saved") })).into_response(),
        Some(Ok(false)) => refusal(StatusCode::CONFLICT, "alarm", visitor.language().text("alarms.no_such")),
        Some(Err(error)) => refusal(StatusCode::SERVICE_UNAVAILABLE, "store", &error.to_string()),
        None => panic_response(),
    }
}

/// Stores an acknowledgement; returns false if the alarm does not exist, or was already acknowledged.
fn store_acknowledgement(
    web: &Web,
    line: AuditEntry,
    form: &AcknowledgeForm,
    who: String,
) -> Result<bool, StoreError> {
    let Ok(raised_unix_ms) = form.raised_unix_ms.parse() else { return Ok(false) };
    // An alarm between cycles names no cycle.
    let cycle = match form.cycle.as_str() {
        "" => None,
        number => match number.parse() {
            Ok(number) => Some(CycleId(number)),
            Err(_) => return Ok(false),
        },
    };
    let alarm = alarms::AlarmId { cycle, code: form.code.clone(), raised_unix_ms };
    web.front.alarms.acknowledge(&alarm, who, line)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;
    use panelprep_store::history::Acknowledgement;

    fn alarm(gone_unix_ms: Option<i64>) -> Alarm {
        Alarm {
            cycle: Some(CycleId(3)),
            code: "low_overlap".to_owned(),
            priority: Priority::Medium,
            message: "85 % <b>".to_owned(),
            cause: "Too little.".to_owned(),
            remedy: "Remove it.".to_owned(),
            phase: None,
            raised_unix_ms: 5_000,
            gone_unix_ms,
            acknowledged: None,
        }
    }

    #[test]
    fn an_alarm_states_its_cause_and_can_be_acknowledged_with_permission() {
        let words = Translations::read(None).expect("the program's own");
        let html = |alarm: &Alarm, may| {
            body(words.language(Some("en"), None), std::slice::from_ref(alarm), may).into_string()
        };
        let active = html(&alarm(None), true);
        assert!(
            active.contains("!! medium, active")
                && active.contains("85 % &lt;b&gt;")
                && active.contains("Remove objects in front of the panel")
        );
        assert!(
            active.contains("name=\"raised_unix_ms\" value=\"5000\"")
                && active.contains("class=\"alarm medium is-active\"")
        );
        assert!(!html(&alarm(None), false).contains("<form"), "a viewer only looks");
        let seen = Acknowledgement {
            unix_ms: 9_000,
            cycle: Some(CycleId(3)),
            code: "low_overlap".to_owned(),
            raised_unix_ms: 5_000,
            who: "Ada".to_owned(),
        };
        let reported = html(&Alarm { acknowledged: Some(seen), ..alarm(Some(6_000)) }, true);
        assert!(
            reported.contains("Acknowledged: Ada")
                && !reported.contains("<form")
                && !reported.contains("is-active"),
            "{reported}"
        );
        assert!(!html(&Alarm { priority: Priority::Note, ..alarm(None) }, true).contains("<form"));
    }
}
