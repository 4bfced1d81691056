//! Calibration against the truth, two seeds each; `make bench-calib` has the sweeps.

use crate::boards::{self, BAD_ROBOT, GOOD_ROBOT, Lens, POSES, Side};
use panelprep::calib::detect;
use panelprep::calib::intrinsics::{LensModel, Options, calibrate};
use panelprep::cell::{FlangeCameraMount, Intrinsics, MountedPose, ScannerMount, Supported};
use panelprep::files::{write_gray_png, write_pcd};
use panelprep::geometry::{Camera, Flange, GrayPicture, KukaPose, PinholeCamera, Pixel, Point};
use panelprep::sim::{BoardCell, BoardPrint, BoardShot};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// With full-size rendered pictures, the true lens and this program's own.
fn mount_comes_back<A: Side>(seed: u64) {
    let cell = boards::cell(seed, GOOD_ROBOT);
    let shots = A::shots(&cell, POSES);
    let corners = boards::rendered::<A>(&cell, &shots);
    let with_truth = boards::error(&cell, &boards::many_poses::<A>(&Lens::truth::<A>(&cell), &shots, &corners));
    let own = boards::own_lens::<A>(&cell);
    let with_own = boards::error(&cell, &boards::many_poses::<A>(&own, &shots, &corners));
    let name = A::NAME;
    assert!(with_truth.mm < 0.06 && with_truth.deg < 0.015, "{name}, seed {seed}, true lens: {with_truth:?}");
    assert!(with_own.mm < 0.10, "{name}, seed {seed}, own lens: {with_own:?}");
    assert!(with_own.stated_mm > with_truth.stated_mm, "{name}: the lens's uncertainty counts: {with_own:?}");
    assert_eq!(with_truth.suspects + with_own.suspects, 0, "{name}, seed {seed}");
}

#[test]
fn many_rendered_poses_give_both_mounts() {
    mount_comes_back::<ScannerMount>(1);
    mount_comes_back::<FlangeCameraMount>(2);
}

#[test]
fn a_robot_half_a_millimetre_off_is_told_honestly() {
    for seed in [1, 2] {
        let cell = boards::cell(seed, BAD_ROBOT);
        let shots = FlangeCameraMount::shots(&cell, POSES);
        let corners = boards::synthetic::<FlangeCameraMount>(&cell, &shots);
        let lens = Lens::truth::<FlangeCameraMount>(&cell);
        let error = boards::error(&cell, &boards::many_poses::<FlangeCameraMount>(&lens, &shots, &corners));
        assert!(error.mm < 0.6 && error.stated_mm > 0.1 && error.stated_mm < 0.8, "{error:?}");
    }
}

#[test]
fn what_does_not_fit_is_found_and_named() {
    for (fault, words) in boards::FAULTS.iter().enumerate() {
        for seed in [1, 2] {
            let fixed = boards::faulty::<ScannerMount>(seed, fault);
            assert!(boards::is_named(&fixed, fault), "{words}: {fixed:?}");
            let moving = boards::faulty::<FlangeCameraMount>(seed, fault);
            assert!(boards::is_named(&moving, fault), "{words}: {moving:?}");
        }
    }
}

#[test]
fn three_touched_points_place_the_panel() {
    for seed in [1, 2] {
        // Within the limits of 95 % of all seeds.
        let [centre_mm, corner_mm] = boards::three_point_errors(seed, 0.1, true);
        assert!(centre_mm < 0.30 && corner_mm < 0.70, "seed {seed}: {centre_mm} mm, {corner_mm} mm");
    }
}

/// Runs the program in a folder: exit code, its object, its standard error.
fn panelprep(folder: &Path, arguments: &str) -> (i32, Value, String) {
    let arguments = format!("calibrate {arguments} --json");
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let words = String::from_utf8(output.stderr).expect("UTF-8");
    let object = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{arguments}: {error}: {text}{words}"));
    (output.status.code().expect("an exit code"), object, words)
}

fn pose_text(pose: &KukaPose) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = pose;
    format!(
        "{{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = {b_deg:?}, c_deg = {c_deg:?} }}"
    )
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    std::fs::write(folder.join(name), bytes).expect("written");
}

fn save(folder: &Path, name: &str, picture: &GrayPicture) {
    write(folder, name, write_gray_png(picture).expect("a picture"));
}

