//! Reads and writes calibration files: the intrinsics of a camera, and the mounts of cameras and tool.
//!
//! Numbers are written to TOML and read back without rounding. The file states their origin (date, serial number,
//! residuals); the code that uses the numbers checks whether their accuracy is sufficient. `[scanner_errors]` in the 3D
//! camera's file is the result of `panelprep calibrate scanner`, from scans of a flat board. `[rough]` in the cell's
//! file contains the camera poses as measured with a tape: a calibration must agree with them approximately.

use super::lens::{self, LensExtent};
use super::provenance::{BoardSize, Date, Provenance, line};
use nalgebra::SMatrix;
use panelprep_base::config::{Problem, Problems, Section, Setting};
use panelprep_base::geometry::{
    Base, Camera, DepthField, FIELD_SIZE, FieldRectangle, Flange, FlangeCamera, Frame, KukaPose, PinholeCamera,
    Pixel, Rigid, Tool, Vector,
};
use panelprep_base::{config, geometry};
use std::marker::PhantomData;
use std::ops::RangeInclusive;
use toml::de::DeValue;

/// Covariance of fx, fy, cx, cy (px), k1, k2, p1, p2, k3, in this order: the uncertainty of a lens.
pub type LensCovariance = SMatrix<f64, 9, 9>;

/// The covariance of a lens as its file stores it: the rows of the upper triangle, one after another.
struct Covariance(LensCovariance);

impl Setting for Covariance {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        const FINITE: RangeInclusive<f64> = -1e12..=1e12;
        let numbers = value.as_array().map(|list| list.iter().map(|item| f64::parse(item.get_ref(), &FINITE)));
        let numbers: Vec<f64> = numbers.map(Iterator::collect::<Result<_, _>>).transpose()?.unwrap_or_default();
        let allowed = || "valid: the 45 numbers of a covariance's upper triangle, row by row".to_owned();
        let mut next = numbers.iter();
        let mut covariance = LensCovariance::zeros();
        for row in 0..9 {
            for column in row..9 {
                let number = *next.next().ok_or_else(allowed)?;
                (covariance[(row, column)], covariance[(column, row)]) = (number, number);
            }
        }
        let is_covariance = (0..9).all(|row| covariance[(row, row)] > 0.0) && next.next().is_none();
        if is_covariance { Ok(Covariance(covariance)) } else { Err(allowed()) }
    }
}

/// The intrinsics of a camera, as stored in the table `[camera]` of their file.
#[derive(Debug, Clone, PartialEq)]
pub struct Intrinsics {
    /// The camera model: focal lengths, principal point, distortion.
    pub camera: PinholeCamera,
    /// The covariance of the intrinsics; if it is absent, the intrinsics are treated as exact.
    pub covariance: Option<LensCovariance>,
    /// Serial number of the camera that was calibrated.
    pub serial: Option<String>,
    /// Date of the calibration.
    pub date: Option<Date>,
    /// Root mean square of the reprojection residuals, px.
    pub rms_px: Option<f64>,
    /// The coefficients of the model, the excluded coefficients with the reasons, and the part of the picture in which
    /// the lens is calibrated.
    pub extent: LensExtent,
    /// The program, the pictures and the residual of each picture.
    pub provenance: Provenance,
    /// The measured depth errors of a 3D camera; `None` if they were not measured.
    pub errors: Option<MeasuredScanner>,
}

const SIZE_PX: RangeInclusive<usize> = 16..=20_000;
const FOCAL_PX: RangeInclusive<f64> = 10.0..=200_000.0;
const CENTRE_PX: RangeInclusive<f64> = -20_000.0..=40_000.0;
const COEFFICIENT: RangeInclusive<f64> = -1_000.0..=1_000.0;
const RESIDUAL: RangeInclusive<f64> = 0.0..=100.0;

impl Intrinsics {
    /// Creates intrinsics that contain only a camera model.
    pub fn from_camera(camera: PinholeCamera) -> Self {
        Intrinsics {
            camera,
            covariance: None,
            serial: None,
            date: None,
            rms_px: None,
            extent: LensExtent::default(),
            provenance: Provenance::default(),
            errors: None,
        }
    }

