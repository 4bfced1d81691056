//! Reads and writes poses as JSON: either a pose `{x_mm, y_mm, z_mm, a_deg, b_deg, c_deg}`, or an object that contains
//! a pose under a key, like the output of the commands.
//!
//! JSON has no NaN, and the parser refuses numbers that are too large for a double; therefore every pose is finite.

use crate::panel::TaughtSource;
use panelprep_base::geometry::{Joints, KukaPose};
use serde::Deserialize;

/// The reason why a file contains no valid pose.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PoseError {
    /// The file contains no pose.
    #[error("{problem}; valid: {{x_mm, y_mm, z_mm, a_deg, b_deg, c_deg}}, or an object with such a pose as {key}")]
    Text {
        /// The key under which a pose is expected.
        key: &'static str,
        /// The problem that the JSON parser reports, with the line.
        problem: String,
    },
    /// The file is the output of a command that has found no pose.
    #[error("{key} is null: the command that printed this file found no pose; run it again until it finds one")]
    NotFound {
        /// The key under which the pose is null.
        key: &'static str,
    },
    /// The panel is taught from its drawing, but the pose in the file does not refer to the drawing's frame.
    #[error(
        "the panel is taught from its drawing, and this file does not state the same pose as base_from_panel and \
         base_from_drawing: it is of a panel that was taught by a scan; locate the panel again"
    )]
    NotOfDrawing,
    /// The pose in the file refers to a drawing's frame, but the panel is not taught from a drawing.
    #[error(
        "this file states base_from_drawing, but the recipe has no [nominal]: the file belongs to a panel that was taught from its drawing; locate the panel with this recipe"
    )]
    OfDrawing,
    /// The file is the output of a command with the verdict `reject`, so that its pose must not be used.
    #[error(
        "the verdict in this file is 'reject', so that {key} must not be used: correct the causes that the reasons in the file state, and run the command again"
    )]
    Rejected {
        /// The key of the pose that must not be used.
        key: &'static str,
    },
}

/// Reads the pose of the panel (base from panel): either a pose, or the output of `locate` or `refine`. `taught_by` is
/// how the recipe's panel was taught, because a panel that is taught from its drawing has a different frame; `None` if
/// no recipe is given.
///
/// # Errors
/// If the file contains no complete pose, has the verdict `reject`, or refers to another frame.
pub fn read_located(bytes: &[u8], taught_by: Option<TaughtSource>) -> Result<KukaPose, PoseError> {
    let key = "base_from_panel";
    let Some(LocatedFile { base_from_panel, base_from_drawing, verdict, .. }) = parse_if_present(bytes, key)?
    else {
        return parse_bare_pose(bytes, key);
    };
    let pose = check_verdict(base_from_panel, verdict, key)?;
    match (taught_by, base_from_drawing) {
        (Some(TaughtSource::Drawing), None) => Err(PoseError::NotOfDrawing),
        (Some(TaughtSource::Scan), Some(_)) => Err(PoseError::OfDrawing),
        (_, Some(drawn)) if drawn != pose => Err(PoseError::NotOfDrawing),
        _ => Ok(pose),
    }
}

/// Reads the uncertainty (95 %, mm) of the pose that [`read_located`] reads; `None` if the file does not state it.
///
/// # Errors
/// If the file contains no pose.
pub fn read_located_mm(bytes: &[u8]) -> Result<Option<f64>, PoseError> {
    let printed: Option<LocatedFile> = parse_if_present(bytes, "base_from_panel")?;
    Ok(printed.and_then(|printed| printed.uncertainty_mm))
}

/// Reads the pose of the flange (base from flange): either a pose, or an object with the key `base_from_flange`.
///
/// # Errors
/// If the file contains no complete pose.
pub fn read_flange(bytes: &[u8]) -> Result<KukaPose, PoseError> {
    let key = "base_from_flange";
    let printed: Option<FlangeFile> = parse_if_present(bytes, key)?;
    printed
        .map_or_else(|| parse_bare_pose(bytes, key), |printed| check_verdict(printed.base_from_flange, None, key))
}

