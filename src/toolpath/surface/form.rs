//! Computes the form of today's panel in the terms of metrology: profile of the surface, and flatness, each with its
//! uncertainty.
//!
//! The region is divided into cells of about 20 mm. If most points of a cell belong to today's surface, the cell's
//! deviation is
//!     d = c(u, v) + mean of the points' distances from c,                                                    (1)
//! along the nominal normal, positive in front of the nominal surface, with c the smooth correction of `today`. The
//! mean adds features that c does not follow, such as a dent that is narrower than the spans of c.
//!
//! *Profile of a surface* (ISO 1101:2017, 17.6; ASME Y14.5-2018, 11.2): the tolerance zone lies between the two
//! surfaces at half the tolerance on both sides of the nominal surface, so that its measured value is 2 · max |d|. The
//! extremes of d are its two unequal sides. The nominal surface is placed by the localization, which is a best fit to
//! the whole panel without datums: position and tilt of the panel have no influence. *Flatness* (ISO 12781-1, MZPL):
//! the minimum zone of the cells' points on today's surface (`geometry/plane`).
//!
//! The 95 % uncertainty U of d follows from the law of propagation (JCGM 100:2008, 5.1.2) with independent parts:
//!     U² = k² (s²/n + g σ² + p²) + N²,   k = 1.96.                                                           (2)
//! - s is the standard deviation of the points about the mean of their cell, n the number of points in the cell.
//! - σ is the scan's smooth error at a point. If the nominal surface is a drawing, there is one scan (g = 1); if it was
//!   scanned, there are two (g = 2).
//! - p is the error of the localization along the cell's normal.
//! - N is the distance from the fitted nominal surface within which 95 % of the nominal points lie.
//!
//! σ and p are not independent, because the pose follows from the same scan: the fit removes the part of the scan's
//! error that is a shift or a tilt, and (2) counts it twice. This makes U larger, by √2 at most. With d_p and U_p of
//! the cells p, the true value of the profile is at most 2 · max (|d_p| + U_p), so that its uncertainty is 2 · (max
//! (|d_p| + U_p) − max |d_p|); the uncertainties of the extremes are computed in the same way. The flatness changes
//! with d at the cells that touch the planes of its zone, with weights that sum to 1 on each plane (the multipliers of
//! its linear program): with independent errors its variance is at most 2 times that of one cell. Pose and nominal
//! surface do not change it, and g is 1. Errors that are equal at two cells cancel in it.
//!
//! A value v meets the limit L with certainty if v + U ≤ L (ISO 14253-1:2017, 5.2). Known limits: all values apply to
//! the cells that were seen. A defect that is narrower than a cell contributes only its mean. Points that are too far
//! from c to belong to the surface are ignored: if they are less than half of a cell, their defect is ignored, too. U
//! is that of single cells.

use super::bspline::Parameter;
use super::fit::Fit;
use super::patch::sides_mm;
use super::today::{CellRaster, TodaysPoint, TodaysSurfaceFit};
use panelprep_base::geometry::statistics::NORMAL_TWO_SIDED_95;
use panelprep_base::geometry::{Panel, PlaneZone, Point, PoseUncertainty};

/// Approximate side of a cell, mm: wide enough for the mean of many points, narrower than a dent made by a hand.
const CELL_MM: f64 = 20.0;
/// Minimum number of points in a cell at which their mean and their scatter are known.
const MIN_POINTS_PER_CELL: u32 = 8;
/// Minimum number of seen cells for which a form is computed.
const MIN_CELLS: usize = 4;
/// Maximum flatness of the nominal surface at which the panel is treated as flat, mm.
const MAX_NOMINAL_FLATNESS_MM: f64 = 0.2;

/// The points of the scan in which the panel was located, with their errors.
#[derive(Debug, Clone, Default)]
pub struct TodaysScan {
    /// The points of the scan in the region.
    pub points: Vec<TodaysPoint>,
    /// The errors of the points; `None` if they are not known.
    pub errors: Option<FormErrors>,
}

/// The errors of the deviation that cannot be determined from the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FormErrors {
    /// Standard deviation of the smooth error of one scan at a point, mm.
    pub scan_mm: f64,
    /// The uncertainty of the pose with which the points were transformed to the panel's frame.
    pub pose: PoseUncertainty,
}