    /// Returns whether this text is a lens file in the format of OpenCV, ROS or Zivid.
    pub fn is_foreign_format(text: &str) -> bool {
        lens::is_foreign_lens(text)
    }

    /// Reads a lens file of another program (OpenCV, ROS or Zivid). It contains no covariance.
    fn read_foreign(file: &str, text: &str) -> Result<Self, Problems> {
        let wrong = |message: String| {
            let list = vec![Problem { line: 1, key: String::new(), message }];
            Problems { file: file.to_owned(), list }
        };
        let camera = lens::read(text).map_err(wrong)?;
        let within = SIZE_PX.contains(&camera.width_px) && SIZE_PX.contains(&camera.height_px);
        if !within || [camera.fx_px, camera.fy_px].iter().any(|focal| !FOCAL_PX.contains(focal)) {
            return Err(wrong(format!(
                "found a picture of {}×{} px with focal lengths of {} and {} px; the limits are {} to {} px and {} to \
                 {} px",
                camera.width_px,
                camera.height_px,
                camera.fx_px,
                camera.fy_px,
                SIZE_PX.start(),
                SIZE_PX.end(),
                FOCAL_PX.start(),
                FOCAL_PX.end()
            )));
        }
        if let Some(corner) = corner_without_ray(&camera) {
            let [u, v] = [corner.u, corner.v];
            return Err(wrong(format!(
                "with this distortion, the pixel ({u}, {v}) has no ray; check that the distortion is that of this \
                 camera"
            )));
        }
        Ok(Intrinsics::from_camera(camera))
    }

    /// Parses and checks an intrinsics file, in the format of this program, OpenCV, ROS or Zivid.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key. A distortion that cannot be inverted inside the picture is
    /// a problem too.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        if Self::is_foreign_format(text) {
            return Self::read_foreign(file, text);
        }
        config::parse_file(file, text, |top| {
            let (intrinsics, errors) = (Self::parse(&top.section("camera")), MeasuredScanner::parse(top));
            top.finish();
            Some(Intrinsics { errors: errors?, ..intrinsics? })
        })
    }

    fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let size = |key| section.parse(key, SIZE_PX, None);
        let number = |key, limits| section.parse::<f64>(key, limits, None);
        let (width_px, height_px) = (size("width_px"), size("height_px"));
        let [fx_px, fy_px] = ["fx_px", "fy_px"].map(|key| number(key, FOCAL_PX));
        let [cx_px, cy_px] = ["cx_px", "cy_px"].map(|key| number(key, CENTRE_PX));
        let [k1, k2, p1, p2, k3] = ["k1", "k2", "p1", "p2", "k3"].map(|key| number(key, COEFFICIENT));
        let covariance = section.parse::<Option<Covariance>>("covariance", (), Some(None));
        let serial = section.parse("serial", (), Some(None));
        let date = section.parse("date", (), Some(None));
        let rms_px = section.parse("rms_px", RESIDUAL, Some(None));
        let extent = LensExtent::parse(section);
        let provenance = Provenance::parse(section, "residuals_px");
        section.finish();
        let camera = PinholeCamera {
            width_px: width_px?,
            height_px: height_px?,
            fx_px: fx_px?,
            fy_px: fy_px?,
            cx_px: cx_px?,
            cy_px: cy_px?,
            k1: k1?,
            k2: k2?,
            p1: p1?,
            p2: p2?,
            k3: k3?,
        };
        if let Some(corner) = corner_without_ray(&camera) {
            let [u, v] = [corner.u, corner.v];
            section.problem(
                "k1",
                format!(
                    "with k1, k2, p1, p2 and k3, the pixel ({u}, {v}) has no ray; check that these values are those of \
                     this camera"
                ),
            );
            return None;
        }
        let covariance = covariance?.map(|covariance| covariance.0);
        let (serial, date, rms_px, extent, provenance) = (serial?, date?, rms_px?, extent?, provenance?);
        Some(Intrinsics { camera, covariance, serial, date, rms_px, extent, provenance, errors: None })
    }

    /// Returns the text of the file. [`Intrinsics::check`] reads all numbers back exactly, if they are within its
    /// ranges.
    pub fn to_toml(&self) -> String {
        let c = &self.camera;
        let mut text = format!("[camera]\nwidth_px = {}\nheight_px = {}\n", c.width_px, c.height_px);
        let numbers = [("fx_px", c.fx_px), ("fy_px", c.fy_px), ("cx_px", c.cx_px), ("cy_px", c.cy_px)];
        let distortion = [("k1", c.k1), ("k2", c.k2), ("p1", c.p1), ("p2", c.p2), ("k3", c.k3)];
        numbers
            .iter()
            .chain(&distortion)
            .for_each(|(key, number)| line(&mut text, key, Some(format!("{number:?}"))));
        let upper = |covariance: &LensCovariance| {
            let numbers = (0..9).flat_map(|row| (row..9).map(move |column| covariance[(row, column)]));
            format!("{:?}", numbers.collect::<Vec<_>>())
        };
        line(&mut text, "covariance", self.covariance.as_ref().map(upper));
        line(&mut text, "serial", self.serial.as_ref().map(|serial| toml::Value::from(serial.as_str())));
        line(&mut text, "date", self.date.as_ref());
        line(&mut text, "rms_px", self.rms_px.map(|number| format!("{number:?}")));
        text += &self.extent.to_toml();
        self.provenance.write(&mut text, "residuals_px");
        if let Some(errors) = &self.errors {
            errors.write(&mut text);
        }
        text
    }
}

