//! Tests of the files that a cell names, lenses and mounts: they are read, refused, and written as they were read.

use super::super::*;
use super::problems;
use panelprep_base::geometry::{KukaPose, PinholeCamera, Pixel, Point};
use proptest::prelude::*;

const LENS: &str =
    "[camera]\nwidth_px = 1944\nheight_px = 1200\nfx_px = 1785.0\nfy_px = 1784.0\ncx_px = 972.0\ncy_px = 600.0
k1 = -0.1\nk2 = 0.12\np1 = 0.0006\np2 = -0.0004\nk3 = -0.02\n";

#[test]
fn intrinsics_are_read_with_where_they_come_from() {
    let text = format!("{LENS}serial = \"Z-2\"\ndate = 2026-05-31\nrms_px = 0.21\n");
    let lens = Intrinsics::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!((lens.camera.width_px, lens.camera.fx_px, lens.camera.k3), (1944, 1785.0, -0.02));
    assert_eq!(
        (lens.serial.as_deref(), lens.date, lens.rms_px),
        (Some("Z-2"), Date::parse("2026-05-31"), Some(0.21))
    );
}

#[test]
fn intrinsics_that_cannot_be_a_cameras_are_refused() {
    let wrong = |from: &str, to: &str| problems(Intrinsics::check("f", &LENS.replace(from, to)));
    assert_eq!(
        wrong("fx_px = 1785.0", "fx_mm = 6.2"),
        ["4: camera.fx_mm: unknown key; this length is in px: write fx_px"]
    );
    assert_eq!(wrong("k2 = 0.12", "k2 = nan"), ["9: camera.k2: found nan, valid: a number from -1000 to 1000"]);
    assert_eq!(wrong("p1 = 0.0006\n", ""), ["1: camera.p1: is missing; this key has no default"]);
    // By hand: k1 = −10 folds where 1 − 30 r² = 0, r = 0.18, and the corner lies at 0.64.
    assert_eq!(
        wrong("k1 = -0.1", "k1 = -10.0"),
        [
            "8: camera.k1: with k1, k2, p1, p2 and k3, the pixel (0, 0) has no ray; check that these values are those \
             of this camera"
        ]
    );
    // Calculated by hand: k1 = −1 folds at r = 0.58; r − r³ = 0.64 is true only at r = −1.23, across the axis.
    assert_eq!(wrong("k1 = -0.1", "k1 = -1.0").len(), 1, "a false inverse is none");
    let dated = |date: &str| problems(Intrinsics::check("f", &format!("{LENS}date = {date}")));
    assert_eq!(dated("2026-05-31T10:00:00"), ["13: camera.date: valid: a date, such as 2026-05-31"]);
    assert_eq!(dated("'yesterday'"), ["13: camera.date: valid: a date, such as 2026-05-31"]);
    assert!(dated("'2026-05-31'").is_empty());
}

const MOUNT: &str = "x_mm = 600\ny_mm = 0\nz_mm = 900\na_deg = 90\nb_deg = 0\nc_deg = 180\n";

/// Calculated by hand: Rx(180) turns the camera's z to −z; A about Z does not change this. A point 500 mm in front
/// of the lens is at z = 400.
#[test]
fn a_mount_maps_its_own_frames() {
    let text = format!("[base_from_camera]\n{MOUNT}rms_mm = 0.1\n");
    let mounted = MountedPose::<ScannerMount>::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"));
    let seen = mounted.rigid() * Point::at(0.0, 0.0, 500.0);
    assert!(seen.distance_mm(Point::at(600.0, 0.0, 400.0)) < 1e-9, "{seen:?}");
    assert_eq!((mounted.rms_mm, mounted.uncertainty_mm), (Some(0.1), None));
}

#[test]
fn a_mount_is_not_taken_for_another() {
    let camera = format!("[flange_from_camera]\n{MOUNT}");
    assert_eq!(problems(MountedPose::<FlangeCameraMount>::check("f", &camera)), Vec::<String>::new());
    assert_eq!(
        problems(MountedPose::<ToolMount>::check("f", &camera)),
        ["1: flange_from_camera: unknown key; did you mean flange_from_tool?"]
    );
    let axis = "axis_measured = true\n";
    assert_eq!(
        problems(MountedPose::<FlangeCameraMount>::check("f", &format!("{camera}{axis}"))),
        [
            "8: flange_from_camera.axis_measured: unknown key; valid keys here: x_mm, y_mm, z_mm, a_deg, b_deg, c_deg, \
             date, rms_mm, uncertainty_mm, serial, robot_correction, program, pictures, residuals_mm"
        ]
    );
    let tool = format!("[flange_from_tool]\n{MOUNT}{axis}");
    let tool = MountedPose::<ToolMount>::check("f", &tool).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(tool.axis_measured, Some(true));
}

