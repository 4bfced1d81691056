//! The operator's page: a second interface on the service's requests and states, in a browser. It makes no decisions
//! for the cell.
//!
//! ```text
//! browser ─ TLS ─ server ─ guard (session, origin, role) ─ routes (the one table) ─ views
//!                                                          ├─ requests → Gateway → the loop
//! the loop ─ state, five times a second ─ live ─ events ───┘
//! ```
//!
//! It runs on a thread and a runtime of its own, and reads the store through its own connection. The loop, the robot's
//! link and the cameras never wait for a browser. Stop and abort need no log-in, are recorded like every request, and
//! are not an emergency stop. Nothing is loaded from other sites.
//!
//! `page_texts` (languages) · `sessions` · `tls` · `state` (the data that handlers share) · `assets` · `layout` (the
//! frame of each page) · and a file for each page.

mod access;
mod alarms;
mod assets;
mod audit;
mod bodies;
mod camera_views;
mod cameras;
mod compare;
mod cycle;
mod doctor;
mod downloads;
mod draw;
mod error;
mod frame;
mod guard;
mod history;
mod layout;
mod live;
mod live_state;
mod login;
mod messages;
mod page_texts;
mod people;
mod places;
mod reading;
mod refusals;
mod requests;
mod routes;
mod run_page;
mod scene;
mod server;
mod sessions;
mod setup;
mod signed_files;
mod stamps;
mod state;
mod tls;
mod trends;
mod versions;
mod visitor;
mod watching;

#[cfg(test)]
mod tests;

pub(super) use assets::STYLE_SHEET;
pub(super) use downloads::csv_file;
pub use error::{PageError, PageFileError};
pub(super) use guard::{cookie, cookie_name};
pub(super) use server::listen_and_serve;
pub use server::{OperatorPage, PageParts};
pub(super) use sessions::{SessionHolder, Sessions};
pub(super) use tls::certificate;
pub(super) use versions::difference;
