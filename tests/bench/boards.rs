//! Boards in poor pictures: measures the fraction of boards found, the accuracy and the time, compared with OpenCV's
//! own detectors in the same run. `cargo bench --bench boards -- [MIXTURES] [KIND] [only=WORDS] [alone] [after=NUMBER]
//! [save=FOLDER]`: the number of mixtures of difficulties for each kind of board; only one kind; only one part; without
//! OpenCV's detectors; with the seeds after this number. Boards that are not found are written to FOLDER as PGM
//! pictures.

#[path = "../board_pictures.rs"]
mod board_pictures;
#[path = "goal.rs"]
mod goal;

use board_pictures::{Hard, Judged, Rendered, camera, judge, no_board, random_difficulties, render};
use goal::Figure;
use opencv::core::{Mat, Point2f, Ptr, Size, TermCriteria, TermCriteria_COUNT, TermCriteria_EPS, Vector};
use opencv::prelude::*;
use opencv::{aruco, calib3d, imgproc};
use panelprep::calib::{Board, detect};
use panelprep::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point, median};
use std::process::ExitCode;
use std::time::Instant;

const WIDTH_PX: usize = 1944;
const SEEDS: u64 = 3;
/// Minimum fraction of boards that must be found.
const MIN_FOUND_FRACTION: f64 = 0.98;
/// Maximum time for a full-size picture, s.
const MAX_TIME_S: f64 = 1.0;
/// Maximum median time for a full-size picture, s.
const MAX_MEDIAN_TIME_S: f64 = 0.2;

type Corners = Option<detect::Corners>;

/// A board detector of one library.
struct Peer {
    name: &'static str,
    find: fn(&Board, &GrayPicture) -> Corners,
}

const CHESSBOARD: [Peer; 3] = [
    Peer { name: "panelprep", find: own },
    Peer { name: "findChessboardCorners", find: classic },
    Peer { name: "findChessboardCornersSB", find: sector_based },
];
const CHARUCO: [Peer; 2] =
    [Peer { name: "panelprep", find: own }, Peer { name: "interpolateCornersCharuco", find: charuco }];
const CIRCLES: [Peer; 2] = [Peer { name: "panelprep", find: own }, Peer { name: "findCirclesGrid", find: circles }];

/// A kind of board: its name on the command line, the board, the detectors, and its figure in the table.
type Kind = (&'static str, &'static str, &'static [Peer], Figure);

const KINDS: [Kind; 4] = [
    ("chessboard", "9x6", &CHESSBOARD, Figure("calib: boards found, chessboard")),
    ("charuco", "charuco:9x7:18:4X4_50", &CHARUCO, Figure("calib: ChArUco")),
    ("circles", "circles:9x7:25", &CIRCLES, Figure("calib: circles")),
    ("acircles", "acircles:4x11:20", &CIRCLES, Figure("calib: asymmetric circles")),
];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let mixtures = arguments.iter().find_map(|argument| argument.parse::<u64>().ok()).unwrap_or(60);
    let is_alone = arguments.iter().any(|argument| argument == "alone");
    let named = |name: &str| arguments.iter().find_map(|argument| argument.strip_prefix(name));
    let chosen = Chosen {
        mixtures,
        part: named("only=").unwrap_or(""),
        after: named("after=").and_then(|number| number.parse().ok()).unwrap_or(0),
        folder: named("save="),
    };
    let only = arguments.iter().find(|argument| KINDS.iter().any(|(kind, ..)| kind == argument));
    let mut missed = 0;
    for (kind, text, peers, figure) in KINDS {
        if only.is_none_or(|only| only == kind) {
            let square_mm = if text.contains("circles") { None } else { Some(25.0) };
            let Ok(board) = Board::parse(text, square_mm) else { return ExitCode::FAILURE };
            missed += sweep((kind, figure), &board, if is_alone { &peers[..1] } else { peers }, &chosen);
        }
    }
    println!("{missed} floors were missed");
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The part of the sweep that is selected by the arguments.
struct Chosen<'a> {
    mixtures: u64,
    part: &'a str,
    /// Only seeds after this number are used.
    after: u64,
    /// The folder for pictures in which a board or corner was not found.
    folder: Option<&'a str>,
}

