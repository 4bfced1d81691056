//! Two parts of a lens file: the extent (the model, the excluded coefficients, and the part of the picture in which the
//! lens is calibrated), and lens files of other programs, in YAML: OpenCV's FileStorage, ROS's `camera_info`, and
//! Zivid's intrinsics.
//!
//! All three formats contain Brown's model with k1, k2, p1, p2, k3, like the file of this program. A lens with another
//! model is refused, because its first coefficients would be taken for those of Brown's model. Zivid's file does not
//! state the picture's size.

use super::provenance::TextList;
use panelprep_base::config::{Section, Setting};
use panelprep_base::geometry::{PinholeCamera, Pixel, polygon};
use saphyr::{LoadableYamlNode, Scalar, Yaml};
use std::fmt::Write;
use toml::de::DeValue;

/// The part of the picture in which the error of a lens is below a stated limit.
#[derive(Debug, Clone, PartialEq)]
pub struct SupportedArea {
    /// The limit of the error (95 %), px.
    pub error_px: f64,
    /// The corners of the part's outline; without corners, the lens is calibrated at no pixel.
    pub outline_px: Vec<Pixel>,
}

impl SupportedArea {
    /// Returns whether the lens is calibrated at this pixel.
    pub fn contains_pixel(&self, pixel: Pixel) -> bool {
        polygon::contains(&self.outline_px, pixel)
    }
}

/// The model of a lens and the part of the picture in which it is calibrated. All values may be absent, as in files of
/// other programs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LensExtent {
    /// The estimated coefficients of the lens model, such as `k1k2`.
    pub model: Option<String>,
    /// The excluded coefficients, each with the reason.
    pub excluded_coefficients: Vec<String>,
    /// The part of the picture in which the lens is calibrated; `None` for the whole picture.
    pub supported: Option<SupportedArea>,
}

impl LensExtent {
    /// Returns whether the lens is calibrated at this pixel.
    pub fn contains_pixel(&self, pixel: Pixel) -> bool {
        self.supported.as_ref().is_none_or(|supported| supported.contains_pixel(pixel))
    }

    pub(super) fn parse(section: &Section<'_, '_>) -> Option<Self> {
        let model = section.parse::<Option<String>>("model", (), Some(None));
        let left_out = section.parse("left_out", (), Some(TextList::default()));
        let error_px = section.parse::<Option<f64>>("supported_error_px", ERROR_PX, Some(None));
        let outline = section.parse::<Option<Outline>>("supported_px", (), Some(None));
        let supported = match (error_px?, outline?) {
            (Some(error_px), Some(Outline(outline_px))) => Some(SupportedArea { error_px, outline_px }),
            (None, None) => None,
            _ => {
                section.problem("supported_px", "state both supported_px and supported_error_px, or neither");
                return None;
            }
        };
        Some(LensExtent { model: model?, excluded_coefficients: left_out?.0, supported })
    }

    #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
    pub(super) fn to_toml(&self) -> String {
        let mut text = String::new();
        // Writing to a `String` cannot fail.
        if let Some(model) = &self.model {
            let _ = writeln!(text, "model = {}", toml::Value::from(model.as_str()));
        }
        if !self.excluded_coefficients.is_empty() {
            let _ = writeln!(text, "left_out = {}", toml::Value::from(self.excluded_coefficients.clone()));
        }
        if let Some(SupportedArea { error_px, outline_px }) = &self.supported {
            let corners: Vec<[f64; 2]> = outline_px.iter().map(|pixel| [pixel.u, pixel.v]).collect();
            let _ = writeln!(text, "supported_error_px = {error_px:?}\nsupported_px = {corners:?}");
        }
        text
    }
}

const ERROR_PX: std::ops::RangeInclusive<f64> = 0.0..=100.0;
const CORNER_PX: std::ops::RangeInclusive<f64> = -20_000.0..=40_000.0;

struct Outline(Vec<Pixel>);

impl Setting for Outline {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let list = value.as_array().ok_or_else(|| "valid: a list of [u, v]".to_owned())?;
        let corner = |item: &toml::Spanned<DeValue<'_>>| {
            <[f64; 2]>::parse(item.get_ref(), &CORNER_PX).map(|[u, v]| Pixel::at(u, v))
        };
        list.iter().map(corner).collect::<Result<_, _>>().map(Outline)
    }
}

