//! Panelprep: finds a free-form panel, watches water run off it, abrades where the film broke.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod geometry;

pub mod config;
pub mod verdict;

pub mod cell;
pub mod recipe;

pub mod check;
