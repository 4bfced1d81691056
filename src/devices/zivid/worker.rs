//! The worker: a separate process that controls the camera and replies to the daemon, one request at a time.
//!
//! The Zivid SDK is C++ code that uses the GPU: it may hang, crash, or end its process. In a separate process this
//! affects only the worker. The worker decides nothing: it captures the requested scans and pictures and reports their
//! metadata. It ends when the daemon closes the connection, and also if the daemon ends without notice.

use super::message::{Hello, Refusal, Reply, Request, SettingsHash, ShotInfo, Size, Source, Trouble, Use};
use super::sensor::{Camera, Clip, Sensor, SettingsSlot, ShotPlanes, lock};
use super::wire::{self, FrameKind, WireError};
use panelprep_cell::files::content_hash;
use std::collections::HashMap;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex};

/// Size of the socket's send buffer, bytes, so that one end continues to send while the other computes the checksum of
/// a piece.
const SOCKET_BYTES: usize = 1 << 20;

/// The error because of which the worker ends.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// A request of the daemon cannot be read.
    #[error("the daemon's request cannot be read: {0}")]
    Wire(#[from] WireError),
    /// A reply to the daemon cannot be written.
    #[error("a response cannot be written: {0}")]
    Json(#[from] serde_json::Error),
}

/// A reply with its payload.
enum Answer {
    Words(Reply),
    Scan(ShotInfo, ShotPlanes),
    Picture(ShotInfo, Vec<[u8; 3]>),
}

/// Settings that the sensor has loaded.
#[derive(Debug, Clone, Copy)]
struct LoadedSettings {
    usage: Use,
    slot: SettingsSlot,
}

/// Processes the requests of one daemon until the daemon closes the connection.
///
/// # Errors
/// If a request cannot be read, or a reply cannot be written; then the connection cannot be used any more.
pub fn serve(mut daemon: UnixStream, sensor: Box<dyn Sensor>) -> Result<(), WorkerError> {
    send_hello(&mut daemon, Ok(sensor.sdk_version()))?;
    #[expect(
        clippy::let_underscore_must_use,
        reason = "the buffer size is only a hint: without it, sending a scan takes a few milliseconds longer"
    )]
    let _ = rustix::net::sockopt::set_socket_send_buffer_size(&daemon, SOCKET_BYTES);
    let camera = Arc::new(Mutex::new(Camera::new(sensor)));
    let mut worker = SensorWorker { camera, settings: HashMap::new(), clip: None };
    loop {
        let opened = match wire::open(&mut daemon, FrameKind::Request) {
            Err(WireError::Ended) => return Ok(()),
            other => other?,
        };
        let (sequence, request) = (opened.sequence, serde_json::from_slice::<Request>(&opened.head)?);
        opened.finish_without_payload(&mut daemon)?;
        let answer =
            worker.answer_request(request).unwrap_or_else(|refusal| Answer::Words(Reply::Refused(refusal)));
        send(&mut daemon, sequence, &answer)?;
    }
}

/// Sends the first message of the worker: the version of the SDK, or the reason why the SDK is not available.
///
/// # Errors
/// If the message cannot be written.
pub fn send_hello(daemon: &mut UnixStream, sdk: Result<String, String>) -> Result<(), WorkerError> {
    let hello = Hello { program: env!("CARGO_PKG_VERSION").to_owned(), sdk };
    Ok(wire::write(daemon, (FrameKind::Hello, 0), &serde_json::to_vec(&hello)?, &[])?)
}

