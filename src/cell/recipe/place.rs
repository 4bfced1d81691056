//! The panel and its pose: `[panel]` with the panel's name and the drawn parts of its outline, `[locate]`, `[corner]`,
//! and `[nominal]`.
//!
//! With `[nominal]`, the panel is taught from its drawing. The table states the pose of the drawing's frame when the
//! panel is at its nominal place, either directly or by datum points.

use panelprep_base::config::{Choice, Section, Setting, settings};
use panelprep_base::geometry::{Base, Drawing, KukaPose, Pixel, Point, Rigid, fit_rigid_motion, polygon};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals, list};
use toml::de::DeValue;

/// The method that refines the pose found by the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Registration {
    /// Point-to-plane registration that also uses the outline.
    PointToPlane,
    /// The thesis's point-to-point ICP, for comparison.
    Thesis,
}

impl Choice for Registration {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("point-to-plane", Registration::PointToPlane), ("thesis", Registration::Thesis)];
}

settings! {
    /// `[locate]`: the search box for the panel, and the acceptance limits (thesis 3.8).
    pub struct Locate {
        /// The method that refines the pose. The thesis's method does not state its error; its difference from the
        /// result of the other method is used as the error.
        method: Registration, (), default Registration::PointToPlane;
        /// Lower corner of the search box in the base frame, mm.
        box_min_mm: [f64; 3], -5_000.0..=5_000.0, required;
        /// Upper corner of the search box in the base frame, mm.
        box_max_mm: [f64; 3], -5_000.0..=5_000.0, required;
        /// Maximum shift of the panel's centre from its nominal position, mm.
        max_shift_mm: f64, 0.0..=1_000.0, default 60.0;
        /// Maximum rotation in the panel's plane, degrees.
        turn_limit_deg: f64, 0.0..=180.0, default 15.0;
        /// Maximum tilt of the panel's normal, degrees.
        max_tilt_deg: f64, 0.0..=45.0, default 15.0;
        /// Maximum root mean square of the point-to-plane residuals, mm.
        max_rms_mm: f64, 0.001..=5.0, default 0.25;
        /// Minimum fraction of the taught points that are found in the scan, and of the panel's points in the scan that
        /// are found among the taught points, 0…1; a fifth of the panel may be hidden.
        min_overlap: f64, 0.0..=1.0, default 0.75;
    }
}

pub(in crate::recipe) fn parse_locate(section: &Section<'_, '_>) -> Option<Locate> {
    let locate = Locate::parse(section)?;
    let (low, high) = (locate.box_min_mm(), locate.box_max_mm());
    if (0..3).any(|axis| low[axis] >= high[axis]) {
        section
            .problem("box_max_mm", format!("{} must exceed box_min_mm {} in every axis", list(&high), list(&low)));
        return None;
    }
    Some(locate)
}

/// A corner of the panel, named by its position in the picture of the flange camera at the taught pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CornerName {
    /// The upper left corner.
    TopLeft,
    /// The upper right corner.
    TopRight,
    /// The lower right corner.
    BottomRight,
    /// The lower left corner.
    BottomLeft,
}

impl Choice for CornerName {
    const KEYWORDS: &'static [(&'static str, Self)] = &[
        ("top-left", CornerName::TopLeft),
        ("top-right", CornerName::TopRight),
        ("bottom-right", CornerName::BottomRight),
        ("bottom-left", CornerName::BottomLeft),
    ];
}

/// The corner in each taught corner picture: one keyword for all pictures, or a list in the order of teaching.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CornerNames(Vec<CornerName>);

impl CornerNames {
    /// Returns the corner in a taught corner picture, counted from 0. If the list is too short, its last corner is
    /// used.
    pub fn for_picture(&self, picture: usize) -> CornerName {
        self.0.get(picture).or(self.0.last()).copied().unwrap_or(CornerName::TopLeft)
    }

