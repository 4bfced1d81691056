//! The cell's file with the calibrations that it names, each read and checked when a command needs it; and the
//! cell's store.

use super::disk;
use super::fault::SetupFault;
use crate::requirements::{Purpose, incomplete_files, is_same_correction};
use panelprep_base::geometry::{Base, Camera, Flange, FlangeCamera, KukaPose, PinholeCamera, Rigid, Tool};
use panelprep_cell::cell::{
    Cell, CorrectionNumbers, FlangeCameraMount, Intrinsics, LensExtent, Mount, MountedPose, RemovalCalibration,
    RobotCorrection, ScannerMount, SignedPage, ToolMount,
};
use panelprep_cell::cycle::{At, Cause};
use panelprep_cell::files::{ReportedFlange, content_hash};
use panelprep_store::store::{Store, StoreError, calibration_hash};
use panelprep_toolpath::path::Kinematics;
use panelprep_toolpath::removal::model::Model;
use panelprep_vision::calib::health::Verification;
use panelprep_vision::locate::ScanErrors;
use std::path::{Path, PathBuf};

/// Message for a pose without axes: the axes that are missing, and how to add them.
pub const NO_AXES: &str = "the cell's file names a correction of the arm, which needs axis angles: add axes_deg = \
                           [A1, …, A6] next to base_from_flange, as the pendant shows the axes at this pose";

/// Returns a file's name for messages.
pub(super) fn name(file: &Path) -> String {
    file.display().to_string()
}

/// The places of a cell's data, as a command line names them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellPaths {
    /// The cell's file.
    pub cell: PathBuf,
    /// The store's folder; `None` if the cell's file names it.
    pub store: Option<PathBuf>,
}

/// A device that is mounted on the flange, at its calibrated pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Mounted {
    /// The name of the mounted item, such as the sanding tool.
    pub name: &'static str,
    /// The pose of the tip of the mounted item.
    pub flange_from_tip: Rigid<Flange, Tool>,
}

/// The cell's file, checked, with the texts of the calibrations that a command needs.
#[derive(Debug)]
pub struct CellFiles {
    paths: CellPaths,
    /// The checked cell; its arm is corrected by the file that it names.
    pub cell: Cell,
    /// The text from which the cell was read.
    cell_text: String,
    /// The text of the correction file.
    correction_text: Option<String>,
    store: PathBuf,
}

/// A calibration and the text from which it was read.
pub struct LoadedCalibration<T> {
    /// The value.
    pub value: T,
    /// Its error at the panel, mm, 95 %, if the file states it.
    pub uncertainty_mm: Option<f64>,
    /// For a lens, the area of its picture in which it is calibrated; empty for others.
    pub extent: LensExtent,
    /// For the 3D camera, its own errors; for other calibrations, the assumed errors.
    pub scan_errors: ScanErrors,
    /// The text of the calibration's file.
    pub text: String,
}

/// Returns the serial number of the camera to which this calibration file belongs, if the file exists and names one.
///
/// # Errors
/// If it cannot be read or has problems.
pub(super) fn calibrated_serial(intrinsics: Option<&Path>) -> Result<Option<String>, SetupFault> {
    // A camera that is not calibrated yet is also accepted: another place checks that a cycle's calibrations exist.
    let Some(file) = intrinsics.filter(|file| file.exists()) else { return Ok(None) };
    Ok(Intrinsics::check(&name(file), &disk::read_text(file)?)?.serial)
}

/// Returns the newest signed page of proofs in the store in this folder. Without a store that can be read, no page
/// counts.
fn newest_signed_page(folder: &Path) -> Option<SignedPage> {
    match Store::open(folder).and_then(|store| store.signed_proofs()) {
        Ok(page) => page,
        Err(error) => {
            tracing::warn!("the signed proofs cannot be read, so no stage counts as signed: {error}");
            None
        }
    }
}

impl CellFiles {
    /// Reads and checks the cell's file.
    ///
    /// # Errors
    /// If it cannot be read or has problems.
    pub fn read(paths: &CellPaths) -> Result<Self, SetupFault> {
        let cell_text = disk::read_text(&paths.cell)?;
        let cell = Cell::check(&name(&paths.cell), &cell_text)?;
        let store = paths.store.clone().unwrap_or_else(|| cell.store().to_owned());
        let signed = cell.robot().stated_stage().and_then(|_| newest_signed_page(&store));
        let cell = cell.with_signed_page(signed);
        let files = CellFiles { paths: paths.clone(), cell, cell_text, correction_text: None, store };
        let Some((text, numbers)) = files.correction_now()? else { return Ok(files) };
        Ok(CellFiles { cell: files.cell.with_arm_correction(numbers), correction_text: Some(text), ..files })
    }

