//! Runs every file of the corpus, every seed, and seeded changes of them through each target: no panic, no
//! execution of more than a second of computing. `make fuzz` judges the memory of an execution.

use super::change::changed;
use super::targets::{TARGETS, Target};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rustix::time::{ClockId, clock_gettime};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

/// Changes per target; `FUZZ_CHANGES` in the environment sets a higher number.
const CHANGES: u64 = 3_000;
/// Limit of the computing time of one execution. It is measured by the thread's own clock, because other tests run
/// at the same time.
const EXECUTION_TIMEOUT: Duration = Duration::from_secs(1);
/// Time limit of a target, even if some of its changes were not tried.
const TARGET_TIME_LIMIT: Duration = Duration::from_secs(20);

fn computed() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.cast_unsigned(), now.tv_nsec as u32)
}

fn corpus(target: &Target) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/fuzz").join(target.name);
    let mut files: Vec<_> =
        std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.expect("a file").path()).collect();
    files.sort();
    files.iter().map(|file| std::fs::read(file).expect("a file")).collect()
}

/// Returns what is wrong with an execution; `None` if nothing is.
fn wrong(target: &Target, bytes: &[u8]) -> Option<String> {
    let before = computed();
    let ended = catch_unwind(AssertUnwindSafe(|| (target.run)(bytes)));
    let took = computed() - before;
    match ended {
        Err(panic) => {
            let words = panic.downcast_ref::<String>().cloned();
            let words = words.or_else(|| panic.downcast_ref::<&str>().map(|words| (*words).to_owned()));
            Some(format!("it panics: {}", words.unwrap_or_default()))
        }
        Ok(()) => (took > EXECUTION_TIMEOUT).then(|| format!("it computes for {took:?}")),
    }
}

/// Writes the bytes of a wrong execution to a file, so that they can be given to `make fuzz` and stored.
fn keep(target: &Target, bytes: &[u8], why: &str) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join(format!("{}-{}", target.name, panelprep::files::content_hash(bytes)));
    std::fs::write(&file, bytes).expect("written");
    format!("{}: {why}; the bytes are in {}", target.name, file.display())
}

#[test]
fn no_reader_fails_on_invalid_bytes() {
    let changes = std::env::var("FUZZ_CHANGES").ok().and_then(|text| text.parse().ok()).unwrap_or(CHANGES);
    let mut found = Vec::new();
    for (index, target) in TARGETS.iter().enumerate() {
        let known = [(target.seeds)(), corpus(target)].concat();
        assert!(!known.is_empty(), "{} has no seed", target.name);
        found.extend(known.iter().filter_map(|bytes| Some(keep(target, bytes, &wrong(target, bytes)?))));
        let (mut draw, begun, mut done) = (Pcg64::seed_from_u64(index as u64), computed(), 0);
        while done < changes && (changes > CHANGES || computed() - begun < TARGET_TIME_LIMIT) {
            let [one, other] = [0, 1].map(|_| &known[draw.random_range(0..known.len())]);
            let bytes = changed(one, other, &mut draw);
            if let Some(why) = wrong(target, &bytes) {
                found.push(keep(target, &bytes, &why));
                break;
            }
            done += 1;
        }
        println!("{:16} {:4} of the corpus, {done} changes, {:?}", target.name, known.len(), computed() - begun);
    }
    assert!(found.is_empty(), "{found:#?}");
}

/// Checks that the judge sees a reader that panics, and a reader that does not return in time.
#[test]
fn a_reader_that_fails_is_reported() {
    let panics = Target { name: "panics", run: |bytes| assert!(bytes.len() < 3, "too long"), seeds: Vec::new };
    assert_eq!(wrong(&panics, b"ab"), None);
    assert_eq!(wrong(&panics, b"abc").as_deref(), Some("it panics: too long"));
    let computes = |_: &[u8]| {
        let begun = computed();
        while computed() - begun < EXECUTION_TIMEOUT + Duration::from_millis(20) {
            std::hint::spin_loop();
        }
    };
    let slow = Target { name: "slow", run: computes, seeds: Vec::new };
    assert!(wrong(&slow, b"").is_some_and(|why| why.starts_with("it computes for 1.")));
}

/// Checks that `make fuzz` searches in every target.
#[test]
fn make_fuzz_searches_in_every_target() {
    let makefile =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("Makefile")).expect("it is there");
    let listed = makefile.lines().find_map(|line| line.strip_prefix("FUZZ_TARGETS := ")).expect("the list");
    let names = TARGETS.each_ref().map(|target| target.name);
    assert_eq!(listed.split_whitespace().collect::<Vec<_>>(), names);
}

/// A source that must be read in steps of no more than a megabyte.
struct Sparing<'b>(&'b [u8]);

impl std::io::Read for Sparing<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        assert!(into.len() <= 1 << 20, "room for {} bytes at once", into.len());
        self.0.read(into)
    }
}

/// A recording's record claims 250 MB and is cut: it is refused, and this memory is not allocated.
#[test]
fn a_record_with_a_false_size_allocates_no_memory() {
    let mut file = b"\x89MCAP0\r\n\x01".to_vec();
    file.extend(250_000_000_u64.to_le_bytes());
    assert!(panelprep::tape::check_recording(Sparing(&file)).is_err());
}
