//! The data for the acceptance checks: the requirements of a test, how its film was observed, and the result of each
//! grid.

use super::model::ASSUMED_FILM_TRANSMISSION;
use super::quality::{Quality, max_brighter_percent};
use panelprep_base::verdict::LimitSource;
use panelprep_cell::cell::Limits;
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe::{self, Recipe};

/// Minimum fraction of the duration of the film that usable pictures must cover.
const MIN_USABLE_FRACTION: f64 = 0.8;
/// Maximum time between two pictures, in intervals of the recipe; a longer time is a gap, unless `persist_s` is even
/// longer.
const MAX_GAP_INTERVALS: f64 = 5.0;

/// States which requirements come from the cell's file, because the recipe does not state them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CellDemands {
    /// Whether the cell's file states the duration of the observation.
    pub observation: bool,
    /// Whether the cell's file states the area of broken film from which a grid fails.
    pub min_break: bool,
}

/// The requirements of a test: the values of the recipe, or of the cell's file if the recipe states none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demands {
    /// Duration of the observation of the film, s.
    pub observation_s: f64,
    /// Number of pictures per second.
    pub frames_per_second: f64,
    /// Minimum area of broken film with which a grid fails, mm².
    pub min_break_mm2: f64,
    /// Minimum time for which a broken place appears dry, s.
    pub persist_s: f64,
    /// Which of these requirements come from the cell's file.
    pub cell_demands: CellDemands,
}

impl Demands {
    /// Creates the requirements of a recipe in a cell with these limits.
    pub fn from_recipe(recipe: &Recipe, limits: &Limits) -> Self {
        Demands {
            observation_s: recipe.process().observation_s().unwrap_or(limits.observation_s()),
            frames_per_second: recipe.process().frames_per_second(),
            min_break_mm2: recipe.inspect().min_break_mm2().unwrap_or(limits.min_break_mm2()),
            persist_s: recipe.inspect().persist_s(),
            cell_demands: CellDemands {
                observation: recipe.process().observation_s().is_none(),
                min_break: recipe.inspect().min_break_mm2().is_none(),
            },
        }
    }

    /// Returns the time for which the film must be recorded, s: a break at the end of the observation must still be
    /// visible for `persist_s`.
    pub fn filmed_s(&self) -> f64 {
        self.observation_s + self.persist_s
    }

    pub(super) fn observation_time_set_by(&self) -> LimitSource {
        match self.cell_demands.observation {
            true => LimitSource::cell("limits.observation_s"),
            false => LimitSource::recipe("process.observation_s"),
        }
    }

    pub(super) fn min_break_set_by(&self) -> LimitSource {
        match self.cell_demands.min_break {
            true => LimitSource::cell("limits.min_break_mm2"),
            false => LimitSource::recipe("inspect.min_break_mm2"),
        }
    }

    /// Returns the minimum time from the first to the last wet picture, s: the last picture may be captured one
    /// interval before the end of the observation.
    pub fn min_observed_s(&self) -> f64 {
        self.observation_s - picture_interval_s(self.frames_per_second)
    }

    /// Returns the minimum time that usable pictures of the film must cover, s.
    pub fn min_usable_s(&self, observed_s: f64) -> f64 {
        MIN_USABLE_FRACTION * observed_s
    }

    /// Returns the maximum time between two wet pictures, s: a longer gap could hide a break.
    pub fn max_gap_s(&self) -> f64 {
        (MAX_GAP_INTERVALS / self.frames_per_second).max(self.persist_s)
    }
}

/// Returns the interval between two pictures, s: the time from the first to the last picture may be shorter than the
/// observation by this value.
pub fn picture_interval_s(frames_per_second: f64) -> f64 {
    1.001 / frames_per_second
}

/// The reference with which the pixels of a grid were compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComparisonReference {
    /// Dry appearance and wet appearance of each pixel.
    DryAndWet,
    /// Only the wet appearance of each pixel: the grid was sanded since the dry picture, or there is no dry picture.
    Wet,
    /// Dry and wet appearance for a part of the grid, only wet appearance for the rest.
    Both,
}

impl ComparisonReference {
    /// Selects the reference from the fraction of a grid that was sanded since the dry picture.
    pub(super) fn from_sanded_share(share: f64) -> Self {
        match share {
            0.0 => ComparisonReference::DryAndWet,
            share if share < 1.0 => ComparisonReference::Both,
            _ => ComparisonReference::Wet,
        }
    }

    /// Returns the description of the reference, as text for a person.
    pub fn describe(self) -> &'static str {
        match self {
            ComparisonReference::DryAndWet => "dry and wet look",
            ComparisonReference::Wet => "wet look alone, sanded since the dry picture",
            ComparisonReference::Both => "wet look alone where it was sanded since the dry picture",
        }
    }
}

/// The result of the test for one grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridInspection {
    /// Name of the grid.
    pub id: GridId,
    /// The reference with which the pixels of the grid were compared.
    pub reference: ComparisonReference,
    /// Whether at least `min_break_mm2` of film broke on the grid.
    pub failed: bool,
    /// Whether the grid was seen completely, except for areas too small to make it fail. A grid that was not seen
    /// completely does not pass.
    pub seen: bool,
    /// Whether every unseen part is masked by the recipe.
    pub only_masked: bool,
    /// Whether film and dry panel have the same appearance on an area so large that a break there would fail the grid.
    pub no_contrast: bool,
    /// Whether an area so large that a break there would fail the grid was already wet in the dry picture.
    pub wet_when_dry: bool,
    /// Area of broken film, mm².
    pub broken_mm2: f64,
    /// Time at which the broken area reached `min_break_mm2`, s after the first fully wet picture.
    pub time_to_break_s: Option<f64>,
}

/// Evidence of how the film was observed.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Time from the first to the last wet picture, s.
    pub observed_s: f64,
    /// Number of wet pictures, including the reference picture.
    pub frames: usize,
    /// Longest time between two wet pictures, s.
    pub longest_gap_s: f64,
    /// Minimum area of broken film with which a grid fails, mm².
    pub min_break_mm2: f64,
    /// Whether a dry picture was captured.
    pub has_dry: bool,
    /// Percentage of the surface of the region that was wet in no picture.
    pub never_wet_percent: f64,
    /// Ratio of the brightness under the film to the dry brightness, 0…1, if the clip determined it.
    pub film_left: Option<f64>,
    /// Change of brightness by the film, grey levels: the median over the region, if the clip determined it.
    pub change_levels: Option<f64>,
    /// Noise of the clip: the standard deviation of a pixel of the film from picture to picture, grey levels.
    pub noise_levels: f64,
    /// Area of the smallest break that is reliably detected, mm².
    pub detection_limit_mm2: f64,
    /// Whether the pose of the panel is assumed, because none was stated.
    pub is_place_assumed: bool,
    /// The quality of the pictures.
    pub quality: Quality,
}

impl Observation {
    /// Returns the maximum decrease and the maximum increase of the light that can be compensated, relative to the dry
    /// picture, percent.
    pub fn light_limits_percent(&self, settings: &recipe::Inspect) -> [f64; 2] {
        let brighter = max_brighter_percent(self.film_left.unwrap_or(ASSUMED_FILM_TRANSMISSION), settings);
        [settings.max_light_change_percent(), brighter]
    }
}
