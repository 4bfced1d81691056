//! Tests the connection to the robot as a whole: the client's session against the mock controller, in virtual time and
//! over sockets.

pub mod cell;
mod corpus;
mod cuts;
mod damage;
mod fuzz;
mod loopback;
pub mod oracles;
mod paths;
mod programs;
mod sockets;
mod walks;
