//! Runs damaged scans, corner pictures and clips of the simulated cell through the stages. No damage may turn a broken
//! film into a pass, or move the panel's pose by more than 0.02 mm without a report. Damage to a file is detected by
//! the PNG's checksum. Damage to the pixels on their way from the camera, before the file is written, can be detected
//! only by the stages; the parts `pixels` and `film` test this. Noise over a corner's edge may move the corner
//! slightly. For the part `pixels` this distance is printed without a limit, because a camera's packets and files have
//! checksums. `cargo bench --bench damage -- [scans=4000] [pictures=1000] [pixels=2500] [clips=500] [film=2000]
//! [reduction=1] [seed=1]`

#[path = "damage/bytes.rs"]
mod bytes;
#[path = "damage/cell.rs"]
mod cell;
#[path = "goal.rs"]
mod goal;

use bytes::DAMAGES;
use cell::{Found, UndamagedFiles};
use goal::Figure;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::process::ExitCode;
use std::time::Instant;

/// Maximum distance of an accepted pose from the pose of the undamaged files at which the two poses are treated as
/// equal, mm.
const MAX_EQUAL_SHIFT_MM: f64 = 0.02;

/// Counts of the results for the files with one kind of damage.
#[derive(Default)]
struct Tally {
    files: usize,
    /// Number of files that the reader refused.
    refused: usize,
    /// Number of results with another verdict than accept.
    reported: usize,
    /// Number of accepted results that equal those of the undamaged files.
    harmless: usize,
    /// Number of accepted results that differ from those of the undamaged files.
    unnoticed: usize,
    /// The largest distance by which an accepted pose was moved, mm.
    moved_mm: f64,
}

impl Tally {
    fn add(&mut self, found: &Found) -> bool {
        self.files += 1;
        match *found {
            Found::Refused => self.refused += 1,
            Found::Reported => self.reported += 1,
            Found::Pose { moved_mm } => {
                self.moved_mm = self.moved_mm.max(moved_mm);
                match moved_mm <= MAX_EQUAL_SHIFT_MM {
                    true => self.harmless += 1,
                    false => self.unnoticed += 1,
                }
            }
            Found::StillFails => self.harmless += 1,
            Found::Passed => self.unnoticed += 1,
        }
        matches!(*found, Found::Passed)
            || matches!(*found, Found::Pose { moved_mm } if moved_mm > MAX_EQUAL_SHIFT_MM)
    }

    fn print(&self, what: &str, damage: &str) {
        let Tally { files, refused, reported, harmless, unnoticed, moved_mm } = self;
        println!(
            "{what:8} {damage:22} {files:6} {refused:8} {reported:8} {harmless:9} {unnoticed:10} {moved_mm:9.4}"
        );
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, usual: u64| {
        let text = arguments.iter().find_map(|argument| argument.strip_prefix(name)?.strip_prefix('='));
        text.map_or(usual, |text| text.parse().expect("a number"))
    };
    let held = UndamagedFiles::new(number("seed", 1), number("reduction", 1) as usize);
    println!("file     damage                  files  refused reported  harmless  unnoticed  moved, mm");
    let parts: [(&str, u64, Part); 5] = [
        ("scan", number("scans", 4_000), UndamagedFiles::located),
        ("picture", number("pictures", 1_000), UndamagedFiles::refined),
        ("pixels", number("pixels", 2_500), UndamagedFiles::refined_by_pixels),
        ("clip", number("clips", 500), UndamagedFiles::inspected),
        ("film", number("film", 2_000), UndamagedFiles::inspected_by_pixels),
    ];
    let (mut all, mut wrong, mut by_pixels) = (0, 0, 0);
    let pixels = parts[2].1 as usize;
    for (what, count, judge) in parts {
        let begun = Instant::now();
        let mut tallies: [Tally; DAMAGES.len()] = Default::default();
        for index in 0..count {
            let kind = (index % DAMAGES.len() as u64) as usize;
            let mut draw = Pcg64::seed_from_u64(index);
            if tallies[kind].add(&judge(&held, &DAMAGES[kind].1, &mut draw)) {
                println!("{what} {index}: {}, not noticed", DAMAGES[kind].0);
            }
        }
        for (tally, (damage, _)) in tallies.iter().zip(DAMAGES) {
            tally.print(what, damage);
            all += tally.files;
            *(if what == "pixels" { &mut by_pixels } else { &mut wrong }) += tally.unnoticed;
        }
        println!("{what}: {count} in {:.1} s", begun.elapsed().as_secs_f64());
    }
    let found = format!("{wrong} of {}", all - pixels);
    let is_noticed = wrong == 0 && all > pixels;
    Figure("inputs: unnoticed damaged files, without damaged pixels of pictures").report("0", &found, is_noticed);
    Figure("inputs: with them").report("–", &format!("{by_pixels} of {pixels}"), true);
    println!(
        "{all} damaged files, {wrong} of them caused a pass or moved a pose by more than {MAX_EQUAL_SHIFT_MM} mm unnoticed (needed 0)"
    );
    if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// A function that damages one of the files and returns the result of the stages.
type Part = fn(&UndamagedFiles, &Damage, &mut Pcg64) -> Found;

/// A function that damages the bytes of a file.
type Damage = fn(&mut Vec<u8>, &mut Pcg64);

/// Returns a damaged copy of a file.
fn damaged(file: &[u8], damage: &Damage, draw: &mut Pcg64) -> Vec<u8> {
    let mut bytes = file.to_vec();
    damage(&mut bytes, draw);
    bytes
}

/// Draws an index below `count`.
fn random_index(count: usize, draw: &mut Pcg64) -> usize {
    draw.random_range(0..count)
}
