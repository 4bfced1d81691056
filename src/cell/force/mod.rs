//! The compliant tool without sockets: telegrams, session, set-points, and the comparison of the measured values with
//! their expected values.
//!
//! A compliant tool presses the disc onto the panel with its own force control, at any extension within its stroke. The
//! arm's tool centre point is calibrated at half the stroke. The arm moves along the plan as with any other tool; the
//! arm does not control the force.
//!
//! ```text
//! tool fully back            half the stroke               fully out
//! 0 mm ├──────┬───────────────────┼───────────────────┬──────┤ stroke_mm
//!             └─ middle two thirds: in contact the tool is here ─┘
//! ```
//!
//! Forces are contact forces, N, positive if the disc presses onto the panel, unless they are named actuator forces;
//! `watch` contains the formula between both. Read the modules in this order: `telegram` · `session` · `press`
//! (set-points, the force at each waypoint, and the check before a contact motion) · `watch` (the weight, and the
//! comparison with expected values). Payload and zero are calibrated in `calib::force`.

mod press;
mod session;
mod telegram;
mod watch;

pub use press::{
    CONTACT_STROKE_FRACTION, ForcePhase, ForceSetPoint, SetPointRamp, TOOL_STROKE, check_stroke, force_phase,
};
pub use session::{LinkLossCause, Session, SessionLimits, State};
pub use telegram::{
    Command, ErrorBits, MAX_LOGIN_ECHO_BYTES, TERMINATOR, TelegramError, ToolReading, login, parse_reply,
};
pub use watch::{ExpectedForce, ForceWatch, SensorLoad, WatchLimits, down_cosine, not_ready_reason};
