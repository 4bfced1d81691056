//! The disk of a world: every write to its folder is observed, may fail, and may be the last one; and the result of a
//! power failure.
//!
//! Functions of this test, which make the system calls, replace those of the C library (`open`, `write`, `pwrite`,
//! `fsync`, `fdatasync`, `ftruncate`, `rename`, `unlink`). SQLite is linked into this program and calls them by name,
//! as the standard library does. Therefore the product needs no layer of its own between store and disk, and the tested
//! code is the shipped code. A SQLite VFS would observe only the database, and neither head nor blobs. `mmap` of the
//! database's `-shm` file is not relevant for durability, because this file is created again from the log.
//!
//! A power failure keeps everything that was flushed (`fsync` of the file; of its folder for names). Of the rest, any
//! part may be kept: each write completely, in some of its sectors, or not at all, in any order; names in their order,
//! up to some point.

use super::libc_calls::{self, Call};
use super::sabotage::Sabotage;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SECTOR: usize = 512;
/// Name of the file with the position of the record chain.
const HEAD: &str = "panelprep.head";
/// Name of the file that reserves disk space and contains no data.
const RESERVE: &str = "panelprep.reserve";

/// An event that is planned for one of the next writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// From this write on, nothing is written.
    End,
    /// This number of writes fail because the disk is full, until the reserve file is deleted.
    Full(u32),
    /// This number of writes fail with an error of the disk.
    Io(u32),
}

#[derive(Debug, Clone)]
enum Change {
    Write { at: usize, bytes: Vec<u8> },
    Length(usize),
}

#[derive(Debug, Default)]
struct File {
    kept: Vec<u8>,
    pending: Vec<Change>,
}

#[derive(Debug, Clone)]
enum Naming {
    Put(PathBuf, usize),
    Move(PathBuf, PathBuf),
    Remove(PathBuf),
}

/// A folder whose writes are observed.
#[derive(Debug)]
struct Watched {
    root: PathBuf,
    files: Vec<File>,
    names: BTreeMap<PathBuf, usize>,
    kept_names: BTreeMap<PathBuf, usize>,
    pending_names: Vec<Naming>,
    /// Open files and folders, by their descriptors.
    open: BTreeMap<i32, Opened>,
    writings: u64,
    events: Vec<(u64, Event)>,
    is_over: bool,
    had_io_error: bool,
    was_full: bool,
    sabotage: Option<Sabotage>,
    /// One in this number of writes is simulated as the last one before a power failure. The files that the power
    /// failure would leave are stored beside the folder.
    imagined: Option<(u32, Pcg64)>,
    imagines: bool,
    left: Vec<PathBuf>,
}

#[derive(Debug, Clone)]
enum Opened {
    File(usize),
    Folder(PathBuf),
}

thread_local! {
    static WATCHED: RefCell<Option<Watched>> = const { RefCell::new(None) };
}

/// Observes this thread's writes to this folder. The existing files are treated as flushed.
pub fn watch(root: &Path, sabotage: Option<Sabotage>) {
    let mut watched = Watched {
        root: root.to_owned(),
        files: Vec::new(),
        names: BTreeMap::new(),
        kept_names: BTreeMap::new(),
        pending_names: Vec::new(),
        open: BTreeMap::new(),
        writings: 0,
        events: Vec::new(),
        is_over: false,
        had_io_error: false,
        was_full: false,
        sabotage,
        imagined: None,
        imagines: false,
        left: Vec::new(),
    };
    watched.scan(root);
    watched.kept_names = watched.names.clone();
    WATCHED.with_borrow_mut(|slot| *slot = Some(watched));
    libc_calls::set_observed(true);
}

/// Simulates one in this number of the writes between [`begin_simulated_power_failures`] and
/// [`simulated_power_failures`] as the last one before a power failure.
pub fn simulate_one_power_failure_in(count: u32, seed: u64) {
    with(|watched| watched.imagined = Some((count, Pcg64::seed_from_u64(seed))));
}

/// From now on, any write may be simulated as the last one before a power failure.
pub fn begin_simulated_power_failures() {
    with(|watched| watched.imagines = true);
}

/// Simulates a power failure now, between two writes.
pub fn simulate_power_failure_now() {
    with(|watched| {
        let draw = watched.imagined.as_mut().map(|(_, draw)| draw.random());
        if let Some(seed) = draw {
            watched.imagine_by(&mut Pcg64::seed_from_u64(seed));
        }
    });
}

