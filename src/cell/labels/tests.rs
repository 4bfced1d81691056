//! Tests of labels like those that a person draws, with expected values that were calculated by hand.

use super::*;
use panelprep_base::geometry::Pixel;

fn shape(from_s: f64, corners_px: &[[f64; 2]]) -> Shape {
    Shape { from_s, corners_px: corners_px.to_vec() }
}

/// Returns a rectangle from its upper left and its lower right corner.
fn rectangle(from_s: f64, [left, top]: [f64; 2], [right, bottom]: [f64; 2]) -> Shape {
    shape(from_s, &[[left, top], [right, top], [right, bottom], [left, bottom]])
}

fn statement(breaks: Vec<Break>) -> Statement {
    Statement { author: "A. Meier".to_owned(), clean: breaks.is_empty(), breaks }
}

/// Returns a clip of 10 × 6 px that is wet from 3 s to 8 s, with one picture each second.
fn frame() -> ClipFrame {
    ClipFrame { size_px: [10, 6], wet_times_s: (3..=8).map(f64::from).collect() }
}

/// Expected values, calculated by hand: the rectangle from (1.5, 0.5) to (4.5, 2.5) contains the centres of columns 2
/// to 4 in rows 1 and 2. These six pixels break at 4 s, 1 s after the first wet picture. The two shapes have the same
/// number of corners, so the right side moves from 4.5 at 4 s to 6.5 at 8 s. At 5 s it is at 5.0, so that column 5 is
/// not yet inside; it breaks at 6 s. At 7 s it is at 6.0, so that column 6 breaks at 8 s.
#[test]
fn pixels_break_when_a_growing_shape_reaches_them() {
    let grows = Break {
        closes_s: None,
        shapes: vec![rectangle(4.0, [1.5, 0.5], [4.5, 2.5]), rectangle(8.0, [1.5, 0.5], [6.5, 2.5])],
    };
    assert_eq!(problems(&statement(vec![grows.clone()]), &frame()), []);
    let broken = broken_pixels(&[grows], &frame());
    let row: Vec<f64> = broken.since_wet_s[10..20].to_vec();
    let never = f64::INFINITY;
    assert_eq!(row, [never, never, 1.0, 1.0, 1.0, 3.0, 5.0, never, never, never]);
    assert_eq!(
        (broken.mask().count(), broken.times().rgb[15]),
        (10, [1, 44, 255]),
        "300 hundredths are 1 · 256 + 44"
    );
    assert_eq!(broken.times().rgb[0], [0; 3]);
}

/// Expected values, calculated by hand: a rectangle and a triangle have different numbers of corners, so the rectangle
/// with its four pixels is valid until 6 s. The long side of the triangle crosses v = 0 at u = 2.5; this adds column 2
/// there, 3 s after the first wet picture. A break that has closed again stays in the mask. The other break covers
/// column 0 from 5 s on. Where two breaks overlap, the earlier time is used, so the other break adds only rows 2 to 5.
#[test]
fn a_shape_applies_until_the_next_one_and_a_closed_break_stays_in_the_mask() {
    let one = Break {
        closes_s: Some(7.0),
        shapes: vec![
            rectangle(3.0, [-0.5, -0.5], [1.5, 1.5]),
            shape(6.0, &[[-0.5, -0.5], [3.5, -0.5], [-0.5, 1.5]]),
        ],
    };
    assert_eq!(one.corners_at(2.9), []);
    assert_eq!(one.corners_at(5.9).len(), 4);
    assert_eq!(one.corners_at(9.0)[1], Pixel::at(3.5, -0.5));
    assert!(one.is_open_at(6.9) && !one.is_open_at(7.0) && !one.is_open_at(2.0));
    let other = Break { closes_s: None, shapes: vec![rectangle(5.0, [-0.5, -0.5], [0.5, 5.5])] };
    let broken = broken_pixels(&[other, one], &frame());
    assert_eq!(broken.since_wet_s[..4], [0.0, 0.0, 3.0, f64::INFINITY]);
    assert_eq!((broken.since_wet_s[10], broken.since_wet_s[20], broken.mask().count()), (0.0, 2.0, 9));
}

