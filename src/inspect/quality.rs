//! Can each picture be judged by? What is wrong with those that cannot, and how long the film went unseen by it.

use super::model::Look;
use super::steady::Steadiness;
use crate::recipe;

/// Of the region this share must be as bright as its state lets expect.
const MIN_TOLD: f64 = 0.5;
/// More light than this looks too much like a film that broke everywhere.
pub const MOST_BRIGHTER_PERCENT: f64 = 25.0;
/// A picture with less of the first one's sharpness is out of focus.
pub const MIN_SHARPNESS: f64 = 0.6;
/// Less is no sharp picture to begin with: the largest step from pixel to pixel, of the whole edge.
pub const MIN_FIRST_SHARPNESS: f64 = 0.2;

/// What keeps a picture from being judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Flaw {
    /// The light is another one than can be made up for.
    Light,
    /// Glints or overexposure hide too much.
    Bright,
    /// The panel is not where it was.
    Moved,
    /// Out of focus.
    Focus,
    /// Bit for bit the picture before.
    Frozen,
}

impl Flaw {
    /// Every one.
    pub const ALL: [Flaw; 5] = [Flaw::Light, Flaw::Bright, Flaw::Moved, Flaw::Focus, Flaw::Frozen];

    /// Its stable word.
    pub fn word(self) -> &'static str {
        match self {
            Flaw::Light => "light",
            Flaw::Bright => "bright",
            Flaw::Moved => "moved",
            Flaw::Focus => "focus",
            Flaw::Frozen => "frozen",
        }
    }
}

/// How well a film could be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Pictures that were judged by.
    pub usable: usize,
    /// Pictures with each flaw, in the order of [`Flaw::ALL`]; a picture counts for its first flaw alone.
    pub flawed: [usize; 5],
    /// The longest time without a usable picture, s.
    pub longest_unseen_s: f64,
    /// The least and the most light of a usable picture, the dry picture's being 1.
    pub light: [f64; 2],
    /// The farthest that the panel moved in the picture, px; `None` where its outline has no contrast.
    pub moved_px: Option<f64>,
    /// The least sharp picture against the first; `None` likewise.
    pub sharpness: Option<f64>,
    /// The first picture's own sharpness.
    pub first_sharpness: Option<f64>,
    last_usable_s: f64,
    last_s: f64,
}

impl Default for Quality {
    fn default() -> Self {
        Quality {
            usable: 0,
            flawed: [0; 5],
            longest_unseen_s: 0.0,
            light: [f64::INFINITY, f64::NEG_INFINITY],
            moved_px: None,
            sharpness: None,
            first_sharpness: None,
            last_usable_s: 0.0,
            last_s: 0.0,
        }
    }
}

impl Quality {
    /// Takes what one picture says of itself; whether it can be judged by.
    pub fn take(
        &mut self,
        look: &Look,
        steady: Option<Steadiness>,
        settings: &recipe::Inspect,
        time_s: f64,
    ) -> bool {
        if let Some(steady) = steady {
            self.moved_px = Some(self.moved_px.unwrap_or(0.0).max(steady.moved_px));
            self.sharpness = Some(self.sharpness.unwrap_or(f64::INFINITY).min(steady.sharpness));
        }
        let flaw = flaw(look, steady, settings);
        self.last_s = time_s;
        match flaw {
            Some(flaw) => self.flawed[flaw as usize] += 1,
            None => {
                self.usable += 1;
                self.longest_unseen_s = self.longest_unseen_s.max(time_s - self.last_usable_s);
                self.last_usable_s = time_s;
                self.light = [self.light[0].min(look.light), self.light[1].max(look.light)];
            }
        }
        flaw.is_none()
    }

    /// The end of the film: what came after the last usable picture was not seen.
    pub fn end(&mut self) {
        self.longest_unseen_s = self.longest_unseen_s.max(self.last_s - self.last_usable_s);
    }
}

fn flaw(look: &Look, steady: Option<Steadiness>, settings: &recipe::Inspect) -> Option<Flaw> {
    let limit_percent = settings.max_light_change_percent();
    let (darker, brighter) = ((1.0 - look.light) * 100.0, (look.light - 1.0) * 100.0);
    let is_other_light = darker > limit_percent || brighter > limit_percent.min(MOST_BRIGHTER_PERCENT);
    if look.frozen {
        Some(Flaw::Frozen)
    } else if steady.is_some_and(|steady| steady.sharpness < MIN_SHARPNESS && steady.sharpness > 0.0) {
        Some(Flaw::Focus)
    } else if look.hidden * 100.0 > settings.max_bright_percent() {
        Some(Flaw::Bright)
    } else if is_other_light || look.told < MIN_TOLD {
        Some(Flaw::Light)
    } else if steady.is_some_and(|steady| steady.moved_px > settings.max_moved_px()) {
        Some(Flaw::Moved)
    } else {
        None
    }
}