    /// Returns the keywords as written in a recipe, in the order of teaching.
    pub fn keywords(&self) -> Vec<&'static str> {
        let word =
            |name: &CornerName| CornerName::KEYWORDS.iter().find(|(_, known)| known == name).map(|(word, _)| *word);
        self.0.iter().filter_map(word).collect()
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
            return Err("found an empty list; valid: one corner for each taught picture".to_owned());
        }
        list.iter().map(|item| CornerName::parse(item.get_ref(), &())).collect::<Result<_, _>>().map(CornerNames)
    }
}

settings! {
    /// `[corner]`: parameters for the evaluation of the corner picture (thesis 3.9, Fig. 3.17).
    pub struct Corner {
        /// The corner of the panel in each taught corner picture.
        which: CornerNames, (), default CornerName::TopLeft.into();
        /// Diameter of the bilateral filter's neighbourhood, px.
        bilateral_diameter_px: usize, 3..=31, default 9;
        /// Standard deviation of the bilateral filter in brightness, grey levels.
        bilateral_sigma_gray: f64, 1.0..=255.0, default 40.0;
        /// Minimum brightness of the panel, grey levels.
        panel_gray_min: usize, 0..=255, default 0;
        /// Maximum brightness of the panel, grey levels.
        panel_gray_max: usize, 0..=255, default 110;
        /// Length of each edge that is excluded beside the corner because of its rounding, mm.
        rounding_mm: f64, 0.0..=100.0, default 8.0;
        /// Length of each edge to which a line is fitted, mm.
        edge_mm: f64, 2.0..=200.0, default 25.0;
        /// Maximum correction in the camera's plane, mm.
        max_correction_mm: f64, 0.1..=50.0, default 8.0;
        /// Maximum correction at which no further picture is captured, mm.
        settled_mm: f64, 0.05..=5.0, default 0.3;
        /// Maximum number of motions after the first picture.
        max_moves: usize, 0..=10, default 3;
        /// Maximum distance between the corner and its localized position immediately before contact, mm.
        verify_mm: f64, 0.05..=5.0, default 0.2;
    }
}

pub(in crate::recipe) fn parse_corner(section: &Section<'_, '_>) -> Option<Corner> {
    let corner = Corner::parse(section)?;
    if corner.panel_gray_min() >= corner.panel_gray_max() {
        section.problem("panel_gray_max", format!("must exceed panel_gray_min, {}", corner.panel_gray_min()));
        return None;
    }
    Some(corner)
}

settings! {
    /// `[panel]`: the panel's name, its drawn outline and its held places. `panel = "name"` is the short form.
    pub struct Panel {
        /// The panel's name, which identifies its taught data in the store.
        name: String, (), required;
        /// The corners of the panel's outline in order, px in the taught picture. Needed if the scan does not show an
        /// edge, because points are missing there or another object is beside it. Without an outline, the depths of the
        /// scan determine the panel's edge. The edges are still measured by colour within 3 px of these lines.
        outline_px: Vec<[f64; 2]>, 0.0..=20_000.0, default Vec::new();
        /// The places at which holders or clamps touch the panel's edge: four corners each, px in the taught picture.
        /// These areas are used neither for the outline nor for the surface, at teaching and at localization.
        held_px: Vec<[[f64; 2]; 4]>, 0.0..=20_000.0, default Vec::new();
        /// The form of the serial numbers of this panel's parts: `#` is a digit, `?` one character, `*` any characters. A
        /// part whose number has another form is not this panel, and a start must state the number.
        serial_pattern: Option<String>, (), default None;
    }
}

impl Panel {
    pub(in crate::recipe) fn name_text(&self) -> &str {
        &self.name
    }
}

/// Maximum number of corners of an outline; more corners are not drawn by hand.
const MAX_CORNERS: usize = 200;
/// Minimum area of a drawn polygon, px².
const MIN_AREA_PX2: f64 = 16.0;

