//! The water-break test: `[process]`, `[region]` and `[inspect]`.

use panelprep_base::config::{Choice, Section, settings};

settings! {
    /// `[process]`: parameters of the water-break test and of the sanding passes.
    pub struct Process {
        /// Time for which the film is observed after the panel is fully wet, s; overrides the cell's value.
        observation_s: Option<f64>, 5.0..=600.0, default None;
        /// Pictures per second while the film is observed.
        frames_per_second: f64, 0.5..=30.0, default 5.0;
        /// Maximum number of sanding passes on one grid in a cycle.
        max_passes_per_grid: usize, 1..=10, default 2;
        /// Maximum number of sanding passes on one part, over all cycles with its serial number; see
        /// [`Process::effective_passes_per_part`].
        max_passes_per_part: Option<usize>, 1..=100, default None;
        /// Time for which the dust is rinsed off, s.
        rinse_s: f64, 0.5..=120.0, default 10.0;
        /// Time for which the panel is sprayed before the film is observed, s.
        spray_s: f64, 0.5..=120.0, default 5.0;
        /// Time from switching the water off until the tool may start, s.
        drain_s: f64, 0.0..=600.0, default 10.0;
        /// Time from switching the light on until its brightness is stable, s.
        light_settle_s: f64, 0.0..=60.0, default 1.0;
        /// The test procedure with its edition, such as "ASTM F22-21, PS 4711 rev. C"; if not stated, ASTM F22 without
        /// an edition.
        procedure: Option<String>, (), default None;
        /// The water for the spray, as printed on the page that the inspector signs, such as "deionised, 2 µS/cm"; if
        /// not stated, the page has a line to fill in.
        water: Option<String>, (), default None;
        /// Temperature of the water, °C.
        water_temperature_c: Option<f64>, 0.0..=100.0, default None;
        /// The lamp, and its illuminance at the panel.
        lamp: Option<String>, (), default None;
    }
}

impl Process {
    /// Returns the maximum number of sanding passes on one part, over all cycles with its serial number. If the recipe
    /// does not state it, it is twice `max_passes_per_grid`.
    pub fn effective_passes_per_part(&self) -> usize {
        self.max_passes_per_part().unwrap_or(2 * self.max_passes_per_grid())
    }
}

pub(in crate::recipe) fn parse_process(section: &Section<'_, '_>) -> Option<Process> {
    let process = Process::parse(section)?;
    let (part, grid) = (process.effective_passes_per_part(), process.max_passes_per_grid());
    if part < grid {
        let allowed = format!("found {part}, must be at least max_passes_per_grid, {grid}");
        section.problem("max_passes_per_part", allowed);
        return None;
    }
    Some(process)
}

settings! {
    /// `[region]`: the area that is inspected and sanded, selected in the taught picture (thesis 4.4, Fig. 4.18).
    pub struct Region {
        /// The four corners of the region, px. Columns of grids run from the first corner to the second, rows from the
        /// first corner to the fourth.
        corners_px: [[f64; 2]; 4], 0.0..=20_000.0, required;
        /// Number of rows of grids.
        rows: usize, 1..=50, required;
        /// Number of columns of grids.
        columns: usize, 1..=50, required;
    }
}

pub(in crate::recipe) fn parse_region(section: &Section<'_, '_>) -> Option<Region> {
    let region = Region::parse(section)?;
    let turns: Vec<f64> = (0..4).map(|i| corner_cross_product(&region.corners_px(), i)).collect();
    if !(turns.iter().all(|turn| *turn > 1.0) || turns.iter().all(|turn| *turn < -1.0)) {
        section.problem(
            "corners_px",
            "the four corners must be in order around a convex region, and no three of them may lie on one line",
        );
        return None;
    }
    Some(region)
}

fn corner_cross_product(corners_px: &[[f64; 2]; 4], index: usize) -> f64 {
    let [a, b, c] = [corners_px[index], corners_px[(index + 1) % 4], corners_px[(index + 2) % 4]];
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

/// The method that detects a broken film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// A model of the dry and wet appearance of each pixel over time.
    Film,
    /// The thesis's pipeline (4.3): subtraction, thresholds, HSV.
    Thesis,
}

impl Choice for Method {
    const KEYWORDS: &'static [(&'static str, Self)] = &[("film", Method::Film), ("thesis", Method::Thesis)];
}

/// The reference for the film on sanded places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SandedReference {
    /// The wet appearance of the same place.
    Wet,
    /// A new dry picture, captured after a person has dried the panel and confirmed that it is dry.
    Dry,
}

impl Choice for SandedReference {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("wet", SandedReference::Wet), ("dry", SandedReference::Dry)];
}