    /// Returns the paths from which these files were read.
    pub fn paths(&self) -> &CellPaths {
        &self.paths
    }

    /// Returns the text of the cell's file that is applied; the file may have changed since it was read.
    pub fn cell_text(&self) -> &str {
        &self.cell_text
    }

    /// Reads the present content of the arm's correction file, with its text.
    fn correction_now(&self) -> Result<Option<(String, CorrectionNumbers)>, SetupFault> {
        let file = self.cell.calibration().robot_correction.as_ref();
        let Some(file) = file else { return Ok(None) };
        let (name, text) = self.text("robot_correction", Some(file))?;
        let numbers = RobotCorrection::check(&name, &text)?.numbers;
        Ok(Some((text, numbers)))
    }

    /// Returns the text of the arm's correction that is applied.
    ///
    /// # Errors
    /// If its file has changed since it was read: started work continues with one correction.
    pub fn correction_text(&self) -> Result<Option<&str>, SetupFault> {
        let now = self.correction_now()?.map(|(text, _)| text);
        if now != self.correction_text {
            return Err(SetupFault::CorrectionChanged { cell: self.paths.cell.clone() });
        }
        Ok(self.correction_text.as_deref())
    }

    /// Returns the hash of the arm's correction, by which calibrations refer to it.
    pub fn correction_hash(&self) -> Option<String> {
        self.correction_text.as_ref().map(|text| content_hash(text.as_bytes()))
    }

    /// Returns the hash of these calibrations and of the arm's correction, if there is one. A verification that
    /// involves the robot is valid for this hash.
    pub fn hash_with_arm(&self, texts: &[&str]) -> String {
        let all: Vec<&str> = texts.iter().copied().chain(self.correction_text.as_deref()).collect();
        calibration_hash(&all)
    }

    /// Returns the true pose of the flange for the controller's report in this file.
    ///
    /// # Errors
    /// If the arm has a correction and the file has no axes.
    pub fn true_flange(&self, file: &Path, reported: &ReportedFlange) -> Result<KukaPose, SetupFault> {
        if self.cell.arm().correction().is_none() {
            return Ok(reported.base_from_flange);
        }
        let joints = reported.joints.as_ref().ok_or_else(|| SetupFault::file_fault(file, NO_AXES))?;
        let arm = Kinematics::new(self.cell.arm());
        Ok(KukaPose::from_rigid(&arm.true_flange(reported.base_from_flange.to_rigid(), joints)))
    }

    /// Returns the store's folder.
    pub fn store_folder(&self) -> &Path {
        &self.store
    }

    /// Opens the store for reading.
    ///
    /// # Errors
    /// If there is none, or it is damaged or not a store of this program.
    pub fn store(&self) -> Result<Store, SetupFault> {
        Store::open(&self.store).map_err(SetupFault::stage)
    }

    /// Opens the store for writing, and makes it if there is none.
    ///
    /// # Errors
    /// If its folder cannot be made, another process writes to it, or its database is damaged or not one of this
    /// program.
    pub fn store_for_writing(&self) -> Result<Store, SetupFault> {
        Store::create(&self.store).map_err(SetupFault::stage)
    }

    /// Opens the store for writing and concludes what an earlier program left unfinished. Refuses if a person must
    /// first check what is still open.
    ///
    /// # Errors
    /// As [`CellFiles::store_for_writing`], and if a motion is open or the last cycle was aborted.
    pub fn settled_store(&self) -> Result<Store, SetupFault> {
        let mut store = self.store_for_writing()?;
        let recovered = store.recover().map_err(SetupFault::stage)?;
        if matches!(recovered.at, At::Aborted { cause: Cause::StoreChanged }) {
            return Err(SetupFault::StoreChanged { cell: self.paths.cell.clone() });
        }
        if recovered.intent.is_some() || store.has_open_motion().map_err(SetupFault::stage)? {
            return Err(SetupFault::MotionOpen { cell: self.paths.cell.clone() });
        }
        if matches!(recovered.at, At::Aborted { .. }) {
            return Err(SetupFault::NotCleared { cell: self.paths.cell.clone() });
        }
        Ok(store)
    }

