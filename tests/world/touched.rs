//! The grids that the arm touched, from the motions that the controller executed. The store must count all of them
//! until the part has its result, or another part is in the cell.

use panelprep::record::{AbradedGrid, ContactPath, CycleId, CycleRecord, EarlierPass, abraded_grids};
use std::collections::BTreeSet;

/// A grid in a pass of a cycle: cycle, pass, grid.
type Place = (CycleId, u8, String);

/// The touched places.
#[derive(Debug, Clone, Default)]
pub struct Touched {
    /// The grids that were touched in all cycles of the store.
    all: BTreeSet<Place>,
    /// Grids touched on the present part, in cycles before the present one.
    part: BTreeSet<Place>,
    /// Grids touched on the present part after the backup that replaced the store.
    lost: BTreeSet<Place>,
    /// The open contact path, and its cycle.
    path: Option<(CycleId, ContactPath)>,
}

impl Touched {
    /// Records a contact path that is in the record and may begin.
    pub fn opens(&mut self, cycle: Option<CycleId>, path: &ContactPath) {
        self.path = cycle.map(|cycle| (cycle, path.clone()));
    }

    /// Records the number of executed waypoints; `None` if it is not known.
    pub fn executed(&mut self, executed: Option<usize>) {
        let (Some((cycle, path)), Some(executed)) = (&self.path, executed) else { return };
        let reached = path.grids.iter().filter(|reached| reached.first as usize <= executed);
        let places: Vec<Place> = reached.map(|reached| (*cycle, path.pass, reached.grid.clone())).collect();
        self.part.extend(places.iter().cloned());
        self.all.extend(places);
    }

    /// Records the end of the contact path.
    pub fn closes(&mut self) {
        self.path = None;
    }

    /// Returns whether a grid was touched on the present part.
    pub fn has_part(&self) -> bool {
        !self.part.is_empty() || !self.lost.is_empty()
    }

    /// Records that another part is in the cell.
    pub fn another_part(&mut self) {
        self.part.clear();
        self.lost.clear();
    }

    /// Returns the number of passes on the present part that the store may have lost.
    pub fn lost(&self) -> usize {
        passes_of(self.lost.iter())
    }

    /// Returns the touched grids of an earlier store, which replaces the store of the later ones. The part in the cell
    /// remains as the arm left it.
    pub fn replaces(self, later: &Touched) -> Self {
        let (part, lost): (BTreeSet<Place>, BTreeSet<Place>) =
            later.part.iter().cloned().partition(|place| self.all.contains(place));
        Touched {
            part,
            lost: lost.into_iter().chain(later.lost.iter().cloned()).collect(),
            path: None,
            all: self.all,
        }
    }

    /// Records that the part has its result in this cycle and is taken out.
    pub fn has_result(&mut self, cycle: CycleId) {
        self.part.retain(|(of, ..)| *of > cycle);
        self.lost.retain(|(of, ..)| *of > cycle);
    }

    /// Describes grids that were touched on this part and that a new cycle does not count, if there are any.
    pub fn uncounted(&self, cycle: Option<CycleId>, counted: &[EarlierPass]) -> Option<String> {
        let knows = |(of, pass, grid): &Place| {
            let is_it = |known: &EarlierPass| {
                (known.cycle, known.pass) == (*of, *pass) && known.grid.as_ref().is_none_or(|known| known == grid)
            };
            Some(*of) == cycle || counted.iter().any(is_it)
        };
        let stated = counted.iter().filter(|known| known.is_stated).count();
        // A pass whose permissions are in the backup is counted without a person's statement.
        let lost = passes_of(self.lost.iter().filter(|place| !knows(place)));
        if stated < lost {
            return Some(format!("{lost} passes were lost by a restore, and {stated} are counted"));
        }
        let forgotten = self.part.iter().find(|place| !knows(place))?;
        Some(format!(
            "{} was touched in cycle {}, pass {}, and is not counted",
            forgotten.2, forgotten.0, forgotten.1
        ))
    }

    /// Describes grids that were touched in a cycle and that its record does not count, if there are any.
    pub fn unrecorded(&self, cycle: CycleId, record: &CycleRecord) -> Option<String> {
        let mut places = self.all.iter().filter(|(of, ..)| *of == cycle).peekable();
        places.peek()?;
        let counted = abraded_grids(&record.findings, &record.motions);
        let knows = |(_, pass, grid): &Place| {
            let is_it =
                |known: &AbradedGrid| known.pass == *pass && known.grid.as_ref().is_none_or(|known| known == grid);
            counted.iter().any(is_it)
        };
        let (_, pass, grid) = places.find(|place| !knows(place))?;
        Some(format!("{grid} was touched in pass {pass}, and its record does not count it"))
    }

    /// Returns the cycles in which a grid was touched.
    pub fn cycles(&self) -> impl Iterator<Item = &CycleId> {
        self.all.iter().map(|(cycle, ..)| cycle)
    }
}

/// Returns the number of passes in which these places were touched.
fn passes_of<'p>(places: impl Iterator<Item = &'p Place>) -> usize {
    places.map(|(cycle, pass, _)| (cycle, pass)).collect::<BTreeSet<_>>().len()
}
