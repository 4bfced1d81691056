//! A simulated GigE Vision camera: Aravis's fake camera, which sends the pictures of this program as packets over the
//! loopback interface.
//!
//! The fake camera replies to control packets and sends stream packets like a real camera. It uses UDP port 3956 of one
//! address of this computer, so only one fake camera can exist at a time. Aravis shares this port with every program
//! that requests it, and a client could be connected to either camera. Therefore the TCP port with the same number,
//! which GigE Vision does not use, is held as a lock between programs. A function supplies the pictures; it is called
//! for each exposure, in the camera's thread. The GenICam XML is `test_camera.xml`: it has the features of a LUCID
//! Triton that this program uses. Most features have no effect on the fake camera; they only keep the value that was
//! written. The fake camera does not resend packets.

use super::format::PixelFormat;
use aravis::GvFakeCamera;
use aravis::glib::translate::ToGlibPtr;
use aravis_sys as ffi;
use std::ffi::c_void;
use std::io::Write;
use std::net::{TcpListener, UdpSocket};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The loopback address, which every computer has. Only one simulated camera can use it at a time.
pub const LOOPBACK_ADDRESS: &str = "127.0.0.1";

/// The UDP port of GigE Vision's control protocol (GVCP).
const GVCP_PORT: u16 = 3956;

/// The GenICam XML of the simulated camera: its features and their registers.
const GENICAM_XML: &str = include_str!("test_camera.xml");

/// The register address of a feature that the GenICam XML adds to the features of Aravis's fake camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Register {
    /// The user set that is selected.
    UserSetSelector = 0x4000,
    /// 1 after the selected user set was loaded.
    UserSetLoad = 0x4004,
    /// Automatic exposure; 0 is off.
    ExposureAuto = 0x4008,
    /// Automatic white balance; 0 is off.
    BalanceWhiteAuto = 0x4010,
    /// 1 if the limit of the frame rate is enabled.
    AcquisitionFrameRateEnable = 0x4014,
    /// 1 if the camera is ready for a trigger.
    TriggerArmed = 0x4018,
    /// 1 if chunk data are sent with each picture.
    ChunkModeActive = 0x401c,
    /// 1 if PTP sets the camera's clock.
    PtpEnable = 0x4020,
    /// Temperature of the camera, tenths of a degree Celsius.
    DeviceTemperature = 0x4024,
    /// Gain, tenths of a dB.
    Gain = 0x0110,
    /// Automatic gain; 0 is off.
    GainAuto = 0x0114,
    /// Exposure time, µs.
    ExposureTime = 0x0120,
    /// Period of the frames, µs.
    FramePeriod = 0x0138,
}

/// A function that writes the pixels of one exposure; its first argument is the number of earlier exposures.
pub type FillPixels = Box<dyn Fn(u64, &mut [u8]) + Send + Sync>;

/// The reason why the simulated camera cannot be started.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LoopbackError {
    /// The UDP port is in use.
    #[error(
        "no GigE Vision camera can be simulated at {LOOPBACK_ADDRESS}: UDP port {GVCP_PORT} is taken, by another simulation or a camera tool"
    )]
    Taken,
    /// The picture is larger than the fake camera's sensor.
    #[error("the simulated GigE Vision camera is at most {sensor_px} px wide and high, but {}×{} px were requested", size_px[0], size_px[1])]
    TooLarge {
        /// The maximum width and height of the fake camera's sensor, px.
        sensor_px: usize,
        /// The requested width and height, px.
        size_px: [usize; 2],
    },
    /// The GenICam XML cannot be written to a temporary file for Aravis.
    #[error("the simulated GigE Vision camera's description cannot be written into a file: {0}")]
    NoDescription(String),
}

/// The data that the fake camera's thread uses.
struct Exposures {
    camera: Mutex<aravis::FakeCamera>,
    fill: FillPixels,
    count: AtomicU64,
}

impl Exposures {
    fn camera(&self) -> MutexGuard<'_, aravis::FakeCamera> {
        self.camera.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A simulated camera on the loopback interface; dropping it stops the camera.
pub struct LoopbackCamera {
    // `fake` is the first field because it must be dropped first: the camera's thread must end before its data is
    // dropped.
    fake: GvFakeCamera,
    exposures: Arc<Exposures>,
    /// The lock on the address, held while the camera exists.
    _lock: TcpListener,
}

impl LoopbackCamera {
    /// Starts the simulated camera.
    ///
    /// # Errors
    /// If its UDP port is in use, or the fake camera does not support the picture size.
    pub fn start(
        serial: &str,
        size_px: [usize; 2],
        format: PixelFormat,
        fill: FillPixels,
    ) -> Result<Self, LoopbackError> {
        Self::start_with_description(GENICAM_XML, serial, size_px, format, fill)
    }

    /// Starts a camera that accepts `format` but sends another format, whose code is `sent` (up to two bytes per
    /// pixel). It still reports a payload size of one byte per pixel.
    ///
    /// # Errors
    /// The errors of [`LoopbackCamera::start`].
    #[cfg(test)]
    pub(super) fn start_sending(
        serial: &str,
        size_px: [usize; 2],
        format: PixelFormat,
        sent: u32,
        fill: FillPixels,
    ) -> Result<Self, LoopbackError> {
        let value = |code: u32| format!("<Value>{code}</Value>");
        let depth = "((FORMAT &gt;&gt; 16) &amp; 0xFF) / 8";
        let description = GENICAM_XML.replace(&value(format.code()), &value(sent)).replace(depth, "1");
        Self::start_with_description(&description, serial, size_px, format, fill)
    }

