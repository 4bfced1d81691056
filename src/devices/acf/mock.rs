//! A mock of the tool: bytes in, bytes out, and an actuator between them. The mock and the session have only the data
//! format in common.
//!
//! The actuator moves out or back at a bounded speed, until its stroke or the panel ends the motion. In contact it
//! presses with the commanded force, to which the weight of its payload is added according to its attitude. Its sensor
//! reports the actuator's force with a small zero error and with noise that depends only on the time, so that two runs
//! are equal.
//!
//! A fault can be planned to begin during a path: `silent@40`, from the 40th waypoint in contact on. For tests of the
//! link and of the doctor the mock is also behind a TCP port of this machine, for one client at a time.

use panelprep_cell::cell::CompliantTool;
use std::io;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Speed of the actuator, mm/s.
const SPEED_MM_S: f64 = 250.0;
/// Noise of the sensor in each direction, N.
const NOISE_N: f64 = 0.2;
/// Stiffness, N/mm: the force for each millimetre that the panel pushes a tool beyond its retracted position, or
/// pushes a stuck tool.
const STIFFNESS_N_PER_MM: f64 = 40.0;
/// Gravity, m/s².
const GRAVITY_M_S2: f64 = 9.806_65;

/// Default values of a fault: delay of an answer, ms, and error of the force, N.
const DEFAULT_DELAY_MS: u64 = 130;
const DEFAULT_FORCE_ERROR_N: f64 = 12.0;

/// How long the mock waits for bytes or a client.
const POLL_TIMEOUT: Duration = Duration::from_millis(2);

/// The surroundings of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolSurroundings {
    /// The time, ms.
    pub time_ms: u64,
    /// The extension at which the disc touches, mm; infinite if nothing is in front of it, negative if the arm
    /// pushes it against its stop.
    pub contact_extension_mm: f64,
    /// The downward component of the tool's direction, −1…1.
    pub downwards: f64,
}

/// A fault of the mock.
#[derive(Debug, Clone, Copy, PartialEq, strum::Display)]
pub enum ToolFault {
    /// The mock cuts the connection.
    LinkCut,
    /// It accepts commands and does not answer.
    Silent,
    /// It answers this many ms late.
    Late(u64),
    /// The tool answers with bytes that are not a reply.
    Garbage,
    /// The tool answers with another tool's number.
    OtherId,
    /// The tool reports these errors, one bit for each.
    Errors(u8),
    /// The mock presses with this much more force than commanded, N.
    ForceOff(f64),
    /// The mock always reports that there is no contact.
    NoContact,
    /// The tool's actuator does not move any more.
    Stuck,
}

/// The mock.
#[derive(Debug, Clone)]
pub struct MockAcf {
    tool: CompliantTool,
    fault: Option<ToolFault>,
    is_logged_in: bool,
    received: Vec<u8>,
    /// The bytes that are to be sent, each piece with its time, ms.
    scheduled: Vec<(u64, Vec<u8>)>,
    commanded_n: [f64; 2],
    position_mm: f64,
    time_ms: Option<u64>,
    pub(super) contact: bool,
    pub(super) sensor_n: f64,
}

impl MockAcf {
    /// Creates a tool as the cell's file describes it.
    pub fn new(tool: &CompliantTool) -> Self {
        MockAcf {
            tool: tool.clone(),
            fault: None,
            is_logged_in: false,
            received: Vec::new(),
            scheduled: Vec::new(),
            commanded_n: [tool.min_force_n; 2],
            position_mm: 0.0,
            time_ms: None,
            contact: false,
            sensor_n: 0.0,
        }
    }

    /// Sets the fault that the mock has from now on; `None` means no fault.
    pub fn set_fault(&mut self, fault: Option<ToolFault>) {
        self.fault = fault;
    }

    /// Returns whether a client can connect.
    pub fn is_reachable(&self) -> bool {
        self.fault != Some(ToolFault::LinkCut)
    }

    /// Accepts a client.
    pub fn connect(&mut self) {
        (self.is_logged_in, self.received, self.scheduled) = (false, Vec::new(), Vec::new());
    }