/// The flange pose as reported by the controller, with the axis angles if the file contains them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportedFlange {
    /// The pose of the flange in the base frame.
    pub base_from_flange: KukaPose,
    /// The axis angles `axes_deg`, A1 to A6.
    pub joints: Option<Joints>,
}

/// Reads a pose as [`read_flange`] does, and the optional key `axes_deg` beside `base_from_flange`.
///
/// # Errors
/// The errors of [`read_flange`].
pub fn read_reported_flange(bytes: &[u8]) -> Result<ReportedFlange, PoseError> {
    let printed: Option<FlangeFile> = parse_if_present(bytes, "base_from_flange")?;
    let joints = printed.and_then(|printed| printed.axes_deg).map(Joints::from);
    Ok(ReportedFlange { base_from_flange: read_flange(bytes)?, joints })
}

/// Returns the flange pose as JSON for [`read_reported_flange`], with a newline at the end.
pub fn write_reported_flange(flange: &ReportedFlange) -> String {
    match flange.joints {
        None => write_pose(&flange.base_from_flange),
        Some(joints) => {
            let (base_from_flange, axes_deg) = (flange.base_from_flange, joints.degrees());
            serde_json::json!({"base_from_flange": base_from_flange, "axes_deg": axes_deg}).to_string() + "\n"
        }
    }
}

/// Returns the pose as JSON, with a newline at the end.
pub fn write_pose(pose: &KukaPose) -> String {
    serde_json::json!(pose).to_string() + "\n"
}

#[derive(Deserialize)]
struct LocatedFile {
    base_from_panel: Option<KukaPose>,
    base_from_drawing: Option<KukaPose>,
    verdict: Option<String>,
    uncertainty_mm: Option<f64>,
}

#[derive(Deserialize)]
struct FlangeFile {
    base_from_flange: Option<KukaPose>,
    axes_deg: Option<[f64; 6]>,
}

/// Parses the object if it contains the key; `None` if the key is absent. The original text is parsed a second time, so
/// that errors state the correct line.
fn parse_if_present<'b, T: Deserialize<'b>>(bytes: &'b [u8], key: &'static str) -> Result<Option<T>, PoseError> {
    let text = |error: serde_json::Error| PoseError::Text { key, problem: error.to_string() };
    let value: serde_json::Value = serde_json::from_slice(bytes).map_err(text)?;
    value.get(key).map(|_| serde_json::from_slice(bytes)).transpose().map_err(text)
}

fn parse_bare_pose(bytes: &[u8], key: &'static str) -> Result<KukaPose, PoseError> {
    serde_json::from_slice(bytes).map_err(|error| PoseError::Text { key, problem: error.to_string() })
}

