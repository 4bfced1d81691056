//! The files that a cycle uses: the recipe, the taught data of its panel, the calibrations, and the texts of all of
//! them for the record.

use super::cell_files::CellFiles;
use super::cycle_setup::{Calibrations, CellSetup, CycleSetup};
use super::fault::SetupFault;
use super::recipes::parse_recipe_for_cell;
use super::start::{PassStatement, PreparedCycle};
use super::teaching::{self, LoadedPanel};
use super::{cameras, disk, part};
use crate::stages::removal::EarlierRemoval;
use panelprep_cell::cell::{LensExtent, check_serial_form};
use panelprep_cell::cycle::Request;
use panelprep_cell::recipe::{Recipe, SandedReference};
use panelprep_cell::record::{ON_FOAM, PartNames};
use panelprep_store::store::{CycleStart, PassesOfCycle, UnknownPassCount};
use panelprep_vision::calib::budget;
use std::path::Path;
use std::sync::Arc;

/// The cell's calibrations, with the texts of the cell's file and of the calibration files, by name.
pub struct Calibrated {
    /// The values.
    pub values: Calibrations,
    /// The area of the picture in which the flange camera's lens is calibrated.
    flange_camera_extent: LensExtent,
    texts: Vec<(&'static str, String)>,
}

impl Calibrated {
    /// Reads all calibrations that a cycle needs.
    ///
    /// # Errors
    /// If the cell does not name such a file, or the file has problems.
    pub fn read(files: &CellFiles) -> Result<Self, SetupFault> {
        let (scanner, base_from_camera) = (files.scanner()?, files.base_from_camera()?);
        let (flange_camera, flange_from_camera) = (files.flange_camera()?, files.flange_from_camera()?);
        let tool = files.flange_from_tool()?;
        let flange_camera_extent = flange_camera.extent;
        let mounts_mm = [base_from_camera.uncertainty_mm, flange_from_camera.uncertainty_mm];
        let budget = budget::parts(mounts_mm, tool.uncertainty_mm, files.last_touch_check(&tool.text).as_ref());
        let removal = files.removal()?;
        let values = Calibrations {
            scanner: scanner.value,
            scan_errors: scanner.scan_errors,
            base_from_camera: base_from_camera.value,
            flange_camera: flange_camera.value,
            flange_from_camera: flange_from_camera.value,
            flange_from_tool: tool.value,
            hand_eye_mm: budget.hand_eye_mm,
            robot_mm: budget.robot_mm,
            removal: removal.as_ref().map(|(model, _)| *model),
        };
        let mut texts = vec![
            ("cell", files.cell_text().to_owned()),
            ("scanner", scanner.text),
            ("base_from_camera", base_from_camera.text),
            ("flange_camera", flange_camera.text),
            ("flange_from_camera", flange_from_camera.text),
            ("flange_from_tool", tool.text),
        ];
        texts.extend(removal.map(|(_, text)| ("removal", text)));
        texts.extend(files.correction_text()?.map(|text| ("robot_correction", text.to_owned())));
        texts.extend(cameras::zivid_settings(&files.cell)?);
        Ok(Calibrated { values, flange_camera_extent, texts })
    }

    fn for_cycle(&self) -> (Calibrations, LensExtent) {
        (self.values, self.flange_camera_extent.clone())
    }
}

/// A recipe with the taught data of its panel.
pub struct TaughtRecipe {
    /// The recipe.
    pub recipe: Recipe,
    recipe_text: String,
    /// The taught data of the recipe's panel.
    pub taught: LoadedPanel,
    part: Option<PartNames>,
    /// Earlier cycles that abraded the same part, if its serial number is given.
    earlier: Vec<PassesOfCycle>,
    /// Statements about the part's abrasions.
    count: PassStatement,
    /// The reason why the part's abrasions cannot be counted without such a statement.
    lost: Option<UnknownPassCount>,
    /// Whether foam lies in the cell instead of a panel.
    on_foam: bool,
}

impl TaughtRecipe {
    /// Reads the recipe and loads the taught data of its panel.
    ///
    /// # Errors
    /// If the recipe has problems or requests what the cell cannot do, or if its panel was not taught or was taught
    /// with another region.
    pub fn read(files: &CellFiles, recipe_file: &Path) -> Result<Self, SetupFault> {
        Self::from_text(files, recipe_file, disk::read_text(recipe_file)?)
    }

