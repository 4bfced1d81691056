//! From a scan to a smooth surface: a least-squares B-spline over the taught region (thesis 4.5, 4.6).
//!
//! The thesis uses raw scan points as control points; such a surface contains the camera's noise and does not pass
//! through the scan. Here the control points minimise the surface's deviation from the scan, and the deviation is
//! reported. The thesis's method can be selected for comparison. `today` corrects the surface with the scan in which
//! the panel was located, and `form` computes its profile and flatness. `dwell` computes the dwell time at each point
//! of the surface from executed or planned poses. Paths are planned in `path`.

mod bspline;
pub mod dwell;
mod equations;
mod fit;
mod form;
mod map;
mod patch;
mod samples;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod scene;
mod today;

pub use bspline::{BSplineSurface, Derivatives, Parameter, PointTangents, SurfaceError};
pub use dwell::{AreaWeighted, DwellSpread};
pub use fit::{Deviation, Fit, Refusal, examine_fit, fit};
pub use form::{Flatness, Form, FormCell, FormErrors, Measured, TodaysScan};
pub use map::{DeviationMap, Field, GridField, HoleMap, MapPixel};
pub use panelprep_base::geometry::basis::{Basis, KnotError, KnotVector, MAX_DEGREE, SpanFunctions, SpanValues};
pub use patch::{ParameterPatch, SampleGrid, Treated, sides_mm};
pub use samples::FitError;
pub use today::{TodayError, TodaysPoint, TodaysSurfaceFit, correct_taught_surface, todays_points};

#[cfg(test)]
mod tests {
    //! Tests of the fit on analytic panels, with and without defects of the scan.

    use super::scene::{SHAPES, ScanDefects, Shape, recipe, taught};
    use super::{Fit, FitError, MapPixel, Parameter, examine_fit, fit};

    fn fitted(shape: Shape, spoil: ScanDefects, more: &str) -> Result<Fit, FitError> {
        let recipe = recipe(shape, more);
        fit(&taught(shape, spoil, &recipe), recipe.surface())
    }

    /// Returns the mean and largest distance from the true surface, mm, and the largest angle between the normals,
    /// degrees.
    fn errors(shape: Shape, fit: &Fit) -> (f64, f64, f64) {
        let (mut sum, mut largest, mut angle) = (0.0, 0.0f64, 0.0f64);
        for n in 0..=20 * 20 {
            let at = Parameter { u: (n % 21) as f64 / 20.0, v: (n / 21) as f64 / 20.0 };
            let (point, normal) = (fit.surface.point(at), fit.surface.normal(at).expect("a normal"));
            let distance = shape.distance_mm(point).abs();
            sum += distance / 401.0;
            largest = largest.max(distance);
            angle = angle.max(shape.normal(point).angle(&normal.mm).to_degrees());
        }
        (sum, largest, angle)
    }

    /// The remaining error consists of the rounding of f32 at 700 mm, 0.00003 mm, and the error of approximating a
    /// sphere by cubics of 25 mm.
    #[test]
    fn an_exact_scan_gives_the_exact_surface() {
        for shape in SHAPES {
            let fit = fitted(shape, ScanDefects::default(), "").unwrap_or_else(|e| panic!("{shape:?}: {e}"));
            let (_, largest, angle) = errors(shape, &fit);
            println!("{shape:?} exact: {largest:.6} mm, {angle:.4}°, {:?}", fit.deviation);
            assert!(largest < 0.002 && angle < 0.01, "{shape:?}: {largest} mm, {angle}°");
            assert!(fit.deviation.rms_mm < 0.000_5);
        }
    }

    /// A quarter-size picture has a sixteenth of the points, so its error is four times that of a full-size picture.
    #[test]
    fn noise_and_flying_points_hardly_move_the_surface() {
        let spoil = ScanDefects { noise_mm: 0.055, flying: 0.01, missing: 0.01, ..ScanDefects::default() };
        for shape in SHAPES {
            let fit = fitted(shape, spoil, "").unwrap_or_else(|e| panic!("{shape:?}: {e}"));
            let (mean, largest, angle) = errors(shape, &fit);
            println!("{shape:?} noisy: mean {mean:.4}, largest {largest:.4} mm, {angle:.3}°, {:?}", fit.deviation);
            assert!(mean < 0.015 && largest < 0.06 && angle < 0.4, "{shape:?}: {mean} {largest} mm, {angle}°");
            assert!((fit.deviation.rms_mm / 0.055 - 1.0).abs() < 0.1, "{:?}", fit.deviation);
            assert!((1.0..3.0).contains(&fit.deviation.missing_percent), "{:?}", fit.deviation);
        }
    }

