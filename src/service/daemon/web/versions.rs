//! The versions of a recipe: who approved each version, when and why, and what it changed, line by line. The versions
//! are read from the audit trail.

use super::layout::local_time;
use super::page_texts::Language;
use maud::{Markup, html};
use panelprep_base::number_text::utc_text;
use panelprep_cell::accounts::AuditEntry;
use panelprep_store::store::NumberedEntry;
use similar::{ChangeTag, TextDiff};

/// The name of a recipe change in the audit trail.
pub(super) use panelprep_cell::accounts::RECIPE_CHANGE;

/// Returns the subject of the audit trail's entry for a change of this recipe, with its reason.
pub(super) fn audit_subject(name: &str, why: &str) -> String {
    format!("{name}: {why}")
}

/// Returns the removal limit in a recipe text, µm; `None` if the text contains none or is not TOML.
fn removal_limit_um(text: &str) -> Option<f64> {
    let recipe: toml::Table = text.parse().ok()?;
    let limit = recipe.get("removal")?.get("max_um")?;
    limit.as_float().or_else(|| limit.as_integer().map(|um| um as f64))
}

/// Returns the removal limit, µm, that is in the text before a change and not in the text after it.
pub(super) fn removed_limit_um(before: &str, after: &str) -> Option<f64> {
    removal_limit_um(before).filter(|_| removal_limit_um(after).is_none())
}

/// Returns the warning that a change deleted the removal limit: the limit, who approved the change, and when.
pub(super) fn removed_limit_warning(words: Language<'_>, limit_um: f64, entry: &AuditEntry) -> String {
    let who = entry.who.as_deref().unwrap_or("–");
    let when = utc_text(entry.unix_ms.div_euclid(1_000));
    format!("{} {limit_um} µm ({who}, {when})", words.text("setup.limit_removed"))
}

fn text_of(entry: &AuditEntry) -> (&str, &str) {
    (entry.before.as_deref().unwrap_or(""), entry.after.as_deref().unwrap_or(""))
}

/// Returns whether a version (the newest first) began with the text with which the previous version ended. The first
/// version has no previous one, but its former text is stored.
fn follows_predecessor(versions: &[NumberedEntry], index: usize) -> bool {
    let before = versions[index].entry.before.as_deref();
    match versions.get(index + 1) {
        Some(older) => before.is_some() && before == older.entry.after.as_deref(),
        None => before.is_some(),
    }
}

/// Shows the problems of the whole history: the present text is not that of the newest version, or a deleted removal
/// limit is still missing.
pub(super) fn show_warnings(words: Language<'_>, present: &str, versions: &[NumberedEntry]) -> Markup {
    let is_newest = versions.first().is_none_or(|newest| newest.entry.after.as_deref() == Some(present));
    let removed = versions.iter().find_map(|NumberedEntry { entry, .. }| {
        let (before, after) = text_of(entry);
        Some(removed_limit_warning(words, removed_limit_um(before, after)?, entry))
    });
    let removed = removed.filter(|_| removal_limit_um(present).is_none());
    html! {
        @if !is_newest { p.told.bad { (words.text("setup.changed_outside")) } }
        @if let Some(warning) = removed { p.told.bad { (warning) } }
    }
}

/// Shows the versions, each with its difference from the previous one. A version whose former text is not the text of
/// the previous version is marked: the recipe was changed without the page, or an entry of the audit trail is missing.
pub(super) fn show_versions(words: Language<'_>, name: &str, versions: &[NumberedEntry]) -> Markup {
    let beginning = audit_subject(name, "");
    let word = |key| words.text(key);
    html! {
        h3 { (word("setup.versions")) }
        @if versions.is_empty() { p { (word("setup.no_versions")) } }
        @for (index, NumberedEntry { entry, .. }) in versions.iter().enumerate() {
            @if !follows_predecessor(versions, index) { p.told.bad { (word("setup.chain_broken")) " " (local_time(entry.unix_ms)) } }
            details {
                summary {
                    (local_time(entry.unix_ms)) " · " (entry.who.as_deref().unwrap_or("–")) " · "
                    (entry.subject.as_deref().and_then(|subject| subject.strip_prefix(&beginning)).unwrap_or(""))
                }
                (show_difference(entry.before.as_deref().unwrap_or(""), entry.after.as_deref().unwrap_or("")))
            }
        }
    }
}

/// Shows the deleted and added lines, with one unchanged line before and after them.
pub(in crate::daemon) fn show_difference(before: &str, after: &str) -> Markup {
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
    use crate::daemon::web::page_texts::Translations;

    fn version(unix_ms: i64, before: Option<&str>, after: &str) -> NumberedEntry {
        let line =
            AuditEntry::for_completed_action(Some("eva".to_owned()), None, "10.0.0.1".to_owned(), RECIPE_CHANGE);
        let (before, after) = (before.map(str::to_owned), Some(after.to_owned()));
        let entry = AuditEntry { unix_ms, subject: Some(audit_subject("door.toml", "why")), before, after, ..line };
        NumberedEntry { number: unix_ms, entry }
    }

    /// Each text must begin with the text of its predecessor: a change without the page, and a missing entry of the
    /// audit trail, are reported.
    #[test]
    fn a_gap_in_the_chain_of_texts_is_reported() {
        let words = Translations::read(None).expect("the program's own");
        let words = words.language(None, None);
        let breaks = |versions: &[NumberedEntry]| {
            show_versions(words, "door.toml", versions)
                .into_string()
                .matches(words.text("setup.chain_broken"))
                .count()
        };
        let warned = |present, versions: &[NumberedEntry]| {
            show_warnings(words, present, versions).into_string().contains(words.text("setup.changed_outside"))
        };
        let all = [version(3, Some("c"), "d"), version(2, Some("b"), "c"), version(1, Some("a"), "b")];
        assert_eq!((breaks(&all), warned("d", &all), warned("x", &all)), (0, false, true));
        assert_eq!(breaks(&[all[0].clone(), all[2].clone()]), 1, "the line between them is missing");
        assert_eq!(breaks(&[version(3, Some("x"), "d"), all[1].clone()]), 1, "changed beside the page");
        assert_eq!(breaks(&[version(3, None, "d")]), 1, "its predecessor is not stored");
        assert!(!warned("anything", &[]));
    }

    #[test]
    fn a_removed_removal_limit_is_reported_until_it_is_restored() {
        let (with, without) = ("[removal]\ntarget_um = 12\nmax_um = 25\n", "[removal]\ntarget_um = 12\n");
        assert_eq!(removed_limit_um(with, without), Some(25.0));
        assert_eq!(removed_limit_um(with, "rows = 1\n"), Some(25.0), "with its whole table");
        assert_eq!(removed_limit_um(without, with), None);
        assert_eq!(removed_limit_um(with, "[removal]\nmax_um = 90.5\n"), None, "another limit is one");
        let words = Translations::read(None).expect("the program's own");
        let words = words.language(None, None);
        let shown = |present| show_warnings(words, present, &[version(1_000, Some(with), without)]).into_string();
        assert!(shown(without).contains("25 µm (eva, 1970-01-01"), "{}", shown(without));
        assert!(!shown(with).contains("25 µm"));
    }

    #[test]
    fn a_version_shows_who_and_why_and_its_lines() {
        let entry = AuditEntry {
            unix_ms: 1_000,
            who: Some("eva".to_owned()),
            role: None,
            from: "10.0.0.1".to_owned(),
            what: RECIPE_CHANGE.to_owned(),
            subject: Some(audit_subject("door.toml", "more rows")),
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
