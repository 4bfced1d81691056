//! Tests of rows over patches that can be checked by hand, and on every curvature.

use super::*;
use proptest::prelude::*;

/// Calculated by hand: disc 30 mm, inset 3 mm; 44 mm of 50 mm remain, at 12 mm in 4 steps of 11 mm. Rows from 3 to
/// 47 mm are in 5 steps of 8.8 mm; the second row runs back.
#[test]
fn a_square_of_50_mm_has_five_rows() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings(""));
    let raster = raster(&surface, &WHOLE, &settings).expect("rows");
    assert_eq!(raster.rows.len(), 5);
    for (index, row) in raster.rows.iter().enumerate() {
        let row = points(&surface, row);
        assert_eq!(row.len(), 6);
        let (from, to) = if index % 2 == 0 { (3.0, 47.0) } else { (47.0, 3.0) };
        let y = 3.0 + 11.0 * index as f64;
        assert!(row[0].distance_mm(Point::at(from, y, 0.0)) < 1e-6, "{:?}", row[0]);
        assert!(row[5].distance_mm(Point::at(to, y, 0.0)) < 1e-6);
    }
    // Each turn of 11 mm gets one waypoint in its middle.
    assert_eq!(raster.to_track(&surface, settings.waypoint_spacing_mm()).len(), 5 * 6 + 4);
}

/// Calculated by hand: below 6 mm there is no space for two insets of 3 mm.
#[test]
fn a_patch_smaller_than_the_disc_gets_one_row_or_one_point() {
    for (width_mm, height_mm, lengths) in
        [(4.0, 4.0, vec![1]), (48.0, 4.0, vec![6]), (4.0, 40.0, vec![1, 1, 1, 1]), (6.0, 6.0, vec![1])]
    {
        let surface = rectangle(width_mm, height_mm);
        let raster = raster(&surface, &WHOLE, &settings("")).expect("rows");
        assert_eq!(raster.rows.iter().map(Vec::len).collect::<Vec<_>>(), lengths, "{width_mm} × {height_mm}");
        let middle = points(&surface, &raster.rows[0])[0];
        if lengths == [1] {
            assert!(middle.distance_mm(Point::at(width_mm / 2.0, height_mm / 2.0, 0.0)) < 1e-6);
        }
    }
}

/// Calculated by hand: a patch 50 mm wide on one side and 60 mm on the other has 54 mm at most between its outer
/// rows, 5 steps. At the narrow side the steps are 8.8 mm, at the wide side 10.8 mm, and the last row stays 3 mm
/// from the slanted border.
#[test]
fn the_last_row_follows_the_far_border() {
    let surface = quad([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 50.0]]);
    let raster = raster(&surface, &WHOLE, &settings("")).expect("rows");
    assert_eq!(raster.rows.len(), 6);
    for point in points(&surface, &raster.rows[5]) {
        let to_border_mm = (50.0 + point.mm.x / 10.0 - point.mm.y) / 1.01f64.sqrt();
        assert!((to_border_mm - 3.0).abs() < 0.06, "{to_border_mm} mm at {point:?}");
    }
}