/// Pictures of the fixed camera with their poses and the true lens, in a folder.
fn folder_of_poses(cell: &BoardCell, count: usize) -> (tempfile::TempDir, Vec<String>) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("board")).expect("a folder");
    let mut poses = Vec::new();
    for shot in cell.fixed_shots(count) {
        let name = format!("{:02}.png", shot.index);
        save(&folder.path().join("board"), &name, &cell.picture(&cell.scanner(), &shot));
        let pose = pose_text(&KukaPose::from_rigid(&shot.base_from_flange));
        poses.push(format!("[[poses]]\nimage = \"{name}\"\nbase_from_flange = {pose}\n"));
    }
    write(folder.path(), "lens.toml", Intrinsics::of(cell.scanner()).to_toml());
    (folder, poses)
}

const BOARD: &str = "--board 9x6 --square-mm 25";

/// From pictures to files: lens, mount, verification; then what is wrong is named and nothing is written.
#[test]
fn commands_calibrate_verify_and_refuse() {
    let cell = boards::cell(3, GOOD_ROBOT);
    let (folder, poses) = folder_of_poses(&cell, 8);
    let folder = folder.path();
    write(folder, "poses.toml", poses.concat());
    let images = (0..8).fold(String::new(), |mut list, index| {
        let _ = write!(list, " board/{index:02}.png");
        list
    });
    let (exit, found, words) =
        panelprep(folder, &format!("intrinsics {BOARD} --out own.toml --pictures pictures{images}"));
    assert!(exit <= 1 && found["verdict"] != "reject", "{found}");
    let number = |object: &Value, key: &str| object[key].as_f64().unwrap_or(f64::NAN);
    assert!((number(&found, "fx_px") / cell.scanner().fx_px - 1.0).abs() < 0.004, "{found}");
    assert!(words.contains("corners: 8 of 8"), "progress is told: {words}");
    assert!(folder.join("pictures/residuals.png").is_file());
    let own = std::fs::read_to_string(folder.join("own.toml")).expect("written");
    let own = Intrinsics::check("own.toml", &own).expect("right");
    assert_eq!((own.provenance.pictures.len(), own.provenance.residuals.len()), (8, 8));
    assert!(own.date.is_some() && own.provenance.program.is_some_and(|program| program.starts_with("panelprep ")));

    let many = format!("hand-eye --mount eye-to-hand {BOARD} --intrinsics lens.toml --images board --poses");
    let (exit, found, _) = panelprep(folder, &format!("{many} poses.toml --out base_from_camera.toml"));
    assert!(exit <= 1 && found["verdict"] != "reject", "{found}");
    let pose: KukaPose = serde_json::from_value(found["base_from_camera"].clone()).expect("a pose");
    let error_mm = pose.to_rigid().distance_at_mm(cell.base_from_camera(), cell.panel_middle());
    assert!(error_mm < 0.1 && number(&found, "uncertainty_mm") < 0.2, "{error_mm} mm, {found}");
    assert_eq!(found["residuals"].as_array().map(Vec::len), Some(8));

    verify(folder);

    let right = KukaPose::from_rigid(&cell.fixed_shots(4)[3].base_from_flange);
    let mistyped = KukaPose { b_deg: right.b_deg + 2.0, ..right };
    let mistyped = format!("[[poses]]\nimage = \"03.png\"\nbase_from_flange = {}\n", pose_text(&mistyped));
    let wrong = poses.iter().enumerate().map(|(i, pose)| if i == 3 { &*mistyped } else { &**pose });
    write(folder, "wrong.toml", wrong.collect::<String>());
    let (exit, found, _) = panelprep(folder, &format!("{many} wrong.toml --out wrong_out.toml"));
    let reasons = found["reasons"].to_string();
    assert!(exit == 1 && reasons.contains("03.png is") && reasons.contains("b_deg"), "{reasons}");
    write(folder, "missing.toml", poses.concat().replace("05.png", "55.png"));
    let (exit, _, words) = panelprep(folder, &format!("{many} missing.toml --out wrong_out.toml"));
    assert!(
        exit == 2 && words.contains("55.png is not in the folder") && words.contains("missing.toml:"),
        "{words}"
    );
    save(folder, "small.png", &GrayPicture::filled(640, 480, 90));
    let (exit, _, words) = panelprep(folder, &format!("intrinsics {BOARD} --out wrong_out.toml{images} small.png"));
    assert!(exit == 2 && words.contains("small.png has 640 × 480"), "{words}");
    let (exit, _, words) =
        panelprep(folder, "intrinsics --board 7x6 --square-mm 25 --out wrong_out.toml board/00.png small.png");
    assert!(exit == 2 && !words.is_empty(), "{words}");
    assert!(!folder.join("wrong_out.toml").exists(), "nothing is written");
}

