//! GigE Vision cameras as flange cameras: a real camera, and the simulated camera over the loopback interface.

use super::simulated::SENSOR_FORMAT;
use super::{CameraError, CameraRole, Conditions, FlangeCamera, FlangePicture, SimulatedFlangeCamera};
use crate::gige::{
    self, ExposureMode, Frame, GigeCamera, GigeError, LinkMonitor, LoopbackCamera, LoopbackError, PixelFormat,
    Settings, demosaic, mosaic,
};
use panelprep_base::geometry::{ColorPicture, PinholeCamera};
use panelprep_cell::cell::Gige;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// A GigE Vision camera on the flange.
#[derive(Debug)]
pub struct GigeFlangeCamera {
    camera: GigeCamera,
    /// Exposure time of each picture, µs, from the cell file; the camera has confirmed this value.
    exposure_us: f64,
    conditions: Conditions,
    started: Instant,
}

impl GigeFlangeCamera {
    /// Starts to search for the camera that the cell file names. Its pictures must have the size of `calibrated`, and
    /// the camera must have the serial number `serial`, if given. If the camera is not found yet,
    /// [`FlangeCamera::check_ready`] reports this.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn open(cell: &Gige, calibrated: &PinholeCamera, serial: Option<String>) -> Result<Self, CameraError> {
        let which = match (&cell.serial, &cell.address) {
            (_, Some(address)) => gige::CameraSelector::Address(address.clone()),
            (Some(serial), None) => gige::CameraSelector::Serial(serial.clone()),
            (None, None) => gige::CameraSelector::Only,
        };
        let format = PixelFormat::from_name(cell.pixel_format).ok_or_else(|| CameraError::Missing {
            which: CameraRole::Flange,
            reason: format!("this program does not support the pixel format {}", cell.pixel_format),
        })?;
        let settings = Settings {
            selector: which,
            serial,
            user_set: cell.user_set.clone(),
            size_px: [calibrated.width_px, calibrated.height_px],
            format,
            exposure_us: Some(cell.exposure_us),
            gain_db: cell.gain_db,
            exposure_mode: ExposureMode::Triggered,
            packet_bytes: cell.packet_bytes,
            may_repeat: false,
        };
        let needed = gige::socket_buffer_bytes(settings.size_px, settings.packet_bytes);
        if let Some(short) = socket_buffer_advice(needed) {
            tracing::warn!("pictures of the flange camera may arrive incomplete: {short}");
        }
        let (camera, conditions, began) = (open_camera(settings)?, Conditions::default(), Instant::now());
        Ok(GigeFlangeCamera { camera, exposure_us: cell.exposure_us, conditions, started: began })
    }

    /// Returns a monitor by which other threads can read the counters of the camera's link at any time.
    pub fn gauge(&self) -> LinkMonitor {
        self.camera.gauge()
    }
}

impl FlangeCamera for GigeFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let frame = self.camera.picture().map_err(camera_error)?;
        let exposure_us = Some(self.exposure_us);
        // A GigE Vision camera has no projector, and never pauses because of heat.
        self.conditions = Conditions { exposure_us, camera_c: frame.camera_c, throttled_ms: None };
        let picture = to_color(&frame)?;
        Ok(FlangePicture { picture, base_from_flange: None, time_s: self.started.elapsed().as_secs_f64() })
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.camera.check_ready().map_err(camera_error)
    }

    fn conditions(&self) -> Conditions {
        self.conditions
    }
}

/// The serial number of the simulated flange camera.
const SIMULATED_SERIAL: &str = "SIMULATED";

/// The simulated flange camera; its pictures are sent over GigE Vision through the loopback interface.
pub struct LoopbackFlangeCamera {
    // `camera` is the first field because it must be dropped first: otherwise its driver would wait for a camera that
    // does not exist any more.
    camera: GigeCamera,
    _loopback: LoopbackCamera,
    /// The pixels of the scene that the simulated sensor exposes next.
    sensor: Arc<Mutex<Vec<u8>>>,
    simulated: SimulatedFlangeCamera,
}