fn corner_without_ray(camera: &PinholeCamera) -> Option<Pixel> {
    let (right, low) = (camera.width_px as f64 - 1.0, camera.height_px as f64 - 1.0);
    let corners = [Pixel::at(0.0, 0.0), Pixel::at(right, 0.0), Pixel::at(right, low), Pixel::at(0.0, low)];
    let has_ray = |corner: &Pixel| {
        let ray: Option<Vector<geometry::Camera>> = camera.unproject(*corner);
        // Beyond the radius at which the distortion folds back, the model has a second, false inverse on the other side
        // of the optical axis.
        ray.is_some_and(|ray| {
            let (x, y) = ((corner.u - camera.cx_px) / camera.fx_px, (corner.v - camera.cy_px) / camera.fy_px);
            ray.mm.x * x + ray.mm.y * y >= 0.0
        })
    };
    corners.into_iter().find(|corner| !has_ray(corner))
}

/// A kind of mount: the two frames that it connects, and the name of its table in the file.
pub trait Mount {
    /// The frame to which the mount maps points.
    type To: Frame;
    /// The frame from which the mount maps points.
    type From: Frame;
    /// The name of the mount's table in its file.
    const TABLE: &'static str;
    /// Whether the mounted device has an axis. If so, the file states whether the axis was measured.
    const HAS_AXIS: bool = false;
    /// Whether a board is mounted. If so, the file states the size of the board.
    const IS_BOARD: bool = false;
}

/// `[base_from_camera]`: the mount of the fixed 3D camera (thesis 3.7, eye-to-hand).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScannerMount {}

impl Mount for ScannerMount {
    type To = Base;
    type From = geometry::Camera;
    const TABLE: &'static str = "base_from_camera";
}

/// `[flange_from_camera]`: the mount of the flange camera (thesis 3.7, eye-in-hand).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlangeCameraMount {}

impl Mount for FlangeCameraMount {
    type To = Flange;
    type From = FlangeCamera;
    const TABLE: &'static str = "flange_from_camera";
}

/// `[flange_from_tool]`: the pose of the sanding tool's contact point; Z points out of the pad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ToolMount {}

impl Mount for ToolMount {
    type To = Flange;
    type From = Tool;
    const TABLE: &'static str = "flange_from_tool";
    const HAS_AXIS: bool = true;
}

/// `[base_from_board]`: the pose of the board with which calibrations are verified.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TargetMount {}

impl Mount for TargetMount {
    type To = Base;
    type From = geometry::Board;
    const TABLE: &'static str = "base_from_board";
    const IS_BOARD: bool = true;
}

