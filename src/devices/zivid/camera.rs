//! The camera in the worker: a sensor that takes one shot or picture after the other, and the data about each.

use super::clock::now_ns;
use super::message::{Refusal, SettingsHash, ShotInfo, Trouble};
use super::sensor::{ExposureMetadata, Sensor};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A camera and the number of its shots.
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

    /// Takes a shot or picture and returns the data about it.
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
