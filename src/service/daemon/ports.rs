//! The loop's interfaces to its environment: a robot, a compliant tool if there is one, cameras, a record, and a source
//! of requests.
//!
//! Each of them is a [`Port`]: it performs one command of its enum at a time and returns one answer of another enum.
//! Therefore a layer between the loop and a port (a recording, a replay, the correction of the arm) is written only
//! once for all commands. The traits `RobotPort`, `ToolPort`, `CameraPort`, `RecordPort` and `RequestPort` provide the
//! commands as functions.

mod cameras;
mod port;
mod record;
mod requests;
mod robot;

pub use cameras::{CameraAnswer, CameraCommand, CameraFault, CameraPort, Cameras, NoCameras, Picture2d};
pub use panelprep_cell::record::Finding;
pub use port::{Command, Port};
pub use record::{
    Figure, Note, PictureStore, Record, RecordAnswer, RecordCommand, RecordError, RecordPort, StoredPicture,
};
pub use requests::{LoopEvent, RequestAnswer, RequestCommand, RequestPort, Requester};
pub use robot::{
    LastState, LinkedRobot, LinkedTool, RobotAnswer, RobotCommand, RobotPort, ToolAnswer, ToolCommand, ToolPort,
};
