//! The main loop: it receives an event, computes the step of the state table, performs the effects of the step, and
//! continues with the next event.
//!
//! ```text
//! requests ─┐                    ┌─ record: journal first, then everything else
//! deadlines ┼─ event ─ step ─────┼─ robot: switches, frames, paths      (`actions`, `moves`, `wiring`)
//! robot ────┘                    └─ cameras and computing               (`computing`, `perception`, `abrasion`)
//! ```
//!
//! The state table decides (see `cycle`); the loop performs. The data of an action (the scan's fit, the refined pose,
//! the film, the plan) stay in the loop; the state table receives only ids, counts and grades. Actions that use a
//! camera or compute share one queue (`computing`). In the service, a thread processes the queue while the loop
//! continues to answer; in a replay and in the simulated cell of a single command, the loop processes the queue itself.
//! The result of an action that was abandoned in the meantime is ignored. The connection to the robot has its own
//! thread, and the controller stops automatically if it receives no data from this thread.
//!
//! The loop uses the robot's time. In lock step this is the mock controller's virtual clock, so that sprays, films and
//! deadlines need no real time; this clock stops during a computation.
//!
//! [`crate::setup`] is the loop's input. `running` is its memory, with the action in progress, the path that was sent,
//! and the limit up to which a contact path may continue. `answers` converts a phase's findings to the state table's
//! answer and the record's finding; `tool_state` is the known state of a compliant tool. `run`, `actions`, `moves`,
//! `contacts` and `robot_reports` perform the effects.
//!
//! A service, a single cycle and a replay use this same loop with different `ports`. Around the loop of the service are
//! `request` (the one request type of every interface) · `socket` (the interface on this computer) · `protocol` (a line
//! in, a line out) · `gateway` (a request in, a reply out) · `request_queue` (waiting requests, by their urgency) ·
//! `request_handler` (requests, signals and systemd, for the loop) · `camera_lease` (the cameras, lent between cycles)
//! · `operator_texts` (states and refusals for people) · `interfaces` (page, line and
//! plant, started together) · `examination` (the cell from the bottom up) · `page_writer` (signature and page of an ended
//! cycle) · `client` (a command that asks the service). `replay` records the data that pass through the ports, and runs
//! a cycle again from a recording.

mod abrasion;
mod actions;
mod alarms;
mod answers;
mod background;
mod camera_lease;
mod client;
mod computing;
mod contacts;
mod control;
mod corners;
mod corrected;
mod error;
mod examination;
mod films;
#[cfg(feature = "plant")]
mod fleet;
mod free_memory;
mod gateway;
mod interfaces;
mod line;
mod live_view;
mod moves;
#[cfg(feature = "plant")]
mod office;
#[cfg(feature = "plant")]
mod opcua;
mod operator_texts;
mod page_writer;
mod people;
mod perception;
mod ports;
mod protocol;
mod push;
mod recording;
#[cfg(any(test, feature = "testing"))]
mod remembered;
mod replay;
mod request;
mod request_handler;
mod request_queue;
mod robot_reports;
mod run;
mod running;
mod single;
mod single_interlocks;
mod slots;
mod socket;
#[cfg(feature = "plant")]
mod sparkplug;
mod tool_state;
mod transfer;
mod web;

#[cfg(test)]
mod tests;

pub use alarms::{AlarmId, Alarms};
pub use camera_lease::{AllCameras, BorrowedFlangeCamera, RemoteScanner, SharedCameras, ShotRequest};
pub use client::{ClientError, send_to_service, service_axes, service_state};
pub use computing::{CalibrationCheck, Computing};
pub use error::DaemonError;
pub use examination::{ExaminationOptions, ExaminedItem, ItemStatus, accept_connection, examine_cell};
#[cfg(feature = "plant")]
pub use fleet::{FleetAddress, FleetError, serve as serve_fleet};
pub use free_memory::give_back_free_memory;
pub use gateway::{Gateway, InterfaceContext, current_user};
pub use interfaces::Interfaces;
pub use line::{LineFront, LineParts};
pub use live_view::{LiveFilm, LiveFrame, LiveView};
#[cfg(feature = "plant")]
pub use office::{OfficeParts, OfficeSender};
#[cfg(feature = "plant")]
pub use opcua::{OpcUaParts, OpcUaServer};
pub use operator_texts::{command, refusal, request_keyword, state_reason};
pub use page_writer::write_pages;
pub use people::{AccountService, LoginResult};
pub use ports::{
    CameraAnswer, CameraCommand, CameraFault, CameraPort, Cameras, Command, Figure, Finding, LastState,
    LinkedRobot, LinkedTool, LoopEvent, NoCameras, Note, Picture2d, PictureStore, Port, Record, RecordAnswer,
    RecordCommand, RecordError, RecordPort, RequestAnswer, RequestCommand, RequestPort, Requester, RobotAnswer,
    RobotCommand, RobotPort, StoredPicture, ToolAnswer, ToolCommand, ToolPort,
};
pub use protocol::{MAX_BYTES, ProtocolError, read_request, request_line};
pub use push::{PushParts, PushSender};
pub use recording::{StoreRecord, picture_store};
#[cfg(any(test, feature = "testing"))]
pub use remembered::{Memory, SceneKey};
pub use replay::{Difference, Player, RecordedPort, Recording, RecordingSwitch, ReplayResult};
pub use request::{Reply, Request, RequestKind, RequestResult};
pub use request_handler::{EndedCycle, LastWrittenPage, RequestHandler, ServiceParts, wait_for};
pub use request_queue::{RequestQueue, RequestQueueError, RequestSender, request_queue};
pub use run::{LoopOutcome, LoopPorts, LoopStart, run};
pub use single::{SingleError, SingleLine, SingleRobot, speed_command};
pub use socket::{Socket, SocketError};
#[cfg(feature = "plant")]
pub use sparkplug::{SparkplugEdge, SparkplugParts};
pub use transfer::{OfficeStatus, PushStatus, RecordTransfers};
pub use web::{OperatorPage, PageError, PageParts};