settings! {
    /// `[inspect]`: parameters of the detection of a broken film (thesis 4.3, Fig. 4.9).
    pub struct Inspect {
        /// The method that detects a broken film.
        method: Method, (), default Method::Film;
        /// The reference for places that were sanded after the dry picture: the wet appearance of the same place, or a
        /// new dry picture, for which a person dries the panel after each sanding pass.
        reference: SandedReference, (), default SandedReference::Wet;
        /// Weights of red, green and blue, used by both methods. A channel in which the film hardly changes the panel's
        /// appearance adds only noise (thesis 4.2).
        channel_weights: [f64; 3], 0.0..=1.0, default [1.0, 1.0, 1.0];
        /// Minimum time for which a place must appear dry to be detected as broken, s. The time of the break is the
        /// first moment at which it appeared dry.
        persist_s: f64, 0.1..=10.0, default 1.2;
        /// Minimum fraction of the dry brightness that a place has after its film has broken. It is below 1, because
        /// the place is still damp. The size of the smallest break that is reliably detected is stated for this
        /// fraction.
        damp: f64, 0.5..=1.0, default 0.8;
        /// Maximum area of a reflection that is treated as a glint, mm².
        glint_mm2: f64, 0.0..=500.0, default 40.0;
        /// Maximum area within a break that is treated as a bead of water, mm².
        bead_mm2: f64, 0.0..=500.0, default 20.0;
        /// Maximum part of the region that is not wet in any picture, percent; with a larger part, the test is invalid.
        max_never_wet_percent: f64, 0.0..=100.0, default 20.0;
        /// Maximum change of the illumination since the dry picture that is compensated, percent. For an increase, the
        /// limit is also at most the change that makes a wet place appear half dry, which is determined from the clip.
        max_light_change_percent: f64, 1.0..=45.0, default 40.0;
        /// Maximum part of the region that glints and overexposure may hide in a picture, percent.
        max_bright_percent: f64, 0.0..=50.0, default 5.0;
        /// Maximum motion of the panel in the picture during the observation, px.
        max_moved_px: f64, 0.1..=20.0, default 1.0;
        /// Areas that are excluded from the inspection, such as reflections: four corners each, px in the taught
        /// picture.
        masked_px: Vec<[[f64; 2]; 4]>, 0.0..=20_000.0, default Vec::new();
        /// Gain α of Eq. 4.2.
        gain: f64, 0.1..=50.0, default 4.0;
        /// Bias β of Eq. 4.2.
        bias: f64, -255.0..=255.0, default 0.0;
        /// Width of the median filter, px, odd. With 5 px or more, the filter is several times slower and removes small
        /// breaks.
        median_px: usize, 3..=31, default 3;
        /// Number of times that the median filter is applied.
        median_passes: usize, 1..=5, default 2;
        /// Minimum adjusted difference of a changed pixel: about half of the difference between dry and wet, so that
        /// the edge of a break is detected at its true position. 52 is for a difference of 26 grey levels on a dark
        /// composite.
        threshold: usize, 1..=255, default 52;
        /// Lower bounds of a dry pixel: hue 0…179, saturation and value 0…255, as scaled by OpenCV. The defaults
        /// exclude nothing, because with too narrow a range a broken film would pass.
        hsv_min: [usize; 3], 0..=255, default [0, 0, 0];
        /// Upper bounds of a dry pixel.
        hsv_max: [usize; 3], 0..=255, default [179, 255, 255];
        /// Minimum area of broken film at which a grid fails, mm²; overrides the cell's value.
        min_break_mm2: Option<f64>, 0.1..=10_000.0, default None;
        /// Number of consecutive pictures that must show a break before the thesis's method detects it.
        persist_frames: usize, 1..=100, default 2;
    }
}

pub(in crate::recipe) fn parse_inspect(section: &Section<'_, '_>) -> Option<Inspect> {
    let inspect = Inspect::parse(section)?;
    if inspect.channel_weights().iter().all(|weight| *weight < 0.01) {
        section.problem("channel_weights", "at least one channel must have a weight of 0.01 or more");
        return None;
    }
    if inspect.median_px() % 2 == 0 {
        section.problem("median_px", format!("found {}, valid: an odd number", inspect.median_px()));
        return None;
    }
    for (key, [hue, ..]) in [("hsv_min", inspect.hsv_min()), ("hsv_max", inspect.hsv_max())] {
        if hue > 179 {
            section.problem(key, format!("found hue {hue}, valid: 0 to 179 (half of the hue angle in degrees)"));
            return None;
        }
    }
    if (0..3).any(|channel| inspect.hsv_min()[channel] > inspect.hsv_max()[channel]) {
        section.problem("hsv_max", "must not be below hsv_min in any channel");
        return None;
    }
    Some(inspect)
}