pub(in crate::recipe) fn parse_panel(top: &Section<'_, '_>) -> Option<Panel> {
    if !top.is_table("panel") {
        let name = top.parse::<String>("panel", (), None)?;
        return Some(Panel { name, outline_px: Vec::new(), held_px: Vec::new(), serial_pattern: None });
    }
    let section = top.section("panel");
    let panel = Panel::parse(&section)?;
    let outline = &panel.outline_px;
    if !outline.is_empty() {
        if !(3..=MAX_CORNERS).contains(&outline.len()) {
            let found = outline.len();
            section.problem("outline_px", format!("found {found} corners, valid: 3 to {MAX_CORNERS}, or none"));
            return None;
        }
        if let Some(problem) = find_polygon_problem(outline) {
            section.problem("outline_px", format!("the outline {problem}"));
            return None;
        }
    }
    for (index, held) in panel.held_px.iter().enumerate() {
        if let Some(problem) = find_polygon_problem(held) {
            section.problem("held_px", format!("item {}: the held place {problem}", index + 1));
            return None;
        }
    }
    Some(panel)
}

/// Returns the reason why these corners do not form a simple polygon; `None` if they do.
fn find_polygon_problem(corners: &[[f64; 2]]) -> Option<String> {
    let pixels: Vec<Pixel> = corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect();
    if let Some([first, second]) = polygon::crossing_sides(&pixels) {
        return Some(format!("crosses itself: the sides from corner {} and from corner {}", first + 1, second + 1));
    }
    let area_px2 = polygon::signed_area_px2(&pixels).abs();
    (area_px2 < MIN_AREA_PX2).then(|| {
        let [area, needed] = distinguishable_texts(area_px2, MIN_AREA_PX2, 1);
        format!("has an area of {area} px², at least {needed} px² are needed")
    })
}

/// Valid number of datum points.
const DATUM_COUNT_RANGE: std::ops::RangeInclusive<usize> = 3..=20;
/// Minimum distance of a datum point from the line through two others, mm; with a smaller distance, no rotation can be
/// determined.
const MIN_SPREAD_MM: f64 = 20.0;
/// Maximum residual of a datum point after the fit, mm.
const MAX_RESIDUAL_MM: f64 = 1.0;
/// Maximum number of datum points of which all permutations are tested.
const MAX_PERMUTED_DATUMS: usize = 5;
/// Maximum coordinate of a datum point in the drawing, mm: the origin of an aircraft's frame is far from the panel.
const COORDINATE_RANGE_MM: f64 = 100_000.0;

/// Maximum coordinate of the drawing's origin in the robot's base, mm. The drawing's frame is set as the base in the
/// controller. Beyond 8 m, the controller's single-precision numbers are less accurate than the micrometre that the
/// link requires.
const MAX_ORIGIN_MM: f64 = 8_000.0;

/// `[nominal]`: the pose of the drawing's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawingPlacement {
    base_from_drawing: Rigid<Base, Drawing>,
    residual_mm: Option<f64>,
    region_mm: Option<[[f64; 3]; 4]>,
}

impl DrawingPlacement {
    /// Returns the pose of the drawing's frame in the robot's base, with the panel at its nominal place.
    pub fn base_from_drawing(&self) -> Rigid<Base, Drawing> {
        self.base_from_drawing
    }

    /// Returns the four corners of the region in the drawing's frame, mm; `None` if the region is drawn on a picture.
    /// Teaching computes `[region] corners_px` from them.
    pub fn region_mm(&self) -> Option<[Point<Drawing>; 4]> {
        self.region_mm.map(|corners| corners.map(|corner| Point::new(corner.into())))
    }

    /// Returns the largest residual of a datum point, mm; `None` if the recipe states the pose directly.
    pub fn residual_mm(&self) -> Option<f64> {
        self.residual_mm
    }
}

