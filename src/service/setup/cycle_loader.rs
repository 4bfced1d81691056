//! Prepares the requested starts of the service: reads all data of a cycle anew, and checks them.

use super::cell_files::CellFiles;
use super::cycle_files::{Calibrated, TaughtRecipe};
use super::cycle_setup::CellSetup;
use super::fault::SetupFault;
use super::health::judge_health;
use super::recorded_cycle::plan_recording;
use super::recording::{check_client_file, check_recording_file};
use super::start::{PassStatement, PreparedCycle, RecipeTextPermission, RecordIn, StartRequest};
use super::{cameras, disk};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cell::Intrinsics;
use panelprep_cell::files::content_hash;
use panelprep_cell::record::RecordingFile;
use panelprep_devices::world::SimulatedWorld;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Reads all data of a cycle, anew for each cycle. The cameras keep the data with which they were started, so the files
/// must still contain the same data.
pub struct CycleLoader {
    files: Arc<CellFiles>,
    cell: Arc<CellSetup>,
    /// The data with which the cameras were started.
    cameras: Vec<(&'static str, String)>,
    /// The simulated world, if there is one.
    world: Option<SimulatedWorld>,
    one_at_a_time: Mutex<()>,
}

impl CycleLoader {
    /// Creates the loader for cameras that are started now with these files.
    ///
    /// # Errors
    /// If a calibration or a setting of the cameras cannot be read.
    pub fn new(files: Arc<CellFiles>, cell: Arc<CellSetup>) -> Result<Self, SetupFault> {
        let cameras = camera_start_data(&files)?;
        Ok(CycleLoader { files, cell, cameras, world: None, one_at_a_time: Mutex::new(()) })
    }

    /// Returns the loader for a cell in this simulated world, in which each start mounts the disc of its recipe.
    #[must_use]
    pub fn in_world(self, world: Option<SimulatedWorld>) -> Self {
        CycleLoader { world, ..self }
    }

    /// Reads and checks the files of a requested cycle.
    ///
    /// # Errors
    /// The reasons why the cycle cannot begin.
    pub fn load(&self, request: &StartRequest) -> Result<PreparedCycle, Vec<Reason>> {
        // A file on a disk that hangs must not block the connections of clients that request a stop.
        let Ok(_turn) = self.one_at_a_time.try_lock() else {
            return Err(vec![Reason::new(
                "busy",
                "another start request is being processed; try again after the service has answered it",
            )]);
        };
        let health = judge_health(&self.files).map_err(|fault| vec![unreadable_reason(&fault)])?;
        if health.verdict == Verdict::Reject {
            return Err(health.reasons);
        }
        let foreign = foreign_recipe(&self.files.cell.page().recipes, (&request.recipe, &request.text));
        if let (Some(foreign), RecipeTextPermission::Refused) = (&foreign, request.own_text) {
            return Err(vec![not_permitted_refusal(foreign)]);
        }
        let prepared = self.prepare(request).map_err(|fault| vec![Reason::new(code(&fault), fault.to_string())])?;
        let remarks = foreign.into_iter().chain(request.is_stated_clear.then(stated_clear_remark)).collect();
        Ok(PreparedCycle { remarks, ..prepared })
    }

    fn prepare(&self, request: &StartRequest) -> Result<PreparedCycle, SetupFault> {
        let StartRequest { recipe, text, record, part, another_part, lost_passes, .. } = request;
        if camera_start_data(&self.files)? != self.cameras {
            return Err(SetupFault::CamerasChanged);
        }
        let calibrated = Calibrated::read(&self.files)?;
        let stated = PassStatement { another_part: *another_part, lost_passes: *lost_passes };
        let taught_recipe = TaughtRecipe::from_text(&self.files, Path::new(recipe), text.clone())?;
        let taught_recipe = taught_recipe.with_part(&self.files, part.clone(), stated)?;
        taught_recipe.check_part_names(&self.files)?;
        if let Some(world) = &self.world {
            world.mount_disc(taught_recipe.recipe.path().disc_diameter_mm());
        }
        let named = record.as_ref().map(|place| match place {
            RecordIn::Store => RecordingFile::InStore,
            RecordIn::File(file) => RecordingFile::Named(file.display().to_string()),
        });
        let recording = match record {
            None => None,
            Some(place) => {
                let store = self.files.store_folder();
                let file = match place {
                    RecordIn::Store => None,
                    RecordIn::File(file) => Some(check_client_file(file, store)?),
                };
                check_recording_file(file.as_deref(), store)?;
                Some(plan_recording(file, &self.files, (&taught_recipe, &calibrated))?)
            }
        };
        let mut prepared = taught_recipe.prepare_cycle(self.cell.clone(), &calibrated)?;
        (prepared.recording, prepared.start.recording) = (recording, named);
        Ok(prepared)
    }
}

/// Returns the code of the reason for a start that this fault refuses.
fn code(fault: &SetupFault) -> &'static str {
    match fault {
        SetupFault::PartUsedUp { .. } => "part_used_up",
        SetupFault::CountUnknown(_) => "count_unknown",
        SetupFault::PartNames(_) => "part_name",
        _ => "bad_input",
    }
}

