//! The operator's page: an interface to the service's requests and states in a browser. It makes no decisions for the
//! cell.
//!
//! ```text
//! browser ─ TLS ─ server ─ guard (session, origin, role) ─ routes (the one table) ─ views
//!                                                          ├─ requests → Gateway → the loop
//! the loop ─ state, five times a second ─ live ─ events ───┘
//! ```
//!
//! The page has its own thread and runtime, and reads the store through its own connection. The loop, the connection to
//! the robot and the cameras never wait for a browser. Stop and abort need no log-in, are recorded like every request,
//! and are not an emergency stop. Nothing is loaded from other sites.
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

pub use server::{OperatorPage, PageError, PageParts};

// The parts that the web page of the office server uses as well.
#[cfg(feature = "plant")]
pub(super) use {
    answers::csv_file,
    guard::{cookie, cookie_name},
    layout::STYLE_SHEET,
    server::{PageFileError, certificate, listen_and_serve},
    sessions::{SessionHolder, Sessions},
    versions::show_difference,
};
