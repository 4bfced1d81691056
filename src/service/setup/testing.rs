//! Data for tests: a cell's folder with real files, and a robot at rest.

use super::{CellFiles, CellPaths};
use panelprep_base::geometry::{Joints, KukaPose};
use panelprep_kuka::eki::{self, CommandId, Epoch, Mode};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// Writes a cell's file with this text into a folder, recipes by their names into its folder `recipes`, and reads the
/// cell. Its store is the folder `store`.
pub fn write_cell(folder: &Path, text: &str, recipes: &[(&str, &str)]) -> Arc<CellFiles> {
    let (cell, recipes_folder) = (folder.join("cell.toml"), folder.join("recipes"));
    fs::create_dir_all(&recipes_folder).expect("a folder");
    for (name, recipe) in recipes {
        fs::write(recipes_folder.join(name), recipe).expect("written");
    }
    fs::write(&cell, format!("{text}\n[page]\nrecipes = 'recipes'\n")).expect("written");
    let paths = CellPaths { cell, store: Some(folder.join("store")) };
    Arc::new(CellFiles::read(&paths).unwrap_or_else(|fault| panic!("{fault}")))
}

/// Returns the state of a robot at rest, drives on, guard closed, in EXT.
pub fn standing_state() -> eki::State {
    eki::State {
        time_ms: 0,
        sequence: 0,
        answered: 0,
        epoch: Epoch(0),
        boot: 1,
        programs_checksum: 1,
        mode: Mode::External,
        drives_on: true,
        emergency_stop: false,
        guard_closed: true,
        moving: false,
        motion_possible: true,
        base_set: false,
        tool_set: false,
        stopped: false,
        inputs: 0,
        outputs: 0,
        done: CommandId(0),
        underruns: 0,
        override_percent: 100,
        joints: Joints::default(),
        base_from_tcp: KukaPose::default(),
        active_base: KukaPose::default(),
        flange_from_tool: KukaPose::default(),
    }
}
