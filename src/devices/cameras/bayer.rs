//! The simulated flange camera behind a colour sensor's filters: each pixel sees one colour, and the other two are
//! estimated.

use super::{CameraError, FlangeCamera, FlangePicture, SimulatedFlangeCamera};
use crate::gige::{PixelFormat, demosaic, mosaic};

/// The filters of the simulated sensor.
pub(super) const FORMAT: PixelFormat = PixelFormat::BayerRG8;

/// The simulated flange camera with such a sensor; the pixels reach the program without any other device between.
pub struct BayerFlangeCamera {
    simulated: SimulatedFlangeCamera,
}

impl BayerFlangeCamera {
    /// Adds the filters to a simulated camera.
    pub fn new(simulated: SimulatedFlangeCamera) -> Self {
        BayerFlangeCamera { simulated }
    }
}

impl FlangeCamera for BayerFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let seen = self.simulated.capture()?;
        let size_px = [seen.picture.width, seen.picture.height];
        let colored = demosaic(&mosaic(&seen.picture, FORMAT), size_px, FORMAT);
        Ok(FlangePicture { picture: colored.unwrap_or_else(|| seen.picture.clone()), ..seen })
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.simulated.check_ready()
    }
}
