//! What the commands read: the cell and its calibrations, recipes, shots, poses, and what was taught.

use super::args::Common;
use super::disk;
use super::fault::Fault;
use crate::calib::health::Verification;
use crate::cell::{
    Cell, CorrectionNumbers, FlangeCameraMount, Intrinsics, LensExtent, Mount, MountedPose, RemovalCalibration,
    RobotCorrection, ScannerMount, ToolMount,
};
use crate::cycle::{At, Cause};
use crate::files::{self, ReportedFlange, content_hash};
use crate::geometry::{
    Base, Camera, ColorPicture, Flange, FlangeCamera, KukaPose, OrganizedCloud, Panel, PinholeCamera, Rigid, Tool,
};
use crate::locate::ScanErrors;
use crate::panel::{TaughtCorner, TaughtPanel, panel_from_base_at_teaching};
use crate::path::Kinematics;
use crate::recipe::Recipe;
use crate::removal::model::Model;
use crate::requirements::{Purpose, unmet};
use crate::stages::learn;
use crate::store::{Store, Teaching, calibration_hash};
use std::path::{Path, PathBuf};

/// How a calibration file comes to be.
pub const CALIBRATION_ADVICE: &str = "of config/cell.toml it is written by `panelprep demo`, of another simulated cell by \
                                      `panelprep render`, of a real one by `panelprep calibrate`";

/// What a pose without axes lacks.
pub const NO_AXES: &str = "the cell's file names a correction of the arm, which needs the axes: add axes_deg = [A1, …, A6] \
                           beside base_from_flange, as the pendant shows them at this pose";

/// A file's name in messages.
fn name(file: &Path) -> String {
    file.display().to_string()
}

/// The cell's file, checked, with the texts of the calibrations that a command asks for.
pub struct CellFiles {
    file: PathBuf,
    /// The checked cell; its arm is corrected as the file that it names says.
    pub cell: Cell,
    /// The text of that file.
    correction_text: Option<String>,
    store: PathBuf,
}

/// A calibration and the text it was read from.
pub struct Calibrated<T> {
    /// The value.
    pub value: T,
    /// Its error at the panel, mm, 95 %, where the file states it.
    pub uncertainty_mm: Option<f64>,
    /// Of a lens: where in its picture it is known; nothing for others.
    pub extent: LensExtent,
    /// Of the 3D camera: its own errors; what is assumed for others.
    pub scan_errors: ScanErrors,
    /// The text of its file.
    pub text: String,
}

/// The serial number of the camera that such a file is the calibration of, where it is there and names one.
///
/// # Errors
/// Where it cannot be read or has problems.
pub fn calibrated_serial(intrinsics: Option<&Path>) -> Result<Option<String>, Fault> {
    // A camera that is not calibrated yet is looked at, too: that a cycle's calibrations are there is asked elsewhere.
    let Some(file) = intrinsics.filter(|file| file.exists()) else { return Ok(None) };
    Ok(Intrinsics::check(&name(file), &disk::read_text(file)?)?.serial)
}

impl CellFiles {
    /// Reads and checks the cell's file.
    ///
    /// # Errors
    /// Where it cannot be read or has problems.
    pub fn read(common: &Common) -> Result<Self, Fault> {
        let cell = Cell::check(&name(&common.cell), &disk::read_text(&common.cell)?)?;
        let store = common.store.clone().unwrap_or_else(|| cell.store().to_owned());
        let files = CellFiles { file: common.cell.clone(), cell, correction_text: None, store };
        let Some((text, numbers)) = files.correction_now()? else { return Ok(files) };
        Ok(CellFiles { cell: files.cell.corrected(numbers), correction_text: Some(text), ..files })
    }

    /// The arm's correction as its file is now, with its text.
    fn correction_now(&self) -> Result<Option<(String, CorrectionNumbers)>, Fault> {
        let file = self.cell.calibration().robot_correction.as_ref();
        let Some(file) = file else { return Ok(None) };
        let (name, text) = self.text("robot_correction", Some(file))?;
        let numbers = RobotCorrection::check(&name, &text)?.numbers;
        Ok(Some((text, numbers)))
    }

