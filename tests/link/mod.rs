//! The robot link as a whole: the client's session against the mock controller, in virtual time and over sockets.

#[allow(dead_code, reason = "the simulated world uses the rest")]
mod cell;
mod corpus;
mod cuts;
mod damage;
mod fuzz;
mod loopback;
mod oracles;
mod paths;
mod programs;
mod sockets;
mod walks;
