//! Tests of recipes as users write them, and of the messages about wrong recipes.

use super::*;
use proptest::prelude::*;

const MINIMAL: &str = "panel = 'door'
locate.box_min_mm = [300, -400, 100]
locate.box_max_mm = [700, 400, 800]
region = {corners_px = [[700, 350], [1250, 350], [1250, 850], [700, 850]], rows = 4, columns = 6}
";

fn recipe_problems(text: &str) -> Vec<String> {
    let problems = Recipe::check("f", text).err().map_or(String::new(), |problems| problems.to_string());
    problems.lines().map(|line| line.trim_start_matches("f:").to_owned()).collect()
}

#[test]
fn the_smallest_recipe_states_panel_box_and_region() {
    let recipe = Recipe::check("f", MINIMAL).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!((recipe.panel(), recipe.region().rows(), recipe.region().columns()), ("door", 4, 6));
    assert_eq!((recipe.process().observation_s(), recipe.inspect().min_break_mm2()), (None, None));
    assert_eq!(
        (recipe.corner().which().for_picture(0), recipe.inspect().method()),
        (CornerName::TopLeft, Method::Film)
    );
    assert_eq!((recipe.path().disc_diameter_mm(), recipe.surface().max_rms_mm()), (30.0, 0.2));
    assert_eq!(
        recipe_problems(""),
        [
            "1: locate: this table is missing; it needs box_min_mm, box_max_mm",
            "1: panel: is missing; this key has no default",
            "1: region: this table is missing; it needs corners_px, rows, columns"
        ]
    );
}

/// The table `[panel]` contains the panel's name, and the outline and held places that a person has drawn.
#[test]
fn a_panel_may_have_an_outline_and_held_edges() {
    let rest = MINIMAL.split_once('\n').map_or("", |(_, rest)| rest);
    let with = |keys: &str| Recipe::check("f", &format!("panel = {{ name = 'door', {keys} }}\n{rest}"));
    let reported =
        with("outline_px = [[1, 1], [90, 1], [90, 70]], held_px = [[[40, 0], [50, 0], [50, 9], [40, 9]]]");
    let recipe = reported.unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(
        (recipe.panel(), recipe.outline().outline_px().len(), recipe.outline().held_px().len()),
        ("door", 3, 1)
    );
    for (keys, words) in [
        ("outline_px = [[1, 1], [90, 1]]", "panel.outline_px: found 2 corners, valid: 3 to 200, or none"),
        (
            "outline_px = [[0, 0], [9, 9], [9, 0], [0, 9]]",
            "panel.outline_px: the outline crosses itself: the sides from corner 1 and from corner 3",
        ),
        (
            "outline_px = [[0, 0], [9, 0], [9, 1]]",
            "panel.outline_px: the outline has an area of 4.5 px², at least 16 px² are needed",
        ),
        (
            "held_px = [[[0, 0], [9, 9], [9, 0], [0, 9]]]",
            "panel.held_px: item 1: the held place crosses itself: the sides from corner 1 and from corner 3",
        ),
        ("outlin_px = []", "panel.outlin_px: unknown key; did you mean outline_px?"),
    ] {
        let problems = with(keys).expect_err("refused").to_string();
        assert!(problems.contains(words), "{keys}: {problems}");
    }
    assert_eq!(
        recipe_problems(&format!("panel = {{ outline_px = [] }}\n{rest}")),
        ["1: panel.name: is missing; this key has no default"]
    );
}

/// A single keyword applies to all taught pictures; a list contains one keyword for each picture.
#[test]
fn corners_are_named_for_each_picture() {
    let which = |corner: &str| {
        let recipe = Recipe::check("f", &format!("{MINIMAL}corner.which = {corner}\n"));
        recipe.unwrap_or_else(|problems| panic!("{problems}")).corner().which()
    };
    assert_eq!(which("'top-right'").for_picture(1), CornerName::TopRight);
    let two = which("['top-left', 'bottom-right']");
    assert_eq!((two.for_picture(0), two.for_picture(1)), (CornerName::TopLeft, CornerName::BottomRight));
    assert!(Recipe::check("f", &format!("{MINIMAL}corner.which = []\n")).is_err());
}

