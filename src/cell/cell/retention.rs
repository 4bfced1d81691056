//! `store`: the folder of the stored data, and how long clips and scans are kept in it.

use panelprep_base::config::Section;

/// The time for which clips and scans of a class of cycles are kept; an absent value sets no limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RetentionTime {
    /// Number of days before the newest cycle's end.
    pub days: Option<usize>,
    /// Number of newest cycles.
    pub cycles: Option<usize>,
}

/// `[store.keep]`: how long clips and scans are kept. Pages, records and taught data are kept for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Retention {
    /// The limit for cycles that passed.
    pub passed: RetentionTime,
    /// The limit for cycles that ended otherwise.
    pub failed: RetentionTime,
}

impl Retention {
    /// Returns whether no file is ever removed.
    pub fn is_unlimited(&self) -> bool {
        *self == Retention::default()
    }
}

const DAYS: std::ops::RangeInclusive<usize> = 1..=36_500;
const CYCLES: std::ops::RangeInclusive<usize> = 1..=1_000_000;

/// `[store]`.
pub(super) struct StoreTable {
    /// Its folder.
    pub folder: String,
    /// How long clips and scans are kept.
    pub retention: Retention,
    /// The file of the key that signs records; `None` if the key is in the folder.
    pub record_key: Option<String>,
}

/// Reads `store = "folder"`, or `[store]` with `folder`, `record_key` and `keep`.
pub(super) fn parse_store(top: &Section<'_, '_>) -> Option<StoreTable> {
    let default = || Some("store".to_owned());
    if !top.is_table("store") {
        let folder = top.parse::<String>("store", (), default())?;
        return Some(StoreTable { folder, retention: Retention::default(), record_key: None });
    }
    let section = top.section("store");
    let folder = section.parse::<String>("folder", (), default());
    let record_key = section.parse::<Option<String>>("record_key", (), Some(None));
    let keep = parse_retention(&section.section("keep"));
    section.finish();
    Some(StoreTable { folder: folder?, retention: keep?, record_key: record_key? })
}

fn parse_retention(section: &Section<'_, '_>) -> Option<Retention> {
    let [days, failed_days] =
        ["days", "failed_days"].map(|key| section.parse::<Option<usize>>(key, DAYS, Some(None)));
    let [cycles, failed_cycles] =
        ["cycles", "failed_cycles"].map(|key| section.parse::<Option<usize>>(key, CYCLES, Some(None)));
    section.finish();
    let passed = RetentionTime { days: days?, cycles: cycles? };
    let failed = RetentionTime { days: failed_days?, cycles: failed_cycles? };
    let mut right = true;
    for (key, of, min) in
        [("failed_days", failed.days, passed.days), ("failed_cycles", failed.cycles, passed.cycles)]
    {
        if let (Some(found), Some(min)) = (of, min)
            && found < min
        {
            let name = key.trim_start_matches("failed_");
            section.problem(
                key,
                format!(
                    "found {found}, the minimum is {min}, the value of {name}: the data of failed cycles must be \
                     kept at least as long"
                ),
            );
            right = false;
        }
    }
    right.then_some(Retention { passed, failed })
}