/// Learns the board's place from a picture, finds it again, and refuses a bumped camera.
fn verify(folder: &Path) {
    let cell =
        "store = \"store\"\n[calibration]\nscanner = \"lens.toml\"\nbase_from_camera = \"base_from_camera.toml\"\n";
    write(folder, "cell.toml", cell);
    let look = |more: &str| {
        let arguments = "verify --cell cell.toml --camera scanner --target target.toml --pictures pictures";
        panelprep(folder, &format!("{arguments} {BOARD} {more}"))
    };
    let (exit, found, _) = look("--image board/00.png --learn");
    assert_eq!(exit, 0, "{found}");
    let (exit, found, _) = look("--image board/00.png");
    assert!(exit == 0 && found["error_mm"].as_f64().is_some_and(|error| error < 1e-6), "{found}");
    // The camera was bumped by 3 mm.
    let mount = std::fs::read_to_string(folder.join("base_from_camera.toml")).expect("there");
    let x_mm = mount.lines().find_map(|line| line.strip_prefix("x_mm = ")).expect("a place");
    let bumped = format!("x_mm = {:?}", x_mm.parse::<f64>().expect("a number") + 3.0);
    write(folder, "base_from_camera.toml", mount.replace(&format!("x_mm = {x_mm}"), &bumped));
    let (exit, found, _) = look("--image board/00.png");
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("verification_limit")), "{found}");
    // Another pose of the board is no look at it.
    let (exit, found, _) = look("--image board/01.png");
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("implausible")), "{found}");
    let trend = std::fs::read_to_string(folder.join("pictures/trend_scanner.svg")).expect("a trend");
    assert_eq!(trend.matches("<circle").count(), 2);
}

/// Three points on the command line, with the 3D camera's own shot as the picture: first the picture, then the mount.
#[test]
fn three_points_from_files() {
    let cell = boards::cell(4, GOOD_ROBOT);
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let shot = cell.fixed_shots(1)[0];
    write(folder, "shot.pcd", write_pcd(&cell.scan(&shot, 0.05)));
    write(folder, "lens.toml", Intrinsics::of(cell.scanner()).to_toml());
    let three =
        format!("hand-eye --mount eye-to-hand {BOARD} --intrinsics lens.toml --image shot.pcd --out mount.toml");
    let (exit, found, _) = panelprep(folder, &three);
    assert!(
        exit == 0 && folder.join("corners_to_touch.png").is_file() && !folder.join("mount.toml").exists(),
        "{found}"
    );
    let board = boards::board();
    let corners = board.corners_to_touch();
    let places: Vec<Point<_>> = corners.iter().filter_map(|&(c, r)| board.corner(c, r)).collect();
    let touched = cell.touched(&(cell.base_from_camera() * shot.camera_from_board), &places, 0.05);
    let points: String =
        touched.iter().zip(corners).enumerate().fold(String::new(), |mut text, (index, (p, (c, r)))| {
            let (n, [x, y, z]) = (index + 1, [p.mm.x, p.mm.y, p.mm.z]);
            let _ = writeln!(text, "p{n}_mm = [{x:?}, {y:?}, {z:?}]\np{n}_corner = [{c}, {r}]");
            text
        });
    write(folder, "points.toml", &points);
    let (exit, found, _) = panelprep(folder, &format!("{three} --points points.toml"));
    assert!(exit == 0 && folder.join("mount.toml").is_file(), "{found}");
    let pose: KukaPose = serde_json::from_value(found["base_from_camera"].clone()).expect("a pose");
    let error_mm = pose.to_rigid().distance_at_mm(cell.base_from_camera(), cell.panel_middle());
    assert!(
        error_mm < 0.5 && found["distance_errors_mm"].as_array().map(Vec::len) == Some(3),
        "{error_mm}: {found}"
    );
}

