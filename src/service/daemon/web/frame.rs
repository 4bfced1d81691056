//! The live picture for people who watch: drawn, reduced and encoded once for all of them.

use crate::daemon::live_view::{LiveFrame, LiveScene, LiveView};
use crate::report::canvas::resize_to_width;
use panelprep_cell::files;
use std::sync::{Arc, Mutex, PoisonError};

/// The largest width of a picture that is sent, px.
const MAX_WIDTH_PX: usize = 960;

/// The newest picture as a JPEG.
pub(super) struct FrameEncoder {
    view: LiveView,
    last: Mutex<Option<(u64, Arc<Vec<u8>>)>>,
}

impl FrameEncoder {
    pub fn new(view: LiveView) -> Self {
        FrameEncoder { view, last: Mutex::new(None) }
    }

    /// Returns the newest cycle in three dimensions.
    pub fn scene(&self) -> LiveScene {
        self.view.scene().clone()
    }

    /// Returns the number of the newest picture and its name; 0 if there is none.
    pub fn newest_frame(&self) -> (u64, Option<String>) {
        match self.view.newest_picture() {
            (number, Some(frame)) => (number, Some(frame.name.clone())),
            (_, None) => (0, None),
        }
    }

    /// Returns the newest picture; `None` if there is none. Encoding takes a few hundredths of a second, once for each
    /// picture.
    pub fn newest_jpeg(&self) -> Option<Arc<Vec<u8>>> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let (number, frame) = self.view.newest_picture();
        let frame = frame?;
        if let Some((kept, jpeg)) = last.as_ref()
            && *kept == number
        {
            return Some(jpeg.clone());
        }
        let jpeg = Arc::new(encoded(&frame)?);
        *last = Some((number, jpeg.clone()));
        Some(jpeg)
    }
}

fn encoded(frame: &LiveFrame) -> Option<Vec<u8>> {
    let drawn = frame.draw().and_then(|picture| match picture.width > MAX_WIDTH_PX {
        true => resize_to_width(&picture, MAX_WIDTH_PX),
        false => Ok(picture),
    });
    let jpeg = drawn.map_err(|error| error.to_string());
    match jpeg.and_then(|picture| files::write_color_jpeg(&picture).map_err(|error| error.to_string())) {
        Ok(jpeg) => Some(jpeg),
        Err(error) => {
            tracing::warn!("the picture {} cannot be shown: {error}", frame.name);
            None
        }
    }
}
