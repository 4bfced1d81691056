//! The adapter against Aravis's fake camera: real GVCP and GVSP over the loopback interface.