#[test]
fn each_mistake_is_named() {
    let cases = [
        ("locate.max_shift_cm = 6", "locate.max_shift_cm: unknown key; this length is in mm: write max_shift_mm"),
        ("path.feed_m_s = 0.1", "path.feed_m_s: unknown key; this speed is in mm/s: write feed_mm_s"),
        ("path.stepover_mm = 9", "path.stepover_mm: unknown key; did you mean step_over_mm?"),
        ("path.min_break_mm2 = 9", "path.min_break_mm2: unknown key here; did you mean inspect.min_break_mm2?"),
        (
            "path.step_over_mm = 31",
            "path.step_over_mm: found 31 (limit 30, disc_diameter_mm): a larger distance leaves untreated stripes",
        ),
        (
            "path.disc_diameter_mm = 10",
            "path.step_over_mm: found 12 (limit 10, disc_diameter_mm): a larger distance leaves untreated stripes",
        ),
        (
            "path.reference_axis = [0, 0, 0.001]",
            "path.reference_axis: found a direction of length 0.001, valid: 0.1 to 1.8, or [0, 0, 0]",
        ),
        (
            "removal = {target_um = 30, max_um = 30, force_n = 20}",
            "removal.max_um: found 30, must be greater than target_um, 30",
        ),
        (
            "removal = {target_um = 30, max_um = 60, force_n = 20, min_feed_mm_s = 61}",
            "removal.min_feed_mm_s: found 61 (limit 60, path.feed_mm_s)",
        ),
        (
            "path.force_n = 15\nremoval = {target_um = 30, max_um = 60, force_n = 20}",
            "removal.force_n: has no effect: the tool presses with path.force_n = 15 N; remove this key",
        ),
        (
            "removal = {target_um = 30, max_um = 60}",
            "removal.force_n: is missing; state the force of the tool on the panel in N, or path.force_n for a compliant tool",
        ),
        (
            "removal = {target_um = 30, max_um = 60, force_n = 20, method = 'even'}",
            "removal.method: found the text \"even\", valid: \"constant\" or \"scheduled\"",
        ),
        ("treat.by = 'cell'", "treat.by: found the text \"cell\", valid: \"grid\" or \"break\""),
        ("treat.margin_mm = 20", "treat.margin_mm: has no effect without by = \"break\""),
        (
            "treat = {by = 'break', margin_mm = 16.9}",
            "treat.margin_mm: found 16.9 (at least 17: half of path.disc_diameter_mm, and uncertainty_mm): a break at \
             the area's border would be under the disc for too short a time",
        ),
        (
            "treat = {by = 'break', margin_mm = 17, uncertainty_mm = 2.5}",
            "treat.margin_mm: found 17 (at least 17.5: half of path.disc_diameter_mm, and uncertainty_mm): a break at \
             the area's border would be under the disc for too short a time",
        ),
        ("treat.margin = 17", "treat.margin: unknown key; this length is in mm: write margin_mm"),
        ("path.max_dwell_ratio = 1", "path.max_dwell_ratio: found 1, valid: a number from 1.1 to 20"),
        ("path.max_dwel_ratio = 2", "path.max_dwel_ratio: unknown key; did you mean max_dwell_ratio?"),
        ("locate.min_overlap = 90", "locate.min_overlap: found 90, valid: a number from 0 to 1"),
        (
            "corner.which = 'top left'",
            "corner.which: found the text \"top left\", valid: \"top-left\" or \"top-right\" or \"bottom-right\" or \"bottom-left\"",
        ),
        ("corner.panel_gray_min = 110", "corner.panel_gray_max: must exceed panel_gray_min, 110"),
        ("inspect.method = 'films'", "inspect.method: found the text \"films\", valid: \"film\" or \"thesis\""),
        (
            "inspect.channel_weights = [0, 0, 0]",
            "inspect.channel_weights: at least one channel must have a weight of 0.01 or more",
        ),
        (
            "inspect.masked_px = [[[1, 2], [3, 4], [5, 6]]]",
            "inspect.masked_px: item 1: found a list of 3, valid: a list of 4 items",
        ),
        ("inspect.median_px = 4", "inspect.median_px: found 4, valid: an odd number"),
        (
            "inspect.hsv_max = [180, 255, 255]",
            "inspect.hsv_max: found hue 180, valid: 0 to 179 (half of the hue angle in degrees)",
        ),
        (
            "inspect.hsv_max = [179, 256, 255]",
            "inspect.hsv_max: item 2: found 256, valid: a whole number from 0 to 255",
        ),
        (
            "inspect.hsv_min = [0, 9, 0]\ninspect.hsv_max = [179, 8, 255]",
            "inspect.hsv_max: must not be below hsv_min in any channel",
        ),
        (
            "process.max_passes_per_grid = 0",
            "process.max_passes_per_grid: found 0, valid: a whole number from 1 to 10",
        ),
        (
            "process.max_passes_per_grid = 3\nprocess.max_passes_per_part = 2",
            "process.max_passes_per_part: found 2, must be at least max_passes_per_grid, 3",
        ),
    ];
    for (mistake, message) in cases {
        let said = recipe_problems(&format!("{MINIMAL}{mistake}"));
        let without_line: Vec<&str> =
            said.iter().filter_map(|said| said.split_once(": ")).map(|(_, said)| said).collect();
        assert_eq!(without_line, [message], "{mistake}");
    }
}

