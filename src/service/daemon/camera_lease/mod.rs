//! The service's cameras, lent between cycles: `panelprep shoot` and the live calibrations take pictures while the
//! service has the cameras open.
//!
//! [`SharedCameras`] holds the loop's cameras. While the cell rests without a cycle, it lends them to one connection at
//! a time, and to the operator's page for one picture at a time (`shared`). Before each shot it checks whether the cell
//! still rests, and a film ends at its next picture if the cell does not. So the loop never waits for a shot that began
//! after the cell was at rest. [`RemoteScanner`] and [`BorrowedFlangeCamera`] are the clients at the other end of the
//! connection (`client`).
//!
//! ```text
//! {"ask":"shoot","shot":"scan"}                                  a line to the service
//! {"sent":"scan","bytes":3987654,"time_s":12.1,"conditions":{…}}   a line from it, then that number of bytes of PCD
//! ```
//!
//! The pictures of a film are sent one after the other until the client closes its writing side, then
//! `{"sent":"ended",…}`. The robot is not moved, no output is switched, and nothing is written to the store. The answer
//! to `{"ask":"state"}` reports the position of the arm during this time.

mod client;
mod request;
mod shared;

pub use client::{BorrowedFlangeCamera, RemoteScanner};
pub use request::ShotRequest;
pub use shared::{AllCameras, SharedCameras};
pub(super) use shared::{CameraEye, serve};

#[cfg(test)]
mod tests;