    /// Returns the service's socket: the one that the cell's file names, else one in the store.
    pub fn socket(&self) -> PathBuf {
        self.cell.socket().map_or_else(|| self.store.join("panelprep.sock"), Path::to_owned)
    }

    /// Returns the last touch check of this tool's calibration; `None` if it was not touched, or the store cannot be read
    /// or does not exist yet: the robot's error then counts as not measured.
    pub fn last_touch_check(&self, tool_text: &str) -> Option<Verification> {
        last_touch_check(&self.store().ok()?, &self.hash_with_arm(&[tool_text])).ok()?
    }

    /// Refuses a cell's file that does not state what this purpose needs, or names a file that is missing or
    /// invalid.
    ///
    /// # Errors
    /// All that is missing, each with its key.
    pub fn require(&self, purpose: Purpose) -> Result<(), SetupFault> {
        let unmet = incomplete_files(&self.cell, purpose, &disk::read_referenced);
        if unmet.is_empty() {
            return Ok(());
        }
        Err(SetupFault::Unmet { cell: self.paths.cell.clone(), purpose, unmet })
    }

    fn missing_file_fault(&self, key: &'static str, file: &Path) -> SetupFault {
        SetupFault::CalibrationAway { cell: self.paths.cell.clone(), key, file: file.to_owned() }
    }

    fn text(&self, key: &'static str, file: Option<&PathBuf>) -> Result<(String, String), SetupFault> {
        let file = file.ok_or_else(|| SetupFault::NotCalibrated { cell: self.paths.cell.clone(), key })?;
        if !file.exists() {
            return Err(self.missing_file_fault(key, file));
        }
        Ok((name(file), disk::read_text(file)?))
    }

    fn lens(&self, key: &'static str, file: Option<&PathBuf>) -> Result<(Intrinsics, String), SetupFault> {
        let (name, text) = self.text(key, file)?;
        Ok((Intrinsics::check(&name, &text)?, text))
    }

    fn intrinsics(
        &self,
        key: &'static str,
        file: Option<&PathBuf>,
    ) -> Result<LoadedCalibration<PinholeCamera>, SetupFault> {
        let (Intrinsics { camera, extent, errors, .. }, text) = self.lens(key, file)?;
        let scan_errors = ScanErrors::from_measured(errors.as_ref());
        Ok(LoadedCalibration { value: camera, uncertainty_mm: None, extent, scan_errors, text })
    }

    /// Checks that a mount's robot poses were corrected with the same correction as this cell's.
    fn check_arm_correction<M: Mount>(&self, name: &str, mount: &MountedPose<M>) -> Result<(), SetupFault> {
        let ours = self.correction_hash();
        if is_same_correction(mount, ours.as_deref()) {
            return Ok(());
        }
        let found = mount.robot_correction.clone();
        Err(SetupFault::OtherCorrection { file: name.into(), found, ours })
    }

    /// Reads a mount that was measured with this arm's correction; returns it with its file's name and text.
    fn load_mount<M: Mount>(&self, file: Option<&PathBuf>) -> Result<(String, MountedPose<M>, String), SetupFault> {
        let (name, text) = self.text(M::TABLE, file)?;
        let mount = MountedPose::<M>::check(&name, &text)?;
        self.check_arm_correction(&name, &mount)?;
        Ok((name, mount, text))
    }

    fn mount<M: Mount>(
        &self,
        file: Option<&PathBuf>,
    ) -> Result<LoadedCalibration<Rigid<M::To, M::From>>, SetupFault> {
        let (_, mount, text) = self.load_mount::<M>(file)?;
        Ok(load_calibration(&mount, text))
    }

    /// Returns the intrinsics of the fixed 3D camera.
    ///
    /// # Errors
    /// If the cell names no such file, or it has problems; likewise for the other calibrations.
    pub fn scanner(&self) -> Result<LoadedCalibration<PinholeCamera>, SetupFault> {
        self.intrinsics("scanner", self.cell.calibration().scanner.as_ref())
    }

