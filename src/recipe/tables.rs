//! The tables of a recipe: every key with its range, default and meaning.

use crate::config::{Choice, Section, Setting, settings};
use toml::de::DeValue;

settings! {
    /// `[process]`: the water-break test and the abrasion as a process.
    pub struct Process {
        /// How long the film is watched after it is fully wet, s; overrides the cell's.
        observation_s: Option<f64>, 5.0..=600.0, default None;
        /// Pictures a second while the film is watched.
        frames_per_second: f64, 0.5..=30.0, default 5.0;
        /// How often one grid may be abraded in a cycle.
        max_passes_per_grid: usize, 1..=10, default 2;
        /// How long the dust is washed off, s.
        rinse_s: f64, 0.5..=120.0, default 10.0;
        /// How long the panel is sprayed before the film is watched, s.
        spray_s: f64, 0.5..=120.0, default 5.0;
        /// From water off to a cell that is drained for the tool, s.
        drain_s: f64, 0.0..=600.0, default 10.0;
        /// From light on to steady light, s.
        light_settle_s: f64, 0.0..=60.0, default 1.0;
        /// The water that is sprayed, as the inspector signs it, such as "deionised, 2 µS/cm"; unstated, a line to fill in.
        water: Option<String>, (), default None;
        /// Its temperature, °C.
        water_temperature_c: Option<f64>, 0.0..=100.0, default None;
        /// The lamp and its brightness at the panel.
        lamp: Option<String>, (), default None;
    }
}

settings! {
    /// `[locate]`: where the panel is searched, and what is accepted (thesis 3.8).
    pub struct Locate {
        /// Lower corner of the search box in the base frame, mm.
        box_min_mm: [f64; 3], -5_000.0..=5_000.0, required;
        /// Upper corner of the search box in the base frame, mm.
        box_max_mm: [f64; 3], -5_000.0..=5_000.0, required;
        /// Largest shift of the panel's centre from its nominal place, mm.
        max_shift_mm: f64, 0.0..=1_000.0, default 60.0;
        /// Largest turn in the panel's plane, degrees.
        turn_limit_deg: f64, 0.0..=180.0, default 15.0;
        /// Largest tilt of the panel's normal, degrees.
        max_tilt_deg: f64, 0.0..=45.0, default 15.0;
        /// Largest root mean square of the point-to-plane residuals, mm.
        max_rms_mm: f64, 0.001..=5.0, default 0.25;
        /// Smallest share of taught points found in the scan, and of the scan's panel found among them, 0…1; a fifth of
        /// the panel may be hidden.
        min_overlap: f64, 0.0..=1.0, default 0.75;
    }
}

pub(super) fn take_locate(section: &Section<'_, '_>) -> Option<Locate> {
    let locate = Locate::take(section)?;
    let (low, high) = (locate.box_min_mm(), locate.box_max_mm());
    if (0..3).any(|axis| low[axis] >= high[axis]) {
        section.problem("box_max_mm", format!("{high:?} must exceed box_min_mm {low:?} in every axis"));
        return None;
    }
    Some(locate)
}

/// Which corner of the panel, as the flange camera sees it at the taught pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CornerName {
    /// Up and to the left.
    TopLeft,
    /// Up and to the right.
    TopRight,
    /// Down and to the right.
    BottomRight,
    /// Down and to the left.
    BottomLeft,
}

impl Choice for CornerName {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("top-left", CornerName::TopLeft),
        ("top-right", CornerName::TopRight),
        ("bottom-right", CornerName::BottomRight),
        ("bottom-left", CornerName::BottomLeft),
    ];
}

/// Which corner each of the taught pictures shows: one word for all of them, or a list in the order of teaching.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CornerNames(Vec<CornerName>);

impl CornerNames {
    /// The corner of a taught picture, counted from 0; pictures beyond the list show the last one named.
    pub fn of(&self, picture: usize) -> CornerName {
        self.0.get(picture).or(self.0.last()).copied().unwrap_or(CornerName::TopLeft)
    }
}

impl From<CornerName> for CornerNames {
    fn from(name: CornerName) -> CornerNames {
        CornerNames(vec![name])
    }
}

impl Setting for CornerNames {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let Some(list) = value.as_array() else { return CornerName::parse(value, &()).map(CornerNames::from) };
        if list.is_empty() {
            return Err("found an empty list, allowed is a corner for each taught picture".to_owned());
        }
        list.iter().map(|item| CornerName::parse(item.get_ref(), &())).collect::<Result<_, _>>().map(CornerNames)
    }
}

