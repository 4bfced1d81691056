//! The present view of the cameras, for people who watch.
//!
//! The computing thread offers a picture; a viewer fetches the newest one and draws it on a separate thread.
//! Nothing waits for a viewer: if there was no viewer recently, nothing is copied, and a picture that was not
//! fetched is replaced.

use super::live_scene::LiveScene;
use super::perception::view;
use super::setup::CycleSetup;
use panelprep_base::geometry::{Base, ColorPicture, Mask, Panel, Rigid};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::{Grid, GridId};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Shortest time between two pictures.
const MIN_PICTURE_INTERVAL: Duration = Duration::from_millis(450);
/// Time after the last request for a picture during which a person counts as watching.
const VIEWER_TIMEOUT: Duration = Duration::from_secs(5);

/// The newest picture. Clones share the same picture.
#[derive(Debug, Clone, Default)]
pub struct LiveView(Arc<Mutex<Inside>>, LiveScene);

#[derive(Debug, Default)]
struct Inside {
    number: u64,
    frame: Option<Arc<LiveFrame>>,
    last_offered: Option<Instant>,
    last_viewed: Option<Instant>,
}

/// A picture, with the data that are drawn on it.
#[derive(Debug)]
pub struct LiveFrame {
    /// The name of the camera's picture or of the drawing.
    pub name: String,
    /// The picture.
    pub picture: Arc<ColorPicture>,
    /// The film to which the picture belongs, if it is part of one.
    pub film: Option<LiveFilm>,
}

/// A film in progress.
#[derive(Debug)]
pub struct LiveFilm {
    /// Seconds since the film's first picture.
    pub film_time_s: f64,
    /// The pixels that broke so far. Pixels that turn out to be a glint are removed at the end.
    pub broken_so_far: Mask,
    /// The grids that failed so far.
    pub failed_so_far: Vec<GridId>,
    pub(super) setup: Arc<CycleSetup>,
    pub(super) place: Rigid<Base, Panel>,
}

impl LiveFrame {
    /// Returns the picture with the known data drawn on it.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn draw(&self) -> Result<ColorPicture, ImagingError> {
        let Some(film) = &self.film else { return Ok((*self.picture).clone()) };
        let failed = |grid: &Grid| film.failed_so_far.contains(&grid.id);
        view(&film.setup, &self.picture, film.place).draw_inspection(
            &film.setup.panel,
            &film.broken_so_far,
            None,
            &failed,
        )
    }
}

impl LiveView {
    /// Returns the number of the newest picture, and the picture if there is one. The caller counts as a viewer.
    pub fn newest_picture(&self) -> (u64, Option<Arc<LiveFrame>>) {
        let mut inside = self.lock();
        inside.last_viewed = Some(Instant::now());
        (inside.number, inside.frame.clone())
    }

    /// Removes the picture: a cycle begins, and the picture belongs to another part.
    pub(super) fn clear(&self) {
        self.lock().frame = None;
    }

    /// Returns the three-dimensional scene of the newest cycle.
    pub(super) fn scene(&self) -> &LiveScene {
        &self.1
    }

    /// Offers a picture; it is created only if there is a viewer and the last picture is old enough.
    pub(super) fn offer_picture(&self, frame: impl FnOnce() -> Option<LiveFrame>) {
        let is_recent = |at: Option<Instant>, span| at.is_some_and(|at| at.elapsed() < span);
        {
            let inside = self.lock();
            if !is_recent(inside.last_viewed, VIEWER_TIMEOUT)
                || is_recent(inside.last_offered, MIN_PICTURE_INTERVAL)
            {
                return;
            }
        }
        // Created without the lock, so that no viewer waits for a copy.
        if let Some(frame) = frame() {
            let mut inside = self.lock();
            inside.number += 1;
            (inside.frame, inside.last_offered) = (Some(Arc::new(frame)), Some(Instant::now()));
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> LiveFrame {
        let picture = Arc::new(ColorPicture::uniform(2, 1, [7, 8, 9]));
        LiveFrame { name: "scan".to_owned(), picture, film: None }
    }

    #[test]
    fn a_picture_is_made_only_if_a_client_watches() {
        let view = LiveView::default();
        view.offer_picture(|| panic!("no person has looked"));
        assert_eq!(view.newest_picture().0, 0);
        view.offer_picture(|| None);
        assert!(view.newest_picture().1.is_none());
        view.offer_picture(|| Some(frame()));
        view.offer_picture(|| panic!("twice within half a second"));
        let (number, shown) = view.newest_picture();
        let drawn = shown.expect("a picture").draw().expect("as it is");
        assert_eq!((number, drawn.rgb), (1, vec![[7, 8, 9]; 2]));
        view.lock().last_viewed = Instant::now().checked_sub(VIEWER_TIMEOUT);
        view.lock().last_offered = None;
        view.offer_picture(|| panic!("they went away"));
    }
}
