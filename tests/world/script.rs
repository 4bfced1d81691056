//! The faults of a world and their times: an explicit list, drawn from a seed, that can be printed, shortened and run
//! again.
//!
//! A time is counted from the first time that the state machine reaches a state, so that every fault occurs in every
//! state, however long the earlier states took. If an entry is removed, the others are unchanged.

use super::{elsewhere, pairs};
use panelprep::cycle::{self, At};
use panelprep::devices::mock;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// A fault of the script, and the time at which it is injected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The state of the cycle's state machine, see [`PLACES`].
    pub place: String,
    /// The number of the visit to this state, from 1.
    pub visit: u32,
    /// Time after the beginning of this visit, ms.
    pub after_ms: u64,
    /// The fault.
    pub fault: Fault,
}

/// A fault of the next message in one direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Harm {
    /// The message never arrives.
    Lose,
    /// The message arrives twice.
    Twice,
    /// The message arrives after the following one.
    Swap,
    /// One bit of the message is inverted.
    Damage { byte: u32, bit: u8 },
    /// The end of the message is missing.
    Half,
    /// The message arrives late, ms.
    Late(u64),
}

/// A camera's fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum CameraHarm {
    /// The camera delivers no picture.
    Lost,
    /// The camera returns its previous picture again.
    Frozen,
    /// The camera's pictures have another size.
    WrongSize,
    /// The camera's pictures are black.
    Dark,
    /// The camera reports that it is too hot.
    Hot,
    /// The camera answers later by this time, ms.
    Late(u64),
}

/// A request of a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Press {
    Reset,
    Start,
    Hold,
    Unhold,
    UnholdDried,
    Accept,
    Stop,
    Abort,
    Clear,
    NewDisc,
    Leave,
    Unprepared,
    Everything,
}

/// An end of the process at one of its writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Power {
    /// The process is killed at the nth write to its disk from now on.
    Kill,
    /// The computer has a power failure at this write: data that were not flushed are lost, torn or kept, depending on
    /// the seed.
    Cut { seed: u64 },
}

/// A fault of the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum DiskHarm {
    /// The disk accepts no data for some time.
    Full,
    /// The disk reports an error.
    Io,
}

/// A fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Fault {
    /// Damages the next message to or from the controller, on the channel of commands (0) or states (1).
    Bytes { to_robot: bool, channel: usize, harm: Harm },
    /// The robot or the client closes a connection; with `loses`, the bytes in transit are lost.
    Cut { channel: usize, by_robot: bool, loses: bool },
    /// No message of the client arrives for this time, ms.
    Deaf(u64),
    /// The thread of the connection is stalled for this time, ms.
    Stall(u64),
    /// A fault in the form of `panelprep mock-robot --fault`, without its time.
    Controller(String),
    /// In this number of messages the controller sends a wrong value: attribute and value.
    Lie { channel: usize, name: String, value: String, times: u32 },
    /// A request of another client reaches the controller.
    Foreign { operation: i32, number: i32 },
    /// A person works with another program on the controller for this time, ms.
    ForeignProgram(u64),
    /// An input keeps its value for this time.
    Feedback { input: u16, on: bool, for_ms: u64 },
    /// A person sends a request.
    Press(Press),
    /// A fault of the next pictures of the flange camera or the 3D camera, for this time.
    Camera { flange: bool, harm: CameraHarm, for_ms: u64 },
    /// The wall clock jumps by this number of seconds.
    Clock(i64),
    /// An end of the process at the nth write to the disk from now on.
    Power { writing: u32, power: Power },
    /// A fault of this number of writes to the disk, beginning at the nth write from now on.
    Disk { writing: u32, harm: DiskHarm, times: u32 },
    /// Each write takes longer by `late_ms`, for the time `for_ms`; the connection continues meanwhile.
    SlowDisk { late_ms: u64, for_ms: u64 },
    /// This number of messages with commands of an ended epoch arrive again.
    Replay(u32),
    /// This number of the client's aborts arrive as heartbeats: the controller answers them and continues.
    Unheeded(u32),
    /// The people who run the cell request nothing for this time, ms.
    Away(u64),
    /// A person jogs the arm after it has become stationary, in T1 for this time. The target is at this percentage of
    /// the way from this height above the panel to the park pose.
    Jog { percent: u8, height_mm: u8, for_ms: u64 },
    /// A second screen sends a decision, although it shows the state machine some steps ago.
    Stale { press: Press, back: u32 },
    /// The store is backed up.
    Backup,
    /// The process ends, and the last backup of the store replaces the present store.
    Restore,
}

