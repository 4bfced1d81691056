//! The water-break test: `[process]`, `[region]` and `[inspect]`.

use crate::config::{Choice, Section, settings};

settings! {
    /// `[process]`: the water-break test and the abrasion as a process.
    pub struct Process {
        /// How long the film is watched after it is fully wet, s; overrides the cell's.
        observation_s: Option<f64>, 5.0..=600.0, default None;
        /// Pictures a second while the film is watched.
        frames_per_second: f64, 0.5..=30.0, default 5.0;
        /// How often one grid may be abraded in a cycle.
        max_passes_per_grid: usize, 1..=10, default 2;
        /// In how many passes one part may be abraded, over all cycles that name its serial number; see
        /// [`Process::passes_of_a_part`].
        max_passes_per_part: Option<usize>, 1..=100, default None;
        /// How long the dust is washed off, s.
        rinse_s: f64, 0.5..=120.0, default 10.0;
        /// How long the panel is sprayed before the film is watched, s.
        spray_s: f64, 0.5..=120.0, default 5.0;
        /// From water off to a cell that is drained for the tool, s.
        drain_s: f64, 0.0..=600.0, default 10.0;
        /// From light on to steady light, s.
        light_settle_s: f64, 0.0..=60.0, default 1.0;
        /// The procedure by which the panel is tested, with its edition, such as "ASTM F22-21, PS 4711 rev. C";
        /// unstated, ASTM F22 without an edition.
        procedure: Option<String>, (), default None;
        /// The water that is sprayed, as the inspector signs it, such as "deionised, 2 µS/cm"; unstated, a line to fill in.
        water: Option<String>, (), default None;
        /// Its temperature, °C.
        water_temperature_c: Option<f64>, 0.0..=100.0, default None;
        /// The lamp and its brightness at the panel.
        lamp: Option<String>, (), default None;
    }
}

impl Process {
    /// Number of passes in which one part may be abraded, over all cycles that name its serial number; if the
    /// recipe does not state it, twice `max_passes_per_grid`.
    pub fn passes_of_a_part(&self) -> usize {
        self.max_passes_per_part().unwrap_or(2 * self.max_passes_per_grid())
    }
}

pub(in crate::recipe) fn parse_process(section: &Section<'_, '_>) -> Option<Process> {
    let process = Process::parse(section)?;
    let (part, grid) = (process.passes_of_a_part(), process.max_passes_per_grid());
    if part < grid {
        let allowed = format!("found {part}, valid: max_passes_per_grid, {grid}, or more");
        section.problem("max_passes_per_part", allowed);
        return None;
    }
    Some(process)
}

settings! {
    /// `[region]`: what is inspected and abraded, chosen in the taught scan's picture (thesis 4.4, Fig. 4.18).
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
    let turns: Vec<f64> = (0..4).map(|i| turn_at(&region.corners_px(), i)).collect();
    if !(turns.iter().all(|turn| *turn > 1.0) || turns.iter().all(|turn| *turn < -1.0)) {
        section.problem("corners_px", "the four corners must go round a convex region in order, none on a line");
        return None;
    }
    Some(region)
}

fn turn_at(corners_px: &[[f64; 2]; 4], index: usize) -> f64 {
    let [a, b, c] = [corners_px[index], corners_px[(index + 1) % 4], corners_px[(index + 2) % 4]];
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

/// How a broken film is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// A model of what each pixel looks like dry and wet, over time.
    Film,
    /// The thesis's pipeline (4.3): subtraction, thresholds, HSV.
    Thesis,
}

impl Choice for Method {
    const WORDS: &'static [(&'static str, Self)] = &[("film", Method::Film), ("thesis", Method::Thesis)];
}

/// What a film on sanded places is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SandedReference {
    /// The place's own wet look.
    Wet,
    /// A new dry picture, taken when a person has dried the panel and confirmed it.
    Dry,
}

impl Choice for SandedReference {
    const WORDS: &'static [(&'static str, Self)] = &[("wet", SandedReference::Wet), ("dry", SandedReference::Dry)];
}

