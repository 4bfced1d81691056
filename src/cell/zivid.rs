//! `[scanner]`: the fixed 3D camera, and what a Zivid needs to be told.

use super::devices::Camera;
use crate::config::Section;
use std::path::{Path, PathBuf};

/// `kind = "zivid"`: a Zivid 3D camera behind its vendor's SDK.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ZividCamera {
    /// Its serial number; the only camera found where there is neither this nor a file.
    pub serial: Option<String>,
    /// A file camera, `.zfc`, instead: the SDK plays raw pictures that were recorded once.
    pub file_camera: Option<PathBuf>,
    /// The settings of 3D shots with colour, as Zivid Studio saves them; needed to take one.
    pub settings: Option<PathBuf>,
    /// The settings of colour pictures; likewise.
    pub settings_2d: Option<PathBuf>,
    /// `libpanelprep_zivid.so`; where there is none, it is searched as any library.
    pub library: Option<PathBuf>,
}

pub(super) fn take_scanner(cell_folder: &Path, section: &Section<'_, '_>) -> Option<Camera> {
    let kind = section.take::<&str>("kind", vec!["simulated", "recorded", "zivid"], Some("simulated"));
    let text = |key| section.take::<Option<String>>(key, (), Some(None));
    let [folder, serial, file_camera] = ["folder", "serial", "file_camera"].map(text);
    let [settings, settings_2d, library] = ["settings", "settings_2d", "library"].map(text);
    section.done();
    let (kind, folder, serial, file_camera) = (kind?, folder?, serial?, file_camera?);
    let (settings, settings_2d, library) = (settings?, settings_2d?, library?);
    let given = [
        ("folder", folder.is_some(), "recorded"),
        ("serial", serial.is_some(), "zivid"),
        ("file_camera", file_camera.is_some(), "zivid"),
        ("settings", settings.is_some(), "zivid"),
        ("settings_2d", settings_2d.is_some(), "zivid"),
        ("library", library.is_some(), "zivid"),
    ];
    let wrong: Vec<_> = given.into_iter().filter(|(_, given, needs)| *given && kind != *needs).collect();
    for (key, _, needs) in &wrong {
        section.problem(key, format!("has no effect with kind = \"{kind}\"; it is for kind = \"{needs}\""));
    }
    if serial.is_some() && file_camera.is_some() {
        section.problem("file_camera", "goes without serial: it is either a camera or a file that plays one");
        return None;
    }
    let file = |name: Option<String>| name.map(|name| cell_folder.join(name));
    let camera = match (kind, folder) {
        ("simulated", _) => Camera::Simulated,
        ("recorded", Some(folder)) => Camera::Recorded { folder: cell_folder.join(folder) },
        ("recorded", None) => {
            section.problem("folder", "is missing; kind = \"recorded\" needs the folder to play");
            return None;
        }
        _ => Camera::Zivid(ZividCamera {
            serial,
            file_camera: file(file_camera),
            settings: file(settings),
            settings_2d: file(settings_2d),
            library: file(library),
        }),
    };
    wrong.is_empty().then_some(camera)
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
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
        assert_eq!(cell.scanner(), &Camera::Zivid(zivid));
    }

    #[test]
    fn what_does_not_go_together_is_told() {
        let says = |text: &str| Cell::check("f", text).expect_err("refused").to_string();
        let told = says("[scanner]\nsettings = 'scan.yml'\nlibrary = 'x.so'");
        assert!(told.contains(
            "f:2: scanner.settings: has no effect with kind = \"simulated\"; it is for kind = \"zivid\""
        ));
        assert!(told.contains("f:3: scanner.library: has no effect"), "{told}");
        let told = says("[scanner]\nkind = 'zivid'\nserial = '1'\nfile_camera = 'a.zfc'");
        assert!(told.contains("f:4: scanner.file_camera: goes without serial"), "{told}");
        let told = says("[scanner]\nkind = 'zivid'\nsetings = 'scan.yml'");
        assert!(told.contains("setings") && told.contains("settings"), "{told}");
    }
}
