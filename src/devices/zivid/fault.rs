//! The faults of the camera, as defined in the fault model (`faults.md`, C1–C11): the cause, what the program does, and
//! what a person must do.

use crate::UNKNOWN_PX;
use panelprep_base::number_text::distinguishable_texts;
use std::time::Duration;

/// A fault of the 3D camera. Each message begins with the number of the fault in the fault model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ZividFault {
    /// The camera was not found.
    #[error(
        "C1 the 3D camera is not found: {0}; check its power and its cable. The program repeats the search every few \
         seconds"
    )]
    NotFound(String),
    /// The camera is connected to another program or computer.
    #[error(
        "C1 the 3D camera is in use: {0}; close Zivid Studio and other camera programs, also on other computers"
    )]
    InUse(String),
    /// The camera was detected, but cannot be reached.
    #[error(
        "C1 the 3D camera cannot be reached: {0}; give this computer's network port an address in the camera's subnet, \
         or change the camera's address with Zivid Studio"
    )]
    OutOfReach(String),
    /// The firmware of the camera does not match the SDK.
    #[error(
        "C5 the 3D camera needs other firmware: {0}; update it with Zivid Studio or ZividFirmwareUpdater, then verify \
         its calibration"
    )]
    Firmware(String),
    /// The worker's program or the camera library is missing.
    #[error("C1 the 3D camera's worker cannot run: {0}")]
    NoWorker(String),
    /// The connection to the open camera was lost.
    #[error(
        "C2 the 3D camera was lost during {during}: {message}; the program opens the camera again when it responds"
    )]
    Lost {
        /// The request during which the connection was lost.
        during: &'static str,
        /// The SDK's message.
        message: String,
    },
    /// The worker did not reply in time.
    #[error("C3 the 3D camera did not respond within {} s to {during}, and its worker was ended; {next}", waited.as_secs_f64())]
    Timeout {
        /// The request.
        during: &'static str,
        /// Waiting time.
        waited: Duration,
        /// What the program does next.
        next: NextStep,
    },
    /// The worker did not reply in time, and did not end when it was killed.
    #[error(
        "C3 the 3D camera did not respond within {} s to {during}, and its worker does not end, because a driver \
         blocks it; restart the cell's computer",
        waited.as_secs()
    )]
    Stuck {
        /// The request.
        during: &'static str,
        /// Waiting time.
        waited: Duration,
    },
    /// The camera delivered nothing in several attempts.
    #[error(
        "C3 the 3D camera delivered nothing for {during} in {tries} attempts: {message}; check its power, cable and \
         temperature"
    )]
    NoShot {
        /// The request.
        during: &'static str,
        /// Number of attempts.
        tries: u32,
        /// The SDK's message.
        message: String,
    },
    /// The camera paused for too long to cool down.
    #[error(
        "C3 the 3D camera is hot and paused for {} ms during {during} (limit {} ms){}; let the camera cool down, and \
         lower Brightness in its settings", distinguishable_texts(*paused_ms, *allowed_ms, 0)[0], distinguishable_texts(*paused_ms, *allowed_ms, 0)[1], lens(*lens_c)
    )]
    Throttled {
        /// The request.
        during: &'static str,
        /// Duration of the pause, ms.
        paused_ms: f64,
        /// Maximum pause, ms.
        allowed_ms: f64,
        /// Temperature of the lens, °C.
        lens_c: Option<f64>,
    },
    /// The received data are incomplete or damaged.
    #[error(
        "C4 the data received for {during} are damaged and were discarded: {cause}; the worker was ended; {next}"
    )]
    Damaged {
        /// The request.
        during: &'static str,
        /// Description of the damage.
        cause: String,
        /// What the program does next.
        next: NextStep,
    },
    /// Some points of the scan have an infinite coordinate.
    #[error("C4 the scan was discarded, because {0} points have an infinite coordinate: scan again")]
    NotFinite(usize),
    /// The scan or picture does not have the calibrated size.
    #[error(
        "C5 {what}: {}×{} px, but the camera's calibration is for {}×{} px; set full resolution in the settings, or \
         calibrate with these settings", found_px[0], found_px[1], expected_px[0], expected_px[1]
    )]
    WrongSize {
        /// The kind of data with the wrong size, for messages.
        what: &'static str,
        /// Width and height, px.
        found_px: [usize; 2],
        /// Width and height in the calibration, px.
        expected_px: [usize; 2],
    },
    /// Another camera.
    #[error(
        "C5 found the 3D camera with serial {found}, but the calibration is for serial {expected}; connect the \
         calibrated camera, or calibrate the found camera"
    )]
    WrongCamera {
        /// Its serial number.
        found: String,
        /// The serial number in the calibration.
        expected: String,
    },
    /// The worker belongs to another version of this program.
    #[error(
        "C5 the version of the 3D camera's worker is {found}, but the version of this program is {expected}; restart \
         the service after an upgrade"
    )]
    WrongVersion {
        /// Version of the worker.
        found: String,
        /// Version of this program.
        expected: String,
    },
    /// The camera or the SDK does not accept the settings.
    #[error("C5 {what} are not accepted: {message}; correct them with Zivid Studio")]
    Settings {
        /// Description of the settings, for messages.
        what: &'static str,
        /// The SDK's message.
        message: String,
    },
    /// The scan has too few points.
    #[error(
        "C6 no 3D data: {} % of the shot's pixels have a point, but at least {needed_percent} % are needed. Check that \
         the panel is in the camera's range, that the lens is open and dry, and the exposure", distinguishable_texts(*found_percent, *needed_percent, 2)[0]
    )]
    NoPoints {
        /// Percentage of pixels with a point.
        found_percent: f64,
        /// Required share, percent.
        needed_percent: f64,
    },
    /// The camera delivered data that are older than the request, or repeated the previous data.
    #[error("C9 the 3D camera delivered old data: {0}; restart the camera")]
    Frozen(String),
    /// The worker ended.
    #[error("C11 the 3D camera's worker ended ({how}) during {during}; {next}")]
    Ended {
        /// How the worker ended: exit code, signal or error.
        how: String,
        /// The request during which the worker ended.
        during: &'static str,
        /// What the program does next.
        next: NextStep,
    },
    /// The worker is being started.
    #[error("C11 the 3D camera's worker has been starting for {} s; its first shot may take {} s more", since.as_secs(), most.as_secs())]
    Starting {
        /// Time since the start of the worker.
        since: Duration,
        /// Maximum time for the start.
        most: Duration,
    },
    /// The worker is not restarted, because its restart budget is used up.
    #[error(
        "C11 the 3D camera's worker stays down: it ended {ended} times within {} min (limit {allowed} restarts). Last: \
         {last}. Fix the cause, then reset after {} s or more", within.as_secs() / 60, wait.as_secs()
    )]
    Down {
        /// Number of times the worker ended within the period.
        ended: usize,
        /// Maximum number of restarts.
        allowed: usize,
        /// Period in which restarts are counted.
        within: Duration,
        /// The message of the last fault.
        last: String,
        /// Time until a person can restart the worker.
        wait: Duration,
    },
    /// The worker violated the protocol, or refused a request.
    #[error("C11 the 3D camera's worker refused {during}: {message}")]
    OutOfOrder {
        /// The request.
        during: &'static str,
        /// Message of the worker.
        message: String,
    },
}

