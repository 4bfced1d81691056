//! The violations and counts of a world.

use std::collections::BTreeMap;

/// A violated requirement, and the check that found it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    /// The name of the check; two violations with the same check are treated as the same violation.
    pub judge: &'static str,
    /// Description of the violation.
    pub what: String,
}

/// The counts of a world.
#[derive(Debug, Clone, Default)]
pub struct Counts {
    /// Number of injected faults, by kind and by state of the state machine.
    pub faults: BTreeMap<(&'static str, &'static str), u64>,
    /// Number of executions of each check.
    pub judged: BTreeMap<&'static str, u64>,
    /// Number of visits to each state of the state machine.
    pub places: BTreeMap<&'static str, u64>,
    /// Verdicts.
    pub verdicts: BTreeMap<&'static str, u64>,
    /// Cycles that began.
    pub cycles: u64,
    /// Number of processes that were started.
    pub lives: u64,
    /// Power cuts.
    pub cuts: u64,
    /// Number of simulated power failures: the program was started on the resulting files, and the world continued.
    pub imagined_cuts: u64,
    /// Number of kills of the process.
    pub kills: u64,
    /// Number of times a person jogged the arm away from an unknown position.
    pub jogs: u64,
    /// Number of backups of the store; `restores` is the number of restores.
    pub backups: u64,
    pub restores: u64,
    /// Virtual time, ms.
    pub time_ms: u64,
}

impl Counts {
    /// Adds the counts of another world.
    pub fn add(&mut self, other: &Counts) {
        other.faults.iter().for_each(|(key, count)| *self.faults.entry(*key).or_default() += count);
        other.judged.iter().for_each(|(key, count)| *self.judged.entry(key).or_default() += count);
        other.places.iter().for_each(|(key, count)| *self.places.entry(key).or_default() += count);
        other.verdicts.iter().for_each(|(key, count)| *self.verdicts.entry(key).or_default() += count);
        self.jogs += other.jogs;
        self.cycles += other.cycles;
        self.lives += other.lives;
        self.cuts += other.cuts;
        self.imagined_cuts += other.imagined_cuts;
        self.kills += other.kills;
        self.backups += other.backups;
        self.restores += other.restores;
        self.time_ms += other.time_ms;
    }

    /// Counts one more execution of this check.
    pub fn judged(&mut self, judge: &'static str) {
        *self.judged.entry(judge).or_default() += 1;
    }
}