fn send(daemon: &mut UnixStream, sequence: u32, answer: &Answer) -> Result<(), WorkerError> {
    let mut reply = |head: &Reply, planes: &[&[u8]]| -> Result<(), WorkerError> {
        Ok(wire::write(daemon, (FrameKind::Reply, sequence), &serde_json::to_vec(head)?, planes)?)
    };
    match answer {
        Answer::Words(words) => reply(words, &[]),
        Answer::Scan(taken, ShotPlanes { points_mm, colors, snr }) => {
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

struct SensorWorker {
    camera: Arc<Mutex<Camera>>,
    settings: HashMap<SettingsHash, LoadedSettings>,
    clip: Option<Clip>,
}

impl SensorWorker {
    fn answer_request(&mut self, request: Request) -> Result<Answer, Refusal> {
        // Every request except those for the next picture and for the end of the clip stops a clip, because the camera
        // executes one task at a time.
        if !matches!(request, Request::NextPicture | Request::EndClip) {
            drop(self.clip.take());
        }
        let words = |reply| Ok(Answer::Words(reply));
        match request {
            Request::Connect { source } => words(self.connect(&source)?),
            Request::Settings { usage, yaml, hash } => words(Reply::Settings(self.read(usage, &yaml, hash)?)),
            Request::Scan { settings } => {
                let slot = self.settings_slot(Use::Scan, &settings)?;
                let (taken, planes) = lock(&self.camera).capture(&settings, |sensor| sensor.scan(slot))?;
                Ok(Answer::Scan(taken, planes))
            }
            Request::Picture { settings } => {
                let slot = self.settings_slot(Use::Picture, &settings)?;
                let (taken, rgb) = lock(&self.camera).capture(&settings, |sensor| sensor.picture(slot))?;
                Ok(Answer::Picture(taken, rgb))
            }
            Request::BeginClip { settings, pictures_per_second } => {
                let slot = self.settings_slot(Use::Picture, &settings)?;
                self.clip = Some(Clip::begin_clip(self.camera.clone(), (slot, settings), pictures_per_second)?);
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
                let known = self.loaded_settings(&settings)?;
                words(Reply::Intrinsics(lock(&self.camera).sensor.intrinsics(known.slot)?))
            }
            Request::State => words(Reply::State(lock(&self.camera).sensor.state()?)),
            Request::Light => words(Reply::Light(lock(&self.camera).sensor.measure_ambient_light()?)),
        }
    }

    fn connect(&mut self, source: &Source) -> Result<Reply, Refusal> {
        self.settings.clear();
        let mut camera = lock(&self.camera);
        let identity = camera.sensor.connect(source)?;
        camera.serial = Some(identity.serial.clone());
        Ok(Reply::Connected(identity))
    }

    /// Loads settings. The SDK reads settings only from files, so the text is written to a temporary file.
    fn read(&mut self, usage: Use, yaml: &str, hash: SettingsHash) -> Result<Size, Refusal> {
        let found = settings_hash(yaml);
        if found != hash {
            let message = format!("the settings received have the hash {found}, expected {hash}: send them again");
            return Err(Refusal { trouble: Trouble::Settings, message });
        }
        let failed = |error: std::io::Error| Refusal {
            trouble: Trouble::Settings,
            message: format!("the settings cannot be passed to the SDK as a file: {error}"),
        };
        // The SDK recognises the file type by its extension.
        let mut file = tempfile::Builder::new().suffix(".yml").tempfile().map_err(failed)?;
        file.write_all(yaml.as_bytes()).and_then(|()| file.flush()).map_err(failed)?;
        let (slot, size) = lock(&self.camera).sensor.settings(usage, file.path())?;
        self.settings.insert(hash, LoadedSettings { usage, slot });
        Ok(size)
    }

    fn loaded_settings(&self, hash: &SettingsHash) -> Result<LoadedSettings, Refusal> {
        let unknown = || Refusal {
            trouble: Trouble::OutOfOrder,
            message: format!("the settings {hash} were not sent after the camera was opened: send them again"),
        };
        self.settings.get(hash).copied().ok_or_else(unknown)
    }

    fn settings_slot(&self, usage: Use, hash: &SettingsHash) -> Result<SettingsSlot, Refusal> {
        let known = self.loaded_settings(hash)?;
        if known.usage == usage {
            return Ok(known.slot);
        }
        let message = format!(
            "the settings {hash} are for {}, but settings for {} were requested",
            known.usage.word(),
            usage.word()
        );
        Err(Refusal { trouble: Trouble::OutOfOrder, message })
    }

    fn running(&mut self) -> Result<&mut Clip, Refusal> {
        let none = || Refusal { trouble: Trouble::OutOfOrder, message: "no clip is being recorded".to_owned() };
        self.clip.as_mut().ok_or_else(none)
    }
}

/// Returns the SHA-256 hash of a settings file's text, hexadecimal.
pub fn settings_hash(yaml: &str) -> SettingsHash {
    content_hash(yaml.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected hash: the output of `printf 'a: 1\n' | sha256sum`.
    #[test]
    fn settings_are_identified_by_their_hash() {
        assert_eq!(settings_hash("a: 1\n"), "37b128c59f1f5097f73f82691cb519f1f568667faab5ced1b4ab979d36837eae");
    }
}