/// The cylinder unrolled: rows that run along its axis are r' apart around it, which is 400 mm times the angle.
#[test]
fn the_step_over_holds_around_a_cylinder() {
    let (fit, _, _, settings) = fitted(Shape::Cylinder, ScanDefects::default(), "[path]\nstep_over_mm = 12\n");
    // In the region, u runs around the cylinder; after the swap, rows run along the cylinder's axis.
    let surface = transposed(&fit.surface);
    let raster = raster(&surface, &WHOLE, &settings).expect("rows");
    let around_mm = |point: &Point<Panel>| 400.0 * (point.mm.x / (1_100.0 - point.mm.z)).atan();
    let ends = |v: f64| around_mm(&surface.point(Parameter { u: 0.5, v }));
    let width_mm = (ends(1.0) - ends(0.0)).abs() - 6.0;
    let step_mm = width_mm / (width_mm / 12.0).ceil();
    let rows: Vec<_> = raster.rows.iter().map(|row| points(&surface, row)).collect();
    println!("width {width_mm:.3} mm, {} rows, r' {step_mm:.4} mm", rows.len());
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for pair in rows.windows(2) {
        // On a developed cylinder: distance of a point from the chord between its neighbouring points in the next row.
        for point in &pair[0][1..pair[0].len() - 1] {
            let flat = |p: &Point<Panel>| nalgebra::Vector2::new(around_mm(p), p.mm.y);
            let here = flat(point);
            let distance = |piece: &[Point<Panel>]| {
                let (a, b) = (flat(&piece[0]), flat(&piece[1]));
                let share = ((here - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                (here - a - (b - a) * share).norm()
            };
            let nearest = pair[1].windows(2).map(distance).fold(f64::INFINITY, f64::min);
            (least, most) = (least.min(nearest), most.max(nearest));
        }
    }
    println!("around the cylinder {least:.4} to {most:.4} mm");
    assert!(most <= 12.0 && (most / step_mm - 1.0).abs() < 0.01 && (least / step_mm - 1.0).abs() < 0.01);
}

fn transposed(surface: &BSplineSurface) -> BSplineSurface {
    let (rows, columns) = (surface.knots_u().controls(), surface.knots_v().controls());
    let controls = (0..rows * columns).map(|n| surface.controls()[(n % rows) * columns + n / rows]).collect();
    let knots = [surface.knots_v().clone(), surface.knots_u().clone()];
    BSplineSurface::new(knots, controls, Point::at(0.0, 0.0, 0.0)).expect("a surface")
}

/// Distances between neighbouring rows, each compared with the r' of its own column, on surfaces with every
/// curvature.
#[test]
fn rows_lie_at_the_equal_distance_of_their_column() {
    for shape in SHAPES {
        for angle_deg in [0.0, 90.0] {
            let more = format!("[path]\nfeed_angle_deg = {angle_deg}\nwaypoint_spacing_mm = 4\n");
            let (fit, region, ..) = fitted(shape, ScanDefects::default(), &more);
            let settings = scene::recipe(shape, &more).path().clone();
            let grids: Vec<GridId> = region.ids().collect();
            let plan = plan(&fit.surface, &region, &grids, &[], &settings).expect("a plan");
            let step_over = plan.step_over_mm.expect("rows");
            // The scene's region is a rectangle in x and y. On a plane, all columns are equally wide, on other
            // shapes nearly so.
            let spread = (step_over.max_mm - step_over.min_mm) / step_over.max_mm;
            println!("{shape:?} {angle_deg}: {step_over:?}");
            assert!(
                step_over.max_mm <= 12.0 * 1.002
                    && spread < if matches!(shape, Shape::Plane) { 0.01 } else { 0.12 }
            );
        }
    }
}

/// A slanted grid of this size with shifted corners, and the settings with which it is treated.
#[derive(Debug, Clone, Copy)]
struct Slanted {
    shift_mm: [f64; 8],
    size_mm: [f64; 2],
    disc_mm: f64,
    /// The step-over as a fraction of the disc's diameter.
    share: f64,
    spacing_mm: f64,
}

impl Slanted {
    /// Rows no farther apart than requested, waypoints no farther apart than requested, and the whole grid covered.
    fn rows_hold_what_they_promise(self) -> Result<(), TestCaseError> {
        let Slanted { shift_mm: shift, size_mm: [w, h], disc_mm, share, spacing_mm } = self;
        let surface = quad([
            [shift[0], shift[1]],
            [w + shift[2], shift[3]],
            [w + shift[4], h + shift[5]],
            [shift[6], h + shift[7]],
        ]);
        let step_over_mm = disc_mm * share;
        let settings = settings(&format!(
            "disc_diameter_mm = {disc_mm}\nstep_over_mm = {step_over_mm}\nwaypoint_spacing_mm = {spacing_mm}"
        ));
        let one = one_grid();
        let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &settings).expect("a plan");
        prop_assert!(plan.coverage > 0.999, "{}", plan.coverage);
        if let Some(step_over) = plan.step_over_mm {
            prop_assert!(step_over.max_mm <= 1.01 * step_over_mm, "{:?} of {}", step_over, step_over_mm);
        }
        for pair in plan.paths[0].waypoints.windows(2).filter(|pair| pair[0].contact && pair[1].contact) {
            let step_mm = tool(&pair[0]).origin().distance_mm(tool(&pair[1]).origin());
            prop_assert!(step_mm <= 1.01 * spacing_mm && step_mm > 1e-6, "{}", step_mm);
        }
        Ok(())
    }
}

/// The smallest grid, disc, step-over and spacing: this case failed once.
#[test]
fn the_smallest_rows_hold_what_they_promise() {
    let smallest =
        Slanted { shift_mm: [0.0; 8], size_mm: [45.0, 45.0], disc_mm: 12.0, share: 0.3, spacing_mm: 3.0 };
    smallest.rows_hold_what_they_promise().expect("as promised");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rows_of_slanted_grids_hold_what_they_promise(
        shift_mm in prop::array::uniform8(-2.5..2.5f64), size_mm in prop::array::uniform2(45.0..90.0f64),
        disc_mm in 12.0..40.0f64, share in 0.3..0.7f64, spacing_mm in 3.0..15.0f64,
    ) {
        Slanted { shift_mm, size_mm, disc_mm, share, spacing_mm }.rows_hold_what_they_promise()?;
    }
}

/// By hand: a patch 56 mm wide on one side and 64 on the other, insets of 3 mm. In the middle half of 54 mm is
/// left. With 2 steps of 10.8 mm the innermost ring would end 24.6 mm before the wide side. There the patch is 62.0
/// mm wide, and the sides of the ring are 62.0 − 6 − 43.2 = 12.8 mm apart. With 3 steps of 7.71 mm they are 61.9 −
/// 6 − 46.3 = 9.6 mm apart there.
#[test]
fn the_innermost_ring_s_sides_keep_the_step_over_where_the_patch_is_widest() {
    let surface = quad([[0.0, 0.0], [100.0, 0.0], [100.0, 64.0], [0.0, 56.0]]);
    let insets = crate::path::raster::Insets::for_disc(&settings(""));
    let rings = crate::path::rings::PatchRings::new(&surface, &WHOLE, insets, 12.0);
    let [low, high] = rings.innermost_sides();
    let closed = rings.closed().expect("rings");
    assert_eq!(closed.len(), 4);
    let innermost = closed.last().expect("one");
    let sides = [points(&surface, &innermost[low]), points(&surface, &innermost[high])];
    let widest_mm = step_overs_mm(&sides[0], &sides[1]).into_iter().fold(0.0, f64::max);
    assert!((9.0..10.5).contains(&widest_mm), "{widest_mm}");
}