/// Parses `[nominal]`. The outer `None` is a problem in the file, the inner `None` means that the table is absent.
pub(in crate::recipe) fn parse_nominal(section: &Section<'_, '_>) -> Option<Option<DrawingPlacement>> {
    if !section.is_present() {
        return Some(None);
    }
    let pose = section.section("base_from_drawing");
    let limits = || -COORDINATE_RANGE_MM..=COORDINATE_RANGE_MM;
    let points = |key| section.parse::<Vec<[f64; 3]>>(key, limits(), Some(Vec::new()));
    let (drawn, measured) = (points("datums_drawing_mm"), points("datums_base_mm"));
    let region_mm = section.parse::<Option<[[f64; 3]; 4]>>("region_mm", limits(), Some(None));
    let (is_pose, pose) = (pose.is_present(), parse_pose(&pose));
    section.finish();
    let (drawn, measured, region_mm) = (drawn?, measured?, region_mm?);
    let nominal = |(base_from_drawing, residual_mm)| {
        is_near(section, &base_from_drawing).then_some(Some(DrawingPlacement {
            base_from_drawing,
            residual_mm,
            region_mm,
        }))
    };
    match (is_pose, drawn.is_empty() && measured.is_empty()) {
        (true, true) => nominal((pose?.to_rigid(), None)),
        (false, false) => fit_datums(section, &drawn, &measured).and_then(|(place, mm)| nominal((place, Some(mm)))),
        (true, false) => {
            section.problem(
                "base_from_drawing",
                "both a pose and datum points are stated; remove the pose or the points",
            );
            None
        }
        (false, true) => {
            section.problem(
                "base_from_drawing",
                "is missing: state the pose of the drawing's frame in the robot's base (x_mm … c_deg), or three \
                 points on the panel in datums_drawing_mm and datums_base_mm",
            );
            None
        }
    }
}

/// Checks that the drawing's origin is near enough to the robot; otherwise a problem is reported.
fn is_near(section: &Section<'_, '_>, base_from_drawing: &Rigid<Base, Drawing>) -> bool {
    let farthest_mm = base_from_drawing.origin().mm.coords.amax();
    let is_near = farthest_mm <= MAX_ORIGIN_MM;
    if !is_near {
        let [found, limit] = distinguishable_texts(farthest_mm, MAX_ORIGIN_MM, 0);
        section.problem(
            "base_from_drawing",
            format!(
                "the drawing's origin lies {found} mm from the robot's base along an axis (limit {limit} mm), and the controller \
                 could not hold its frame exactly; export the drawing with an origin on the panel"
            ),
        );
    }
    is_near
}

fn parse_pose(section: &Section<'_, '_>) -> Option<KukaPose> {
    if !section.is_present() {
        return None;
    }
    let number = |key, limit: f64| section.parse::<f64>(key, -limit..=limit, None);
    let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| number(key, COORDINATE_RANGE_MM));
    let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| number(key, 360.0));
    section.finish();
    Some(KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? })
}

/// Fits the drawing's frame to the datum points. Returns the frame and the largest residual; reports a problem if the
/// points do not determine the frame.
fn fit_datums(
    section: &Section<'_, '_>,
    drawn: &[[f64; 3]],
    measured: &[[f64; 3]],
) -> Option<(Rigid<Base, Drawing>, f64)> {
    if drawn.len() != measured.len() || !DATUM_COUNT_RANGE.contains(&drawn.len()) {
        let (low, high) = (DATUM_COUNT_RANGE.start(), DATUM_COUNT_RANGE.end());
        let found = format!(
            "found {} points, and {} in datums_drawing_mm; valid: {low} to {high} points, the same in both lists \
             and in the same order",
            measured.len(),
            drawn.len()
        );
        section.problem("datums_base_mm", found);
        return None;
    }
    for (key, points) in [("datums_drawing_mm", drawn), ("datums_base_mm", measured)] {
        let spread_mm = spread_mm(points);
        if spread_mm < MIN_SPREAD_MM {
            let [spread, needed] = [spread_mm, MIN_SPREAD_MM].map(|mm| fixed_decimals(mm, 1));
            section.problem(
                key,
                format!(
                    "the points lie within {spread} mm of a line (at least {needed} mm are needed); choose points \
                     far apart, not on one line"
                ),
            );
            return None;
        }
    }
    let pairs: Vec<(Point<Drawing>, Point<Base>)> = drawn
        .iter()
        .zip(measured)
        .map(|(drawn, measured)| (Point::new((*drawn).into()), Point::new((*measured).into())))
        .collect();
    let Some(base_from_drawing) = fit_rigid_motion(&pairs) else {
        section.problem(
            "datums_base_mm",
            "the points do not determine a pose; choose points far apart, not on one line",
        );
        return None;
    };
    let residuals = pairs.iter().map(|(drawn, measured)| (base_from_drawing * *drawn).distance_mm(*measured));
    let (worst, residual_mm) = residuals
        .enumerate()
        .fold((0, 0.0), |worst, (index, mm)| if mm > worst.1 { (index + 1, mm) } else { worst });
    if residual_mm > MAX_RESIDUAL_MM {
        let [found, limit] = distinguishable_texts(residual_mm, MAX_RESIDUAL_MM, 2);
        section.problem(
            "datums_base_mm",
            format!(
                "point {worst} is {found} mm from its position in the drawing (limit {limit} mm): check the order \
                 of the points and the drawing's unit (mm here), and measure again"
            ),
        );
        return None;
    }
    if let Some(order) = alternative_order(drawn, measured) {
        let order: Vec<String> = order.iter().map(|index| (index + 1).to_string()).collect();
        section.problem(
            "datums_base_mm",
            format!(
                "the points also fit in the order {}, so the drawing could be turned over or around: choose points \
                 with unequal distances, or add a point",
                order.join(", ")
            ),
        );
        return None;
    }
    Some((base_from_drawing, residual_mm))
}