/// Top-level keys that identify a lens file of another program.
const IDENTIFYING_KEYS: [&str; 6] =
    ["CameraIntrinsics:", "camera_matrix:", "cameraMatrix:", "Camera_Matrix:", "distortion_coefficients:", "K:"];

/// Returns whether this text is a lens file in the format of another program.
pub(super) fn is_foreign_lens(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim_start);
    lines.any(|line| IDENTIFYING_KEYS.iter().any(|key| line.starts_with(key)))
}

/// Reads a lens file of another program.
///
/// # Errors
/// If a value is missing or has the wrong type; the error states how to correct the file.
pub(super) fn read(text: &str) -> Result<PinholeCamera, String> {
    // OpenCV's files begin with a directive that is not valid YAML, and have tags on their matrices.
    let plain: Vec<String> = text
        .lines()
        .map(|line| if line.starts_with('%') { String::new() } else { line.replace("!!opencv-matrix", "") })
        .collect();
    let documents = Yaml::load_from_str(&plain.join("\n"))
        .map_err(|error| format!("this is not valid YAML: {}", error.info()))?;
    let [top] = documents.as_slice() else { return Err("valid: exactly one YAML document".to_owned()) };
    let size = |names: &[&str], what: &str| {
        let found = names.iter().find_map(|name| number(top, &[name]));
        found.filter(|size| *size >= 1.0).map(|size| size as usize).ok_or_else(|| {
            format!(
                "the picture's {what} is missing; this kind of file does not state it: add a line '{}: …', or read \
                 the lens from a scan with panelprep calibrate intrinsics --from-scan",
                names[0]
            )
        })
    };
    let width = || size(&["image_width", "width", "width_px", "image_Width"], "width");
    let height = || size(&["image_height", "height", "height_px", "image_Height"], "height");
    if find_value(top, &["CameraIntrinsics"]).is_some() {
        let of = |part: &str, key: &str| {
            number(top, &["CameraIntrinsics", part, key])
                .ok_or_else(|| format!("CameraIntrinsics.{part}.{key} is missing"))
        };
        let (matrix, distortion) = ("CameraMatrix", "Distortion");
        return Ok(PinholeCamera {
            fx_px: of(matrix, "FX")?,
            fy_px: of(matrix, "FY")?,
            cx_px: of(matrix, "CX")?,
            cy_px: of(matrix, "CY")?,
            k1: of(distortion, "K1")?,
            k2: of(distortion, "K2")?,
            p1: of(distortion, "P1")?,
            p2: of(distortion, "P2")?,
            k3: of(distortion, "K3")?,
            width_px: width()?,
            height_px: height()?,
        });
    }
    let model = find_value(top, &["distortion_model"]).and_then(Yaml::as_str);
    if let Some(model) = model.filter(|model| *model != "plumb_bob") {
        return Err(format!("the lens model is {model}, valid: plumb_bob (k1, k2, p1, p2, k3)"));
    }
    let matrix = find_numbers(top, &["camera_matrix", "cameraMatrix", "Camera_Matrix", "K"]);
    let [fx_px, skew, cx_px, row_2, fy_px, cy_px, row_3 @ ..] = matrix.as_slice() else {
        return Err("the nine numbers of camera_matrix are missing".to_owned());
    };
    if *row_2 != 0.0 || *row_3 != [0.0, 0.0, 1.0] {
        return Err(format!(
            "camera_matrix is {}; its nine numbers are fx 0 cx, 0 fy cy, 0 0 1, row by row",
            matrix.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
        ));
    }
    if *skew != 0.0 {
        return Err(format!("the camera matrix has a skew of {skew}, valid: 0"));
    }
    let names = [
        "distortion_coefficients",
        "distCoeffs",
        "dist_coeffs",
        "Distortion_Coefficients",
        "distortion_coeffs",
        "D",
    ];
    let coefficients = find_numbers(top, &names);
    // A file with four coefficients may be that of a fisheye lens, whose coefficients are not k1, k2, p1, p2.
    if !matches!((coefficients.len(), model), (5.., _) | (4, Some(_))) {
        return Err(
            "distortion_coefficients k1, k2, p1, p2 and k3 are missing; a file with only four coefficients must also \
             state distortion_model plumb_bob"
                .to_owned(),
        );
    }
    if coefficients.iter().skip(5).any(|coefficient| *coefficient != 0.0) {
        return Err(format!(
            "found {} distortion coefficients; this program supports only k1, k2, p1, p2 and k3: calibrate without the \
             rational model",
            coefficients.len()
        ));
    }
    let k3 = coefficients.get(4).copied().unwrap_or(0.0);
    let [k1, k2, p1, p2] = [0, 1, 2, 3].map(|at| coefficients[at]);
    let (fx_px, fy_px, cx_px, cy_px) = (*fx_px, *fy_px, *cx_px, *cy_px);
    Ok(PinholeCamera { width_px: width()?, height_px: height()?, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 })
}

