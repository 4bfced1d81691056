//! The gate: what was seen of the film becomes pass, fail or invalid.
//!
//! Invalid where the test does not say enough to judge by: too short, too few pictures, a gap between them, or a grid
//! out of sight. That outranks fail, since a verdict from part of a test would name part of the grids. Fail where film
//! broke on a grid. A break always stays in the reasons.

use crate::cell::Limits;
use crate::panel::GridId;
use crate::recipe::Recipe;
use crate::verdict::{Judgement, Reason, Verdict};

/// Fewer pictures than this share of what the recipe asks for are too few.
const MIN_FRAME_SHARE: f64 = 0.8;
/// Pictures farther apart than this many of the recipe's intervals leave a gap in which a film can break and close.
const MAX_GAP_INTERVALS: f64 = 5.0;

/// What is asked of a test: the recipe's values, or the cell's where the recipe has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demands {
    /// How long the film is watched, s.
    pub observation_s: f64,
    /// Pictures a second.
    pub frames_per_second: f64,
    /// Broken film from which a grid fails, mm².
    pub min_break_mm2: f64,
}

impl Demands {
    /// What a recipe asks for in a cell with these limits.
    pub fn of(recipe: &Recipe, limits: &Limits) -> Self {
        Demands {
            observation_s: recipe.process().observation_s().unwrap_or(limits.observation_s()),
            frames_per_second: recipe.process().frames_per_second(),
            min_break_mm2: recipe.inspect().min_break_mm2().unwrap_or(limits.min_break_mm2()),
        }
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
    /// Was it in the picture? A grid that was not is not passed.
    pub seen: bool,
    /// Broken film, mm².
    pub broken_mm2: f64,
    /// When `min_break_mm2` were broken, s after the first fully wet picture.
    pub time_to_break_s: Option<f64>,
}

/// How the film was watched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// From the first to the last wet picture, s.
    pub observed_s: f64,
    /// Wet pictures, the reference among them.
    pub frames: usize,
    /// The longest time between two of them, s.
    pub longest_gap_s: f64,
    /// Broken film from which a grid fails, mm².
    pub min_break_mm2: f64,
}

/// Judges a test.
pub fn judge(observation: &Observation, grids: &[GridInspection], demands: &Demands) -> Judgement {
    let mut reasons = invalid(observation, grids, demands);
    let invalid = !reasons.is_empty();
    let broken = broken(demands.min_break_mm2, grids);
    let verdict = match (invalid, &broken) {
        (true, _) => Verdict::Invalid,
        (false, Some(_)) => Verdict::Fail,
        (false, None) => Verdict::Pass,
    };
    reasons.extend(broken);
    Judgement { verdict, reasons }
}

fn invalid(observation: &Observation, grids: &[GridInspection], demands: &Demands) -> Vec<Reason> {
    let Observation { observed_s, frames, longest_gap_s, .. } = *observation;
    let window_s = demands.observation_s;
    let mut reasons = Vec::new();
    if observed_s < demands.min_observed_s() {
        let message = format!(
            "the film was watched for {observed_s:.1} s; the recipe's observation_s asks for {window_s:.1} s: \
             repeat the test"
        );
        reasons.push(Reason::new("too_short", message));
    }
    let needed = demands.min_frames();
    if (frames as f64) < needed {
        let message = format!("{frames} wet pictures were taken; needed are {needed}: repeat the test");
        reasons.push(Reason::new("too_few_frames", message));
    }
    let allowed_gap_s = demands.max_gap_s();
    if longest_gap_s > allowed_gap_s {
        let message = format!(
            "two wet pictures lie {longest_gap_s:.2} s apart; allowed are {allowed_gap_s:.2} s: repeat the test"
        );
        reasons.push(Reason::new("gap", message));
    }
    let unseen: Vec<String> = grids.iter().filter(|grid| !grid.seen).map(|grid| grid.id.to_string()).collect();
    if !unseen.is_empty() {
        let message = format!("not wholly in the picture: {}; move the panel into view", unseen.join(", "));
        reasons.push(Reason::new("not_seen", message));
    }
    reasons
}

fn broken(min_break_mm2: f64, grids: &[GridInspection]) -> Option<Reason> {
    let failed: Vec<String> = grids
        .iter()
        .filter(|grid| grid.failed)
        .map(|grid| {
            let when = grid.time_to_break_s.map(|time| format!(" from {time:.1} s")).unwrap_or_default();
            format!("{} ({:.1} mm²{when})", grid.id, grid.broken_mm2)
        })
        .collect();
    let message = format!("the film broke on {}; a grid fails from {min_break_mm2:.1} mm²", failed.join(", "));
    (!failed.is_empty()).then(|| Reason::new("broken", message))
}
