//! Tests of the cell through its public functions, in small pictures.

use super::*;
use panelprep_base::geometry::{Frame, Point, polygon};

fn in_search_box<F: Frame>(point: &Point<F>) -> bool {
    let [low, high] = SEARCH_BOX_MM;
    (0..3).all(|axis| (low[axis]..high[axis]).contains(&point.mm[axis]))
}

fn panel_points(cell: &Cell, cloud: &OrganizedCloud<Camera>) -> usize {
    cloud
        .transformed(&cell.calibrated_base_from_camera())
        .valid_points()
        .filter(|(_, point)| in_search_box(point))
        .count()
}

/// Expected values, calculated by hand. 300,000 points in the full picture are 18,750 points at a quarter of its width
/// and height. The panel has about 334 × 228 mm without the cut corner, 73,000 mm², seen at 33° with 2.28 px/mm.
#[test]
fn a_panel_has_about_300_000_points() {
    for seed in 0..4 {
        let cell = Cell::new(seed, Scene::Good, 4);
        let taught = panel_points(&cell, &cell.taught_scan());
        assert!((17_500..21_000).contains(&taught), "{taught}");
        let displaced = panel_points(&cell, &cell.scan());
        assert!((16_000..22_500).contains(&displaced), "{displaced}");
    }
}

#[test]
fn scenes_differ_in_the_objects_in_front_of_the_fixture() {
    let cell = |scene| Cell::new(3, scene, 4);
    let (good, clean) = (cell(Scene::Good), cell(Scene::Clean));
    let (empty, wrong) = (cell(Scene::NoPanel), cell(Scene::WrongPanel));
    assert_eq!(panel_points(&empty, &empty.scan()), 0);
    assert!(panel_points(&wrong, &wrong.scan()) > 10_000);
    assert_eq!(good.scan().picture(), clean.scan().picture(), "grease does not show on a dry panel");
    // The taught panel is the same in all scenes; the panel of the scene "wrong panel" differs from it by millimetres.
    assert_eq!(good.taught_scan().picture(), wrong.taught_scan().picture());
    let (right, other) = (good.truth(), wrong.truth());
    let off_mm = other.surface_points().iter().map(|&point| right.distance_mm(point).abs()).fold(0.0, f64::max);
    assert!(off_mm > 5.0, "{off_mm}");
    assert!(clean.truth().spots.is_empty() && clean.film().broken_pixels(60.0).count() == 0);
    assert!(!good.truth().spots.is_empty());
}

/// The plate is at X = 665 mm. A point's error in X is its error along the ray times the cosine of incidence, 0.055 mm
/// · (z/700)², which does not depend on the incidence.
#[test]
fn white_noise_of_the_scanner() {
    let cell = Cell::new(1, Scene::NoPanel, 4);
    let base_from_camera = cell.truth().base_from_camera;
    let errors: Vec<f64> = cell
        .scan()
        .valid_points()
        .filter_map(|(_, point)| {
            let error_mm = (base_from_camera * point).mm.x - 665.0;
            (error_mm.abs() < 2.0).then(|| error_mm / (0.055 * (point.mm.z / 700.0).powi(2)))
        })
        .collect();
    let rms = rms(&errors);
    assert!(errors.len() > 50_000 && (rms - 1.0).abs() < 0.01, "{rms}");
    assert!((errors.iter().sum::<f64>() / errors.len() as f64).abs() < 0.01);
}

