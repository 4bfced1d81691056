//! Programs and data lists of the controller: `.src`, `.sub`, `.dat`, checked as one program.

use super::report::FileReport;
use crate::krl::{File, Kss, analyse, parse};

/// Whether this is the name of a KRL file.
pub(super) fn is_krl(name: &str) -> bool {
    let name = name.to_lowercase();
    [".src", ".sub", ".dat"].iter().any(|ending| name.ends_with(ending))
}

/// Checks files, each with its place among all, its name and its text, for this version of KSS.
pub(super) fn check(files: &[(usize, &str, &str)], kss: Kss) -> Vec<(usize, FileReport)> {
    let (read, unreadable): (Vec<File>, Vec<_>) = files.iter().map(|(_, name, text)| parse(name, text)).unzip();
    let analysis = analyse(&read, kss);
    let found = analysis.problems.into_iter().zip(analysis.warnings).zip(unreadable).zip(&read);
    let mut reports = Vec::new();
    for ((place, ..), (((problems, warnings), mut all), file)) in files.iter().zip(found) {
        all.extend(problems);
        all.sort_by_key(|problem| problem.line);
        reports
            .push((*place, FileReport { kind: Some("KRL"), problems: all, warnings, says: vec![file.sentence()] }));
    }
    reports
}