/// A quarter of the size, and a board that is still well seen: what is tested with it is not accuracy.
fn small_cell() -> BoardCell {
    BoardCell::new(5, BoardPrint::chessboard(5, 4, 40.0), GOOD_ROBOT).with_reduction(4)
}

/// Saves shots of the fixed camera and gives the text of their poses file.
fn poses_of(cell: &BoardCell, count: usize, save: impl Fn(&str, &BoardShot<Camera>) -> String) -> String {
    let entry = |shot: &BoardShot<Camera>| {
        let name = save(&format!("{:02}", shot.index), shot);
        let pose = pose_text(&KukaPose::from_rigid(&shot.base_from_flange));
        format!("[[poses]]\nimage = \"{name}\"\nbase_from_flange = {pose}\n")
    };
    cell.fixed_shots(count).iter().map(entry).collect()
}

/// Where the 3D camera measured the board, its own points give a second mount; intrinsics that are not the camera's show
/// in the distance between the two.
#[test]
fn the_3d_camera_s_own_points_give_a_second_mount() {
    let cell = small_cell();
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let poses = poses_of(&cell, 8, |name, shot| {
        let name = format!("{name}.pcd");
        write(folder, &name, write_pcd(&cell.scan(shot, 0.03)));
        name
    });
    write(folder, "poses.toml", poses);
    write(folder, "lens.toml", Intrinsics::of(cell.scanner()).to_toml());
    let command =
        "hand-eye --mount eye-to-hand --board 5x4 --square-mm 40 --images . --poses poses.toml --out m.toml";
    let (exit, found, _) = panelprep(folder, &format!("{command} --intrinsics lens.toml"));
    assert!(exit <= 1 && found["verdict"] != "reject", "{found}");
    let pose: KukaPose = serde_json::from_value(found["second"]["base_from_camera"].clone()).expect("a pose");
    let error_mm = pose.to_rigid().distance_at_mm(cell.base_from_camera(), cell.panel_middle());
    assert!(error_mm < 0.15, "{error_mm} mm: {found}");
    assert!(found["second"]["apart_mm"].as_f64().is_some_and(|mm| mm < 0.3), "{found}");
    assert!(!found["reasons"].to_string().contains("second_result"), "{found}");

    let other = PinholeCamera {
        fx_px: cell.scanner().fx_px * 1.004,
        fy_px: cell.scanner().fy_px * 1.004,
        ..cell.scanner()
    };
    write(folder, "other.toml", Intrinsics::of(other).to_toml());
    let (exit, found, _) = panelprep(folder, &format!("{command} --intrinsics other.toml"));
    assert!(exit == 1 && found["reasons"].to_string().contains("second_result"), "{found}");
}