/// Returns one folder for each simulated power failure since [`begin_simulated_power_failures`], with the files that
/// the power failure would have left.
pub fn simulated_power_failures() -> Vec<PathBuf> {
    let left = with(|watched| {
        watched.imagines = false;
        std::mem::take(&mut watched.left)
    });
    left.unwrap_or_default()
}

/// Continues with another process in the same folder: unflushed data of the last process are still in the system's
/// memory.
pub fn resume() {
    with(|watched| {
        watched.open.clear();
        (watched.is_over, watched.had_io_error, watched.was_full) = (false, false, false);
    });
}

/// Ends the observation.
pub fn leave() {
    libc_calls::set_observed(false);
    WATCHED.with_borrow_mut(|slot| *slot = None);
}

/// Plans an event for the nth write from now on.
pub fn at_writing(nth: u32, event: Event) {
    with(|watched| {
        // The reserve frees more space than is written until the process ends, so the disk would not become full.
        let has_room = !watched.names.contains_key(&watched.root.join(RESERVE));
        if !(has_room && matches!(event, Event::Full(_))) {
            watched.events.push((watched.writings + u64::from(nth), event));
        }
    });
}

/// Cancels all planned events.
pub fn mend() {
    with(|watched| watched.events.clear());
}

/// Returns whether an event is still planned.
pub fn is_armed() -> bool {
    with(|watched| !watched.events.is_empty()).unwrap_or(false)
}

/// Returns whether the planned end of all writes has been reached.
pub fn is_over() -> bool {
    with(|watched| watched.is_over).unwrap_or(false)
}

/// Returns whether a write has failed because of a disk error.
pub fn had_io_error() -> bool {
    with(|watched| watched.had_io_error).unwrap_or(false)
}

/// Returns whether a write of this process failed because the disk was full, not counting writes of the head.
pub fn was_full() -> bool {
    with(|watched| watched.was_full).unwrap_or(false)
}

/// Writes into this folder the files that a power failure leaves; the seed determines which changes are kept.
pub fn after_power_cut(to: &Path, seed: u64) {
    let was = libc_calls::set_observed(false);
    let _ = std::fs::remove_dir_all(to);
    with(|watched| watched.image(to, &mut Pcg64::seed_from_u64(seed)));
    libc_calls::set_observed(was);
}

fn with<T>(act: impl FnOnce(&mut Watched) -> T) -> Option<T> {
    let was = libc_calls::set_observed(false);
    let done = WATCHED.with_borrow_mut(|slot| slot.as_mut().map(act));
    libc_calls::set_observed(was);
    done
}

/// Handles a call of this thread before it is performed; returns an error number if the call must fail.
pub fn before(call: &Call<'_>) -> Option<i32> {
    WATCHED.with_borrow_mut(|slot| slot.as_mut().and_then(|watched| watched.before(call)))
}

/// Records a call of this thread after it was performed.
pub fn after(call: &Call<'_>, result: i64) {
    WATCHED.with_borrow_mut(|slot| {
        if let Some(watched) = slot {
            watched.after(call, result);
        }
    });
}

impl Watched {
    fn scan(&mut self, folder: &Path) {
        let mut entries: Vec<_> = std::fs::read_dir(folder).expect("a folder").flatten().collect();
        entries.sort_by_key(std::fs::DirEntry::file_name);
        for entry in entries {
            if entry.path().is_dir() {
                self.scan(&entry.path());
                continue;
            }
            // The bytes of the reserve are many and have no meaning, so they are not stored.
            let kept = if entry.file_name() == RESERVE {
                Vec::new()
            } else {
                std::fs::read(entry.path()).expect("a file")
            };
            self.files.push(File { kept, pending: Vec::new() });
            self.names.insert(entry.path(), self.files.len() - 1);
        }
    }

