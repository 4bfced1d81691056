//! The loop's data about the compliant tool: its last measured value, its last command, and the contact path in
//! progress.

use panelprep_base::verdict::Reason;
use panelprep_cell::cell::CompliantTool;
use panelprep_cell::force::{
    ExpectedForce, ForcePhase, ForceSetPoint, ForceWatch, LinkLossCause, SensorLoad, SetPointRamp, ToolReading,
    WatchLimits, force_phase, not_ready_reason,
};
use panelprep_cell::recipe;
use panelprep_devices::acf::ToolReport;
use panelprep_kuka::eki::Time;
use std::time::Duration;

/// Maximum additional age of a measured value beyond the tool's deadlines. If the value is older, the thread of the
/// connection to the tool is treated as failed.
const MAX_FORCE_VALUE_DELAY: Duration = Duration::from_millis(150);
/// Maximum delay of the force behind its set-point.
const MAX_FORCE_LAG: Duration = Duration::from_millis(100);
/// Minimum change of the weight component along the tool's axis, N, after which the tool is commanded again.
const MIN_ATTITUDE_CHANGE_N: f64 = 0.2;

/// The state of the tool's force control.
#[derive(Debug, Default)]
pub(super) struct PressState {
    last: Option<(Time, ToolReading)>,
    loss: Option<LinkLossCause>,
    last_command: Option<ForceSetPoint>,
    contact: Option<ContactInProgress>,
}

/// A contact path in progress.
#[derive(Debug)]
struct ContactInProgress {
    /// For each waypoint of the plan, whether the disc touches the panel.
    on_panel: Vec<bool>,
    force_n: f64,
    landing_n: f64,
    ramp_s: f64,
    force_phase: ForcePhase,
    /// The set-point of the tool's contact force, N, which changes along ramps.
    ramp: SetPointRamp,
    watch: ForceWatch,
}

impl PressState {
    /// Begins a contact path; `on_panel` states for each waypoint whether the disc touches the panel.
    pub fn begin_contact(&mut self, on_panel: Vec<bool>, settings: &recipe::Path, tool: &CompliantTool) {
        let (Some(force_n), Some(landing_n)) = (settings.force_n(), settings.landing_n()) else { return };
        self.contact = Some(ContactInProgress {
            on_panel,
            force_n,
            landing_n,
            ramp_s: settings.force_ramp_s(),
            force_phase: ForcePhase::HeldBack,
            ramp: SetPointRamp::constant(ForceSetPoint::retracted(tool.min_force_n)),
            watch: ForceWatch::default(),
        });
    }

    /// Returns the command that the tool needs now, if it differs from the last command. `under_way` is the number of
    /// waypoints that the arm has reached on a contact path.
    pub fn next_command(
        &mut self,
        tool: &CompliantTool,
        (under_way, downwards): (Option<usize>, f64),
        now: Time,
    ) -> Option<ForceSetPoint> {
        let held = ForceSetPoint::retracted(tool.min_force_n);
        let wanted = match (under_way, &mut self.contact) {
            (Some(reached), Some(contact)) => contact.force_at(reached, (tool, downwards), now),
            _ => {
                self.contact = None;
                held
            }
        };
        let is_same = |commanded: ForceSetPoint| {
            let forces = [(commanded.force_n, wanted.force_n), (commanded.no_contact_n, wanted.no_contact_n)];
            forces.into_iter().all(|(told_n, wanted_n)| (told_n - wanted_n).abs() < MIN_ATTITUDE_CHANGE_N)
        };
        if self.last_command.is_some_and(is_same) {
            return None;
        }
        self.last_command = Some(wanted);
        Some(wanted)
    }

    /// Processes a report of the tool; returns a reason if the connection is lost.
    pub fn on_report(&mut self, news: Option<ToolReport>, now: Time) -> Option<Reason> {
        match news? {
            ToolReport::Reading { reading, age_ms } => {
                let age = Duration::from_millis(u64::from(age_ms));
                let at = Time::from_start(now.since_start().saturating_sub(age));
                (self.last, self.loss) = (Some((at, reading)), None);
                None
            }
            ToolReport::Lost(loss) => {
                // A tool that connects again is retracted and must be commanded again.
                (self.last, self.last_command) = (None, None);
                Some(link_loss_reason(self.loss.insert(loss)))
            }
        }
    }