    /// The text of the arm's correction that is applied.
    ///
    /// # Errors
    /// Where its file is another now than when it was read: what has begun goes on by one correction.
    pub fn correction_text(&self) -> Result<Option<&str>, Fault> {
        let now = self.correction_now()?.map(|(text, _)| text);
        if now != self.correction_text {
            return Err(Fault::CorrectionChanged { cell: self.file.clone() });
        }
        Ok(self.correction_text.as_deref())
    }

    /// The hash of the arm's correction, by which calibrations name it.
    pub fn correction_hash(&self) -> Option<String> {
        self.correction_text.as_ref().map(|text| content_hash(text.as_bytes()))
    }

    /// The hash of these calibrations, and of the arm's correction where there is one: what a verification that the robot
    /// takes part in holds for.
    pub fn hash_with_arm(&self, texts: &[&str]) -> String {
        let all: Vec<&str> = texts.iter().copied().chain(self.correction_text.as_deref()).collect();
        calibration_hash(&all)
    }

    /// Where the flange truly was, when the controller reported what this file says.
    ///
    /// # Errors
    /// Where the arm has a correction, and the file no axes.
    pub fn true_flange(&self, file: &Path, reported: &ReportedFlange) -> Result<KukaPose, Fault> {
        if self.cell.arm().correction().is_none() {
            return Ok(reported.base_from_flange);
        }
        let joints = reported.joints.as_ref().ok_or_else(|| Fault::file(file, NO_AXES))?;
        let arm = Kinematics::new(self.cell.arm());
        Ok(KukaPose::from_rigid(&arm.true_flange(reported.base_from_flange.to_rigid(), joints)))
    }

    /// The store's folder.
    pub fn store_folder(&self) -> &Path {
        &self.store
    }

    /// Opens the store for reading.
    ///
    /// # Errors
    /// Where there is none, it is damaged or not ours.
    pub fn store(&self) -> Result<Store, Fault> {
        Store::open(&self.store).map_err(Fault::stage)
    }

    /// Opens the store for writing, and makes it where there is none.
    ///
    /// # Errors
    /// Where its folder cannot be made, another process writes to it, or its database is damaged or not ours.
    pub fn store_for_writing(&self) -> Result<Store, Fault> {
        Store::create(&self.store).map_err(Fault::stage)
    }

    /// Opens the store for writing, settles what an earlier program left, and refuses while something is open that a
    /// person must look at.
    ///
    /// # Errors
    /// As [`CellFiles::store_for_writing`], and where a motion is open or the last cycle was aborted.
    pub fn settled_store(&self) -> Result<Store, Fault> {
        let mut store = self.store_for_writing()?;
        let recovered = store.recover().map_err(Fault::stage)?;
        if matches!(recovered.at, At::Aborted { cause: Cause::StoreChanged }) {
            return Err(Fault::StoreChanged { cell: self.file.clone() });
        }
        if recovered.intent.is_some() || store.has_open_motion().map_err(Fault::stage)? {
            return Err(Fault::MotionOpen { cell: self.file.clone() });
        }
        if matches!(recovered.at, At::Aborted { .. }) {
            return Err(Fault::NotCleared { cell: self.file.clone() });
        }
        Ok(store)
    }

    /// The service's socket: where the cell's file says, else in the store.
    pub fn socket(&self) -> PathBuf {
        self.cell.socket().map_or_else(|| self.store.join("panelprep.sock"), Path::to_owned)
    }

    /// The last touch check of this tool's calibration; none where it was not touched, or there is no store yet.
    pub fn last_touch(&self, tool_text: &str) -> Option<Verification> {
        last_touch(&self.store().ok()?, &self.hash_with_arm(&[tool_text]))
    }

    /// Refuses where the cell's file does not say what this needs, or a calibration that it names is not there.
    ///
    /// # Errors
    /// All that is missing, each with its key.
    pub fn require(&self, purpose: Purpose) -> Result<(), Fault> {
        let unmet = unmet(&self.cell, purpose);
        if !unmet.is_empty() {
            return Err(Fault::Unmet { cell: self.file.clone(), purpose, unmet });
        }
        let named = self.cell.calibration().named();
        let away = named.into_iter().find(|(_, file)| purpose == Purpose::Cycle && !file.exists());
        away.map_or(Ok(()), |(key, file)| Err(self.away(key, file)))
    }