impl LoopbackFlangeCamera {
    /// Starts the loopback camera; its pictures have the size of `camera`.
    ///
    /// # Errors
    /// If its port is in use, if it does not support the picture size, or if the operating system's socket buffers are
    /// too small for a picture.
    pub fn start(simulated: SimulatedFlangeCamera, camera: &PinholeCamera) -> Result<Self, CameraError> {
        let size_px = [camera.width_px, camera.height_px];
        let needed = gige::burst_bytes(size_px, gige::PACKET_BYTES);
        if let Some(reason) = socket_buffer_advice(needed) {
            return Err(CameraError::Missing { which: CameraRole::Flange, reason });
        }
        let sensor = Arc::new(Mutex::new(vec![0; size_px[0] * size_px[1]]));
        let sees = sensor.clone();
        let fill = move |_: u64, pixels: &mut [u8]| {
            let seen = sees.lock().unwrap_or_else(PoisonError::into_inner);
            let both = pixels.len().min(seen.len());
            pixels[..both].copy_from_slice(&seen[..both]);
        };
        let not_there =
            |reason: LoopbackError| CameraError::Missing { which: CameraRole::Flange, reason: reason.to_string() };
        let loopback =
            LoopbackCamera::start(SIMULATED_SERIAL, size_px, SENSOR_FORMAT, Box::new(fill)).map_err(not_there)?;
        let settings = Settings {
            selector: gige::CameraSelector::Address(gige::LOOPBACK_ADDRESS.to_owned()),
            serial: Some(SIMULATED_SERIAL.to_owned()),
            user_set: "Default".to_owned(),
            size_px,
            format: SENSOR_FORMAT,
            exposure_us: None,
            gain_db: None,
            exposure_mode: ExposureMode::Triggered,
            packet_bytes: gige::PACKET_BYTES,
            may_repeat: true,
        };
        let mut camera = open_camera(settings)?;
        camera.check_ready().map_err(camera_error)?;
        Ok(LoopbackFlangeCamera { camera, _loopback: loopback, sensor, simulated })
    }

    /// Returns a monitor by which other threads can read the counters of the camera's link at any time.
    pub fn gauge(&self) -> LinkMonitor {
        self.camera.gauge()
    }
}

impl FlangeCamera for LoopbackFlangeCamera {
    /// Renders a picture, sends it through the loopback interface, and checks that the received bytes equal the
    /// rendered bytes.
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let seen = self.simulated.capture()?;
        let raw = mosaic(&seen.picture, SENSOR_FORMAT);
        self.sensor.lock().unwrap_or_else(PoisonError::into_inner).clone_from(&raw);
        let frame = self.camera.picture().map_err(camera_error)?;
        if frame.pixels != raw {
            let differing = frame.pixels.iter().zip(&raw).filter(|(came, went)| came != went).count();
            let reason =
                format!("{differing} of {} received bytes differ from the bytes that were sent", raw.len());
            return Err(CameraError::Unusable { which: CameraRole::Flange, reason });
        }
        Ok(FlangePicture { picture: to_color(&frame)?, ..seen })
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.camera.check_ready().map_err(camera_error)
    }
}

/// Returns advice on how to increase the socket buffers if the operating system permits fewer than `bytes` bytes;
/// otherwise `None`.
fn socket_buffer_advice(bytes: usize) -> Option<String> {
    let given = gige::rmem_max().filter(|given| *given < bytes)?;
    Some(format!(
        "net.core.rmem_max is {given}, at least {bytes} are needed: run sysctl -w net.core.rmem_max={bytes}"
    ))
}

fn open_camera(settings: Settings) -> Result<GigeCamera, CameraError> {
    let no_thread =
        |error: std::io::Error| CameraError::Missing { which: CameraRole::Flange, reason: error.to_string() };
    GigeCamera::open(settings).map_err(no_thread)
}

fn to_color(frame: &Frame) -> Result<ColorPicture, CameraError> {
    let format = PixelFormat::ALL.iter().copied().find(|format| format.code() == frame.facts.format);
    let colored = format.and_then(|format| demosaic(&frame.pixels, frame.facts.size_px, format));
    let reason = || "the data do not match the picture's size and pixel format".to_owned();
    colored.ok_or_else(|| CameraError::Unusable { which: CameraRole::Flange, reason: reason() })
}

fn camera_error(error: GigeError) -> CameraError {
    let which = CameraRole::Flange;
    match error {
        GigeError::Timeout { waited_ms } => CameraError::Timeout { which, waited_ms },
        GigeError::WrongSize { found_px, expected_px } => CameraError::WrongSize { which, found_px, expected_px },
        GigeError::NotFound { .. }
        | GigeError::NotOpened { .. }
        | GigeError::Controlled { .. }
        | GigeError::WrongCamera { .. }
        | GigeError::Lost { .. } => CameraError::Missing { which, reason: error.to_string() },
        GigeError::Plan(_)
        | GigeError::NotTaken { .. }
        | GigeError::NoCompletePicture { .. }
        | GigeError::OtherFormat { .. }
        | GigeError::Refused { .. }
        | GigeError::Frozen { .. } => CameraError::Unusable { which, reason: error.to_string() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::PIXEL_FORMATS;

    /// The driver supports exactly the pixel formats that a cell file can name.
    #[test]
    fn every_pixel_format_of_a_cell_is_supported() {
        assert!(
            PIXEL_FORMATS.into_iter().all(|name| PixelFormat::from_name(name).is_some_and(|f| f.name() == name))
        );
        assert_eq!(PIXEL_FORMATS.len(), PixelFormat::ALL.len());
    }
}
