//! Describes what a cycle did to the panel: which grids it abraded, and how much it removed.

use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::record::{self, AbradedGrid, CycleRecord, PathRemoval};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Describes each grid with the passes that touched it; unknown facts are marked as such.
pub fn describe_grids(record: &CycleRecord) -> Vec<String> {
    let mut passes: BTreeMap<(String, u8), bool> = BTreeMap::new();
    for AbradedGrid { grid, pass, how } in record::abraded_grids(&record.findings, &record.motions) {
        let grid = grid.unwrap_or_else(|| "any grid".to_owned());
        *passes.entry((grid, pass)).or_default() |= how.is_certain();
    }
    let mut grids: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for ((grid, _), is_sure) in &passes {
        grids.entry(grid).or_default()[usize::from(!is_sure)] += 1;
    }
    let words = |(grid, [sure, perhaps]): (&&str, &[usize; 2])| match (sure, perhaps) {
        (sure, 0) => format!("{grid} ×{sure}"),
        (0, _) => format!("{grid} possibly (not confirmed)"),
        (sure, _) => format!("{grid} ×{sure}, possibly once more (not confirmed)"),
    };
    grids.iter().map(words).collect()
}

/// Describes the removal of each path, a line for each; empty if the recipe does not request a removal.
pub fn removed(record: &CycleRecord) -> Vec<String> {
    let line = |path: PathRemoval| {
        format!(
            "removed in pass {}: mean {} µm over the treated grids; at most {} µm so far at any point of the part (95 % bound)",
            path.pass,
            fixed_decimals(path.mean_um, 1),
            fixed_decimals(path.bound_um, 1)
        )
    };
    record::removed(&record.findings).into_iter().map(line).collect()
}

/// Returns the removal of each path for scripts.
pub fn removed_json(record: &CycleRecord) -> Value {
    let path = |path: PathRemoval| json!({"pass": path.pass, "mean_um": path.mean_um, "bound_um": path.bound_um});
    record::removed(&record.findings).into_iter().map(path).collect()
}
