//! The session with the tool: log-in, then one command a period, each answered before its deadline. No sockets, no
//! clock.
//!
//! The owner of the connection supplies the received bytes and the time, and sends the bytes that it is given. The
//! first deviation ends the session with its [`Loss`]; a new connection begins with the tool held back. Nothing is
//! ever skipped or guessed: a wrong byte ends the session, since the bytes that follow could be the answer to
//! another command.

use super::press::{Press, Ramp};
use super::telegram::{self, Command, MAX_LOGIN_ECHO_BYTES, MAX_REPLY_BYTES, Reading, TERMINATOR, TelegramError};
use crate::eki::Time;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Timeout for the echo of the log-in.
const LOGIN_TIMEOUT: Duration = Duration::from_millis(1_000);

/// The settings of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionLimits {
    /// The log-in word.
    pub login: String,
    /// The tool's number.
    pub id: u16,
    /// Interval between commands.
    pub period: Duration,
    /// Timeout for a reply.
    pub reply_within: Duration,
    /// The tool's set-point until another is commanded.
    pub at_rest: Press,
}

/// Why the link to the tool is lost.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// Nothing connects.
    #[error("the connection failed: {problem}")]
    Unreachable {
        /// The system's error.
        problem: String,
    },
    /// The connection ended.
    #[error("the connection was closed")]
    Closed,
    /// The tool refused the log-in.
    #[error("the tool replied to the log-in text with \"{found}\"; compare [tool] login with the tool's settings")]
    NotLoggedIn {
        /// Its answer.
        found: String,
    },
    /// The tool did not answer in time.
    #[error("the tool has not replied for {ms} ms")]
    Silent {
        /// How long, ms.
        ms: u64,
    },
    /// Its answer is not a reply.
    #[error("the tool's reply is not valid: {problem}")]
    Garbage {
        /// Why.
        problem: String,
    },
    /// Another tool answered.
    #[error("{problem}; compare [tool] id with the tool's settings")]
    OtherId {
        /// Which.
        problem: String,
    },
    /// It sent data without a request.
    #[error("the tool sent data without a request")]
    Unasked,
}

/// The state of a session.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// There is no connection yet.
    Offline,
    /// The log-in was sent at this time.
    LoggingIn(Time),
    /// No request is open; the next command is due at this time.
    Ready(Time),
    /// A command was sent at this time.
    Asked(Time),
    /// It has ended.
    Lost(Loss),
}

/// A session.
#[derive(Debug, Clone)]
pub struct Session {
    limits: SessionLimits,
    state: State,
    ramp: Ramp,
    buffer: Vec<u8>,
    newest: Option<(Time, Reading)>,
}

impl Session {
    /// Creates a session that is not connected yet.
    pub fn new(limits: SessionLimits) -> Self {
        let ramp = Ramp::at(limits.at_rest);
        Session { limits, state: State::Offline, ramp, buffer: Vec::new(), newest: None }
    }

    /// Starts on an established connection: returns the log-in to be sent. The tool is held back until another
    /// set-point is commanded.
    pub fn connected(&mut self, now: Time) -> Vec<u8> {
        // Nothing of the former connection is kept, above all not its set-point: the tool may be over another place by
        // now.
        *self = Session { state: State::LoggingIn(now), ..Session::new(self.limits.clone()) };
        telegram::login(&self.limits.login)
    }

    /// Sets the tool's set-point from now on.
    pub fn press(&mut self, press: Press, now: Time) {
        self.ramp.turn_to(press, now);
    }

    /// Returns the session's state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Whether replies come.
    pub fn is_live(&self) -> bool {
        matches!(self.state, State::Ready(_) | State::Asked(_)) && self.newest.is_some()
    }

    /// Returns the last reading, and when it arrived.
    pub fn newest(&self) -> Option<(Time, Reading)> {
        self.newest
    }

    /// Returns the time by which [`tick`](Self::tick) must be called next; `None` without a connection.
    pub fn due(&self) -> Option<Time> {
        match self.state {
            State::LoggingIn(since) => Some(since + LOGIN_TIMEOUT),
            State::Ready(due) => Some(due),
            State::Asked(since) => Some(since + self.limits.reply_within),
            State::Offline | State::Lost(_) => None,
        }
    }

    /// Processes the elapsed time and returns the bytes to send now. A missed deadline ends the session.
    pub fn tick(&mut self, now: Time) -> Option<Vec<u8>> {
        match self.state {
            State::Ready(due) if now >= due => {
                self.state = State::Asked(now);
                Some(self.command(now).bytes())
            }
            State::LoggingIn(since) if now.since(since) >= LOGIN_TIMEOUT => self.silent(since, now),
            State::Asked(since) if now.since(since) >= self.limits.reply_within => self.silent(since, now),
            _ => None,
        }
    }

    fn silent(&mut self, since: Time, now: Time) -> Option<Vec<u8>> {
        let ms = u64::try_from(now.since(since).as_millis()).unwrap_or(u64::MAX);
        self.lose(Loss::Silent { ms });
        None
    }

    fn command(&self, now: Time) -> Command {
        let Press { no_contact_n, .. } = self.ramp.target();
        // The force is already without gravity, and the ramp is made here: the tool must do neither a second time.
        Command { id: self.limits.id, force_n: self.ramp.force_n(now), no_contact_n, ramp_s: 0.0, payload_kg: 0.0 }
    }

    /// These bytes came.
    pub fn received(&mut self, bytes: &[u8], now: Time) {
        for byte in bytes {
            match self.state {
                State::Offline | State::Lost(_) => return,
                // Request and reply alternate. An extra reply would answer the next request, and every reading would be
                // one period old.
                State::Ready(_) => return self.lose(Loss::Unasked),
                State::LoggingIn(_) => self.of_login(*byte, now),
                State::Asked(since) => self.of_reply(*byte, since, now),
            }
        }
    }

    fn of_login(&mut self, byte: u8, now: Time) {
        self.buffer.push(byte);
        let expected = telegram::login(&self.limits.login);
        if self.buffer == expected {
            self.buffer.clear();
            self.state = State::Ready(now);
        } else if !expected.starts_with(&self.buffer) || self.buffer.len() >= MAX_LOGIN_ECHO_BYTES {
            let found = String::from_utf8_lossy(&self.buffer).escape_debug().to_string();
            self.lose(Loss::NotLoggedIn { found });
        }
    }

    fn of_reply(&mut self, byte: u8, since: Time, now: Time) {
        if byte != TERMINATOR {
            self.buffer.push(byte);
            // Without a limit a tool that sends noise without an end would fill the memory.
            if self.buffer.len() > MAX_REPLY_BYTES {
                let problem = TelegramError::TooLong { bytes: self.buffer.len() }.to_string();
                self.lose(Loss::Garbage { problem });
            }
            return;
        }
        let buffer = std::mem::take(&mut self.buffer);
        match telegram::parse_reply(&buffer, self.limits.id) {
            Ok(reading) => {
                // With the time of arrival, not of the request: the age of a reading decides whether it may be judged.
                self.newest = Some((now, reading));
                self.state = State::Ready((since + self.limits.period).max(now));
            }
            Err(error @ TelegramError::OtherId { .. }) => self.lose(Loss::OtherId { problem: error.to_string() }),
            Err(error) => self.lose(Loss::Garbage { problem: error.to_string() }),
        }
    }

    /// It ends here.
    pub fn lose(&mut self, why: Loss) {
        // The first cause stays: what follows a loss is its consequence.
        if !matches!(self.state, State::Lost(_)) {
            self.state = State::Lost(why);
            self.buffer.clear();
        }
    }
}

#[cfg(test)]
mod tests;