settings! {
    /// `[corner]`: how the corner picture is read (thesis 3.9, Fig. 3.17).
    pub struct Corner {
        /// Which corner of the panel each taught picture shows.
        which: CornerNames, (), default CornerName::TopLeft.into();
        /// Neighbourhood of the bilateral filter, px.
        bilateral_diameter_px: usize, 3..=31, default 9;
        /// How far two brightnesses may differ and still be averaged.
        bilateral_sigma_gray: f64, 1.0..=255.0, default 40.0;
        /// Darkest brightness that is panel.
        panel_gray_min: usize, 0..=255, default 0;
        /// Brightest brightness that is panel.
        panel_gray_max: usize, 0..=255, default 110;
        /// Length of edge beside the corner that is left out, for its rounding, mm.
        rounding_mm: f64, 0.0..=100.0, default 8.0;
        /// Length of each edge that is fitted, mm.
        edge_mm: f64, 2.0..=200.0, default 25.0;
        /// Largest correction in the camera's plane, mm.
        max_correction_mm: f64, 0.1..=50.0, default 8.0;
        /// A picture that asks for less than this is the last one, mm.
        settled_mm: f64, 0.05..=5.0, default 0.3;
        /// Moves after the first picture, at most.
        max_moves: usize, 0..=10, default 3;
        /// Farthest that the corner may stand from where the localization puts it just before contact, mm.
        verify_mm: f64, 0.05..=5.0, default 0.2;
    }
}

pub(super) fn take_corner(section: &Section<'_, '_>) -> Option<Corner> {
    let corner = Corner::take(section)?;
    if corner.panel_gray_min() >= corner.panel_gray_max() {
        section.problem("panel_gray_max", format!("must exceed panel_gray_min, {}", corner.panel_gray_min()));
        return None;
    }
    Some(corner)
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

pub(super) fn take_region(section: &Section<'_, '_>) -> Option<Region> {
    let region = Region::take(section)?;
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

settings! {
    /// `[inspect]`: how a broken film is seen (thesis 4.3, Fig. 4.9).
    pub struct Inspect {
        /// The method.
        method: Method, (), default Method::Film;
        /// What red, green and blue count: both methods weigh the channels by it. A channel in which the film changes
        /// the panel little adds noise alone (thesis 4.2).
        channel_weights: [f64; 3], 0.0..=1.0, default [1.0, 1.0, 1.0];
        /// How long a place must be seen dry before it counts as broken, s. It broke when it was first seen so.
        persist_s: f64, 0.1..=10.0, default 1.2;
        /// Share of the region that may be wet in no picture, percent; more is no test.
        max_never_wet_percent: f64, 0.0..=100.0, default 20.0;
        /// Change of the light since the dry picture that is made up for, percent; of more light at most what brings a wet
        /// place half-way to dry, which the clip tells.
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
        /// Smallest adjusted difference of a changed pixel: about half of that between dry and wet, so that a break's
        /// edge is found where it is. 52 is for 26 grey levels, dark composite.
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

pub(super) fn take_inspect(section: &Section<'_, '_>) -> Option<Inspect> {
    let inspect = Inspect::take(section)?;
    if inspect.channel_weights().iter().all(|weight| *weight < 0.01) {
        section.problem("channel_weights", "one channel at least must weigh 0.01 or more");
        return None;
    }
    if inspect.median_px() % 2 == 0 {
        section.problem("median_px", format!("found {}, allowed is an odd number", inspect.median_px()));
        return None;
    }
    for (key, [hue, ..]) in [("hsv_min", inspect.hsv_min()), ("hsv_max", inspect.hsv_max())] {
        if hue > 179 {
            section.problem(key, format!("found hue {hue}, allowed is 0 to 179: half of its degrees"));
            return None;
        }
    }
    if (0..3).any(|channel| inspect.hsv_min()[channel] > inspect.hsv_max()[channel]) {
        section.problem("hsv_max", "must not be below hsv_min in any channel");
        return None;
    }
    Some(inspect)
}

/// How control points are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitMethod {
    /// The surface that deviates least from the scan.
    LeastSquares,
    /// The thesis's own way (4.5): points of the scan are the control points.
    Thesis,
}

impl Choice for FitMethod {
    const WORDS: &'static [(&'static str, Self)] =
        &[("least-squares", FitMethod::LeastSquares), ("thesis", FitMethod::Thesis)];
}

settings! {
    /// `[surface]`: how the B-spline surface is fitted (thesis 4.5).
    pub struct Surface {
        /// How control points are found.
        method: FitMethod, (), default FitMethod::LeastSquares;
        /// Distance between control points, mm.
        control_spacing_mm: f64, 5.0..=200.0, default 25.0;
        /// Largest root mean square of the fit's residuals, mm.
        max_rms_mm: f64, 0.001..=5.0, default 0.2;
        /// Largest share of the region's pixels without a point, percent.
        max_missing_percent: f64, 0.0..=50.0, default 10.0;
        /// Side of the largest square without a point, mm.
        max_hole_mm: f64, 1.0..=200.0, default 12.0;
    }
}

/// How the lines lie in a region that is abraded (thesis Fig. 4.26).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// Rows, there and back.
    Raster,
    /// Rows, and then rows across them.
    CrossHatch,
    /// Turns that go inwards all the time.
    Spiral,
    /// Closed contours, one inside the other.
    Offset,
    /// Contours, the end of each leading into the next one.
    OffsetSpiral,
}

impl Choice for Pattern {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("raster", Pattern::Raster),
        ("cross-hatch", Pattern::CrossHatch),
        ("spiral", Pattern::Spiral),
        ("offset", Pattern::Offset),
        ("offset-spiral", Pattern::OffsetSpiral),
    ];
}

