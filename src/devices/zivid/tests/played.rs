//! A worker in a thread, whose simulated sensor follows a plan.

use super::super::message::{Flicker, Identity, Lens, Light, Refusal, Temperatures, Trouble, Use, now_ns};
use super::super::process::WorkerPeer;
use super::super::sensor::{ExposureMetadata, Sensor, SettingsSlot, ShotPlanes};
use super::super::{AnswerTimeouts, CameraSetup, Restarts, Size, Source, WorkerLauncher, worker};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub const SIZE: Size = Size { width: 8, height: 6 };

/// The numbers of the exposures at which faults occur, counted over all workers; the first exposure is the warm-up.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    pub missing: Vec<u64>,
    pub infinite: Vec<u64>,
    pub half: Vec<u64>,
    /// Exposures whose metadata have times before the request.
    pub old: Vec<u64>,
    pub frozen: Vec<u64>,
    pub gone: Vec<u64>,
    pub no_shot: Vec<u64>,
    pub hot: Vec<u64>,
    pub panics: Vec<u64>,
    /// Exposures without light: black pictures.
    pub dark: Vec<u64>,
    /// Number of attempts to open the camera in which no camera is found.
    pub absent_for: u64,
}

pub fn setup() -> CameraSetup {
    let ms = Duration::from_millis;
    // The time limits are long where a busy computer may be slow, and short where a test waits for them.
    let patience = AnswerTimeouts { search: ms(5), ..AnswerTimeouts::default() };
    CameraSetup {
        source: Source::Only,
        serial: None,
        size: SIZE,
        scan_yaml: "scan".to_owned(),
        picture_yaml: "picture".to_owned(),
        restarts: Restarts::default(),
        timeouts: patience,
    }
}

/// Returns a launcher of workers whose sensor follows this plan.
pub fn played(plan: Plan) -> WorkerLauncher {
    let counts = Arc::new((AtomicU64::new(0), AtomicU64::new(0)));
    in_thread(move |stream| {
        let sensor = Played { plan: plan.clone(), counts: counts.clone(), is_open: false, content: 0 };
        // The worker ends when its daemon ends, or as planned.
        let _ = worker::serve(stream, Box::new(sensor));
    })
}

/// Returns a launcher that calls `serve` with one end of a socket, each time in a new thread.
pub fn in_thread(serve: impl Fn(UnixStream) + Send + Sync + 'static) -> WorkerLauncher {
    let serve = Arc::new(serve);
    Box::new(move || {
        let (ours, theirs) = UnixStream::pair()?;
        let (again, serve) = (theirs.try_clone()?, serve.clone());
        let thread = std::thread::spawn(move || {
            let hangs_up = ClosesOnDrop(again);
            serve(theirs);
            drop(hangs_up);
        });
        let stream = ours.try_clone()?;
        Ok((ours, Box::new(Threaded { stream, thread }) as Box<dyn WorkerPeer>))
    })
}

/// Closes the socket when the thread ends, as the operating system does at the end of a process.
struct ClosesOnDrop(UnixStream);

impl Drop for ClosesOnDrop {
    fn drop(&mut self) {
        let _ = self.0.shutdown(std::net::Shutdown::Both);
    }
}

struct Threaded {
    stream: UnixStream,
    thread: JoinHandle<()>,
}

impl WorkerPeer for Threaded {
    fn kill(&mut self) {
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
    }

    /// A thread has no exit status, so the text is fixed.
    fn wait_ended(&mut self, within: Duration) -> Option<String> {
        if within.is_zero() {
            return self.thread.is_finished().then(|| "it hung up".to_owned());
        }
        self.kill();
        let until = Instant::now() + within;
        while !self.thread.is_finished() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(1));
        }
        None
    }

    fn id(&self) -> Option<u32> {
        None
    }
}

struct Played {
    plan: Plan,
    /// The number of attempts to open the camera, and the number of exposures.
    counts: Arc<(AtomicU64, AtomicU64)>,
    is_open: bool,
    content: u64,
}

