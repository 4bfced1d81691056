//! The program's messages in a person's language: what a code means and what to do, beside the English sentence with
//! its values.

use super::answers::Answer;
use super::guard::{VisitorExtension, not_found_page};
use super::page_texts::Language;
use axum::extract::Path;
use axum::response::IntoResponse;
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_base::verdict::Reason;
use serde_json::json;

/// Returns the short line of a code, its meaning and the remedy, in the visitor's language.
pub(super) async fn json(Extension(visitor): VisitorExtension, Path(code): Path<String>) -> Answer {
    let words = visitor.language();
    match words.message(&code) {
        Some((cause, remedy)) => {
            let told = json!({ "short": words.short(&code), "cause": cause, "remedy": remedy });
            Ok(Json(told).into_response())
        }
        None => Err(not_found_page().await),
    }
}

/// Returns the reasons as one text, each preceded by its explanation in the person's language.
pub(super) fn text(words: Language<'_>, reasons: &[Reason]) -> String {
    let one = |reason: &Reason| match words.message(&reason.code).filter(|_| !words.is_english()) {
        Some((cause, remedy)) => format!("{cause} {remedy} ({})", reason.message),
        None => reason.message.clone(),
    };
    reasons.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// Shows reasons grouped by their codes: the meaning of each code and the remedy are shown once, next to all messages
/// with this code.
pub(super) fn show_by_code(words: Language<'_>, reasons: &[Reason]) -> Markup {
    let mut codes: Vec<(&str, Vec<&str>)> = Vec::new();
    for reason in reasons {
        match codes.iter_mut().find(|(code, _)| *code == reason.code) {
            Some((_, messages)) => messages.push(&reason.message),
            None => codes.push((&reason.code, vec![&reason.message])),
        }
    }
    html! { ul { @for (code, messages) in &codes { li { (explain_code(words, code, messages)) } } } }
}

/// Shows the short line of a code, its messages, its cause and the remedy. In English the messages come before the
/// cause; in other languages the cause and the remedy come first.
pub(super) fn explain_code(words: Language<'_>, code: &str, messages: &[&str]) -> Markup {
    let remedy = |remedy| html! { p { strong { (words.text("alarms.remedy")) ": " } (markup_with_code(remedy)) } };
    let sentences = html! { @for message in messages { p lang="en" { (markup_with_code(message)) " " small { "(" (code) ")" } } } };
    let short = html! { @if let Some(short) = words.short(code) { p { strong { (short) } } } };
    match words.message(code) {
        Some((cause, what)) if words.is_english() => html! {
            (short)
            (sentences)
            details { summary { (words.text("alarms.cause")) " · " (words.text("alarms.remedy")) } p { (markup_with_code(cause)) } (remedy(what)) }
        },
        Some((cause, what)) => html! { (short) p { (markup_with_code(cause)) } (remedy(what)) (sentences) },
        None => sentences,
    }
}

/// Shows a text in which the parts between backticks are formatted as code.
fn markup_with_code(text: &str) -> Markup {
    html! {
        @for (at, part) in text.split('`').enumerate() {
            @if at % 2 == 1 { code lang="en" { (part) } } @else { (part) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::web::page_texts::Translations;

    #[test]
    fn a_message_is_in_the_persons_language_with_the_values_beside_it() {
        let words = Translations::read(None).expect("the program's own");
        let reason = Reason::new("shift_limit", "moved 80 mm, allowed < 60 mm");
        let (english, german) = (words.language(Some("en"), None), words.language(Some("de"), None));
        let (cause, _) = german.message("shift_limit").expect("a row");
        assert_eq!(text(english, std::slice::from_ref(&reason)), "moved 80 mm, allowed < 60 mm");
        let told = text(german, &[reason, Reason::new("no_such_code", "odd")]);
        assert!(told.starts_with(cause) && told.ends_with(" (moved 80 mm, allowed < 60 mm); odd"), "{told}");
        let page = |words| explain_code(words, "shift_limit", &["moved 80 mm, allowed < 60 mm"]).into_string();
        let at = |page: &str, text: &str| page.find(text).unwrap_or_else(|| panic!("{text}: {page}"));
        let (english, german) = (page(english), page(german));
        assert!(
            at(&english, "moved 80 mm, allowed &lt; 60 mm") < at(&english, "farther from its nominal position")
        );
        assert!(
            at(&german, "Abhilfe") < at(&german, "moved 80 mm") && german.contains("<code lang=\"en\">[locate]")
        );
        let two = [("a", "1"), ("b", "2"), ("a", "3")].map(|(code, message)| Reason::new(code, message));
        let listed = show_by_code(words.language(Some("de"), None), &two).into_string();
        assert!(listed.matches("<li>").count() == 2 && at(&listed, ">3 ") < at(&listed, ">2 "), "{listed}");
        assert!(!english.contains('`') && !german.contains('`'));
        assert!(
            explain_code(words.language(Some("de"), None), "no_such_code", &["odd"]).into_string().contains("odd")
        );
    }
}
