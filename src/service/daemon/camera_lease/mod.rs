//! Lends the service's cameras between cycles: `panelprep shoot` and the live calibrations capture pictures while the
//! service has the cameras open.
//!
//! [`SharedCameras`] holds the cameras of the loop. While no cycle is running, it lends them to one connection at a
//! time, and to the operator's page for one picture at a time (`shared`). Before each shot it checks that no cycle has
//! started; a film ends before its next picture if a cycle has started. So the loop never waits for a shot that began
//! after the cycle. [`RemoteScanner`] and [`BorrowedFlangeCamera`] are the clients at the other end of the connection
//! (`client`).
//!
//! ```text
//! {"ask":"shoot","shot":"scan"}                                    one line to the service
//! {"sent":"scan","bytes":3987654,"time_s":12.1,"conditions":{…}}   one line from the service, then that number of
//! bytes of PCD
//! ```
//!
//! The pictures of a film are sent one after the other until the client closes its writing side. Then the service sends
//! `{"sent":"ended",…}`. The robot is not moved, no output is switched, and nothing is written to the store. Meanwhile
//! the reply to `{"ask":"state"}` reports the position of the arm.

mod client;
mod request;
mod shared;

pub use client::{BorrowedFlangeCamera, RemoteScanner};
pub use request::ShotRequest;
pub use shared::{AllCameras, SharedCameras};
pub(super) use shared::{CameraEye, serve};

#[cfg(test)]
mod tests;
