//! Opens `libpanelprep_zivid.so`, the interface to the Zivid SDK, at run time. Only the worker process does this.
//!
//! This file is the foreign function interface and contains all `unsafe` code for the camera. The library's own
//! initialisation runs when it is opened. Its functions are called with the types that `cpp/panelprep_zivid.h`
//! declares. The version of the interface is read first, so that an older or newer library is refused before any other
//! call. Sizes in calls are those of the buffers that are passed. A session is used by one thread at a time (`&mut
//! self`).
#![allow(unsafe_code, reason = "calls into the camera vendor's SDK go through a C interface")]

use super::message::{Flicker, Identity, Lens, Light, Refusal, Size, Source, Temperatures, Trouble, Use};
use super::sensor::{ExposureMetadata, Sensor, SettingsSlot, ShotPlanes};
use libloading::Library;
use std::ffi::{CStr, CString, OsStr, c_char};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::ptr::{NonNull, null};

/// The interface version (`PZ_INTERFACE`) of the header that this file implements.
const INTERFACE: u32 = 2;
const NAME_BYTES: usize = 64;
const MESSAGE_BYTES: usize = 1024;

/// The reason why the camera library cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The library cannot be opened, or does not contain a required function.
    #[error(
        "{}: {cause}; build it with `make zivid` on a computer that has the Zivid SDK, or name it with [scanner] \
         library",
        file.display()
    )]
    Open {
        /// The library.
        file: PathBuf,
        /// The system's error.
        cause: libloading::Error,
    },
    /// The library was built with another version of the interface.
    #[error("{}: the library has interface version {found}, but this program needs {INTERFACE}; build the library \
             again with `make zivid`", file.display())]
    Interface {
        /// The library.
        file: PathBuf,
        /// Its number.
        found: u32,
    },
    /// The SDK cannot be started.
    #[error("the Zivid SDK does not start: {0}")]
    Sdk(String),
}

#[repr(C)]
struct Message {
    text: [c_char; MESSAGE_BYTES],
}

#[repr(C)]
struct RawIdentity {
    serial: [c_char; NAME_BYTES],
    model: [c_char; NAME_BYTES],
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
struct RawSize {
    width: u64,
    height: u64,
}

#[repr(C)]
#[derive(Default)]
struct RawShotInfo {
    size: RawSize,
    exposed_ns: u64,
    throttled_ms: f64,
    lens_c: f64,
}

#[repr(C)]
#[derive(Default)]
struct RawTemperatures {
    dmd_c: f64,
    general_c: f64,
    led_c: f64,
    lens_c: f64,
    pcb_c: f64,
}

#[repr(C)]
#[derive(Default)]
struct RawLens {
    matrix_px: [f64; 4],
    distortion: [f64; 5],
}

#[repr(C)]
struct RawFlicker {
    classification: [c_char; NAME_BYTES],
    frequency: [c_char; NAME_BYTES],
}

/// The opaque type `pz_session` of the library.
#[repr(C)]
struct RawSession {
    _private: [u8; 0],
}

type Session = *mut RawSession;
type Status = i32;

/// The functions of the library. The library is never unloaded, because the SDK's own threads may still run; so the
/// functions are valid until the program ends.
struct Functions {
    end: unsafe extern "C" fn(Session),
    connect: unsafe extern "C" fn(Session, *const c_char, *const c_char, *mut RawIdentity, *mut Message) -> Status,
    settings_scan: unsafe extern "C" fn(Session, *const c_char, *mut u32, *mut RawSize, *mut Message) -> Status,
    settings_picture: unsafe extern "C" fn(Session, *const c_char, *mut u32, *mut RawSize, *mut Message) -> Status,
    scan: unsafe extern "C" fn(Session, u32, *mut RawShotInfo, *mut Message) -> Status,
    copy_scan: unsafe extern "C" fn(Session, *mut f32, *mut u8, *mut f32, usize, *mut Message) -> Status,
    picture: unsafe extern "C" fn(Session, u32, *mut RawShotInfo, *mut Message) -> Status,
    copy_picture: unsafe extern "C" fn(Session, *mut u8, usize, *mut Message) -> Status,
    intrinsics: unsafe extern "C" fn(Session, u32, *mut RawLens, *mut Message) -> Status,
    state: unsafe extern "C" fn(Session, *mut RawTemperatures, *mut Message) -> Status,
    light: unsafe extern "C" fn(Session, *mut RawFlicker, *mut Message) -> Status,
}

/// A camera that is controlled through the SDK.
pub struct Sdk {
    functions: Functions,
    session: NonNull<RawSession>,
    version: String,
}

// SAFETY: the header permits any thread to use a session, one at a time, which `&mut self` enforces. No part of the
// session is shared.
unsafe impl Send for Sdk {}

impl Sdk {
    /// Opens the library and starts the SDK.
    ///
    /// # Errors
    /// If the library cannot be opened or has another interface version, or the SDK cannot be started.
    pub fn open(file: &Path) -> Result<Self, LibraryError> {
        let failed = |cause| LibraryError::Open { file: file.to_owned(), cause };
        // SAFETY: the initialisation code is the vendor's and that of this project, and runs in a process for this
        // purpose only.
        let library: &'static Library = Box::leak(Box::new(unsafe { Library::new(file) }.map_err(failed)?));
        // SAFETY: this function has this type in every version of the interface.
        let interface: unsafe extern "C" fn() -> u32 =
            *unsafe { library.get(b"pz_interface\0") }.map_err(failed)?;
        // SAFETY: the function has no arguments and returns a number.
        let found = unsafe { interface() };
        if found != INTERFACE {
            return Err(LibraryError::Interface { file: file.to_owned(), found });
        }
        macro_rules! function {
            // SAFETY: in this interface version, the function with this name has the type of the field to which it is
            // assigned, as the header declares.
            ($name:literal) => {
                *unsafe { library.get(concat!("pz_", $name, "\0").as_bytes()) }.map_err(failed)?
            };
        }
        let begin: unsafe extern "C" fn(*mut c_char, *mut Message) -> Session = function!("begin");
        let functions = Functions {
            end: function!("end"),
            connect: function!("connect"),
            settings_scan: function!("settings_scan"),
            settings_picture: function!("settings_picture"),
            scan: function!("scan"),
            copy_scan: function!("copy_scan"),
            picture: function!("picture"),
            copy_picture: function!("copy_picture"),
            intrinsics: function!("intrinsics"),
            state: function!("state"),
            light: function!("light"),
        };
        let (mut sdk, mut message) = ([0; NAME_BYTES], Message::new_empty());
        // SAFETY: both buffers have the sizes that the header requires.
        let session = unsafe { begin(sdk.as_mut_ptr(), &raw mut message) };
        let session = NonNull::new(session).ok_or_else(|| LibraryError::Sdk(message.read()))?;
        Ok(Sdk { functions, session, version: text_until_nul(&sdk) })
    }

