//! The camera in the worker process. It is controlled through the SDK, one call at a time.
//!
//! A sensor captures scans and pictures in sequence, each with its metadata. For a clip, a separate thread captures
//! pictures into a queue of three. If pictures are fetched too late, the oldest are dropped and counted.

use super::message::{
    ClipEnd, Identity, Lens, Light, Refusal, SettingsHash, ShotInfo, Size, Source, Temperatures, Trouble, Use,
    now_ns,
};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Maximum number of a clip's pictures that wait to be fetched.
const QUEUE_LENGTH: usize = 3;

/// Time limit for the next picture of a clip; after this time the worker reports to the daemon that there is none.
const PICTURE_TIMEOUT: Duration = Duration::from_secs(4);

/// Time without a request for a picture after which a clip ends, because the client may have disappeared.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// Maximum number of consecutive pictures that the camera may fail to deliver; each is a gap in the clip's times. One
/// more failure ends the clip.
const MAX_MISSED_PICTURES: u32 = 2;

/// Maximum rate of a clip, pictures per second; it is above that of any camera of this type.
const MAX_PICTURES_PER_SECOND: f64 = 1_000.0;

/// The number by which the sensor identifies loaded settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SettingsSlot(pub u32);

/// The metadata of an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposureMetadata {
    /// The size of the picture.
    pub size: Size,
    /// Time at which the exposure ended, ns of the monotonic clock.
    pub exposed_ns: u64,
    /// The pause because the camera was too hot, ms.
    pub throttled_ms: f64,
    /// Temperature of the lens at the exposure, °C.
    pub lens_c: Option<f64>,
}

/// The values of a 3D scan, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct ShotPlanes {
    /// x, y and z of each point in the camera's frame, mm; NaN for a missing point.
    pub points_mm: Vec<[f32; 3]>,
    /// Red, green and blue of each pixel, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Signal-to-noise ratio.
    pub snr: Vec<f32>,
}

impl ShotPlanes {
    /// Allocates memory for a scan of this size.
    pub fn with_size(size: Size) -> Self {
        let pixels = size.pixels();
        ShotPlanes { points_mm: vec![[0.0; 3]; pixels], colors: vec![[0; 3]; pixels], snr: vec![0.0; pixels] }
    }
}

/// A 3D camera that also captures colour pictures. Each method blocks; a request that the camera cannot execute is
/// refused with a reason.
pub trait Sensor: Send {
    /// Returns the version of the SDK with which the sensor was built.
    fn sdk_version(&self) -> String;

    /// Opens a camera. If another camera is open, it is closed first, and its settings are discarded.
    ///
    /// # Errors
    /// If the camera is not found or cannot be opened.
    fn connect(&mut self, source: &Source) -> Result<Identity, Refusal>;

    /// Loads settings from a YAML file.
    ///
    /// # Errors
    /// If the camera does not accept the settings.
    fn settings(&mut self, usage: Use, file: &Path) -> Result<(SettingsSlot, Size), Refusal>;

    /// Captures a 3D scan.
    ///
    /// # Errors
    /// If the camera delivers no scan.
    fn scan(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, ShotPlanes), Refusal>;

    /// Captures a picture: red, green and blue of each pixel.
    ///
    /// # Errors
    /// If the camera delivers no picture.
    fn picture(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, Vec<[u8; 3]>), Refusal>;

    /// Returns the camera's own lens model.
    ///
    /// # Errors
    /// If the camera does not report the lens model.
    fn intrinsics(&mut self, slot: SettingsSlot) -> Result<Lens, Refusal>;

    /// Returns the camera's temperatures.
    ///
    /// # Errors
    /// If the camera does not report its temperatures.
    fn state(&mut self) -> Result<Temperatures, Refusal>;

    /// Measures the flicker of the ambient light.
    ///
    /// # Errors
    /// If the camera does not measure the ambient light.
    fn measure_ambient_light(&mut self) -> Result<Light, Refusal>;
}