/// Each with what was found, what is needed, and no file.
#[test]
fn bad_input_is_told_and_writes_nothing() {
    let cell = small_cell();
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let poses = poses_of(&cell, 6, |name, shot| {
        let name = format!("{name}.png");
        save(folder, &name, &cell.picture(&cell.scanner(), shot));
        name
    });
    write(folder, "lens.toml", Intrinsics::of(cell.scanner()).to_toml());
    save(folder, "empty.png", &GrayPicture::filled(486, 300, 90));
    save(folder, "large.png", &GrayPicture::filled(640, 480, 90));
    write(folder, "poses.toml", &poses);
    write(folder, "few.toml", poses.split("[[poses]]").take(4).collect::<Vec<_>>().join("[[poses]]"));
    write(folder, "missing.toml", poses.replace("03.png", "33.png"));
    let rad = |pose: &KukaPose| KukaPose {
        a_deg: pose.a_deg.to_radians(),
        b_deg: pose.b_deg.to_radians(),
        c_deg: pose.c_deg.to_radians(),
        ..*pose
    };
    let radians = cell.fixed_shots(6).iter().fold(String::new(), |mut text, shot| {
        let pose = pose_text(&rad(&KukaPose::from_rigid(&shot.base_from_flange)));
        let _ = write!(text, "[[poses]]\nimage = \"{:02}.png\"\nbase_from_flange = {pose}\n", shot.index);
        text
    });
    write(folder, "radians.toml", radians);
    let points = |third: &str| {
        format!(
            "p1_mm = [0, 0, 0]\np1_corner = [0, 0]\np2_mm = [160, 0, 0]\np2_corner = [4, 0]\np3_mm = {third}\np3_corner = [4, 3]\n"
        )
    };
    write(folder, "line.toml", points("[320, 1, 0]"));
    write(folder, "near.toml", points("[161, 1, 0]"));
    let lens = "intrinsics --board 5x4 --square-mm 40 --out out.toml";
    let all = "00.png 01.png 02.png 03.png 04.png";
    let many = "hand-eye --mount eye-to-hand --board 5x4 --square-mm 40 --intrinsics lens.toml --images . --out out.toml --poses";
    let three = "hand-eye --mount eye-to-hand --board 5x4 --square-mm 40 --intrinsics lens.toml --image 00.png --out out.toml --points";
    for (command, words) in [
        (format!("{lens} {all} large.png"), "large.png has 640 × 480 pixels"),
        (format!("{lens} {all} lens.toml"), "lens.toml"),
        (format!("{lens} {all}").replace("--square-mm 40", "--square-mm 0"), "allowed is 0.5 to 500"),
        (format!("{many} few.toml"), "3 of 3 pictures can be used, 5 are needed"),
        (format!("{many} missing.toml"), "33.png is not in the folder"),
        (format!("{many} radians.toml"), "look like radians"),
        (format!("{three} line.toml"), "on one line"),
        (format!("{three} near.toml"), "apart; at least"),
    ] {
        let (exit, found, told) = panelprep(folder, &command);
        assert!(exit == 2 && told.contains(words), "{command}: {exit} {found} {told}");
        assert!(!folder.join("out.toml").exists(), "{command}: nothing is written");
    }
    // Pictures that are right and do not determine a lens: a verdict, and the next picture to take.
    for (command, words) in [
        (format!("{lens} empty.png empty.png empty.png empty.png"), "empty.png shows no board with 5×4"),
        (format!("{lens} {all}").replace("5x4", "9x6"), "found a 5x4 board, asked for 9x6"),
        (format!("{lens} 00.png 01.png 02.png"), "3 of 3 pictures can be used, 4 are needed"),
        (format!("{lens} 00.png 00.png 00.png 00.png"), ""),
    ] {
        let (exit, found, _) = panelprep(folder, &command);
        assert!(exit == 1 && found["verdict"] != "accept", "{command}: {exit} {found}");
        assert!(
            found["reasons"].to_string().contains(words) && found["next_picture"].is_string(),
            "{command}: {found}"
        );
        assert_eq!(folder.join("out.toml").exists(), found["verdict"] == "review", "{command}");
        let _ = std::fs::remove_file(folder.join("out.toml"));
    }
}

/// A lens that was seen in the middle of the picture alone is written with that part, `check` tells it, and a look at a board
/// outside of it is refused and not kept.
#[test]
fn outside_of_what_a_lens_was_seen_in_nothing_is_measured() {
    let cell = small_cell();
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let shot = cell.fixed_shots(1)[0];
    save(folder, "board.png", &cell.picture(&cell.scanner(), &shot));
    write(
        folder,
        "mount.toml",
        MountedPose::<ScannerMount>::of(KukaPose::from_rigid(&cell.base_from_camera())).to_toml(),
    );
    let files = "store = \"store\"\n[calibration]\nscanner = \"lens.toml\"\nbase_from_camera = \"mount.toml\"\n";
    write(folder, "cell.toml", files);
    let learn = "verify --cell cell.toml --camera scanner --board 5x4 --square-mm 40 --target target.toml --image board.png --learn";
    let lens = |outline_px: Vec<Pixel>| {
        let mut lens = Intrinsics::of(cell.scanner());
        lens.extent.supported = Some(Supported { error_px: 0.3, outline_px });
        write(folder, "lens.toml", lens.to_toml());
    };
    let (width, height) = (cell.scanner().width_px as f64, cell.scanner().height_px as f64);
    let around = |u: f64, v: f64| vec![Pixel::at(0.0, 0.0), Pixel::at(u, 0.0), Pixel::at(u, v), Pixel::at(0.0, v)];
    lens(around(width, height));
    let (exit, found, _) = panelprep(folder, learn);
    assert_eq!(exit, 0, "{found}");
    std::fs::remove_file(folder.join("target.toml")).expect("learned");
    lens(around(width / 3.0, height / 3.0));
    let (exit, found, _) = panelprep(folder, learn);
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("outside_of_lens")), "{found}");
    assert!(!folder.join("target.toml").exists(), "nothing is learned");
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["check", "lens.toml"])
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let told = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(told.contains("known to 0.30 px in 11 % of the picture"), "{told}");
}