/// Noise of 0.06 mm at the nodes is 0.06 · 26/35 = 0.0446 mm overall. The error along the ray is the distance divided
/// by the cosine of incidence. The known variance of the white noise is subtracted.
#[test]
fn correlated_noise_of_the_scanner() {
    let cell = Cell::new(1, Scene::Clean, 8);
    let truth = cell.truth();
    let (mut sum, mut count) = (0.0, 0);
    for shot in 0..60 {
        let camera_from_panel = truth.base_from_camera.inverse() * scene::nominal();
        let scan = cell.scan_at(&scene::nominal(), shot);
        for (_, point) in scan.valid_points().step_by(5) {
            let on_panel = camera_from_panel.inverse() * point;
            let distance_mm = truth.distance_mm(on_panel);
            if distance_mm.abs() > 2.0 || truth.outline_distance_mm(on_panel) > -8.0 {
                continue;
            }
            let toward = (camera_from_panel * truth.normal(on_panel))
                .angle_between(Point::<Camera>::at(0.0, 0.0, 0.0) - point);
            let cos = toward.to_rad().cos();
            let white_mm = 0.055 * (point.mm.z / 700.0).powi(2) / cos;
            sum += (distance_mm / cos).powi(2) - white_mm * white_mm;
            count += 1;
        }
    }
    let rms_mm = (sum / f64::from(count)).sqrt();
    assert!((rms_mm - 0.0446).abs() < 0.003, "{rms_mm}");
}

fn rms(numbers: &[f64]) -> f64 {
    (numbers.iter().map(|n| n * n).sum::<f64>() / numbers.len() as f64).sqrt()
}

/// Expected fractions: of the pixels within 1 px of the edge with a lit surface behind it, 75 % are missing and 10 %
/// have flying points. Of all other pixels, 0.2 % of the lit ones and all unlit ones are missing.
#[test]
fn edges_have_missing_and_flying_points() {
    let cell = Cell::new(2, Scene::Clean, 2);
    let scan = cell.taught_scan();
    let panel = Some((&cell.taught, &scene::nominal()));
    let (view, projector) = (cell.scanner_view(panel), Projector::new(&scene::base_from_camera(), panel, &[]));
    let (mut edge, mut missing, mut between, mut others, mut dropped, mut dark) = (0, 0, 0, 0, 0, 0);
    for row in 0..scan.height() {
        view.cast_row(row, |column, sight| {
            let point = scan.point(column, row);
            let inside = sight.panel.is_some_and(|panel| panel.edge_px <= -1.0);
            let behind = sight.background.depth_mm.filter(|_| !inside);
            if behind.is_some_and(|depth_mm| !projector.is_lit(&(sight.ray * depth_mm), None)) {
                dark += 1;
                assert!(point.is_none() || sight.panel.is_some_and(|panel| panel.edge_px < 0.0), "{column}, {row}");
                return;
            }
            match sight.panel.filter(|panel| panel.edge_px.abs() < 1.0) {
                Some(panel) => {
                    edge += 1;
                    missing += usize::from(point.is_none());
                    let behind = sight.background.depth_mm.expect("the plate is behind the panel");
                    between +=
                        usize::from(point.is_some_and(|p| p.mm.z > panel.depth_mm + 2.0 && p.mm.z < behind - 2.0));
                }
                None if sight.background.depth_mm.is_some() => {
                    others += 1;
                    dropped += usize::from(point.is_none());
                }
                None => {}
            }
        });
    }
    let share = |part: usize, whole: usize| part as f64 / whole as f64;
    assert!(dark > 10_000 && edge > 1_000, "{dark} dark, {edge} at the edge");
    assert!((share(missing, edge) - 0.75).abs() < 0.04, "{}", share(missing, edge));
    assert!((share(between, edge) - 0.095).abs() < 0.02, "{}", share(between, edge));
    assert!((share(dropped, others) - 0.002).abs() < 0.0003, "{}", share(dropped, others));
}

#[test]
fn results_are_bit_equal_for_any_number_of_threads() {
    let render = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let cell = Cell::new(9, Scene::Good, 8);
            let scan = cell.scan();
            let bits: Vec<u32> = scan.raw_points_mm().as_flattened().iter().map(|mm| mm.to_bits()).collect();
            let corner = cell.flange_picture(&cell.corner_views()[0].base_from_flange, PanelPosition::Nominal);
            (bits, scan.picture(), corner, cell.film().picture(9.5))
        })
    };
    assert!(render(1) == render(2));
}

