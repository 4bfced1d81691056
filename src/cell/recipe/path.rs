//! How the panel is sanded: the surface and the tool's path (`[surface]` and `[path]`), the areas that are sanded after
//! a film has broken (`[treat]`), and the required removal (`[removal]`).

use panelprep_base::config::{Choice, Section, settings};
use panelprep_base::number_text::shortest_text;

/// The method that determines the control points of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitMethod {
    /// Least squares: the surface with the smallest deviation from the scan.
    LeastSquares,
    /// The thesis's method (4.5): points of the scan are used as control points.
    Thesis,
}

impl Choice for FitMethod {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("least-squares", FitMethod::LeastSquares), ("thesis", FitMethod::Thesis)];
}

settings! {
    /// `[surface]`: how the B-spline surface is fitted (thesis 4.5).
    pub struct Surface {
        /// The method that determines the control points.
        method: FitMethod, (), default FitMethod::LeastSquares;
        /// Distance between control points, mm.
        control_spacing_mm: f64, 5.0..=200.0, default 25.0;
        /// Maximum root mean square of the fit's residuals, mm.
        max_rms_mm: f64, 0.001..=5.0, default 0.2;
        /// Maximum part of the region's pixels without a point, percent.
        max_missing_percent: f64, 0.0..=50.0, default 10.0;
        /// Maximum side of a square without a point, mm.
        max_hole_mm: f64, 1.0..=200.0, default 12.0;
        /// Maximum distance between the present panel and the taught panel, mm; with a larger distance, a person
        /// decides.
        max_deviation_mm: f64, 0.05..=20.0, default 2.0;
        /// Maximum profile of the surface over the region, twice the largest deviation, mm; if conformance is not
        /// proven, a person decides. If not stated, the profile is only reported.
        max_profile_mm: Option<f64>, 0.05..=40.0, default None;
        /// Maximum flatness of the region, minimum zone, mm; if conformance is not proven, a person decides. If not
        /// stated, the flatness of a flat panel is only reported.
        max_flatness_mm: Option<f64>, 0.02..=40.0, default None;
    }
}

/// The pattern of the lines in an area that is sanded (thesis Fig. 4.26).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// Parallel rows, in alternating directions.
    Raster,
    /// Parallel rows, followed by rows perpendicular to them.
    CrossHatch,
    /// A continuous spiral inwards.
    Spiral,
    /// Closed contours, one inside the other.
    Offset,
    /// Contours that are connected to one continuous line.
    OffsetSpiral,
}

