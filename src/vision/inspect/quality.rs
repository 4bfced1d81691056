//! Decides whether each picture can be used, records the flaws of unusable pictures, and measures for how long the film
//! was not observed because of them.

use super::model::PictureMeasurement;
use super::steady::OutlineMeasurement;
use panelprep_cell::recipe;
use strum::{EnumCount, VariantArray};

/// Minimum sharpness of a picture, as a fraction of the sharpness of the first picture.
pub const MIN_SHARPNESS: f64 = 0.6;
/// Minimum sharpness of the first picture. The sharpness is the largest step from pixel to pixel, as a fraction of the
/// contrast of the edge.
pub const MIN_FIRST_SHARPNESS: f64 = 0.2;

/// A reason why a picture cannot be judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, EnumCount, VariantArray)]
pub enum Flaw {
    /// The light decreased by more than can be compensated.
    Darker,
    /// The light increased by more than can be compensated, or the film broke everywhere: the two cannot be
    /// distinguished.
    Brighter,
    /// The lamp flickers, and it cannot be determined whether the lamp or water darkened the surroundings of the panel.
    Flicker,
    /// Too much of the region is overexposed.
    Bright,
    /// The panel moved since the first picture.
    Moved,
    /// The picture is out of focus.
    Focus,
    /// The picture is bit-identical to the previous one.
    Frozen,
    /// Too little of the outline is visible to determine whether the panel moved.
    Outline,
    /// The visible parts of the outline do not agree on the position of the panel.
    OutlineDisagrees,
}

impl Flaw {
    /// All flaws, in the order of their declaration.
    pub const ALL: &'static [Flaw] = <Self as VariantArray>::VARIANTS;

    /// Returns the keyword of the flaw, which does not change between versions.
    pub fn keyword(self) -> &'static str {
        match self {
            Flaw::Darker | Flaw::Brighter | Flaw::Flicker => "light",
            Flaw::Bright => "bright",
            Flaw::Moved => "moved",
            Flaw::Focus => "focus",
            Flaw::Frozen => "frozen",
            Flaw::Outline | Flaw::OutlineDisagrees => "outline",
        }
    }
}

/// The pictures with one flaw.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FlawedPictures {
    /// Number of pictures; a picture is counted only for its first flaw.
    pub pictures: usize,
    /// The worst measured value, in the unit of its limit.
    pub worst: f64,
}

/// Quality of the observation of a film.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Number of pictures that were judged.
    pub usable: usize,
    /// Time covered by usable pictures, s: each picture covers the time since the previous picture.
    pub usable_s: f64,
    /// The pictures with each flaw, in the order of [`Flaw::ALL`].
    pub flawed: [FlawedPictures; Flaw::COUNT],
    /// Longest time without a usable picture, s.
    pub longest_unseen_s: f64,
    /// Minimum and maximum light of the usable pictures, relative to the dry picture.
    pub light: [f64; 2],
    /// Maximum displacement of the panel in the picture, px; `None` if its outline has no contrast.
    pub moved_px: Option<f64>,
    /// Sharpness of the least sharp picture, relative to the first picture; `None` if the outline has no contrast.
    pub sharpness: Option<f64>,
    /// Sharpness of the first picture, without comparison.
    pub first_sharpness: Option<f64>,
    /// Distance between the outline in the dry picture and the outline calculated from the pose, px; `None` if the
    /// outline has no contrast.
    pub off_px: Option<f64>,
    last_usable_s: f64,
    last_s: f64,
}

impl Default for Quality {
    fn default() -> Self {
        Quality {
            usable: 0,
            usable_s: 0.0,
            flawed: [FlawedPictures::default(); Flaw::COUNT],
            longest_unseen_s: 0.0,
            light: [f64::INFINITY, f64::NEG_INFINITY],
            moved_px: None,
            sharpness: None,
            first_sharpness: None,
            off_px: None,
            last_usable_s: 0.0,
            last_s: 0.0,
        }
    }
}

