//! The check of a camera that the service uses.

use super::check::Check;
use panelprep_base::geometry::ColorPicture;
use panelprep_devices::cameras::CameraError;

/// Judges a camera that the service uses, from the result of a request for a shot; a cell that is at work is not
/// disturbed.
pub(super) fn judge_shot_reply(name: &str, state: &str, taken: Result<ColorPicture, CameraError>) -> Check {
    let holder = format!("in use by the service, state {state}");
    match taken {
        Ok(picture) => Check::passed(name, format!("{holder}: delivers {}×{}", picture.width, picture.height)),
        Err(CameraError::AtWork) => {
            Check::passed(name, format!("{holder}; no test picture was taken, because the cell is working"))
        }
        Err(error) => Check::failed(
            name,
            format!("{holder}: {error}"),
            "check the camera's power, cable and address; read the service's log",
        ),
    }
}
