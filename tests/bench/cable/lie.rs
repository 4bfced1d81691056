//! Defines a scenario: the fault that is injected, its moment and direction, and an optional request of a person during
//! the fault. Everything is drawn from the bench's seed and the scenario's number, so that a scenario can be repeated.

use super::draw::Draw;
use std::fmt;

/// One direction of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    Commands,
    Acknowledgements,
    Requests,
    States,
}

impl Way {
    pub const ALL: [Way; 4] = [Way::Commands, Way::Acknowledgements, Way::Requests, Way::States];

    /// Returns the channel's number: 0 for the command channel, 1 for the state channel.
    pub fn channel(self) -> usize {
        usize::from(matches!(self, Way::Requests | Way::States))
    }

    pub fn is_to_controller(self) -> bool {
        matches!(self, Way::Commands | Way::Requests)
    }
}

macro_rules! kinds {
    ($($name:ident $words:literal,)*) => {
        /// The kinds of faults.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Kind { $($name,)* }

        impl Kind {
            pub const ALL: &'static [Kind] = &[$(Kind::$name,)*];

            pub fn words(self) -> &'static str {
                match self { $(Kind::$name => $words,)* }
            }
        }
    };
}

kinds! {
    Delay "constant delay",
    Jitter "jitter",
    Stall "stall, then all at once",
    Loss "messages lost",
    Duplicate "messages twice",
    Reorder "neighbours swapped",
    Damage "a damaged byte",
    Cut "cut within a message",
    Fragments "single bytes",
    Garbage "garbage between messages",
    Close "connections closed",
    Refuse "closed and refused",
    BlackHole "black hole",
    OldBytes "old bytes replayed",
    StateField "a state's field",
    AckField "an acknowledgement's field",
    OldState "an old state replayed",
    Frozen "the state frozen",
    Clock "the clock stands",
    AckUnsent "acknowledged, never sent",
    CommandField "a command's field",
    RequestField "a request's field",
}

/// The moment at which the fault is injected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Moment {
    Contact,
    Film,
    Free,
    Start,
    Retract,
    Stop,
    Connect,
    Idle,
    Clear,
}

impl Moment {
    const ALL: [Moment; 9] = [
        Moment::Contact,
        Moment::Film,
        Moment::Free,
        Moment::Start,
        Moment::Retract,
        Moment::Stop,
        Moment::Connect,
        Moment::Idle,
        Moment::Clear,
    ];
}

/// The way in which a value is changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    Set(&'static str),
    Add(f64),
    /// This bit of an integer is inverted.
    Turn(u32),
}

#[derive(Debug, Clone)]
pub struct MessageFault {
    pub kind: Kind,
    pub way: Way,
    /// Whether both channels are affected; without a meaning for some kinds.
    pub both: bool,
    /// Maximum duration of the fault, ms.
    pub lasts_ms: u64,
    /// Maximum number of times that the fault is injected.
    pub times: u64,
    /// The length of a delay or a pause, ms.
    pub amount_ms: u64,
    pub field: &'static str,
    pub change: Change,
    /// Whether the counts in the changed messages continue correctly.
    pub counts_go_on: bool,
    /// Whether only the requests that stop or open an epoch are affected.
    pub of_orders: bool,
}

#[derive(Debug, Clone)]
pub struct Scenario {
    pub number: u64,
    pub lie: MessageFault,
    pub moment: Moment,
    /// The phase in which the stop occurs, if the scenario's moment is a stop.
    pub amid: Moment,
    /// Time from the scenario's moment to the beginning of the fault, ms.
    pub after_ms: u64,
    /// The request that a person sends, and its time after the beginning of the fault, ms.
    pub press: Option<(&'static str, u64)>,
    pub draw: Draw,
}

const STATE_FIELDS: [&str; 20] = [
    "T", "Seq", "Re", "Ep", "Boot", "Sum", "Mode", "Flags", "In", "Out", "Done", "Under", "J/A1", "J/A3", "Tcp/X",
    "Tcp/Z", "Base/X", "Base/A", "Tool/Z", "Ep",
];
const ACK_FIELDS: [&str; 6] = ["Rx", "Done", "Free", "Err", "ErrId", "Ep"];
const COMMAND_FIELDS: [&str; 12] = ["Id", "Ep", "Op", "N1", "N2", "R1", "R2", "P/X", "P/Y", "P/Z", "P/A", "P/C"];
const REQUEST_FIELDS: [&str; 4] = ["Id", "Ep", "Op", "N1"];
const WHOLE: [Change; 11] = [
    Change::Set("0"),
    Change::Set("-1"),
    Change::Set("1"),
    Change::Set("2147483647"),
    Change::Set("2147483648"),
    Change::Set("-2147483648"),
    Change::Set(""),
    Change::Set("1.5"),
    Change::Add(1.0),
    Change::Add(-1.0),
    Change::Add(1_000_000.0),
];
const REAL: [Change; 8] = [
    Change::Set("NaN"),
    Change::Set("inf"),
    Change::Set("100000.000000"),
    Change::Set("-100000.500000"),
    Change::Set("0.000000"),
    Change::Set("1e3"),
    Change::Add(0.3),
    Change::Add(40.0),
];

fn change(field: &str, draw: &mut Draw) -> Change {
    match field {
        "Flags" | "In" | "Out" if !draw.one_in(4) => Change::Turn(draw.below(8) as u32),
        "R1" | "R2" => draw.choose(&REAL),
        _ if field.contains('/') => draw.choose(&REAL),
        _ => draw.choose(&WHOLE),
    }
}

impl Scenario {
    /// Draws a scenario. The first scenarios are all pairs of kinds and moments; everything else is random.
    pub fn drawn(seed: u64, number: u64) -> Self {
        let mut draw = Draw::new(seed, number);
        let kinds = Kind::ALL.len() as u64;
        let kind = Kind::ALL[(number % kinds) as usize];
        let moment = Moment::ALL[((number / kinds + number) % 9) as usize];
        let mut lie = MessageFault::drawn(kind, moment, &mut draw);
        let press = match (moment, draw.below(5) < 2) {
            (Moment::Stop, _) => Some(0),
            // While the service connects, and in idle, there is no motion that could be stopped.
            (Moment::Connect | Moment::Idle | Moment::Clear, _) | (_, false) => None,
            (_, true) => Some(draw.between(20, lie.lasts_ms.clamp(100, 900))),
        };
        let press = press.map(|after_ms| (draw.choose(&["stop", "abort"]), after_ms));
        lie.of_orders = kind == Kind::RequestField && (press.is_some() || moment == Moment::Clear);
        let amid = draw.choose(&[Moment::Contact, Moment::Film, Moment::Free]);
        let after_ms = draw.between(0, if moment == Moment::Retract { 150 } else { 700 });
        Scenario { number, lie, moment, amid, after_ms, press, draw }
    }