impl Quality {
    /// Adds the measurements of one picture and returns whether the picture can be judged.
    pub fn add(
        &mut self,
        look: &PictureMeasurement,
        outline: OutlineMeasurement,
        settings: &recipe::Inspect,
        time_s: f64,
    ) -> bool {
        if let OutlineMeasurement::Measured(steady) = outline {
            self.moved_px = Some(self.moved_px.unwrap_or(0.0).max(steady.moved_px));
            self.sharpness = Some(self.sharpness.unwrap_or(f64::INFINITY).min(steady.sharpness));
        }
        let flaw = first_flaw(look, outline, settings);
        let since_s = time_s - std::mem::replace(&mut self.last_s, time_s);
        match flaw {
            Some((flaw, measured)) => {
                let FlawedPictures { pictures, worst } = &mut self.flawed[flaw as usize];
                let least_is_worst = matches!(flaw, Flaw::Focus | Flaw::Outline);
                let is_worse = if least_is_worst { measured < *worst } else { measured > *worst };
                *worst = if *pictures == 0 || is_worse { measured } else { *worst };
                *pictures += 1;
            }
            None => {
                self.usable += 1;
                self.usable_s += since_s;
                self.longest_unseen_s = self.longest_unseen_s.max(time_s - self.last_usable_s);
                self.last_usable_s = time_s;
                self.light = [self.light[0].min(look.light), self.light[1].max(look.light)];
            }
        }
        flaw.is_none()
    }

    /// Ends the film: the time after the last usable picture is treated as not observed.
    pub fn end(&mut self) {
        self.longest_unseen_s = self.longest_unseen_s.max(self.last_s - self.last_usable_s);
    }
}

/// Returns the maximum increase of the light over the dry picture that can be compensated if the lamp cannot be
/// measured around the panel, percent. With (1 + τ)/2τ times the light of the dry picture, a wet place is as bright as
/// the limit between wet and dry. The picture then looks as if the film had broken everywhere.
pub fn max_brighter_percent(film_left: f64, settings: &recipe::Inspect) -> f64 {
    (50.0 * (1.0 / film_left - 1.0)).clamp(0.0, settings.max_light_change_percent())
}

/// Returns the first flaw of a picture and its measured value; `None` for a usable picture.
fn first_flaw(
    look: &PictureMeasurement,
    outline: OutlineMeasurement,
    settings: &recipe::Inspect,
) -> Option<(Flaw, f64)> {
    let (darker, brighter) = ((1.0 - look.light) * 100.0, (look.light - 1.0) * 100.0);
    let overexposed = look.overexposed * 100.0;
    let most_brighter = match look.is_lamp_known {
        true => settings.max_light_change_percent(),
        false => max_brighter_percent(look.film_transmission, settings),
    };
    let (blurred, moved_px, seen_percent) = match outline {
        OutlineMeasurement::Measured(steady) => (Some(steady.sharpness), steady.moved_px, None),
        OutlineMeasurement::Lost(seen_percent) => (None, 0.0, Some(seen_percent)),
        OutlineMeasurement::Disagrees | OutlineMeasurement::NoContrast => (None, 0.0, None),
    };
    let tests = [
        (look.frozen, Flaw::Frozen, 0.0),
        (blurred.is_some_and(|sharpness| sharpness < MIN_SHARPNESS), Flaw::Focus, blurred.unwrap_or(0.0)),
        (overexposed > settings.max_bright_percent(), Flaw::Bright, overexposed),
        (darker > settings.max_light_change_percent(), Flaw::Darker, darker),
        (brighter > most_brighter, Flaw::Brighter, brighter),
        (look.flicker_percent > 0.0, Flaw::Flicker, look.flicker_percent),
        (moved_px > settings.max_moved_px(), Flaw::Moved, moved_px),
        (seen_percent.is_some(), Flaw::Outline, seen_percent.unwrap_or(0.0)),
        (outline == OutlineMeasurement::Disagrees, Flaw::OutlineDisagrees, 0.0),
    ];
    tests.into_iter().find(|(has, ..)| *has).map(|(_, flaw, measured)| (flaw, measured))
}

#[cfg(test)]
mod tests {
    use super::super::steady::PanelMotion;
    use super::super::tests::inspect_table;
    use super::*;

    const GOOD: PictureMeasurement = PictureMeasurement {
        light: 1.0,
        is_lamp_known: false,
        overexposed: 0.0,
        frozen: false,
        film_transmission: 0.6,
        flicker_percent: 0.0,
    };
    const STEADY: PanelMotion = PanelMotion { moved_px: 0.0, sharpness: 1.0 };

