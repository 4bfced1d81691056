//! The water-break test: `[process]`, `[region]` and `[inspect]`.

use panelprep_base::config::{Choice, Section, settings};

settings! {
    /// `[process]`: the water-break test and the abrasion as a process.
    pub struct Process {
        /// Time for which the film is watched after it is fully wet, s; overrides the cell's value.
        observation_s: Option<f64>, 5.0..=600.0, default None;
        /// Pictures per second while the film is watched.
        frames_per_second: f64, 0.5..=30.0, default 5.0;
        /// Largest number of abrasions of one grid in a cycle.
        max_passes_per_grid: usize, 1..=10, default 2;
        /// Largest number of passes in which one part may be abraded, over all cycles that name its serial number;
        /// see [`Process::effective_passes_per_part`].
        max_passes_per_part: Option<usize>, 1..=100, default None;
        /// Time for which the dust is washed off, s.
        rinse_s: f64, 0.5..=120.0, default 10.0;
        /// Time for which the panel is sprayed before the film is watched, s.
        spray_s: f64, 0.5..=120.0, default 5.0;
        /// Time from the end of the water until the cell is drained for the tool, s.
        drain_s: f64, 0.0..=600.0, default 10.0;
        /// Time from switching on the light until it is steady, s.
        light_settle_s: f64, 0.0..=60.0, default 1.0;
        /// The procedure by which the panel is tested, with its edition, such as "ASTM F22-21, PS 4711 rev. C"; if
        /// not stated, ASTM F22 without an edition.
        procedure: Option<String>, (), default None;
        /// The water that is sprayed, as the inspector signs it, such as "deionised, 2 µS/cm"; if not stated, the
        /// page has a line to fill in.
        water: Option<String>, (), default None;
        /// Temperature of the water, °C.
        water_temperature_c: Option<f64>, 0.0..=100.0, default None;
        /// The lamp and its brightness at the panel.
        lamp: Option<String>, (), default None;
    }
}

impl Process {
    /// Returns the largest number of passes in which one part may be abraded, over all cycles that name its serial
    /// number; if the recipe does not state it, twice `max_passes_per_grid`.
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
    /// `[region]`: the area that is inspected and abraded, chosen in the taught scan's picture (thesis 4.4, Fig.
    /// 4.18).
    pub struct Region {
        /// The four corners of the region, px; columns of grids run from the first to the second, rows from the
        /// first to the fourth.
        corners_px: [[f64; 2]; 4], 0.0..=20_000.0, required;
        /// Rows of grids.
        rows: usize, 1..=50, required;
        /// Columns of grids.
        columns: usize, 1..=50, required;
    }
}

pub(in crate::recipe) fn parse_region(section: &Section<'_, '_>) -> Option<Region> {
    let region = Region::parse(section)?;
    let turns: Vec<f64> = (0..4).map(|i| corner_turn(&region.corners_px(), i)).collect();
    if !(turns.iter().all(|turn| *turn > 1.0) || turns.iter().all(|turn| *turn < -1.0)) {
        section.problem(
            "corners_px",
            "the four corners must be in order around a convex region, and no three of them may lie on one line",
        );
        return None;
    }
    Some(region)
}

fn corner_turn(corners_px: &[[f64; 2]; 4], index: usize) -> f64 {
    let [a, b, c] = [corners_px[index], corners_px[(index + 1) % 4], corners_px[(index + 2) % 4]];
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

/// The method of finding a broken film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// A model of each pixel's dry and wet appearance over time.
    Film,
    /// The thesis's pipeline (4.3): subtraction, thresholds, HSV.
    Thesis,
}

impl Choice for Method {
    const KEYWORDS: &'static [(&'static str, Self)] = &[("film", Method::Film), ("thesis", Method::Thesis)];
}

/// The reference with which a film on sanded places is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SandedReference {
    /// The wet appearance of the same place.
    Wet,
    /// A new dry picture, taken after a person has dried the panel and confirmed this.
    Dry,
}

impl Choice for SandedReference {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("wet", SandedReference::Wet), ("dry", SandedReference::Dry)];
}

settings! {
    /// `[inspect]`: how a broken film is found (thesis 4.3, Fig. 4.9).
    pub struct Inspect {
        /// The method.
        method: Method, (), default Method::Film;
        /// The reference for a place that was sanded since the dry picture: the place's own wet appearance, or a
        /// new dry picture. For the new picture, a person dries the panel after each abrasion.
        reference: SandedReference, (), default SandedReference::Wet;
        /// Weights of red, green and blue, used by both methods. A channel in which the film changes the panel
        /// little adds only noise (thesis 4.2).
        channel_weights: [f64; 3], 0.0..=1.0, default [1.0, 1.0, 1.0];
        /// Time for which a place must appear dry before it counts as broken, s. The time of the break is the first
        /// moment at which it appeared dry.
        persist_s: f64, 0.1..=10.0, default 1.2;
        /// Smallest fraction of its dry brightness to which a place returns when its film has broken; it does not
        /// return completely, because it is damp. The smallest break that is surely found is stated for this fraction.
        damp: f64, 0.5..=1.0, default 0.8;
        /// Largest area of a reflection that counts as a glint, mm².
        glint_mm2: f64, 0.0..=500.0, default 40.0;
        /// Largest area within a break that counts as a bead of water, mm².
        bead_mm2: f64, 0.0..=500.0, default 20.0;
        /// Largest part of the region that is not wet in any picture, percent; with a larger part, the test is not
        /// valid.
        max_never_wet_percent: f64, 0.0..=100.0, default 20.0;
        /// Largest change of the light since the dry picture that is compensated, percent. For brighter light, the
        /// limit is at most the change with which a wet place looks half-way to dry; the clip determines this change.
        max_light_change_percent: f64, 1.0..=45.0, default 40.0;
        /// Largest part of the region that glints and overexposure may hide in a picture, percent.
        max_bright_percent: f64, 0.0..=50.0, default 5.0;
        /// Largest motion of the panel in the picture while it is watched, px.
        max_moved_px: f64, 0.1..=20.0, default 1.0;
        /// Places that are not inspected, such as reflections: four corners each, px in the taught scan's picture.
        masked_px: Vec<[[f64; 2]; 4]>, 0.0..=20_000.0, default Vec::new();
        /// Gain α of Eq. 4.2.
        gain: f64, 0.1..=50.0, default 4.0;
        /// Bias β of Eq. 4.2.
        bias: f64, -255.0..=255.0, default 0.0;
        /// Width of the median blur, px, odd. With 5 px or more, it is several times slower and removes small
        /// breaks.
        median_px: usize, 3..=31, default 3;
        /// Number of times that the median blur is applied.
        median_passes: usize, 1..=5, default 2;
        /// Smallest adjusted difference of a changed pixel: about half of the difference between dry and wet, so
        /// that a break's edge is found at its true place. 52 is for 26 grey levels, dark composite.
        threshold: usize, 1..=255, default 52;
        /// Lower bounds of a dry pixel: hue 0…179, saturation and value 0…255 as OpenCV scales them. The defaults
        /// exclude nothing, because with too narrow a range a broken film would pass.
        hsv_min: [usize; 3], 0..=255, default [0, 0, 0];
        /// Upper bounds of a dry pixel.
        hsv_max: [usize; 3], 0..=255, default [179, 255, 255];
        /// Area of broken film from which a grid fails, mm²; overrides the cell's value.
        min_break_mm2: Option<f64>, 0.1..=10_000.0, default None;
        /// Number of successive pictures that must show a break before the thesis's pipeline counts it.
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