/// A camera, and the number of its scans and pictures so far.
pub(super) struct Camera {
    pub(super) sensor: Box<dyn Sensor>,
    pub(super) serial: Option<String>,
    taken: u64,
}

impl Camera {
    /// Creates a camera that was not opened yet.
    pub(super) fn new(sensor: Box<dyn Sensor>) -> Self {
        Camera { sensor, serial: None, taken: 0 }
    }

    /// Captures a scan or picture, and returns it with its metadata.
    pub(super) fn capture<T>(
        &mut self,
        settings: &SettingsHash,
        shot: impl FnOnce(&mut dyn Sensor) -> Result<(ExposureMetadata, T), Refusal>,
    ) -> Result<(ShotInfo, T), Refusal> {
        let closed = || Refusal { trouble: Trouble::OutOfOrder, message: "no camera is open".to_owned() };
        let serial = self.serial.clone().ok_or_else(closed)?;
        let begun_ns = now_ns();
        let (exposed, data) = shot(&mut *self.sensor)?;
        self.taken += 1;
        let ExposureMetadata { size, exposed_ns, throttled_ms, lens_c } = exposed;
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

pub(super) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A picture with its metadata.
type PictureWithMetadata = (ShotInfo, Vec<[u8; 3]>);

/// The data that the thread of a clip and the worker share.
#[derive(Default)]
struct ClipQueue {
    waiting: VecDeque<PictureWithMetadata>,
    taken: u64,
    dropped: u64,
    /// Number of consecutive pictures that the camera has failed to deliver.
    missed: u32,
    /// Time of the last request for a picture, ns of the monotonic clock.
    asked_ns: u64,
    /// The error that ended the clip, reported once.
    failed: Option<Refusal>,
    is_over: bool,
}

impl ClipQueue {
    /// Adds the result of a capture at this time.
    fn receive(&mut self, taken: Result<PictureWithMetadata, Refusal>, now_ns: u64) {
        match taken {
            Ok(photo) => self.push(photo),
            Err(refusal) if refusal.trouble == Trouble::NoShot && self.missed < MAX_MISSED_PICTURES => {
                self.missed += 1
            }
            Err(refusal) => (self.failed, self.is_over) = (Some(refusal), true),
        }
        if now_ns.saturating_sub(self.asked_ns) > REQUEST_TIMEOUT.as_nanos() as u64 {
            let message = format!(
                "no picture of the clip was requested for {} s, so the clip was ended",
                REQUEST_TIMEOUT.as_secs()
            );
            let ended = Refusal { trouble: Trouble::OutOfOrder, message };
            (self.failed, self.is_over) = (Some(ended), true);
            self.waiting.clear();
        }
    }

    /// Adds a picture; if the queue is full, the oldest picture is dropped.
    fn push(&mut self, photo: PictureWithMetadata) {
        (self.taken, self.missed) = (self.taken + 1, 0);
        self.waiting.push_back(photo);
        if self.waiting.len() > QUEUE_LENGTH {
            self.waiting.pop_front();
            self.dropped += 1;
        }
    }

    fn pop(&mut self) -> Option<PictureWithMetadata> {
        let (mut taken, rgb) = self.waiting.pop_front()?;
        taken.dropped = self.dropped;
        Some((taken, rgb))
    }
}

/// A clip that is being recorded; dropping it ends the recording.
pub(super) struct Clip {
    shared: Arc<(Mutex<ClipQueue>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl Clip {
    pub(super) fn begin_clip(
        camera: Arc<Mutex<Camera>>,
        (slot, settings): (SettingsSlot, SettingsHash),
        pictures_per_second: f64,
    ) -> Result<Self, Refusal> {
        let refused = |message| Refusal { trouble: Trouble::OutOfOrder, message };
        if !(pictures_per_second > 0.0 && pictures_per_second <= MAX_PICTURES_PER_SECOND) {
            return Err(refused(format!(
                "{pictures_per_second} pictures per second are requested; valid: more than 0 and at most \
                 {MAX_PICTURES_PER_SECOND}"
            )));
        }
        let period_ns = (1e9 / pictures_per_second) as u64;
        let queue = ClipQueue { asked_ns: now_ns(), ..ClipQueue::default() };
        let shared = Arc::new((Mutex::new(queue), Condvar::new()));
        let theirs = shared.clone();
        let run = move || {
            let (queue, news) = &*theirs;
            let mut due_ns = now_ns();
            loop {
                let taken = lock(&camera).capture(&settings, |sensor| sensor.picture(slot));
                let mut queue = lock(queue);
                queue.receive(taken, now_ns());
                news.notify_all();
                // If the camera is late, the schedule continues from the current time; missed pictures are not captured
                // afterwards.
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

    /// Returns the oldest picture in the queue, or waits for the next one.
    pub(super) fn next(&mut self) -> Result<PictureWithMetadata, Refusal> {
        let (queue, news) = &*self.shared;
        let idle = |queue: &mut ClipQueue| queue.waiting.is_empty() && !queue.is_over;
        lock(queue).asked_ns = now_ns();
        let waited = news.wait_timeout_while(lock(queue), PICTURE_TIMEOUT, idle);
        let mut queue = waited.unwrap_or_else(PoisonError::into_inner).0;
        queue.asked_ns = now_ns();
        let late = || Refusal {
            trouble: Trouble::NoShot,
            message: format!("no picture of the clip within {} s", PICTURE_TIMEOUT.as_secs()),
        };
        queue.pop().ok_or_else(|| queue.failed.clone().unwrap_or_else(late))
    }

    /// Ends the clip after the picture that is being captured, and returns its statistics.
    pub(super) fn end(&mut self) -> ClipEnd {
        let (queue, news) = &*self.shared;
        lock(queue).is_over = true;
        news.notify_all();
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
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
    use super::super::message::Size;
    use super::*;

    fn photo(number: u64) -> PictureWithMetadata {
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

    /// Expected result, derived by hand: of five pictures that are not fetched, the first two are dropped.
    #[test]
    fn the_queue_keeps_the_newest_and_counts_the_others() {
        let mut queue = ClipQueue::default();
        (1..=5).for_each(|number| queue.push(photo(number)));
        let taken = std::iter::from_fn(|| queue.pop()).map(|(taken, _)| (taken.number, taken.dropped));
        assert_eq!(taken.collect::<Vec<_>>(), [(3, 2), (4, 2), (5, 2)]);
        assert_eq!((queue.taken, queue.dropped), (5, 2));
    }

    fn no_shot() -> Refusal {
        Refusal { trouble: Trouble::NoShot, message: "no exposure".to_owned() }
    }

    /// Two consecutive pictures may be missing, which the times of the other pictures show. A third missing picture
    /// ends the clip.
    #[test]
    fn two_missing_pictures_are_a_gap_and_three_end_the_clip() {
        let mut queue = ClipQueue::default();
        for taken in [Err(no_shot()), Err(no_shot()), Ok(photo(1)), Err(no_shot()), Err(no_shot())] {
            queue.receive(taken, 0);
            assert!(!queue.is_over);
        }
        queue.receive(Err(no_shot()), 0);
        assert!(queue.is_over && queue.failed == Some(no_shot()));
        let mut gone = ClipQueue::default();
        gone.receive(Err(Refusal { trouble: Trouble::Gone, message: String::new() }), 0);
        assert!(gone.is_over, "a camera that is gone ends it at once");
    }

    /// The clip of an abandoned film continues for ten seconds and no longer.
    #[test]
    fn a_clip_without_requests_ends() {
        let mut queue = ClipQueue { asked_ns: 5_000_000_000, ..ClipQueue::default() };
        queue.receive(Ok(photo(1)), 15_000_000_000);
        assert!(!queue.is_over);
        queue.receive(Ok(photo(2)), 15_000_000_001);
        assert!(queue.is_over && queue.waiting.is_empty());
        assert!(
            queue.failed.is_some_and(|why| why.message.contains("no picture of the clip was requested for 10 s"))
        );
    }
}
