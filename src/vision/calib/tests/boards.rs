//! Rendered boards at full size: corners, lens and distortion compared with the true values.

use crate::calib::intrinsics::{Options, View, calibrate};
use crate::calib::{Board, detect, gate, marker_cells};
use panelprep_base::geometry::{Frame, GrayPicture, PinholeCamera};
use panelprep_base::verdict::Verdict;
use panelprep_sim::{BoardCell, BoardPrint, BoardShot, Marker, RobotNoise};

const NO_NOISE: RobotNoise = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };

fn print_of(board: &Board) -> BoardPrint {
    let Some(charuco) = board.markers() else {
        return BoardPrint::chessboard(board.columns(), board.rows(), board.square_mm());
    };
    let (squares, cells) = (board.marker_squares(), marker_cells(board).expect("a dictionary"));
    let markers = squares.iter().zip(cells).map(|(&(column, row), cells)| Marker { column, row, cells });
    BoardPrint {
        columns: board.columns() + 1,
        rows: board.rows() + 1,
        square_mm: board.square_mm(),
        is_first_square_white: squares.contains(&(0, 0)),
        marker_mm: charuco.marker_mm,
        markers: markers.collect(),
    }
}

/// Returns the root mean square and the maximum distance of the detected corners from their true positions, px, and the
/// number of corners.
fn corner_error<C: Frame>(
    cell: &BoardCell,
    camera: &PinholeCamera,
    shot: &BoardShot<C>,
    board: &Board,
) -> (f64, f64, usize) {
    let found = detect::detect("picture", &cell.picture(camera, shot), board, None).expect("a board");
    let errors: Vec<f64> = found
        .corners
        .iter()
        .map(|(q, pixel)| camera.project(shot.camera_from_board * *q).expect("in front").distance_px(*pixel))
        .collect();
    let square: f64 = errors.iter().map(|error| error * error).sum();
    ((square / errors.len() as f64).sqrt(), errors.iter().copied().fold(0.0, f64::max), errors.len())
}

#[test]
fn chessboard_corners_are_located_to_a_hundredth_of_a_pixel() {
    let board = Board::parse("9x6", 25.0).expect("a board");
    let cell = BoardCell::new(1, print_of(&board), NO_NOISE);
    for shot in &cell.fixed_shots(2) {
        let (rms, largest, count) = corner_error(&cell, &cell.scanner(), shot, &board);
        assert!(rms < 0.02 && largest < 0.06 && count == 54, "{rms} px rms, {largest} px, {count}");
    }
}

/// OpenCV 4.6 changed the pattern of boards with an even number of rows: both patterns are read, and neither is
/// confused with the other.
#[test]
fn charuco_of_both_patterns_is_read() {
    let boards = ["charuco:8x6:18:4X4_50", "charuco:8x6:18:4X4_50:legacy"];
    let boards = boards.map(|text| Board::parse(text, 25.0).expect("a board"));
    for board in &boards {
        let cell = BoardCell::new(2, print_of(board), NO_NOISE);
        let shot = cell.flange_shots(1)[0];
        let (rms, largest, count) = corner_error(&cell, &cell.flange_camera(), &shot, board);
        assert!(rms < 0.02 && largest < 0.06 && count == 35, "{rms} px rms, {largest} px, {count}");
    }
    let cell = BoardCell::new(2, print_of(&boards[0]), NO_NOISE);
    let picture = cell.picture(&cell.flange_camera(), &cell.flange_shots(1)[0]);
    assert!(detect::detect("new.png", &picture, &boards[1], None).is_err(), "another pattern is no board");
}