/// A mount as stored in its file: the pose and its origin.
#[derive(Debug, Clone, PartialEq)]
pub struct MountedPose<M: Mount> {
    /// The pose of the mounted device.
    pub pose: KukaPose,
    /// The date of the calibration.
    pub date: Option<Date>,
    /// Root mean square of the residuals, mm.
    pub rms_mm: Option<f64>,
    /// 95 % uncertainty of the position at the panel, mm.
    pub uncertainty_mm: Option<f64>,
    /// Tool only: whether the direction of the axis was measured, in addition to the contact point.
    pub axis_measured: Option<bool>,
    /// Board only: the size of the board.
    pub board: Option<BoardSize>,
    /// Serial number of the mounted device.
    pub serial: Option<String>,
    /// Hash of the correction of the arm that was applied to the robot's poses; `None` if the poses were not corrected.
    pub robot_correction: Option<String>,
    /// The program, the pictures and the residual of each picture.
    pub provenance: Provenance,
    mount: PhantomData<M>,
}

const POSITION_RANGE_MM: RangeInclusive<f64> = -20_000.0..=20_000.0;
const ANGLE_DEG: RangeInclusive<f64> = -360.0..=360.0;

impl<M: Mount> MountedPose<M> {
    /// Creates a mount that contains only a pose.
    pub fn from_pose(pose: KukaPose) -> Self {
        MountedPose {
            pose,
            date: None,
            rms_mm: None,
            uncertainty_mm: None,
            axis_measured: None,
            board: None,
            serial: None,
            robot_correction: None,
            provenance: Provenance::default(),
            mount: PhantomData,
        }
    }

    /// Returns the mount's pose as a rigid transform.
    pub fn rigid(&self) -> Rigid<M::To, M::From> {
        self.pose.to_rigid()
    }

    /// Parses and checks the file of a mount.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        config::parse_file(file, text, |top| {
            let mounted = Self::parse(&top.section(M::TABLE));
            top.finish();
            mounted
        })
    }

    fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| section.parse(key, POSITION_RANGE_MM, None));
        let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| section.parse(key, ANGLE_DEG, None));
        let date = section.parse("date", (), Some(None));
        let rms_mm = section.parse("rms_mm", RESIDUAL, Some(None));
        let uncertainty_mm = section.parse("uncertainty_mm", RESIDUAL, Some(None));
        let axis_measured = if M::HAS_AXIS { section.parse("axis_measured", (), Some(None)) } else { Some(None) };
        let board = if M::IS_BOARD { BoardSize::parse(section).map(Some) } else { Some(None) };
        let serial = section.parse("serial", (), Some(None));
        let robot_correction = section.parse("robot_correction", (), Some(None));
        let provenance = Provenance::parse(section, "residuals_mm");
        section.finish();
        let pose = KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? };
        let (date, rms_mm, uncertainty_mm, axis_measured) = (date?, rms_mm?, uncertainty_mm?, axis_measured?);
        let (board, serial, robot_correction, provenance) = (board?, serial?, robot_correction?, provenance?);
        let mounted = MountedPose { date, rms_mm, uncertainty_mm, axis_measured, ..Self::from_pose(pose) };
        Some(MountedPose { board, serial, robot_correction, provenance, ..mounted })
    }

    /// Returns the text of the file. [`MountedPose::check`] reads all numbers back exactly, if they are within its
    /// ranges.
    pub fn to_toml(&self) -> String {
        let p = &self.pose;
        let mut text = format!("[{}]\n", M::TABLE);
        let place = [("x_mm", p.x_mm), ("y_mm", p.y_mm), ("z_mm", p.z_mm)];
        let angles = [("a_deg", p.a_deg), ("b_deg", p.b_deg), ("c_deg", p.c_deg)];
        place.iter().chain(&angles).for_each(|(key, number)| line(&mut text, key, Some(format!("{number:?}"))));
        line(&mut text, "date", self.date.as_ref());
        line(&mut text, "rms_mm", self.rms_mm.map(|number| format!("{number:?}")));
        line(&mut text, "uncertainty_mm", self.uncertainty_mm.map(|number| format!("{number:?}")));
        line(&mut text, "axis_measured", self.axis_measured);
        let board = self.board.as_ref();
        line(&mut text, "board", board.map(|board| toml::Value::from(board.board.as_str())));
        line(&mut text, "square_mm", board.map(|board| format!("{:?}", board.square_mm)));
        let quoted = |value: &Option<String>| value.as_ref().map(|value| toml::Value::from(value.as_str()));
        line(&mut text, "serial", quoted(&self.serial));
        line(&mut text, "robot_correction", quoted(&self.robot_correction));
        self.provenance.write(&mut text, "residuals_mm");
        text
    }
}

