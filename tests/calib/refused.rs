//! Tests files from which no calibration can be computed: a message states within a short time what is needed, and no
//! file is written.

use super::files::{panelprep, pose_text, save, save_shots, small_cell, write};
use crate::boards::GOOD_ROBOT;
use panelprep::cell::{Intrinsics, MountedPose, ScannerMount, SupportedArea};
use panelprep::geometry::{GrayPicture, KukaPose, Pixel};
use panelprep::sim::{BoardCell, BoardPrint};
use std::fmt::Write;
use std::process::Command;

/// Each invalid input is refused; the message states what was found and what is needed, and no file is written.
#[test]
fn bad_input_is_reported_and_writes_nothing() {
    let cell = small_cell();
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let poses = save_shots(&cell, 6, |name, shot| {
        let name = format!("{name}.png");
        save(folder, &name, &cell.picture(&cell.scanner(), shot));
        name
    });
    write(folder, "lens.toml", Intrinsics::from_camera(cell.scanner()).to_toml());
    save(folder, "empty.png", &GrayPicture::uniform(486, 300, 90));
    save(folder, "large.png", &GrayPicture::uniform(640, 480, 90));
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
        (format!("{lens} {all}").replace("--square-mm 40", "--square-mm 0"), "limits 0.5 to 500 mm"),
        (format!("{many} few.toml"), "3 of 3 pictures can be used, at least 5 are needed"),
        (format!("{many} missing.toml"), "33.png is not in the folder"),
        (format!("{many} radians.toml"), "look like radians"),
        (format!("{three} line.toml"), "on one line"),
        (format!("{three} near.toml"), "apart; at least"),
    ] {
        let (exit, found, reported) = panelprep(folder, &command);
        assert!(exit == 2 && reported.contains(words), "{command}: {exit} {found} {reported}");
        assert!(!folder.join("out.toml").exists(), "{command}: nothing is written");
    }
    // Valid pictures that do not determine a lens give a verdict, and the next picture to capture.
    for (command, words) in [
        (format!("{lens} empty.png empty.png empty.png empty.png"), "empty.png shows no board with 5×4"),
        (format!("{lens} {all}").replace("5x4", "9x6"), "found a 5x4 board, expected 9x6"),
        (format!("{lens} 00.png 01.png 02.png"), "3 of 3 pictures can be used, at least 4 are needed"),
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

/// The file of a lens that was calibrated only in the middle of the picture contains the outline of this part, and
/// `check` reports it. A verification with a board outside of this part is refused and not stored.
#[test]
fn nothing_is_measured_outside_of_the_calibrated_part_of_a_lens() {
    let cell = small_cell();
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let shot = cell.fixed_shots(1)[0];
    save(folder, "board.png", &cell.picture(&cell.scanner(), &shot));
    write(
        folder,
        "mount.toml",
        MountedPose::<ScannerMount>::from_pose(KukaPose::from_rigid(&cell.base_from_camera())).to_toml(),
    );
    let files = "store = \"store\"\n[calibration]\nscanner = \"lens.toml\"\nbase_from_camera = \"mount.toml\"\n";
    write(folder, "cell.toml", files);
    let learn = "verify --cell cell.toml --camera scanner --board 5x4 --square-mm 40 --target target.toml --image board.png --learn";
    let lens = |outline_px: Vec<Pixel>| {
        let mut lens = Intrinsics::from_camera(cell.scanner());
        lens.extent.supported = Some(SupportedArea { error_px: 0.3, outline_px });
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
    let reported = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(reported.contains("lens calibrated to 0.30 px in 11 % of the picture"), "{reported}");
}

/// Full-size pictures without the requested board: another board, fine texture, a plain background. The search in each
/// picture takes at most two seconds of processor time in this build (one second in an optimised build), and reports
/// that it is running.
#[test]
fn a_search_for_an_absent_board_ends_in_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let cell = BoardCell::new(5, BoardPrint::chessboard(5, 4, 40.0), GOOD_ROBOT);
    let (width, height) = (cell.scanner().width_px, cell.scanner().height_px);
    let mut noise = GrayPicture::uniform(width, height, 0);
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
    write(folder, "lens.toml", Intrinsics::from_camera(cell.scanner()).to_toml());
    for (name, board, words) in [
        ("board.png", "6x4", "found a 5x4 board, expected 6x4"),
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
        let reported = String::from_utf8(output.stdout).expect("UTF-8");
        assert!(reported.contains(words) && reported.contains("searching for "), "{reported}");
        // The shell's last line is the processor time of the program: "0m0.52s 0m0.08s".
        let taken = reported.lines().last().expect("times").split_whitespace().map(|time| {
            let (minutes, seconds) = time.trim_end_matches('s').split_once('m').expect("minutes");
            60.0 * minutes.parse::<f64>().expect("minutes") + seconds.parse::<f64>().expect("seconds")
        });
        let taken_s: f64 = taken.sum();
        // An earlier search took minutes, because it followed wrong candidates; `cargo bench --bench boards` measures
        // the duration of the search.
        assert!(taken_s < 20.0, "{name}: {taken_s} s");
    }
}
