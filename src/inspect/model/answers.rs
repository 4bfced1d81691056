//! Queries of the model: the state of each pixel of the window.

use super::kernel::{BLOCK_PX, BROKE, EVER_WET, INSIDE, LEVEL, OPEN, RUN};
use super::light::TILE_PX;
use super::unseen::was_seen;
use super::{Mirror, Model};

/// A tile of the region under a film that takes the same fraction everywhere.
pub struct TileFilm {
    /// How bright it is when dry, grey levels.
    pub dry_levels: f64,
    /// By how much the film changes it, grey levels.
    pub change_levels: f64,
}

impl Model {
    /// Block and place in it of a pixel of the window.
    pub(super) fn at(&self, index: usize) -> (usize, usize) {
        let (row, column) = (index / self.window.width, index % self.window.width);
        (row * self.columns + column / BLOCK_PX, column % BLOCK_PX)
    }

    fn kept(&self, index: usize) -> u16 {
        let (block, at) = self.at(index);
        self.kept[block][at]
    }

    /// How bright the region is when dry, grey levels.
    pub fn mean_dry_levels(&self) -> f64 {
        if let Some(mirror) = &self.mirror {
            return mirror.mean_dry_levels();
        }
        let inside =
            self.kept.as_flattened().iter().zip(self.dry.as_flattened()).filter(|(kept, _)| **kept & INSIDE > 0);
        let (sum, count) = inside.fold((0_u64, 0_u64), |(sum, count), (_, dry)| (sum + u64::from(*dry), count + 1));
        sum as f64 / count.max(1) as f64 / f64::from(LEVEL)
    }

    /// The tile of a pixel of the window, as [`Model::tiles`] has them.
    pub fn tile_of(&self, index: usize) -> usize {
        let (row, column) = (index / self.window.width, index % self.window.width);
        row / TILE_PX * self.columns + column / TILE_PX
    }

    /// Each tile of the region, where the clip determined what the film leaves; `None` where none of the region lies in it. Where a
    /// film mirrors more than elsewhere it takes less away.
    pub fn tiles(&self) -> Option<Vec<Option<TileFilm>>> {
        let film = self.film()?;
        let mut sums = vec![(0_u64, 0_u64); self.kept.len() / TILE_PX];
        for (block, (kept, dry)) in self.kept.iter().zip(&self.dry).enumerate() {
            let tile = &mut sums[block / self.columns / TILE_PX * self.columns + block % self.columns];
            for (_, dry) in kept.iter().zip(dry).filter(|(kept, _)| **kept & INSIDE > 0) {
                *tile = (tile.0 + u64::from(*dry), tile.1 + 1);
            }
        }
        let tile = |((sum, count), (beyond, pictures)): ((u64, u64), &(f64, u32))| {
            let dry_levels = (count > 0).then(|| sum as f64 / count as f64 / f64::from(LEVEL))?;
            let beyond = if *pictures > 0 { (beyond / f64::from(*pictures)).max(1.0) } else { 1.0 };
            Some(TileFilm { dry_levels, change_levels: dry_levels * (1.0 - film * beyond) })
        };
        Some(sums.into_iter().zip(&self.beyond).map(tile).collect())
    }

    /// A pixel's dry brightness, of any unit.
    pub fn dry_brightness(&self, index: usize) -> f64 {
        let (block, at) = self.at(index);
        f64::from(self.dry[block][at])
    }

    /// Whether a pixel of the window was looked at.
    pub fn sees(&self, index: usize) -> bool {
        if let Some(mirror) = &self.mirror {
            return mirror.sees(index);
        }
        self.kept(index) & INSIDE > 0
    }

    /// Whether it showed that it is wet or dry, and did so in half of the pictures and near the end: no glint, nothing that
    /// flickers.
    pub fn saw(&self, index: usize) -> bool {
        if let Some(mirror) = &self.mirror {
            return mirror.saw(index);
        }
        let (block, at) = self.at(index);
        self.sees(index)
            && self.kept(index) & (EVER_WET | BROKE | RUN) > 0
            && was_seen(self.past[block].unseen[at], self.past[block].unseen_now[at], &self.times_s)
    }

    /// Whether it was seen wet in a picture.
    pub fn ever_wet(&self, index: usize) -> bool {
        if let Some(mirror) = &self.mirror {
            return mirror.ever_wet(index);
        }
        self.kept(index) & EVER_WET > 0
    }

    /// Whether its film is open now.
    pub fn is_open(&self, index: usize) -> bool {
        if let Some(mirror) = &self.mirror {
            return mirror.is_open(index);
        }
        self.kept(index) & OPEN > 0
    }

    /// How long its film was open, where it broke and closed again, s.
    pub fn was_open_s(&self, index: usize) -> Option<f32> {
        if let Some(mirror) = &self.mirror {
            return mirror.was_open_s(index);
        }
        let (block, at) = self.at(index);
        let (past, time_s) = (&self.past[block], |picture: u16| self.times_s[usize::from(picture)]);
        (self.kept(index) & (BROKE | OPEN) == BROKE).then(|| time_s(past.until[at]) - time_s(past.since[at]))
    }

    /// How far from its dry brightness it was while it looked dry, as a share of what the film takes.
    pub fn off_dry(&self, index: usize) -> f32 {
        let (block, at) = self.at(index);
        f32::from(self.past[block].off[at] as i16)
            / (f32::from(self.dry[block][at]) * (1.0 - self.wetting.film as f32)).max(1.0)
    }

    /// Whether film and dry differ enough there to tell one from the other.
    pub fn has_contrast(&self, index: usize) -> bool {
        self.mirror.as_ref().is_none_or(|mirror| mirror.has_contrast(index))
    }

    /// The film as a mirror, where it is judged as one.
    pub fn mirror(&self) -> Option<&Mirror> {
        self.mirror.as_deref()
    }

    /// When its film broke, s; `None` where it did not.
    pub fn broke_s(&self, index: usize) -> Option<f32> {
        if let Some(mirror) = &self.mirror {
            return mirror.broke_s(index);
        }
        (self.kept(index) & BROKE > 0).then(|| self.since_s(index))
    }

    /// Since when it has looked dry, though not long enough to count, or long enough beside a glint.
    pub fn looks_dry_since_s(&self, index: usize) -> Option<f32> {
        if let Some(mirror) = &self.mirror {
            return mirror.looks_dry_since_s(index);
        }
        let kept = self.kept(index);
        if kept & (BROKE | INSIDE) != INSIDE {
            return None;
        }
        let (block, at) = self.at(index);
        let beside = usize::from(self.past[block].beside_glint[at]);
        // Half of what makes a break: that it belongs to one is told by the break it reaches.
        let is_long = beside > 0 && 2 * (self.times_s.len() - beside) > usize::from(self.persist);
        (kept & RUN > 0).then(|| self.since_s(index)).or_else(|| is_long.then(|| self.times_s[beside - 1]))
    }

    fn since_s(&self, index: usize) -> f32 {
        let (block, at) = self.at(index);
        self.times_s[usize::from(self.past[block].since[at])]
    }
}