#[test]
fn the_corners_of_a_region_are_in_order() {
    let with_corners = |corners: &str| {
        recipe_problems(&MINIMAL.replace("[[700, 350], [1250, 350], [1250, 850], [700, 850]]", corners))
    };
    let round = "4: region.corners_px: the four corners must be in order around a convex region, and no three of them may lie on one line";
    assert_eq!(with_corners("[[700, 350], [1250, 850], [1250, 350], [700, 850]]"), [round], "crossed");
    assert_eq!(with_corners("[[700, 350], [900, 350], [1250, 350], [700, 850]]"), [round], "on a line");
    assert_eq!(with_corners("[[700, 350], [800, 400], [1250, 350], [900, 850]]"), [round], "dented");
    assert!(with_corners("[[700, 850], [1250, 850], [1250, 350], [700, 350]]").is_empty(), "either way round");
    assert_eq!(
        with_corners("[[700, 350], [1250, 350], [1250, 850]]"),
        ["4: region.corners_px: found a list of 3, valid: a list of 4 items"]
    );
}

#[test]
fn a_search_box_has_a_size() {
    assert_eq!(
        recipe_problems(&MINIMAL.replace("[700, 400, 800]", "[700, 400, 100]")),
        ["3: locate.box_max_mm: [700, 400, 100] must exceed box_min_mm [300, -400, 100] in every axis"]
    );
}

proptest! {
    #[test]
    fn no_text_causes_a_panic(text in "(?s).{0,200}") {
        let _ = Recipe::check("f", &text);
        let _ = Recipe::check("f", &format!("{MINIMAL}{text}"));
    }
}