    /// Returns whether the panel must be greasy in this scenario, so that it is sanded.
    pub fn needs_contact(&self) -> bool {
        let is_contact = |moment| matches!(moment, Moment::Contact | Moment::Retract);
        is_contact(self.moment) || (self.moment == Moment::Stop && is_contact(self.amid))
    }
}

impl MessageFault {
    fn drawn(kind: Kind, moment: Moment, draw: &mut Draw) -> Self {
        let has_commands = matches!(moment, Moment::Contact | Moment::Free | Moment::Start | Moment::Stop);
        let ways = if has_commands { &Way::ALL[..] } else { &Way::ALL[1..] };
        let (way, fields) = match kind {
            Kind::StateField => (Way::States, &STATE_FIELDS[..]),
            Kind::OldState | Kind::Frozen | Kind::Clock => (Way::States, &STATE_FIELDS[..]),
            Kind::AckField => (Way::Acknowledgements, &ACK_FIELDS[..]),
            Kind::AckUnsent => (Way::Acknowledgements, &["Rx", "Done"][..]),
            Kind::CommandField => (Way::Commands, &COMMAND_FIELDS[..]),
            Kind::RequestField => (Way::Requests, &REQUEST_FIELDS[..]),
            _ => (draw.choose(ways), &STATE_FIELDS[..]),
        };
        let field = draw.choose(fields);
        let change = match kind {
            Kind::AckUnsent => Change::Add(draw.choose(&[1.0, 5.0, 60.0, 1_000.0])),
            _ => change(field, draw),
        };
        let amount_ms = match kind {
            Kind::Delay => draw.choose(&[20, 90, 180, 300, 450, 800]),
            Kind::Jitter => draw.choose(&[40, 150, 390, 600]),
            Kind::Fragments => draw.choose(&[0, 0, 1]),
            _ => draw.between(0, 400),
        };
        let times = match kind {
            Kind::Loss => draw.between(1, 4),
            Kind::StateField | Kind::AckField => draw.choose(&[1, 1, 3, u64::MAX]),
            Kind::CommandField | Kind::RequestField | Kind::AckUnsent => 1,
            Kind::Duplicate | Kind::Reorder | Kind::Damage | Kind::OldState => draw.choose(&[1, 1, 3]),
            Kind::Cut | Kind::Garbage => 1,
            _ => u64::MAX,
        };
        let lasts_ms = match kind {
            Kind::Stall | Kind::BlackHole => draw.choose(&[150, 300, 390, 500, 1_000, 2_500]),
            Kind::Refuse => draw.choose(&[300, 1_500, 4_000]),
            Kind::Frozen | Kind::Clock => draw.choose(&[250, 600, 1_500, 4_000]),
            // The fault ends when it has been injected this number of times.
            _ if times < u64::MAX => 5_000,
            _ => draw.choose(&[1_000, 2_000, 3_000]),
        };
        let (both, counts_go_on) = (draw.one_in(2), draw.one_in(2));
        MessageFault { kind, way, both, lasts_ms, times, amount_ms, field, change, counts_go_on, of_orders: false }
    }
}

impl fmt::Display for Scenario {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Scenario { number, lie, moment, press, .. } = self;
        write!(f, "{number:3} {} in {moment:?}", lie.kind.words())?;
        if *moment == Moment::Stop {
            write!(f, " amid {:?}", self.amid)?;
        }
        write!(f, ", {:?}", lie.way)?;
        if matches!(
            lie.kind,
            Kind::StateField | Kind::AckField | Kind::CommandField | Kind::RequestField | Kind::AckUnsent
        ) {
            write!(f, " {} {:?}", lie.field, lie.change)?;
        }
        if let Some((word, after_ms)) = press {
            write!(f, ", {word} after {after_ms} ms")?;
        }
        Ok(())
    }
}