    /// Time passes.
    pub fn advance(&mut self, around: ToolSurroundings) {
        let ToolSurroundings { time_ms, contact_extension_mm: touches_at_mm, downwards } = around;
        let passed_s = time_ms.saturating_sub(self.time_ms.unwrap_or(time_ms)) as f64 / 1_000.0;
        self.time_ms = Some(time_ms);
        let weight_n = self.tool.payload_kg * GRAVITY_M_S2 * downwards;
        let off_n = if let Some(ToolFault::ForceOff(off_n)) = self.fault { off_n } else { 0.0 };
        let actuator_n = self.commanded_n[usize::from(!self.contact)] + off_n;
        let total_n = actuator_n + weight_n;
        let is_stuck = self.fault == Some(ToolFault::Stuck);
        if !is_stuck {
            let most_mm = SPEED_MM_S * passed_s;
            let goal_mm = if total_n > 0.0 { touches_at_mm.min(self.tool.stroke_mm) } else { 0.0 };
            let step_mm = (goal_mm - self.position_mm).clamp(-most_mm, most_mm);
            // The panel pushes the actuator in as fast as the arm approaches.
            self.position_mm = (self.position_mm + step_mm).min(touches_at_mm).max(0.0);
        }
        let pushed_mm = self.position_mm - touches_at_mm;
        let contact_n = match (is_stuck, pushed_mm >= -1e-9) {
            (true, true) => STIFFNESS_N_PER_MM * pushed_mm,
            (false, true) if pushed_mm > 1e-9 => total_n.max(0.0) + STIFFNESS_N_PER_MM * pushed_mm,
            (false, true) => total_n,
            (_, false) => 0.0,
        };
        self.contact = contact_n > 0.0;
        self.sensor_n = self.tool.zero_n + contact_n.max(0.0) - weight_n + noise_n(time_ms);
    }

    /// Processes bytes that were received.
    pub fn receive(&mut self, bytes: &[u8], now_ms: u64) {
        self.received.extend(bytes);
        while let Some(end) = self.received.iter().position(|byte| *byte == b'k') {
            let telegram: Vec<u8> = self.received.drain(..=end).collect();
            self.answer_telegram(&telegram[..end], now_ms);
        }
    }

    fn answer_telegram(&mut self, telegram: &[u8], now_ms: u64) {
        if !self.is_logged_in {
            self.is_logged_in = telegram == self.tool.login.as_bytes();
            let echo = if self.is_logged_in { telegram } else { b"denied" };
            self.scheduled.push((now_ms, [echo, b"k"].concat()));
            return;
        }
        let text = String::from_utf8_lossy(telegram);
        let fields: Vec<f64> = text.split(' ').filter_map(|field| field.parse().ok()).collect();
        let [id, force_n, no_contact_n, _, _, _] = fields[..] else { return };
        if id != f64::from(self.tool.id) {
            return;
        }
        self.commanded_n = [force_n, no_contact_n];
        let (at_ms, bytes) = match self.fault {
            Some(ToolFault::Silent | ToolFault::LinkCut) => return,
            Some(ToolFault::Late(late_ms)) => (now_ms + late_ms, self.reply(self.tool.id, 0)),
            Some(ToolFault::Garbage) => (now_ms, b"1040 2o.1 \xff 1 0k".to_vec()),
            Some(ToolFault::OtherId) => (now_ms, self.reply(self.tool.id.wrapping_add(1), 0)),
            Some(ToolFault::Errors(bits)) => (now_ms, self.reply(self.tool.id, bits)),
            _ => (now_ms, self.reply(self.tool.id, 0)),
        };
        self.scheduled.push((at_ms, bytes));
    }

    fn reply(&self, id: u16, errors: u8) -> Vec<u8> {
        let contact = u8::from(self.contact && self.fault != Some(ToolFault::NoContact));
        format!("{id} {:.2} {:.2} {contact} {errors}k", self.sensor_n, self.position_mm).into_bytes()
    }

    /// Returns the bytes that the mock has sent by now; `None` if the connection is cut.
    pub fn sent_bytes(&mut self, now_ms: u64) -> Option<Vec<u8>> {
        if self.fault == Some(ToolFault::LinkCut) {
            return None;
        }
        let due = self.scheduled.extract_if(.., |(at_ms, _)| *at_ms <= now_ms);
        Some(due.flat_map(|(_, bytes)| bytes).collect())
    }

    /// Returns how far the actuator is extended, mm.
    pub fn position_mm(&self) -> f64 {
        self.position_mm
    }
}

/// Returns noise that depends only on the time.
fn noise_n(time_ms: u64) -> f64 {
    let mixed = time_ms.wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(17).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    NOISE_N * ((mixed >> 40) as f64 / f64::from(1_u32 << 23) - 1.0)
}

/// A fault, and the number of waypoints after which the tool has the fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedToolFault {
    /// The fault.
    pub fault: ToolFault,
    /// Number of waypoints in contact that are executed before the fault begins.
    pub from: u32,
}

/// The error of a fault specification.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found \"{found}\"; valid: {}", PlannedToolFault::HELP)]
pub struct PlannedToolFaultError {
    found: String,
}

impl PlannedToolFault {
    /// The syntax of a fault.
    pub const HELP: &'static str = "NAME[=VALUE]@N, N being a waypoint in contact from 1 on: link-cut, silent, late=MS, garbage, \
                                    other-id, errors=BITS, force=N, no-contact, stuck; for example silent@40 or force=-12@3";
}

impl FromStr for PlannedToolFault {
    type Err = PlannedToolFaultError;