/// A measured value with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The measured value, mm.
    pub value_mm: f64,
    /// Uncertainty, mm: 95 % of the errors are smaller.
    pub uncertainty_mm: f64,
}

/// The deviation of one cell of the region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FormCell {
    /// The centre of the cell.
    pub at: Parameter,
    /// Distance of today's panel in front of the nominal surface.
    pub deviation: Measured,
    /// Standard deviation of the scan's error alone, mm.
    scan_mm: f64,
}

/// The flatness of a panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flatness {
    /// The minimum zone of today's surface.
    pub zone: Measured,
    /// The zone about the least-squares plane, mm: an upper bound of the minimum zone.
    pub least_squares_mm: f64,
    /// The minimum zone of the nominal surface at the same cells, mm.
    pub nominal_mm: f64,
}

impl Flatness {
    /// Returns whether the nominal panel is flat.
    pub fn is_nominal_flat(&self) -> bool {
        self.nominal_mm <= MAX_NOMINAL_FLATNESS_MM
    }
}

/// The form of today's panel over the part of the region that the scan shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Form {
    /// The profile: twice the largest absolute deviation.
    pub profile: Measured,
    /// The largest deviation in front of the nominal surface; negative if the whole panel lies behind the nominal
    /// surface.
    pub front: Measured,
    /// The largest deviation behind the nominal surface, as a negative value; positive if the whole panel lies in
    /// front.
    pub behind: Measured,
    /// The flatness; `None` if the seen cells lie on a line.
    pub flatness: Option<Flatness>,
    /// Fraction of the region that the seen cells cover, percent.
    pub seen_percent: f64,
    /// The cells that were seen.
    pub places: Vec<FormCell>,
}

impl Form {
    /// Computes the form of today's surface relative to the nominal surface; `nominal_scans` is 0 for a drawing, and 1
    /// for a taught scan. `None` if fewer than four cells were seen.
    pub fn compute(
        (taught, nominal_scans): (&Fit, u8),
        todays: &TodaysSurfaceFit,
        errors: &FormErrors,
    ) -> Option<Form> {
        let cells = FormCells::count(taught, todays);
        let scatter_mm = cells.scatter_mm();
        let places: Vec<FormCell> = (0..cells.sums.len())
            .filter(|index| cells.is_seen(*index))
            .filter_map(|index| {
                let (at, mean_mm, count) =
                    (cells.raster.middle(index), cells.mean_mm(index), cells.sums[index].near);
                let normal = taught.surface.normal(at)?;
                let pose_mm = errors.pose.along_mm(taught.surface.point(at), normal);
                let noise_mm = scatter_mm / f64::from(count).sqrt();
                let scans_mm = errors.scan_mm * f64::from(1 + nominal_scans).sqrt();
                let parts_mm = NORMAL_TWO_SIDED_95 * noise_mm.hypot(scans_mm).hypot(pose_mm);
                let deviation = Measured {
                    value_mm: todays.measured.field.height_at([at.u, at.v]) + mean_mm,
                    uncertainty_mm: parts_mm.hypot(taught.deviation.p95_mm),
                };
                Some(FormCell { at, deviation, scan_mm: noise_mm.hypot(errors.scan_mm) })
            })
            .collect();
        let seen_percent = 100.0 * places.len() as f64 / cells.sums.len() as f64;
        (places.len() >= MIN_CELLS).then(|| Form {
            profile: profile(&places),
            front: largest(places.iter().map(|place| place.deviation)),
            behind: largest(places.iter().map(|place| place.deviation.reversed())).reversed(),
            flatness: flatness(taught, &places),
            seen_percent,
            places,
        })
    }

    /// Returns the largest 95 % uncertainty of a cell's deviation, mm.
    pub fn largest_uncertainty_mm(&self) -> f64 {
        self.places.iter().map(|place| place.deviation.uncertainty_mm).fold(0.0, larger)
    }
}

impl Measured {
    /// Returns the value with the opposite sign and the same uncertainty.
    fn reversed(self) -> Measured {
        Measured { value_mm: -self.value_mm, ..self }
    }