#[test]
fn each_seed_shot_and_time_has_its_own_noise() {
    let cell = Cell::new(1, Scene::Good, 8);
    assert_ne!(cell.scan().picture(), Cell::new(2, Scene::Good, 8).scan().picture());
    let nominal = scene::nominal();
    assert_ne!(cell.scan_at(&nominal, 0).picture(), cell.scan_at(&nominal, 1).picture());
    assert_eq!(cell.scan_at(&nominal, 4).picture(), cell.scan_at(&nominal, 4).picture());
    assert_ne!(cell.film().picture(0.2), cell.film().picture(0.4));
}

/// The panel fills the quadrant opposite to the corner's name; the grey level 110 separates the panel from the
/// background.
#[test]
fn corner_pictures_show_the_panel_in_one_quadrant() {
    let cell = Cell::new(4, Scene::Good, 4);
    for view in cell.corner_views() {
        for (pose, place) in [
            (view.base_from_flange, PanelPosition::Nominal),
            (cell.displaced_corner_pose(&view), PanelPosition::Displaced),
        ] {
            let gray = cell.flange_picture(&pose, place).to_gray();
            let (left, top) = (view.name.ends_with("left"), view.name.starts_with("top"));
            let camera_from_panel = (pose * cell.truth().flange_from_camera).inverse()
                * if place == PanelPosition::Nominal { scene::nominal() } else { cell.truth().base_from_panel };
            let corner =
                cell.flange_camera().project_inside(camera_from_panel * view.corner).expect("in the picture");
            for (right, down) in [(false, false), (true, false), (false, true), (true, true)] {
                let step = |positive: bool| if positive { 45.0 } else { -45.0 };
                let pixel = Pixel::at(corner.u + step(right), corner.v + step(down));
                let (column, row) = pixel.nearest_whole(gray.width, gray.height).expect("near the middle");
                let dark = gray.gray[row * gray.width + column] < 110;
                assert_eq!(dark, right == left && down == top, "{} at {pixel:?}", view.name);
            }
        }
    }
}

#[test]
fn the_region_lies_well_inside_in_grids_of_about_45_mm() {
    for seed in 0..5 {
        let cell = Cell::new(seed, Scene::Good, 4);
        let region = cell.region();
        let inner = cell.taught.outline().inset_corners(REGION_INSET_MM);
        let side = |from: usize, to: usize, parts: usize| (inner[from] - inner[to]).norm() / parts as f64;
        for mm in [side(4, 3, region.columns), side(0, 1, region.columns), side(4, 0, region.rows)] {
            assert!((40.0..53.0).contains(&mm), "seed {seed}: {mm}");
        }
        let scan = cell.taught_scan();
        for corner in region.corners_px {
            let (column, row) = corner.nearest_whole(scan.width(), scan.height()).expect("in the picture");
            let near = [(column, row), (column + 1, row), (column, row + 1)];
            let point = near.into_iter().find_map(|(column, row)| scan.point(column, row)).expect("a point");
            let depth_mm = cell.truth().outline_distance_mm(Point::new((cell.truth().base_from_camera * point).mm));
            assert!((-18.0..-12.0).contains(&depth_mm), "seed {seed}: {depth_mm}");
        }
    }
}

