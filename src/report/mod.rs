//! Pictures and pages for people: from results to something to look at. Computes nothing that decides.

pub mod canvas;
pub mod page;