    /// Returns whether the upper end of the uncertainty interval is within an upper limit, mm.
    pub fn is_within_with_uncertainty(&self, limit_mm: f64) -> bool {
        self.value_mm + self.uncertainty_mm <= limit_mm
    }

    /// Returns whether the lower end of the uncertainty interval exceeds an upper limit, mm.
    pub fn is_beyond_with_uncertainty(&self, limit_mm: f64) -> bool {
        self.value_mm - self.uncertainty_mm > limit_mm
    }
}

/// Returns the larger number, or NaN if one of them is NaN, because an unknown number must not be ignored.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Returns the largest value; its uncertainty is the distance to the largest upper end of the uncertainty intervals.
fn largest(all: impl Iterator<Item = Measured>) -> Measured {
    let none = [f64::NEG_INFINITY; 2];
    let [value_mm, bound_mm] = all.fold(none, |[value, bound], measured| {
        [larger(value, measured.value_mm), larger(bound, measured.value_mm + measured.uncertainty_mm)]
    });
    Measured { value_mm, uncertainty_mm: bound_mm - value_mm }
}

fn profile(places: &[FormCell]) -> Measured {
    let sizes = places.iter().map(|place| Measured { value_mm: place.deviation.value_mm.abs(), ..place.deviation });
    let Measured { value_mm, uncertainty_mm } = largest(sizes);
    Measured { value_mm: 2.0 * value_mm, uncertainty_mm: 2.0 * uncertainty_mm }
}

fn flatness(taught: &Fit, places: &[FormCell]) -> Option<Flatness> {
    let nominal: Vec<Point<Panel>> = places.iter().map(|place| taught.surface.point(place.at)).collect();
    let moved = |(place, point): (&FormCell, &Point<Panel>)| {
        Some(*point + taught.surface.normal(place.at)? * place.deviation.value_mm)
    };
    let todays = places.iter().zip(&nominal).map(moved).collect::<Option<Vec<Point<Panel>>>>()?;
    let zone = PlaneZone::compute(&todays)?;
    let scan_mm = places.iter().map(|place| place.scan_mm).fold(0.0, larger);
    Some(Flatness {
        zone: Measured {
            value_mm: zone.minimum_mm,
            uncertainty_mm: std::f64::consts::SQRT_2 * NORMAL_TWO_SIDED_95 * scan_mm,
        },
        least_squares_mm: zone.least_squares_mm,
        nominal_mm: PlaneZone::compute(&nominal)?.minimum_mm,
    })
}

/// The sums over the points of one cell.
#[derive(Debug, Clone, Copy, Default)]
struct CellSums {
    all: u32,
    near: u32,
    sum_mm: f64,
    squares_mm2: f64,
}

/// The cells of the region, with the sums over their points.
struct FormCells {
    raster: CellRaster,
    sums: Vec<CellSums>,
}

impl FormCells {
    fn count(taught: &Fit, todays: &TodaysSurfaceFit) -> FormCells {
        let raster = CellRaster::new(sides_mm(&taught.surface), CELL_MM);
        let mut cells = FormCells { raster, sums: vec![CellSums::default(); raster.count()] };
        for sample in &todays.measured.seen {
            let off_mm = sample.height_mm - todays.measured.field.height_at(sample.position);
            let sums = &mut cells.sums[raster.index(sample.position)];
            sums.all += 1;
            if off_mm.abs() < todays.measured.limit_mm {
                sums.near += 1;
                sums.sum_mm += off_mm;
                sums.squares_mm2 += off_mm * off_mm;
            }
        }
        cells
    }

    fn is_seen(&self, index: usize) -> bool {
        let CellSums { all, near, .. } = self.sums[index];
        2 * near > all && near >= MIN_POINTS_PER_CELL
    }

    fn mean_mm(&self, index: usize) -> f64 {
        self.sums[index].sum_mm / f64::from(self.sums[index].near)
    }

