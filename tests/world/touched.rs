//! What the arm touched, by what the controller executed: no count of the store may forget it before the part has
//! its result, or another part lies there.

use panelprep::record::{Abraded, ContactPath, CycleId, CycleRecord, EarlierPass, abraded};
use std::collections::BTreeSet;

/// A grid, and in which pass of which cycle.
type Place = (CycleId, u8, String);

/// What was touched.
#[derive(Debug, Clone, Default)]
pub struct Touched {
    /// In all cycles of the store.
    all: BTreeSet<Place>,
    /// Of the part that lies there, in cycles before the one at hand.
    part: BTreeSet<Place>,
    /// The path that is open, and its cycle.
    path: Option<(CycleId, ContactPath)>,
}

impl Touched {
    /// A contact path is on the record and may begin.
    pub fn opens(&mut self, cycle: Option<CycleId>, path: &ContactPath) {
        self.path = cycle.map(|cycle| (cycle, path.clone()));
    }

    /// How many waypoints were executed; `None` if that is not known.
    pub fn executed(&mut self, executed: Option<usize>) {
        let (Some((cycle, path)), Some(executed)) = (&self.path, executed) else { return };
        let reached = path.grids.iter().filter(|reached| reached.first as usize <= executed);
        let places: Vec<Place> = reached.map(|reached| (*cycle, path.pass, reached.grid.clone())).collect();
        self.part.extend(places.iter().cloned());
        self.all.extend(places);
    }

    /// It is over.
    pub fn closes(&mut self) {
        self.path = None;
    }

    /// Something was touched on the part that lies there.
    pub fn has_part(&self) -> bool {
        !self.part.is_empty()
    }

    /// Another part lies there.
    pub fn another_part(&mut self) {
        self.part.clear();
    }

    /// The part had its result in this cycle, and is taken out.
    pub fn has_result(&mut self, cycle: CycleId) {
        self.part.retain(|(of, ..)| *of > cycle);
    }

    /// What was touched on this part, and what a cycle that begins does not count.
    pub fn uncounted(&self, cycle: Option<CycleId>, counted: &[EarlierPass]) -> Option<String> {
        let knows = |(of, pass, grid): &Place| {
            let is_it = |known: &EarlierPass| {
                (known.cycle, known.pass) == (*of, *pass) && known.grid.as_ref().is_none_or(|known| known == grid)
            };
            Some(*of) == cycle || counted.iter().any(is_it)
        };
        let forgotten = self.part.iter().find(|place| !knows(place))?;
        Some(format!(
            "{} was touched in cycle {}, pass {}, and is not counted",
            forgotten.2, forgotten.0, forgotten.1
        ))
    }

    /// What was touched in a cycle, and what its record does not count.
    pub fn unrecorded(&self, cycle: CycleId, record: &CycleRecord) -> Option<String> {
        let mut places = self.all.iter().filter(|(of, ..)| *of == cycle).peekable();
        places.peek()?;
        let counted = abraded(&record.findings, &record.motions);
        let knows = |(_, pass, grid): &Place| {
            let is_it =
                |known: &Abraded| known.pass == *pass && known.grid.as_ref().is_none_or(|known| known == grid);
            counted.iter().any(is_it)
        };
        let (_, pass, grid) = places.find(|place| !knows(place))?;
        Some(format!("{grid} was touched in pass {pass}, and its record does not count it"))
    }

    /// The cycles in which something was touched.
    pub fn cycles(&self) -> impl Iterator<Item = &CycleId> {
        self.all.iter().map(|(cycle, ..)| cycle)
    }
}
