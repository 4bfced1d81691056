//! The session with the tool: log-in, then one command in each period, each with a reply before its deadline. This
//! module has no sockets and no clock.
//!
//! The owner of the connection passes received bytes and the time, and sends the bytes that are returned. The first
//! deviation ends the session with a [`LinkLossCause`]; in a new connection, the tool is first held back. No byte is
//! ever skipped: a wrong byte ends the session, because the bytes after it could be the reply to another command.

use super::press::{ForceSetPoint, SetPointRamp};
use super::telegram::{
    self, Command, MAX_LOGIN_ECHO_BYTES, MAX_REPLY_BYTES, TERMINATOR, TelegramError, ToolReading,
};
use panelprep_kuka::eki::Time;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Maximum time until the tool echoes the log-in.
const LOGIN_TIMEOUT: Duration = Duration::from_millis(1_000);

/// The settings of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionLimits {
    /// The word with which the program logs in to the tool.
    pub login: String,
    /// The tool's id in telegrams.
    pub id: u16,
    /// Period of the commands.
    pub period: Duration,
    /// Maximum time until a reply.
    pub reply_within: Duration,
    /// The set-point of the tool until another one is set.
    pub rest_set_point: ForceSetPoint,
}

/// The reason why the link to the tool was lost.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum LinkLossCause {
    /// The connection could not be established.
    #[error("the connection failed: {problem}")]
    Unreachable {
        /// The error of the operating system.
        problem: String,
    },
    /// The tool closed the connection.
    #[error("the tool closed the connection: check its controller")]
    Closed,
    /// The tool refused the log-in.
    #[error("the tool replied to the log-in text with \"{found}\"; compare [tool] login with the tool's settings")]
    NotLoggedIn {
        /// The tool's reply to the log-in.
        found: String,
    },
    /// The tool did not reply in time.
    #[error("the tool has not replied for {ms} ms: check its power and its network cable")]
    Silent {
        /// Time without a reply, ms.
        ms: u64,
    },
    /// The tool's reply is not valid.
    #[error("the tool's reply is not valid: {problem}")]
    Garbage {
        /// The problem in the reply.
        problem: String,
    },
    /// A tool with another id has replied.
    #[error("{problem}; compare [tool] id with the tool's settings")]
    OtherId {
        /// The problem, with the expected and the received id.
        problem: String,
    },
    /// The tool sent data without a request.
    #[error("the tool sent data without a request: check that no other program controls it")]
    Unasked,
}

/// The state of a session.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// No connection yet.
    Offline,
    /// The log-in was sent at this time.
    LoggingIn(Time),
    /// No reply is pending; the next command is due at this time.
    Ready(Time),
    /// A command was sent at this time, and its reply is pending.
    Asked(Time),
    /// The session has ended.
    Lost(LinkLossCause),
}

/// A session with a compliant tool.
#[derive(Debug, Clone)]
pub struct Session {
    limits: SessionLimits,
    state: State,
    ramp: SetPointRamp,
    buffer: Vec<u8>,
    last_reading: Option<(Time, ToolReading)>,
}

impl Session {
    /// Creates a session that is not connected yet.
    pub fn new(limits: SessionLimits) -> Self {
        let ramp = SetPointRamp::constant(limits.rest_set_point);
        Session { limits, state: State::Offline, ramp, buffer: Vec::new(), last_reading: None }
    }

    /// Starts the session on a new connection, and returns the log-in to send. The tool is held back until another
    /// set-point is set.
    pub fn connected(&mut self, now: Time) -> Vec<u8> {
        // Discard the previous session, including its set-point: the tool may be at another place now.
        *self = Session { state: State::LoggingIn(now), ..Session::new(self.limits.clone()) };
        telegram::login(&self.limits.login)
    }

    /// Sets the set-point of the tool from `now` on.
    pub fn set_point_now(&mut self, press: ForceSetPoint, now: Time) {
        self.ramp.start_towards(press, now);
    }

    /// Returns the session's state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Returns whether the session is logged in and receives replies.
    pub fn is_receiving(&self) -> bool {
        matches!(self.state, State::Ready(_) | State::Asked(_)) && self.last_reading.is_some()
    }

    /// Returns the last measured values and the time at which they were received.
    pub fn last_reading(&self) -> Option<(Time, ToolReading)> {
        self.last_reading
    }

