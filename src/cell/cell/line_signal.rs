//! `[io.line_outputs]`: the outputs that report the cell's state to a line.

use panelprep_base::config::Section;
use std::collections::BTreeMap;
use strum::VariantArray;

/// The signals that the line reads: outputs of the robot's controller, by their names in `[io.line_outputs]`, in
/// the order of CELL_LINE.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr, strum::EnumString, VariantArray,
)]
#[strum(serialize_all = "snake_case")]
pub enum LineSignal {
    /// `ready`: a start request is accepted for examination.
    Ready,
    /// `cycle_done`: the cycle is complete, and the part may be removed.
    CycleDone,
    /// `pass`: with `cycle_done`, the verdict is pass.
    Pass,
    /// `fail`: with `cycle_done`, the verdict is any other than pass.
    Fail,
    /// `review`: the cycle waits for a person's decision on a result.
    Review,
    /// `fault`: a person is needed. The controller itself sets it if it receives nothing from this program.
    Fault,
}

impl LineSignal {
    /// The name in the cell's file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The signal's bit in the word that is sent to the controller.
    pub fn bit(self) -> u32 {
        1 << (self as u32)
    }
}

/// Reads `[io.line_outputs]`: an output for the line must not be one that the process switches.
pub(super) fn parse_line_outputs(
    section: &Section<'_, '_>,
    numbers: BTreeMap<String, u16>,
    outputs: &BTreeMap<String, u16>,
) -> Option<BTreeMap<String, u16>> {
    let names = || LineSignal::VARIANTS.iter().map(|signal| signal.name()).collect::<Vec<_>>().join(", ");
    let mut right = true;
    for (name, number) in &numbers {
        let taken = outputs.iter().find(|(_, other)| *other == number);
        let wrong = match (name.parse::<LineSignal>(), taken) {
            (Err(_), _) => format!("is not a signal for a line; valid: {}", names()),
            (_, Some((output, _))) => {
                format!("found {number}, which is already the number of {output} in [io.outputs]")
            }
            _ => continue,
        };
        section.problem(name, wrong);
        right = false;
    }
    right.then_some(numbers)
}
