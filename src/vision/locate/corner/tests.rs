use super::*;
use panelprep_cell::recipe::Recipe;

fn settings(corner: &str) -> recipe::Corner {
    let text = format!(
        "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
         [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n[corner]\n{corner}"
    );
    Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}")).corner().clone()
}

/// Draws a dark panel to the right of and below a corner, in front of a light wall. Its edges are turned by
/// `turn_deg`, rounded by `rounding_px` and spread over one pixel; a little unevenness replaces noise.
fn picture(corner: Pixel, turn_deg: f64, rounding_px: f64) -> GrayPicture {
    let (width, height) = (320usize, 240usize);
    let (sin, cos) = turn_deg.to_radians().sin_cos();
    let gray = (0..width * height).map(|i| {
        let (u, v) = ((i % width) as f64 - corner.u, (i / width) as f64 - corner.v);
        let (x, y) = (cos * u + sin * v, cos * v - sin * u);
        let (short_x, short_y) = ((rounding_px - x).max(0.0), (rounding_px - y).max(0.0));
        let inside_px = rounding_px - if x.min(y) < rounding_px { short_x.hypot(short_y) } else { 0.0 };
        let share = (0.5 + inside_px).clamp(0.0, 1.0);
        let uneven = f64::from((i * 7919 % 13) as u8) - 6.0;
        (170.0 - 100.0 * share + uneven).round() as u8
    });
    GrayPicture { width, height, gray: gray.collect() }
}

const SHORT: &str = "rounding_mm = 4\nedge_mm = 12\n";

/// By construction the edges meet at (103.4, 77.8), outside the panel: the corner is rounded by 22 px.
#[test]
fn a_rounded_turned_corner_is_found_to_a_tenth_of_a_pixel() {
    for turn_deg in [-14.0, 0.0, 3.0, 12.0] {
        let corner = Pixel::at(103.4, 77.8);
        let found =
            find(&picture(corner, turn_deg, 22.0), &settings(SHORT), CornerName::TopLeft, 5.0).expect("a corner");
        assert!(found.corner_px.distance_px(corner) < 0.1, "{turn_deg}°: {:?}", found.corner_px);
        // The thesis's corner point lies on the rounding, (√2 − 1)·22 = 9.1 px from the corner. In a turned picture
        // the corner point lies beside the middle of the rounding.
        let mark_px = found.nearest_px.distance_px(corner);
        assert!((8.0..28.0).contains(&mark_px), "{turn_deg}°: {:?}", found.nearest_px);
        assert!(found.edges.iter().all(|edge| edge.rms_px < 0.2 && edge.points > 50), "{:?}", found.edges);
    }
}

/// Tests another corner by turning the picture: `which` selects the corner.
#[test]
fn the_named_corner_is_found() {
    let upright = picture(Pixel::at(103.0, 77.0), 2.0, 10.0);
    let (width, height) = (upright.width, upright.height);
    let turned = GrayPicture { gray: upright.gray.iter().rev().copied().collect(), ..upright };
    let found = find(&turned, &settings(SHORT), CornerName::BottomRight, 5.0).expect("a corner");
    let expected = Pixel::at(width as f64 - 1.0 - 103.0, height as f64 - 1.0 - 77.0);
    assert!(found.corner_px.distance_px(expected) < 0.1, "{:?}", found.corner_px);
}

#[test]
fn what_is_no_corner_is_refused_in_words() {
    let settings = settings(SHORT);
    let nothing = find(&GrayPicture::uniform(320, 240, 200), &settings, CornerName::TopLeft, 5.0);
    assert!(matches!(nothing, Err(CornerError::NoContour { min: 0, max: 110 })), "{nothing:?}");
    let speck = find(&picture(Pixel::at(310.0, 230.0), 0.0, 1.0), &settings, CornerName::TopLeft, 5.0);
    assert!(matches!(speck, Err(CornerError::ContourTooSmall { .. })), "{speck:?}");
    let cut = find(&picture(Pixel::at(-20.0, 77.0), 0.0, 5.0), &settings, CornerName::TopLeft, 5.0);
    assert!(matches!(cut, Err(CornerError::CornerAtBorder { .. })), "{cut:?}");
    let short = find(&picture(Pixel::at(290.0, 77.0), 0.0, 5.0), &settings, CornerName::TopLeft, 5.0);
    assert!(matches!(short, Err(CornerError::EdgeTooShort { .. })), "{short:?}");
}
