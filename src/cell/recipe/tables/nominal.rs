//! `[nominal]`: the panel is taught from its drawing. The table states where the drawing's frame lies at the panel's
//! nominal place, by a pose or by datum points.

use panelprep_base::config::Section;
use panelprep_base::geometry::{Base, Drawing, KukaPose, Point, Rigid, fit_rigid_motion};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};

/// Number of datum points.
const DATUM_COUNT_RANGE: std::ops::RangeInclusive<usize> = 3..=20;
/// Smallest distance of a datum point from the line through two others, mm: nearer points determine no rotation.
const MIN_SPREAD_MM: f64 = 20.0;
/// Largest distance of a datum point from its place after the fit, mm.
const MAX_RESIDUAL_MM: f64 = 1.0;
/// Largest number of datum points of which all orders are tried.
const MAX_PERMUTED_DATUMS: usize = 5;
/// Limits of the coordinates, mm: an aircraft's frame has its origin far from the panel.
const COORDINATE_RANGE_MM: f64 = 100_000.0;

/// Largest coordinate of the drawing's origin in the robot's base, mm. The base that is set in the controller is the
/// drawing's frame; beyond 8 m the controller's single-precision numbers are no longer exact to the micrometre that the
/// link requires of a base.
const MAX_ORIGIN_MM: f64 = 8_000.0;

/// `[nominal]`: where the drawing lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawingPlacement {
    base_from_drawing: Rigid<Base, Drawing>,
    residual_mm: Option<f64>,
    region_mm: Option<[[f64; 3]; 4]>,
}

impl DrawingPlacement {
    /// The drawing's frame in the robot's base, with the panel at its nominal place.
    pub fn base_from_drawing(&self) -> Rigid<Base, Drawing> {
        self.base_from_drawing
    }

    /// The four corners of the region in the drawing's frame, mm; `None` if the region is drawn on a picture.
    /// Teaching sets `[region] corners_px` from them.
    pub fn region_mm(&self) -> Option<[Point<Drawing>; 4]> {
        self.region_mm.map(|corners| corners.map(|corner| Point::new(corner.into())))
    }

    /// The largest distance of a datum point from its place in the drawing, mm; `None` if the recipe states the
    /// pose.
    pub fn residual_mm(&self) -> Option<f64> {
        self.residual_mm
    }
}

/// Returns `Some(None)` if the table is absent.
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

/// Returns whether the drawing's origin is near enough to the robot; otherwise the problem is noted.
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

/// Fits the drawing's frame to datum points, and returns the largest distance of a point from its place; the problem
/// is noted if they do not determine it.
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

/// Returns another order of the measured points that fits the drawing as well; `None` if there is none. All orders of
/// up to five points are tried, and all exchanges of two of more points.
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

/// Returns all orders of this number of points: the last one is put at each position of the orders of the others.
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

/// Returns the orders in which two points are exchanged.
fn transpositions(own: &[usize]) -> Vec<Vec<usize>> {
    let pairs = (0..own.len()).flat_map(|one| (0..one).map(move |other| (one, other)));
    let exchanged = |(one, other)| {
        let mut order = own.to_vec();
        order.swap(one, other);
        order
    };
    pairs.map(exchanged).collect()
}

/// Returns how far the farthest point lies from the line through the two points that are farthest apart, mm.
fn spread_mm(points: &[[f64; 3]]) -> f64 {
    let points: Vec<nalgebra::Point3<f64>> = points.iter().map(|point| (*point).into()).collect();
    let pairs = points.iter().flat_map(|a| points.iter().map(move |b| (*a, b - a)));
    let Some((from, along)) = pairs.max_by(|a, b| a.1.norm().total_cmp(&b.1.norm())) else { return 0.0 };
    let Some(along) = along.try_normalize(1e-9) else { return 0.0 };
    points.iter().map(|point| (point - from).cross(&along).norm()).fold(0.0, f64::max)
}