    /// Expected values, calculated by hand: values on both sides of each limit, with the defaults of the recipe; the
    /// maximum increase of the light is (1/0.6 − 1)/2 = 33.3 %.
    #[test]
    fn each_limit_has_its_flaw() {
        let settings = inspect_table("");
        let found = |look: PictureMeasurement, steady: PanelMotion| {
            first_flaw(&look, OutlineMeasurement::Measured(steady), &settings).map(|(flaw, _)| flaw)
        };
        let looks = [
            (PictureMeasurement { light: 0.61, ..GOOD }, PictureMeasurement { light: 0.59, ..GOOD }, Flaw::Darker),
            (
                PictureMeasurement { light: 1.33, ..GOOD },
                PictureMeasurement { light: 1.34, ..GOOD },
                Flaw::Brighter,
            ),
            (GOOD, PictureMeasurement { flicker_percent: 2.0, ..GOOD }, Flaw::Flicker),
            (
                PictureMeasurement { light: 1.39, is_lamp_known: true, ..GOOD },
                PictureMeasurement { light: 1.41, is_lamp_known: true, ..GOOD },
                Flaw::Brighter,
            ),
            (
                PictureMeasurement { overexposed: 0.049, ..GOOD },
                PictureMeasurement { overexposed: 0.051, ..GOOD },
                Flaw::Bright,
            ),
            (GOOD, PictureMeasurement { frozen: true, ..GOOD }, Flaw::Frozen),
        ];
        for (good, bad, expected) in looks {
            assert_eq!((found(good, STEADY), found(bad, STEADY)), (None, Some(expected)));
        }
        let moved = |moved_px: f64, sharpness: f64| found(GOOD, PanelMotion { moved_px, sharpness });
        assert_eq!([moved(1.0, 0.6), moved(1.1, 0.6)], [None, Some(Flaw::Moved)]);
        assert_eq!(
            [moved(0.0, 0.59), first_flaw(&GOOD, OutlineMeasurement::Lost(12.0), &settings).map(|(flaw, _)| flaw)],
            [Some(Flaw::Focus), Some(Flaw::Outline)],
            "gone, neither blurred nor moved"
        );
        let disagrees = first_flaw(&GOOD, OutlineMeasurement::Disagrees, &settings).map(|(flaw, _)| flaw);
        assert_eq!(disagrees, Some(Flaw::OutlineDisagrees));
        assert_eq!(
            first_flaw(
                &PictureMeasurement { film_transmission: 0.5, light: 1.41, ..GOOD },
                OutlineMeasurement::NoContrast,
                &settings
            )
            .map(|found| found.0),
            Some(Flaw::Brighter)
        );
    }

    /// Pictures are captured once per second. Three in the middle and the last two are flawed; each flaw is reported
    /// with its worst value. The expected times are calculated by hand.
    #[test]
    fn unseen_time_and_the_worst_value_of_each_flaw_are_reported() {
        let mut quality = Quality::default();
        let blurred = |sharpness: f64| PanelMotion { sharpness, ..STEADY };
        let darker = |light: f64| PictureMeasurement { light, ..GOOD };
        let shown = [
            (darker(0.9), STEADY),
            (darker(0.5), STEADY),
            (darker(0.4), STEADY),
            (darker(0.45), STEADY),
            (darker(1.1), STEADY),
            (GOOD, blurred(0.3)),
            (GOOD, blurred(0.5)),
        ];
        for (second, (look, steady)) in shown.iter().enumerate() {
            quality.add(look, OutlineMeasurement::Measured(*steady), &inspect_table(""), second as f64);
        }
        assert_eq!((quality.usable, quality.longest_unseen_s, quality.light), (2, 4.0, [0.9, 1.1]));
        quality.end();
        let [dark, focus] = [Flaw::Darker, Flaw::Focus].map(|flaw| quality.flawed[flaw as usize]);
        assert!(
            (dark.pictures, focus.pictures) == (3, 2) && (dark.worst - 60.0).abs() < 1e-9 && focus.worst == 0.3
        );
        assert_eq!((quality.longest_unseen_s, quality.sharpness), (4.0, Some(0.3)));
    }
}