fn check_verdict(
    pose: Option<KukaPose>,
    verdict: Option<String>,
    key: &'static str,
) -> Result<KukaPose, PoseError> {
    match verdict.as_deref() {
        Some("reject") => Err(PoseError::Rejected { key }),
        _ => pose.ok_or(PoseError::NotFound { key }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BARE: &str = r#"{"x_mm": 1, "y_mm": 2.5, "z_mm": -3, "a_deg": 4, "b_deg": 5, "c_deg": 6}"#;
    const POSE: KukaPose = KukaPose { x_mm: 1.0, y_mm: 2.5, z_mm: -3.0, a_deg: 4.0, b_deg: 5.0, c_deg: 6.0 };

    #[test]
    fn a_pose_is_alone_or_in_what_a_command_printed() {
        let printed = format!(r#"{{"verdict": "accept", "base_from_panel": {BARE}, "rms_mm": 0.02}}"#);
        for taught_by in [None, Some(TaughtSource::Scan), Some(TaughtSource::Drawing)] {
            assert_eq!(read_located(BARE.as_bytes(), taught_by), Ok(POSE), "{taught_by:?}");
        }
        assert_eq!(read_located(printed.as_bytes(), Some(TaughtSource::Scan)), Ok(POSE));
        assert_eq!(read_located_mm(printed.as_bytes()), Ok(None));
        assert_eq!(read_located_mm(printed.replace("rms_mm", "uncertainty_mm").as_bytes()), Ok(Some(0.02)));
        assert_eq!(read_located_mm(BARE.as_bytes()), Ok(None));
        assert_eq!(read_flange(format!(r#"{{"base_from_flange": {BARE}}}"#).as_bytes()), Ok(POSE));
        let bare = ReportedFlange { base_from_flange: POSE, joints: None };
        assert_eq!(read_reported_flange(BARE.as_bytes()), Ok(bare));
        let whole = ReportedFlange { joints: Some(Joints::from([1.0, -90.5, 90.0, 0.0, 5.0, 6.0])), ..bare };
        assert_eq!(read_reported_flange(write_reported_flange(&whole).as_bytes()), Ok(whole));
        assert_eq!(read_reported_flange(write_reported_flange(&bare).as_bytes()), Ok(bare));
        let five = format!(r#"{{"base_from_flange": {BARE}, "axes_deg": [1, 2, 3, 4, 5]}}"#);
        assert!(read_reported_flange(five.as_bytes()).is_err());
    }

    #[test]
    fn each_refusal_states_which_key() {
        let located =
            |text: &str| read_located(text.as_bytes(), Some(TaughtSource::Scan)).expect_err("refused").to_string();
        let cases = [
            (BARE.replace("a_deg", "a_rad"), "unknown field `a_rad`, expected one of `x_mm`"),
            (BARE.replace(r#", "c_deg": 6"#, ""), "missing field `c_deg` at line 1"),
            (BARE.replace("z_mm", "x_mm"), "duplicate field `x_mm`"),
            (BARE.replace("2.5", "NaN"), "expected value at line 1 column 21"),
            (BARE.replace("2.5", "1e999"), "number out of range at line 1"),
            (BARE.replace("2.5", "\"2.5\""), "invalid type: string \"2.5\", expected f64"),
            (format!(r#"{{"base_from_flange": {BARE}}}"#), "unknown field `base_from_flange`"),
            (r#"{"base_from_panel": null}"#.to_owned(), "base_from_panel is null"),
            (
                format!(r#"{{"verdict": "reject", "base_from_panel": {BARE}}}"#),
                "the verdict in this file is 'reject'",
            ),
            (format!(r#"{{"base_from_panel": {}}}"#, BARE.replace("x_mm", "x")), "unknown field `x`"),
            (String::new(), "an object with such a pose as base_from_panel"),
        ];
        for (text, expected) in cases {
            let found = located(&text);
            assert!(found.contains(expected), "{found}\nshould say: {expected}");
        }
    }

    /// A panel that is taught from its drawing has the drawing's frame. With a pose that refers to another frame, the
    /// tool would move to a wrong place.
    #[test]
    fn a_pose_of_another_frame_is_refused() {
        let of = |more: &str| format!(r#"{{"verdict": "accept", "base_from_panel": {BARE}{more}}}"#);
        let drawn = of(&format!(r#", "base_from_drawing": {BARE}"#));
        let old = of(&format!(r#", "base_from_drawing": {}"#, BARE.replacen("2.5", "3.5", 1)));
        let read = |text: &str, taught_by| read_located(text.as_bytes(), taught_by);
        let [scan, drawing] = [TaughtSource::Scan, TaughtSource::Drawing].map(Some);
        assert_eq!([read(&of(""), scan), read(&drawn, drawing)], [Ok(POSE), Ok(POSE)]);
        assert_eq!([read(&of(""), None), read(&drawn, None)], [Ok(POSE), Ok(POSE)], "no recipe is given");
        assert_eq!([read(&of(""), drawing), read(&old, drawing)], [(); 2].map(|()| Err(PoseError::NotOfDrawing)));
        assert_eq!([read(&drawn, scan), read(&old, scan)], [(); 2].map(|()| Err(PoseError::OfDrawing)));
        assert_eq!(read(&old, None), Err(PoseError::NotOfDrawing));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_to_the_bit(n in prop::array::uniform6(-1e4..1e4_f64)) {
            let pose = KukaPose { x_mm: n[0], y_mm: n[1], z_mm: n[2], a_deg: n[3], b_deg: n[4], c_deg: n[5] };
            prop_assert_eq!(read_flange(write_pose(&pose).as_bytes()), Ok(pose));
        }
    }
}
