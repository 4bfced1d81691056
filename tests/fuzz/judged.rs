//! Runs every file of the corpus, every seed, and random changes of them through each target. No execution may panic or
//! compute for more than a second. `make fuzz` also checks the memory of each execution.

use super::change::change_bytes;
use super::targets::{TARGETS, Target};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rustix::time::{ClockId, clock_gettime};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

/// Number of changes per target; `FUZZ_CHANGES` in the environment sets a higher number.
const DEFAULT_CHANGE_COUNT: u64 = 3_000;
/// Time limit for the computation of one execution. It is measured by the clock of the thread, because other tests run
/// at the same time.
const EXECUTION_TIMEOUT: Duration = Duration::from_secs(1);
/// Time limit of a target, even if some of its changes were not run.
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

/// Returns the problem with an execution; `None` if there is none.
fn execution_problem(target: &Target, bytes: &[u8]) -> Option<String> {
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

/// Writes the bytes of a failed execution to a file, for use with `make fuzz` and in the corpus.
fn save_failed_input(target: &Target, bytes: &[u8], why: &str) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join(format!("{}-{}", target.name, panelprep::files::content_hash(bytes)));
    std::fs::write(&file, bytes).expect("written");
    format!("{}: {why}; the bytes are in {}", target.name, file.display())
}

#[test]
fn no_reader_fails_on_invalid_bytes() {
    let changes =
        std::env::var("FUZZ_CHANGES").ok().and_then(|text| text.parse().ok()).unwrap_or(DEFAULT_CHANGE_COUNT);
    let mut found = Vec::new();
    for (index, target) in TARGETS.iter().enumerate() {
        let known = [(target.seeds)(), corpus(target)].concat();
        assert!(!known.is_empty(), "{} has no seed", target.name);
        found.extend(
            known
                .iter()
                .filter_map(|bytes| Some(save_failed_input(target, bytes, &execution_problem(target, bytes)?))),
        );
        let (mut draw, begun, mut done) = (Pcg64::seed_from_u64(index as u64), computed(), 0);
        while done < changes && (changes > DEFAULT_CHANGE_COUNT || computed() - begun < TARGET_TIME_LIMIT) {
            let [one, other] = [0, 1].map(|_| &known[draw.random_range(0..known.len())]);
            let bytes = change_bytes(one, other, &mut draw);
            if let Some(why) = execution_problem(target, &bytes) {
                found.push(save_failed_input(target, &bytes, &why));
                break;
            }
            done += 1;
        }
        println!("{:16} {:4} of the corpus, {done} changes, {:?}", target.name, known.len(), computed() - begun);
    }
    assert!(found.is_empty(), "{found:#?}");
}

/// Checks that a reader that panics, and a reader that does not return in time, are reported.
#[test]
fn a_reader_that_fails_is_reported() {
    let panics = Target { name: "panics", run: |bytes| assert!(bytes.len() < 3, "too long"), seeds: Vec::new };
    assert_eq!(execution_problem(&panics, b"ab"), None);
    assert_eq!(execution_problem(&panics, b"abc").as_deref(), Some("it panics: too long"));
    let computes = |_: &[u8]| {
        let begun = computed();
        while computed() - begun < EXECUTION_TIMEOUT + Duration::from_millis(20) {
            std::hint::spin_loop();
        }
    };
    let slow = Target { name: "slow", run: computes, seeds: Vec::new };
    assert!(execution_problem(&slow, b"").is_some_and(|why| why.starts_with("it computes for 1.")));
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

/// A source that must be read in steps of at most a megabyte.
struct LimitedReader<'b>(&'b [u8]);

impl std::io::Read for LimitedReader<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        assert!(into.len() <= 1 << 20, "room for {} bytes at once", into.len());
        self.0.read(into)
    }
}

/// A record of a recording states a size of 250 MB and is truncated: it is refused, and this memory is not allocated.
#[test]
fn a_record_with_a_false_size_allocates_no_memory() {
    let mut file = b"\x89MCAP0\r\n\x01".to_vec();
    file.extend(250_000_000_u64.to_le_bytes());
    assert!(panelprep::tape::check_recording(LimitedReader(&file)).is_err());
}