#[test]
fn a_mount_in_other_units_is_refused() {
    let text = format!(
        "[base_from_camera]\n{}",
        MOUNT.replace("x_mm = 600", "x_m = 0.6").replace("a_deg = 90", "a_rad = 1.57")
    );
    assert_eq!(
        problems(MountedPose::<ScannerMount>::check("f", &text)),
        [
            "2: base_from_camera.x_m: unknown key; this length is in mm: write x_mm",
            "5: base_from_camera.a_rad: unknown key; this angle is in degrees: write a_deg"
        ]
    );
}

fn date() -> impl Strategy<Value = Option<Date>> {
    prop::option::of((2000..2100i32, 1..=12i32, 1..=28i32))
        .prop_map(|day| day.and_then(|(year, month, day)| Date::parse(&format!("{year:04}-{month:02}-{day:02}"))))
}

proptest! {
    /// A written calibration is read back with identical bits.
    #[test]
    fn intrinsics_come_back_as_written(
        (width_px, height_px) in (16..4000usize, 16..4000usize),
        focal_px in 4_000.0..9_000.0f64,
        centre_px in prop::array::uniform2(0.0..4000.0f64),
        coefficients in prop::array::uniform5(-1e-3..1e-3f64),
        serial in prop::option::of("\\PC{0,12}[^\\s\\p{C}]"),
        date in date(),
        rms_px in prop::option::of(0.0..9.0f64),
    ) {
        let [k1, k2, p1, p2, k3] = coefficients;
        let [cx_px, cy_px] = centre_px;
        let (fx_px, fy_px) = (focal_px, focal_px * 1.001);
        let camera = PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 };
        let provenance = Provenance {
            program: Some("panelprep \"0\"".to_owned()),
            pictures: vec!["ab".to_owned(), "cd".to_owned()],
            residuals: rms_px.into_iter().collect(),
        };
        let covariance = rms_px.map(|_| LensCovariance::from_fn(|i, j| 0.1 / (1.0 + i.abs_diff(j) as f64)));
        let outline_px = vec![Pixel::at(1.5, 2.0), Pixel::at(9.0, 2.0), Pixel::at(9.0, 8.25)];
        let extent = LensExtent {
            model: Some("k1k2".to_owned()),
            excluded_coefficients: vec!["k3: as good without".to_owned()],
            supported: rms_px.map(|error_px| SupportedArea { error_px, outline_px }),
        };
        let lens = Intrinsics { camera, covariance, serial, date, rms_px, extent, provenance, errors: None };
        prop_assert_eq!(Intrinsics::check("f", &lens.to_toml()), Ok(lens.clone()), "{}", lens.to_toml());
    }

    #[test]
    fn mounts_come_back_as_written(
        place_mm in prop::array::uniform3(-2e4..2e4f64),
        angles_deg in prop::array::uniform3(-360.0..360.0f64),
        date in date(),
        residuals_mm in prop::option::of((0.0..9.0f64, 1e-12..9.0f64)),
        axis_measured in prop::option::of(prop::bool::ANY),
    ) {
        let ([x_mm, y_mm, z_mm], [a_deg, b_deg, c_deg]) = (place_mm, angles_deg);
        let (rms_mm, uncertainty_mm) = residuals_mm.unzip();
        let pose = KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg };
        let mut tool = MountedPose::<ToolMount>::from_pose(pose);
        (tool.date, tool.rms_mm) = (date, rms_mm);
        (tool.uncertainty_mm, tool.axis_measured) = (uncertainty_mm, axis_measured);
        prop_assert_eq!(MountedPose::check("f", &tool.to_toml()), Ok(tool.clone()), "{}", tool.to_toml());
        let camera = MountedPose::<ScannerMount>::from_pose(pose);
        prop_assert_eq!(MountedPose::check("f", &camera.to_toml()), Ok(camera));
    }
}