impl Played {
    /// Returns the number of the exposure and its metadata, or the planned fault.
    fn expose(&mut self) -> Result<(u64, ExposureMetadata), Refusal> {
        let number = self.counts.1.fetch_add(1, Ordering::Relaxed) + 1;
        let refused = |trouble, message: &str| Err(Refusal { trouble, message: message.to_owned() });
        let plan = &self.plan;
        if !self.is_open || plan.gone.contains(&number) {
            self.is_open = false;
            return refused(Trouble::Gone, "unplugged");
        }
        assert!(!plan.panics.contains(&number), "as planned");
        if plan.no_shot.contains(&number) {
            return refused(Trouble::NoShot, "no exposure");
        }
        let size = if plan.half.contains(&number) { Size { width: 4, height: 3 } } else { SIZE };
        let exposed_ns = if plan.old.contains(&number) { 1 } else { now_ns() };
        let throttled_ms = if plan.hot.contains(&number) { 900.0 } else { 0.0 };
        if !plan.frozen.contains(&number) {
            self.content = number;
        }
        Ok((number, ExposureMetadata { size, exposed_ns, throttled_ms, lens_c: Some(36.0) }))
    }
}

impl Sensor for Played {
    fn sdk_version(&self) -> String {
        "played".to_owned()
    }

    fn connect(&mut self, _: &Source) -> Result<Identity, Refusal> {
        if self.counts.0.fetch_add(1, Ordering::Relaxed) < self.plan.absent_for {
            return Err(Refusal { trouble: Trouble::NotFound, message: "no such camera".to_owned() });
        }
        self.is_open = true;
        Ok(Identity { serial: "STUB1".to_owned(), model: "played".to_owned() })
    }

    fn settings(&mut self, usage: Use, file: &Path) -> Result<(SettingsSlot, Size), Refusal> {
        let text = std::fs::read_to_string(file).expect("the file is there while it is read");
        match (usage, text.as_str()) {
            (Use::Scan, "scan") => Ok((SettingsSlot(0), SIZE)),
            (Use::Picture, "picture") => Ok((SettingsSlot(1), SIZE)),
            _ => Err(Refusal { trouble: Trouble::Settings, message: "these are no settings".to_owned() }),
        }
    }

    /// Returns a scan whose point k has the coordinates (k, content, 700 + content).
    fn scan(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, ShotPlanes), Refusal> {
        assert_eq!(slot, SettingsSlot(0));
        let (number, exposed) = self.expose()?;
        let mut planes = ShotPlanes::with_size(exposed.size);
        for (k, point) in planes.points_mm.iter_mut().enumerate() {
            *point = [k as f32, self.content as f32, 700.0 + self.content as f32];
        }
        planes.points_mm[0] = [f32::NAN; 3];
        if self.plan.missing.contains(&number) {
            planes.points_mm.fill([f32::NAN; 3]);
        }
        if self.plan.infinite.contains(&number) {
            planes.points_mm[5][2] = f32::INFINITY;
        }
        for (k, color) in planes.colors.iter_mut().enumerate() {
            *color = [k as u8, self.content as u8, 1];
        }
        Ok((exposed, planes))
    }

    fn picture(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, Vec<[u8; 3]>), Refusal> {
        assert_eq!(slot, SettingsSlot(1));
        let (number, exposed) = self.expose()?;
        if self.plan.dark.contains(&number) {
            return Ok((exposed, vec![[0; 3]; exposed.size.pixels()]));
        }
        let pixel = |k: usize| [k as u8, self.content as u8, (self.content >> 8) as u8];
        Ok((exposed, (0..exposed.size.pixels()).map(pixel).collect()))
    }

    fn intrinsics(&mut self, _: SettingsSlot) -> Result<Lens, Refusal> {
        Ok(Lens { matrix_px: [2.0, 2.0, 4.0, 3.0], distortion: [0.0; 5] })
    }

    fn state(&mut self) -> Result<Temperatures, Refusal> {
        let (dmd_c, general_c, led_c, pcb_c) = (None, None, None, None);
        Ok(Temperatures { dmd_c, general_c, led_c, lens_c: Some(36.0), pcb_c })
    }

    fn measure_ambient_light(&mut self) -> Result<Light, Refusal> {
        Ok(Light { flicker: Flicker::Grid50Hz, frequency: "100".to_owned() })
    }
}