/// `[rough]`: the camera poses, measured with a tape. Each pose may be absent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RoughMounts {
    /// The pose of the fixed camera in the base frame.
    pub base_from_camera: Option<Rigid<Base, Camera>>,
    /// The pose of the flange camera in the flange frame.
    pub flange_from_camera: Option<Rigid<Flange, FlangeCamera>>,
}

pub(super) fn parse_rough(section: &Section<'_, '_>) -> Option<RoughMounts> {
    let [base_from_camera, flange_from_camera] =
        ["base_from_camera", "flange_from_camera"].map(|key| parse_pose(&section.section(key)));
    section.finish();
    let rough = RoughMounts {
        base_from_camera: base_from_camera?.map(|pose| pose.to_rigid()),
        flange_from_camera: flange_from_camera?.map(|pose| pose.to_rigid()),
    };
    Some(rough)
}

/// Parses a pose. The outer `None` is a problem in the file, the inner `None` means that the table is absent.
fn parse_pose(section: &Section<'_, '_>) -> Option<Option<KukaPose>> {
    if !section.is_present() {
        return Some(None);
    }
    let number = |key, limit: f64| section.parse::<f64>(key, -limit..=limit, None);
    let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| number(key, 20_000.0));
    let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| number(key, 360.0));
    section.finish();
    Some(Some(KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? }))
}

/// The depth errors of a 3D camera, as stored in the file of its intrinsics.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredScanner {
    /// White noise of a pixel at a distance of 700 mm, standard deviation, mm.
    pub white_mm: f64,
    /// Spatially smooth error of one scan, standard deviation, mm.
    pub smooth_mm: f64,
    /// Side of the squares within which the smooth error is constant, mm.
    pub correlation_mm: f64,
    /// Scale error: the ratio of measured to true distances minus one, percent.
    pub scale_percent: f64,
    /// Standard deviation of the scale between scans, without the part that the smooth error explains, percent.
    pub scale_deviation_percent: f64,
    /// Number of board positions that were scanned.
    pub board_positions: usize,
    /// The systematic depth error, which is the same in each scan and is corrected; `None` if none was found.
    pub field: Option<DepthField>,
    /// Date of the measurement.
    pub date: Option<Date>,
    /// The program, the scans and the deviation of each scan from a plane, mm.
    pub provenance: Provenance,
}

/// The name of the table with the depth errors.
const TABLE: &str = "scanner_errors";
const LENGTH_MM: RangeInclusive<f64> = 5.0..=2_000.0;
const ERROR_MM: RangeInclusive<f64> = 0.001..=10.0;
const PERCENT: RangeInclusive<f64> = -10.0..=10.0;
const DIRECTION: RangeInclusive<f64> = -5.0..=5.0;
const FIELD_MM: RangeInclusive<f64> = -50.0..=50.0;

impl MeasuredScanner {
    /// Parses the table `[scanner_errors]`. The outer `None` is a problem in the file, the inner `None` means that the
    /// table is absent.
    pub(super) fn parse(top: &Section<'_, '_>) -> Option<Option<Self>> {
        let section = top.section(TABLE);
        if !section.is_present() {
            return Some(None);
        }
        let error = |key| section.parse::<f64>(key, ERROR_MM, None);
        let (white_mm, smooth_mm) = (error("white_mm"), error("smooth_mm"));
        let correlation_mm = section.parse::<f64>("correlation_mm", LENGTH_MM, None);
        let percent = |key| section.parse::<f64>(key, PERCENT, None);
        let (scale_percent, scale_deviation_percent) =
            (percent("scale_percent"), percent("scale_deviation_percent"));
        let places = section.parse::<usize>("places", 1..=10_000, None);
        let field = Self::field(&section);
        let date = section.parse("date", (), Some(None));
        let provenance = Provenance::parse(&section, "residuals_mm");
        section.finish();
        Some(Some(MeasuredScanner {
            white_mm: white_mm?,
            smooth_mm: smooth_mm?,
            correlation_mm: correlation_mm?,
            scale_percent: scale_percent?,
            scale_deviation_percent: scale_deviation_percent?,
            board_positions: places?,
            field: field?,
            date: date?,
            provenance: provenance?,
        }))
    }

