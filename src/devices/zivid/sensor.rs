//! The interface of the worker to a camera: the camera is operated through the SDK, one call at a time.

use super::message::{Identity, Lens, Light, Refusal, Size, Source, Temperatures, Use};
use std::path::Path;

/// The number that the sensor gave to settings that it has read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SettingsSlot(pub u32);

/// The metadata of an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposureMetadata {
    /// Its size.
    pub size: Size,
    /// Time at which the exposure ended, ns of the monotonic clock.
    pub exposed_ns: u64,
    /// How long the camera paused because it is hot, ms.
    pub throttled_ms: f64,
    /// Temperature of the lens at this shot, °C.
    pub lens_c: Option<f64>,
}

/// The values of a 3D shot, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct ShotPlanes {
    /// x, y, z in the camera's frame, mm; NaN if missing.
    pub points_mm: Vec<[f32; 3]>,
    /// Red, green, blue, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Signal-to-noise ratio.
    pub snr: Vec<f32>,
}

impl ShotPlanes {
    /// Allocates memory for a shot of this size.
    pub fn with_size(size: Size) -> Self {
        let pixels = size.pixels();
        ShotPlanes { points_mm: vec![[0.0; 3]; pixels], colors: vec![[0; 3]; pixels], snr: vec![0.0; pixels] }
    }
}

/// A 3D camera that also takes colour pictures. Each call blocks; a request that it cannot fulfil is refused in
/// words.
pub trait Sensor: Send {
    /// Returns the version of the SDK with which the sensor was built.
    fn sdk_version(&self) -> String;

    /// Opens a camera; a camera that is open is released first, with its settings.
    ///
    /// # Errors
    /// If there is no such camera; likewise for the other methods, if the camera does not do what is requested.
    fn connect(&mut self, source: &Source) -> Result<Identity, Refusal>;

    /// Reads settings from a YAML file.
    ///
    /// # Errors
    /// As [`Sensor::connect`].
    fn settings(&mut self, usage: Use, file: &Path) -> Result<(SettingsSlot, Size), Refusal>;

    /// Takes a 3D shot.
    ///
    /// # Errors
    /// As [`Sensor::connect`].
    fn scan(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, ShotPlanes), Refusal>;

    /// Takes a picture: red, green, blue of each pixel.
    ///
    /// # Errors
    /// As [`Sensor::connect`].
    fn picture(&mut self, slot: SettingsSlot) -> Result<(ExposureMetadata, Vec<[u8; 3]>), Refusal>;

    /// Returns the camera's model of its lens.
    ///
    /// # Errors
    /// As [`Sensor::connect`].
    fn intrinsics(&mut self, slot: SettingsSlot) -> Result<Lens, Refusal>;

    /// Returns the camera's temperatures.
    ///
    /// # Errors
    /// As [`Sensor::connect`].
    fn state(&mut self) -> Result<Temperatures, Refusal>;

    /// Measures how the ambient light flickers at present.
    ///
    /// # Errors
    /// As [`Sensor::connect`].
    fn measure_ambient_light(&mut self) -> Result<Light, Refusal>;
}
