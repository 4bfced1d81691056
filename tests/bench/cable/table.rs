//! The results of the scenarios, counted by kind of fault.

use super::lie::Kind;
use std::collections::BTreeMap;
use std::fmt;

/// The result of one scenario.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Number of messages that were changed.
    pub sent: u64,
    pub verdicts: Vec<String>,
    pub pressed: u64,
    pub worst_stop_ms: Option<f64>,
    pub unnoticed: usize,
    pub violations: Vec<String>,
}

#[derive(Debug, Default)]
struct Row {
    scenarios: u64,
    not_sent: u64,
    sent: u64,
    pressed: u64,
    worst_stop_ms: f64,
    unnoticed: usize,
    violations: usize,
    verdicts: BTreeMap<String, u64>,
}

#[derive(Debug, Default)]
pub struct Table(BTreeMap<Kind, Row>);

impl Table {
    pub fn add(&mut self, kind: Kind, outcome: &Outcome) {
        let row = self.0.entry(kind).or_default();
        row.scenarios += 1;
        row.not_sent += u64::from(outcome.sent == 0);
        row.sent += outcome.sent;
        row.pressed += outcome.pressed;
        row.worst_stop_ms = row.worst_stop_ms.max(outcome.worst_stop_ms.unwrap_or(0.0));
        row.unnoticed += outcome.unnoticed;
        row.violations += outcome.violations.len();
        for verdict in &outcome.verdicts {
            *row.verdicts.entry(verdict.clone()).or_default() += 1;
        }
    }

    pub fn violations(&self) -> usize {
        self.0.values().map(|row| row.violations).sum()
    }

    pub fn scenarios(&self) -> u64 {
        self.sum().scenarios
    }

    /// Returns the longest duration of a stop, ms; 0 without a stop.
    pub fn worst_stop_ms(&self) -> f64 {
        self.sum().worst_stop_ms
    }

    fn sum(&self) -> Row {
        let mut sum = Row::default();
        for row in self.0.values() {
            sum.scenarios += row.scenarios;
            sum.not_sent += row.not_sent;
            sum.sent += row.sent;
            sum.pressed += row.pressed;
            sum.worst_stop_ms = sum.worst_stop_ms.max(row.worst_stop_ms);
            sum.unnoticed += row.unnoticed;
            sum.violations += row.violations;
            row.verdicts.iter().for_each(|(word, count)| *sum.verdicts.entry(word.clone()).or_default() += count);
        }
        sum
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:26} {:>9} {:>8} {:>7} {:>8} {:>13} {:>9} {:>10}  cycles by verdict",
            "kind of lie", "scenarios", "not sent", "sent", "pressed", "worst stop ms", "unnoticed", "violations"
        )?;
        let all = self.sum();
        let rows = self.0.iter().map(|(kind, row)| (kind.words(), row)).chain([("all", &all)]);
        for (words, row) in rows {
            let verdicts: Vec<String> =
                row.verdicts.iter().map(|(word, count)| format!("{word} {count}")).collect();
            writeln!(
                f,
                "{words:26} {:>9} {:>8} {:>7} {:>8} {:>13.0} {:>9} {:>10}  {}",
                row.scenarios,
                row.not_sent,
                row.sent,
                row.pressed,
                row.worst_stop_ms,
                row.unnoticed,
                row.violations,
                verdicts.join(", ")
            )?;
        }
        Ok(())
    }
}
