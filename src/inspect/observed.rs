//! What the gate judges: the demands of a test, how its film was watched, and what became of each grid.

use super::model::FILM_ASSUMED;
use super::quality::{Quality, most_brighter_percent};
use crate::cell::Limits;
use crate::panel::GridId;
use crate::recipe::{self, Recipe};
use crate::verdict::SetBy;

/// Fewer pictures than this share of what the recipe asks for are too few.
const MIN_FRAME_SHARE: f64 = 0.8;
/// Pictures farther apart than this many of the recipe's intervals leave a gap in which a film can break and close.
const MAX_GAP_INTERVALS: f64 = 5.0;
/// Which of the demands the cell's file states, since the recipe does not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ByCell {
    /// How long the film is watched.
    pub observation: bool,
    /// Broken film from which a grid fails.
    pub min_break: bool,
}

/// The requirements of a test: the recipe's values, or the cell's where the recipe has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demands {
    /// How long the film is watched, s.
    pub observation_s: f64,
    /// Pictures a second.
    pub frames_per_second: f64,
    /// Broken film from which a grid fails, mm².
    pub min_break_mm2: f64,
    /// How long a place must be seen dry to count as broken, s.
    pub persist_s: f64,
    /// Who states them.
    pub by_cell: ByCell,
}

impl Demands {
    /// What a recipe asks for in a cell with these limits.
    pub fn of(recipe: &Recipe, limits: &Limits) -> Self {
        Demands {
            observation_s: recipe.process().observation_s().unwrap_or(limits.observation_s()),
            frames_per_second: recipe.process().frames_per_second(),
            min_break_mm2: recipe.inspect().min_break_mm2().unwrap_or(limits.min_break_mm2()),
            persist_s: recipe.inspect().persist_s(),
            by_cell: ByCell {
                observation: recipe.process().observation_s().is_none(),
                min_break: recipe.inspect().min_break_mm2().is_none(),
            },
        }
    }

    /// How long to film, s: what breaks at the end of the window must be seen dry long enough to count.
    pub fn filmed_s(&self) -> f64 {
        self.observation_s + self.persist_s
    }

    pub(super) fn window_set_by(&self) -> SetBy {
        match self.by_cell.observation {
            true => SetBy::cell("limits.observation_s"),
            false => SetBy::recipe("process.observation_s"),
        }
    }

    pub(super) fn min_break_set_by(&self) -> SetBy {
        match self.by_cell.min_break {
            true => SetBy::cell("limits.min_break_mm2"),
            false => SetBy::recipe("inspect.min_break_mm2"),
        }
    }

    /// Pictures that must show a place dry.
    pub fn persist_frames(&self) -> u8 {
        // With this number of pictures, the second is compared with the first.
        (self.persist_s * self.frames_per_second).round().clamp(2.0, 250.0) as u8
    }

    /// The shortest time from the first to the last wet picture, s: the last one of a window may come one interval
    /// before its end.
    pub fn min_observed_s(&self) -> f64 {
        self.observation_s - 1.001 / self.frames_per_second
    }

    /// The fewest wet pictures.
    pub fn min_frames(&self) -> f64 {
        (MIN_FRAME_SHARE * self.observation_s * self.frames_per_second).ceil()
    }

    /// The least number of wet pictures that must be usable.
    pub fn min_usable(&self, frames: usize) -> f64 {
        (MIN_FRAME_SHARE * frames as f64).ceil()
    }

    /// The longest time between two wet pictures, s.
    pub fn max_gap_s(&self) -> f64 {
        MAX_GAP_INTERVALS / self.frames_per_second
    }
}

/// What the test says of one grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridInspection {
    /// Its name.
    pub id: GridId,
    /// Did at least `min_break_mm2` of film break on it?
    pub failed: bool,
    /// Was it wholly seen, but for what is too small to make it fail? A grid that was not is not passed.
    pub seen: bool,
    /// Is all of it that was not seen what the recipe masks?
    pub only_masked: bool,
    /// Do film and dry panel look so alike on so much of it that a break there would fail the grid?
    pub no_contrast: bool,
    /// Was enough of it wet already in the dry picture that a break there would fail the grid?
    pub wet_when_dry: bool,
    /// Broken film, mm².
    pub broken_mm2: f64,
    /// When `min_break_mm2` were broken, s after the first fully wet picture.
    pub time_to_break_s: Option<f64>,
}

/// How the film was watched.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// From the first to the last wet picture, s.
    pub observed_s: f64,
    /// Wet pictures, the reference among them.
    pub frames: usize,
    /// The longest time between two of them, s.
    pub longest_gap_s: f64,
    /// Broken film from which a grid fails, mm².
    pub min_break_mm2: f64,
    /// Was a dry picture taken?
    pub has_dry: bool,
    /// Share of the region's surface that was wet in no picture, percent.
    pub never_wet_percent: f64,
    /// What the film leaves of the panel's dry brightness, 0…1, where the clip determined it.
    pub film_left: Option<f64>,
    /// The region's mean brightness when dry, grey levels.
    pub dry_levels: f64,
    /// The smallest break that is surely found, mm².
    pub detection_limit_mm2: f64,
    /// Did nobody say where the panel stands?
    pub is_place_assumed: bool,
    /// Which pictures could be judged by.
    pub quality: Quality,
}

impl Observation {
    /// By how much the film changes the panel, grey levels.
    pub fn change_levels(&self) -> f64 {
        self.dry_levels * (1.0 - self.film_left.unwrap_or(FILM_ASSUMED))
    }

    /// How much less light and how much more than the dry picture's is made up for, percent.
    pub fn light_limits_percent(&self, settings: &recipe::Inspect) -> [f64; 2] {
        let brighter = most_brighter_percent(self.film_left.unwrap_or(FILM_ASSUMED), settings);
        [settings.max_light_change_percent(), brighter]
    }
}