impl Fault {
    /// Returns the name of the fault's kind, for counts.
    pub fn kind(&self) -> &'static str {
        match self {
            Fault::Bytes { harm, .. } => match harm {
                Harm::Lose => "bytes lost",
                Harm::Twice => "bytes twice",
                Harm::Swap => "bytes reordered",
                Harm::Damage { .. } => "bytes damaged",
                Harm::Half => "bytes cut short",
                Harm::Late(_) => "bytes late",
            },
            Fault::Cut { .. } => "connection cut",
            Fault::Deaf(_) => "way blocked",
            Fault::Stall(_) => "link stands still",
            Fault::Controller(text) if text.starts_with("override") => "override",
            Fault::Controller(text) if text.starts_with("measured") => "measured pose",
            Fault::Controller(_) => "controller",
            Fault::Lie { .. } => "meaning",
            Fault::Foreign { .. } => "other client",
            Fault::ForeignProgram(_) => "foreign program",
            Fault::Feedback { .. } => "feedback",
            Fault::Press(_) => "person",
            Fault::Camera { .. } => "camera",
            Fault::Clock(_) => "clock",
            Fault::Power { power: Power::Kill, .. } => "kill",
            Fault::Power { power: Power::Cut { .. }, .. } => "power cut",
            Fault::Disk { harm: DiskHarm::Full, .. } => "disk full",
            Fault::Disk { harm: DiskHarm::Io, .. } => "disk error",
            Fault::SlowDisk { .. } => "disk slow",
            Fault::Replay(_) => "bytes replayed",
            Fault::Unheeded(_) => "abort not obeyed",
            Fault::Away(_) => "no person there",
            Fault::Jog { .. } => "jog",
            Fault::Stale { .. } => "stale screen",
            Fault::Backup => "backup",
            Fault::Restore => "restore",
        }
    }

    /// Returns the duration of the fault, ms; zero if it has none.
    pub fn lasts_ms(&self) -> u64 {
        match self {
            Fault::Deaf(ms) | Fault::Stall(ms) | Fault::ForeignProgram(ms) | Fault::Away(ms) => *ms,
            Fault::Feedback { for_ms, .. } | Fault::Camera { for_ms, .. } => *for_ms,
            Fault::SlowDisk { late_ms, for_ms } => late_ms + for_ms,
            Fault::Jog { for_ms, .. } => *for_ms,
            Fault::Bytes { harm: Harm::Late(ms), .. } => *ms,
            // The drawn time, plus the time in which a controller restarts.
            Fault::Controller(_) => 6_000,
            _ => 0,
        }
    }
}

/// The states of the cycle's state machine; instead of the state Execute, the names of its phases.
pub const PLACES: [&str; 23] = [
    "stopped",
    "resetting",
    "idle",
    "starting",
    "locate",
    "refine",
    "dry",
    "wet",
    "inspect",
    "plan",
    "verify",
    "abrade",
    "retract",
    "rinse",
    "holding",
    "held",
    "unholding",
    "completing",
    "complete",
    "stopping",
    "aborting",
    "aborted",
    "clearing",
];

/// The states in which water runs, the arm moves or the tool touches the panel: most faults can have effects in these
/// states, so they are drawn more often.
const OFTEN: [&str; 5] = ["wet", "verify", "abrade", "retract", "rinse"];

/// Returns the name of a state; for the state Execute, the name of its phase.
pub fn place(at: At) -> &'static str {
    match at {
        At::Execute(phase) => phase.keyword(),
        at => at.keyword(),
    }
}

/// The parameters for drawing a script: the kinds of faults, and their number.
#[derive(Debug, Clone, Copy)]
pub struct Odds {
    /// Maximum number of entries.
    pub most: usize,
    /// Whether some entries are faults of the disk.
    pub disk: bool,
}

/// Returns the script of a seed.
pub fn draw(seed: u64, odds: Odds) -> Vec<Entry> {
    let mut draw = Pcg64::seed_from_u64(seed);
    let count = draw.random_range(1..=odds.most);
    let mut script: Vec<Entry> = (0..count).map(|_| entry(&mut draw, odds)).collect();
    // These entries are drawn separately, so that the entries before them do not change.
    let mut draw = Pcg64::seed_from_u64(seed ^ 0xf0c5);
    if draw.random_bool(0.3) {
        script.extend(aimed(&mut draw, odds));
    }
    // Likewise.
    script.extend(pairs::draw(seed, odds));
    script.extend(elsewhere::draw(seed, odds));
    script
}