/// Returns the cases with a single difficulty. Blur and board size are limited so that markers can still be read.
fn singles(board: &Board) -> Vec<(&'static str, Hard)> {
    let easy = Hard::EASY;
    let small = if board.markers().is_some() { 0.25 } else { 0.15 };
    vec![
        ("easy", easy),
        ("out of focus, 1.5 px", Hard { blur_px: 1.5, ..easy }),
        ("out of focus, 3 px", Hard { blur_px: 3.0, width_share: 0.7, tilt_deg: 15.0, ..easy }),
        ("noise of 8", Hard { noise: 8.0, ..easy }),
        ("contrast of 25", Hard { contrast: 25.0, ..easy }),
        ("glare over a tenth", Hard { glare: true, ..easy }),
        ("tilted by 60°", Hard { tilt_deg: 60.0, ..easy }),
        ("dark surroundings", Hard { dark: true, ..easy }),
        ("small", Hard { width_share: small, ..easy }),
    ]
}

/// Counts of the results of one detector.
#[derive(Default)]
struct Tally {
    /// Number of boards of which at least nine tenths of the visible corners were found.
    found: usize,
    /// Number of these boards with missing corners.
    nearly: usize,
    part: usize,
    wrong: usize,
    of: usize,
    square: f64,
    seconds: Vec<f64>,
}

impl Tally {
    fn add(&mut self, judged: Judged, seconds: f64) {
        self.of += 1;
        self.seconds.push(seconds);
        match judged {
            Judged::Found(rms) => {
                self.found += 1;
                self.square += rms * rms;
            }
            Judged::Nearly(rms, _) => {
                self.found += 1;
                self.nearly += 1;
                self.square += rms * rms;
            }
            Judged::Part(_) => self.part += 1,
            Judged::Wrong(_) => self.wrong += 1,
            Judged::Nothing => {}
        }
    }

    fn median_s(&self) -> f64 {
        median(&mut self.seconds.clone()).unwrap_or(0.0)
    }

    fn worst_s(&self) -> f64 {
        self.seconds.iter().copied().fold(0.0, f64::max)
    }

    fn summary(&self) -> String {
        format!(
            "{} of {} found, {} of them without a few corners ({} others in part, {} wrong), {:.3} px rms, {:.3} s median, {:.2} s worst",
            self.found,
            self.of,
            self.nearly,
            self.part,
            self.wrong,
            (self.square / self.found.max(1) as f64).sqrt(),
            self.median_s(),
            self.worst_s()
        )
    }
}

fn sweep((kind, figure): (&str, Figure), board: &Board, peers: &[Peer], chosen: &Chosen) -> usize {
    let camera = camera(WIDTH_PX);
    let mut all: Vec<Tally> = peers.iter().map(|_| Tally::default()).collect();
    let mut groups: Vec<(String, Vec<(Hard, u64)>)> = singles(board)
        .into_iter()
        .map(|(name, hard)| (name.to_owned(), (1..=SEEDS).map(|seed| (hard, chosen.after + seed)).collect()))
        .collect();
    let seeds = chosen.after + 1..=chosen.after + chosen.mixtures;
    let mixed = seeds.map(|seed| (random_difficulties(board, &camera, seed), 1000 + seed));
    groups.push(("mixtures".to_owned(), mixed.collect()));
    for (name, cases) in groups.into_iter().filter(|(name, _)| name.contains(chosen.part)) {
        let mut here: Vec<Tally> = peers.iter().map(|_| Tally::default()).collect();
        for (hard, seed) in cases {
            let rendered = render(board, &camera, &hard, seed);
            for (index, peer) in peers.iter().enumerate() {
                let (judged, found, seconds) = timed(peer, board, &rendered);
                if index == 0 && !matches!(judged, Judged::Found(_) | Judged::Nearly(..)) {
                    println!("        {judged:?} in seed {seed}: {hard:?}");
                    print_farthest(&rendered, found);
                    save(chosen.folder, &format!("{kind}_{seed}"), &rendered.picture);
                }
                here[index].add(judged, seconds);
                all[index].add(judged, seconds);
            }
        }
        for (peer, tally) in peers.iter().zip(&here) {
            println!("  {kind}, {name}: {}: {}", peer.name, tally.summary());
        }
    }
    let mut nothing: Vec<Tally> = peers.iter().map(|_| Tally::default()).collect();
    for seed in chosen.after + 1..=chosen.after + 2 * SEEDS {
        let rendered = Rendered { picture: no_board(&camera, seed), truth: vec![] };
        for (peer, tally) in peers.iter().zip(&mut nothing) {
            let started = Instant::now();
            let found = (peer.find)(board, &rendered.picture);
            let judged = if found.is_some() { Judged::Wrong(f64::INFINITY) } else { Judged::Nothing };
            tally.add(judged, started.elapsed().as_secs_f64());
        }
    }
    for (peer, tally) in peers.iter().zip(&nothing) {
        println!(
            "  {kind}, no board: {}: {} of {} pictures reported as a board, {:.3} s median, {:.2} s worst",
            peer.name,
            tally.wrong,
            tally.of,
            tally.median_s(),
            tally.worst_s()
        );
    }
    let share = all[0].found as f64 / all[0].of as f64;
    let found = format!("{} of {}", all[0].found, all[0].of);
    figure.report(&format!("{} %", 100.0 * MIN_FOUND_FRACTION), &found, share >= MIN_FOUND_FRACTION);
    let worst_s = all[0].worst_s().max(nothing[0].worst_s());
    let good = share >= MIN_FOUND_FRACTION
        && all[0].wrong + nothing[0].wrong == 0
        && worst_s <= MAX_TIME_S
        && all[0].median_s() <= MAX_MEDIAN_TIME_S
        && nothing[0].median_s() <= MAX_MEDIAN_TIME_S.max(all[0].worst_s());
    for (index, (peer, tally)) in peers.iter().zip(&all).enumerate() {
        let state = if index > 0 {
            "      "
        } else if good {
            "ok    "
        } else {
            "MISSED"
        };
        let ratio = tally.median_s() / all[0].median_s();
        println!(
            "{state} {kind}: {}: {:.1} %, {}; {ratio:.2} × our time",
            peer.name,
            100.0 * tally.found as f64 / tally.of as f64,
            tally.summary()
        );
    }
    usize::from(!good)
}

