//! Checks whether the labels of a clip are consistent. All problems are reported at once, each with the number of its
//! break.

use super::statement::{Break, Shape, Statement};
use panelprep_base::geometry::{Pixel, polygon};

/// Maximum length of the author's name, characters.
const MAX_AUTHOR_CHARACTERS: usize = 200;
/// Minimum number of corners of a polygon.
const MIN_CORNERS: usize = 3;
/// Maximum time that `times.png` can store, s since the first wet picture.
pub const MAX_SINCE_WET_S: f64 = 655.35;

/// The properties of a clip that its labels refer to.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipFrame {
    /// Width and height of the clip's pictures, px.
    pub size_px: [usize; 2],
    /// The times of the wet pictures in order, s of the clip; at least one.
    pub wet_times_s: Vec<f64>,
}

impl ClipFrame {
    /// Returns the time of the first fully wet picture, s of the clip.
    pub fn wet_from_s(&self) -> f64 {
        self.wet_times_s.first().copied().unwrap_or_default()
    }

    /// Returns the time of the last wet picture, s of the clip.
    pub fn ends_s(&self) -> f64 {
        self.wet_times_s.last().copied().unwrap_or_default()
    }
}

/// A problem of the labels. Breaks and corners are counted from 1; times are s of the clip.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// The author's name is missing.
    #[error("the name of the person who labels is missing")]
    NoAuthor,
    /// The author's name is not valid.
    #[error(
        "the name is not valid: {found} characters (limit {MAX_AUTHOR_CHARACTERS}; control characters are not permitted)"
    )]
    BadAuthor {
        /// Number of characters in the name.
        found: usize,
    },
    /// There is no break, and the clip is not marked as clean.
    #[error("no break is drawn: draw the breaks, or mark the clip as clean")]
    NothingSaid,
    /// The clip is marked as clean, but there are breaks.
    #[error("the clip is marked as clean, but breaks are drawn ({found}): remove the mark or the breaks")]
    CleanWithBreaks {
        /// Number of breaks that are drawn.
        found: usize,
    },
    /// A break without a shape.
    #[error("break {number} has no shape: draw its outline, or remove the break")]
    NoShape {
        /// Number of the break.
        number: usize,
    },
    /// A shape with fewer than three corners.
    #[error("break {number}, shape from {from_s} s: found {found} corners, at least {MIN_CORNERS} are needed")]
    TooFewCorners {
        /// Number of the break.
        number: usize,
        /// Start time of the shape, by which it is identified.
        from_s: f64,
        /// Number of corners of the shape.
        found: usize,
    },
    /// A corner lies outside of the picture.
    #[error(
        "break {number}, shape from {from_s} s: corner {corner} at ({u}, {v}) px lies outside of the picture, which has {width}×{height} px"
    )]
    Outside {
        /// Number of the break.
        number: usize,
        /// Start time of the shape, by which it is identified.
        from_s: f64,
        /// Number of the corner.
        corner: usize,
        /// Column of the corner, px.
        u: f64,
        /// Row of the corner, px.
        v: f64,
        /// Width of the picture, px.
        width: usize,
        /// Height of the picture, px.
        height: usize,
    },
    /// The outline of a shape crosses itself, so that its interior is not defined.
    #[error(
        "break {number}, shape from {from_s} s: the side after corner {first} meets the side after corner {second}; an outline must not cross itself"
    )]
    Crosses {
        /// Number of the break.
        number: usize,
        /// Start time of the shape, by which it is identified.
        from_s: f64,
        /// Number of the corner at which the first side begins.
        first: usize,
        /// Number of the corner at which the second side begins.
        second: usize,
    },
    /// A break begins before the first wet picture.
    #[error(
        "break {number} begins at {from_s} s, before the first wet picture at {wet_from_s} s; let the break of a \
         place that never became wet begin with the first wet picture"
    )]
    BeforeWet {
        /// Number of the break.
        number: usize,
        /// Start time of the break, s.
        from_s: f64,
        /// Time of the first wet picture, s.
        wet_from_s: f64,
    },
    /// A time after the last wet picture.
    #[error("break {number}: {what} {time_s} s, after the clip's last wet picture at {ends_s} s")]
    AfterEnd {
        /// Number of the break.
        number: usize,
        /// What has this time: the beginning, a later shape, or the end of the break.
        what: &'static str,
        /// The time, s.
        time_s: f64,
        /// Time of the last wet picture, s.
        ends_s: f64,
    },
    /// A time that is larger than `times.png` can store.
    #[error(
        "break {number}: a shape begins {since_wet_s} s after the first wet picture (limit {MAX_SINCE_WET_S} s, \
         the largest time that times.png can store)"
    )]
    TooLate {
        /// Number of the break.
        number: usize,
        /// The time, s since the first wet picture.
        since_wet_s: f64,
    },
    /// The shapes of a break are not in the order of their start times.
    #[error(
        "break {number}: a shape begins at {from_s} s, but the previous shape begins at {before_s} s; each shape \
         must begin later than the previous one"
    )]
    NotLater {
        /// Number of the break.
        number: usize,
        /// Start time of the second shape, s.
        from_s: f64,
        /// Start time of the first shape, s.
        before_s: f64,
    },
    /// A break closes before its last shape begins.
    #[error(
        "break {number} closes again at {closes_s} s, but its last shape begins at {from_s} s; the break must \
         close later"
    )]
    ClosesEarly {
        /// Number of the break.
        number: usize,
        /// Time at which the break closes, s.
        closes_s: f64,
        /// Start time of the last shape, s.
        from_s: f64,
    },
}

