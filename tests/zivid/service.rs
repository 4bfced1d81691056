//! Tests the service of a cell whose 3D camera is killed repeatedly.

use super::stub;
use crate::commands::{json, rendered};
use crate::service::Service;
use rustix::process::{Pid, Signal, kill_process};
use std::path::Path;

/// Returns the worker's process: the child of the daemon.
fn worker_of(daemon: u32) -> Option<Pid> {
    let children = std::fs::read_dir(format!("/proc/{daemon}/task"))
        .ok()?
        .filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("children")).ok());
    let ids: Vec<i32> = children
        .flat_map(|ids| ids.split_whitespace().filter_map(|id| id.parse().ok()).collect::<Vec<_>>())
        .collect();
    ids.first().copied().and_then(Pid::from_raw)
}

fn with_zivid(folder: &Path) {
    let cell = folder.join("cell/cell.toml");
    let text = std::fs::read_to_string(&cell).expect("rendered");
    let library = stub::library().display();
    let zivid = format!(
        "[scanner]\nkind = \"zivid\"\nfile_camera = \"camera.zfc\"\nsettings = \"scan.yml\"\nsettings_2d = \"film.yml\"\nlibrary = \"{library}\"\n"
    );
    let begin = text.find("[scanner]").expect("it has one");
    let end = begin + text[begin..].find("\n[").expect("more follows") + 1;
    std::fs::write(&cell, format!("{}{zivid}\n{}", &text[..begin], &text[end..])).expect("written");
    std::fs::write(folder.join("cell/scan.yml"), stub::SCAN).expect("written");
    std::fs::write(folder.join("cell/film.yml"), stub::PICTURE).expect("written");
    std::fs::write(folder.join("cell/camera.zfc"), "width 486\nheight 300\n").expect("written");
}

/// After each of three kills the worker process is restarted, with a line in the log. After the fourth kill the camera
/// is not restarted, and the reset reports this. The service continues and ends correctly. An upgrade that replaces the
/// program's file meanwhile has no effect.
#[test]
fn the_service_outlives_its_camera() {
    let folder = rendered("good");
    with_zivid(folder.path());
    let program = folder.path().join("panelprep");
    std::fs::copy(env!("CARGO_BIN_EXE_panelprep"), &program).expect("copied");
    let service = Service::start_from(&program, folder.path(), &[]);
    let upgrade = folder.path().join("upgrade");
    std::fs::copy("/bin/false", &upgrade).and_then(|_| std::fs::rename(&upgrade, &program)).expect("replaced");
    service.reset();
    let log = || std::fs::read_to_string(folder.path().join("run.log")).unwrap_or_default();
    let readies = || log().matches("the 3D camera is ready").count();
    for kill in 1..=4_usize {
        service.wait("the camera is ready", |_| readies() >= kill);
        let mut killed = false;
        service.wait("a worker", |service| {
            killed |= worker_of(service.id()).is_some_and(|id| kill_process(id, Signal::KILL).is_ok());
            killed
        });
        service.wait("it is reported", |_| {
            log().matches("C11 the 3D camera's worker ended (signal: 9 (SIGKILL))").count() >= kill
        });
        assert_eq!(service.state(), "idle", "no person needed the camera");
    }
    assert!(
        log().contains("restart 3 of 3 in 10 min") && log().contains("C11 the 3D camera's worker stays down"),
        "{}",
        log()
    );
    service.done("stop");
    service.reach("stopped");
    // The self-test may fail before the reset is answered.
    let (exit, answer) = service.ctl("reset");
    let tells_why = answer["reasons"].to_string().contains("C11 the 3D camera's worker stays down");
    assert!(exit == 0 || (exit == 3 && tells_why), "{exit} {answer}");
    service.wait("the reset fails", |service| {
        service.ctl("state").1["reasons"].to_string().contains("C11 the 3D camera's worker stays down")
    });
    service.signal(Signal::TERM);
    assert!(service.wait_for_end().success());
}

/// The reports of doctor about a Zivid, in addition to whether the camera delivers shots: the flicker of the light, the
/// graphics processor, and whether the camera is warm, which is not known yet. A film with the projector's light is
/// refused with file, line and key.
#[test]
fn doctor_checks_light_warm_up_and_settings() {
    let folder = rendered("good");
    with_zivid(folder.path());
    let camera = folder.path().join("cell/camera.zfc");
    std::fs::write(camera, "width 486\nheight 300\nlight grid60hz 120\n").expect("written");
    let checks = || json(folder.path(), "doctor --cell cell/cell.toml").1["checks"].clone();
    let check = |checks: &serde_json::Value, name: &str| {
        let all = checks.as_array().expect("checks");
        let one = all.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("{name}: {checks}"));
        (one["ok"] == true, format!("{} {}", one["found"], one["advice"]))
    };
    let found = checks();
    let (_, graphics) = check(&found, "graphics processor");
    assert!(graphics.contains("nvidia") || graphics.contains("NVIDIA"), "{graphics}");
    let (ok, light) = check(&found, "light on the scene");
    assert!(
        !ok && light.contains("flickers like lamps on mains of 60 Hz (120 Hz)") && light.contains("settings_2d"),
        "{light}"
    );
    let (ok, warmth) = check(&found, "scanner's warmth");
    assert!(
        ok && warmth.contains("it is not known whether the 3D camera is warm") && warmth.contains("--warm-up"),
        "{warmth}"
    );
    let (ok, scanner) = check(&found, "scanner");
    assert!(ok && scanner.contains("Zivid camera ready"), "{scanner}");

    let film = folder.path().join("cell/film.yml");
    std::fs::write(&film, stub::PICTURE.replace("Brightness: 0", "Brightness: 1.8")).expect("written");
    let (ok, scanner) = check(&checks(), "scanner");
    let words = "Settings2D.Acquisitions[0].Acquisition.Brightness: found 1.8, the value must be 0";
    assert!(!ok && scanner.contains("film.yml:") && scanner.contains(words), "{scanner}");
}
