//! Injected faults and their times, and the parser for their text form.

#[cfg(test)]
mod tests;

use super::super::options::Mode;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::str::FromStr;

const SETTINGS: [&str; 4] = ["seed", "delay", "fragment", "random"];
const FAULTS: [&str; 20] = [
    "cut",
    "unplug",
    "mute",
    "no-acks",
    "stall",
    "garbage",
    "skip-state",
    "lose-base",
    "lose-tool",
    "wrong-base",
    "refuse",
    "slow",
    "override",
    "measured",
    "e-stop",
    "guard",
    "drives",
    "mode",
    "deselect",
    "reboot",
];
const MAX_TIME_MS: f64 = 86_400_000.0;
const MAX_RANDOM_FAULTS: usize = 1_000;

/// The connections that a fault affects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConnectionSide {
    /// CELLCMD.
    Command,
    /// CELLSTAT.
    State,
    /// Both.
    Both,
}

/// A fault that can be injected. `for_ms` is its duration; `None` if it does not end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// `cut`: the controller closes one or both connections.
    Cut(ConnectionSide),
    /// `unplug`: the cable is unplugged. Bytes are held back in both directions, and neither side is notified.
    Unplug {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `mute`: the controller receives messages and sends none.
    Mute {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `no-acks`: commands are executed but not acknowledged.
    NoAcks {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `stall`: the submit interpreter stalls; the arm executes the commands that were already received.
    Stall {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `garbage`: the controller sends bytes that are not an XML document.
    Garbage(ConnectionSide),
    /// `skip-state`: the sequence number of the next state is skipped.
    SkipState,
    /// `lose-base`: the next `set_base` is acknowledged but has no effect.
    LoseBase,
    /// `lose-tool`: the next `set_tcp` is acknowledged but has no effect.
    LoseTool,
    /// `wrong-base`: the next `set_base` is set with an error of 1 mm in X.
    WrongBase,
    /// `refuse`: the next command is refused with this error number (`Err`), 1 to 12.
    Refuse(u8),
    /// `override`: a person sets the override to this value, 1 to 100 %; at the end of the fault it is 100 % again.
    Override {
        /// Override, %.
        percent: u8,
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `slow`: the arm moves at this percentage of the commanded speed, 1 to 100 %, although the reported override does
    /// not change.
    Slow {
        /// Percentage of the commanded speed.
        percent: u8,
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `measured`: the reported pose of the tool has an error of 1 to 200 mm along Z of the active base.
    Measured {
        /// Error of the measured pose, mm.
        deviation_mm: u8,
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `e-stop`: the emergency stop is pressed; at the end of the fault it is released, and the drives are switched on
    /// again.
    EStop {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `guard`: the guard is opened; at the end of the fault it is closed.
    Guard {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `drives`: the drives are switched off; at the end of the fault they are switched on.
    Drives {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `mode`: the mode switch is set to this mode; at the end of the fault it is set to EXT.
    Mode {
        /// The new mode.
        to: Mode,
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `deselect`: the robot program is deselected; at the end of the fault it is selected again.
    Deselect {
        /// Duration of the fault, ms; `None` if the fault does not end.
        for_ms: Option<u64>,
    },
    /// `reboot`: the controller restarts, and listens again after the duration; the default is 3 s.
    Reboot {
        /// Time until the controller listens again, ms; `None` for the default.
        for_ms: Option<u64>,
    },
}

/// The time or event at which a fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultTime {
    /// The fault begins at this time since the controller's start, ms.
    AtMs(u64),
    /// The fault begins when this number of commands has arrived.
    AtCommand(u64),
}

/// A fault and the time at which it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedFault {
    /// Start of the fault.
    pub when: FaultTime,
    /// The fault.
    pub fault: Fault,
}

/// All faults that are planned for one mock controller.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FaultSpec {
    /// The seed of the random delays, fragments and faults; the same seed gives the same sequence.
    pub seed: u64,
    /// The minimum and maximum delay of bytes in both directions, ms.
    pub delay_ms: Option<(u64, u64)>,
    /// Whether the output is sent in fragments that do not match the boundaries of documents.
    pub fragment: bool,
    /// The faults, each with its time.
    pub planned: Vec<PlannedFault>,
}

/// The reason why a text is not a valid fault specification. Each error contains the item and the valid syntax.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FaultSpecError {
    /// There is no item between two commas.
    #[error("an item is empty; items are separated by single commas")]
    Empty,
    /// The name is not a fault or setting.
    #[error("\"{item}\": {name} is not a fault or setting{}; valid: {}", nearest(name), known_faults())]
    Unknown {
        /// The complete item of the specification.
        item: String,
        /// Its name.
        name: String,
    },
    /// A value is missing or is not valid.
    #[error("\"{item}\": the value is {found}; valid: {allowed}")]
    Value {
        /// The whole item.
        item: String,
        /// The text found.
        found: String,
        /// The valid values.
        allowed: &'static str,
    },
    /// An item has a value, duration or time that is not valid for its name.
    #[error("\"{item}\": {name} does not accept a {what}")]
    Needless {
        /// The whole item.
        item: String,
        /// Its name.
        name: String,
        /// The part that is not valid: "value", "duration" or "time".
        what: &'static str,
    },
    /// A fault has no time.
    #[error(
        "\"{item}\": the time of the fault is missing; add @TIME (@3s, @250ms) or @#N, the arrival of the Nth command"
    )]
    NoTime {
        /// The whole item.
        item: String,
    },
    /// A text is not a valid time.
    #[error("\"{item}\": {found} is not a time; write 3s, 1.5s or 250ms, at most 1 day{}", command(*at))]
    Time {
        /// The whole item.
        item: String,
        /// The text found.
        found: String,
        /// Whether the number of a command is also valid at this point.
        at: bool,
    },
}

fn command(at: bool) -> &'static str {
    if at { ", or #40 for the arrival of the 40th command" } else { "" }
}

fn known_faults() -> String {
    SETTINGS.iter().chain(&FAULTS).copied().collect::<Vec<_>>().join(", ")
}

fn nearest(name: &str) -> String {
    let all = SETTINGS.iter().chain(&FAULTS);
    let near = all.map(|known| (strsim::damerau_levenshtein(name, known), known)).min();
    near.filter(|(far, _)| *far <= 3).map_or_else(String::new, |(_, known)| format!(" (did you mean {known}?)"))
}

impl FaultSpec {
    /// The syntax of a fault specification, for help texts.
    pub const HELP: &'static str = "\
Items separated by commas. A fault is NAME[=VALUE][/DURATION]@WHEN; WHEN is a time since the start (3s, 250ms) or #N,
the arrival of the Nth command; without a duration, the fault remains.
  cut[=command|state|both]@WHEN   close the connections      garbage[=command|state|both]@WHEN   send no XML
  unplug[/D]@WHEN  cable out      mute[/D]@WHEN  send nothing      no-acks[/D]@WHEN  acknowledge nothing
  stall[/D]@WHEN   stall the submit interpreter   skip-state@WHEN  skip a state number
  lose-base@WHEN, lose-tool@WHEN, wrong-base@WHEN    the next set_base or set_tcp has no effect, or is 1 mm off
  refuse=1..12@WHEN   refuse the next command with that Err (the controller's own programs report Err 8 in its place)
  slow=1..100[/D]@WHEN   percent of the speed, not reported   override=1..100[/D]@WHEN   a person sets the override
  measured=1..200[/D]@WHEN   the tool's pose is reported this many mm off along Z
  e-stop[/D]@WHEN, guard[/D]@WHEN, drives[/D]@WHEN, mode=T1|T2|AUT|EXT[/D]@WHEN, deselect[/D]@WHEN, reboot[/D]@WHEN
Settings: seed=N   delay=20ms or delay=2ms..25ms, each way   fragment   random=N/D: N random faults within the duration D
Example: seed=7,delay=5ms..15ms,fragment,unplug/2s@10s,refuse=8@#40";
}

impl FromStr for FaultSpec {
    type Err = FaultSpecError;

    fn from_str(text: &str) -> Result<Self, FaultSpecError> {
        let mut spec = FaultSpec::default();
        let mut random = None;
        for text in text.split(',') {
            let item = Item::parse(text.trim())?;
            match item.name {
                "seed" => {
                    spec.seed =
                        item.check_no_time()?.value("a whole number, such as seed=7", |text| text.parse().ok())?;
                }
                "delay" => spec.delay_ms = Some(item.check_no_time()?.delay()?),
                "fragment" => {
                    item.check_no_time()?.check_no_value()?;
                    spec.fragment = true;
                }
                "random" => random = Some(item.random()?),
                _ => spec.planned.push(item.to_planned_fault()?),
            }
        }
        if let Some((count, within_ms)) = random {
            let mut draw = Pcg64::seed_from_u64(spec.seed);
            spec.planned.extend((0..count).map(|_| random_fault(&mut draw, within_ms)));
        }
        Ok(spec)
    }
}

/// One item of a specification, split into its parts.
struct Item<'a> {
    text: &'a str,
    name: &'a str,
    value: Option<&'a str>,
    duration: Option<&'a str>,
    when: Option<&'a str>,
}

impl<'a> Item<'a> {
    fn parse(whole: &'a str) -> Result<Self, FaultSpecError> {
        if whole.is_empty() {
            return Err(FaultSpecError::Empty);
        }
        let cut = |text: &'a str, at: char| match text.split_once(at) {
            Some((before, behind)) => (before, Some(behind)),
            None => (text, None),
        };
        let (what, when) = cut(whole, '@');
        let (what, duration) = cut(what, '/');
        let (name, value) = cut(what, '=');
        if !SETTINGS.iter().chain(&FAULTS).any(|known| *known == name) {
            return Err(FaultSpecError::Unknown { item: whole.to_owned(), name: name.to_owned() });
        }
        Ok(Item { text: whole, name, value, duration, when })
    }

    fn needless_error(&self, what: &'static str) -> FaultSpecError {
        FaultSpecError::Needless { item: self.text.to_owned(), name: self.name.to_owned(), what }
    }

    /// Checks that the item has neither duration nor time, because it is a setting.
    fn check_no_time(self) -> Result<Self, FaultSpecError> {
        match (self.duration, self.when) {
            (Some(_), _) => Err(self.needless_error("duration")),
            (_, Some(_)) => Err(self.needless_error("time")),
            _ => Ok(self),
        }
    }

    fn check_no_value(&self) -> Result<(), FaultSpecError> {
        if self.value.is_some() { Err(self.needless_error("value")) } else { Ok(()) }
    }

    fn value<T>(&self, allowed: &'static str, read: impl Fn(&str) -> Option<T>) -> Result<T, FaultSpecError> {
        self.value.and_then(read).ok_or_else(|| FaultSpecError::Value {
            item: self.text.to_owned(),
            found: self.value.map_or_else(|| "missing".to_owned(), |value| format!("\"{value}\"")),
            allowed,
        })
    }

    fn time(&self, text: &str, at: bool) -> Result<u64, FaultSpecError> {
        milliseconds(text).ok_or_else(|| FaultSpecError::Time {
            item: self.text.to_owned(),
            found: format!("\"{text}\""),
            at,
        })
    }

    fn delay(&self) -> Result<(u64, u64), FaultSpecError> {
        const ALLOWED_FAULTS: &str = "a time or a range of times, such as 20ms or 2ms..25ms, at most 10s";
        self.value(ALLOWED_FAULTS, |text| {
            let (low, high) = text.split_once("..").unwrap_or((text, text));
            let (low, high) = (milliseconds(low)?, milliseconds(high)?);
            (low <= high && high <= 10_000).then_some((low, high))
        })
    }

    fn random(&self) -> Result<(usize, u64), FaultSpecError> {
        if self.when.is_some() {
            return Err(self.needless_error("time"));
        }
        let within_ms = self.duration.map_or(Ok(60_000), |text| self.time(text, false))?;
        let count = self.value("a count of 1 to 1000, such as random=5/60s", |text| {
            text.parse().ok().filter(|count| (1..=MAX_RANDOM_FAULTS).contains(count))
        })?;
        Ok((count, within_ms.max(1)))
    }

    fn side(&self) -> Result<ConnectionSide, FaultSpecError> {
        let side = |text: &str| match text {
            "command" => Some(ConnectionSide::Command),
            "state" => Some(ConnectionSide::State),
            "both" => Some(ConnectionSide::Both),
            _ => None,
        };
        if self.value.is_none() { Ok(ConnectionSide::Both) } else { self.value("command, state or both", side) }
    }

    fn to_planned_fault(&self) -> Result<PlannedFault, FaultSpecError> {
        let when = match self.when {
            None => return Err(FaultSpecError::NoTime { item: self.text.to_owned() }),
            Some(text) => match text.strip_prefix('#').map(str::parse) {
                Some(Ok(number)) => FaultTime::AtCommand(number),
                _ => FaultTime::AtMs(self.time(text, true)?),
            },
        };
        let for_ms = self.duration.map(|text| self.time(text, false)).transpose()?;
        let lasts = matches!(
            self.name,
            "unplug"
                | "mute"
                | "no-acks"
                | "stall"
                | "slow"
                | "override"
                | "measured"
                | "e-stop"
                | "guard"
                | "drives"
                | "mode"
                | "deselect"
                | "reboot"
        );
        if for_ms.is_some() && !lasts {
            return Err(self.needless_error("duration"));
        }
        if !matches!(self.name, "cut" | "garbage" | "refuse" | "slow" | "override" | "measured" | "mode") {
            self.check_no_value()?;
        }
        let number =
            |low: u8, high: u8| move |text: &str| text.parse().ok().filter(|number| (low..=high).contains(number));
        let fault = match self.name {
            "cut" => Fault::Cut(self.side()?),
            "garbage" => Fault::Garbage(self.side()?),
            "unplug" => Fault::Unplug { for_ms },
            "mute" => Fault::Mute { for_ms },
            "no-acks" => Fault::NoAcks { for_ms },
            "stall" => Fault::Stall { for_ms },
            "skip-state" => Fault::SkipState,
            "lose-base" => Fault::LoseBase,
            "lose-tool" => Fault::LoseTool,
            "wrong-base" => Fault::WrongBase,
            "refuse" => Fault::Refuse(self.value("an Err of 1 to 12", number(1, 12))?),
            "slow" => Fault::Slow { percent: self.value("1 to 100 percent", number(1, 100))?, for_ms },
            "override" => Fault::Override { percent: self.value("1 to 100 percent", number(1, 100))?, for_ms },
            "measured" => Fault::Measured { deviation_mm: self.value("1 to 200 mm", number(1, 200))?, for_ms },
            "e-stop" => Fault::EStop { for_ms },
            "guard" => Fault::Guard { for_ms },
            "drives" => Fault::Drives { for_ms },
            "mode" => Fault::Mode { to: self.value("T1, T2, AUT or EXT", parse_mode)?, for_ms },
            "deselect" => Fault::Deselect { for_ms },
            _ => Fault::Reboot { for_ms },
        };
        Ok(PlannedFault { when, fault })
    }
}

fn parse_mode(text: &str) -> Option<Mode> {
    match text {
        "T1" => Some(Mode::T1),
        "T2" => Some(Mode::T2),
        "AUT" => Some(Mode::Aut),
        "EXT" => Some(Mode::Ext),
        _ => None,
    }
}

fn milliseconds(text: &str) -> Option<u64> {
    let (number, unit_ms) = match (text.strip_suffix("ms"), text.strip_suffix('s')) {
        (Some(number), _) => (number, 1.0),
        (None, Some(number)) => (number, 1000.0),
        (None, None) => return None,
    };
    let plain = number.starts_with(|first: char| first.is_ascii_digit())
        && number.chars().all(|character| character.is_ascii_digit() || character == '.');
    let ms = number.parse::<f64>().ok().filter(|_| plain)? * unit_ms;
    (ms <= MAX_TIME_MS).then_some(ms.round() as u64)
}

/// Returns a random fault of limited duration that begins within this time, ms.
pub(super) fn random_fault(draw: &mut Pcg64, within_ms: u64) -> PlannedFault {
    let for_ms = Some(draw.random_range(100..3_000));
    let side = [ConnectionSide::Command, ConnectionSide::State, ConnectionSide::Both][draw.random_range(0..3)];
    let faults = [
        Fault::Cut(side),
        Fault::Garbage(side),
        Fault::Unplug { for_ms },
        Fault::Mute { for_ms },
        Fault::NoAcks { for_ms },
        Fault::Stall { for_ms },
        Fault::SkipState,
        Fault::LoseBase,
        Fault::LoseTool,
        Fault::WrongBase,
        Fault::Refuse(draw.random_range(1..=12)),
        Fault::Slow { percent: draw.random_range(5..100), for_ms },
        Fault::Override { percent: draw.random_range(5..100), for_ms },
        Fault::EStop { for_ms },
        Fault::Guard { for_ms },
        Fault::Drives { for_ms },
        Fault::Mode { to: Mode::T1, for_ms },
        Fault::Deselect { for_ms },
        Fault::Reboot { for_ms },
    ];
    let fault = faults[draw.random_range(0..faults.len())];
    PlannedFault { when: FaultTime::AtMs(draw.random_range(0..within_ms)), fault }
}