    fn from_str(text: &str) -> Result<Self, PlannedToolFaultError> {
        read(text).ok_or_else(|| PlannedToolFaultError { found: text.to_owned() })
    }
}

fn read(text: &str) -> Option<PlannedToolFault> {
    let (what, from) = text.split_once('@')?;
    let (name, value) = what.split_once('=').map_or((what, None), |(name, value)| (name, Some(value)));
    let fault = match (name, value) {
        ("link-cut", None) => ToolFault::LinkCut,
        ("silent", None) => ToolFault::Silent,
        ("late", ms) => ToolFault::Late(ms.map_or(Some(DEFAULT_DELAY_MS), |ms| ms.parse().ok())?),
        ("garbage", None) => ToolFault::Garbage,
        ("other-id", None) => ToolFault::OtherId,
        ("errors", bits) => ToolFault::Errors(bits.map_or(Some(1), |bits| bits.parse().ok())?),
        ("force", off) => ToolFault::ForceOff(off.map_or(Some(DEFAULT_FORCE_ERROR_N), parse_finite)?),
        ("no-contact", None) => ToolFault::NoContact,
        ("stuck", None) => ToolFault::Stuck,
        _ => return None,
    };
    Some(PlannedToolFault { fault, from: from.parse().ok().filter(|from| *from > 0)? })
}

fn parse_finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

/// A mock behind a TCP port; when it is dropped, its thread ends.
pub struct MockAcfServer {
    address: SocketAddr,
    fault: Arc<Mutex<Option<ToolFault>>>,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl MockAcfServer {
    /// Starts to listen. The panel is at the distance `touches_at_mm` in front of the tool, and the tool's axis is
    /// horizontal.
    ///
    /// # Errors
    /// If no port is free or no thread can be started.
    pub fn start(tool: &CompliantTool, touches_at_mm: f64) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let (fault, ends) = (Arc::new(Mutex::new(None)), Arc::new(AtomicBool::new(false)));
        let (of_thread, ended, mut mock) = (fault.clone(), ends.clone(), MockAcf::new(tool));
        let run = move || {
            let since = Instant::now();
            while !ended.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((stream, _)) => serve(stream, &mut mock, (&of_thread, &ended), (since, touches_at_mm)),
                    Err(_) => std::thread::sleep(POLL_TIMEOUT),
                }
            }
        };
        let thread = std::thread::Builder::new().name("mock tool".to_owned()).spawn(run)?;
        Ok(MockAcfServer { address, fault, ending: ends, thread: Some(thread) })
    }

    /// Returns the address at which it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sets the fault that the mock has from now on.
    pub fn set_fault(&self, fault: Option<ToolFault>) {
        *self.fault.lock().unwrap_or_else(PoisonError::into_inner) = fault;
    }
}

impl Drop for MockAcfServer {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
            let _ = thread.join();
        }
    }
}

type Control<'a> = (&'a Mutex<Option<ToolFault>>, &'a AtomicBool);

/// Serves one client, until the client leaves or the mock cuts the connection.
fn serve(
    mut stream: TcpStream,
    mock: &mut MockAcf,
    (fault, ends): Control<'_>,
    (since, touches_at_mm): (Instant, f64),
) {
    mock.connect();
    if stream.set_nonblocking(false).and_then(|()| stream.set_read_timeout(Some(POLL_TIMEOUT))).is_err() {
        return;
    }
    let mut buffer = [0; 256];
    while !ends.load(Ordering::Relaxed) {
        mock.set_fault(*fault.lock().unwrap_or_else(PoisonError::into_inner));
        let time_ms = u64::try_from(since.elapsed().as_millis()).unwrap_or(u64::MAX);
        mock.advance(ToolSurroundings { time_ms, contact_extension_mm: touches_at_mm, downwards: 0.0 });
        match stream.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => mock.receive(&buffer[..count], time_ms),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
        let Some(bytes) = mock.sent_bytes(time_ms) else { return };
        if stream.write_all(&bytes).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_read_with_its_waypoint() {
        let of = |text: &str| text.parse::<PlannedToolFault>().map(|planned| (planned.fault, planned.from));
        assert_eq!(of("silent@40"), Ok((ToolFault::Silent, 40)));
        assert_eq!(of("force=-12.5@3"), Ok((ToolFault::ForceOff(-12.5), 3)));
        assert_eq!(of("late@1"), Ok((ToolFault::Late(130), 1)));
        assert_eq!(of("errors=2@7"), Ok((ToolFault::Errors(2), 7)));
        for wrong in ["silent", "silent@0", "silent@x", "mute@4", "silent=3@4", "force=nan@4", ""] {
            let told = of(wrong).expect_err("no fault").to_string();
            assert!(told.starts_with(&format!("found \"{wrong}\"")) && told.contains("silent@40"), "{told}");
        }
    }
}
