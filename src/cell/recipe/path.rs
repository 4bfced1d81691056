//! How the panel is abraded: the surface and the tool's path over it (`[surface]` and `[path]`), what is abraded after
//! a film broke (`[treat]`), and the required removal (`[removal]`).

use panelprep_base::config::{Choice, Section, settings};
use panelprep_base::number_text::shortest_text;

/// The method of finding the control points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitMethod {
    /// The surface with the least deviation from the scan.
    LeastSquares,
    /// The thesis's method (4.5): points of the scan are the control points.
    Thesis,
}

impl Choice for FitMethod {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("least-squares", FitMethod::LeastSquares), ("thesis", FitMethod::Thesis)];
}

settings! {
    /// `[surface]`: how the B-spline surface is fitted (thesis 4.5).
    pub struct Surface {
        /// The method of finding the control points.
        method: FitMethod, (), default FitMethod::LeastSquares;
        /// Distance between control points, mm.
        control_spacing_mm: f64, 5.0..=200.0, default 25.0;
        /// Largest root mean square of the fit's residuals, mm.
        max_rms_mm: f64, 0.001..=5.0, default 0.2;
        /// Largest part of the region's pixels without a point, percent.
        max_missing_percent: f64, 0.0..=50.0, default 10.0;
        /// Side of the largest allowed square without a point, mm.
        max_hole_mm: f64, 1.0..=200.0, default 12.0;
        /// Largest distance of today's panel from the taught panel, mm; beyond it a person decides.
        max_deviation_mm: f64, 0.05..=20.0, default 2.0;
        /// Largest profile of the surface over the region, twice the largest deviation, mm; if it is not proven, a
        /// person decides. If not stated, the profile is reported only.
        max_profile_mm: Option<f64>, 0.05..=40.0, default None;
        /// Largest flatness of the region, minimum zone, mm; if it is not proven, a person decides. If not stated, the
        /// flatness of a flat panel is reported only.
        max_flatness_mm: Option<f64>, 0.02..=40.0, default None;
    }
}

/// The arrangement of the lines in a region that is abraded (thesis Fig. 4.26).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// Parallel rows, in alternating directions.
    Raster,
    /// Rows, followed by rows across them.
    CrossHatch,
    /// Turns that lead continuously inwards.
    Spiral,
    /// Closed contours, one inside the other.
    Offset,
    /// Contours, each of which ends at the start of the next one.
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
        /// The arrangement of the lines.
        pattern: Pattern, (), default Pattern::Raster;
        /// Direction of the rows, degrees, measured from the direction of the region's columns towards the
        /// direction of its rows.
        feed_angle_deg: f64, -90.0..=90.0, default 0.0;
        /// Whether neighbouring grids are abraded together or each separately.
        join_grids: bool, (), default true;
        /// Diameter of the disc's contact area, mm.
        disc_diameter_mm: f64, 2.0..=300.0, default 30.0;
        /// Largest distance between neighbouring rows, on the surface, mm.
        step_over_mm: f64, 0.5..=200.0, default 12.0;
        /// Largest distance between waypoints along a row, mm.
        waypoint_spacing_mm: f64, 1.0..=100.0, default 10.0;
        /// Largest distance of the straight line between two waypoints from the surface, mm; waypoints are closer if
        /// the panel bends more.
        chord_error_mm: f64, 0.005..=5.0, default 0.1;
        /// Time that the controller needs to plan one line, ms; if waypoints are closer, the feed is lower.
        planning_time_ms: f64, 1.0..=500.0, default 60.0;
        /// Rounding at a waypoint, as a fraction of the shorter adjacent line. The controller accepts at most a half.
        blend_share: f64, 0.0..=0.5, default 0.2;
        /// Largest distance that the disc may reach beyond the panel's outline, mm.
        edge_overhang_mm: f64, 0.0..=100.0, default 2.0;
        /// Largest ratio of the longest to the shortest time under the disc (95 % to 5 % of the treated area), for
        /// each grid and for all grids together.
        max_dwell_ratio: f64, 1.1..=20.0, default 2.0;
        /// Highest feed along the surface, mm/s; it is lower at places that would be under the disc for less time.
        feed_mm_s: f64, 1.0..=500.0, default 60.0;
        /// Acceleration of the tool centre point when starting and stopping, mm/s².
        acceleration_mm_s2: f64, 50.0..=10_000.0, default 1_000.0;
        /// Height of approach and retract above the surface, mm.
        approach_mm: f64, 5.0..=300.0, default 40.0;
        /// Length along the surface over which the tool lands on the surface, and over which it retracts, while
        /// moving, mm; with 0 it moves straight down and up.
        landing_mm: f64, 0.0..=100.0, default 15.0;
        /// Height above the surface at which the landing begins, mm.
        landing_height_mm: f64, 0.5..=50.0, default 3.0;
        /// The tool is lifted over a hole that contains a square of this side, mm; it passes over smaller holes.
        lift_hole_mm: f64, 1.0..=200.0, default 10.0;
        /// Depth of the commanded tool tip below the panel's surface, along the normal, mm: the compression of its pad.
        press_in_mm: f64, 0.0..=50.0, default 0.0;
        /// Largest compression of the pad, mm; required if `press_in_mm` is used.
        pad_stroke_mm: Option<f64>, 0.5..=100.0, default None;
        /// Force with which a compliant tool presses, N; required for a compliant tool, not allowed for any other
        /// tool.
        force_n: Option<f64>, 1.0..=500.0, default None;
        /// Force with which a compliant tool lands and retracts, N; a third of force_n if not stated.
        landing_force_n: Option<f64>, 0.5..=500.0, default None;
        /// Time of the change between `landing_force_n` and `force_n`, s.
        force_ramp_s: f64, 0.0..=2.0, default 0.2;
        /// Tilt of the tool along its spin axis X, degrees.
        lead_deg: f64, -20.0..=20.0, default 0.0;
        /// Tilt of the tool across its spin axis X, degrees.
        tilt_deg: f64, -20.0..=20.0, default 0.0;
        /// Reference of the tool's spin, a direction in the panel's frame; [0, 0, 0] selects each grid's feed axis.
        reference_axis: [f64; 3], -1.0..=1.0, default [0.0, 0.0, 0.0];
        /// Whether the tool is round, so that its spin may be changed for the arm's reach.
        round_tool: bool, (), default true;
        /// Area of the panel that one disc can treat, mm²; if not stated, discs are not counted.
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
    // The direction need not have length 1, but such a short vector is an input error. √3 is the longest possible.
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
    /// Returns the force with which a compliant tool lands and retracts, N; `None` if no force is stated.
    pub fn landing_n(&self) -> Option<f64> {
        Some(self.landing_force_n().unwrap_or(self.force_n()? / 3.0))
    }
}