#[test]
fn breaks_open_and_grow_until_they_fill_their_spots() {
    let cell = Cell::new(6, Scene::Good, 2);
    let (film, truth) = (cell.film(), cell.truth());
    let first_s = truth.spots.iter().map(|spot| spot.breaks_at_s).fold(f64::INFINITY, f64::min);
    let last_s = truth.spots.iter().map(|spot| spot.grown_at_s).fold(0.0, f64::max);
    assert!(first_s > WET_FROM_S && last_s < WET_FROM_S + 60.0);
    assert_eq!(film.broken_pixels(first_s - 0.1).count(), 0);
    let counts: Vec<usize> = (0..80).map(|second| film.broken_pixels(f64::from(second)).count()).collect();
    assert!(counts.windows(2).all(|pair| pair[0] <= pair[1]));
    assert_eq!(counts[79], film.broken_pixels(last_s + 0.1).count());
    // The final mask agrees with the projected outlines, except for pixels on their edges.
    let camera_from_panel = truth.base_from_camera.inverse() * truth.base_from_panel;
    let project = |&point: &Point<Panel>| cell.scanner().project(camera_from_panel * point).expect("in front");
    let outlines: Vec<Vec<Pixel>> =
        truth.spots.iter().map(|spot| spot.outline.iter().map(project).collect()).collect();
    let area_px2: f64 = outlines.iter().map(|outline| polygon::signed_area_px2(outline).abs()).sum();
    assert!((counts[79] as f64 / area_px2 - 1.0).abs() < 0.03, "{} px, {area_px2}", counts[79]);
    let mask = film.broken_pixels(79.0);
    let inside = (0..mask.inside.len()).filter(|&i| mask.inside[i]).filter(|i| {
        let pixel = Pixel::at((i % mask.width) as f64, (i / mask.width) as f64);
        outlines.iter().any(|outline| polygon::contains(outline, pixel))
    });
    assert!(inside.count() as f64 > 0.97 * counts[79] as f64);
}

/// A broken film has the dry colour. An unbroken film has 0.58 to 0.63 of the dry colour, less in streaks. The fixture
/// does not change.
#[test]
fn a_whole_film_is_darker_than_a_broken_film() {
    let cell = Cell::new(6, Scene::Good, 4).with_films(FilmSpec::CALM_FILM);
    let (film, mask) = (cell.film(), cell.film().broken_pixels(80.0));
    let (dry, wet) = (film.picture(0.0).to_gray(), film.picture(80.0).to_gray());
    let mut means = [(0.0, 0.0, 0); 3];
    for index in 0..mask.inside.len() {
        let kind = if mask.inside[index] { 0 } else { 1 + usize::from(dry.gray[index] > 130) };
        // Excludes pixels of the hall and of the panel's edge.
        if kind == 1 && !(63..90).contains(&dry.gray[index]) {
            continue;
        }
        means[kind].0 += f64::from(dry.gray[index]);
        means[kind].1 += f64::from(wet.gray[index]);
        means[kind].2 += 1;
    }
    let ratio = |kind: usize| means[kind].1 / means[kind].0;
    assert!(means.iter().all(|mean| mean.2 > 100));
    assert!(ratio(0) > 0.95 && ratio(0) < 1.01, "{}", ratio(0));
    assert!((0.55..0.64).contains(&ratio(1)), "{}", ratio(1));
    assert!((ratio(2) - 1.0).abs() < 1e-3, "{}", ratio(2));
}

/// The same panel at several poses: shape, grease and taught scan do not change.
#[test]
fn another_pose_shows_the_same_panel() {
    let at = |place: u32| Cell::new(3, Scene::Good, 8).with_pose(place);
    let (first, second) = (at(0), at(2));
    assert_eq!(first.scan().picture(), Cell::new(3, Scene::Good, 8).scan().picture());
    assert_eq!(first.taught_scan().picture(), second.taught_scan().picture());
    let (truth, other) = (first.truth(), second.truth());
    let way = truth.base_from_panel.inverse() * other.base_from_panel;
    assert!(way.rotation_angle().0 > 0.5, "{}", way.rotation_angle());
    assert_eq!(truth.spots.len(), other.spots.len());
    assert!(truth.spots.iter().zip(&other.spots).all(|(a, b)| a.centre.distance_mm(b.centre) < 1e-9));
    let off_mm = |p| truth.distance_mm(p).abs();
    assert!(other.surface_points().into_iter().map(off_mm).fold(0.0, f64::max) < 1e-6);
    let [low, high] = SEARCH_BOX_MM;
    for place in 0..50 {
        let truth = at(place).truth();
        let inside = |point: Point<Base>| (0..3).all(|axis| (low[axis]..high[axis]).contains(&point.mm[axis]));
        assert!(truth.surface_points().iter().all(|&point| inside(truth.base_from_panel * point)), "{place}");
    }
}