/// Returns all problems of the labels of this clip; labels without problems can be saved.
pub fn problems(said: &Statement, frame: &ClipFrame) -> Vec<Problem> {
    let mut problems = Vec::new();
    let found = said.author.chars().count();
    if said.author.trim().is_empty() {
        problems.push(Problem::NoAuthor);
    } else if found > MAX_AUTHOR_CHARACTERS || said.author.chars().any(char::is_control) {
        problems.push(Problem::BadAuthor { found });
    }
    match (said.clean, said.breaks.len()) {
        (false, 0) => problems.push(Problem::NothingSaid),
        (true, found @ 1..) => problems.push(Problem::CleanWithBreaks { found }),
        _ => {}
    }
    for (index, one) in said.breaks.iter().enumerate() {
        check_times(index + 1, one, frame, &mut problems);
        for shape in &one.shapes {
            problems.extend(outline(index + 1, shape, frame));
        }
    }
    problems
}

/// Checks the times of a break.
fn check_times(number: usize, one: &Break, frame: &ClipFrame, problems: &mut Vec<Problem>) {
    let (Some(first), Some(last)) = (one.shapes.first(), one.shapes.last()) else {
        return problems.push(Problem::NoShape { number });
    };
    let (wet_from_s, ends_s) = (frame.wet_from_s(), frame.ends_s());
    // These comparisons are false for NaN, so that NaN is reported as a problem.
    let is_wet = first.from_s >= wet_from_s;
    let is_later = |time_s: f64, before_s: f64| time_s > before_s;
    if !is_wet {
        problems.push(Problem::BeforeWet { number, from_s: first.from_s, wet_from_s });
    }
    for pair in one.shapes.windows(2).filter(|pair| !is_later(pair[1].from_s, pair[0].from_s)) {
        problems.push(Problem::NotLater { number, from_s: pair[1].from_s, before_s: pair[0].from_s });
    }
    if last.from_s > ends_s {
        let what = if one.shapes.len() == 1 { "the break begins at" } else { "the last shape begins at" };
        problems.push(Problem::AfterEnd { number, what, time_s: last.from_s, ends_s });
    } else if last.from_s - wet_from_s > MAX_SINCE_WET_S {
        problems.push(Problem::TooLate { number, since_wet_s: last.from_s - wet_from_s });
    }
    if let Some(closes_s) = one.closes_s {
        if closes_s > ends_s {
            problems.push(Problem::AfterEnd {
                number,
                what: "the break closes again at",
                time_s: closes_s,
                ends_s,
            });
        }
        if !is_later(closes_s, last.from_s) {
            problems.push(Problem::ClosesEarly { number, closes_s, from_s: last.from_s });
        }
    }
}

/// Returns the first problem of a shape's outline.
fn outline(number: usize, shape: &Shape, frame: &ClipFrame) -> Option<Problem> {
    let (from_s, [width, height]) = (shape.from_s, frame.size_px);
    let found = shape.corners_px.len();
    if found < MIN_CORNERS {
        return Some(Problem::TooFewCorners { number, from_s, found });
    }
    // The picture extends half a pixel beyond the centres of its outer pixels.
    let is_on = |value: f64, count: usize| (-0.5..=count as f64 - 0.5).contains(&value);
    let outside = |[u, v]: &[f64; 2]| !is_on(*u, width) || !is_on(*v, height);
    if let Some(index) = shape.corners_px.iter().position(outside) {
        let [u, v] = shape.corners_px[index];
        return Some(Problem::Outside { number, from_s, corner: index + 1, u, v, width, height });
    }
    let corners: Vec<Pixel> = shape.corners_px.iter().map(|&[u, v]| Pixel::at(u, v)).collect();
    let [first, second] = polygon::crossing_sides(&corners)?;
    Some(Problem::Crosses { number, from_s, first: first + 1, second: second + 1 })
}