#[test]
fn an_impossible_statement_is_reported_with_its_break() {
    let of = |shapes: Vec<Shape>, closes_s: Option<f64>| statement(vec![Break { closes_s, shapes }]);
    let good = || rectangle(4.0, [1.0, 1.0], [4.0, 4.0]);
    let cases = [
        (
            Statement { author: " ".to_owned(), ..of(vec![good()], None) },
            "the name of the person who labels is missing",
        ),
        (Statement { author: "A\nB".to_owned(), ..of(vec![good()], None) }, "control characters are not permitted"),
        (Statement { clean: false, ..statement(vec![]) }, "no break is drawn"),
        (Statement { clean: true, ..of(vec![good()], None) }, "as clean, but breaks are drawn (1)"),
        (of(vec![], None), "break 1 has no shape: draw its outline, or remove the break"),
        (of(vec![shape(4.0, &[[1.0, 1.0], [2.0, 2.0]])], None), "shape from 4 s: found 2 corners, at least 3"),
        (
            of(vec![rectangle(4.0, [1.0, 1.0], [9.6, 4.0])], None),
            "corner 2 at (9.6, 1) px lies outside of the picture, which has 10×6",
        ),
        (of(vec![rectangle(4.0, [f64::NAN, 1.0], [9.0, 4.0])], None), "lies outside"),
        (
            of(vec![shape(4.0, &[[1.0, 1.0], [4.0, 4.0], [4.0, 1.0], [1.0, 4.0]])], None),
            "the side after corner 1 meets the side after corner 3",
        ),
        (
            of(vec![rectangle(2.5, [1.0, 1.0], [4.0, 4.0])], None),
            "begins at 2.5 s, before the first wet picture at 3 s",
        ),
        (of(vec![rectangle(f64::NAN, [1.0, 1.0], [4.0, 4.0])], None), "before the first wet picture"),
        (
            of(vec![rectangle(8.5, [1.0, 1.0], [4.0, 4.0])], None),
            "the break begins at 8.5 s, after the clip's last wet picture at 8 s",
        ),
        (of(vec![good(), rectangle(9.0, [1.0, 1.0], [4.0, 4.0])], None), "the last shape begins at 9 s"),
        (of(vec![good(), good()], None), "a shape begins at 4 s, but the previous shape begins at 4 s"),
        (of(vec![good()], Some(4.0)), "closes again at 4 s, but its last shape begins at 4 s"),
        (of(vec![good()], Some(8.5)), "the break closes again at 8.5 s, after the clip's last"),
    ];
    for (statement, words) in cases {
        let found: Vec<String> = problems(&statement, &frame()).iter().map(ToString::to_string).collect();
        assert!(found.len() == 1 && found[0].contains(words), "{words}: {found:?}");
    }
    let long = ClipFrame { wet_times_s: vec![3.0, 900.0], ..frame() };
    let late = of(vec![rectangle(700.0, [1.0, 1.0], [4.0, 4.0])], None);
    assert_eq!(problems(&late, &long), [Problem::TooLate { number: 1, since_wet_s: 697.0 }]);
    assert_eq!(problems(&statement(vec![]), &frame()), [], "a clean clip is a statement");
}

fn file(breaks: Vec<Break>) -> LabelFile {
    LabelFile {
        version: VERSION,
        author: "Zoë \"Z\" Ångström".to_owned(),
        saved_at: "2026-11-24 11:20:03 UTC".to_owned(),
        clip_sha256: "ba78".to_owned(),
        size_px: [10, 6],
        clean: breaks.is_empty(),
        breaks,
    }
}

#[test]
fn what_is_written_reads_back() {
    let two = Break {
        closes_s: Some(7.25),
        shapes: vec![rectangle(4.1, [1.1, 1.0], [4.0, 4.0]), shape(6.0, &[[0.1, 0.2], [3.0, 0.0], [0.3, 2.0]])],
    };
    let one = Break { closes_s: None, shapes: vec![rectangle(3.0, [0.0, 0.0], [1.0, 1.0])] };
    for file in [file(vec![]), file(vec![two.clone()]), file(vec![one, two])] {
        let text = write(&file);
        assert_eq!(read(text.as_bytes()).expect("it reads"), file, "{text}");
    }
    let text = write(&file(vec![]));
    assert!(text.contains("\n  \"breaks\": []\n") && text.ends_with("}\n"), "{text}");
}

#[test]
fn another_form_is_refused_with_its_line() {
    let text = write(&file(vec![]));
    let refusal = |text: &str| read(text.as_bytes()).expect_err("refused").to_string();
    assert_eq!(
        refusal(&text.replace("\"version\": 1", "\"version\": 2")),
        "the label file has version 2; this program reads version 1"
    );
    assert!(refusal(&text.replace("clean", "cleen")).contains("unknown field `cleen`"));
    assert!(refusal("{\"version\": 1").contains("at line 1"));
    assert!(refusal("[]").contains("the content is not a valid label file"));
}