/// If a picture shows a ChArUco board of another layout or dictionary, or is mirrored, the message states the correct
/// `--board`, or that the picture is mirrored.
#[test]
fn another_charuco_board_is_reported_with_the_correct_option() {
    let printed = "charuco:8x6:18:4X4_50:legacy";
    let board = |text: &str| Board::parse(text, 25.0).expect("a board");
    let cell = BoardCell::new(2, print_of(&board(printed)), NO_NOISE).with_reduction(2);
    let picture = cell.picture(&cell.flange_camera(), &cell.flange_shots(1)[0]);
    let told = |picture: &GrayPicture, text: &str| {
        detect::detect("it.png", picture, &board(text), None).expect_err("another board").to_string()
    };
    assert!(detect::detect("it.png", &picture, &board(printed), None).is_ok());
    let pattern = told(&picture, "charuco:8x6:18:4X4_50");
    assert!(pattern.contains("(:legacy); use --board charuco:8x6:18:4X4_50:legacy"), "{pattern}");
    let exchanged = told(&picture, "charuco:6x8:18:4X4_50:legacy");
    assert!(exchanged.contains("--board charuco:8x6:18:4X4_50:legacy"), "{exchanged}");
    let dictionary = told(&picture, "charuco:8x6:18:6X6_250:legacy");
    assert!(dictionary.contains("the dictionary 4X4_1000"), "{dictionary}");
    let gray = picture.gray.chunks(picture.width).flat_map(|row| row.iter().rev().copied()).collect();
    let mirrored = told(&GrayPicture { gray, ..picture.clone() }, printed);
    assert!(mirrored.contains("mirrored"), "{mirrored}");
}

#[test]
fn no_board_and_another_board_are_reported() {
    let board = Board::parse("9x6", 25.0).expect("a board");
    let empty = GrayPicture::uniform(640, 480, 90);
    let error = detect::detect("empty.png", &empty, &board, None).expect_err("no board").to_string();
    assert!(error.contains("empty.png shows no board with 9×6"), "{error}");
    let unknown = Board::parse("charuco:8x6:18:9X9_50", 25.0).expect_err("no dictionary").to_string();
    assert!(unknown.contains("7X7_1000"), "{unknown}");
}

/// In the second of these pictures the search adds a column beyond the board, which is then compared with the grey
/// levels.
#[test]
fn a_grid_larger_than_the_board_is_not_accepted() {
    let board = Board::parse("9x6", 25.0).expect("a board");
    let cell = BoardCell::new(3, print_of(&board), NO_NOISE);
    for shot in &cell.fixed_shots(3) {
        let (rms, largest, count) = corner_error(&cell, &cell.scanner(), shot, &board);
        assert!(rms < 0.02 && largest < 0.06 && count == 54, "{}: {rms} px rms, {largest} px, {count}", shot.index);
        let other = Board::parse("10x6", 25.0).expect("a board");
        let told =
            detect::detect("it.png", &cell.picture(&cell.scanner(), shot), &other, None).expect_err("another");
        assert!(!told.to_string().is_empty(), "never taken for a board with a column more");
    }
}

/// The 5×4 board in a picture of full size. If a board with more or fewer squares is searched, the error names the
/// board in the picture. A part of a board is never mistaken for the whole. A search for the board with columns and
/// rows exchanged finds the same corners.
#[test]
fn another_board_is_reported_and_a_part_is_not_accepted() {
    let board = |text: &str| Board::parse(text, 40.0).expect("a board");
    let cell = BoardCell::new(6, print_of(&board("5x4")), NO_NOISE);
    let picture = cell.picture(&cell.scanner(), &cell.fixed_shots(1)[0]);
    for other in ["6x4", "9x6", "4x4", "4x3", "3x3"] {
        let told = detect::detect("it.png", &picture, &board(other), None).expect_err(other).to_string();
        assert!(told.starts_with(&format!("it.png: found a 5x4 board, expected {other}")), "{told}");
    }
    let [along, across] = ["5x4", "4x5"].map(|text| detect::detect("it.png", &picture, &board(text), None));
    let pixels = |found: Result<detect::DetectedCorners, _>| -> Vec<[i64; 2]> {
        let corners = found.expect("the board").corners;
        let mut all: Vec<_> = corners.iter().map(|(_, p)| [p.u, p.v].map(|n| (100.0 * n).round() as i64)).collect();
        all.sort_unstable();
        all
    };
    assert_eq!(pixels(along), pixels(across));
}

