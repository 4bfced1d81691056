//! The worker: a process of its own that drives the camera and answers the daemon, request by request.
//!
//! The Zivid SDK is C++ on a graphics processor: it may hang, crash, or take the process along. Here it does so alone.
//! The worker decides nothing: it takes what it is asked to take and says how. It ends when the daemon hangs up, and
//! with the daemon where that ends without a word. A clip runs on a thread of its own into a queue of three pictures; whoever
//! takes them too late loses the oldest, which are counted.

use super::clock::now_ns;
use super::message::{ClipEnd, Hello, Refusal, Reply, Request, SettingsHash, ShotInfo, Size, Source, Trouble, Use};
use super::sensor::{Exposed, Planes, Sensor, Slot};
use super::wire::{self, Kind, WireError};
use crate::files::content_hash;
use std::collections::{HashMap, VecDeque};
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Pictures of a clip that wait to be taken over, at most.
pub const QUEUE: usize = 3;
/// How long the next picture of a clip is waited for before the daemon is told that there is none.
const NEXT_PICTURE: Duration = Duration::from_secs(4);
/// So long nobody need ask for a clip's pictures before it ends by itself: whoever began it may have gone.
const NOBODY_ASKS: Duration = Duration::from_secs(10);
/// Pictures in a row that the camera may not give; each is a gap in the clip's times. One more ends the clip.
const MOST_MISSED: u32 = 2;

/// Room for what is under way, so that this end goes on while the other sums up a piece.
const SOCKET_BYTES: usize = 1 << 20;