/// Prints the corners with the largest errors, and whether each of them is visible despite the glare.
fn print_farthest(rendered: &Rendered, found: Corners) {
    let off = |(q, pixel): (Point<BoardFrame>, Pixel)| {
        let (_, there, is_seen) = rendered.truth.iter().find(|(t, ..)| t.distance_mm(q) < 0.01)?;
        Some((pixel.distance_px(*there), q, *there, *is_seen))
    };
    let mut all: Vec<_> = found.unwrap_or_default().into_iter().filter_map(off).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (off_px, q, there, is_seen) in all.into_iter().take(3) {
        println!(
            "          {off_px:.2} px off: the corner at {:.0}, {:.0} mm, at pixel {:.0}, {:.0}{}",
            q.mm.x,
            q.mm.y,
            there.u,
            there.v,
            if is_seen { "" } else { ", behind the glare" }
        );
    }
}

fn save(folder: Option<&str>, name: &str, picture: &GrayPicture) {
    if let Some(folder) = folder {
        let head = format!("P5 {} {} 255\n", picture.width, picture.height);
        let bytes = [head.as_bytes(), &picture.gray].concat();
        std::fs::write(format!("{folder}/{name}.pgm"), bytes).expect("a folder for pictures");
    }
}

fn timed(peer: &Peer, board: &Board, rendered: &Rendered) -> (Judged, Corners, f64) {
    let started = Instant::now();
    let found = (peer.find)(board, &rendered.picture);
    let seconds = started.elapsed().as_secs_f64();
    (judge(board, rendered, found.as_ref()), found, seconds)
}

fn own(board: &Board, picture: &GrayPicture) -> Corners {
    detect::detect("picture", picture, board, None).ok().map(|found| found.corners)
}

/// Refines and orders corners as OpenCV's tutorials do: all corners are refined by `cornerSubPix` with a window of ± 5
/// px, and any of four orders is accepted.
fn ordered(board: &Board, points: &Vector<Point2f>) -> Corners {
    let corners = board.corners();
    if points.len() != corners.len() {
        return None;
    }
    let mut pixels: Vec<Pixel> = points.iter().map(|p| Pixel::at(p.x.into(), p.y.into())).collect();
    let columns = board.columns();
    let (first, right, below) = (pixels[0], pixels[columns - 1], pixels[pixels.len() - columns]);
    if (right.u - first.u) * (below.v - first.v) < (right.v - first.v) * (below.u - first.u) {
        pixels.chunks_mut(columns).for_each(<[Pixel]>::reverse);
    }
    // The tilted boards of this sweep are rotated by less than 90°, so the first corner is the upper or left one.
    let last = pixels[pixels.len() - 1];
    if pixels[columns - 1].u - pixels[0].u + last.v - pixels[0].v < 0.0 {
        pixels.reverse();
    }
    Some(corners.into_iter().zip(pixels).collect())
}