    /// Reads the taught data for a recipe that is given as text.
    ///
    /// # Errors
    /// As [`TaughtRecipe::read`].
    pub fn from_text(files: &CellFiles, recipe_file: &Path, recipe_text: String) -> Result<Self, SetupFault> {
        let recipe = parse_recipe_for_cell(&files.cell, &recipe_file.display().to_string(), &recipe_text)?;
        let taught = teaching::taught(files, recipe_file, &recipe)?;
        Ok(TaughtRecipe {
            recipe,
            recipe_text,
            taught,
            part: None,
            earlier: vec![],
            count: PassStatement::default(),
            lost: None,
            on_foam: false,
        })
    }

    /// States that foam lies in the cell instead of a panel: the cycle's record then releases no part.
    #[must_use]
    pub fn on_foam(self, on_foam: bool) -> Self {
        TaughtRecipe { on_foam, ..self }
    }

    /// Adds this part, whose names are stored with the cycle, and what was stated about its abrasions. Passes in
    /// earlier cycles of the part count.
    ///
    /// # Errors
    /// If a name is not valid, or the store cannot be read.
    pub fn with_part(
        self,
        files: &CellFiles,
        part: Option<PartNames>,
        count: PassStatement,
    ) -> Result<Self, SetupFault> {
        let part = part::parse_part_names(part.unwrap_or_default())?;
        let serial = part.as_ref().and_then(|part| part.serial.as_deref());
        let store = files.store()?;
        let earlier = match serial {
            Some(serial) => store.sanding_passes_by_serial(serial, None).map_err(SetupFault::stage)?,
            None => vec![],
        };
        let lost =
            store.unknown_pass_count(self.recipe.panel(), serial.unwrap_or_default()).map_err(SetupFault::stage)?;
        Ok(TaughtRecipe { part, earlier, count, lost, ..self })
    }

    /// Checks that the part is named as `[part]` of the cell's file demands. If the recipe states the form of its panel's
    /// serial numbers, also checks that the part has a number of this form.
    ///
    /// # Errors
    /// If a required name is missing, or a name does not have its form.
    pub fn check_part_names(&self, files: &CellFiles) -> Result<(), SetupFault> {
        let part = self.part.as_ref();
        let serial = part.and_then(|part| part.serial.as_deref());
        let order = part.and_then(|part| part.order.as_deref());
        let checked = files.cell.part().check(serial, order);
        let form = self.recipe.outline().serial_pattern();
        let checked = checked.and_then(|()| form.map_or(Ok(()), |form| check_serial_form(serial, &form)));
        checked.map_err(SetupFault::PartNames)
    }

    /// Checks that the part's abrasions can be counted, and by `[process] max_passes_per_part` that it may be abraded
    /// once more.
    ///
    /// # Errors
    /// If earlier cycles have used all allowed passes; each cycle is named with its passes. If the store was restored
    /// and nothing was stated about the part.
    pub fn check_part_passes(&self) -> Result<(), SetupFault> {
        if let (Some(lost), None) = (&self.lost, self.count.lost_passes) {
            let is_answered = self.count.another_part && UnknownPassCount::is_another_part_sufficient(&lost.serial);
            if !is_answered {
                return Err(SetupFault::CountUnknown(lost.clone()));
            }
        }
        let most = self.recipe.process().effective_passes_per_part();
        part::check_pass_limit(self.part.as_ref(), (&self.earlier, self.lost_passes()), most)
    }

    fn lost_passes(&self) -> u8 {
        self.count.lost_passes.unwrap_or(0)
    }

    /// Prepares a cycle for the service to begin.
    ///
    /// # Errors
    /// If the part may not be abraded any more, no corner was taught, or a corner was taught where the lens is not
    /// calibrated.
    pub fn prepare_cycle(self, cell: Arc<CellSetup>, calibrated: &Calibrated) -> Result<PreparedCycle, SetupFault> {
        self.check_part_passes()?;
        let (request, start, before) = (self.request(), self.start(calibrated)?, self.removed_before());
        let TaughtRecipe { recipe, taught: LoadedPanel { panel, corners, .. }, .. } = self;
        let setup = CycleSetup::new(cell, recipe, (panel, corners), calibrated.for_cycle())?;
        let setup = setup.with_earlier_removal(before);
        Ok(PreparedCycle { request, setup, start, recording: None, remarks: vec![] })
    }

