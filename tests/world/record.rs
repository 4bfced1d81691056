//! The record of a world: the product's own record, on the real store. Pictures are reduced before they are stored,
//! because compressing them would take most of a world's time; each is still a file with its own content, named by a
//! row.

use super::disk;
use super::inside::{Permit, Shared};
use super::ledger::{CommandSummary, Ledger};
use super::restoring::backs_up;
use super::sabotage::Sabotage;
use super::wear::Wear;
use panelprep::cycle::{Outcome, Path};
use panelprep::daemon::{Figure, Note, Port, RecordAnswer, RecordCommand, RecordError, StoreRecord};
use panelprep::geometry::ColorPicture;
use panelprep::record::{ANOTHER_PART_TEXT, ContactPath, Kind};
use panelprep::store::Store;
use panelprep::verdict::Verdict;
use std::path::Path as Folder;
use std::sync::Arc;

/// Width and height of a picture in the store, px.
const SMALL_PX: usize = 8;
/// Minimum distance from the panel that the arm must reach before its next other motion, mm. A path in contact ends
/// `approach_mm` off the panel, and the arm then moves away by the same distance again.
const MIN_LEAVING_DISTANCE_MM: f64 = 60.0;

/// The record's port.
pub struct Record<'s> {
    store: StoreRecord<'s>,
    /// The store's folder.
    folder: &'s Folder,
    ledger: &'s mut Ledger,
    world: Shared,
    sabotage: Option<Sabotage>,
    wear: Wear,
    /// The epoch of the last motion, if the motion reached the end of its path along the panel.
    contact_epoch: Option<u32>,
    /// Whether the present cycle has the result of a film.
    has_film: bool,
}

impl<'s> Record<'s> {
    /// Wraps a record; each acknowledgement is also recorded in the ledger.
    pub fn new((store, folder): (StoreRecord<'s>, &'s Folder), ledger: &'s mut Ledger, world: Shared) -> Self {
        let sabotage = world.lock().sabotage;
        Record {
            store,
            folder,
            ledger,
            world,
            sabotage,
            wear: Wear::default(),
            contact_epoch: None,
            has_film: false,
        }
    }
}

impl Record<'_> {
    /// Checks each power failure that was simulated during the last command: the resulting store must contain
    /// everything that was acknowledged before.
    fn judge_imagined_cuts(&mut self) {
        for folder in disk::simulated_power_failures() {
            let held = self.ledger.clone().check_start(&folder);
            let _ = std::fs::remove_dir_all(&folder);
            let mut world = self.world.lock();
            world.counts.imagined_cuts += 1;
            world.counts.judged("an imagined power cut");
            if let Err(problem) = held {
                world.wrong("an imagined power cut", problem);
            }
        }
    }
}

impl Record<'_> {
    /// Checks that a motion that is reported as executed has ended, and that after a motion in contact the arm leaves
    /// the panel before any other motion.
    fn judge_standing(&mut self, command: &RecordCommand) {
        let mut world = self.world.lock();
        match command {
            RecordCommand::CloseIntent { motion, outcome, .. } => {
                let is_done = *outcome == Outcome::Done;
                let is_calm = !world.is_strange();
                world.counts.judged("a motion's end");
                if is_done && is_calm && world.cell.controller.is_moving() {
                    world.wrong("a motion's end", format!("{motion:?} is reported as done, and the arm moves"));
                }
                world.counts.judged("off the panel");
                self.contact_epoch = (is_done && motion.path == Path::Contact).then_some(motion.epoch);
            }
            RecordCommand::OpenIntent(motion) => {
                let height_mm = world.height_mm();
                let is_near = height_mm < MIN_LEAVING_DISTANCE_MM && motion.path != Path::Retract;
                // If the epoch has changed, another motion was executed in between.
                if self.contact_epoch.take() == Some(motion.epoch) && is_near {
                    let what =
                        format!("{motion:?} begins {height_mm:.1} mm off the panel, behind a path in contact");
                    world.wrong("off the panel", what);
                }
            }
            _ => {}
        }
    }
}

impl Record<'_> {
    /// Checks that no count decreases. The touched grids must be counted when a cycle begins, until the part has its
    /// result or another part is in the cell.
    fn judge_counts(&mut self, counted: &Counted, answer: &RecordAnswer) {
        let mut world = self.world.lock();
        let touched = &mut self.ledger.touched;
        match (counted, answer) {
            (Counted::Opens(path), _) => touched.opens(self.ledger.cycle, path),
            (Counted::Closes, _) => touched.closes(),
            (Counted::Begins { another }, RecordAnswer::Cycle(cycle)) => {
                if *another {
                    touched.another_part();
                }
                if touched.has_part() {
                    world.counts.judged("no count that falls");
                    let counted = Store::open(self.folder).and_then(|store| store.earlier_abrasions(*cycle));
                    let forgotten = match counted {
                        Ok(counted) => touched.uncounted(Some(*cycle), &counted),
                        Err(error) => Some(error.to_string()),
                    };
                    if let Some(forgotten) = forgotten {
                        world.wrong("no count that falls", forgotten);
                    }
                }
                world.counts.judged("a cycle's number is new");
                if !self.ledger.is_new(*cycle) {
                    world.wrong(
                        "a cycle's number is new",
                        format!("cycle {cycle} begins after one that is not before it"),
                    );
                }
            }
            (Counted::Finds, _) => self.has_film = true,
            (_, RecordAnswer::Concluded(Verdict::Pass)) if self.has_film => {
                // The part is taken out. A failed part stays until a start states that another part is in the cell.
                touched.another_part();
            }
            (_, RecordAnswer::Earlier(earlier)) if touched.has_part() => {
                world.counts.judged("no count that falls");
                if let Some(forgotten) = touched.uncounted(self.ledger.cycle, earlier) {
                    world.wrong("no count that falls", forgotten);
                }
            }
            _ => {}
        }
        if matches!(answer, RecordAnswer::Cycle(_)) {
            self.has_film = false;
        }
    }
}