fn mat(picture: &GrayPicture) -> Mat {
    let mut copy = Mat::new_rows_cols_with_default(
        picture.height as i32,
        picture.width as i32,
        opencv::core::CV_8UC1,
        opencv::core::Scalar::all(0.0),
    )
    .expect("memory");
    copy.data_bytes_mut().expect("bytes").copy_from_slice(&picture.gray);
    copy
}

fn classic(board: &Board, picture: &GrayPicture) -> Corners {
    let (source, mut found) = (mat(picture), Vector::<Point2f>::new());
    let size = Size::new(board.columns() as i32, board.rows() as i32);
    let flags =
        calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE | calib3d::CALIB_CB_FAST_CHECK;
    if !calib3d::find_chessboard_corners(&source, size, &mut found, flags).ok()? {
        return None;
    }
    let until = TermCriteria::new(TermCriteria_COUNT + TermCriteria_EPS, 30, 1e-3).ok()?;
    imgproc::corner_sub_pix(&source, &mut found, Size::new(5, 5), Size::new(-1, -1), until).ok()?;
    ordered(board, &found)
}

fn sector_based(board: &Board, picture: &GrayPicture) -> Corners {
    let (source, mut found) = (mat(picture), Vector::<Point2f>::new());
    let size = Size::new(board.columns() as i32, board.rows() as i32);
    let flags = calib3d::CALIB_CB_NORMALIZE_IMAGE | calib3d::CALIB_CB_ACCURACY;
    calib3d::find_chessboard_corners_sb(&source, size, &mut found, flags).ok()?.then_some(())?;
    ordered(board, &found)
}

fn circles(board: &Board, picture: &GrayPicture) -> Corners {
    let (source, mut found) = (mat(picture), Vector::<Point2f>::new());
    let size = Size::new(board.columns() as i32, board.rows() as i32);
    let flags = match board.circles()? {
        true => calib3d::CALIB_CB_ASYMMETRIC_GRID,
        false => calib3d::CALIB_CB_SYMMETRIC_GRID,
    };
    let detector = opencv::features2d::SimpleBlobDetector::create_def().ok()?;
    let detector: Ptr<opencv::features2d::Feature2D> = detector.into();
    calib3d::find_circles_grid(&source, size, &mut found, flags, Some(&detector)).ok()?.then_some(())?;
    ordered(board, &found)
}

fn charuco(board: &Board, picture: &GrayPicture) -> Corners {
    let markers = board.markers()?;
    let source = mat(picture);
    let dictionary = aruco::get_predefined_dictionary_i32(0).ok()?;
    let (columns, rows) = (board.columns() as i32 + 1, board.rows() as i32 + 1);
    let theirs =
        aruco::CharucoBoard::create(columns, rows, board.square_mm() as f32, markers.marker_mm as f32, &dictionary)
            .ok()?;
    let (mut corners, mut numbers): (Vector<Vector<Point2f>>, Vector<i32>) = (Vector::new(), Vector::new());
    let parameters = aruco::DetectorParameters::create().ok()?;
    let mut rejected: Vector<Vector<Point2f>> = Vector::new();
    aruco::detect_markers(&source, &dictionary, &mut corners, &mut numbers, &parameters, &mut rejected).ok()?;
    if numbers.is_empty() {
        return None;
    }
    let (mut found, mut places): (Vector<Point2f>, Vector<i32>) = (Vector::new(), Vector::new());
    aruco::interpolate_corners_charuco(
        &corners,
        &numbers,
        &source,
        &theirs,
        &mut found,
        &mut places,
        &Mat::default(),
        &Mat::default(),
        2,
    )
    .ok()?;
    if found.is_empty() {
        return None;
    }
    // The corners are numbered row by row from the lower left or the upper left, depending on OpenCV's version.
    let all = board.corners();
    let place = |number: i32| {
        let (column, row) = (number as usize % board.columns(), number as usize / board.columns());
        all.get(row * board.columns() + column).copied()
    };
    found.iter().zip(places.iter()).map(|(p, n)| Some((place(n)?, Pixel::at(p.x.into(), p.y.into())))).collect()
}
