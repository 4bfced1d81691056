//! Pages that this program serves to a browser on the same computer.
//!
//! [`Local`] is the server: it listens on a loopback address alone, knows its pages by a key in their address that only the
//! terminal shows, and refuses requests that name another host, so that no other page in the browser can ask for anything. All that
//! a page needs is in the program; nothing comes from outside.
//!
//! - `drawing`: the region and what is masked, drawn on the taught picture
//! - `label`: what broke in a clip, marked over its pictures

pub mod drawing;
pub mod label;
mod local;
mod session;

pub use local::{Local, LocalError};
