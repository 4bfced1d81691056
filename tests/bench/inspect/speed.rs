//! Measures the time from a decoded 1944×1200 frame to its result, compared with the thesis's pipeline in Python's
//! OpenCV on the same frames, and the memory for a whole clip.

use crate::clips::{Bench, phase};
use crate::goal::Figure;
use panelprep::files::{read_color, write_color_jpeg};
use panelprep::geometry::statistics::{QuantileRank, quantile};
use panelprep::phase::Phase;
use panelprep::sim::{FilmSpec, Grease, WET_FROM_S};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const FRAMES: u32 = 300;

pub fn run(reduction: usize) {
    let bench = Bench::new(3, reduction, "");
    let spots = bench.cell.with_other_grease(&Grease::Mixed { count: 5, until_s: WET_FROM_S + 40.0 }, 3);
    let film = bench.cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, 3);
    let folder = std::env::temp_dir().join(format!("panelprep-frames-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for passing frames");
    let frames = FRAMES / (reduction * reduction) as u32;
    let mut picture = film.picture(0.0);
    let mut watch = bench.watch(60.0, None);
    for (index, time_s) in [0.2, 2.0, 3.0].into_iter().enumerate() {
        film.renew(&mut picture, time_s);
        watch.push(&picture, index as f64, phase(&film, time_s)).expect("in order");
    }
    let (mut decoding, mut judging, mut copying) = (Vec::new(), Vec::new(), Vec::new());
    let mut copy = picture.clone();
    for frame in 0..=frames {
        let time_s = WET_FROM_S + f64::from(frame) / 5.0;
        film.renew(&mut picture, time_s);
        let jpeg = write_color_jpeg(&picture).expect("a picture");
        std::fs::write(folder.join(format!("{frame:04}.jpg")), &jpeg).expect("room for frames");
        let begun = Instant::now();
        let decoded = read_color(&jpeg).expect("a picture");
        decoding.push(begun.elapsed());
        let begun = Instant::now();
        watch.push(&decoded, 10.0 + time_s, Phase::Wet).expect("in order");
        judging.push(begun.elapsed());
        // The time of a simple copy shows how busy the machine was during the measurement.
        let begun = Instant::now();
        copy.rgb.copy_from_slice(std::hint::black_box(&decoded.rgb));
        copying.push(begun.elapsed());
    }
    let begun = Instant::now();
    let inspection = watch.finish().expect("wet pictures");
    let finishing = begun.elapsed();
    let ms = |times: &mut Vec<Duration>, share: f64| {
        quantile(times, share, QuantileRank::Lower).expect("pictures").as_secs_f64() * 1e3
    };
    println!(
        "speed, {} frames of {}×{} px on {} threads: judging, median {:.2} ms, fastest tenth {:.2} ms, 95 % {:.2} ms \
         (needed 1.5 ms); copying the picture, on one thread, {:.2} ms; decoding {:.2} ms; the end of the film {:.0} ms",
        judging.len(),
        picture.width,
        picture.height,
        rayon::current_num_threads(),
        ms(&mut judging, 0.5),
        ms(&mut judging, 0.1),
        ms(&mut judging, 0.95),
        ms(&mut copying, 0.5),
        ms(&mut decoding, 0.5),
        finishing.as_secs_f64() * 1e3,
    );
    let median_ms = ms(&mut judging, 0.5);
    let found = format!("{median_ms:.2} ms");
    Figure("film: time for a decoded picture, median").report("1.5 ms", &found, median_ms <= 1.5);
    peers(&folder, &inspection.footprint.region());
    std::fs::remove_dir_all(&folder).expect("our folder");
}

fn peers(folder: &Path, region: &panelprep::geometry::Mask) {
    let Ok(python) = std::env::var("PANELPREP_PEERS") else {
        println!("  the thesis's pipeline in Python: not run; `make bench-inspect` sets it up");
        return;
    };
    let inside = (0..region.inside.len()).filter(|&index| region.inside[index]);
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    for index in inside {
        let place = [index % region.width, index / region.width];
        (0..2).for_each(|axis| (low[axis], high[axis]) = (low[axis].min(place[axis]), high[axis].max(place[axis])));
    }
    let box_px = [low[0], low[1], high[0] - low[0] + 1, high[1] - low[1] + 1].map(|px| px.to_string());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bench/inspect/thesis_opencv.py");
    let ran = Command::new(python).arg(script).arg(folder).args(box_px).status();
    if !ran.is_ok_and(|status| status.success()) {
        println!("  the thesis's pipeline in Python could not be run");
    }
}

/// Measures the peak memory of `panelprep inspect` for a clip of 60 s, as reported by the operating system.
pub fn memory(reduction: usize) {
    let folder = std::env::temp_dir().join(format!("panelprep-memory-{}", std::process::id()));
    let file = |name: &str| folder.join(name).display().to_string();
    let panelprep = |arguments: &str| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(arguments.split_whitespace())
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("the program");
        let status = format!("/proc/{}/status", child.id());
        let mut most_mb = 0.0_f64;
        while child.try_wait().expect("ours").is_none() {
            let text = std::fs::read_to_string(&status).unwrap_or_default();
            let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
            let kb = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
            most_mb = most_mb.max(kb.unwrap_or(0.0) / 1024.0);
            std::thread::sleep(Duration::from_millis(20));
        }
        most_mb
    };
    let (cell, recipe) = (file("cell.toml"), file("recipe.toml"));
    panelprep(&format!("render --seed 3 --reduction {reduction} --out {}", folder.display()));
    panelprep(&format!(
        "teach --cell {cell} --recipe {recipe} --scan {} --corner {} --flange {}",
        file("taught_scan.pcd"),
        file("taught_corner.png"),
        file("taught_flange.json")
    ));
    let most_mb = panelprep(&format!("inspect --cell {cell} --recipe {recipe} --clip {}", file("clip")));
    let found = format!("{most_mb:.0} MB");
    // A value of 0 means that the memory could not be read.
    Figure("film: memory for 60 s").report("400 MB", &found, most_mb > 0.0 && most_mb < 400.0);
    println!("memory of `panelprep inspect` on a clip of 60 s: {most_mb:.0} MB (needed below 400 MB)");
    std::fs::remove_dir_all(&folder).expect("our folder");
}
