//! The program's messages in a person's language: what a code means and what to do, beside the English sentence with its values.

use super::guard::{By, not_found};
use super::reading::Answer;
use super::words::Language;
use crate::verdict::Reason;
use axum::extract::Path;
use axum::response::IntoResponse;
use axum::{Extension, Json};
use maud::{Markup, html};
use serde_json::json;

/// What a code means and what to do, in the visitor's language.
pub(super) async fn json(Extension(visitor): By, Path(code): Path<String>) -> Answer {
    match visitor.language().message(&code) {
        Some((cause, remedy)) => Ok(Json(json!({ "cause": cause, "remedy": remedy })).into_response()),
        None => Err(not_found().await),
    }
}

/// Reasons as one text, each in the person's language first.
pub(super) fn text(words: Language<'_>, reasons: &[Reason]) -> String {
    let one = |reason: &Reason| match words.message(&reason.code).filter(|_| !words.is_of_the_program()) {
        Some((cause, remedy)) => format!("{cause} {remedy} ({})", reason.message),
        None => reason.message.clone(),
    };
    reasons.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// One message: its sentence and what the code means, in the order in which the person reads them, and what to do.
pub(super) fn explained(words: Language<'_>, code: &str, message: &str) -> Markup {
    let remedy = |remedy| html! { p { strong { (words.word("alarms.remedy")) ": " } (prose(remedy)) } };
    let sentence = html! { p lang="en" { (prose(message)) " " small { "(" (code) ")" } } };
    match words.message(code) {
        Some((cause, what)) if words.is_of_the_program() => html! {
            (sentence)
            details { summary { (words.word("alarms.cause")) " · " (words.word("alarms.remedy")) } p { (prose(cause)) } (remedy(what)) }
        },
        Some((cause, what)) => html! { p { (prose(cause)) } (remedy(what)) (sentence) },
        None => sentence,
    }
}

/// A text in which what stands between backticks is set as code.
fn prose(text: &str) -> Markup {
    html! {
        @for (at, part) in text.split('`').enumerate() {
            @if at % 2 == 1 { code lang="en" { (part) } } @else { (part) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::words::Words;

    #[test]
    fn a_message_stands_in_the_persons_language_with_the_values_beside_it() {
        let words = Words::read(None).expect("the program's own");
        let reason = Reason::new("shift_limit", "moved 80 mm, allowed < 60 mm");
        let (english, german) = (words.language(Some("en"), None), words.language(Some("de"), None));
        let (cause, _) = german.message("shift_limit").expect("a row");
        assert_eq!(text(english, std::slice::from_ref(&reason)), "moved 80 mm, allowed < 60 mm");
        let told = text(german, &[reason, Reason::new("no_such_code", "odd")]);
        assert!(told.starts_with(cause) && told.ends_with(" (moved 80 mm, allowed < 60 mm); odd"), "{told}");
        let page = |words| explained(words, "shift_limit", "moved 80 mm, allowed < 60 mm").into_string();
        let at = |page: &str, text: &str| page.find(text).unwrap_or_else(|| panic!("{text}: {page}"));
        let (english, german) = (page(english), page(german));
        assert!(at(&english, "moved 80 mm, allowed &lt; 60 mm") < at(&english, "farther from its nominal place"));
        assert!(
            at(&german, "Was zu tun ist") < at(&german, "moved 80 mm")
                && german.contains("<code lang=\"en\">[locate]")
        );
        assert!(!english.contains('`') && !german.contains('`'));
        assert!(explained(words.language(Some("de"), None), "no_such_code", "odd").into_string().contains("odd"));
    }
}