    /// Returns the setup for the single cycle of a command.
    ///
    /// # Errors
    /// If the cell does not name what a cycle needs, or its corners are not suitable.
    pub fn single_setup(&self, files: &CellFiles, calibrated: &Calibrated) -> Result<CycleSetup, SetupFault> {
        let cell = Arc::new(CellSetup::new(&files.cell)?);
        let taught = (self.taught.panel.clone(), self.taught.corners.clone());
        let setup = CycleSetup::new(cell, self.recipe.clone(), taught, calibrated.for_cycle())?;
        Ok(setup.with_earlier_removal(self.removed_before()).with_foam(self.on_foam))
    }

    /// Returns the first entries of the cycle's record.
    ///
    /// # Errors
    /// If the part cannot be written as text.
    pub fn start(&self, calibrated: &Calibrated) -> Result<CycleStart, SetupFault> {
        let part = self.part.as_ref().map(part::text).transpose()?.map(|text| (PartNames::FILE, text));
        let before = self.removed_before_text()?;
        let texts = calibrated.texts.iter().chain(&part).chain(&before);
        let texts = texts.map(|(name, text)| ((*name).to_owned(), text.clone()));
        let another = self.count.another_part.then(part::another_part_text);
        let lost = self.count.lost_passes.map(part::lost).transpose()?;
        let foam =
            self.on_foam.then(|| (ON_FOAM.to_owned(), "foam lies in the cell instead of a panel\n".to_owned()));
        Ok(CycleStart {
            panel: self.recipe.panel().to_owned(),
            taught_version: self.taught.version.clone(),
            recipe_text: self.recipe_text.clone(),
            file_texts: texts.chain(another).chain(lost).chain(foam).collect(),
            recording: None,
            is_air_run: false,
        })
    }

    /// Returns the request to the cycle's state table to begin a cycle.
    pub fn request(&self) -> Request {
        let process = self.recipe.process();
        let left = process.effective_passes_per_part().saturating_sub(self.earlier_pass_count());
        Request::Start {
            max_passes: count(process.max_passes_per_grid().min(left)),
            max_moves: self.max_correction_moves(),
            dries: self.recipe.inspect().reference() == SandedReference::Dry,
        }
    }

    /// Returns the removal on the part by earlier cycles; the last of these cycles states the total.
    fn removed_before(&self) -> EarlierRemoval {
        let known = self.earlier.iter().filter_map(|cycle| cycle.removed_um);
        let unknown = self.earlier.iter().filter(|cycle| cycle.removed_um.is_none()).count()
            + usize::from(self.lost_passes() > 0);
        let is_asked = self.recipe.removal().is_some();
        let found = EarlierRemoval { bound_um: known.fold(0.0, f64::max), unknown };
        if is_asked { found } else { EarlierRemoval::default() }
    }

    /// Returns the removal by earlier cycles as text, which is stored with the cycle and from which a replay reads it;
    /// `None` if nothing was removed.
    fn removed_before_text(&self) -> Result<Option<(&'static str, String)>, SetupFault> {
        let found = Some(self.removed_before()).filter(|found| *found != EarlierRemoval::default());
        let text = found.map(|found| toml::to_string(&found)).transpose().map_err(SetupFault::stage)?;
        Ok(text.map(|text| (EARLIER_REMOVAL_TEXT, text)))
    }

    fn earlier_pass_count(&self) -> usize {
        self.earlier.iter().map(|cycle| cycle.passes).sum::<usize>() + usize::from(self.lost_passes())
    }

    /// Returns the request to the cycle's state table to begin an air-run.
    pub fn air_request(&self) -> Request {
        Request::AirRun { max_moves: self.max_correction_moves() }
    }

    fn max_correction_moves(&self) -> u8 {
        count(self.recipe.corner().max_moves())
    }
}

/// The name of the text about earlier removal among a cycle's texts.
pub const EARLIER_REMOVAL_TEXT: &str = "removed_before";

fn count(number: usize) -> u8 {
    u8::try_from(number).unwrap_or(u8::MAX)
}