/// Without the table, whole grids are sanded. Expected values, calculated by hand: the default margin is half of the
/// disc's 30 mm plus the uncertainty of 2 mm; with a disc of 50 mm it is 27 mm.
#[test]
fn breaks_are_widened_by_the_disc_and_their_uncertainty() {
    let recipe = |more: &str| Recipe::check("f", &format!("{MINIMAL}{more}")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(recipe("").treat().by(), TreatBy::Grid);
    let widened_mm = |more: &str| {
        let recipe = recipe(more);
        assert_eq!(recipe.treat().by(), TreatBy::Break);
        recipe.treat().widened_mm(recipe.path())
    };
    assert_eq!(widened_mm("treat.by = 'break'"), 17.0);
    assert_eq!(widened_mm("treat.by = 'break'\npath.disc_diameter_mm = 50"), 27.0);
    assert_eq!(widened_mm("treat = {by = 'break', margin_mm = 25, uncertainty_mm = 5}"), 25.0);
}

/// Without the table, no removal is required.
#[test]
fn the_removal_table_is_optional() {
    let recipe = |text: &str| Recipe::check("f", text).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(recipe(MINIMAL).removal(), None);
    let stated = recipe(&format!("{MINIMAL}removal = {{target_um = 30, max_um = 60, force_n = 20}}\n"));
    let removal = stated.removal().expect("stated");
    assert_eq!(
        (removal.method(), removal.even_percent(), removal.min_feed_mm_s()),
        (RemovalMethod::Constant, 20.0, 5.0)
    );
}

/// The pose of a drawing is stated directly or by datum points. Expected values, calculated by hand: the drawing's x
/// axis is parallel to the base's y axis, and its origin is (560, -200, 360).
#[test]
fn a_drawing_has_its_place_by_a_pose_or_by_points() {
    let with = |keys: &str| format!("{MINIMAL}[nominal]\n{keys}\n");
    let place = |keys: &str| {
        let recipe = Recipe::check("f", &with(keys)).unwrap_or_else(|problems| panic!("{problems}"));
        *recipe.nominal().expect("a drawing")
    };
    let pose = "base_from_drawing = { x_mm = 560, y_mm = -200, z_mm = 360, a_deg = 90, b_deg = 0, c_deg = 0 }";
    let points = "datums_drawing_mm = [[0, 0, 0], [400, 0, 0], [0, 250, 0]]\n\
                  datums_base_mm = [[560, -200, 360], [560, 200.3, 360], [310, -200, 360]]";
    let corner = panelprep_base::geometry::Point::at(400.0, 250.0, 0.0);
    for place in [place(pose), place(points)] {
        let placed = place.base_from_drawing() * corner;
        assert!(placed.distance_mm(panelprep_base::geometry::Point::at(310.0, 200.0, 360.0)) < 0.3, "{placed:?}");
    }
    assert_eq!(place(pose).residual_mm(), None);
    // Point 2 is measured 0.3 mm too far away. A shift of all three points by a third of this error leaves a residual
    // of 0.2 mm; a rotation reduces it further.
    let residual_mm = place(points).residual_mm().expect("of points");
    assert!((0.15..=0.2).contains(&residual_mm), "{residual_mm}");
    assert!(Recipe::check("f", MINIMAL).is_ok_and(|recipe| recipe.nominal().is_none()));
    for (keys, words) in [
        ("", "nominal.base_from_drawing: is missing: state the pose of the drawing's frame"),
        (
            &pose.replace("x_mm = 560", "x_mm = 8001"),
            "nominal.base_from_drawing: the drawing's origin lies 8001 mm",
        ),
        (&format!("{pose}\n{points}")[..], "nominal.base_from_drawing: both a pose and datum points are stated"),
        (
            &points.replace("200.3", "203"),
            "nominal.datums_base_mm: point 2 is 1.91 mm from its position in the drawing",
        ),
        (
            &points.replace("[0, 250, 0]", "[800, 10, 0]"),
            "the points lie within 5.0 mm of a line (at least 20.0 mm are needed)",
        ),
        (&points.replace(", [310, -200, 360]", ""), "found 2 points, and 3 in datums_drawing_mm"),
        (
            "datums_drawing_mm = [[0, 0, 0], [400, 0, 0], [0, 400, 0]]\n\
             datums_base_mm = [[500, 0, 300], [900, 0, 300], [500, 400, 300]]",
            "the points also fit in the order 1, 3, 2",
        ),
    ] {
        let found = recipe_problems(&with(keys)).join("\n");
        assert!(found.contains(words), "{found}\nshould say: {words}");
    }
}