    /// Returns the time at which [`tick`](Self::tick) must be called next; `None` without a connection.
    pub fn next_tick(&self) -> Option<Time> {
        match self.state {
            State::LoggingIn(since) => Some(since + LOGIN_TIMEOUT),
            State::Ready(due) => Some(due),
            State::Asked(since) => Some(since + self.limits.reply_within),
            State::Offline | State::Lost(_) => None,
        }
    }

    /// Advances the session to the time `now`, and returns the bytes to send. A missed deadline ends the session.
    pub fn tick(&mut self, now: Time) -> Option<Vec<u8>> {
        match self.state {
            State::Ready(due) if now >= due => {
                self.state = State::Asked(now);
                Some(self.command(now).bytes())
            }
            State::LoggingIn(since) if now.since(since) >= LOGIN_TIMEOUT => self.on_silence(since, now),
            State::Asked(since) if now.since(since) >= self.limits.reply_within => self.on_silence(since, now),
            _ => None,
        }
    }

    fn on_silence(&mut self, since: Time, now: Time) -> Option<Vec<u8>> {
        let ms = u64::try_from(now.since(since).as_millis()).unwrap_or(u64::MAX);
        self.end_session(LinkLossCause::Silent { ms });
        None
    }

    fn command(&self, now: Time) -> Command {
        let ForceSetPoint { no_contact_n, .. } = self.ramp.target();
        // The tool must neither compensate for gravity nor ramp the force, because both are already computed here.
        Command {
            id: self.limits.id,
            force_n: self.ramp.force_n(now),
            free_force_n: no_contact_n,
            ramp_s: 0.0,
            payload_kg: 0.0,
        }
    }

    /// Processes received bytes.
    pub fn received(&mut self, bytes: &[u8], now: Time) {
        for byte in bytes {
            match self.state {
                State::Offline | State::Lost(_) => return,
                // Requests and replies alternate. An additional reply would be taken for the reply to the next request,
                // and all measured values would be one period old.
                State::Ready(_) => return self.end_session(LinkLossCause::Unasked),
                State::LoggingIn(_) => self.process_login_byte(*byte, now),
                State::Asked(since) => self.process_reply_byte(*byte, since, now),
            }
        }
    }

    fn process_login_byte(&mut self, byte: u8, now: Time) {
        self.buffer.push(byte);
        let expected = telegram::login(&self.limits.login);
        if self.buffer == expected {
            self.buffer.clear();
            self.state = State::Ready(now);
        } else if !expected.starts_with(&self.buffer) || self.buffer.len() >= MAX_LOGIN_ECHO_BYTES {
            let found = String::from_utf8_lossy(&self.buffer).escape_debug().to_string();
            self.end_session(LinkLossCause::NotLoggedIn { found });
        }
    }

    fn process_reply_byte(&mut self, byte: u8, since: Time, now: Time) {
        if byte != TERMINATOR {
            self.buffer.push(byte);
            // A limit is needed, because a tool that sends endless noise would fill the memory.
            if self.buffer.len() > MAX_REPLY_BYTES {
                let problem = TelegramError::TooLong { bytes: self.buffer.len() }.to_string();
                self.end_session(LinkLossCause::Garbage { problem });
            }
            return;
        }
        let buffer = std::mem::take(&mut self.buffer);
        match telegram::parse_reply(&buffer, self.limits.id) {
            Ok(reading) => {
                // The time of arrival, not of the request, is stored: the age of a measured value decides whether it is
                // compared.
                self.last_reading = Some((now, reading));
                self.state = State::Ready((since + self.limits.period).max(now));
            }
            Err(error @ TelegramError::OtherId { .. }) => {
                self.end_session(LinkLossCause::OtherId { problem: error.to_string() })
            }
            Err(error) => self.end_session(LinkLossCause::Garbage { problem: error.to_string() }),
        }
    }

