//! Applies one change (mutation) after another to the program's sources and runs simulated worlds until a check finds
//! the mutation: see `tests/world/mutations`. In a copy of the repository below `target/mutations` each change is made,
//! the world is built and run, and the change is undone; the next world is built in parallel. `cargo bench --profile
//! dev --bench mutations -- [seeds=N] [limit_s=N] [from=N] [only=TEXT] [tree=FOLDER]`: number of seeds and time limit
//! for each change, number of the first change, a part of a change's name, and the folder of the copy. Results of an
//! earlier build in this folder are used again.

#[path = "arguments.rs"]
mod arguments;
#[path = "../world/mutations/mod.rs"]
mod mutations;

use arguments::{argument, number};
use mutations::Mutation;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time after its time limit at which a world that still runs is treated as hanging, s.
const HANG_DELAY_S: u64 = 60;

/// The result of a mutation.
enum Outcome {
    /// The mutation was found: the number of seeds that were needed, and the message of the check.
    Found(u64, String),
    NotFound(u64),
    /// The program does not end with this seed.
    Hangs(String),
    DoesNotBuild,
}

fn main() -> ExitCode {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    let bench = Bench {
        tree: argument("tree").map_or(repository.join("target/mutations/tree"), PathBuf::from),
        target: std::env::var_os("CARGO_TARGET_DIR")
            .map_or(repository.join("target"), |folder| repository.join(folder)),
        seeds: number("seeds").unwrap_or(2_000),
        limit_s: number("limit_s").unwrap_or(120),
    };
    copy(repository, &bench.tree).unwrap_or_else(|error| panic!("{}: {error}", bench.tree.display()));
    let only = argument("only").unwrap_or_default();
    let chosen: Vec<&Mutation> = mutations::all()
        .skip(usize::try_from(number("from").unwrap_or(0)).unwrap_or(0))
        .filter(|mutation| mutation.name.contains(&only))
        .collect();
    let mut tally = [0_usize; 4];
    let mut running: Option<(&Mutation, JoinHandle<Outcome>)> = None;
    for mutation in &chosen {
        let built = bench.built(mutation);
        // Only one world runs at a time, because two cores both build and run.
        report(running.take(), &mut tally);
        match built {
            Some(world) => running = Some((mutation, bench.run(mutation, world))),
            None => report(Some((mutation, std::thread::spawn(|| Outcome::DoesNotBuild))), &mut tally),
        }
    }
    report(running, &mut tally);
    let [found, not_found, hangs, not_built] = tally;
    println!("{found} of {} found; not found {not_found}, hang {hangs}, do not build {not_built}", chosen.len());
    ExitCode::SUCCESS
}

/// Waits for a world and prints its result.
fn report(running: Option<(&Mutation, JoinHandle<Outcome>)>, tally: &mut [usize; 4]) {
    let Some((Mutation { name, not_found, .. }, outcome)) = running else { return };
    let outcome = outcome.join().unwrap_or_else(|_| panic!("{name}: its world could not be run"));
    let kind = match &outcome {
        Outcome::Found(seeds, what) => {
            println!("found after {seeds} seeds: {name} ({what})");
            0
        }
        Outcome::NotFound(seeds) => {
            let why = not_found.map(|why| format!(" ({why})")).unwrap_or_default();
            println!("not found in {seeds} seeds: {name}{why}");
            1
        }
        Outcome::Hangs(seed) => {
            println!("hangs in {seed}: {name}");
            2
        }
        Outcome::DoesNotBuild => {
            println!("does not build: {name}");
            3
        }
    };
    tally[kind] += 1;
}

/// Copies the files that git tracks in the repository. The time of an unchanged file is kept, so that it is not
/// compiled again.
fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    let listed = Command::new("git").args(["ls-files", "-z"]).current_dir(from).output()?;
    for name in String::from_utf8_lossy(&listed.stdout).split_terminator('\0') {
        let (source, copied) = (from.join(name), to.join(name));
        if !source.is_file() {
            continue;
        }
        let bytes = std::fs::read(&source)?;
        if std::fs::read(&copied).is_ok_and(|known| known == bytes) {
            continue;
        }
        std::fs::create_dir_all(copied.parent().unwrap_or(to))?;
        std::fs::write(&copied, bytes)?;
    }
    Ok(())
}

fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn put(path: &Path, text: &str) {
    std::fs::write(path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// The folder in which changes are built and run, and the time limit.
struct Bench {
    tree: PathBuf,
    target: PathBuf,
    seeds: u64,
    limit_s: u64,
}

impl Bench {
    /// Builds the world with this change, as a separate file; `None` if the compiler refuses the change. The change is
    /// undone afterwards.
    fn built(&self, mutation: &Mutation) -> Option<PathBuf> {
        let shipped: BTreeMap<PathBuf, String> = mutation
            .edits()
            .map(|edit| self.tree.join(edit.file))
            .map(|path| (path.clone(), text_of(&path)))
            .collect();
        for edit in mutation.edits() {
            let path = self.tree.join(edit.file);
            put(&path, &text_of(&path).replacen(edit.ships, edit.changed, 1));
        }
        let executable = self.build();
        shipped.iter().for_each(|(path, text)| put(path, text));
        let world = self.tree.with_file_name("world");
        // A world that still runs keeps the file's contents; only the file's name is removed here.
        let _ = std::fs::remove_file(&world);
        std::fs::copy(executable?, &world).unwrap_or_else(|error| panic!("{}: {error}", world.display()));
        Some(world)
    }

    fn build(&self) -> Option<PathBuf> {
        let mut cargo = Command::new("cargo");
        // Cargo's variables about this bench's own package are removed: with them build scripts would run again, and
        // everything that depends on these scripts would be built again.
        for (name, _) in std::env::vars_os() {
            if ["CARGO_PKG_", "CARGO_MANIFEST_"].iter().any(|own| name.to_string_lossy().starts_with(own)) {
                cargo.env_remove(name);
            }
        }
        let built = cargo
            .args(["build", "--locked", "--quiet", "--bench", "world", "--message-format", "json"])
            .current_dir(&self.tree)
            .env("CARGO_TARGET_DIR", &self.target)
            .stderr(Stdio::null())
            .output()
            .unwrap_or_else(|error| panic!("cargo: {error}"));
        let lines = String::from_utf8_lossy(&built.stdout).into_owned();
        let messages = lines.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
        let executable = |message: serde_json::Value| {
            let is_world = message["target"]["name"] == "world";
            message["executable"].as_str().filter(|_| is_world).map(PathBuf::from)
        };
        let executable = messages.filter_map(executable).next_back();
        executable.filter(|_| built.status.success())
    }

    /// Runs the world with this mutation in a thread.
    fn run(&self, mutation: &Mutation, world: PathBuf) -> JoinHandle<Outcome> {
        let (first, step) = mutation.seeds;
        let child = Command::new(world)
            .args(["until-wrong".to_owned(), format!("from={first}"), format!("step={step}")])
            .args([format!("seeds={}", self.seeds), format!("limit_s={}", self.limit_s)])
            .current_dir(&self.tree)
            .env("RAYON_NUM_THREADS", "1")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("the world: {error}"));
        let latest = Instant::now() + Duration::from_secs(self.limit_s + HANG_DELAY_S);
        std::thread::spawn(move || outcome(child, latest))
    }
}

/// Waits until a world ends or is killed, and evaluates its output.
fn outcome(mut child: Child, latest: Instant) -> Outcome {
    let (printed, errors) = (child.stdout.take().map(read), child.stderr.take().map(read));
    let mut hangs = false;
    while matches!(child.try_wait(), Ok(None)) {
        if Instant::now() > latest {
            hangs = true;
            child.kill().unwrap_or_else(|error| panic!("the world: {error}"));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let text =
        |reader: Option<JoinHandle<String>>| reader.and_then(|reader| reader.join().ok()).unwrap_or_default();
    let (printed, errors) = (text(printed), text(errors));
    let seeds: Vec<&str> = printed.lines().filter(|line| line.starts_with("seed ")).collect();
    let count = seeds.len() as u64;
    let panic =
        errors.split_once("panicked at ").map(|(_, message)| message.lines().take(2).collect::<Vec<_>>().join(" "));
    match (printed.lines().find_map(|line| line.strip_prefix("wrong: ")), panic) {
        (Some(what), _) => Outcome::Found(count, what.to_owned()),
        (None, Some(message)) => Outcome::Found(count, format!("panic: {message}")),
        (None, None) if hangs => Outcome::Hangs(seeds.last().copied().unwrap_or("no seed").to_owned()),
        (None, None) => Outcome::NotFound(count),
    }
}

fn read(mut from: impl Read + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // If reading fails, the output that was read before is used.
        let _ = from.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    })
}