/// Calculated from synthetic corners of 14 pictures with 0.05 px of noise: the focal length is correct to 0.1 %, and a
/// picture with shifted corners is excluded.
#[test]
fn the_true_lens_is_found_and_a_bad_picture_is_excluded() {
    let board = Board::parse("9x6", 25.0).expect("a board");
    let cell = BoardCell::new(3, print_of(&board), NO_NOISE);
    let truth = cell.flange_camera();
    let mut views: Vec<View> = cell
        .flange_shots(14)
        .iter()
        .map(|shot| View { name: format!("{}.png", shot.index), corners: cell.corners(&truth, shot, 0.05) })
        .collect();
    for (index, (_, pixel)) in views[4].corners.iter_mut().enumerate() {
        pixel.u += if index % 2 == 0 { 1.5 } else { -1.5 };
    }
    let found = calibrate((truth.width_px, truth.height_px), &views, Options::default()).expect("a camera");
    let aside: Vec<_> =
        found.views.iter().filter(|view| view.exclusion_reason.is_some()).map(|view| &*view.name).collect();
    assert_eq!(aside, ["4.png"]);
    assert!((found.camera.fx_px / truth.fx_px - 1.0).abs() < 1e-3, "{}", found.camera.fx_px);
    assert!((found.camera.cx_px - truth.cx_px).abs() < 5.0 && found.rms_px < 0.09, "{:?}", found.camera);
    let off = (found.camera.fx_px - truth.fx_px).abs() / found.deviations[0];
    assert!(off < 4.0, "{off} standard deviations");
    let kept =
        calibrate((truth.width_px, truth.height_px), &views, Options { keep_all_pictures: true, model: None })
            .expect("a camera");
    assert!(kept.views.iter().all(|view| view.exclusion_reason.is_none()) && kept.rms_px > 0.3, "{}", kept.rms_px);
    let few = calibrate((truth.width_px, truth.height_px), &views[..3], Options::default()).expect_err("three");
    assert!(few.to_string().contains("4 are needed"));
}

/// Without tilt the lens is not determined, and the verdict states this.
#[test]
fn pictures_without_tilt_are_reviewed() {
    let board = Board::parse("9x6", 25.0).expect("a board");
    let cell = BoardCell::new(5, print_of(&board), NO_NOISE);
    let camera = cell.flange_camera();
    let flat = |index: u32| {
        let place = nalgebra::Isometry3::translation(-100.0 + f64::from(index) * 4.0, -60.0, 540.0);
        let mut shot = cell.flange_shots(1)[0];
        (shot.index, shot.camera_from_board) =
            (u64::from(index), panelprep_base::geometry::Rigid::from_isometry_unchecked(place));
        View { name: index.to_string(), corners: cell.corners(&camera, &shot, 0.05) }
    };
    let views: Vec<View> = (0..10).map(flat).collect();
    let found = calibrate((camera.width_px, camera.height_px), &views, Options::default()).expect("some camera");
    let judged = gate::intrinsics(&found);
    assert_eq!(judged.verdict, Verdict::Review);
    assert!(judged.reasons.iter().any(|reason| reason.code == "tilt"), "{judged:?}");
    assert!(judged.reasons.iter().any(|reason| reason.code == "coverage"), "{judged:?}");
}