/// Draws combinations that are rare by chance: long silence in contact, messages of ended epochs, a slow disk while
/// waypoints are permitted, and a power failure of controller and computer.
fn aimed(draw: &mut Pcg64, odds: Odds) -> Vec<Entry> {
    let at = |draw: &mut Pcg64, places: &[&str], fault| {
        let (place, visit) = (places.choose(draw).copied().unwrap_or("abrade"), draw.random_range(1..3));
        Entry { place: place.to_owned(), visit, after_ms: draw.random_range(0..2_500), fault }
    };
    match draw.random_range(0..if odds.disk { 8 } else { 5 }) {
        0 | 1 => {
            let ms = draw.random_range(600..5_000);
            let fault = if draw.random_bool(0.7) { Fault::Deaf(ms) } else { Fault::Stall(ms) };
            vec![at(draw, &["abrade", "abrade", "verify", "retract"], fault)]
        }
        2..5 => {
            let fault = Fault::Replay(draw.random_range(1..8));
            vec![at(draw, &["refine", "verify", "abrade", "retract", "rinse", "held", "stopped"], fault)]
        }
        5 | 6 => {
            let late_ms = [50, 400, 2_500, 6_000][draw.random_range(0..4)];
            let fault = Fault::SlowDisk { late_ms, for_ms: draw.random_range(500..4_000) };
            vec![at(draw, &["abrade", "abrade", "wet", "plan", "refine"], fault)]
        }
        _ => {
            let reboot = Fault::Controller("reboot/1000ms".to_owned());
            let cut = Power::Cut { seed: draw.random_range(0..1 << 32) };
            let power = Fault::Power { writing: draw.random_range(0..3), power: cut };
            let (place, visit, after_ms) = (*OFTEN.choose(draw).unwrap_or(&"wet"), 1, draw.random_range(0..2_000));
            let entry = |fault| Entry { place: place.to_owned(), visit, after_ms, fault };
            vec![entry(reboot), entry(power)]
        }
    }
}

fn entry(draw: &mut Pcg64, odds: Odds) -> Entry {
    let places: &[&str] = if draw.random_bool(0.4) { &OFTEN } else { &PLACES };
    let place = places.choose(draw).copied().unwrap_or("stopped").to_owned();
    let visit = if draw.random_bool(0.85) { 1 } else { draw.random_range(2..4) };
    let after_ms = match draw.random_range(0..4) {
        0 => 0,
        1 => draw.random_range(0..200),
        _ => draw.random_range(0..3_000),
    };
    Entry { place, visit, after_ms, fault: fault(draw, odds) }
}

fn lasts_ms(draw: &mut Pcg64) -> u64 {
    match draw.random_range(0..3) {
        0 => draw.random_range(1..300),
        1 => draw.random_range(300..800),
        _ => draw.random_range(800..4_000),
    }
}

fn fault(draw: &mut Pcg64, odds: Odds) -> Fault {
    let kinds = if odds.disk { 27 } else { 20 };
    match draw.random_range(0..kinds) {
        0..4 => bytes(draw),
        4 => Fault::Cut {
            channel: draw.random_range(0..2),
            by_robot: draw.random_bool(0.5),
            loses: draw.random_bool(0.5),
        },
        5 => Fault::Deaf(lasts_ms(draw)),
        6 => Fault::Stall(lasts_ms(draw)),
        7..10 => controller(draw),
        10..12 => lie(draw),
        12 => Fault::Foreign {
            operation: draw.random_range(9..13),
            number: [i32::MIN, -1, 0, 1, 1_000_000, i32::MAX - 1, i32::MAX][draw.random_range(0..7)],
        },
        13 => Fault::ForeignProgram(draw.random_range(500..4_000)),
        14 => Fault::Feedback {
            input: draw.random_range(1..6),
            on: draw.random_bool(0.5),
            for_ms: draw.random_range(100..9_000),
        },
        15..18 => Fault::Press(press(draw)),
        18 => Fault::Camera { flange: draw.random_bool(0.5), harm: camera(draw), for_ms: lasts_ms(draw) },
        19 => Fault::Clock(
            [-3_000_000_000, -1_800_000_000, -86_400, -1, 1, 3_600, 315_360_000][draw.random_range(0..7)],
        ),
        20..22 => Fault::Power { writing: draw.random_range(0..60), power: Power::Kill },
        22..25 => Fault::Power {
            writing: draw.random_range(0..60),
            power: Power::Cut { seed: draw.random_range(0..1 << 32) },
        },
        _ => Fault::Disk {
            writing: draw.random_range(0..30),
            harm: if draw.random_bool(0.5) { DiskHarm::Full } else { DiskHarm::Io },
            times: [1, 2, 10, 30][draw.random_range(0..4)],
        },
    }
}

fn bytes(draw: &mut Pcg64) -> Fault {
    let harm = match draw.random_range(0..6) {
        0 => Harm::Lose,
        1 => Harm::Twice,
        2 => Harm::Swap,
        3 => Harm::Damage { byte: draw.random_range(0..600), bit: draw.random_range(0..7) },
        4 => Harm::Half,
        _ => Harm::Late(lasts_ms(draw)),
    };
    Fault::Bytes { to_robot: draw.random_bool(0.5), channel: draw.random_range(0..2), harm }
}

