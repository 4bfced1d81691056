//! Finds a camera and configures it; the settings are read back.

use super::error::GigeError;
use super::search::search;
use super::settings::{CameraSelector, SettingStep, Settings, plan};
use super::sockets::local_subnets;
use super::streaming::gone_error;
use super::subnet;
use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{GvDevice, GvInterface, GvPacketSizeAdjustment};

/// Finds and opens the selected camera.
pub(super) fn open_selected(which: &CameraSelector) -> Result<GvDevice, GigeError> {
    let wanted = which.to_string();
    let not_found = |found: String| GigeError::NotFound { wanted: wanted.clone(), found };
    let interface = GvInterface::instance()
        .ok_or_else(|| not_found("the Aravis library has no GigE Vision support".to_owned()))?;
    let far = |address: &str| subnet::unreachable_reason(address, &local_subnets());
    let id = match which {
        CameraSelector::Address(address) => address.clone(),
        CameraSelector::Only | CameraSelector::Serial(_) => {
            let all = search().map_err(not_found)?;
            let reported: Vec<String> =
                all.iter().map(|found| format!("serial {} at {}", found.serial, found.address)).collect();
            let reported = match all.is_empty() {
                true => format!(
                    "no camera responded; cameras respond in this computer's subnets ({}), but a camera with an \
                     address outside of them may not respond",
                    subnet::describe(&local_subnets())
                ),
                false => format!("found {}", reported.join(", ")),
            };
            let right = all.iter().filter(|found| match which {
                CameraSelector::Serial(wanted) => found.serial == *wanted,
                _ => true,
            });
            match right.collect::<Vec<_>>().as_slice() {
                [only] if far(&only.address).is_some() => {
                    return Err(not_found(far(&only.address).unwrap_or_default()));
                }
                [only] => only.id.clone(),
                [] => return Err(not_found(reported)),
                _ => return Err(not_found(format!("{reported}: select one by its serial"))),
            }
        }
    };
    let why = |error: aravis::glib::Error| far(&id).unwrap_or_else(|| error.to_string());
    let device = interface.open_device(Some(&id)).map_err(|error| not_found(why(error)))?;
    device.downcast::<GvDevice>().map_err(|_| not_found("the device is not a GigE Vision camera".to_owned()))
}

/// Configures the camera and reads back the settings on which the meaning of a picture depends.
pub(super) fn configure(camera: &aravis::Camera, settings: &Settings) -> Result<(), GigeError> {
    let has = |node: &str| camera.is_feature_available(node).unwrap_or(false);
    if let Some(expected) = &settings.serial {
        let found = camera.device_serial_number().map_err(gone_error)?.to_string();
        if found != *expected {
            return Err(GigeError::WrongCamera { found, expected: expected.clone() });
        }
    }
    for step in plan(settings, &has)? {
        set(camera, &step)?;
    }
    let refused = |node, value: String| {
        move |why: aravis::glib::Error| GigeError::NotTaken { node, value, why: why.to_string() }
    };
    let (bytes, node) = (settings.packet_bytes, "GevSCPSPacketSize");
    camera.gv_set_packet_size_adjustment(GvPacketSizeAdjustment::Never);
    camera.gv_set_packet_size(i32::from(bytes)).map_err(refused(node, bytes.to_string()))?;
    let taken = camera.gv_get_packet_size().map_err(refused(node, bytes.to_string()))?;
    if taken != u32::from(bytes) {
        let why = format!("the camera set {taken} instead");
        return Err(GigeError::NotTaken { node, value: bytes.to_string(), why });
    }
    let (_, _, width, height) = camera.region().map_err(gone_error)?;
    let found_px = [width, height].map(|px| usize::try_from(px).unwrap_or_default());
    if found_px != settings.size_px {
        return Err(GigeError::WrongSize { found_px, expected_px: settings.size_px });
    }
    Ok(())
}

/// Performs one step; the value that was set is read back.
fn set(camera: &aravis::Camera, step: &SettingStep) -> Result<(), GigeError> {
    let (node, value) = match step {
        SettingStep::Command(node) => (*node, "()".to_owned()),
        SettingStep::SetEnum(node, entry) => (*node, entry.clone()),
        SettingStep::Number(node, number) | SettingStep::Limit(node, number) => (*node, number.to_string()),
        SettingStep::Switch(node, on) => (*node, on.to_string()),
    };
    let not_taken = |why: String| GigeError::NotTaken { node, value: value.clone(), why };
    let refused = |error: aravis::glib::Error| not_taken(error.to_string());
    match step {
        SettingStep::Command(node) => camera.execute_command(node).map_err(refused),
        SettingStep::Switch(node, on) => camera.set_boolean(node, *on).map_err(refused),
        SettingStep::SetEnum(node, entry) => {
            camera.set_string(node, entry).map_err(|error| {
                let entries = camera.dup_available_enumerations_as_strings(node).unwrap_or_default();
                let entries = entries.iter().map(|entry| entry.as_str()).collect::<Vec<_>>().join(", ");
                not_taken(format!("{error}; valid: {entries}"))
            })?;
            let taken = camera.string(node).map_err(refused)?;
            if taken == *entry { Ok(()) } else { Err(not_taken(format!("the camera set {taken} instead"))) }
        }
        SettingStep::Limit(node, number) => {
            let (_, upper) = camera.float_bounds(node).map_err(refused)?;
            set(camera, &SettingStep::Number(node, number.min(upper)))
        }
        SettingStep::Number(node, number) => {
            let (lower, upper) = camera.float_bounds(node).map_err(refused)?;
            if !(lower..=upper).contains(number) {
                return Err(not_taken(format!("valid: {lower} to {upper}{}", describe_frame_rate(camera, node))));
            }
            camera.set_float(node, *number).map_err(refused)?;
            let taken = camera.float(node).map_err(refused)?;
            // A sensor's exposure is a multiple of its row time, and an amplifier's gain has steps, so the accepted
            // value may differ slightly.
            let near = (taken - number).abs() <= 0.02 * number.abs() + 0.1;
            if near { Ok(()) } else { Err(not_taken(format!("the camera set {taken} instead"))) }
        }
    }
}

/// The frame rate that limits the exposure, in words, if the camera reports one.
fn describe_frame_rate(camera: &aravis::Camera, node: &str) -> String {
    let rate = node.starts_with("Exposure").then(|| camera.float("AcquisitionFrameRate").ok()).flatten();
    rate.map_or(String::new(), |rate| format!(" at the camera's lowest rate, {rate:.3} pictures per second"))
}
