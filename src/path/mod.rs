//! Tool paths.