/// What the program does after the loss of a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextStep {
    /// The worker is restarted.
    Restart {
        /// The number of this restart, from 1.
        number: usize,
        /// Maximum number of restarts.
        of: usize,
        /// Period in which restarts are counted.
        within: Duration,
    },
    /// The worker is not restarted.
    StaysDown,
}

impl std::fmt::Display for NextStep {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NextStep::Restart { number, of, within } => {
                write!(
                    f,
                    "the program restarts the worker, restart {number} of {of} in {} min",
                    within.as_secs() / 60
                )
            }
            NextStep::StaysDown => f.write_str("the worker stays down, because its restarts are used up"),
        }
    }
}

fn lens(lens_c: Option<f64>) -> String {
    lens_c.map_or(String::new(), |celsius| format!(", lens temperature {celsius:.0} °C"))
}

impl ZividFault {
    /// Returns whether the fault reports a value that the caller did not know when it opened the camera: the size
    /// (opened with [`UNKNOWN_PX`]), or the serial number (opened with "").
    pub fn reports_unknown_value(&self) -> bool {
        match self {
            ZividFault::WrongSize { expected_px, .. } => *expected_px == UNKNOWN_PX,
            ZividFault::WrongCamera { expected, .. } => expected.is_empty(),
            _ => false,
        }
    }

    /// Returns the number of the fault in the fault model, for example "C3".
    pub fn row(&self) -> &'static str {
        use ZividFault as F;
        match self {
            F::NotFound(_) | F::InUse(_) | F::OutOfReach(_) | F::NoWorker(_) => "C1",
            F::Lost { .. } => "C2",
            F::Timeout { .. } | F::Stuck { .. } | F::NoShot { .. } | F::Throttled { .. } => "C3",
            F::Damaged { .. } | F::NotFinite(_) => "C4",
            F::Firmware(_)
            | F::WrongSize { .. }
            | F::WrongCamera { .. }
            | F::WrongVersion { .. }
            | F::Settings { .. } => "C5",
            F::NoPoints { .. } => "C6",
            F::Frozen(_) => "C9",
            F::Ended { .. } | F::Starting { .. } | F::Down { .. } | F::OutOfOrder { .. } => "C11",
        }
    }
}