settings! {
    /// `[inspect]`: how a broken film is seen (thesis 4.3, Fig. 4.9).
    pub struct Inspect {
        /// The method.
        method: Method, (), default Method::Film;
        /// What a place is held against that was sanded since the dry picture: its own wet look, or a new dry
        /// picture for which a person dries the panel after each abrasion.
        reference: SandedReference, (), default SandedReference::Wet;
        /// What red, green and blue count: both methods weigh the channels by it. A channel in which the film changes
        /// the panel little adds noise alone (thesis 4.2).
        channel_weights: [f64; 3], 0.0..=1.0, default [1.0, 1.0, 1.0];
        /// How long a place must be seen dry before it counts as broken, s. It broke when it was first seen so.
        persist_s: f64, 0.1..=10.0, default 1.2;
        /// Share of its dry brightness that a place at least regains when its film has broken; the rest is damp.
        /// The smallest break that is surely found is stated for this share.
        damp: f64, 0.5..=1.0, default 0.8;
        /// The largest reflection that is taken for a glint, mm².
        glint_mm2: f64, 0.0..=500.0, default 40.0;
        /// The largest place within a break that is taken for a bead of water on it, mm².
        bead_mm2: f64, 0.0..=500.0, default 20.0;
        /// Share of the region that may be wet in no picture, percent; more is no test.
        max_never_wet_percent: f64, 0.0..=100.0, default 20.0;
        /// Change of the light since the dry picture that is made up for, percent; of more light at most what brings a wet
        /// place half-way to dry, which the clip determines.
        max_light_change_percent: f64, 1.0..=45.0, default 40.0;
        /// Share of the region that glints and overexposure may hide in a picture, percent.
        max_bright_percent: f64, 0.0..=50.0, default 5.0;
        /// How far the panel may move in the picture while it is watched, px.
        max_moved_px: f64, 0.1..=20.0, default 1.0;
        /// Reflections and the like that are not looked at: four corners each, px in the taught scan's picture.
        masked_px: Vec<[[f64; 2]; 4]>, 0.0..=20_000.0, default Vec::new();
        /// Gain α of Eq. 4.2.
        gain: f64, 0.1..=50.0, default 4.0;
        /// Bias β of Eq. 4.2.
        bias: f64, -255.0..=255.0, default 0.0;
        /// Width of the median blur, px, odd. Of 5 px or more it is several times slower and rounds small breaks away.
        median_px: usize, 3..=31, default 3;
        /// How often the median blur is applied.
        median_passes: usize, 1..=5, default 2;
        /// Smallest adjusted difference of a changed pixel: about half of the difference between dry and wet, so
        /// that a break's edge is found at its true place. 52 is for 26 grey levels, dark composite.
        threshold: usize, 1..=255, default 52;
        /// Lower bounds of a dry pixel: hue 0…179, saturation and value 0…255 as OpenCV scales them. The defaults rule
        /// nothing out, since a range that is too narrow passes a broken film.
        hsv_min: [usize; 3], 0..=255, default [0, 0, 0];
        /// Upper bounds of a dry pixel.
        hsv_max: [usize; 3], 0..=255, default [179, 255, 255];
        /// Broken film from which a grid fails, mm²; overrides the cell's.
        min_break_mm2: Option<f64>, 0.1..=10_000.0, default None;
        /// Pictures in a row that must show a break before the thesis's pipeline counts it.
        persist_frames: usize, 1..=100, default 2;
    }
}

pub(in crate::recipe) fn parse_inspect(section: &Section<'_, '_>) -> Option<Inspect> {
    let inspect = Inspect::parse(section)?;
    if inspect.channel_weights().iter().all(|weight| *weight < 0.01) {
        section.problem("channel_weights", "one channel at least must weigh 0.01 or more");
        return None;
    }
    if inspect.median_px() % 2 == 0 {
        section.problem("median_px", format!("found {}, valid: an odd number", inspect.median_px()));
        return None;
    }
    for (key, [hue, ..]) in [("hsv_min", inspect.hsv_min()), ("hsv_max", inspect.hsv_max())] {
        if hue > 179 {
            section.problem(key, format!("found hue {hue}, the limits are 0 to 179: half of its degrees"));
            return None;
        }
    }
    if (0..3).any(|channel| inspect.hsv_min()[channel] > inspect.hsv_max()[channel]) {
        section.problem("hsv_max", "must not be below hsv_min in any channel");
        return None;
    }
    Some(inspect)
}