settings! {
    /// `[path]`: how the tool moves (thesis 4.6–4.8).
    pub struct Path {
        /// How the lines lie.
        pattern: Pattern, (), default Pattern::Raster;
        /// Direction of the rows, degrees from the region's columns' direction towards its rows'.
        feed_angle_deg: f64, -90.0..=90.0, default 0.0;
        /// Are neighbouring grids abraded as one, or each by itself?
        join_grids: bool, (), default true;
        /// Diameter of the disc's contact, mm.
        disc_diameter_mm: f64, 2.0..=300.0, default 30.0;
        /// Largest distance between neighbouring rows, on the surface, mm.
        step_over_mm: f64, 0.5..=200.0, default 12.0;
        /// Largest distance between waypoints along a row, mm.
        waypoint_spacing_mm: f64, 1.0..=100.0, default 10.0;
        /// How far the straight way between two waypoints may lie off the surface, mm; waypoints come closer where the
        /// panel bends more.
        chord_error_mm: f64, 0.005..=5.0, default 0.1;
        /// What the controller needs to plan one line, ms; where waypoints are closer, the feed is lower.
        planning_time_ms: f64, 1.0..=500.0, default 60.0;
        /// Rounding at a waypoint, as a share of the shorter line beside it. The controller takes at most a half.
        blend_share: f64, 0.0..=0.5, default 0.2;
        /// How far the disc may reach beyond the panel's outline, mm.
        edge_overhang_mm: f64, 0.0..=100.0, default 2.0;
        /// Feed along the surface, mm/s.
        feed_mm_s: f64, 1.0..=500.0, default 60.0;
        /// Acceleration of the tool's point from and to a stop, mm/s².
        acceleration_mm_s2: f64, 50.0..=10_000.0, default 1_000.0;
        /// Height of approach and retract above the surface, mm.
        approach_mm: f64, 5.0..=300.0, default 40.0;
        /// Way along the surface on which the tool comes down to it and leaves it, moving, mm; 0 goes straight down.
        landing_mm: f64, 0.0..=100.0, default 15.0;
        /// Height above the surface at which that way begins, mm.
        landing_height_mm: f64, 0.5..=50.0, default 3.0;
        /// The tool is lifted where a hole holds a square of this side, mm; smaller ones it passes over.
        lift_hole_mm: f64, 1.0..=200.0, default 10.0;
        /// How far the tool's point goes into the panel along the normal: the compression of its pad, mm.
        press_in_mm: f64, 0.0..=50.0, default 0.0;
        /// What the pad can be compressed, mm; a press-in needs it stated.
        pad_stroke_mm: Option<f64>, 0.5..=100.0, default None;
        /// Lean of the tool along its spin axis X, degrees.
        lead_deg: f64, -20.0..=20.0, default 0.0;
        /// Lean of the tool across that axis, degrees.
        tilt_deg: f64, -20.0..=20.0, default 0.0;
        /// Reference of the tool's spin, a direction in the panel's frame; [0, 0, 0] takes each grid's feed axis.
        reference_axis: [f64; 3], -1.0..=1.0, default [0.0, 0.0, 0.0];
        /// Is the tool round, so that its spin may be turned for the arm's reach?
        round_tool: bool, (), default true;
        /// Contact area that one disc lasts for, mm² of panel; unstated, discs are not counted.
        disc_life_mm2: Option<f64>, 100.0..=10_000_000.0, default None;
    }
}

pub(super) fn take_path(section: &Section<'_, '_>) -> Option<Path> {
    let path = Path::take(section)?;
    if path.step_over_mm() > path.disc_diameter_mm() {
        section.problem(
            "step_over_mm",
            format!(
                "found {}, allowed is at most disc_diameter_mm, {}: wider rows leave stripes",
                path.step_over_mm(),
                path.disc_diameter_mm()
            ),
        );
        return None;
    }
    match path.pad_stroke_mm() {
        Some(stroke_mm) if path.press_in_mm() > stroke_mm => {
            let message = format!("found {}, allowed is at most pad_stroke_mm, {stroke_mm}", path.press_in_mm());
            section.problem("press_in_mm", message);
            return None;
        }
        None if path.press_in_mm() > 0.0 => {
            section.problem("pad_stroke_mm", "is missing; a press_in_mm needs the stroke of the pad that takes it");
            return None;
        }
        _ => {}
    }
    if path.landing_height_mm() > path.approach_mm() {
        let message =
            format!("found {}, allowed is at most approach_mm, {}", path.landing_height_mm(), path.approach_mm());
        section.problem("landing_height_mm", message);
        return None;
    }
    // A direction need not have length 1, but one this short is a slip of the pen. √3 is the longest.
    let length = nalgebra::Vector3::from(path.reference_axis()).norm();
    if length > 0.0 && length < 0.1 {
        section.problem(
            "reference_axis",
            format!("found a direction of length {length}, allowed is 0.1 to 1.8, or [0, 0, 0]"),
        );
        return None;
    }
    Some(path)
}