fn find_value<'y, 't>(top: &'y Yaml<'t>, path: &[&str]) -> Option<&'y Yaml<'t>> {
    path.iter().try_fold(top, |node, name| {
        let mapping = node.as_mapping()?;
        mapping.iter().find(|(key, _)| key.as_str() == Some(*name)).map(|(_, value)| value)
    })
}

fn scalar(node: &Yaml<'_>) -> Option<f64> {
    match node {
        Yaml::Value(Scalar::Integer(number)) => Some(*number as f64),
        Yaml::Value(Scalar::FloatingPoint(number)) => Some(number.into_inner()),
        // OpenCV writes a number as `600.`, which is a string in YAML.
        Yaml::Value(Scalar::String(text)) => text.trim().parse().ok(),
        _ => None,
    }
    .filter(|number| number.is_finite())
}

fn number(top: &Yaml<'_>, path: &[&str]) -> Option<f64> {
    scalar(find_value(top, path)?)
}

/// Returns the numbers under the first of these keys that exists: a list, or a matrix with `data`. Empty if an element
/// is missing or is not a number.
fn find_numbers(top: &Yaml<'_>, names: &[&str]) -> Vec<f64> {
    let node = names.iter().find_map(|name| find_value(top, &[name]));
    let data = node.and_then(|node| find_value(node, &["data"]).or(Some(node)));
    let list =
        data.and_then(|data| data.as_sequence()).map(|list| list.iter().map(scalar).collect::<Option<Vec<f64>>>());
    list.flatten().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROS: &str = "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [600.5, 0, 321, 0, 601, 239.5, 0, 0, 1]\n\
                       distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 0.001, -0.002, 0]\n";

    #[test]
    fn lenses_of_ros_opencv_and_zivid_are_read() {
        let lens = read(ROS).expect("a lens");
        assert_eq!((lens.width_px, lens.height_px, lens.fx_px, lens.cy_px), (640, 480, 600.5, 239.5));
        assert_eq!((lens.k1, lens.p2, lens.k3), (-0.1, -0.002, 0.0));
        let opencv = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
                      data: [ 600.5, 0., 321., 0., 601., 239.5, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   \
                      data: [ -1.0e-01, 2.0e-02, 1.0e-03, -2.0e-03, 0. ]\n";
        assert!(is_foreign_lens(opencv) && is_foreign_lens(ROS));
        assert_eq!(read(opencv), Ok(lens));
        let zivid = "__version__:\n  serializer: 1\n  data: 8\nCameraIntrinsics:\n  CameraMatrix:\n    CX: 970.3\n    CY: 602.1\n    FX: 1785.2\n    \
                     FY: 1784.6\n  Distortion:\n    K1: -0.082\n    K2: 0.105\n    K3: -0.02\n    P1: 0.0006\n    P2: -0.0004\n";
        assert!(is_foreign_lens(zivid));
        let error = read(zivid).expect_err("no size");
        assert!(error.contains("picture's width") && error.contains("--from-scan"), "{error}");
        let sized = read(&format!("{zivid}image_width: 1944\nimage_height: 1200\n")).expect("a lens");
        assert_eq!((sized.fx_px, sized.k3, sized.p1, sized.height_px), (1785.2, -0.02, 0.0006, 1200));
    }

    #[test]
    fn lenses_of_another_model_are_refused() {
        let error = read(&ROS.replace("plumb_bob", "equidistant")).expect_err("a fisheye");
        assert!(error.contains("equidistant"), "{error}");
        let error = read(&ROS.replace("-0.002, 0]", "-0.002, 0, 0.3, 0, 0]")).expect_err("rational");
        assert!(error.contains("without the rational model"), "{error}");
        assert!(read("camera_matrix: [1, 2]").is_err());
        assert!(!is_foreign_lens("[camera]\nfx_px = 3\n"));
    }
}
