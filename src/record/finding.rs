//! What one phase of a cycle found.

use crate::verdict::{Check, Judgement};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Number of a cycle in its store, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CycleId(pub i64);

impl std::fmt::Display for CycleId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// Which phase found something.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "these names are those of the cycle's phases")]
#[strum(serialize_all = "lowercase")]
pub enum Kind {
    Locate,
    Refine,
    /// What the arm reaches of the panel, before it is wetted.
    Reach,
    Inspect,
    Plan,
    Verify,
    Abrade,
    /// The gate before a motion.
    Gate,
    /// What the robot or its link reported.
    Robot,
    /// The self-test before a cycle.
    SelfTest,
    /// What the compliant tool reported.
    Tool,
}

impl Kind {
    /// Its word, as it is kept.
    pub fn word(self) -> &'static str {
        self.into()
    }
}

/// Names of numbers that are read again by their name.
pub mod name {
    /// How far today's panel lies from the taught one at most.
    pub const DEVIATION: &str = "deviation from the taught panel, largest";
    /// How long a film was watched, s.
    pub const WATCHED: &str = "watched";
    /// The water, as the recipe states it.
    pub const WATER: &str = "water, as the recipe states it";
    /// The lamp, as the recipe states it.
    pub const LAMP: &str = "lamp, as the recipe states it";
    /// From a scan in memory to the gate's word, ms.
    pub const SCAN_TO_VERDICT: &str = "scan to verdict";
    /// From a decoded wet picture to its result, median, ms.
    pub const PER_PICTURE: &str = "a picture takes, median";
    /// Waypoints of a plan, with the first, in air, at which the approach ends.
    pub const PLANNED: &str = "waypoints";
    /// Waypoints of a contact path that the robot executed, without the one at which the approach ended.
    pub const EXECUTED: &str = "waypoints executed";
    /// Depth that a path is expected to remove of the treated grids, mean, µm.
    pub const REMOVED_MEAN: &str = "expected removal, mean";
    /// Largest deviation from the target for 95 % of the treated area, %.
    pub const REMOVED_EVEN: &str = "removal even within";
    /// Largest removal at any place of the part over all passes so far, as the upper 95 % bound, µm.
    pub const REMOVED_BOUND: &str = "largest removal over all passes, upper 95 % bound";
    /// Contact force of a compliant tool at the poses that the robot reported on the panel, mean, N.
    pub const FORCE_MEAN: &str = "force in contact, mean";
    /// The least of them, N.
    pub const FORCE_MIN: &str = "force in contact, least";
    /// The most of them, N.
    pub const FORCE_MAX: &str = "force in contact, most";
    /// Corners that were seen so far.
    pub const CORNERS: &str = "corners seen";
    /// What is worn of the disc in use after the largest grid.
    pub const WORN_BY_A_GRID: &str = "worn of the disc after the largest grid";
    /// Grids that were begun and not covered as planned.
    pub const BEGUN: &str = "grids that were not covered as planned";
    /// Moves of the corner loop.
    pub const MOVES: &str = "moves after the first picture";
    /// Localization: residual along the surface's normals, about the smooth deviation, rms, mm.
    pub const RESIDUAL: &str = "residual, point to plane, rms";
    /// Localization: the panel's smooth deviation from the taught one, at most, mm.
    pub const BEND: &str = "smooth deviation from the taught panel, at most";
    /// Localization: residual of the outline, rms, px.
    pub const OUTLINE_RESIDUAL: &str = "residual of the outline, rms";
    /// Localization: the stated error at the panel's worst place, 95 %, mm.
    pub const LOCATION_ERROR: &str = "error at the worst place, 95 %";
    /// By how much the film changes the panel, grey levels.
    pub const FILM_CHANGE: &str = "change of the panel by the film";
    /// The least light of a film against the dry picture's, %.
    pub const LIGHT_MIN: &str = "change of the light, least";
    /// The most light of a film against the dry picture's, %.
    pub const LIGHT_MAX: &str = "change of the light, most";

    /// The smallest area of broken film that is surely found at the panel's place, mm².
    pub const SMALLEST_BREAK: &str = "smallest break that is surely found";
    /// Of a plan: the covered share of its worst grid.
    pub const COVERAGE: &str = "coverage of the worst of them";
    /// Of a plan: its longest dwell beside its shortest, over all grids or in the worst one.
    pub const DWELL_RATIO: &str = "their ratio, all together or the worst grid's";
    /// Of an abrasion: how many times as long as planned a grid was under the disc, at most.
    pub const LONGER: &str = "time under the disc beside its plan, the worst grid's ratio";
    /// Of an abrasion: how far a reported position was off the planned path, at most, mm.
    pub const OFF_PATH: &str = "farthest of them from the planned path";

    const BROKEN_FILM: &str = "broken film in ";

    /// The area of a grid on which the film broke, mm².
    pub fn broken_film(grid: impl std::fmt::Display) -> String {
        format!("{BROKEN_FILM}{grid}")
    }

    /// The grid of a [`broken_film`]; `None` for another name.
    pub fn grid_of_broken_film(name: &str) -> Option<&str> {
        name.strip_prefix(BROKEN_FILM)
    }

    /// After how long a grid failed, s.
    pub fn failed_after(grid: impl std::fmt::Display) -> String {
        format!("{grid} failed after")
    }
}

/// A picture to show.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Picture {
    /// Its short name, `corner_before`.
    pub name: String,
    /// What it shows.
    pub caption: String,
    /// The JPEG's hash in the store.
    pub hash: String,
}

/// What one phase found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Which phase.
    pub kind: Kind,
    /// Abrasions planned by then: 0 before the first.
    pub pass: u8,
    /// The gate's word.
    pub judgement: Judgement,
    /// Every number that led to it, with its limit.
    #[serde(rename = "numbers")]
    pub checks: Vec<Check>,
    /// What is no single number, such as `base_from_panel`, by its name in the commands' JSON.
    pub details: BTreeMap<String, serde_json::Value>,
    /// What was seen, drawn for people.
    pub pictures: Vec<Picture>,
    /// The pictures as the cameras gave them.
    pub shots: Vec<KeptFile>,
}

impl Finding {
    /// A finding without checks and pictures.
    pub fn new(kind: Kind, pass: u8, judgement: Judgement) -> Self {
        let (checks, details) = (Vec::new(), BTreeMap::new());
        Finding { kind, pass, judgement, checks, details, pictures: Vec::new(), shots: Vec::new() }
    }

    /// Adds these checks to the existing ones. A good finding becomes a review if one of these checks violates a
    /// limit and no rule states the consequence.
    pub fn with(mut self, checks: impl IntoIterator<Item = Check>) -> Self {
        let more: Vec<Check> = checks.into_iter().collect();
        self.judgement = self.judgement.beside(&more);
        self.checks.extend(more);
        self
    }

    /// With this detail.
    pub fn detail(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.details.insert(name.to_owned(), value.into());
        self
    }

    /// Returns the names that this detail lists; none if there is no such list.
    pub fn names(&self, detail: &str) -> Vec<String> {
        let value = self.details.get(detail);
        value.and_then(|value| serde_json::from_value(value.clone()).ok()).unwrap_or_default()
    }

    /// The value of the number with this name.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.checks.iter().find(|check| check.name == name)?.value
    }
}

/// A kept file: what it was used for, and its hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptFile {
    /// What it was used for, such as `base_from_camera`.
    pub name: String,
    /// Its hash in the store.
    pub hash: String,
}