    /// Outliers must not move the surface near them: without weights, outliers of up to 2 mm would increase the error
    /// by a factor of 14. Without the second fit this test fails. Smoothing does not increase the error of a noisy
    /// plane, and does not reduce that of an exact saddle.
    #[test]
    fn noise_requires_smoothing_and_an_exact_scan_none() {
        let noisy =
            fitted(Shape::Plane, ScanDefects { noise_mm: 0.1, ..ScanDefects::default() }, "").expect("a surface");
        let exact = fitted(Shape::Saddle, ScanDefects::default(), "").expect("a surface");
        let [noisy, exact] = [noisy, exact].map(|fit| fit.deviation.smoothing);
        assert!(noisy >= 1.0 && exact <= 1e-6, "{noisy} {exact}");
    }

    #[test]
    fn a_cluster_of_flying_points_is_left_out() {
        let clean =
            fitted(Shape::Sphere, ScanDefects { noise_mm: 0.02, ..ScanDefects::default() }, "").expect("a fit");
        let flying =
            fitted(Shape::Sphere, ScanDefects { noise_mm: 0.02, flying: 0.06, ..ScanDefects::default() }, "")
                .expect("a fit");
        let (clean_mean, ..) = errors(Shape::Sphere, &clean);
        let (mean, ..) = errors(Shape::Sphere, &flying);
        assert!(mean < 2.0 * clean_mean, "{mean} mm, {clean_mean} mm without flying points");
        assert!(flying.deviation.rejected > 900, "{:?}", flying.deviation);
    }

    #[test]
    fn a_scan_with_missing_points_is_refused() {
        let hole = |hole_px| ScanDefects { noise_mm: 0.02, hole_px, ..ScanDefects::default() };
        let small = fitted(Shape::Plane, hole(3.0), "").expect("a small hole is bridged");
        assert!(small.deviation.missing_percent > 0.1);
        assert!(
            matches!(fitted(Shape::Plane, hole(15.0), ""), Err(FitError::Hole { size_mm, .. }) if (size_mm - 46.0).abs() < 4.0)
        );
        let dropped = ScanDefects { missing: 0.2, ..hole(0.0) };
        assert!(
            matches!(fitted(Shape::Plane, dropped, ""), Err(FitError::Missing { percent, .. }) if (percent - 20.0).abs() < 1.0)
        );
    }

    #[test]
    fn a_poor_fit_and_too_many_controls_are_refused() {
        let spoil = ScanDefects { noise_mm: 0.1, ..ScanDefects::default() };
        let poor = fitted(Shape::Saddle, spoil, "[surface]\nmax_rms_mm = 0.09\n");
        assert!(matches!(poor, Err(FitError::PoorFit { rms_mm, .. }) if (rms_mm - 0.1).abs() < 0.01), "{poor:?}");
        let fine = fitted(Shape::Saddle, spoil, "[surface]\ncontrol_spacing_mm = 6\n");
        assert!(matches!(fine, Err(FitError::TooFine { .. })), "{fine:?}");
    }

    /// In a band of 40 px the points are in reverse order: the surface folds there. The error contains the position of
    /// the fold and a map.
    #[test]
    fn a_fold_is_refused_with_its_picture() {
        let recipe = recipe(Shape::Plane, "[surface]\nmax_rms_mm = 5\n");
        let panel =
            taught(Shape::Plane, ScanDefects { noise_mm: 0.02, fold_px: 20.0, ..ScanDefects::default() }, &recipe);
        let refusal = examine_fit(&panel, recipe.surface()).expect_err("a fold");
        let FitError::Fold { at } = refusal.error else { panic!("{}", refusal.error) };
        assert!((at.u - 243.0).abs() < 25.0, "{at:?}");
        let map = refusal.map.expect("a picture");
        assert!(map.pixels().iter().any(|pixel| matches!(pixel, MapPixel::Fits { .. })));
        assert!(map.pixels().len() > 10_000);
    }

    #[test]
    fn the_fit_is_bit_equal_for_any_number_of_threads() {
        let recipe = recipe(Shape::Sphere, "");
        let panel = taught(Shape::Sphere, ScanDefects { noise_mm: 0.05, ..ScanDefects::default() }, &recipe);
        let fits = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| fit(&panel, recipe.surface()).expect("a fit"))
        });
        assert_eq!(fits[0].surface, fits[1].surface);
        assert_eq!(fits[0].deviation, fits[1].deviation);
    }
}