    fn away(&self, key: &'static str, file: &Path) -> Fault {
        Fault::CalibrationAway { cell: self.file.clone(), key, file: file.to_owned() }
    }

    fn text(&self, key: &'static str, file: Option<&PathBuf>) -> Result<(String, String), Fault> {
        let file = file.ok_or_else(|| Fault::NotCalibrated { cell: self.file.clone(), key })?;
        if !file.exists() {
            return Err(self.away(key, file));
        }
        Ok((name(file), disk::read_text(file)?))
    }

    fn lens(&self, key: &'static str, file: Option<&PathBuf>) -> Result<(Intrinsics, String), Fault> {
        let (name, text) = self.text(key, file)?;
        Ok((Intrinsics::check(&name, &text)?, text))
    }

    fn intrinsics(&self, key: &'static str, file: Option<&PathBuf>) -> Result<Calibrated<PinholeCamera>, Fault> {
        let (Intrinsics { camera, extent, errors, .. }, text) = self.lens(key, file)?;
        let scan_errors = ScanErrors::of(errors.as_ref());
        Ok(Calibrated { value: camera, uncertainty_mm: None, extent, scan_errors, text })
    }

    /// A mount's robot poses were corrected as this cell corrects them.
    fn measured_with_this_arm<M: Mount>(&self, name: &str, mount: &MountedPose<M>) -> Result<(), Fault> {
        // What a person wrote by hand was not measured with the robot.
        let is_measured = mount.provenance.program.is_some() || mount.robot_correction.is_some();
        let (found, ours) = (mount.robot_correction.clone(), self.correction_hash());
        match is_measured && found != ours {
            true => Err(Fault::OtherCorrection { file: name.into(), found, ours }),
            false => Ok(()),
        }
    }

    /// A mount that was measured with this arm, with its file's name and text.
    fn mounted<M: Mount>(&self, file: Option<&PathBuf>) -> Result<(String, MountedPose<M>, String), Fault> {
        let (name, text) = self.text(M::TABLE, file)?;
        let mount = MountedPose::<M>::check(&name, &text)?;
        self.measured_with_this_arm(&name, &mount)?;
        Ok((name, mount, text))
    }

    fn mount<M: Mount>(&self, file: Option<&PathBuf>) -> Result<Calibrated<Rigid<M::To, M::From>>, Fault> {
        let (_, mount, text) = self.mounted::<M>(file)?;
        Ok(calibrated(&mount, text))
    }

    /// The intrinsics of the fixed 3D camera.
    ///
    /// # Errors
    /// Where the cell names no such file, or it has problems; likewise for the other calibrations.
    pub fn scanner(&self) -> Result<Calibrated<PinholeCamera>, Fault> {
        self.intrinsics("scanner", self.cell.calibration().scanner.as_ref())
    }

    /// The whole file of the fixed 3D camera.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn scanner_lens(&self) -> Result<Intrinsics, Fault> {
        self.lens("scanner", self.cell.calibration().scanner.as_ref()).map(|(lens, _)| lens)
    }

    /// The intrinsics of the flange camera.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn flange_camera(&self) -> Result<Calibrated<PinholeCamera>, Fault> {
        self.intrinsics("flange_camera", self.cell.calibration().flange_camera.as_ref())
    }

    /// Where the fixed camera stands.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn base_from_camera(&self) -> Result<Calibrated<Rigid<Base, Camera>>, Fault> {
        self.mount::<ScannerMount>(self.cell.calibration().base_from_camera.as_ref())
    }

    /// How the flange camera sits on the flange.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn flange_from_camera(&self) -> Result<Calibrated<Rigid<Flange, FlangeCamera>>, Fault> {
        self.mount::<FlangeCameraMount>(self.cell.calibration().flange_from_camera.as_ref())
    }

    /// Where the tool's tip is; its axis may not have been measured.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`].
    pub fn tool_tip(&self) -> Result<Calibrated<Rigid<Flange, Tool>>, Fault> {
        self.mount::<ToolMount>(self.cell.calibration().flange_from_tool.as_ref())
    }

    /// What the disc takes off, with the text of its file; none where the cell names none.
    ///
    /// # Errors
    /// Where the file is away or has problems.
    pub fn removal(&self) -> Result<Option<(Model, String)>, Fault> {
        let Some(file) = self.cell.calibration().removal.as_ref() else { return Ok(None) };
        let (name, text) = self.text("removal", Some(file))?;
        Ok(Some((Model::from(&RemovalCalibration::check(&name, &text)?.numbers), text)))
    }

    /// Where the sanding tool's contact is.
    ///
    /// # Errors
    /// As [`CellFiles::scanner`]; also where the file does not say that the tool's axis was measured.
    pub fn flange_from_tool(&self) -> Result<Calibrated<Rigid<Flange, Tool>>, Fault> {
        let (file, mounted, text) = self.mounted::<ToolMount>(self.cell.calibration().flange_from_tool.as_ref())?;
        match mounted.axis_measured {
            Some(true) => Ok(calibrated(&mounted, text)),
            _ => Err(Fault::NoAxis { file }),
        }
    }
}

