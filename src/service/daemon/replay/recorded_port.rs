//! A port whose commands and answers are recorded: each command passes unchanged, and is recorded while the switch is
//! on.

use super::form::{Recordable, RecordedAnswer};
use super::switch::RecordingSwitch;
use crate::daemon::ports::Port;
use panelprep_store::tape::Entry;
use std::ops::DerefMut;

/// A port that can be recorded.
pub struct RecordedPort<P> {
    port: P,
    switch: RecordingSwitch,
}

impl<P> RecordedPort<P> {
    /// Returns this port, recorded while the switch is on.
    pub fn new(port: P, switch: RecordingSwitch) -> Self {
        RecordedPort { port, switch }
    }
}

impl<C: Recordable, P: DerefMut<Target: Port<C>>> Port<C> for RecordedPort<P> {
    fn perform(&mut self, command: C) -> C::Answer {
        command.before_command(&self.switch);
        let recorder = self.switch.recorder();
        let said = recorder.as_ref().and_then(|_| command.recorded_command());
        let mut answer = self.port.perform(command);
        C::after_answer(&mut answer, &self.switch);
        if let (Some(recorder), Some((topic, said))) = (recorder, said)
            && let Some(RecordedAnswer { value: heard, shot }) = C::recorded_answer(&answer, &recorder)
        {
            recorder.record_entry(Entry { topic, at_ns: 0, action: said, reply: heard, shot });
        }
        answer
    }
}
