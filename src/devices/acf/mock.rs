//! A mock of the compliant tool: it receives and sends the tool's telegrams as bytes, and simulates the actuator. The
//! mock and the client's session share only the data format.
//!
//! The actuator extends or retracts at a limited speed until it reaches the end of its stroke or touches the panel. In
//! contact it presses with the commanded force plus the component of its payload's weight along the tool's axis. Its
//! sensor reports the actuator's force with a small zero error and with noise that depends only on the time, so that
//! runs are reproducible.
//!
//! An injected fault can begin during a path: `silent@40` begins at the 40th waypoint in contact. For tests of the link
//! and of `doctor`, the mock can also listen on a TCP port of this computer, for one client at a time.

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
const ACTUATOR_SPEED_MM_S: f64 = 250.0;
/// Amplitude of the sensor's noise, N.
const SENSOR_NOISE_N: f64 = 0.2;
/// Contact stiffness, N/mm: the force for each millimetre by which the panel pushes the tool beyond its retracted
/// position, or pushes a stuck tool.
const STIFFNESS_N_PER_MM: f64 = 40.0;
/// Gravity, m/s².
const GRAVITY_M_S2: f64 = 9.806_65;

/// Default parameters of injected faults: delay of a reply, ms, and error of the force, N.
const DEFAULT_DELAY_MS: u64 = 130;
const DEFAULT_FORCE_ERROR_N: f64 = 12.0;

/// Time for which the mock waits for bytes or for a client before it checks whether it must end.
const POLL_TIMEOUT: Duration = Duration::from_millis(2);

/// The position of the panel relative to the tool, and the tool's attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolSurroundings {
    /// The time, ms.
    pub time_ms: u64,
    /// The extension of the actuator at which the disc touches the panel, mm. Infinite if there is no panel in front of
    /// the tool; negative if the arm pushes the tool beyond its retracted position.
    pub contact_extension_mm: f64,
    /// The downward component of the tool's direction, −1 to 1.
    pub downwards: f64,
}

/// A fault that can be injected into the mock.
#[derive(Debug, Clone, Copy, PartialEq, strum::Display)]
pub enum ToolFault {
    /// The mock closes the connection.
    LinkCut,
    /// The mock accepts commands and does not reply.
    Silent,
    /// The mock replies with this delay, ms.
    Late(u64),
    /// The mock replies with bytes that are not a valid telegram.
    Garbage,
    /// The mock replies with the identification number of another tool.
    OtherId,
    /// The mock reports these error bits.
    Errors(u8),
    /// The force of the mock differs from the commanded force by this amount, N.
    ForceOff(f64),
    /// The mock always reports that there is no contact.
    NoContact,
    /// The actuator of the mock does not move any more.
    Stuck,
}

/// The mock.
#[derive(Debug, Clone)]
pub struct MockAcf {
    tool: CompliantTool,
    fault: Option<ToolFault>,
    is_logged_in: bool,
    received: Vec<u8>,
    /// The replies that are not sent yet, each with the time at which it is sent, ms.
    scheduled: Vec<(u64, Vec<u8>)>,
    commanded_n: [f64; 2],
    position_mm: f64,
    time_ms: Option<u64>,
    pub(super) contact: bool,
    pub(super) sensor_n: f64,
}

impl MockAcf {
    /// Creates a mock with the parameters of the tool in the cell file.
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

    /// Sets the injected fault; `None` removes it.
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

    /// Advances the time of the mock.
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
            let most_mm = ACTUATOR_SPEED_MM_S * passed_s;
            let goal_mm = if total_n > 0.0 { touches_at_mm.min(self.tool.stroke_mm) } else { 0.0 };
            let step_mm = (goal_mm - self.position_mm).clamp(-most_mm, most_mm);
            // The panel pushes the actuator back as fast as the arm approaches.
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

    /// Processes the bytes that the client has sent.
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

    /// Returns the bytes that the mock has sent up to this time; `None` if the connection is closed.
    pub fn sent_bytes(&mut self, now_ms: u64) -> Option<Vec<u8>> {
        if self.fault == Some(ToolFault::LinkCut) {
            return None;
        }
        let due = self.scheduled.extract_if(.., |(at_ms, _)| *at_ms <= now_ms);
        Some(due.flat_map(|(_, bytes)| bytes).collect())
    }

    /// Returns the extension of the actuator, mm.
    pub fn position_mm(&self) -> f64 {
        self.position_mm
    }
}

/// Returns the sensor's noise at this time; the noise is reproducible.
fn noise_n(time_ms: u64) -> f64 {
    let mixed = time_ms.wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(17).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    SENSOR_NOISE_N * ((mixed >> 40) as f64 / f64::from(1_u32 << 23) - 1.0)
}

/// An injected fault, and the waypoint in contact at which it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedToolFault {
    /// The fault.
    pub fault: ToolFault,
    /// The number of the waypoint in contact at which the fault begins.
    pub from: u32,
}

/// The error of an invalid fault specification.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found \"{found}\"; valid: {}", PlannedToolFault::HELP)]
pub struct PlannedToolFaultError {
    found: String,
}

impl PlannedToolFault {
    /// The syntax of a fault specification, for help texts.
    pub const HELP: &'static str = "NAME[=VALUE]@N, N being a waypoint in contact from 1 on: link-cut, silent, \
                                    late=MS, garbage, other-id, errors=BITS, force=N, no-contact, stuck; for example \
                                    silent@40 or force=-12@3";
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

/// A mock tool that listens on a TCP port; dropping it ends its thread.
pub struct MockAcfServer {
    address: SocketAddr,
    fault: Arc<Mutex<Option<ToolFault>>>,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl MockAcfServer {
    /// Starts a mock tool that listens on a free TCP port. Its axis is horizontal, and the panel is `touches_at_mm` in
    /// front of its retracted position.
    ///
    /// # Errors
    /// If no port is free, or the operating system cannot start a thread.
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

    /// Returns the address on which the mock listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sets the injected fault; `None` removes it.
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

/// Serves one client until the client disconnects or the mock closes the connection.
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
