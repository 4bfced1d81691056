//! The report on one file.

use panelprep_base::config::Problem;

/// The kind that is checked against a cell.
pub(super) const RECIPE: &str = "recipe";

/// The result of the check of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct FileReport {
    /// The kind of the file; `None` if it is not clear.
    pub kind: Option<&'static str>,
    /// Problems of the file, in the order of the lines.
    pub problems: Vec<Problem>,
    /// Properties that are allowed but lead to problems, in the order of the lines.
    pub warnings: Vec<Problem>,
    /// Content of the file as understood, one sentence each; empty if one of this program's own files cannot be
    /// understood.
    pub descriptions: Vec<String>,
}

/// Returns the indices of the files of this kind.
pub(super) fn reports_of_kind(kind: &'static str, reports: &[FileReport]) -> Vec<usize> {
    (0..reports.len()).filter(|place| reports[*place].kind == Some(kind)).collect()
}