/// Full-size pictures without the board that is asked for: another board, fine texture, a plain ground. None takes more
/// than two seconds of the processors in this build (one when it is optimised), whatever it shows, and each says that it looks.
#[test]
fn a_look_without_its_board_ends_soon() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let cell = BoardCell::new(5, BoardPrint::chessboard(5, 4, 40.0), GOOD_ROBOT);
    let (width, height) = (cell.scanner().width_px, cell.scanner().height_px);
    let mut noise = GrayPicture::filled(width, height, 0);
    let mut weave = noise.clone();
    let mut random = 1_u32;
    for index in 0..width * height {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let [gray, ..] = random.to_be_bytes();
        noise.gray[index] = gray;
        let is_light = (index % width / 9 + index / width / 9) % 2 == 0;
        weave.gray[index] = if is_light { 150 } else { 90 } + gray % 8;
    }
    save(folder, "board.png", &cell.picture(&cell.scanner(), &cell.fixed_shots(1)[0]));
    save(folder, "noise.png", &noise);
    save(folder, "weave.png", &weave);
    write(folder, "lens.toml", Intrinsics::of(cell.scanner()).to_toml());
    for (name, board, words) in [
        ("board.png", "6x4", "found a 5x4 board, asked for 6x4"),
        ("noise.png", "5x4", "shows no board with 5×4"),
        ("weave.png", "9x6", "weave.png"),
        ("noise.png", "charuco:8x6:18:4X4_50", "shows no board with 7×5"),
        ("weave.png", "charuco:8x6:18:4X4_50", "shows no board with 7×5"),
        ("noise.png", "circles:7x11:40", "shows no grid of 7 circles"),
        ("weave.png", "acircles:4x11:40", "shows no grid of 4 circles"),
    ] {
        let program = env!("CARGO_BIN_EXE_panelprep");
        let arguments = format!(
            "calibrate hand-eye --mount eye-to-hand --board {board} --square-mm 40 --intrinsics lens.toml --image {name} --out m.toml"
        );
        let output = Command::new("sh")
            .args(["-c", &format!("'{program}' {arguments} 2>&1; times")])
            .current_dir(folder)
            .output()
            .expect("a shell");
        let told = String::from_utf8(output.stdout).expect("UTF-8");
        assert!(told.contains(words) && told.contains("looking for "), "{told}");
        // The shell's last line is what the program took: "0m0.52s 0m0.08s".
        let taken = told.lines().last().expect("times").split_whitespace().map(|time| {
            let (minutes, seconds) = time.trim_end_matches('s').split_once('m').expect("minutes");
            60.0 * minutes.parse::<f64>().expect("minutes") + seconds.parse::<f64>().expect("seconds")
        });
        let taken_s: f64 = taken.sum();
        // A search that loses itself took minutes; how fast it is, `cargo bench --bench boards` says.
        assert!(taken_s < 20.0, "{name}: {taken_s} s");
    }
}

/// The tool's point and axis from a poses file: by hand, the tip is 150 mm out along the flange's Z.
#[test]
fn a_tool_from_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let held = |out_mm: f64, a_deg: f64, b_deg: f64, c_deg: f64| {
        let turned = KukaPose { a_deg, b_deg, c_deg, ..KukaPose::default() };
        let tip = turned.to_rigid::<Flange, Flange>() * Point::at(0.0, 0.0, out_mm);
        let pose = KukaPose { x_mm: 600.0 - tip.mm.x, y_mm: -tip.mm.y, z_mm: 200.0 - tip.mm.z, ..turned };
        format!("base_from_flange = {}\n", pose_text(&pose))
    };
    let angles = [(0.0, 0.0, 180.0), (30.0, 25.0, 180.0), (-40.0, 0.0, 150.0), (90.0, -20.0, 200.0)];
    let tip: String = angles.iter().map(|&(a, b, c)| format!("[[poses]]\n{}", held(150.0, a, b, c))).collect();
    write(folder, "tip.toml", &tip);
    let (exit, found, _) = panelprep(folder, "tcp --poses tip.toml --out tool.toml");
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("no_axis")), "{found}");
    write(folder, "axis.toml", format!("{tip}[[axis]]\n{}", held(90.0, 10.0, 5.0, 170.0)));
    let (exit, found, _) = panelprep(folder, "tcp --poses axis.toml --out tool.toml");
    assert_eq!(exit, 0, "{found}");
    let pose: KukaPose = serde_json::from_value(found["flange_from_tool"].clone()).expect("a pose");
    assert!((pose.z_mm - 150.0).abs() < 1e-6 && pose.x_mm.abs() < 1e-6, "{pose}");
    let text = std::fs::read_to_string(folder.join("tool.toml")).expect("written");
    assert!(text.contains("axis_measured = true") && text.contains("uncertainty_mm = "), "{text}");
}