    /// Calls a function of the library, and converts its status to a result.
    fn call(&mut self, call: impl FnOnce(&Functions, Session, *mut Message) -> Status) -> Result<(), Refusal> {
        let mut message = Message::new_empty();
        let trouble = match call(&self.functions, self.session.as_ptr(), &raw mut message) {
            0 => return Ok(()),
            1 => Trouble::NotFound,
            2 => Trouble::Gone,
            3 => Trouble::NoShot,
            4 => Trouble::Settings,
            6 => Trouble::Firmware,
            7 => Trouble::InUse,
            8 => Trouble::OutOfReach,
            _ => Trouble::OutOfOrder,
        };
        Err(Refusal { trouble, message: message.read() })
    }
}

impl Drop for Sdk {
    fn drop(&mut self) {
        // SAFETY: the session is open, and is not used afterwards.
        unsafe { (self.functions.end)(self.session.as_ptr()) }
    }
}

impl Sensor for Sdk {
    fn sdk_version(&self) -> String {
        self.version.clone()
    }

    fn connect(&mut self, source: &Source) -> Result<Identity, Refusal> {
        let (serial, file) = match source {
            Source::Only => (None, None),
            Source::Serial(serial) => (Some(c_string(serial.as_ref())?), None),
            Source::File(file) => (None, Some(c_string(file.as_ref())?)),
        };
        let pointer = |text: &Option<CString>| text.as_ref().map_or(null(), |text| text.as_ptr());
        let (serial, file) = (&serial, &file);
        let mut identity = RawIdentity { serial: [0; NAME_BYTES], model: [0; NAME_BYTES] };
        let into = &raw mut identity;
        self.call(|functions, session, message| {
            // SAFETY: the texts end with NUL or are null, and all pointers stay valid during the call.
            unsafe { (functions.connect)(session, pointer(serial), pointer(file), into, message) }
        })?;
        Ok(Identity { serial: text_until_nul(&identity.serial), model: text_until_nul(&identity.model) })
    }

    fn settings(&mut self, usage: Use, file: &Path) -> Result<(SettingsSlot, Size), Refusal> {
        let file = c_string(file.as_os_str())?;
        let (mut slot, mut size) = (0, RawSize::default());
        let (slot_into, size_into) = (&raw mut slot, &raw mut size);
        self.call(|functions, session, message| {
            let read = match usage {
                Use::Scan => functions.settings_scan,
                Use::Picture => functions.settings_picture,
            };
            // SAFETY: the text ends with NUL, and all pointers stay valid during the call.
            unsafe { read(session, file.as_ptr(), slot_into, size_into, message) }
        })?;
        Ok((SettingsSlot(slot), size.validated()?))
    }

