//! Lines of the audit trail about refused requests of logged-in people. If a page repeats such requests, only a few
//! lines are written, and one more that counts the others, so that requests that are not permitted do not keep the
//! disk busy.

use panelprep_cell::accounts::{AuditEntry, LineLimit, MaxLinesPerMinute};
use std::collections::BTreeMap;

/// Lines of one account in a minute; one more line counts the lines that are left out.
const LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 0, refused: 19 };

/// For each account whose requests were refused in this minute: its line limit and the last line.
#[derive(Debug, Default)]
pub(super) struct Refusals(BTreeMap<String, (LineLimit, AuditEntry)>);

impl Refusals {
    /// Returns whether this line of a refusal is written; if not, the line is counted.
    pub fn admit_line(&mut self, line: &AuditEntry, now_ms: u64) -> bool {
        let who = line.who.clone().unwrap_or_default();
        let (limit, last) = self.0.entry(who).or_insert_with(|| (LineLimit::new(LINES, now_ms), line.clone()));
        last.clone_from(line);
        limit.admit_line(true)
    }

    /// Returns, for the minutes that have passed, the lines that count the lines left out.
    pub fn take_elapsed_lines(&mut self, now_ms: u64) -> Vec<AuditEntry> {
        let mut counted = Vec::new();
        self.0.retain(|_, (limit, last)| {
            let is_over = limit.has_minute_elapsed(now_ms);
            if let Some(left_out) = limit.end_elapsed_minute(now_ms) {
                let refused =
                    format!("{left_out} further refused requests within one minute were not recorded individually");
                let AuditEntry { who, role, from, .. } = last.clone();
                counted.push(AuditEntry {
                    refused: Some(refused),
                    ..AuditEntry::for_completed_action(who, role, from, "flood")
                });
            }
            !is_over
        });
        counted
    }
}
