//! The versions of a recipe: who approved each version, when and why, and what it changed, line by line. The
//! versions come from the audit trail.

use super::layout::local_time;
use super::page_texts::Language;
use crate::store::NumberedEntry;
use maud::{Markup, html};
use similar::{ChangeTag, TextDiff};

/// The name of a recipe's change in the audit trail.
pub(super) const RECIPE_CHANGE: &str = "change recipe";

/// Returns the subject in the audit trail for a change of this recipe, with its reason.
pub(super) fn subject(name: &str, why: &str) -> String {
    format!("{name}: {why}")
}

/// Shows the versions, each with its difference from the previous one.
pub(super) fn show_versions(words: Language<'_>, name: &str, versions: &[NumberedEntry]) -> Markup {
    let beginning = subject(name, "");
    let word = |key| words.text(key);
    html! {
        h3 { (word("setup.versions")) }
        @if versions.is_empty() { p { (word("setup.no_versions")) } }
        @for NumberedEntry { entry, .. } in versions {
            details {
                summary {
                    (local_time(entry.unix_ms)) " · " (entry.who.as_deref().unwrap_or("–")) " · "
                    (entry.subject.as_deref().and_then(|subject| subject.strip_prefix(&beginning)).unwrap_or(""))
                }
                (difference(entry.before.as_deref().unwrap_or(""), entry.after.as_deref().unwrap_or("")))
            }
        }
    }
}

/// Shows the lines that were removed and added, with one unchanged line around them.
pub(in crate::daemon) fn difference(before: &str, after: &str) -> Markup {
    let difference = TextDiff::from_lines(before, after);
    html! {
        pre.scroll tabindex="0" {
            @for group in difference.grouped_ops(1) {
                @for change in group.iter().flat_map(|operation| difference.iter_changes(operation)) {
                    @match change.tag() {
                        ChangeTag::Equal => { "  " (change.value()) }
                        ChangeTag::Delete => del { "− " (change.value()) },
                        ChangeTag::Insert => ins { "+ " (change.value()) },
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accounts::AuditEntry;
    use crate::daemon::web::page_texts::Translations;

    #[test]
    fn a_version_shows_who_and_why_and_its_lines() {
        let entry = AuditEntry {
            unix_ms: 1_000,
            who: Some("eva".to_owned()),
            role: None,
            from: "10.0.0.1".to_owned(),
            what: RECIPE_CHANGE.to_owned(),
            subject: Some(subject("door.toml", "more rows")),
            before: Some("panel = \"a\"\nrows = 3\ncolumns = 6\n".to_owned()),
            after: Some("panel = \"a\"\nrows = 4 # <b>\ncolumns = 6\n".to_owned()),
            refused: None,
        };
        let words = Translations::read(None).expect("the program's own");
        let versions = [NumberedEntry { number: 5, entry }];
        let page = show_versions(words.language(None, None), "door.toml", &versions).into_string();
        assert!(page.contains("eva · more rows"), "{page}");
        assert!(page.contains("<del>− rows = 3\n</del><ins>+ rows = 4 # &lt;b&gt;\n</ins>"), "{page}");
    }
}