/// Pictures that a real camera took, where Debian's opencv-doc is installed or `make bench-calib` fetched it.
#[test]
fn real_pictures_give_opencv_s_own_camera() {
    let Some(folder) = opencv_doc() else {
        eprintln!("skipped: Debian's opencv-doc is not there; `make bench-calib` fetches it");
        return;
    };
    let views = opencv_views(&folder, Some(11));
    let all = Options { keep_all: true, model: Some(LensModel::Full) };
    let found = calibrate((640, 480), &views, all).expect("a camera");
    let near =
        |value: f64, expected: f64, within: f64| assert!((value - expected).abs() < within, "{value}, {expected}");
    let c = found.camera;
    near(c.fx_px, 536.07, 0.02);
    near(c.fy_px, 536.02, 0.02);
    near(c.cx_px, 342.37, 0.02);
    near(c.cy_px, 235.54, 0.02);
    near(c.k1, -0.265, 0.001);
    near(found.rms_px, 0.409, 0.001);
    println!(
        "ok     opencv-doc, all pictures, windows of ±11 px: fx {:.3} fy {:.3} cx {:.3} cy {:.3} k1 {:.4}, {:.3} px rms",
        c.fx_px, c.fy_px, c.cx_px, c.cy_px, c.k1, found.rms_px
    );
    let views = opencv_views(&folder, None);
    let chosen = calibrate((640, 480), &views, Options::default()).expect("a camera");
    assert!(chosen.rms_px < 0.3 && (chosen.camera.fx_px / c.fx_px - 1.0).abs() < 0.01, "{chosen:?}");
    let aside = chosen.views.iter().filter(|view| view.set_aside.is_some()).count();
    println!(
        "ok     opencv-doc, own corners: fx {:.3} ± {:.3}, cx {:.3} ± {:.3}, {:.3} px rms, {aside} pictures set aside",
        chosen.camera.fx_px, chosen.deviations[0], chosen.camera.cx_px, chosen.deviations[2], chosen.rms_px
    );
    // OpenCV states 1.358 px for fx; its divisor counts 702 corners where there are 1404 coordinates, and 87 unknowns. The
    // pictures that were left out are farther off than those that were used, and the lens is stated as they show it.
    let inside = 1.358 * (615.0_f64 / 1317.0).sqrt();
    assert!((inside..1.6 * inside).contains(&found.deviations[0]), "{inside}, {}", found.deviations[0]);
    assert!(found.left_out_rms_px > found.rms_px && found.left_out_rms_px < 1.5 * found.rms_px);
}

/// The thirteen pictures with their corners, in windows of this size.
fn opencv_views(folder: &Path, half_window_px: Option<usize>) -> Vec<panelprep::calib::intrinsics::View> {
    let numbers = (1..=14).filter(|number| *number != 10);
    let view = |number| {
        let name = format!("left{number:02}.jpg");
        let picture =
            panelprep::files::read_gray(&std::fs::read(folder.join(&name)).expect("there")).expect("a picture");
        let corners = detect::detect(&name, &picture, &boards::board(), half_window_px).expect("a board").corners;
        panelprep::calib::intrinsics::View { name, corners }
    };
    numbers.map(view).collect()
}

fn opencv_doc() -> Option<std::path::PathBuf> {
    let inside = "usr/share/doc/opencv-doc/examples/data";
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/opencv-doc").join(inside);
    [here, Path::new("/").join(inside)].into_iter().find(|folder| folder.join("left01.jpg").is_file())
}