/// Why the worker ends.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The daemon does not speak as it should.
    #[error("the daemon's request cannot be read: {0}")]
    Wire(#[from] WireError),
    /// A message that cannot be written.
    #[error("an answer cannot be written: {0}")]
    Json(#[from] serde_json::Error),
}

/// An answer with the payload that goes with it.
enum Answer {
    Words(Reply),
    Scan(ShotInfo, Planes),
    Picture(ShotInfo, Vec<[u8; 3]>),
}

/// Settings that were read.
#[derive(Debug, Clone, Copy)]
struct Known {
    usage: Use,
    slot: Slot,
}

/// A camera and how many shots it took.
struct Camera {
    sensor: Box<dyn Sensor>,
    serial: Option<String>,
    taken: u64,
}

/// Serves one daemon until it hangs up.
///
/// # Errors
/// Where what it says cannot be read or answered: then there is nobody to go on with.
pub fn serve(mut daemon: UnixStream, sensor: Box<dyn Sensor>) -> Result<(), WorkerError> {
    greet(&mut daemon, Ok(sensor.sdk()))?;
    #[expect(clippy::let_underscore_must_use, reason = "a hint; without it a shot takes a few milliseconds more")]
    let _ = rustix::net::sockopt::set_socket_send_buffer_size(&daemon, SOCKET_BYTES);
    let camera = Arc::new(Mutex::new(Camera { sensor, serial: None, taken: 0 }));
    let mut worker = Worker { camera, settings: HashMap::new(), clip: None };
    loop {
        let opened = match wire::open(&mut daemon, Kind::Request) {
            Err(WireError::Ended) => return Ok(()),
            other => other?,
        };
        let (sequence, request) = (opened.sequence, serde_json::from_slice::<Request>(&opened.head)?);
        opened.without_payload(&mut daemon)?;
        let answer = worker.answer(request).unwrap_or_else(|refusal| Answer::Words(Reply::Refused(refusal)));
        send(&mut daemon, sequence, &answer)?;
    }
}

/// The worker's first words: the SDK's version, or why there is no camera to serve with.
///
/// # Errors
/// Where nobody takes them.
pub fn greet(daemon: &mut UnixStream, sdk: Result<String, String>) -> Result<(), WorkerError> {
    let hello = Hello { program: env!("CARGO_PKG_VERSION").to_owned(), sdk };
    Ok(wire::write(daemon, (Kind::Hello, 0), &serde_json::to_vec(&hello)?, &[])?)
}

fn send(daemon: &mut UnixStream, sequence: u32, answer: &Answer) -> Result<(), WorkerError> {
    let mut reply = |head: &Reply, planes: &[&[u8]]| -> Result<(), WorkerError> {
        Ok(wire::write(daemon, (Kind::Reply, sequence), &serde_json::to_vec(head)?, planes)?)
    };
    match answer {
        Answer::Words(words) => reply(words, &[]),
        Answer::Scan(taken, Planes { points_mm, colors, snr }) => {
            let planes = [
                bytemuck::cast_slice(points_mm.as_slice()),
                bytemuck::cast_slice(colors.as_slice()),
                bytemuck::cast_slice(snr.as_slice()),
            ];
            reply(&Reply::Scan(taken.clone()), &planes)
        }
        Answer::Picture(taken, rgb) => reply(&Reply::Picture(taken.clone()), &[rgb.as_flattened()]),
    }
}

struct Worker {
    camera: Arc<Mutex<Camera>>,
    settings: HashMap<SettingsHash, Known>,
    clip: Option<Clip>,
}

impl Worker {
    fn answer(&mut self, request: Request) -> Result<Answer, Refusal> {
        // All but its next picture ends a clip: camera and projector do one thing at a time.
        if !matches!(request, Request::NextPicture | Request::EndClip) {
            drop(self.clip.take());
        }
        let words = |reply| Ok(Answer::Words(reply));
        match request {
            Request::Connect { source } => words(self.connect(&source)?),
            Request::Settings { usage, yaml, hash } => words(Reply::Settings(self.read(usage, &yaml, hash)?)),
            Request::Scan { settings } => {
                let slot = self.slot(Use::Scan, &settings)?;
                let (taken, planes) = lock(&self.camera).take(&settings, |sensor| sensor.scan(slot))?;
                Ok(Answer::Scan(taken, planes))
            }
            Request::Picture { settings } => {
                let slot = self.slot(Use::Picture, &settings)?;
                let (taken, rgb) = lock(&self.camera).take(&settings, |sensor| sensor.picture(slot))?;
                Ok(Answer::Picture(taken, rgb))
            }
            Request::BeginClip { settings, pictures_per_second } => {
                let slot = self.slot(Use::Picture, &settings)?;
                self.clip = Some(Clip::begin(self.camera.clone(), (slot, settings), pictures_per_second)?);
                words(Reply::ClipBegun)
            }
            Request::NextPicture => {
                let (taken, rgb) = self.running()?.next()?;
                Ok(Answer::Picture(taken, rgb))
            }
            Request::EndClip => {
                let ended = self.running()?.end();
                self.clip = None;
                words(Reply::ClipEnded(ended))
            }
            Request::Intrinsics { settings } => {
                let known = self.known(&settings)?;
                words(Reply::Intrinsics(lock(&self.camera).sensor.intrinsics(known.slot)?))
            }
            Request::State => words(Reply::State(lock(&self.camera).sensor.state()?)),
            Request::Light => words(Reply::Light(lock(&self.camera).sensor.light()?)),
        }
    }

    fn connect(&mut self, source: &Source) -> Result<Reply, Refusal> {
        self.settings.clear();
        let mut camera = lock(&self.camera);
        let identity = camera.sensor.connect(source)?;
        camera.serial = Some(identity.serial.clone());
        Ok(Reply::Connected(identity))
    }

    /// The SDK reads settings from files alone, so the text becomes one for as long as that takes.
    fn read(&mut self, usage: Use, yaml: &str, hash: SettingsHash) -> Result<Size, Refusal> {
        let found = settings_hash(yaml);
        if found != hash {
            let message = format!("the settings' text has the hash {found}, announced was {hash}");
            return Err(Refusal { trouble: Trouble::Settings, message });
        }
        let failed = |error: std::io::Error| Refusal {
            trouble: Trouble::Settings,
            message: format!("the settings cannot be handed to the SDK as a file: {error}"),
        };
        // The SDK tells what it reads by the ending.
        let mut file = tempfile::Builder::new().suffix(".yml").tempfile().map_err(failed)?;
        file.write_all(yaml.as_bytes()).and_then(|()| file.flush()).map_err(failed)?;
        let (slot, size) = lock(&self.camera).sensor.settings(usage, file.path())?;
        self.settings.insert(hash, Known { usage, slot });
        Ok(size)
    }

    fn known(&self, hash: &SettingsHash) -> Result<Known, Refusal> {
        let unknown = || Refusal {
            trouble: Trouble::OutOfOrder,
            message: format!("settings {hash} were not sent since the camera was opened"),
        };
        self.settings.get(hash).copied().ok_or_else(unknown)
    }

    fn slot(&self, usage: Use, hash: &SettingsHash) -> Result<Slot, Refusal> {
        let known = self.known(hash)?;
        if known.usage == usage {
            return Ok(known.slot);
        }
        let message =
            format!("the settings {hash} are for {}, and {} were asked for", known.usage.word(), usage.word());
        Err(Refusal { trouble: Trouble::OutOfOrder, message })
    }

    fn running(&mut self) -> Result<&mut Clip, Refusal> {
        let none = || Refusal { trouble: Trouble::OutOfOrder, message: "no clip is being taken".to_owned() };
        self.clip.as_mut().ok_or_else(none)
    }
}

impl Camera {
    /// Takes something and says how.
    fn take<T>(
        &mut self,
        settings: &SettingsHash,
        shot: impl FnOnce(&mut dyn Sensor) -> Result<(Exposed, T), Refusal>,
    ) -> Result<(ShotInfo, T), Refusal> {
        let closed = || Refusal { trouble: Trouble::OutOfOrder, message: "no camera is open".to_owned() };
        let serial = self.serial.clone().ok_or_else(closed)?;
        let begun_ns = now_ns();
        let (exposed, data) = shot(&mut *self.sensor)?;
        self.taken += 1;
        let Exposed { size, exposed_ns, throttled_ms, lens_c } = exposed;
        let settings = settings.clone();
        let taken = ShotInfo {
            size,
            settings,
            serial,
            number: self.taken,
            begun_ns,
            exposed_ns,
            ready_ns: now_ns(),
            throttled_ms,
            lens_c,
            dropped: 0,
        };
        Ok((taken, data))
    }
}

/// SHA-256 of a settings file's text.
pub fn settings_hash(yaml: &str) -> SettingsHash {
    content_hash(yaml.as_bytes())
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

type Photo = (ShotInfo, Vec<[u8; 3]>);

/// What the clip's thread and the worker share.
#[derive(Default)]
struct Queue {
    waiting: VecDeque<Photo>,
    taken: u64,
    dropped: u64,
    /// Pictures in a row that the camera did not give.
    missed: u32,
    /// When somebody last asked for one.
    asked_ns: u64,
    /// What ended the clip, reported once.
    failed: Option<Refusal>,
    is_over: bool,
}

impl Queue {
    /// What the camera gave, at this time.
    fn take(&mut self, taken: Result<Photo, Refusal>, now_ns: u64) {
        match taken {
            Ok(photo) => self.push(photo),
            Err(refusal) if refusal.trouble == Trouble::NoShot && self.missed < MOST_MISSED => self.missed += 1,
            Err(refusal) => (self.failed, self.is_over) = (Some(refusal), true),
        }
        if now_ns.saturating_sub(self.asked_ns) > NOBODY_ASKS.as_nanos() as u64 {
            let message =
                format!("nobody asked for its pictures for {} s, so the clip has ended", NOBODY_ASKS.as_secs());
            let ended = Refusal { trouble: Trouble::OutOfOrder, message };
            (self.failed, self.is_over) = (Some(ended), true);
            self.waiting.clear();
        }
    }

    /// The newest pictures stay.
    fn push(&mut self, photo: Photo) {
        (self.taken, self.missed) = (self.taken + 1, 0);
        self.waiting.push_back(photo);
        if self.waiting.len() > QUEUE {
            self.waiting.pop_front();
            self.dropped += 1;
        }
    }

    fn pop(&mut self) -> Option<Photo> {
        let (mut taken, rgb) = self.waiting.pop_front()?;
        taken.dropped = self.dropped;
        Some((taken, rgb))
    }
}

/// A clip that is being taken; dropping it ends it.
struct Clip {
    shared: Arc<(Mutex<Queue>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

/// Beyond what any camera of this kind does.
const MOST_PER_SECOND: f64 = 1_000.0;

impl Clip {
    fn begin(
        camera: Arc<Mutex<Camera>>,
        (slot, settings): (Slot, SettingsHash),
        pictures_per_second: f64,
    ) -> Result<Self, Refusal> {
        let refused = |message| Refusal { trouble: Trouble::OutOfOrder, message };
        if !(pictures_per_second > 0.0 && pictures_per_second <= MOST_PER_SECOND) {
            return Err(refused(format!("{pictures_per_second} pictures a second are none, or too many")));
        }
        let period_ns = (1e9 / pictures_per_second) as u64;
        let queue = Queue { asked_ns: now_ns(), ..Queue::default() };
        let shared = Arc::new((Mutex::new(queue), Condvar::new()));
        let theirs = shared.clone();
        let run = move || {
            let (queue, news) = &*theirs;
            let mut due_ns = now_ns();
            loop {
                let taken = lock(&camera).take(&settings, |sensor| sensor.picture(slot));
                let mut queue = lock(queue);
                queue.take(taken, now_ns());
                news.notify_all();
                // A camera that is late goes on from when it was, without hurrying after.
                due_ns = (due_ns + period_ns).max(now_ns());
                while !queue.is_over && now_ns() < due_ns {
                    let left = Duration::from_nanos(due_ns.saturating_sub(now_ns()));
                    queue = news.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
                }
                if queue.is_over {
                    return;
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("clip".to_owned())
            .spawn(run)
            .map_err(|error| refused(format!("the clip's thread cannot start: {error}")))?;
        Ok(Clip { shared, thread: Some(thread) })
    }

    /// The oldest picture that waits, or the next one.
    fn next(&mut self) -> Result<Photo, Refusal> {
        let (queue, news) = &*self.shared;
        let idle = |queue: &mut Queue| queue.waiting.is_empty() && !queue.is_over;
        lock(queue).asked_ns = now_ns();
        let waited = news.wait_timeout_while(lock(queue), NEXT_PICTURE, idle);
        let mut queue = waited.unwrap_or_else(PoisonError::into_inner).0;
        queue.asked_ns = now_ns();
        let late = || Refusal {
            trouble: Trouble::NoShot,
            message: format!("no picture of the clip within {} s", NEXT_PICTURE.as_secs()),
        };
        queue.pop().ok_or_else(|| queue.failed.clone().unwrap_or_else(late))
    }

    /// Takes no more pictures, once the one that is being taken is there.
    fn end(&mut self) -> ClipEnd {
        let (queue, news) = &*self.shared;
        lock(queue).is_over = true;
        news.notify_all();
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "a panic in there was reported where it happened")]
            let _ = thread.join();
        }
        let queue = lock(queue);
        ClipEnd { taken: queue.taken, dropped: queue.dropped }
    }
}

impl Drop for Clip {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo(number: u64) -> Photo {
        let size = Size { width: 1, height: 1 };
        let taken = ShotInfo {
            size,
            settings: String::new(),
            serial: String::new(),
            number,
            begun_ns: 0,
            exposed_ns: 0,
            ready_ns: 0,
            throttled_ms: 0.0,
            lens_c: None,
            dropped: 0,
        };
        (taken, vec![[0; 3]])
    }

    /// By hand: of five pictures that nobody takes over the first two are gone.
    #[test]
    fn the_queue_keeps_the_newest_and_counts_the_others() {
        let mut queue = Queue::default();
        (1..=5).for_each(|number| queue.push(photo(number)));
        let taken = std::iter::from_fn(|| queue.pop()).map(|(taken, _)| (taken.number, taken.dropped));
        assert_eq!(taken.collect::<Vec<_>>(), [(3, 2), (4, 2), (5, 2)]);
        assert_eq!((queue.taken, queue.dropped), (5, 2));
    }

    fn no_shot() -> Refusal {
        Refusal { trouble: Trouble::NoShot, message: "no exposure".to_owned() }
    }

    /// Two pictures in a row may be missing, which the times of the others show; the third ends the clip.
    #[test]
    fn a_missing_picture_is_a_gap_and_three_are_the_end() {
        let mut queue = Queue::default();
        for taken in [Err(no_shot()), Err(no_shot()), Ok(photo(1)), Err(no_shot()), Err(no_shot())] {
            queue.take(taken, 0);
            assert!(!queue.is_over);
        }
        queue.take(Err(no_shot()), 0);
        assert!(queue.is_over && queue.failed == Some(no_shot()));
        let mut gone = Queue::default();
        gone.take(Err(Refusal { trouble: Trouble::Gone, message: String::new() }), 0);
        assert!(gone.is_over, "a camera that is gone ends it at once");
    }

    /// A clip of a film that was left goes on for ten seconds and no longer.
    #[test]
    fn a_clip_that_nobody_asks_for_ends() {
        let mut queue = Queue { asked_ns: 5_000_000_000, ..Queue::default() };
        queue.take(Ok(photo(1)), 15_000_000_000);
        assert!(!queue.is_over);
        queue.take(Ok(photo(2)), 15_000_000_001);
        assert!(queue.is_over && queue.waiting.is_empty());
        assert!(queue.failed.is_some_and(|why| why.message.contains("nobody asked for its pictures for 10 s")));
    }

    /// `printf 'a: 1\n' | sha256sum`
    #[test]
    fn settings_are_named_by_their_content() {
        assert_eq!(settings_hash("a: 1\n"), "37b128c59f1f5097f73f82691cb519f1f568667faab5ced1b4ab979d36837eae");
    }
}