fn controller(draw: &mut Pcg64) -> Fault {
    let ms = lasts_ms(draw);
    let side = ["command", "state", "both"][draw.random_range(0..3)];
    let names = [
        format!("cut={side}"),
        format!("unplug/{ms}ms"),
        format!("mute/{ms}ms"),
        format!("no-acks/{ms}ms"),
        format!("stall/{ms}ms"),
        format!("garbage={side}"),
        "skip-state".to_owned(),
        "lose-base".to_owned(),
        "lose-tool".to_owned(),
        "wrong-base".to_owned(),
        "refuse=8".to_owned(),
        format!("slow={}/{ms}ms", draw.random_range(1..100)),
        format!("e-stop/{ms}ms"),
        format!("guard/{ms}ms"),
        format!("drives/{ms}ms"),
        format!("mode={}/{ms}ms", ["T1", "T2", "AUT"][draw.random_range(0..3)]),
        format!("deselect/{ms}ms"),
        format!("reboot/{ms}ms"),
    ];
    Fault::Controller(names[draw.random_range(0..names.len())].clone())
}

/// The attributes of the controller's acknowledgements; `STATES` are those of its states.
const ACKS: [&str; 6] = ["Rx", "Done", "Ep", "Err", "ErrId", "Free"];
const STATES: [&str; 14] =
    ["T", "Seq", "Re", "Boot", "Sum", "Ep", "Done", "Under", "Mode", "Flags", "In", "Out", "X", "A1"];
/// The wrong values that these attributes may get.
const VALUES: [&str; 14] = [
    "0",
    "1",
    "-1",
    "2",
    "255",
    "256",
    "65535",
    "-2147483648",
    "2147483647",
    "2147483646",
    "1000000",
    "4294967295",
    "1e9",
    "nan",
];

fn lie(draw: &mut Pcg64) -> Fault {
    let channel = usize::from(draw.random_bool(0.8));
    let names: &[&str] = if channel == 0 { &ACKS } else { &STATES };
    Fault::Lie {
        channel,
        name: names[draw.random_range(0..names.len())].to_owned(),
        value: VALUES[draw.random_range(0..VALUES.len())].to_owned(),
        times: [1, 1, 2, 20][draw.random_range(0..4)],
    }
}

fn press(draw: &mut Pcg64) -> Press {
    use Press as P;
    let all = [
        P::Reset,
        P::Start,
        P::Hold,
        P::Hold,
        P::Unhold,
        P::UnholdDried,
        P::Accept,
        P::Stop,
        P::Stop,
        P::Abort,
        P::Clear,
        P::NewDisc,
        P::Leave,
        P::Unprepared,
        P::Everything,
    ];
    all[draw.random_range(0..all.len())]
}

fn camera(draw: &mut Pcg64) -> CameraHarm {
    use CameraHarm as C;
    [C::Lost, C::Frozen, C::WrongSize, C::Dark, C::Hot, C::Late(draw.random_range(100..5_000))]
        [draw.random_range(0..6)]
}

/// Parses a fault of the controller.
///
/// # Errors
/// If the text does not describe a fault.
pub fn controller_fault(text: &str) -> Result<mock::Fault, String> {
    let spec: mock::FaultSpec = format!("{text}@0ms").parse().map_err(|error| format!("{error}"))?;
    spec.planned.first().map(|planned| planned.fault).ok_or_else(|| format!("{text} is no fault"))
}

/// Returns the requests to the state machine that a press causes, in order.
pub fn requests(press: Press) -> Vec<cycle::Request> {
    use cycle::Request as Q;
    match press {
        Press::Reset => vec![Q::Reset],
        Press::Hold => vec![Q::Hold],
        Press::Unhold => vec![Q::Unhold { dried: false }],
        Press::UnholdDried => vec![Q::Unhold { dried: true }],
        Press::Accept => vec![Q::Accept],
        Press::Stop => vec![Q::Stop],
        Press::Abort => vec![Q::Abort],
        Press::Clear => vec![Q::Clear],
        Press::Everything => vec![
            Q::Accept,
            Q::Unhold { dried: false },
            Q::Clear,
            Q::Reset,
            Q::Start { max_passes: 255, max_moves: 255, dries: false },
            Q::AirRun { max_moves: 0 },
            Q::Hold,
            Q::Unhold { dried: true },
            Q::Stop,
            Q::Clear,
        ],
        Press::Start | Press::NewDisc | Press::Leave | Press::Unprepared => vec![],
    }
}

/// Returns the script as one line.
pub fn print(script: &[Entry]) -> String {
    serde_json::to_string(script).expect("plain data")
}

/// Parses a printed script.
///
/// # Errors
/// If the text is not a script.
pub fn parse(text: &str) -> Result<Vec<Entry>, String> {
    serde_json::from_str(text).map_err(|error| format!("this is no script: {error}"))
}