    /// Ends the session for this cause.
    pub fn end_session(&mut self, why: LinkLossCause) {
        // The first cause is kept, because later ones are its consequences.
        if !matches!(self.state, State::Lost(_)) {
            self.state = State::Lost(why);
            self.buffer.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    //! Tests of a session, message by message.

    use super::*;
    use proptest::prelude::*;

    fn session() -> Session {
        Session::new(SessionLimits {
            login: "ferba".to_owned(),
            id: 1040,
            period: Duration::from_millis(10),
            reply_within: Duration::from_millis(100),
            rest_set_point: ForceSetPoint::retracted(-20.0),
        })
    }

    fn live() -> Session {
        let mut session = session();
        assert_eq!(session.connected(Time::from_ms(0)), b"ferbak");
        session.received(b"ferbak", Time::from_ms(3));
        session
    }

    fn text(bytes: Option<Vec<u8>>) -> String {
        String::from_utf8(bytes.expect("a command")).expect("text")
    }

    fn lost(session: &Session) -> &LinkLossCause {
        let State::Lost(loss) = session.state() else { panic!("{:?}", session.state()) };
        loss
    }

    /// Expected values, calculated by hand: the first command is sent immediately after the log-in, the next one 10 ms
    /// later. The force in each command follows the ramp.
    #[test]
    fn one_command_a_period_and_each_is_answered() {
        let mut session = live();
        assert!(!session.is_receiving(), "nothing is read yet");
        assert_eq!(text(session.tick(Time::from_ms(3))), "1040 -20.00 -20.00 0.000 0.000 0k");
        assert_eq!(session.tick(Time::from_ms(5)), None, "one at a time");
        session.received(b"1040 -20.0 0.1", Time::from_ms(6));
        session.received(b" 0 0k", Time::from_ms(7));
        assert!(session.is_receiving());
        assert_eq!(session.last_reading().map(|(at, read)| (at, read.force_n)), Some((Time::from_ms(7), -20.0)));
        session.set_point_now(ForceSetPoint { force_n: 10.0, no_contact_n: 5.0, ramp_s: 0.06 }, Time::from_ms(8));
        assert_eq!((session.tick(Time::from_ms(12)), session.next_tick()), (None, Some(Time::from_ms(13))));
        assert_eq!(text(session.tick(Time::from_ms(38))), "1040 -5.00 5.00 0.000 0.000 0k");
    }

    #[test]
    fn each_fault_ends_the_session_with_its_cause() {
        let ends = |act: &dyn Fn(&mut Session)| {
            let mut session = live();
            session.tick(Time::from_ms(3));
            act(&mut session);
            lost(&session).to_string()
        };
        let says = |bytes: &'static [u8]| move |session: &mut Session| session.received(bytes, Time::from_ms(9));
        assert_eq!(
            ends(&|session| drop(session.tick(Time::from_ms(103)))),
            "the tool has not replied for 100 ms: check its power and its network cable"
        );
        assert!(ends(&says(b"1041 1 2 1 0k")).starts_with("tool id 1041 replied, but the request was for id 1040"));
        assert_eq!(
            ends(&says(b"hellok")),
            "the tool's reply is not valid: the reply has 1 fields instead of five: id, force, position, contact, error"
        );
        assert_eq!(
            ends(&says(b"1040 1 2 1 0k1040 1 2 1 0k")),
            "the tool sent data without a request: check that no other program controls it"
        );
        assert!(ends(&says(&[b'1'; 200])).contains("bytes without a terminator"));
        let mut session = session();
        session.connected(Time::from_ms(0));
        session.received(b"nok", Time::from_ms(1));
        assert!(lost(&session).to_string().contains("log-in text with \"n\""), "{:?}", lost(&session));
        session.connected(Time::from_ms(0));
        session.tick(Time::from_ms(1_000));
        assert_eq!(lost(&session), &LinkLossCause::Silent { ms: 1_000 });
    }

    /// A new connection does not use the previous set-point of the tool.
    #[test]
    fn a_new_connection_holds_the_tool_back() {
        let mut session = live();
        session.set_point_now(ForceSetPoint { force_n: 30.0, no_contact_n: 5.0, ramp_s: 0.0 }, Time::from_ms(4));
        session.end_session(LinkLossCause::Closed);
        session.connected(Time::from_ms(50));
        session.received(b"ferbak", Time::from_ms(60));
        assert_eq!(text(session.tick(Time::from_ms(60))), "1040 -20.00 -20.00 0.000 0.000 0k");
    }

    proptest! {
        /// No received bytes cause a panic, and the result does not depend on how the bytes are divided into reads.
        #[test]
        fn the_result_does_not_depend_on_how_the_bytes_are_split(
            bytes in prop::collection::vec(prop_oneof![Just(b'k'), Just(b' '), b'0'..=b'9', any::<u8>()], 0..150),
            cut in 0_usize..150,
        ) {
            let (mut whole, mut parts) = (live(), live());
            whole.tick(Time::from_ms(3));
            parts.tick(Time::from_ms(3));
            whole.received(&bytes, Time::from_ms(5));
            let cut = cut.min(bytes.len());
            parts.received(&bytes[..cut], Time::from_ms(5));
            parts.received(&bytes[cut..], Time::from_ms(5));
            prop_assert_eq!(whole.state(), parts.state());
            prop_assert_eq!(whole.last_reading(), parts.last_reading());
        }
    }
}