/// Renders the circles of a tilted board, light or dark, with 5 × 5 rays per pixel.
fn circles(camera: &PinholeCamera, board: &Board, pose: &nalgebra::Isometry3<f64>, inks: [f64; 2]) -> GrayPicture {
    let mut picture = GrayPicture::uniform(camera.width_px, camera.height_px, 0);
    let radius_mm = 0.28 * board.square_mm();
    let (origin, normal) = (pose.translation.vector, pose.rotation * nalgebra::Vector3::z());
    let corners = board.corners();
    for (index, gray) in picture.gray.iter_mut().enumerate() {
        let ray = |ray: usize| {
            let part = |index: usize| (index as f64 + 0.5) / 5.0 - 0.5;
            let (u, v) = (
                (index % camera.width_px) as f64 + part(ray % 5),
                (index / camera.width_px) as f64 + part(ray / 5),
            );
            let along: panelprep_base::geometry::Vector<panelprep_base::geometry::Camera> =
                camera.unproject(panelprep_base::geometry::Pixel::at(u, v)).expect("in the picture");
            let on_board =
                pose.inverse() * nalgebra::Point3::from(along.mm * (origin.dot(&normal) / along.mm.dot(&normal)));
            let inside = corners.iter().any(|q| (q.mm.x - on_board.x).hypot(q.mm.y - on_board.y) < radius_mm);
            if inside { inks[0] } else { inks[1] }
        };
        *gray = ((0..25).map(ray).sum::<f64>() / 25.0).round() as u8;
    }
    picture
}

/// Both kinds of grids, light and dark, tilted by 35°: every centre is located to a few hundredths of a pixel, in the
/// order of the board.
#[test]
fn circles_are_found_and_located() {
    let camera = PinholeCamera {
        width_px: 480,
        height_px: 360,
        fx_px: 520.0,
        fy_px: 520.0,
        cx_px: 240.0,
        cy_px: 180.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };
    for (text, inks) in
        [("circles:7x5:40", [30.0, 210.0]), ("circles:5x6:45", [190.0, 60.0]), ("acircles:4x7:24", [30.0, 210.0])]
    {
        let board = Board::parse(text, None).expect("a board");
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::new(0.45, -0.4, 0.1));
        let place = nalgebra::Vector3::new(0.0, 0.0, 520.0) - turn * board.centre().mm.coords;
        let pose = nalgebra::Isometry3::from_parts(place.into(), turn);
        let found = detect::detect(text, &circles(&camera, &board, &pose, inks), &board, None).expect(text);
        assert_eq!(found.corners.len(), board.count());
        let off = |(q, pixel): &(panelprep_base::geometry::Point<_>, panelprep_base::geometry::Pixel)| {
            let point = panelprep_base::geometry::Point::<panelprep_base::geometry::Camera>::new(pose * q.mm);
            camera.project(point).expect("in front").distance_px(*pixel)
        };
        let worst = found.corners.iter().map(off).fold(0.0, f64::max);
        assert!(worst < 0.05, "{text}: {worst} px");
        let fewer = Board::parse("circles:9x9:40", None).expect("a board");
        assert!(detect::detect(text, &circles(&camera, &board, &pose, inks), &fewer, None).is_err());
    }
}

/// Only the left half of a ChArUco board is in the picture: only the corners of this half are found, each with the
/// right number.
#[test]
fn a_charuco_board_that_is_cut_off_is_read() {
    let board = Board::parse("charuco:8x6:18:4X4_50", 25.0).expect("a board");
    let cell = BoardCell::new(2, print_of(&board), NO_NOISE);
    let (camera, shot) = (cell.flange_camera(), cell.flange_shots(1)[0]);
    let mut picture = cell.picture(&camera, &shot);
    let middle = camera.project(shot.camera_from_board * board.centre()).expect("in front").u as usize;
    for row in picture.gray.chunks_mut(camera.width_px) {
        row[middle..].fill(90);
    }
    let found = detect::detect("cut.png", &picture, &board, None).expect("a part of the board");
    assert!((10..=20).contains(&found.corners.len()), "{}", found.corners.len());
    for (q, pixel) in &found.corners {
        let off_px = camera.project(shot.camera_from_board * *q).expect("in front").distance_px(*pixel);
        assert!(off_px < 0.06, "{q:?}: {off_px} px");
    }
}
