//! Pages that this program serves to a browser on the same computer.
//!
//! [`Local`] is the server. It listens on a loopback address alone and identifies its pages by a key in their address
//! that only the terminal shows. It refuses requests that name another host, so that no other page in the browser can
//! send a request. All that a page needs is in the program; nothing is loaded from other servers.
//!
//! - `drawing`: the region and the masked areas, drawn on the taught picture
//! - `label`: the breaks in a clip, marked over its pictures

pub mod drawing;
pub mod label;
mod local;
mod session;

pub use local::{LocalError, LocalServer};