    fn before(&mut self, call: &Call<'_>) -> Option<i32> {
        let is_ours = match call {
            Call::Write { fd, .. } | Call::Length { fd, .. } | Call::Flush { fd } => self.open.contains_key(fd),
            Call::Open { path, writes, .. } => *writes && path.starts_with(&self.root),
            Call::Move { to, .. } => to.starts_with(&self.root),
            Call::Remove { path } => path.starts_with(&self.root) && !is_shared_memory(path),
            Call::Close { .. } => false,
        };
        if !is_ours {
            return None;
        }
        if self.is_over {
            return Some(libc::EIO);
        }
        if matches!(call, Call::Open { .. }) {
            return None;
        }
        self.writings += 1;
        self.imagine_cut();
        let now = self.writings;
        let gives_up =
            matches!(call, Call::Remove { path } if path.file_name().is_some_and(|name| name == RESERVE));
        let index = self.events.iter().position(|(at, _)| *at <= now)?;
        let takes_room = matches!(call, Call::Write { .. } | Call::Length { .. });
        let is_head = self.is_head(call);
        match &mut self.events[index].1 {
            Event::End => {
                self.is_over = true;
                self.events.clear();
                Some(libc::EIO)
            }
            Event::Full(_) if gives_up => {
                // The space of the reserve is much more than the cell writes until it is idle.
                self.events.retain(|(_, event)| !matches!(event, Event::Full(_)));
                None
            }
            Event::Full(_) if !takes_room => None,
            Event::Full(times) | Event::Io(times) if *times == 0 => {
                self.events.remove(index);
                None
            }
            Event::Full(times) => {
                *times -= 1;
                self.was_full |= !is_head;
                Some(libc::ENOSPC)
            }
            Event::Io(times) => {
                *times -= 1;
                self.had_io_error = true;
                Some(libc::EIO)
            }
        }
    }

    /// Returns whether the call writes the head. If the head cannot be written because the disk is full, nothing
    /// depends on it after a commit.
    fn is_head(&self, call: &Call<'_>) -> bool {
        let (Call::Write { fd, .. } | Call::Length { fd, .. }) = call else { return false };
        let Some(Opened::File(file)) = self.open.get(fd) else { return false };
        self.path_of(*file).is_some_and(|path| path.ends_with(HEAD))
    }

    fn imagine_cut(&mut self) {
        let Some((count, draw)) = self.imagined.as_mut().filter(|_| self.imagines) else { return };
        if draw.random_range(0..*count) > 0 {
            return;
        }
        let mut draw = Pcg64::seed_from_u64(draw.random());
        self.imagine_by(&mut draw);
    }

    fn imagine_by(&mut self, draw: &mut Pcg64) {
        let folder = self.root.with_file_name(format!("cut-{}", self.left.len()));
        let _ = std::fs::remove_dir_all(&folder);
        self.image(&folder, draw);
        self.left.push(folder);
    }

    fn after(&mut self, call: &Call<'_>, result: i64) {
        match call {
            Call::Open { path, is_new, truncates, .. } => self.opened(path, *is_new, *truncates, result),
            Call::Close { fd } => drop(self.open.remove(fd)),
            Call::Write { fd, at, bytes } if result > 0 => {
                let written = usize::try_from(result).unwrap_or(0).min(bytes.len());
                let change = Change::Write { at: *at as usize, bytes: bytes[..written].to_vec() };
                self.change(*fd, change);
            }
            Call::Length { fd, length } if result == 0 => self.change(*fd, Change::Length(*length as usize)),
            Call::Flush { fd } if result == 0 => self.flushed(*fd),
            Call::Move { from, to } if result == 0 => {
                if let Some(file) = self.names.remove(*from) {
                    self.names.insert(to.to_path_buf(), file);
                    self.pending_names.push(Naming::Move(from.to_path_buf(), to.to_path_buf()));
                }
            }
            Call::Remove { path } if result == 0 && self.names.remove(*path).is_some() => {
                self.pending_names.push(Naming::Remove(path.to_path_buf()));
            }
            _ => {}
        }
    }

    fn opened(&mut self, path: &Path, is_new: bool, truncates: bool, result: i64) {
        let Ok(fd) = i32::try_from(result) else { return };
        if fd < 0 || !path.starts_with(&self.root) || is_shared_memory(path) {
            return;
        }
        if path == self.root || path.is_dir() {
            self.open.insert(fd, Opened::Folder(path.to_owned()));
            return;
        }
        let known = self.names.get(path).copied();
        let file = match known {
            Some(file) => file,
            None if is_new => {
                self.files.push(File::default());
                let file = self.files.len() - 1;
                self.names.insert(path.to_owned(), file);
                self.pending_names.push(Naming::Put(path.to_owned(), file));
                file
            }
            None => return,
        };
        self.open.insert(fd, Opened::File(file));
        if truncates && known.is_some() {
            self.files[file].pending.push(Change::Length(0));
        }
    }

