//! Tests about a dozen poor pictures of boards, at half the size of those in `make bench-calib`.

use crate::board_pictures::{Hard, Judged, Rendered, camera, judge, no_board, random_difficulties, render};
use panelprep::calib::{Board, detect};

fn found(text: &str, square_mm: Option<f64>, hard: Hard, seed: u64) -> Judged {
    let board = Board::parse(text, square_mm).expect("a board");
    compare_with_truth(&board, &render(&board, &camera(972), &hard, seed))
}

fn compare_with_truth(board: &Board, rendered: &Rendered) -> Judged {
    let found = detect::detect("picture", &rendered.picture, board, None).ok();
    judge(board, rendered, found.as_ref().map(|found| &found.corners))
}

fn are_all_detected(text: &str, square_mm: Option<f64>, all: &[(&str, Hard)]) {
    for (seed, (name, hard)) in all.iter().enumerate() {
        let judged = found(text, square_mm, *hard, seed as u64 + 1);
        assert!(matches!(judged, Judged::Found(rms_px) if rms_px < 0.15), "{text}, {name}: {judged:?}");
    }
}

const EASY: Hard = Hard { width_share: 0.6, ..Hard::EASY };

#[test]
fn chessboards_in_poor_pictures_are_found() {
    are_all_detected(
        "9x6",
        Some(25.0),
        &[
            ("out of focus", Hard { blur_px: 2.5, ..EASY }),
            ("noise and little contrast", Hard { noise: 8.0, contrast: 40.0, ..EASY }),
            ("glare", Hard { glare: true, ..EASY }),
            ("tilted", Hard { tilt_deg: 60.0, ..EASY }),
            ("in the dark", Hard { dark: true, ..EASY }),
            ("small", Hard { width_share: 0.25, ..EASY }),
            // No single corner is accurate to 0.2 px, but the surface through all of them is.
            (
                "noise, out of focus and small",
                Hard { blur_px: 2.0, noise: 6.0, contrast: 60.0, width_share: 0.4, ..EASY },
            ),
        ],
    );
}

/// The pictures are so blurred and noisy that almost no marker is read; the lattice of the squares shows where the
/// corners are.
#[test]
fn charuco_boards_with_unreadable_markers_are_found() {
    let hard = Hard { blur_px: 1.3, noise: 6.0, contrast: 60.0, width_share: 0.4, ..Hard::EASY };
    are_all_detected("charuco:9x7:18:4X4_50", Some(25.0), &[("markers that are not read", hard)]);
}

/// A glare hides some circles and raises the mean brightness around others.
#[test]
fn circles_beside_a_glare_are_found() {
    for text in ["circles:9x7:25", "acircles:4x11:20"] {
        are_all_detected(
            text,
            None,
            &[
                ("glare", Hard { glare: true, ..EASY }),
                ("glare and little contrast", Hard { glare: true, contrast: 60.0, tilt_deg: 10.0, ..EASY }),
            ],
        );
    }
}

/// Some of the random mixtures of `make bench-calib`, in full size. At the edge of a glare, corners were once up to 1.3
/// px off, or the whole board was not detected.
#[test]
fn the_rim_of_a_glare_moves_no_corner() {
    for (text, square_mm, seeds) in [("9x6", Some(25.0), [20, 44]), ("acircles:4x11:20", None, [2, 39])] {
        let (board, camera) = (Board::parse(text, square_mm).expect("a board"), camera(1944));
        for seed in seeds {
            let rendered = render(&board, &camera, &random_difficulties(&board, &camera, seed), 1000 + seed);
            let judged = compare_with_truth(&board, &rendered);
            assert!(matches!(judged, Judged::Found(_) | Judged::Nearly(..)), "{text}, {seed}: {judged:?}");
        }
    }
}

#[test]
fn other_boards_in_poor_pictures_are_found() {
    are_all_detected(
        "charuco:9x7:18:4X4_50",
        Some(25.0),
        &[
            ("tilted", Hard { tilt_deg: 45.0, ..EASY }),
            ("glare in the dark", Hard { glare: true, dark: true, ..EASY }),
        ],
    );
    for text in ["circles:9x7:25", "acircles:4x11:20"] {
        are_all_detected(
            text,
            None,
            &[
                ("out of focus", Hard { blur_px: 2.0, ..EASY }),
                ("tilted, in the dark", Hard { tilt_deg: 50.0, dark: true, ..EASY }),
            ],
        );
    }
}

/// Clutter, texture and stripes are not detected as a board of any kind.
#[test]
fn no_board_is_found_in_pictures_without_a_board() {
    for text in ["9x6", "circles:9x7:25", "charuco:9x7:18:4X4_50"] {
        let board = Board::parse(text, (!text.starts_with("circles")).then_some(25.0)).expect("a board");
        for seed in 1..=3 {
            let picture = no_board(&camera(972), seed);
            assert!(detect::detect("picture", &picture, &board, None).is_err(), "{text}, {seed}");
        }
    }
}