    /// Reads the whole file of the fixed 3D camera.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn scanner_lens(&self) -> Result<Intrinsics, SetupFault> {
        self.lens("scanner", self.cell.calibration().scanner.as_ref()).map(|(lens, _)| lens)
    }

    /// Reads the whole file of the flange camera.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn flange_camera_lens(&self) -> Result<Intrinsics, SetupFault> {
        self.lens("flange_camera", self.cell.calibration().flange_camera.as_ref()).map(|(lens, _)| lens)
    }

    /// Reads the intrinsics of the flange camera.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn flange_camera(&self) -> Result<LoadedCalibration<PinholeCamera>, SetupFault> {
        self.intrinsics("flange_camera", self.cell.calibration().flange_camera.as_ref())
    }

    /// Returns the pose of the fixed camera.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn base_from_camera(&self) -> Result<LoadedCalibration<Rigid<Base, Camera>>, SetupFault> {
        self.mount::<ScannerMount>(self.cell.calibration().base_from_camera.as_ref())
    }

    /// Reads the pose of the flange camera on the flange.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn flange_from_camera(&self) -> Result<LoadedCalibration<Rigid<Flange, FlangeCamera>>, SetupFault> {
        self.mount::<FlangeCameraMount>(self.cell.calibration().flange_from_camera.as_ref())
    }

    /// Returns the pose of the tool's tip; its axis may not have been measured.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn tool_tip(&self) -> Result<LoadedCalibration<Rigid<Flange, Tool>>, SetupFault> {
        self.mount::<ToolMount>(self.cell.calibration().flange_from_tool.as_ref())
    }

    /// Returns the calibrated poses of the devices that are mounted on the flange. A calibration that was not made yet
    /// is left out; an existing file must be right.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn flange_devices(&self) -> Result<Vec<Mounted>, SetupFault> {
        let calibration = self.cell.calibration();
        let is_made = |file: &Option<PathBuf>| file.as_ref().is_some_and(|file| file.exists());
        let mut mounted = Vec::new();
        if is_made(&calibration.flange_from_tool) {
            let flange_from_tip = self.tool_tip()?.value;
            mounted.push(Mounted { name: "the sanding tool", flange_from_tip });
        }
        if is_made(&calibration.flange_from_camera) {
            let camera = Rigid::from_isometry_unchecked(*self.flange_from_camera()?.value.isometry());
            mounted.push(Mounted { name: "the flange camera", flange_from_tip: camera });
        }
        Ok(mounted)
    }

    /// Returns the removal model of the disc, with the text of its file; `None` if the cell names none.
    ///
    /// # Errors
    /// If the file is missing or has problems.
    pub fn removal(&self) -> Result<Option<(Model, String)>, SetupFault> {
        let Some(file) = self.cell.calibration().removal.as_ref() else { return Ok(None) };
        let (name, text) = self.text("removal", Some(file))?;
        Ok(Some((Model::from(&RemovalCalibration::check(&name, &text)?.numbers), text)))
    }

    /// Returns the pose of the sanding tool's contact.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`]; also if the file does not state that the tool's axis was measured.
    pub fn flange_from_tool(&self) -> Result<LoadedCalibration<Rigid<Flange, Tool>>, SetupFault> {
        let (file, mounted, text) =
            self.load_mount::<ToolMount>(self.cell.calibration().flange_from_tool.as_ref())?;
        match mounted.axis_measured {
            Some(true) => Ok(load_calibration(&mounted, text)),
            _ => Err(SetupFault::NoAxis { file }),
        }
    }
}

fn load_calibration<M: Mount>(mount: &MountedPose<M>, text: String) -> LoadedCalibration<Rigid<M::To, M::From>> {
    let (value, uncertainty_mm) = (mount.rigid(), mount.uncertainty_mm);
    LoadedCalibration {
        value,
        uncertainty_mm,
        extent: LensExtent::default(),
        scan_errors: ScanErrors::default(),
        text,
    }
}

/// Returns the last touch check of this tool's calibration in a store; `None` if it was not touched, or that touch was
/// struck out.
///
/// # Errors
/// If the store cannot be read.
pub fn last_touch_check(store: &Store, hash: &str) -> Result<Option<Verification>, StoreError> {
    Ok(store.newest_verification("tool")?.filter(|last| last.counts_for(hash)))
}

#[cfg(test)]
mod tests {
    use crate::setup::testing::write_cell;

    /// A cycle's record states the cell that the cycle used, not the present content of the file.
    #[test]
    fn a_later_change_of_the_file_does_not_change_the_text_in_use() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = write_cell(folder.path(), "[limits]\nmax_speed_mm_s = 400\n", &[]);
        let read = std::fs::read_to_string(&files.paths().cell).expect("read");
        std::fs::write(&files.paths().cell, "[limits]\nmax_speed_mm_s = 100\n").expect("written");
        assert!(read.contains("max_speed_mm_s = 400"));
        assert_eq!(files.cell_text(), read);
    }
}
