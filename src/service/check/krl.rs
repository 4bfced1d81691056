//! Programs and data lists of the controller: `.src`, `.sub`, `.dat`, checked as one program.

use super::report::FileReport;
use panelprep_base::config::Problem;
use panelprep_kuka::krl::{File, Kss, analyse, parse};
use std::collections::BTreeMap;

/// Maximum number of names that one warning lists.
const MAX_LISTED: usize = 12;

/// Returns whether this is the name of a KRL file.
pub fn is_krl(name: &str) -> bool {
    let name = name.to_lowercase();
    [".src", ".sub", ".dat"].iter().any(|ending| name.ends_with(ending))
}

/// Checks files, each with its index among all files, its name and its text, for this version of KSS, if it is
/// known.
pub(super) fn check_krl_files(files: &[(usize, &str, &str)], kss: Option<Kss>) -> Vec<(usize, FileReport)> {
    let read: Vec<File> = files.iter().map(|(_, name, text)| parse(name, text)).collect();
    let analysis = analyse(&read, kss);
    let found = analysis.problems.into_iter().zip(analysis.warnings).zip(analysis.unexecuted).zip(&read);
    let report = |(place, (((problems, warnings), unexecuted), file)): (usize, (((_, Vec<_>), Vec<_>), &File))| {
        let says = [file.sentence()].into_iter().chain(unexecuted_kinds(&unexecuted)).collect();
        (
            place,
            FileReport { kind: Some("KRL"), problems, warnings: merge_duplicates(warnings), descriptions: says },
        )
    };
    files.iter().map(|(place, ..)| *place).zip(found).map(report).collect()
}

/// Returns one warning in place of several that state the same about different names: at the line of the first, with
/// all names.
fn merge_duplicates(warnings: Vec<Problem>) -> Vec<Problem> {
    let mut all: BTreeMap<String, Vec<Problem>> = BTreeMap::new();
    for warning in warnings {
        all.entry(warning.message.clone()).or_default().push(warning);
    }
    let mut all: Vec<Problem> = all.into_values().map(merge_problems).collect();
    all.sort_by(|a, b| (a.line, &a.key).cmp(&(b.line, &b.key)));
    all
}

/// Combines at least one problem into one, in the order of the lines.
fn merge_problems(mut same: Vec<Problem>) -> Problem {
    let first = same.remove(0);
    if same.is_empty() {
        return first;
    }
    let others = same.iter().take(MAX_LISTED - 1).map(|other| format!("{} (line {})", other.key, other.line));
    let mut names: Vec<String> = [first.key].into_iter().chain(others).collect();
    if same.len() >= MAX_LISTED {
        names.push(format!("{} more", same.len() + 1 - MAX_LISTED));
    }
    Problem { line: first.line, key: names.join(", "), message: first.message }
}

/// Returns the kinds of statements that were read and checked but are not executed by a rehearsal, each with its
/// lines; only the first ones if there are many.
fn unexecuted_kinds(unexecuted: &[Problem]) -> Option<String> {
    let mut lines: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for place in unexecuted {
        lines.entry(&place.key).or_default().push(place.line);
    }
    let mut each: Vec<(usize, String)> = Vec::new();
    for (what, mut of) in lines {
        of.dedup();
        let more = if of.len() > 3 { format!(" and {} more", of.len() - 3) } else { String::new() };
        let first: Vec<String> = of.iter().take(3).map(usize::to_string).collect();
        each.push((of.len(), format!("{what} (line {}{more})", first.join(", "))));
    }
    // The most frequent kind comes first.
    each.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let rest = each.len().saturating_sub(MAX_LISTED);
    let mut each: Vec<String> = each.into_iter().take(MAX_LISTED).map(|(_, words)| words).collect();
    if rest > 0 {
        each.push(format!("{rest} more"));
    }
    (!each.is_empty()).then(|| format!("checked, not executed by `mock-robot --programs`: {}", each.join("; ")))
}