    /// Returns the standard deviation of a point about the mean of its cell, mm, over all seen cells.
    fn scatter_mm(&self) -> f64 {
        let seen = (0..self.sums.len()).filter(|index| self.is_seen(*index));
        let (freedom, squares) = seen.fold((0.0, 0.0), |(freedom, squares), index| {
            let CellSums { near, sum_mm, squares_mm2, .. } = self.sums[index];
            let of_place = squares_mm2 - sum_mm * sum_mm / f64::from(near);
            (freedom + f64::from(near - 1), squares + of_place.max(0.0))
        });
        if freedom > 0.0 { (squares / freedom).sqrt() } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::scene::{ScanDefects, Shape, recipe, taught};
    use crate::surface::today::{correct_taught_surface, points_of};
    use crate::surface::{Fit, fit};
    use nalgebra::{Isometry3, Matrix6};
    use panelprep_base::geometry::Rigid;
    use panelprep_cell::panel::TaughtPanel;

    /// Returns a taught panel of 280 × 168 mm with its fitted surface.
    fn learnt(shape: Shape) -> (TaughtPanel, Fit) {
        let recipe = recipe(shape, "");
        let panel = taught(shape, ScanDefects::default(), &recipe);
        let fit = fit(&panel, recipe.surface()).expect("a surface");
        (panel, fit)
    }

    /// Returns an error of the scan of 0.03 mm, and a shift of 0.02 mm along the camera's axis.
    fn errors() -> FormErrors {
        let mut covariance = Matrix6::zeros();
        covariance[(5, 5)] = 0.02 * 0.02;
        let camera_from_panel = Rigid::from_isometry_unchecked(Isometry3::identity());
        let pose = PoseUncertainty { camera_from_panel, centre: Point::at(0.0, 0.0, 700.0), covariance };
        FormErrors { scan_mm: 0.03, pose }
    }

    fn form(shape: Shape, in_front_mm: impl Fn(Parameter) -> f64) -> Form {
        let (panel, fit) = learnt(shape);
        let points = points_of(&fit, in_front_mm);
        let todays = correct_taught_surface(&fit.surface, &panel, &fit.map, (&points, 12.0)).expect("a surface");
        Form::compute((&fit, 0), &todays, &errors()).expect("a form")
    }

    /// Expected values, calculated by hand. The bow 1.5 (1 − (2u − 1)²) mm over 14 cells along u has its largest value
    /// at u = 0.536, 1.492 mm, and its smallest at u = 0.036, 0.207 mm. The profile is 2.985 mm. The taught plane has
    /// the slopes 0.2 and 0.1, so that its normal has the component 1/√1.05 = 0.976 along the camera's axis: the
    /// contribution of the shift is 0.0195 mm. With 0.03 mm of the scan and 0.06/√140 = 0.005 mm of the points, U is
    /// 1.96 · 0.0361 = 0.071 mm.
    #[test]
    fn a_bow_has_its_profile() {
        let found = form(Shape::Plane, |at| 1.5 * (1.0 - (2.0 * at.u - 1.0).powi(2)));
        assert!((found.profile.value_mm - 2.985).abs() < 0.04, "{:?}", found.profile);
        assert!((found.profile.uncertainty_mm / 2.0 - 0.071).abs() < 0.015, "{:?}", found.profile);
        assert!((found.front.value_mm - 1.492).abs() < 0.02, "{:?}", found.front);
        assert!((found.behind.value_mm - 0.207).abs() < 0.04, "{:?}", found.behind);
        assert!(found.seen_percent == 100.0 && found.places.len() == 14 * 8, "{}", found.places.len());
    }

    /// Expected values, calculated by hand. The same bow on a plane has the zone between its highest and its lowest
    /// cells, 1.492 − 0.207 = 1.285 mm, with the uncertainty √2 · 1.96 · 0.0304 = 0.084 mm. The region is 280 mm of the
    /// taught cylinder of radius 400 mm; its nominal zone is the sagitta at the outer cells, 130 mm from the middle:
    /// 21.7 mm.
    #[test]
    fn a_bow_has_its_flatness() {
        let flat = form(Shape::Plane, |at| 1.5 * (1.0 - (2.0 * at.u - 1.0).powi(2))).flatness.expect("a plane");
        assert!((flat.zone.value_mm - 1.285).abs() < 0.04 && flat.is_nominal_flat(), "{flat:?}");
        assert!((flat.zone.uncertainty_mm - 0.084).abs() < 0.005, "{flat:?}");
        assert!(flat.least_squares_mm >= flat.zone.value_mm, "{flat:?}");
        let round = form(Shape::Cylinder, |_| 0.0).flatness.expect("a plane");
        assert!((round.nominal_mm - 21.7).abs() < 1.0 && !round.is_nominal_flat(), "{round:?}");
    }

    /// A tilt of the whole panel does not change its flatness: the flatness of the plane 0.4 u − 0.2 is that of its
    /// noise. The profile includes the tilt, because only the localization removes a tilt.
    #[test]
    fn a_tilt_is_flat() {
        let found = form(Shape::Plane, |at| 0.4 * at.u - 0.2);
        let flat = found.flatness.expect("a plane");
        assert!(flat.zone.value_mm < 0.06, "{flat:?}");
        // Expected value, calculated by hand: the outer cells are at u = 1/28 and 27/28, where the tilt is −0.186 and
        // 0.186 mm.
        assert!((found.profile.value_mm - 0.371).abs() < 0.04, "{:?}", found.profile);
    }

    /// A dent of 40 mm with a depth of 0.2 mm is narrower than the features that the smooth correction follows; its
    /// full depth is still measured.
    #[test]
    fn a_narrow_dent_counts_with_its_full_depth() {
        let is_dent = |at: Parameter| (at.u - 0.5).abs() < 20.0 / 280.0 && (at.v - 0.5).abs() < 21.0 / 168.0;
        let found = form(Shape::Plane, |at| if is_dent(at) { -0.2 } else { 0.0 });
        assert!((found.behind.value_mm + 0.2).abs() < 0.03, "{:?}", found.behind);
    }

    /// Hidden cells have no value and reduce the seen fraction. Expected value, calculated by hand: a clamp over 2 of
    /// 14 by 2 of 8 cells leaves 108 of 112, 96.4 %.
    #[test]
    fn hidden_places_are_not_counted() {
        let is_clamped = |at: Parameter| at.u < 2.0 / 14.0 && at.v < 2.0 / 8.0;
        let found = form(Shape::Plane, |at| if is_clamped(at) { 8.0 } else { 0.0 });
        assert!((found.seen_percent - 96.4).abs() < 0.1, "{}", found.seen_percent);
        assert!(found.profile.value_mm < 0.1, "{:?}", found.profile);
    }

    /// If the uncertainty of one cell is not known, that of the panel is not known either, whatever the other cells
    /// state.
    #[test]
    fn an_unknown_uncertainty_of_a_place_proves_nothing() {
        let (panel, fit) = learnt(Shape::Plane);
        let points = points_of(&fit, |_| 0.0);
        let todays = correct_taught_surface(&fit.surface, &panel, &fit.map, (&points, 12.0)).expect("a surface");
        let of = |errors: &FormErrors| Form::compute((&fit, 0), &todays, errors).expect("a form");
        let unknown_scan = of(&FormErrors { scan_mm: f64::NAN, ..errors() });
        let flat = unknown_scan.flatness.expect("a plane");
        assert!(
            !unknown_scan.profile.is_within_with_uncertainty(9.0) && !flat.zone.is_within_with_uncertainty(9.0)
        );
        let mut pose = errors().pose;
        pose.covariance[(5, 5)] = f64::NAN;
        let unknown_pose = of(&FormErrors { pose, ..errors() });
        assert!(
            !unknown_pose.profile.is_within_with_uncertainty(9.0) && unknown_pose.largest_uncertainty_mm().is_nan()
        );
        let known = Measured { value_mm: 0.1, uncertainty_mm: 0.1 };
        let unknown = Measured { uncertainty_mm: f64::NAN, ..known };
        for places in [[known, unknown], [unknown, known]] {
            assert!(!largest(places.into_iter()).is_within_with_uncertainty(9.0), "{places:?}");
        }
    }

    #[test]
    fn a_limit_within_the_uncertainty_is_neither_met_nor_exceeded() {
        let measured = Measured { value_mm: 0.5, uncertainty_mm: 0.1 };
        assert!(measured.is_within_with_uncertainty(0.6) && !measured.is_within_with_uncertainty(0.59));
        assert!(measured.is_beyond_with_uncertainty(0.39) && !measured.is_beyond_with_uncertainty(0.41));
        let unknown = Measured { value_mm: 0.5, uncertainty_mm: f64::NAN };
        assert!(!unknown.is_within_with_uncertainty(9.0));
    }
}