/// Returns what the record of a start says if the person stated that the cell is clear.
fn stated_clear_remark() -> Reason {
    let message =
        "the person who started the cycle stated that the guard is closed and no person is inside the cell";
    Reason::new("stated_clear", message)
}

/// Returns a reason if a recipe's text differs from the file of this name in the recipes' folder.
fn foreign_recipe(folder: &Path, (name, text): (&str, &str)) -> Option<Reason> {
    let file = folder.join(Path::new(name).file_name().unwrap_or_default());
    let there = disk::read_text(&file).ok();
    let found = match &there {
        Some(there) if there == text => return None,
        Some(there) => format!("the file in the folder has SHA-256 {}", content_hash(there.as_bytes())),
        None => "the folder contains no such file".to_owned(),
    };
    let message = format!(
        "the recipe {name} with SHA-256 {} is not in the folder {}: {found}",
        content_hash(text.as_bytes()),
        folder.display()
    );
    Some(Reason::new("foreign_recipe", message))
}

/// Returns the refusal for an operator, who may start only with the recipes that an engineer has put into the
/// folder.
fn not_permitted_refusal(foreign: &Reason) -> Reason {
    let message = format!(
        "{}. The role operator may start only recipes of this folder; ask an engineer to put the recipe there or to start the cycle",
        foreign.message
    );
    Reason { message, ..foreign.clone() }
}

/// Returns the reason for a calibration that cannot be read.
pub fn unreadable_reason(fault: &SetupFault) -> Reason {
    Reason::new("calibration", fault.to_string())
}

/// Returns the data with which the cameras were started and which later cycles must match: the settings, and the
/// serial number and picture size of each calibrated camera.
fn camera_start_data(files: &CellFiles) -> Result<Vec<(&'static str, String)>, SetupFault> {
    let mut all = cameras::zivid_settings(&files.cell)?;
    let lenses = [("scanner", files.scanner_lens()?), ("flange_camera", files.flange_camera_lens()?)];
    for (which, Intrinsics { serial, camera, .. }) in lenses {
        all.push((which, format!("{} {}×{}", serial.unwrap_or_default(), camera.width_px, camera.height_px)));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recipe of the folder is recognised by its name and its whole text; another text under the same name is not
    /// this recipe.
    #[test]
    fn a_recipe_of_the_folder_is_recognised_by_name_and_text() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("door.toml"), "min_break_mm2 = 25\n").expect("written");
        let foreign = |name: &str, text: &str| foreign_recipe(folder.path(), (name, text));
        assert_eq!(foreign("door.toml", "min_break_mm2 = 25\n"), None);
        assert_eq!(foreign("/etc/panelprep/recipes/door.toml", "min_break_mm2 = 25\n"), None, "by its whole name");
        let own = foreign("door.toml", "min_break_mm2 = 10000\n").expect("another text");
        let sha256 = content_hash(b"min_break_mm2 = 25\n");
        assert!(own.code == "foreign_recipe" && own.message.contains(&sha256), "{}", own.message);
        for (name, text) in [("gate.toml", "min_break_mm2 = 25\n"), ("..", ""), ("", ""), ("door.toml/", "")] {
            assert!(foreign(name, text).is_some(), "{name}");
        }
        assert!(not_permitted_refusal(&own).message.contains("role operator"));
    }
}