    /// Parses the three keys of the field of systematic errors: all of them, or none.
    fn field(section: &Section<'_, '_>) -> Option<Option<DepthField>> {
        let direction = |key| section.parse::<Option<[f64; 2]>>(key, DIRECTION, Some(None));
        let (from, to) = (direction("field_from"), direction("field_to"));
        let coefficients = section.parse::<Option<[f64; FIELD_SIZE]>>("field_mm", FIELD_MM, Some(None));
        match (from?, to?, coefficients?) {
            (None, None, None) => Some(None),
            (Some(from), Some(to), Some(coefficients_mm)) if from[0] < to[0] && from[1] < to[1] => {
                Some(Some(DepthField { rectangle: FieldRectangle { min: from, max: to }, coefficients_mm }))
            }
            _ => {
                section.problem(
                    "field_mm",
                    "state all of field_from, field_to and field_mm, or none; field_from must be less than field_to",
                );
                None
            }
        }
    }

    /// Writes the table. [`MeasuredScanner::parse`] reads all numbers back exactly.
    pub(super) fn write(&self, text: &mut String) {
        text.push_str("\n[scanner_errors]\n");
        let numbers = [
            ("white_mm", self.white_mm),
            ("smooth_mm", self.smooth_mm),
            ("correlation_mm", self.correlation_mm),
            ("scale_percent", self.scale_percent),
            ("scale_deviation_percent", self.scale_deviation_percent),
        ];
        numbers.iter().for_each(|(key, number)| line(text, key, Some(format!("{number:?}"))));
        line(text, "places", Some(self.board_positions));
        if let Some(DepthField { rectangle: over, coefficients_mm }) = &self.field {
            line(text, "field_from", Some(format!("{:?}", over.min)));
            line(text, "field_to", Some(format!("{:?}", over.max)));
            line(text, "field_mm", Some(format!("{coefficients_mm:?}")));
        }
        line(text, "date", self.date.as_ref());
        self.provenance.write(text, "residuals_mm");
    }
}

#[cfg(test)]
mod tests {
    use super::super::Intrinsics;
    use super::*;
    use panelprep_base::geometry::PinholeCamera;

    fn lens(errors: MeasuredScanner) -> Intrinsics {
        let camera = PinholeCamera {
            width_px: 1944,
            height_px: 1200,
            fx_px: 1785.0,
            fy_px: 1784.0,
            cx_px: 972.0,
            cy_px: 600.0,
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        };
        Intrinsics { errors: Some(errors), ..Intrinsics::from_camera(camera) }
    }

    fn errors(field: Option<DepthField>) -> MeasuredScanner {
        MeasuredScanner {
            white_mm: 0.054_321,
            smooth_mm: 0.033,
            correlation_mm: 80.0,
            scale_percent: -0.0123,
            scale_deviation_percent: 0.02,
            board_positions: 16,
            field,
            date: None,
            provenance: Provenance { residuals: vec![0.03, 0.04], ..Provenance::default() },
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let over = FieldRectangle { min: [-0.55, -0.34], max: [0.55, 0.34] };
        let field =
            DepthField { rectangle: over, coefficients_mm: std::array::from_fn(|k| 0.1 / (1.0 + k as f64)) };
        for lens in [lens(errors(None)), lens(errors(Some(field)))] {
            assert_eq!(Intrinsics::check("f", &lens.to_toml()), Ok(lens.clone()), "{}", lens.to_toml());
        }
    }

    #[test]
    fn each_mistake_is_named() {
        let text = lens(errors(None)).to_toml();
        let wrong = text.replace("smooth_mm = 0.033", "smooth_mm = 0.0").replace("places", "plaecs");
        let problems = Intrinsics::check("f", &(wrong + "field_from = [0, 0]\n")).expect_err("refused").to_string();
        for words in [
            "scanner_errors.smooth_mm: found 0.0",
            "places",
            "state all of field_from, field_to and field_mm, or none",
        ] {
            assert!(problems.contains(words), "{words}: {problems}");
        }
    }
}