impl Choice for Pattern {
    const KEYWORDS: &'static [(&'static str, Self)] = &[
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
        /// The pattern of the lines.
        pattern: Pattern, (), default Pattern::Raster;
        /// Direction of the rows, degrees, from the direction of the region's columns towards the direction of its
        /// rows.
        feed_angle_deg: f64, -90.0..=90.0, default 0.0;
        /// Whether adjacent grids are sanded together instead of each separately.
        join_grids: bool, (), default true;
        /// Diameter of the disc's contact area, mm.
        disc_diameter_mm: f64, 2.0..=300.0, default 30.0;
        /// Maximum distance between adjacent rows, on the surface, mm.
        step_over_mm: f64, 0.5..=200.0, default 12.0;
        /// Maximum distance between waypoints along a row, mm.
        waypoint_spacing_mm: f64, 1.0..=100.0, default 10.0;
        /// Maximum distance between the surface and the straight line between two waypoints, mm; on a strongly curved
        /// panel, the waypoints are closer.
        chord_error_mm: f64, 0.005..=5.0, default 0.1;
        /// Time that the controller needs to plan one line, ms; if waypoints are close to each other, the feed is
        /// reduced accordingly.
        planning_time_ms: f64, 1.0..=500.0, default 60.0;
        /// Rounding at a waypoint, as a fraction of the shorter adjacent line. The maximum of the controller is 0.5.
        blend_share: f64, 0.0..=0.5, default 0.2;
        /// Maximum distance by which the disc may extend beyond the panel's outline, mm.
        edge_overhang_mm: f64, 0.0..=100.0, default 2.0;
        /// Maximum ratio of the longest to the shortest dwell time (95 % to 5 % of the sanded area), for each grid and
        /// for all grids together.
        max_dwell_ratio: f64, 1.1..=20.0, default 2.0;
        /// Maximum feed along the surface, mm/s; the feed is lower at places whose dwell time would be too short.
        feed_mm_s: f64, 1.0..=500.0, default 60.0;
        /// Acceleration of the tool centre point when starting and stopping, mm/s².
        acceleration_mm_s2: f64, 50.0..=10_000.0, default 1_000.0;
        /// Height of approach and retract above the surface, mm.
        approach_mm: f64, 5.0..=300.0, default 40.0;
        /// Length along the surface over which the tool lands on the surface, or lifts off, while it moves, mm; with 0,
        /// the tool moves straight down and up.
        landing_mm: f64, 0.0..=100.0, default 15.0;
        /// Height above the surface at which the landing begins, mm.
        landing_height_mm: f64, 0.5..=50.0, default 3.0;
        /// Minimum side of a square inside a hole at which the tool is lifted over the hole, mm; it passes over smaller
        /// holes.
        lift_hole_mm: f64, 1.0..=200.0, default 10.0;
        /// Depth of the commanded tool tip below the panel's surface, along the normal, mm: the compression of the pad.
        press_in_mm: f64, 0.0..=50.0, default 0.0;
        /// Maximum compression of the pad, mm; required if `press_in_mm` is used.
        pad_stroke_mm: Option<f64>, 0.5..=100.0, default None;
        /// Force with which a compliant tool presses, N; required for a compliant tool, invalid for any other tool.
        force_n: Option<f64>, 1.0..=500.0, default None;
        /// Force with which a compliant tool lands and lifts off, N; default: a third of `force_n`.
        landing_force_n: Option<f64>, 0.5..=500.0, default None;
        /// Duration of the change between `landing_force_n` and `force_n`, s.
        force_ramp_s: f64, 0.0..=2.0, default 0.2;
        /// Tilt of the tool in the direction of its X axis, degrees.
        lead_deg: f64, -20.0..=20.0, default 0.0;
        /// Tilt of the tool perpendicular to its X axis, degrees.
        tilt_deg: f64, -20.0..=20.0, default 0.0;
        /// Reference direction for the rotation of the tool about its axis, in the panel's frame; [0, 0, 0] selects the
        /// feed direction of each grid.
        reference_axis: [f64; 3], -1.0..=1.0, default [0.0, 0.0, 0.0];
        /// Whether the tool is round, so that it may be rotated about its axis to improve the arm's reach.
        round_tool: bool, (), default true;
        /// Area of the panel that one disc can sand, mm²; if not stated, the area per disc is not limited.
        disc_life_mm2: Option<f64>, 100.0..=10_000_000.0, default None;
    }
}

pub(in crate::recipe) fn parse_path(section: &Section<'_, '_>) -> Option<Path> {
    let path = Path::parse(section)?;
    if path.step_over_mm() > path.disc_diameter_mm() {
        section.problem(
            "step_over_mm",
            format!(
                "found {} (limit {}, disc_diameter_mm): a larger distance leaves untreated stripes",
                path.step_over_mm(),
                path.disc_diameter_mm()
            ),
        );
        return None;
    }
    match path.pad_stroke_mm() {
        Some(stroke_mm) if path.press_in_mm() > stroke_mm => {
            let message = format!("found {} (limit {stroke_mm}, pad_stroke_mm)", path.press_in_mm());
            section.problem("press_in_mm", message);
            return None;
        }
        None if path.press_in_mm() > 0.0 => {
            section
                .problem("pad_stroke_mm", "is missing; press_in_mm requires the stroke of the pad that absorbs it");
            return None;
        }
        _ => {}
    }
    if !check_force_keys(section, &path) {
        return None;
    }
    if path.landing_height_mm() > path.approach_mm() {
        let message = format!("found {} (limit {}, approach_mm)", path.landing_height_mm(), path.approach_mm());
        section.problem("landing_height_mm", message);
        return None;
    }
    // The direction need not have length 1, but a very short vector is an input error. The longest possible vector has
    // the length √3.
    let length = nalgebra::Vector3::from(path.reference_axis()).norm();
    if length > 0.0 && length < 0.1 {
        section.problem(
            "reference_axis",
            format!("found a direction of length {length}, valid: 0.1 to 1.8, or [0, 0, 0]"),
        );
        return None;
    }
    Some(path)
}

impl Path {
    /// Returns the force with which a compliant tool lands and lifts off, N; `None` if the recipe states no force.
    pub fn landing_n(&self) -> Option<f64> {
        Some(self.landing_force_n().unwrap_or(self.force_n()? / 3.0))
    }
}

/// Checks that the keys for the force of a compliant tool are consistent.
fn check_force_keys(section: &Section<'_, '_>, path: &Path) -> bool {
    let Some(force_n) = path.force_n() else {
        let lonely: Vec<&str> =
            ["landing_force_n", "force_ramp_s"].into_iter().filter(|key| section.has_key(key)).collect();
        lonely.iter().for_each(|key| section.problem(key, "has no effect without force_n"));
        return lonely.is_empty();
    };
    match path.landing_force_n().filter(|landing_n| *landing_n > force_n) {
        Some(landing_n) => {
            section.problem("landing_force_n", format!("found {landing_n} (limit {force_n}, force_n)"));
            false
        }
        None => true,
    }
}