    /// Returns the last measured contact force, N.
    pub fn contact_n(&self, tool: &CompliantTool, downwards: f64) -> Option<f64> {
        self.last.map(|(_, reading)| SensorLoad::from(tool).contact_n(reading.force_n, downwards))
    }

    /// Returns the reason why the contact path in progress must end now; `None` if it may continue.
    pub fn end_reason(&mut self, tool: &CompliantTool, downwards: f64, now: Time) -> Option<Reason> {
        if let Some(why) = self.not_ready_reason(tool, now) {
            return Some(why);
        }
        let (contact_n, (at, reading)) = (self.contact_n(tool, downwards)?, self.last?);
        let ContactInProgress { force_phase: aim, ramp, watch, .. } = self.contact.as_mut()?;
        let expected = ExpectedForce { force_phase: *aim, force_range_n: ramp.force_range_n(at, MAX_FORCE_LAG) };
        watch.evaluate((&reading, contact_n), expected, &limits(tool), at)
    }

    /// Returns the reason why no motion towards the panel may begin; `None` if it may begin.
    pub fn motion_refusal(&self, tool: &CompliantTool, now: Time) -> Option<Reason> {
        let unready = || self.last.and_then(|(_, reading)| not_ready_reason(&reading, tool.stroke_mm));
        self.not_ready_reason(tool, now).or_else(unready)
    }

    /// Records that the contact path in progress has ended.
    pub fn end_contact(&mut self) {
        self.contact = None;
    }

    fn not_ready_reason(&self, tool: &CompliantTool, now: Time) -> Option<Reason> {
        if let Some(loss) = &self.loss {
            return Some(link_loss_reason(loss));
        }
        let Some((at, _)) = self.last else {
            let words = "no data was received from the compliant tool yet; check its power and cable, then run \
                         `panelprep doctor`";
            return Some(Reason::new("tool_link", words));
        };
        let longest =
            Duration::from_millis(u64::from(tool.reply_ms) + u64::from(tool.period_ms)) + MAX_FORCE_VALUE_DELAY;
        let age = now.since(at);
        let words = || {
            format!(
                "the compliant tool has sent no data for {} ms; run `panelprep doctor` to check the connection",
                age.as_millis()
            )
        };
        (age > longest).then(|| Reason::new("tool_link", words()))
    }
}

impl ContactInProgress {
    /// Returns the force set-point of the tool after the arm has reached `reached` waypoints.
    fn force_at(&mut self, reached: usize, (tool, downwards): (&CompliantTool, f64), now: Time) -> ForceSetPoint {
        let aim = force_phase(&self.on_panel, reached);
        let target_n = match aim {
            ForcePhase::HeldBack => tool.min_force_n,
            ForcePhase::Landing => self.landing_n,
            ForcePhase::Pressing => self.force_n,
        };
        // At the landing, the force changes to the landing force without a ramp; when the disc leaves the panel, it
        // also changes without a ramp.
        let was_held = self.force_phase == ForcePhase::HeldBack;
        let ramp_s =
            if aim == ForcePhase::HeldBack || was_held && aim == ForcePhase::Landing { 0.0 } else { self.ramp_s };
        if aim != self.force_phase {
            self.force_phase = aim;
            self.ramp.start_towards(ForceSetPoint { force_n: target_n, no_contact_n: self.landing_n, ramp_s }, now);
        }
        if aim == ForcePhase::HeldBack {
            return ForceSetPoint::retracted(tool.min_force_n);
        }
        // The value is within the tool's force range at every attitude; otherwise the cell or the cycle would have been
        // refused.
        let actuator_n = |contact_n: f64| SensorLoad::from(tool).actuator_n(contact_n, downwards);
        ForceSetPoint { force_n: actuator_n(target_n), no_contact_n: actuator_n(self.landing_n), ramp_s }
    }
}

fn limits(tool: &CompliantTool) -> WatchLimits {
    let span = |ms: u16| Duration::from_millis(u64::from(ms));
    WatchLimits {
        stroke_mm: tool.stroke_mm,
        band_n: tool.band_n,
        band_within: span(tool.band_ms),
        contact_within: span(tool.contact_ms),
    }
}

fn link_loss_reason(loss: &LinkLossCause) -> Reason {
    let words = format!(
        "the connection to the compliant tool is lost: {loss}; check its power and cable, then run `panelprep doctor`"
    );
    Reason::new("tool_link", words)
}