/// A cell whose arm is off its drawing is calibrated, and a whole cycle by it is as good as by an arm without errors. Its
/// recording replays. Without the correction the tool does not come to what the 3D camera sees.
#[test]
fn a_cycle_by_an_arm_that_is_not_as_it_is_drawn() {
    let folder = tempfile::tempdir().expect("a folder");
    let demo = |more: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(["demo", "--json", "--reduction", "4", "--arm-error-mm", "1.2", "--seed", "1", "--out", "arm"])
            .args(more)
            .current_dir(folder.path())
            .output()
            .expect("the program starts");
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        serde_json::from_slice::<Value>(&output.stdout).unwrap_or_else(|error| panic!("{error}: {words}"))
    };
    let uncorrected = demo(&["--uncorrected"]);
    let uncorrected_mm = uncorrected["verified"]["tool_mm"].as_f64().expect("touched");
    let passed = demo(&["--record", "arm.mcap"]);
    let number = |pointer: &str| passed.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    assert_eq!(passed["verdict"], "pass", "{passed}");
    assert!(uncorrected_mm > 2.0 * number("/verified/tool_mm"), "{uncorrected_mm} mm before: {passed}");
    assert!(number("/verified/tool_mm") < 0.35 && number("/refine/error_max_mm") < 0.3, "{passed}");
    assert!(number("/abrade/0/surface_error_max_mm") < 0.45 && number("/abrade/0/coverage") > 0.99, "{passed}");
    let page = std::fs::read_to_string(folder.path().join("arm/index.html")).expect("a page");
    assert!(page.contains("robot, corrected by robot_correction, and tool"), "the record names the correction");
    let run = |arguments: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(arguments.split_whitespace())
            .current_dir(folder.path())
            .output()
            .expect("the program starts");
        let text =
            [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        (output.status.code(), text)
    };
    let (code, text) = run("replay arm.mcap");
    assert!(code == Some(0) && text.contains("the same as recorded"), "{text}");

    // What is left over the working volume, with its map.
    let verify = "calibrate verify --cell arm/cell/cell.toml --camera flange-camera --target arm/cell/boards/flange/target.toml \
                  --poses arm/cell/boards/flange/poses.toml --pictures maps";
    let (code, text) = run(verify);
    assert!(code == Some(0) && text.contains("mm rms"), "{text}");
    assert!(folder.path().join("maps/map_flange_camera.svg").exists(), "{text}");

    // Another tool is selected on the pendant: its tip says nothing of the cell's.
    let touch = "calibrate touch --cell arm/cell/cell.toml --target arm/cell/target/scanner.toml \
                 --points arm/cell/target/touched.toml";
    let (code, text) = run(touch);
    assert!(code == Some(0), "{text}");
    let points = folder.path().join("arm/cell/target/touched.toml");
    let right = std::fs::read_to_string(&points).expect("points");
    let (before, after) = right.split_once("p2_mm = [").expect("a second touch");
    let (x_mm, after) = after.split_once(',').expect("a place");
    let x_mm: f64 = x_mm.parse().expect("a number");
    std::fs::write(&points, format!("{before}p2_mm = [{:.3},{after}", x_mm + 8.0)).expect("written");
    let (code, text) = run(touch);
    assert!(
        code == Some(2) && text.contains("touched.toml") && text.contains("p2_mm is") && text.contains("tool"),
        "{text}"
    );

    // A pose without axes cannot be corrected; mounts that were measured with the correction are no use without it.
    let pose = "arm/cell/target/flange.json";
    let whole: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join(pose)).expect("a pose")).expect("JSON");
    std::fs::write(folder.path().join(pose), whole["base_from_flange"].to_string()).expect("written");
    let look = "calibrate verify --cell arm/cell/cell.toml --camera flange-camera --target arm/cell/target/flange_camera.toml \
                --image arm/cell/target/flange_camera.png --flange arm/cell/target/flange.json";
    let (code, text) = run(look);
    assert!(code == Some(2) && text.contains("flange.json") && text.contains("axes_deg"), "{text}");
    let cell = folder.path().join("arm/cell/cell.toml");
    let text = std::fs::read_to_string(&cell).expect("a cell");
    std::fs::write(&cell, text.replace("robot_correction = \"robot_correction.toml\"\n", "")).expect("written");
    let (code, text) = run(verify);
    assert!(
        code == Some(2) && text.contains("flange_from_camera.toml: was measured with the correction of the arm"),
        "{text}"
    );
}
