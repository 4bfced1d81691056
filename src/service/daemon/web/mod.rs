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
//! `page_texts` (languages) · `sessions` · `state` (the data that handlers share) · `layout` (the frame of each page,
//! styles and scripts) · `answers` · and a file for each page.

mod accounts;
mod alarms;
mod answers;
mod audit;
mod cameras;
mod cycle;
mod guard;
mod history;
mod layout;
mod live_state;
mod messages;
mod page_texts;
mod requests;
mod routes;
mod run_page;
mod server;
mod sessions;
mod setup;
mod state;
mod trends;
mod versions;

#[cfg(test)]
mod tests;

pub(super) use answers::csv_file;
pub(super) use guard::{cookie, cookie_name};
pub(super) use layout::STYLE_SHEET;
pub use server::{OperatorPage, PageError, PageFileError, PageParts};
pub(super) use server::{certificate, listen_and_serve};
pub(super) use sessions::{SessionHolder, Sessions};
pub(super) use versions::difference;
