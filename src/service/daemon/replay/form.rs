//! The form of commands and answers in a recording. The recorder writes this form and the player reads it, in the same
//! way for all commands.

mod cameras;
mod record;
mod recordable;
mod requests;
mod robot;
mod tool;

pub(super) use cameras::film_role;
#[cfg(test)]
pub(super) use recordable::to_json;
pub use recordable::{Recordable, RecordedAnswer};

use panelprep_cell::record::name;
use serde_json::Value;

/// Returns a finding as it is compared, without stop-watch times: these depend on the computer.
pub(super) fn without_measured_times(mut finding: Value) -> Value {
    let numbers = finding.get_mut("numbers").and_then(Value::as_array_mut);
    for number in numbers.into_iter().flatten() {
        let stopped = number["name"].as_str().is_some_and(|name| WALL_CLOCK_NUMBERS.contains(&name));
        if stopped {
            number["value"] = Value::Null;
        }
    }
    finding
}

/// Numbers that depend on the wall clock; no decision uses them.
const WALL_CLOCK_NUMBERS: [&str; 2] = [name::SCAN_TO_VERDICT, name::PER_PICTURE];
