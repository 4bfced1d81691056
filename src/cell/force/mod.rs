//! The compliant tool without sockets: its telegrams, its session, its set-points, and the expected values of its
//! readings.
//!
//! A compliant tool presses the disc onto the panel with a force of its own, at any distance of the arm within its
//! stroke. The arm's tool centre point is calibrated at half the stroke. The arm moves along the plan as with any
//! other tool; no force is controlled through the arm.
//!
//! ```text
//! tool fully back            half the stroke               fully out
//! 0 mm ├──────┬───────────────────┼───────────────────┬──────┤ stroke_mm
//!             └─ middle two thirds: in contact the tool is here ─┘
//! ```
//!
//! Forces are contact forces, N, positive if the disc presses onto the panel, unless they are stated to be the
//! actuator's; `watch` has the formula between them. Read in this order: `telegram` · `session` · `press` (the
//! set-points of the tool, the force at each waypoint, and the gate before the motion) · `watch` (the weight, and
//! readings against expected values). Payload and zero are calibrated in `calib::force`.

mod press;
mod session;
mod telegram;
mod watch;

pub use press::{ForcePhase, ForceSetPoint, MIDDLE_SHARE, SetPointRamp, TOOL_STROKE, check_stroke, force_phase};
pub use session::{LinkLossCause, Session, SessionLimits, State};
pub use telegram::{
    Command, ErrorBits, MAX_LOGIN_ECHO_BYTES, TERMINATOR, TelegramError, ToolReading, login, parse_reply,
};
pub use watch::{ExpectedForce, ForceWatch, SensorLoad, WatchLimits, down_cosine, not_ready_reason};