    fn change(&mut self, fd: i32, change: Change) {
        if let Some(Opened::File(file)) = self.open.get(&fd) {
            self.files[*file].pending.push(change);
        }
    }

    fn flushed(&mut self, fd: i32) {
        match self.open.get(&fd).cloned() {
            Some(Opened::File(file)) if self.forgets(self.path_of(file), false) => {}
            Some(Opened::Folder(folder)) if self.forgets(Some(&folder), true) => {}
            Some(Opened::File(file)) => {
                let File { kept, pending } = &mut self.files[file];
                pending.drain(..).for_each(|change| apply(kept, &change));
            }
            Some(Opened::Folder(folder)) => {
                let is_in = |naming: &mut Naming| {
                    let (Naming::Put(path, _) | Naming::Move(_, path) | Naming::Remove(path)) = naming;
                    path.parent() == Some(&folder)
                };
                let done: Vec<Naming> = self.pending_names.extract_if(.., is_in).collect();
                done.iter().for_each(|naming| name(&mut self.kept_names, naming));
            }
            None => {}
        }
    }

    fn path_of(&self, file: usize) -> Option<&Path> {
        self.names.iter().find(|(_, named)| **named == file).map(|(path, _)| path.as_path())
    }

    /// Returns whether an injected error omits the flush of this file or folder.
    fn forgets(&self, path: Option<&Path>, is_folder: bool) -> bool {
        let Some((sabotage, path)) = self.sabotage.zip(path) else { return false };
        sabotage.forgets_flush(path, is_folder)
    }

    fn image(&self, to: &Path, draw: &mut Pcg64) {
        let mut names = self.kept_names.clone();
        let count = draw.random_range(0..=self.pending_names.len());
        self.pending_names[..count].iter().for_each(|naming| name(&mut names, naming));
        std::fs::create_dir_all(to.join("blobs")).expect("a folder");
        for (path, file) in names {
            let path = to.join(path.strip_prefix(&self.root).expect("in the root"));
            if path.file_name().is_some_and(|name| name == RESERVE) {
                let made = std::fs::File::create(&path).and_then(|file| file.set_len(32 << 20));
                made.expect("a sparse file");
                continue;
            }
            std::fs::write(&path, self.files[file].after_power_cut(draw)).expect("a file");
        }
    }
}

impl File {
    fn after_power_cut(&self, draw: &mut Pcg64) -> Vec<u8> {
        let mut bytes = self.kept.clone();
        // Fraction of the pending changes that are kept: none, all, or a part.
        let share = [0.0, 0.5, 0.9, 1.0][draw.random_range(0..4)];
        for change in &self.pending {
            let kept = draw.random_bool(share);
            let is_torn = draw.random_bool(0.3);
            match change {
                Change::Write { at, bytes: written } if is_torn && written.len() > SECTOR => {
                    for (index, sector) in written.chunks(SECTOR).enumerate() {
                        if draw.random_bool(0.5) {
                            apply(&mut bytes, &Change::Write { at: at + index * SECTOR, bytes: sector.to_vec() });
                        }
                    }
                }
                change if kept => apply(&mut bytes, change),
                _ => {}
            }
        }
        bytes
    }
}

/// Returns whether a file is SQLite's index of its log, which is shared memory and is created again.
fn is_shared_memory(path: &Path) -> bool {
    path.to_string_lossy().ends_with("-shm")
}

fn apply(bytes: &mut Vec<u8>, change: &Change) {
    match change {
        Change::Write { at, bytes: written } => {
            let end = at + written.len();
            if bytes.len() < end {
                bytes.resize(end, 0);
            }
            bytes[*at..end].copy_from_slice(written);
        }
        Change::Length(length) => bytes.resize(*length, 0),
    }
}

fn name(names: &mut BTreeMap<PathBuf, usize>, naming: &Naming) {
    match naming {
        Naming::Put(path, file) => drop(names.insert(path.clone(), *file)),
        Naming::Move(from, to) => {
            if let Some(file) = names.remove(from) {
                names.insert(to.clone(), file);
            }
        }
        Naming::Remove(path) => drop(names.remove(path)),
    }
}
