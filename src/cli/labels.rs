//! The labels of a clip: `mask.png` with the pixels that broke by its end, and, where it is known, `times.png` with when.
//!
//! In `times.png` a pixel that broke has blue 255, and red · 256 + green hundredths of a second since the first fully wet
//! picture; any other pixel is black.

use super::disk;
use super::fault::Fault;
use crate::files;
use crate::geometry::{ColorPicture, Mask};
use std::path::Path;

/// The mask's file.
pub const MASK: &str = "mask.png";
/// The times' file.
pub const TIMES: &str = "times.png";

/// A time as a colour.
pub fn coded(since_wet_s: Option<f64>) -> [u8; 3] {
    since_wet_s.map_or([0; 3], |since_wet_s| {
        let [red, green] = ((since_wet_s * 100.0).round().clamp(0.0, 65_535.0) as u16).to_be_bytes();
        [red, green, 255]
    })
}

fn decoded([red, green, blue]: [u8; 3]) -> Option<f64> {
    (blue == 255).then(|| f64::from(u16::from_be_bytes([red, green])) / 100.0)
}

/// What is true of a clip.
pub struct Labels {
    /// The pixels that broke by its end.
    pub mask: Mask,
    times: Option<ColorPicture>,
}

impl Labels {
    /// Reads a folder's labels.
    ///
    /// # Errors
    /// Where there is no mask, or a file is no picture.
    pub fn read(folder: &Path) -> Result<Self, Fault> {
        let file = folder.join(MASK);
        let gray = files::read_gray(&disk::read(&file)?).map_err(|error| Fault::file(&file, error))?;
        let file = folder.join(TIMES);
        let times = match file.exists() {
            true => Some(files::read_color(&disk::read(&file)?).map_err(|error| Fault::file(&file, error))?),
            false => None,
        };
        Ok(Labels { mask: Mask::from_gray(&gray), times })
    }

    /// When a pixel broke, s; `None` also where that is not known.
    pub fn time_s(&self, index: usize) -> Option<f64> {
        decoded(*self.times.as_ref()?.rgb.get(index)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_survive_their_colour() {
        for time_s in [None, Some(0.0), Some(0.25), Some(59.99), Some(600.0)] {
            assert_eq!(decoded(coded(time_s)), time_s);
        }
    }
}