    fn scan(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, ShotPlanes), Refusal> {
        let mut taken = RawShotInfo::default();
        let into = &raw mut taken;
        // SAFETY: all pointers stay valid during the call.
        self.call(|functions, session, message| unsafe { (functions.scan)(session, slot.0, into, message) })?;
        let exposed = taken.read()?;
        let mut planes = ShotPlanes::with_size(exposed.size);
        let pixels = planes.points_mm.len();
        let (points, colors) = (planes.points_mm.as_flattened_mut(), planes.colors.as_flattened_mut());
        let (points, colors, snr) = (points.as_mut_ptr(), colors.as_mut_ptr(), planes.snr.as_mut_ptr());
        self.call(|functions, session, message| {
            // SAFETY: the planes have 3, 3 and 1 numbers for each of these pixels, and outlive the call.
            unsafe { (functions.copy_scan)(session, points, colors, snr, pixels, message) }
        })?;
        Ok((exposed, planes))
    }

    fn picture(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, Vec<[u8; 3]>), Refusal> {
        let mut taken = RawShotInfo::default();
        let into = &raw mut taken;
        // SAFETY: all pointers stay valid during the call.
        self.call(|functions, session, message| unsafe { (functions.picture)(session, slot.0, into, message) })?;
        let exposed = taken.read()?;
        let mut rgb = vec![[0; 3]; exposed.size.pixels()];
        let (pixels, bytes) = (rgb.len(), rgb.as_flattened_mut().as_mut_ptr());
        self.call(|functions, session, message| {
            // SAFETY: the buffer has 3 bytes for each pixel, and stays valid during the call.
            unsafe { (functions.copy_picture)(session, bytes, pixels, message) }
        })?;
        Ok((exposed, rgb))
    }

    fn intrinsics(&mut self, slot: SettingsSlot) -> Result<Lens, Refusal> {
        let mut lens = RawLens::default();
        let into = &raw mut lens;
        // SAFETY: all pointers stay valid during the call.
        self.call(|functions, session, message| unsafe { (functions.intrinsics)(session, slot.0, into, message) })?;
        Ok(Lens { matrix_px: lens.matrix_px, distortion: lens.distortion })
    }

    fn state(&mut self) -> Result<Temperatures, Refusal> {
        let mut found = RawTemperatures::default();
        let into = &raw mut found;
        // SAFETY: all pointers stay valid during the call.
        self.call(|functions, session, message| unsafe { (functions.state)(session, into, message) })?;
        let known = |celsius: f64| Some(celsius).filter(|celsius| celsius.is_finite());
        let RawTemperatures { dmd_c, general_c, led_c, lens_c, pcb_c } = found;
        let [dmd_c, general_c, led_c, lens_c, pcb_c] = [dmd_c, general_c, led_c, lens_c, pcb_c].map(known);
        Ok(Temperatures { dmd_c, general_c, led_c, lens_c, pcb_c })
    }

    fn measure_ambient_light(&mut self) -> Result<Light, Refusal> {
        let mut found = RawFlicker { classification: [0; NAME_BYTES], frequency: [0; NAME_BYTES] };
        let into = &raw mut found;
        // SAFETY: all pointers stay valid during the call.
        self.call(|functions, session, message| unsafe { (functions.light)(session, into, message) })?;
        Ok(Light {
            flicker: Flicker::from_sdk_name(&text_until_nul(&found.classification)),
            frequency: text_until_nul(&found.frequency),
        })
    }
}

impl Message {
    fn new_empty() -> Self {
        Message { text: [0; MESSAGE_BYTES] }
    }

    fn read(&self) -> String {
        text_until_nul(&self.text)
    }
}

/// Maximum width and height of a picture, px: far beyond any camera of this type, and small enough that no calculation
/// overflows.
const MAX_SIDE_PX: u64 = 16_384;

impl RawSize {
    fn validated(self) -> Result<Size, Refusal> {
        let side = |pixels: u64| usize::try_from(pixels).ok().filter(|_| (1..=MAX_SIDE_PX).contains(&pixels));
        match (side(self.width), side(self.height)) {
            (Some(width), Some(height)) => Ok(Size { width, height }),
            _ => {
                let message = format!("a shot has the invalid size {}×{} px", self.width, self.height);
                Err(Refusal { trouble: Trouble::NoShot, message })
            }
        }
    }
}

impl RawShotInfo {
    fn read(&self) -> Result<ExposureMetadata, Refusal> {
        let lens_c = Some(self.lens_c).filter(|celsius| celsius.is_finite());
        let throttled_ms = if self.throttled_ms.is_finite() { self.throttled_ms } else { 0.0 };
        Ok(ExposureMetadata { size: self.size.validated()?, exposed_ns: self.exposed_ns, throttled_ms, lens_c })
    }
}

/// Returns the text before its NUL, or the whole buffer if there is no NUL.
fn text_until_nul(text: &[c_char]) -> String {
    let bytes: Vec<u8> = text.iter().map(|&c| c.to_ne_bytes()[0]).collect();
    let text = CStr::from_bytes_until_nul(&bytes).map_or(bytes.as_slice(), CStr::to_bytes);
    String::from_utf8_lossy(text).into_owned()
}

fn c_string(text: &OsStr) -> Result<CString, Refusal> {
    let refused =
        |_| Refusal { trouble: Trouble::Settings, message: format!("{} contains a NUL character", text.display()) };
    CString::new(text.as_bytes()).map_err(refused)
}
