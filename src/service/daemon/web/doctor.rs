//! The state of the whole cell, as `panelprep doctor` reports it: each item from the bottom up, with its findings and
//! the remedy.

use super::guard::VisitorExtension;
use super::layout::Frame;
use super::page_texts::Language;
use super::reading::{Answer, panic_response};
use super::state::{Web, run_blocking};
use crate::daemon::sources::ExaminedItem;
use axum::Extension;
use axum::extract::State;
use maud::{Markup, html};
use std::sync::Arc;

/// Examines everything now, for one person at a time: it queries cameras, robot and disk.
pub(super) async fn page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let Ok(_turn) = web.examining.acquire().await else { return Err(panic_response()) };
    let source = web.front.setup.clone();
    let Some(examined) = run_blocking(move || source.examine_cell()).await else { return Err(panic_response()) };
    let words = visitor.language();
    let title = words.text("doctor.title");
    let frame = Frame { visitor: &visitor, title, here: "/setup", scripts: &[] };
    Ok(frame.page(&body(words, &examined)))
}

/// Shows the items that are not in order first, then the others, both in the order from the bottom up.
fn body(words: Language<'_>, examined: &[ExaminedItem]) -> Markup {
    let word = |key| words.text(key);
    let (right, wrong): (Vec<&ExaminedItem>, Vec<&ExaminedItem>) = examined.iter().partition(|one| one.is_right);
    html! {
        section.card {
            h2 { (word("doctor.title")) }
            p { (word("doctor.right")) ": " (right.len()) " / " (examined.len()) }
            p.links { a href="/setup/doctor" { (word("doctor.again")) } }
            @if !wrong.is_empty() { h3 { "✖ " (word("doctor.wrong")) } p.note { (word("doctor.uppermost")) } }
            @for one in &wrong {
                article.alarm.high {
                    h3 lang="en" { (one.name) }
                    p lang="en" { (one.found) }
                    @if !one.advice.is_empty() { p { strong { (word("alarms.remedy")) ": " } span lang="en" { (one.advice) } } }
                }
            }
            h3 { "✓ " (word("doctor.right")) }
            div.scroll tabindex="0" { table { tbody {
                @for one in &right { tr { th scope="row" lang="en" { (one.name) } td lang="en" { (one.found) } } }
            } } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;

    #[test]
    fn what_is_wrong_is_first_with_what_to_do() {
        let one = |name: &str, is_right, advice: &str| ExaminedItem {
            name: name.to_owned(),
            is_right,
            found: format!("{name} <found>"),
            advice: advice.to_owned(),
        };
        let examined = [one("disk", true, ""), one("robot", false, "look at its cable"), one("clock", true, "")];
        let words = Translations::read(None).expect("the program's own");
        let page = body(words.language(Some("en"), None), &examined).into_string();
        let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text} is missing: {page}"));
        assert!(
            at("robot &lt;found&gt;") < at("look at its cable") && at("look at its cable") < at("disk"),
            "{page}"
        );
        assert!(page.contains("2 / 3") && at("disk") < at("clock"), "{page}");
        let well = body(words.language(Some("de"), None), &examined[..1]).into_string();
        assert!(well.contains("1 / 1") && !well.contains("✖"), "{well}");
    }
}