fn calibrated<M: Mount>(mount: &MountedPose<M>, text: String) -> Calibrated<Rigid<M::To, M::From>> {
    let (value, uncertainty_mm) = (mount.rigid(), mount.uncertainty_mm);
    Calibrated { value, uncertainty_mm, extent: LensExtent::default(), scan_errors: ScanErrors::default(), text }
}

/// The last touch check of this tool's calibration in a store; none where it was not touched, or that touch was struck out.
pub fn last_touch(store: &Store, hash: &str) -> Option<Verification> {
    let last = store.last_verification("tool").ok()??;
    last.counts_for(hash).then_some(last)
}

/// Reads and checks a recipe.
///
/// # Errors
/// Where it cannot be read or has problems.
pub fn recipe(file: &Path) -> Result<Recipe, Fault> {
    Ok(Recipe::check(&name(file), &disk::read_text(file)?)?)
}

/// Reads an organised scan and holds it against the camera's calibration.
///
/// # Errors
/// Where the file is no organised scan, or its size is not the calibrated one.
pub fn scan(file: &Path, camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, Fault> {
    let bytes = disk::read(file)?;
    files::read_cloud(&bytes, camera).map_err(|error| Fault::file(file, error))
}

/// Reads a picture of a clip and holds it against the camera's calibration.
///
/// # Errors
/// Where the file is no picture, or its size is not the calibrated one.
pub fn picture(file: &Path, camera: &PinholeCamera) -> Result<ColorPicture, Fault> {
    files::read_color_of(&disk::read(file)?, camera).map_err(|error| Fault::file(file, error))
}

/// Reads where the panel is; without a file it stands at its nominal place.
///
/// # Errors
/// Where the file holds no pose, or one that was rejected.
pub fn located(file: Option<&PathBuf>) -> Result<Rigid<Base, Panel>, Fault> {
    let Some(file) = file else { return Ok(panel_from_base_at_teaching().inverse()) };
    let pose = files::read_located(&disk::read(file)?).map_err(|error| Fault::file(file, error))?;
    Ok(pose.to_rigid())
}

/// How well the place in this file is known, 95 %, mm; `None` where it does not say.
///
/// # Errors
/// As [`located`].
pub fn located_mm(file: &Path) -> Result<Option<f64>, Fault> {
    files::read_located_mm(&disk::read(file)?).map_err(|error| Fault::file(file, error))
}

/// A corner picture with the flange's pose at that picture.
pub struct CornerShot {
    /// The picture's file.
    pub file: PathBuf,
    /// Its bytes, for the store.
    pub bytes: Vec<u8>,
    /// The picture.
    pub picture: ColorPicture,
    /// Where the flange truly was.
    pub base_from_flange: KukaPose,
}

/// Where the flange truly was, as this file says.
///
/// # Errors
/// Where it holds no pose, or no axes and the arm has a correction.
pub fn flange_file(cell_files: &CellFiles, file: &Path) -> Result<KukaPose, Fault> {
    let reported = files::read_reported_flange(&disk::read(file)?).map_err(|error| Fault::file(file, error))?;
    cell_files.true_flange(file, &reported)
}

/// Reads corner pictures, each with its pose.
///
/// # Errors
/// Where the counts differ, or a file is not what it must be.
pub fn corner_shots(
    cell_files: &CellFiles,
    pictures: &[PathBuf],
    flanges: &[PathBuf],
    camera: &PinholeCamera,
) -> Result<Vec<CornerShot>, Fault> {
    if pictures.len() != flanges.len() {
        return Err(Fault::CornerWithoutFlange { found: pictures.len(), flanges: flanges.len() });
    }
    let read = |(file, flange): (&PathBuf, &PathBuf)| {
        let bytes = disk::read(file)?;
        let picture = files::read_measured(&bytes, camera).map_err(|error| Fault::file(file, error))?;
        let base_from_flange = flange_file(cell_files, flange)?;
        Ok(CornerShot { file: file.clone(), bytes, picture, base_from_flange })
    };
    pictures.iter().zip(flanges).map(read).collect()
}

/// What was taught of a panel, derived again from what the store keeps.
pub struct Taught {
    /// The panel.
    pub panel: TaughtPanel,
    /// Its corners, in the order of teaching.
    pub corners: Vec<TaughtCorner>,
    /// The version in the store.
    pub version: String,
}

/// Loads what was taught of the recipe's panel.
///
/// # Errors
/// Where it was not taught, its files are damaged, or the recipe's `[region]` is another than the taught one.
pub fn taught(files: &CellFiles, recipe_file: &Path, recipe: &Recipe) -> Result<Taught, Fault> {
    let kept = files.store()?.taught(recipe.panel(), None).map_err(Fault::stage)?;
    let taught_recipe = Recipe::check("the taught recipe", &kept.teaching.recipe_text)?;
    if taught_recipe.region() != recipe.region() {
        return Err(Fault::TaughtOtherwise {
            recipe: recipe_file.to_owned(),
            table: "region",
            panel: recipe.panel().to_owned(),
            version: kept.version,
        });
    }
    let now = files.scanner_lens()?;
    derive(&kept.teaching, (&taught_recipe, &now), kept.version, &|index| format!("taught corner {}", index + 1))
}

/// The errors of the camera at teaching: those that were known then, or those of the same camera that are known now.
fn scan_errors_of_teaching(then: &Intrinsics, now: &Intrinsics) -> ScanErrors {
    let is_same = then.serial == now.serial && then.camera == now.camera;
    ScanErrors::of(then.errors.as_ref().or_else(|| now.errors.as_ref().filter(|_| is_same)))
}

/// Reads what a teaching holds and learns panel and corners from it; `name` is a corner picture's in messages.
///
/// # Errors
/// Where the scan shows no panel under the region, or pictures no corner: all of these are named.
pub fn derive(
    teaching: &Teaching,
    (recipe, now): (&Recipe, &Intrinsics),
    version: String,
    name: &dyn Fn(usize) -> String,
) -> Result<Taught, Fault> {
    let kept = "the taught calibration";
    let lens = Intrinsics::check(kept, &teaching.scanner_calibration_text)?;
    let errors = scan_errors_of_teaching(&lens, now);
    let camera = lens.camera;
    let base_from_camera = MountedPose::<ScannerMount>::check(kept, &teaching.base_from_camera_text)?.rigid();
    let cloud = errors.corrected(files::read_cloud(&teaching.scan, &camera).map_err(Fault::stage)?);
    let panel = TaughtPanel::learn(&cloud, camera, base_from_camera, recipe).map_err(Fault::stage)?;
    let mut corners = Vec::with_capacity(teaching.corners.len());
    let mut problems = Vec::new();
    for (index, shot) in teaching.corners.iter().enumerate() {
        let camera = Intrinsics::check(kept, &teaching.flange_camera_text)?.camera;
        let mount = MountedPose::<FlangeCameraMount>::check(kept, &teaching.flange_from_camera_text)?.rigid();
        let picture = files::read_measured(&shot.picture, &camera);
        let picture =
            picture.map_err(|error| Fault::TaughtCorner { number: index + 1, cause: error.to_string() })?;
        let view = (&picture, shot.base_from_flange.to_rigid());
        match learn::corner(&panel, (recipe.corner(), index), view, (&camera, mount)) {
            Ok(corner) => corners.push(corner),
            Err(error) => problems.push(format!("{}: {error}", name(index))),
        }
    }
    if !problems.is_empty() {
        return Err(Fault::Corners(problems));
    }
    Ok(Taught { panel, corners, version })
}
