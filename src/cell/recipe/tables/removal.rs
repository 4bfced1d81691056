//! The required removal: `[removal]`.

use super::path::Path;
use panelprep_base::config::{Choice, Section, settings};

/// The method of calculating the feed from the required removal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RemovalMethod {
    /// No calculation: the feed makes the times under the disc even, and the resulting removal is reported.
    Constant,
    /// The feed on each move is calculated so that the target is removed evenly.
    Scheduled,
}

impl Choice for RemovalMethod {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("constant", RemovalMethod::Constant), ("scheduled", RemovalMethod::Scheduled)];
}

settings! {
    /// `[removal]`: the required removal and its upper limit.
    pub struct Removal {
        /// The method of calculating the feed from the required removal.
        method: RemovalMethod, (), default RemovalMethod::Constant;
        /// Depth to remove, µm.
        target_um: f64, 0.1..=5_000.0, required;
        /// Largest allowed depth at any place, µm, for example the thickness of the coating or of the first ply. The
        /// 95 % bound of the removal over all passes is compared with this depth.
        max_um: f64, 0.1..=10_000.0, required;
        /// Largest deviation from the target for 95 % of the treated area, percent of the target.
        even_percent: f64, 1.0..=100.0, default 20.0;
        /// Force of the tool on the panel, N, if the tool is a spring; the force of a compliant tool is in `[path]`.
        force_n: Option<f64>, 0.5..=500.0, default None;
        /// Uncertainty of this force, 95 %, percent of the force.
        force_error_percent: f64, 0.0..=50.0, default 10.0;
        /// Lowest feed that a schedule may use, mm/s; the highest is the path's.
        min_feed_mm_s: f64, 0.5..=500.0, default 5.0;
    }
}

/// Reads the table, if the recipe has one; the outer `None` means that the table has problems. If `[path]` has
/// problems, `path` is `None` here, and the keys that depend on it are not checked.
pub(in crate::recipe) fn parse_removal(section: &Section<'_, '_>, path: Option<&Path>) -> Option<Option<Removal>> {
    if !section.is_present() {
        return Some(None);
    }
    let removal = Removal::parse(section)?;
    if removal.target_um() >= removal.max_um() {
        let message =
            format!("found {}, must be greater than target_um, {}", removal.max_um(), removal.target_um());
        section.problem("max_um", message);
        return None;
    }
    let Some(path) = path else { return Some(Some(removal)) };
    match (path.force_n(), removal.force_n()) {
        (Some(pressed_n), Some(_)) => {
            section.problem(
                "force_n",
                format!("has no effect: the tool presses with path.force_n = {pressed_n} N; remove this key"),
            );
            return None;
        }
        (None, None) => {
            section.problem(
                "force_n",
                "is missing; state the force of the tool on the panel in N, or path.force_n for a compliant tool",
            );
            return None;
        }
        _ => {}
    }
    if removal.min_feed_mm_s() > path.feed_mm_s() {
        let (found, feed_limit) = (removal.min_feed_mm_s(), path.feed_mm_s());
        section.problem("min_feed_mm_s", format!("found {found} (limit {feed_limit}, path.feed_mm_s)"));
        return None;
    }
    Some(Some(removal))
}
