//! A mock of the tool: bytes in, bytes out, and an actuator between them. The mock and the session have only the data
//! format in common.
//!
//! The actuator moves out or back at a bounded speed, until its stroke or the panel ends the motion. In contact it
//! presses with the commanded force, to which the weight of its payload is added according to its attitude. Its sensor
//! reports the actuator's force with a small zero error and with noise that depends only on the time, so that two runs
//! are equal.

use panelprep_cell::cell::CompliantTool;

/// Speed of the actuator, mm/s.
const SPEED_MM_S: f64 = 250.0;
/// Noise of the sensor in each direction, N.
const NOISE_N: f64 = 0.2;
/// Stiffness, N/mm: the force for each millimetre that the panel pushes a tool beyond its retracted position, or
/// pushes a stuck tool.
const STIFF_N_MM: f64 = 40.0;
/// Gravity, m/s².
const GRAVITY_M_S2: f64 = 9.806_65;

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
    /// It reports these errors, as bits.
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
    /// The bytes that are to be sent, and the times.
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
            (true, true) => STIFF_N_MM * pushed_mm,
            (false, true) if pushed_mm > 1e-9 => total_n.max(0.0) + STIFF_N_MM * pushed_mm,
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