/// The part of a command that is relevant for the counts.
enum Counted {
    Opens(ContactPath),
    Closes,
    Begins {
        another: bool,
    },
    /// The finding of an inspection: from then on, the cycle has a film.
    Finds,
    Nothing,
}

impl Counted {
    fn from_command(command: &RecordCommand) -> Self {
        match command {
            RecordCommand::OpenContact { path, .. } => Counted::Opens(path.clone()),
            RecordCommand::CloseIntent { .. } => Counted::Closes,
            RecordCommand::Begin(start) => {
                Counted::Begins { another: start.file_texts.iter().any(|(name, _)| name == ANOTHER_PART_TEXT) }
            }
            RecordCommand::Note(Note::Finding(finding)) if finding.kind == Kind::Inspect => Counted::Finds,
            _ => Counted::Nothing,
        }
    }
}

impl Port<RecordCommand> for Record<'_> {
    fn perform(&mut self, command: RecordCommand) -> Result<RecordAnswer, RecordError> {
        let counted = Counted::from_command(&command);
        let executed = {
            let mut world = self.world.lock();
            backs_up(&mut world, self.folder, self.ledger);
            world.executed_on_path()
        };
        self.ledger.touched.executed(executed);
        let reported = CommandSummary::from_command(&command);
        let permit = match &command {
            RecordCommand::OpenContact { permitted, .. } => Some(Permit::Begins(*permitted)),
            RecordCommand::Permit(permitted) => Some(Permit::Continues(*permitted)),
            RecordCommand::CloseIntent { .. } => Some(Permit::Ends),
            _ => None,
        };
        let command = match command {
            RecordCommand::Note(note) => RecordCommand::Note(shrunk(note)),
            RecordCommand::OpenContact { motion, path, permitted } if self.sabotage == Some(Sabotage::NoGrids) => {
                RecordCommand::OpenContact { motion, path: ContactPath { grids: vec![], ..path }, permitted }
            }
            command => command,
        };
        if !matches!(command, RecordCommand::Filled | RecordCommand::DiscWorn | RecordCommand::BetweenCycles) {
            self.world.lock().writes();
        }
        let is_skipped = self.sabotage.is_some_and(|sabotage| sabotage.skips(&command));
        disk::begin_simulated_power_failures();
        if let RecordCommand::Conclude { verdict, .. } = &command {
            self.ledger.decided(*verdict);
            disk::simulate_power_failure_now();
        }
        self.judge_standing(&command);
        let told_of_contact = of_contact(&command);
        let skipped = match &command {
            RecordCommand::Conclude { verdict, .. } => RecordAnswer::Concluded(*verdict),
            _ => RecordAnswer::Done,
        };
        let answer = if is_skipped { Ok(skipped) } else { self.store.perform(command) };
        self.judge_imagined_cuts();
        let answer = answer?;
        self.judge_counts(&counted, &answer);
        if let Some(command) = told_of_contact {
            let mut world = self.world.lock();
            let executed = world.executed_on_path();
            if let Some(problem) = self.wear.acknowledged(&command, &answer, (executed, world.places_lie)) {
                world.wrong("contact on the record", problem);
            }
            world.counts.judged("contact on the record");
        }
        self.ledger.acknowledged(reported, &answer);
        if let Some(permit) = permit {
            self.world.lock().permits(permit);
        }
        Ok(answer)
    }
}

/// Returns a copy of a command about contact.
fn of_contact(command: &RecordCommand) -> Option<RecordCommand> {
    use panelprep::cycle::{Event, Report};
    Some(match command {
        RecordCommand::DiscWorn => RecordCommand::DiscWorn,
        RecordCommand::WearDisc(mm2) => RecordCommand::WearDisc(*mm2),
        RecordCommand::MountDisc => RecordCommand::MountDisc,
        RecordCommand::OpenContact { motion, path, permitted } => {
            RecordCommand::OpenContact { motion: *motion, path: path.clone(), permitted: *permitted }
        }
        RecordCommand::Event(event @ Event::Reported(Report::Progress { .. })) => RecordCommand::Event(*event),
        RecordCommand::CloseIntent { motion, outcome, done } => {
            RecordCommand::CloseIntent { motion: *motion, outcome: *outcome, done: *done }
        }
        _ => return None,
    })
}

/// Returns the note with reduced pictures.
pub fn shrunk(note: Note) -> Note {
    match note {
        Note::Picture(name, picture) => Note::Picture(name, small(&picture)),
        Note::Frame(picture, time_s, phase) => Note::Frame(Arc::new(small(&picture)), time_s, phase),
        Note::Figure(figure) => Note::Figure(Figure { picture: small(&figure.picture), ..figure }),
        note => note,
    }
}

/// Keeps single pixels at regular intervals, so that different pictures give different files.
fn small(picture: &ColorPicture) -> ColorPicture {
    let (width, height) = (picture.width.clamp(1, SMALL_PX), picture.height.clamp(1, SMALL_PX));
    let mut small = ColorPicture::uniform(width, height, [0; 3]);
    for (index, pixel) in small.rgb.iter_mut().enumerate() {
        let (u, v) = (index % width * picture.width / width, index / width * picture.height / height);
        *pixel = picture.rgb[v * picture.width + u];
    }
    small
}