    fn start_with_description(
        description: &str,
        serial: &str,
        size_px: [usize; 2],
        format: PixelFormat,
        fill: FillPixels,
    ) -> Result<Self, LoopbackError> {
        let sensor_px = ffi::ARV_FAKE_CAMERA_SENSOR_WIDTH as usize;
        if size_px.iter().any(|px| !(1..=sensor_px).contains(px)) {
            return Err(LoopbackError::TooLarge { sensor_px, size_px });
        }
        let lock = TcpListener::bind((LOOPBACK_ADDRESS, GVCP_PORT)).map_err(|_| LoopbackError::Taken)?;
        // This test detects a fake camera of another program that does not use the lock.
        UdpSocket::bind((LOOPBACK_ADDRESS, GVCP_PORT)).map_err(|_| LoopbackError::Taken)?;
        // Aravis reads the GenICam XML from a file when it starts.
        let no_file = |error: std::io::Error| LoopbackError::NoDescription(error.to_string());
        let mut file = tempfile::Builder::new().suffix(".xml").tempfile().map_err(no_file)?;
        file.write_all(description.as_bytes()).and_then(|()| file.flush()).map_err(no_file)?;
        let name = file
            .path()
            .to_str()
            .ok_or_else(|| LoopbackError::NoDescription("the file's name is not valid UTF-8".to_owned()))?;
        let fake = GvFakeCamera::new_full(Some(LOOPBACK_ADDRESS), Some(serial), Some(name));
        let camera = fake.fake_camera().filter(|_| fake.is_running()).ok_or(LoopbackError::Taken)?;
        let [width, height] = size_px.map(|px| px as u32);
        for (register, value) in [
            (ffi::ARV_FAKE_CAMERA_REGISTER_WIDTH as u32, width),
            (ffi::ARV_FAKE_CAMERA_REGISTER_HEIGHT as u32, height),
            (ffi::ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT as u32, format.code()),
            (Register::TriggerArmed as u32, 1),
            (Register::DeviceTemperature as u32, 315),
        ] {
            camera.write_register(register, value);
        }
        let exposures = Arc::new(Exposures { camera: Mutex::new(camera), fill, count: AtomicU64::new(0) });
        set_fill(&exposures);
        Ok(LoopbackCamera { fake, exposures, _lock: lock })
    }

    /// Returns the number of exposures so far.
    pub fn exposures(&self) -> u64 {
        self.exposures.count.load(Ordering::Relaxed)
    }

    /// Returns the value of a register.
    pub fn register(&self, register: Register) -> Option<u32> {
        self.exposures.camera().read_register(register as u32)
    }

    /// Writes a register, to simulate a change by the camera itself.
    pub fn write(&self, register: Register, value: u32) {
        self.exposures.camera().write_register(register as u32, value);
    }

    /// Sets the fraction of packets that the camera drops, 0 to 1.
    pub fn lose_packets(&self, share: f64) {
        self.fake.set_gvsp_lost_ratio(share);
    }

    /// Reduces the size of the camera's pictures while a client has the camera open, as if another program changed the
    /// settings. A larger size is ignored.
    pub fn shrink_picture(&self, size_px: [usize; 2]) {
        let camera = self.exposures.camera();
        let registers = [ffi::ARV_FAKE_CAMERA_REGISTER_WIDTH, ffi::ARV_FAKE_CAMERA_REGISTER_HEIGHT];
        for (register, px) in registers.map(|register| register as u32).into_iter().zip(size_px) {
            let smaller = camera.read_register(register).is_some_and(|now| px <= now as usize);
            if smaller {
                camera.write_register(register, px as u32);
            }
        }
    }
}

/// Registers the callback with which the fake camera requests its pictures from `exposures`.
#[allow(unsafe_code, reason = "the bindings do not contain this function; its callback and data are in C")]
fn set_fill(exposures: &Arc<Exposures>) {
    let data = Arc::as_ptr(exposures).cast_mut().cast::<c_void>();
    // SAFETY: the camera is alive while it is borrowed. `data` lives as long as `LoopbackCamera`, which is the only
    // owner of the fake GigE Vision camera and drops it first; the drop waits for the camera's thread, and nothing
    // else calls the callback.
    unsafe { ffi::arv_fake_camera_set_fill_pattern(exposures.camera().to_glib_none().0, Some(fill_buffer), data) }
}

/// Aravis's callback: writes an exposure's pixels into its buffer.
#[allow(unsafe_code, reason = "called from C with C's pointers")]
unsafe extern "C" fn fill_buffer(
    buffer: *mut ffi::ArvBuffer,
    data: *mut c_void,
    _exposure_us: u32,
    _gain: u32,
    _format: ffi::ArvPixelFormat,
) {
    if buffer.is_null() || data.is_null() {
        return;
    }
    // SAFETY: `data` is the pointer that `set_fill` passed. The buffer belongs to the fake camera and nothing else
    // uses it during the call. Aravis has just checked that the buffer is not smaller than the payload according to
    // the present registers; only this thread increases them. The size that the buffer itself reports here is not
    // valid (0).
    unsafe {
        let exposures = &*data.cast::<Exposures>();
        let mut told = 0;
        let pixels = ffi::arv_buffer_get_data(buffer, &mut told);
        if pixels.is_null() {
            return;
        }
        let payload = exposures.camera().payload();
        let pixels = std::slice::from_raw_parts_mut(pixels, payload);
        (exposures.fill)(exposures.count.fetch_add(1, Ordering::Relaxed), pixels);
    }
}