/// Returns another order of the measured points that fits the drawing equally well; `None` if there is none. For up to
/// five points, all permutations are tested; for more points, all exchanges of two.
fn alternative_order(drawn: &[[f64; 3]], measured: &[[f64; 3]]) -> Option<Vec<usize>> {
    let own: Vec<usize> = (0..measured.len()).collect();
    let fits = |order: &Vec<usize>| {
        let pairs: Vec<(Point<Drawing>, Point<Base>)> = drawn
            .iter()
            .zip(order)
            .map(|(drawn, &index)| (Point::new((*drawn).into()), Point::new(measured[index].into())))
            .collect();
        let off_mm = |motion: Rigid<Base, Drawing>| {
            pairs.iter().map(|(drawn, measured)| (motion * *drawn).distance_mm(*measured)).fold(0.0, f64::max)
        };
        fit_rigid_motion(&pairs).is_some_and(|motion| off_mm(motion) <= MAX_RESIDUAL_MM)
    };
    let orders = if own.len() <= MAX_PERMUTED_DATUMS { permutations(own.len()) } else { transpositions(&own) };
    orders.into_iter().find(|order| *order != own && fits(order))
}

/// Returns all permutations of `count` points, by inserting the last point at each position of each permutation of the
/// others.
fn permutations(count: usize) -> Vec<Vec<usize>> {
    let Some(last) = count.checked_sub(1) else { return vec![vec![]] };
    let with_last = |order: Vec<usize>| {
        (0..count).map(move |position| {
            let mut order = order.clone();
            order.insert(position, last);
            order
        })
    };
    permutations(last).into_iter().flat_map(with_last).collect()
}

/// Returns all orders in which two points are exchanged.
fn transpositions(own: &[usize]) -> Vec<Vec<usize>> {
    let pairs = (0..own.len()).flat_map(|one| (0..one).map(move |other| (one, other)));
    let exchanged = |(one, other)| {
        let mut order = own.to_vec();
        order.swap(one, other);
        order
    };
    pairs.map(exchanged).collect()
}

/// Returns the largest distance of a point from the line through the two points that are farthest apart, mm.
fn spread_mm(points: &[[f64; 3]]) -> f64 {
    let points: Vec<nalgebra::Point3<f64>> = points.iter().map(|point| (*point).into()).collect();
    let pairs = points.iter().flat_map(|a| points.iter().map(move |b| (*a, b - a)));
    let Some((from, along)) = pairs.max_by(|a, b| a.1.norm().total_cmp(&b.1.norm())) else { return 0.0 };
    let Some(along) = along.try_normalize(1e-9) else { return 0.0 };
    points.iter().map(|point| (point - from).cross(&along).norm()).fold(0.0, f64::max)
}