/// The areas that are sanded after a grid has failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TreatBy {
    /// The whole grid that has failed.
    Grid,
    /// Areas around the breaks of the grid.
    Break,
}

impl Choice for TreatBy {
    const KEYWORDS: &'static [(&'static str, Self)] = &[("grid", TreatBy::Grid), ("break", TreatBy::Break)];
}

settings! {
    /// `[treat]`: the areas that are sanded after a grid has failed.
    pub struct Treat {
        /// Whether whole grids are sanded, or areas around the breaks.
        by: TreatBy, (), default TreatBy::Grid;
        /// Margin around a break on the surface, mm; only with `by = "break"`, see [`Treat::widened_mm`].
        margin_mm: Option<f64>, 1.0..=200.0, default None;
        /// Uncertainty of a break's outline on the panel, 95 %, mm: from the panel's pose during the film, the blurred
        /// edge of the break, and the tool. The program's own margin for pose and tool is 1.5 mm (`path::touching`);
        /// the edge is blurred by half a millimetre.
        uncertainty_mm: f64, 0.5..=20.0, default 2.0;
    }
}

impl Treat {
    /// Returns the margin around a break, mm; if the recipe does not state it, the minimum margin.
    pub fn widened_mm(&self, path: &Path) -> f64 {
        self.margin_mm().unwrap_or_else(|| self.min_margin_mm(path))
    }

    /// Returns the minimum margin, mm: the disc's radius plus the uncertainty of the outline.
    fn min_margin_mm(&self, path: &Path) -> f64 {
        path.disc_diameter_mm() / 2.0 + self.uncertainty_mm()
    }
}

/// Parses `[treat]`. If `[path]` has problems, `path` is `None`, and the margin is not compared with the disc.
pub(in crate::recipe) fn parse_treat(section: &Section<'_, '_>, path: Option<&Path>) -> Option<Treat> {
    let treat = Treat::parse(section)?;
    if treat.by() == TreatBy::Grid {
        let lonely: Vec<&str> =
            ["margin_mm", "uncertainty_mm"].into_iter().filter(|key| section.has_key(key)).collect();
        lonely.iter().for_each(|key| section.problem(key, "has no effect without by = \"break\""));
        return lonely.is_empty().then_some(treat);
    }
    let Some(path) = path else { return Some(treat) };
    let (found_mm, min_mm) = (treat.widened_mm(path), treat.min_margin_mm(path));
    if found_mm < min_mm {
        let [found, least] = [found_mm, min_mm].map(shortest_text);
        let message = format!(
            "found {found} (at least {least}: half of path.disc_diameter_mm, and uncertainty_mm): a break at the area's \
             border would be under the disc for too short a time"
        );
        section.problem("margin_mm", message);
        return None;
    }
    Some(treat)
}

/// The method that determines the feed from the required removal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RemovalMethod {
    /// The feed is chosen for a uniform dwell time; the resulting removal is only reported.
    Constant,
    /// The feed on each line is computed so that the removal is uniform and reaches the target.
    Scheduled,
}

impl Choice for RemovalMethod {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("constant", RemovalMethod::Constant), ("scheduled", RemovalMethod::Scheduled)];
}

settings! {
    /// `[removal]`: the required removal and its upper limit.
    pub struct Removal {
        /// The method that determines the feed from the required removal.
        method: RemovalMethod, (), default RemovalMethod::Constant;
        /// Depth to remove, µm.
        target_um: f64, 0.1..=5_000.0, required;
        /// Maximum removed depth at any place, µm, for example the thickness of the coating or of the first ply. It is
        /// compared with the 95 % bound of the removal over all passes.
        max_um: f64, 0.1..=10_000.0, required;
        /// Maximum deviation from the target in 95 % of the sanded area, percent of the target.
        even_percent: f64, 1.0..=100.0, default 20.0;
        /// Force of the tool on the panel, N, if the tool is a spring. The force of a compliant tool is in `[path]`.
        force_n: Option<f64>, 0.5..=500.0, default None;
        /// Uncertainty of this force, 95 %, percent of the force.
        force_error_percent: f64, 0.0..=50.0, default 10.0;
        /// Minimum feed of a computed schedule, mm/s; the maximum is that of the path.
        min_feed_mm_s: f64, 0.5..=500.0, default 5.0;
    }
}

/// Parses `[removal]`. The outer `None` is a problem in the file, the inner `None` means that the table is absent. If
/// `[path]` has problems, `path` is `None`, and the keys that depend on it are not checked.
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
