//! Mutations of the model of the controller's programs.

use super::{Mutation, change};

const OUTPUTS: &str = "src/devices/mock/outputs.rs";
const SUBMIT: &str = "src/devices/mock/submit.rs";

pub(super) const ALL: [Mutation; 5] = [
    change(
        "the controller's watchdog × 4",
        SUBMIT,
        "const WATCHDOG_TIMEOUT_MS: u64 = 400;",
        "const WATCHDOG_TIMEOUT_MS: u64 = 1_600;",
    ),
    change(
        "the controller takes a command behind a gap",
        SUBMIT,
        "if command.id != self.epoch.last_received + 1 {",
        "if command.id > self.epoch.last_received + 1_000 {",
    ),
    change(
        "the controller's watchdog does not look at tool and water",
        OUTPUTS,
        "at_once.any(|(number, _)| self.outputs.get(number) == Some(&true))",
        "at_once.any(|(number, _)| self.outputs.get(number).is_none())",
    ),
    change(
        "the controller keeps the place of a client that is gone without a word",
        SUBMIT,
        "const CLIENT_SILENCE_TIMEOUT_MS: u64 = 3_000;",
        "const CLIENT_SILENCE_TIMEOUT_MS: u64 = 18_000_000;",
    ),
    change("a stop leaves the water on", SUBMIT, "self.switch_off_outputs(|after_ms| after_ms == 0);", "").and(
        OUTPUTS,
        "if since_ms >= after_ms && self.pending_off_outputs.contains(&number) {",
        "if since_ms >= after_ms && number != 2 && self.pending_off_outputs.contains(&number) {",
    ),
];
