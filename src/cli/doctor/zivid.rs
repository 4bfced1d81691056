//! Checks of a Zivid: whether it delivers, whether the light is suitable for its exposures, whether it is warm, and
//! on which device its SDK computes.

use super::check::Check;
use super::leased_camera::judge_shot_reply;
use super::{judge, machine};
use crate::cli::load::CellFiles;
use crate::cli::service_request;
use crate::cli::shoot::opening;
use panelprep_base::geometry::PinholeCamera;
use panelprep_cell::cell::ZividCamera;
use panelprep_devices::cameras::Scanner as _;
use panelprep_devices::zivid::{AnswerTimeouts, ZividFault, ZividScanner};
use panelprep_service::daemon::RemoteScanner;
use std::time::{Duration, Instant};

/// Starts the camera's worker, opens the camera and takes a shot to warm it up. If requested, takes shots for ten
/// minutes and follows the camera's temperature.
pub(super) fn checks(files: &CellFiles, camera: &ZividCamera, warm_up: bool) -> Vec<Check> {
    let graphics = machine::graphics_processor();
    if let Some(state) = service_request::service_state(&files.socket()) {
        let taken = RemoteScanner::new(files.socket()).capture_3d();
        return vec![graphics, judge_shot_reply("scanner", &state, taken.map(|taken| taken.cloud.picture()))];
    }
    let lens = opening::lens(files.scanner());
    let calibrated_px = lens.as_ref().ok().copied().flatten().map(|lens| lens.fx_px);
    let opened = lens.and_then(|lens| {
        let open = |lens: &PinholeCamera| crate::cli::zivid::scanner(&files.cell, camera, lens);
        opening::open_with_size(lens, open, opening::zivid_ready)
    });
    let mut scanner = match opened {
        Ok((scanner, _)) => scanner,
        Err(fault) => {
            let wrong = Check::failed("scanner", fault.to_string(), "correct [scanner] in the cell's file");
            return vec![graphics, wrong];
        }
    };
    let ready = scanner.wait_ready(AnswerTimeouts::default().start());
    let (found, own) = match ready.and_then(|()| Ok((scanner.temperatures()?, scanner.intrinsics()?))) {
        Ok(both) => both,
        Err(fault) => {
            let wrong = Check::failed(
                "scanner",
                fault.to_string(),
                "see the requirements of the Zivid camera in src/devices/README.md",
            );
            return vec![graphics, wrong];
        }
    };
    let light = match (scanner.measure_ambient_light(), crate::cli::zivid::checked_settings(camera)) {
        (Ok(light), Ok(settings)) => judge::judge_light(&light, &settings),
        (Err(fault), _) => judge::unknown_light(&fault.to_string()),
        (_, Err(fault)) => judge::unknown_light(&fault.to_string()),
    };
    let warm = found.lens_c.map_or("unknown".to_owned(), |celsius| format!("{celsius:.0} °C"));
    let calibrated =
        calibrated_px.map_or("not calibrated yet".to_owned(), |px| format!("{px:.1} px in its calibration file"));
    let reported = format!(
        "Zivid camera ready; lens temperature {warm}; focal length {:.1} px as the camera reports, {calibrated}",
        own.matrix_px[0]
    );
    let followed = if warm_up { warm_up_camera(&mut scanner, WARM_UP_TIME_AND_INTERVAL) } else { Ok(()) };
    let warmth = match followed {
        Ok(()) => judge::judge_warmth(scanner.temperature_state()),
        Err(fault) => Check::failed(
            "scanner's warmth",
            fault.to_string(),
            "repair the 3D camera, then run `panelprep doctor --warm-up` again",
        ),
    };
    vec![graphics, Check::passed("scanner", reported), light, warmth]
}

/// Duration of the warm-up of a camera, which is the maker's ten minutes, and interval between two shots.
const WARM_UP_TIME_AND_INTERVAL: [Duration; 2] = [Duration::from_secs(605), Duration::from_secs(10)];

/// Takes 3D shots, which warm the camera and from which its temperature is followed.
fn warm_up_camera(scanner: &mut ZividScanner, [long, every]: [Duration; 2]) -> Result<(), ZividFault> {
    let begun = Instant::now();
    while begun.elapsed() < long {
        let lens = scanner
            .take_scan()?
            .metadata
            .lens_c
            .map_or(String::new(), |celsius| format!(", lens temperature {celsius:.1} °C"));
        let left_s = long.saturating_sub(begun.elapsed()).as_secs();
        tracing::info!("the 3D camera is warming up, {left_s} s left{lens}");
        std::thread::sleep(every.min(long.saturating_sub(begun.elapsed())));
    }
    Ok(())
}
