//! `[scanner]`: the fixed 3D camera, and the settings that a Zivid needs.

use super::devices::DeviceKind;
use panelprep_base::config::Section;
use std::path::{Path, PathBuf};

/// `kind = "zivid"`: a Zivid 3D camera behind its vendor's SDK.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ZividCamera {
    /// The camera's serial number; without a serial number and a file camera, the only camera that is found is used.
    pub serial: Option<String>,
    /// A file camera, `.zfc`, instead of a real one: the SDK plays raw pictures that were recorded before.
    pub file_camera: Option<PathBuf>,
    /// The settings of 3D shots with colour, as Zivid Studio saves them; needed for such a shot.
    pub settings: Option<PathBuf>,
    /// The settings of colour pictures, as Zivid Studio saves them; needed for such a picture.
    pub settings_2d: Option<PathBuf>,
    /// `libpanelprep_zivid.so`; if none is stated, it is searched for like any library.
    pub library: Option<PathBuf>,
}

/// Returns the keys that only a Zivid has, and the function that parses them; its file paths are relative to the
/// cell's folder.
pub(super) fn kind(
    cell_folder: &Path,
) -> DeviceKind<'static, impl FnOnce(&Section<'_, '_>) -> Option<ZividCamera>> {
    let keys = &["serial", "file_camera", "settings", "settings_2d", "library"];
    DeviceKind {
        keyword: "zivid",
        required_keys: &[],
        keys,
        parse: |section: &Section<'_, '_>| parse(cell_folder, section),
    }
}

fn parse(cell_folder: &Path, section: &Section<'_, '_>) -> Option<ZividCamera> {
    let text = |key| section.parse::<Option<String>>(key, (), Some(None));
    let file = |key| Some(text(key)?.map(|name| cell_folder.join(name)));
    let (serial, file_camera) = (text("serial"), file("file_camera"));
    let (settings, settings_2d, library) = (file("settings"), file("settings_2d"), file("library"));
    let (serial, file_camera) = (serial?, file_camera?);
    if serial.is_some() && file_camera.is_some() {
        section.problem(
            "file_camera",
            "cannot be combined with serial: state serial for a real camera, or file_camera for a camera simulated \
             from a file",
        );
        return None;
    }
    Some(ZividCamera { serial, file_camera, settings: settings?, settings_2d: settings_2d?, library: library? })
}

#[cfg(test)]
mod tests {
    use super::super::{Camera, Cell};
    use super::*;

    #[test]
    fn a_zivids_files_start_at_the_cells_folder() {
        let text =
            "[scanner]\nkind = 'zivid'\nserial = '2127A0F3'\nsettings = 'scan.yml'\nsettings_2d = '/etc/film.yml'";
        let cell = Cell::check("cells/cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let zivid = ZividCamera {
            serial: Some("2127A0F3".to_owned()),
            settings: Some("cells/scan.yml".into()),
            settings_2d: Some("/etc/film.yml".into()),
            ..ZividCamera::default()
        };
        assert_eq!(cell.scanner(), &Camera::Device(zivid));
    }

    #[test]
    fn what_does_not_go_together_is_reported() {
        let says = |text: &str| Cell::check("f", text).expect_err("refused").to_string();
        let told = says("[scanner]\nsettings = 'scan.yml'\nlibrary = 'x.so'");
        assert!(told.contains(
            "f:2: scanner.settings: has no effect with kind = \"simulated\"; this key is valid only with kind = \
             \"zivid\""
        ));
        assert!(told.contains("f:3: scanner.library: has no effect"), "{told}");
        let told = says("[scanner]\nkind = 'zivid'\nserial = '1'\nfile_camera = 'a.zfc'");
        assert!(told.contains("f:4: scanner.file_camera: cannot be combined with serial"), "{told}");
        let told = says("[scanner]\nkind = 'zivid'\nsetings = 'scan.yml'");
        assert!(told.contains("setings") && told.contains("settings"), "{told}");
    }
}