/// Checks that the keys of a compliant tool's force are consistent.
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

/// The places that are abraded after a grid failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TreatBy {
    /// The whole grid.
    Grid,
    /// The breaks of the grid, widened.
    Break,
}

impl Choice for TreatBy {
    const KEYWORDS: &'static [(&'static str, Self)] = &[("grid", TreatBy::Grid), ("break", TreatBy::Break)];
}

settings! {
    /// `[treat]`: the places that are abraded after a grid failed.
    pub struct Treat {
        /// What is abraded: whole grids, or areas around the breaks.
        by: TreatBy, (), default TreatBy::Grid;
        /// Distance by which a break is widened on the surface, mm; only with `by = "break"`, see
        /// [`Treat::widened_mm`].
        margin_mm: Option<f64>, 1.0..=200.0, default None;
        /// Uncertainty of a break's outline on the panel, 95 %, mm: of the panel's pose in the film, of the break's
        /// blurred rim, and of the tool. The program's own margin for pose and tool is 1.5 mm (`path::touching`), and
        /// the rim is blurred by half a millimetre.
        uncertainty_mm: f64, 0.5..=20.0, default 2.0;
    }
}

impl Treat {
    /// Returns the distance by which breaks are widened, mm; if the recipe does not state it, the least allowed one.
    pub fn widened_mm(&self, path: &Path) -> f64 {
        self.margin_mm().unwrap_or_else(|| self.least_mm(path))
    }

    /// Returns the least margin, mm: the disc's radius and the uncertainty of the outline.
    fn least_mm(&self, path: &Path) -> f64 {
        path.disc_diameter_mm() / 2.0 + self.uncertainty_mm()
    }
}

/// Reads the table. If `[path]` has problems, `path` is `None` here, and the margin is not compared with the disc.
pub(in crate::recipe) fn parse_treat(section: &Section<'_, '_>, path: Option<&Path>) -> Option<Treat> {
    let treat = Treat::parse(section)?;
    if treat.by() == TreatBy::Grid {
        let lonely: Vec<&str> =
            ["margin_mm", "uncertainty_mm"].into_iter().filter(|key| section.has_key(key)).collect();
        lonely.iter().for_each(|key| section.problem(key, "has no effect without by = \"break\""));
        return lonely.is_empty().then_some(treat);
    }
    let Some(path) = path else { return Some(treat) };
    let (found_mm, least_mm) = (treat.widened_mm(path), treat.least_mm(path));
    if found_mm < least_mm {
        let [found, least] = [found_mm, least_mm].map(shortest_text);
        let message = format!(
            "found {found} (at least {least}: half of path.disc_diameter_mm, and uncertainty_mm): a break at the area's \
             border would be under the disc for too short a time"
        );
        section.problem("margin_mm", message);
        return None;
    }
    Some(treat)
}

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
