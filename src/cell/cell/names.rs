//! Names that the user chooses: `[poses]`; `[io]` with the controller's signals, the outputs that are switched off
//! automatically and the outputs that report the cell's state to a production line (`[io.line_outputs]`); and `[line]`,
//! the handshake with this line, which is off until the table is present.

use panelprep_base::config::Section;
use panelprep_base::geometry::Joints;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use strum::VariantArray;

/// Parses `[poses]`. A pose consists of axis angles, because the arm moves to it by `move_j`, which needs axis angles.
pub(super) fn parse_poses(section: &Section<'_, '_>) -> Option<BTreeMap<String, Joints>> {
    let named = section.named_sections();
    if section.is_present() && !named.iter().any(|(name, _)| name == "park") {
        section.problem(
            "park",
            "is missing; state the axis angles at which the arm is clear of the panel: every cycle begins there",
        );
        return None;
    }
    named.into_iter().map(|(name, pose)| Some((name, parse_joints(&pose)?))).collect()
}

fn parse_joints(section: &Section<'_, '_>) -> Option<Joints> {
    // The range is wide: `requirements` and the checks of a motion state which angles this arm reaches.
    let axis = |key| section.parse::<f64>(key, -360.0..=360.0, None);
    let [a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg] =
        ["a1_deg", "a2_deg", "a3_deg", "a4_deg", "a5_deg", "a6_deg"].map(axis);
    section.finish();
    Some(Joints {
        a1_deg: a1_deg?,
        a2_deg: a2_deg?,
        a3_deg: a3_deg?,
        a4_deg: a4_deg?,
        a5_deg: a5_deg?,
        a6_deg: a6_deg?,
    })
}

/// The controller's outputs that the process uses. Their names are keys of `[io.outputs]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
pub enum Output {
    /// `light`: on for pictures of the film, off for 3D shots.
    Light,
    /// `spray`: sprays water onto the panel.
    Spray,
    /// `lens_shutter`: protects the lens with a shutter or purge air.
    LensShutter,
    /// `extraction`: switches the dust extraction on.
    Extraction,
    /// `tool`: switches the sander on.
    Tool,
}

impl Output {
    /// All outputs that the process uses.
    pub const ALL: &'static [Output] = <Self as VariantArray>::VARIANTS;

    /// Returns the output's name in the cell's file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the feedback that confirms the effect of the output. The feedback of the spray confirms that the spray
    /// is off.
    pub fn feedback(self) -> Feedback {
        match self {
            Output::Light => Feedback::LightOn,
            Output::Spray => Feedback::WaterOff,
            Output::LensShutter => Feedback::LensShut,
            Output::Extraction => Feedback::ExtractionFlow,
            Output::Tool => Feedback::ToolRunning,
        }
    }
}

/// The controller's inputs that the process uses as feedback. Their names are keys of `[io.feedbacks]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum Feedback {
    /// `light_on`: the lamp is on and has reached its full brightness.
    LightOn,
    /// `water_off`: the valve is closed.
    WaterOff,
    /// `lens_shut`: no drop can reach the lens.
    LensShut,
    /// `extraction_flow`: the extraction has an air flow.
    ExtractionFlow,
    /// `tool_running`: the sander rotates.
    ToolRunning,
    /// `tool_stands`: the sander is at rest. Exactly one of the signals `tool_running` and `tool_stands` is on. A
    /// signal that is on therefore proves that the tool is off, and a broken wire is detected.
    ToolStands,
}

impl Feedback {
    /// Returns the feedback's name in the cell's file.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Name in `[io.feedbacks]` of the input of the cell's selector switch. It is on while the switch is in the position
/// local.
pub const LOCAL_CONTROL: &str = "local_control";
/// Name in `[io.outputs]` of the horn or lamp that warns before the first motion.
pub const WARNING: &str = "warning";

/// `[io.outputs]`, `[io.off_after_s]`, `[io.feedbacks]`, `[io.mapped_inputs]`, `[io.line_outputs]` and `[io]
/// may_stay_on`: the names of the controller's digital outputs and inputs, the outputs that the controller's program
/// switches off when an epoch ends, and the outputs that may stay on.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct InputsOutputs {
    outputs: BTreeMap<String, u16>,
    off_delays_s: BTreeMap<String, u16>,
    feedbacks: BTreeMap<String, u16>,
    mapped_inputs: BTreeMap<String, u16>,
    line_outputs: BTreeMap<String, u16>,
    may_stay_on: BTreeSet<String>,
}

impl InputsOutputs {
    /// Returns the number n of `$OUT[n]` for each name.
    pub fn outputs(&self) -> &BTreeMap<String, u16> {
        &self.outputs
    }

    /// Returns the number n of `$IN[n]` for each name.
    pub fn feedbacks(&self) -> &BTreeMap<String, u16> {
        &self.feedbacks
    }

    /// Returns the number n of `$IN[n]` for each input that `set_digin` may set. The controller maps each of these
    /// inputs to a flag, because `$IN[n]` is read-only.
    pub fn mapped_inputs(&self) -> &BTreeMap<String, u16> {
        &self.mapped_inputs
    }

    /// Returns the outputs that the controller switches off automatically, each with its delay after the end of an
    /// epoch, s. The delay of tool and water is 0. An output without an entry keeps its state, such as the lens
    /// shutter.
    pub fn off_delays_s(&self) -> &BTreeMap<String, u16> {
        &self.off_delays_s
    }

    /// Returns the outputs without a decision in the cell's file: it states neither a delay after which they are
    /// switched off, nor that they may stay on. The lens shutter needs no decision.
    pub fn undecided(&self) -> Vec<&str> {
        let is_decided = |name: &str| {
            name == Output::LensShutter.name()
                || self.off_delays_s.contains_key(name)
                || self.may_stay_on.contains(name)
        };
        self.outputs.keys().map(String::as_str).filter(|name| !is_decided(name)).collect()
    }

    /// Returns the number of the output for this signal to the line.
    pub fn line_output(&self, signal: LineSignal) -> Option<u16> {
        self.line_outputs.get(signal.name()).copied()
    }

    /// Returns the numbers of all outputs to the line, in the order of CELL_LINE; 0 if the cell does not have the
    /// output.
    pub fn line_outputs(&self) -> [u16; 6] {
        let mut numbers = [0; 6];
        for signal in LineSignal::VARIANTS {
            numbers[*signal as usize] = self.line_output(*signal).unwrap_or(0);
        }
        numbers
    }

    /// Returns the bits in `Out` of the state message that belong to tool and water, which are switched off without
    /// delay.
    pub fn immediate_off_bits(&self) -> u32 {
        let at_once = self.off_delays_s.iter().filter(|(_, after_s)| **after_s == 0);
        let bits = at_once.filter_map(|(name, _)| bit(&self.outputs, *self.outputs.get(name)?));
        bits.fold(0, |bits, bit| bits | 1u32.checked_shl(bit).unwrap_or(0))
    }

    /// Returns the number of an output that the process uses.
    pub fn output(&self, output: Output) -> Option<u16> {
        self.outputs.get(output.name()).copied()
    }

    /// Returns the number of a feedback that the process uses.
    pub fn feedback(&self, feedback: Feedback) -> Option<u16> {
        self.feedbacks.get(feedback.name()).copied()
    }

    /// Returns the bit in `Out` of the state message for the output with this number.
    pub fn output_bit(&self, number: u16) -> Option<u32> {
        bit(&self.outputs, number)
    }

    /// Returns whether a signal that is on proves that the tool is off. Without such a signal, a broken wire cannot be
    /// distinguished from a tool at rest.
    pub fn proves_tool_off(&self) -> bool {
        [Feedback::ToolRunning, Feedback::ToolStands].iter().all(|feedback| self.feedback(*feedback).is_some())
    }

    /// Returns the bit in `In` of the state message for a feedback.
    pub fn feedback_bit(&self, feedback: Feedback) -> Option<u32> {
        bit(&self.feedbacks, self.feedback(feedback)?)
    }

    /// Returns the bit in `In` of the state message for the input with this name.
    pub fn input_bit(&self, name: &str) -> Option<u32> {
        bit(&self.feedbacks, *self.feedbacks.get(name)?)
    }

    /// Returns the name of each output, and whether it is on in `bits`, the `Out` of the state message.
    pub fn decode_outputs(&self, bits: u32) -> Vec<(&str, bool)> {
        signals(&self.outputs, bits)
    }

    /// Returns the name of each feedback, and whether it is on in `bits`, the `In` of the state message.
    pub fn decode_feedbacks(&self, bits: u32) -> Vec<(&str, bool)> {
        signals(&self.feedbacks, bits)
    }
}

/// Returns the bit of a signal. The bits of the state message are in the order of the signals' numbers.
fn bit(names: &BTreeMap<String, u16>, number: u16) -> Option<u32> {
    u32::try_from(names.values().filter(|other| **other < number).count()).ok()
}

fn signals(names: &BTreeMap<String, u16>, bits: u32) -> Vec<(&str, bool)> {
    let is_on = |number: u16| bit(names, number).is_some_and(|bit| bits.checked_shr(bit).unwrap_or(0) & 1 == 1);
    names.iter().map(|(name, number)| (name.as_str(), is_on(*number))).collect()
}

/// Maximum number of feedbacks: the state message carries the inputs as the bits of one INT (`eki.md` 9).
const MAX_FEEDBACKS: usize = 31;
/// Outputs that can do harm without supervision by the PC: the tool, and all outputs that let water run. They are
/// switched off without delay.
const IMMEDIATE_OFF_OUTPUTS: [&str; 3] = ["rinse", "spray", "tool"];
/// Maximum delay after which an output is switched off, s.
const MAX_OFF_DELAY_S: u16 = 600;
/// Maximum number of mapped inputs: the size of the controller's list.
const MAX_MAPPED_INPUTS: usize = 8;

pub(super) fn parse_io(section: &Section<'_, '_>) -> Option<InputsOutputs> {
    let (outputs, feedbacks) = (section.section("outputs"), section.section("feedbacks"));
    let mapped = section.section("mapped_inputs");
    let off_after = section.section("off_after_s");
    let line_outputs = section.section("line_outputs");
    let staying = section.parse::<Option<Vec<String>>>("may_stay_on", (), Some(None));
    section.finish();
    let (outputs, feedbacks_taken, mapped_taken) =
        (parse_numbers(&outputs), parse_numbers(&feedbacks), parse_numbers(&mapped));
    let outputs = outputs?;
    let off_after_s = parse_off_delays(&off_after, &outputs);
    let may_stay_on = parse_may_stay_on(section, staying?, (&outputs, off_after_s.as_ref()));
    let line_numbers = parse_numbers(&line_outputs);
    let line_outputs = parse_line_outputs(&line_outputs, line_numbers?, &outputs);
    let io = InputsOutputs {
        outputs,
        off_delays_s: off_after_s?,
        feedbacks: feedbacks_taken?,
        mapped_inputs: mapped_taken?,
        line_outputs: line_outputs?,
        may_stay_on: may_stay_on?,
    };
    let constant: Vec<_> = io.feedbacks.iter().filter(|(_, number)| [1025, 1026].contains(*number)).collect();
    for (name, number) in &constant {
        feedbacks.problem(
            name,
            format!("found {number}; $IN[1025] is always true and $IN[1026] is always false; state another input"),
        );
    }
    // This program must never set the inputs that prove that water or tool is off.
    let proves = |number: &u16| io.feedbacks.values().any(|feedback| feedback == number);
    let feigned: Vec<_> = io.mapped_inputs.iter().filter(|(_, number)| proves(number)).collect();
    for (name, number) in &feigned {
        mapped.problem(
            name,
            format!("found {number}, which is the number of a feedback; feedbacks are only read, never set"),
        );
    }
    let mut right = constant.is_empty() && feigned.is_empty();
    for (key, found, max_count) in [
        ("mapped_inputs", io.mapped_inputs.len(), MAX_MAPPED_INPUTS),
        ("feedbacks", io.feedbacks.len(), MAX_FEEDBACKS),
    ] {
        if found > max_count {
            section.problem(key, format!("found {found} names, the maximum is {max_count}"));
            right = false;
        }
    }
    right.then_some(io)
}

/// Parses `[io.off_after_s]`: the delay after the end of an epoch at which the controller's program switches each
/// output off.
fn parse_off_delays(section: &Section<'_, '_>, outputs: &BTreeMap<String, u16>) -> Option<BTreeMap<String, u16>> {
    let stated = section.parse_named_entries::<u16>(&(0..=MAX_OFF_DELAY_S));
    let mut right = true;
    for (name, after_s) in &stated {
        let wrong = if !outputs.contains_key(name) {
            let names = outputs.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            format!("is not an output of [io.outputs]; valid: {names}")
        } else if name == Output::LensShutter.name() {
            "protects the cameras from drops and is never switched off automatically; remove this key".to_owned()
        } else if IMMEDIATE_OFF_OUTPUTS.contains(&name.as_str()) && *after_s > 0 {
            format!("found {after_s}, valid: 0; tool and water are switched off immediately")
        } else {
            continue;
        };
        section.problem(name, wrong);
        right = false;
    }
    let at_once = IMMEDIATE_OFF_OUTPUTS.map(|name| (name, 0));
    // A stop during the warning must not leave the warning output on.
    let later = [(Output::Extraction.name(), 30), (Output::Light.name(), 60), (WARNING, 1)];
    let usual = at_once.into_iter().chain(later);
    let mut all: BTreeMap<String, u16> =
        usual.filter(|(name, _)| outputs.contains_key(*name)).map(|(name, s)| (name.to_owned(), s)).collect();
    all.extend(stated);
    right.then_some(all)
}

/// Parses `may_stay_on`: the outputs that stay on after the end of an epoch.
fn parse_may_stay_on(
    section: &Section<'_, '_>,
    stated: Option<Vec<String>>,
    (outputs, off_after_s): (&BTreeMap<String, u16>, Option<&BTreeMap<String, u16>>),
) -> Option<BTreeSet<String>> {
    let stated = stated.unwrap_or_default();
    let mut right = true;
    for name in &stated {
        let wrong = if IMMEDIATE_OFF_OUTPUTS.contains(&name.as_str()) {
            "tool and water are always switched off without delay; remove this name".to_owned()
        } else if !outputs.contains_key(name) {
            let names = outputs.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            format!("this name is not an output of [io.outputs]; valid: {names}")
        } else if let Some(after_s) = off_after_s.and_then(|all| all.get(name)) {
            format!(
                "this output is switched off {after_s} s after the end of an epoch ([io.off_after_s], or its default time); remove it from may_stay_on"
            )
        } else {
            continue;
        };
        section.problem("may_stay_on", format!("found \"{name}\"; {wrong}"));
        right = false;
    }
    right.then(|| stated.into_iter().collect())
}

fn parse_numbers(section: &Section<'_, '_>) -> Option<BTreeMap<String, u16>> {
    let named = section.parse_named_entries::<u16>(&(1..=4096));
    let mut first_names = BTreeMap::new();
    let mut right = true;
    for (name, number) in &named {
        if let Some(first) = first_names.insert(*number, name) {
            section.problem(name, format!("found {number}, which is already the number of {first}"));
            right = false;
        }
    }
    right.then_some(named)
}

/// The signals from the cell to the production line: outputs of the robot controller. Their names are keys of
/// `[io.line_outputs]`, in the order of CELL_LINE.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr, strum::EnumString, VariantArray,
)]
#[strum(serialize_all = "snake_case")]
pub enum LineSignal {
    /// `ready`: the cell can accept a start request.
    Ready,
    /// `cycle_done`: the cycle has ended, and the part may be removed.
    CycleDone,
    /// `pass`: with `cycle_done`, the verdict is pass.
    Pass,
    /// `fail`: with `cycle_done`, the verdict is not pass.
    Fail,
    /// `review`: the cycle waits for a person's decision on a result.
    Review,
    /// `fault`: the cell needs a person. The controller also sets this signal if it receives no messages from this
    /// program.
    Fault,
}

impl LineSignal {
    /// Returns the signal's name in the cell's file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the signal's bit in the word that is sent to the controller.
    pub fn bit(self) -> u32 {
        1 << (self as u32)
    }
}

/// Parses `[io.line_outputs]`. An output to the line must not be an output that the process switches.
fn parse_line_outputs(
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

/// Names in `[io.feedbacks]` of the inputs that the production line sets.
pub const LINE_INPUTS: [&str; 2] = ["part_present", "start_request"];

/// The parameters of a cycle that the production line starts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// The path of the recipe.
    pub recipe: PathBuf,
    /// The serial number that every part gets; `None` for no serial number.
    pub serial: Option<String>,
    /// The work order, if one is stated.
    pub order: Option<String>,
    /// The responsible person, who is recorded as the operator.
    pub operator: Option<String>,
}

pub(super) fn parse_line(
    folder: &Path,
    section: &Section<'_, '_>,
    io: Option<&InputsOutputs>,
) -> Option<Option<Line>> {
    if !section.is_present() {
        return Some(None);
    }
    let recipe = section.parse::<String>("recipe", (), None);
    let name = |key| section.parse::<Option<String>>(key, (), Some(None));
    let [serial, order, operator] = ["serial", "order", "operator"].map(name);
    section.finish();
    let io = io?;
    let inputs = LINE_INPUTS.iter().filter(|name| !io.feedbacks().contains_key(**name));
    let missing: Vec<String> = inputs.map(|name| format!("io.feedbacks.{name}")).collect();
    let outputs = LineSignal::VARIANTS.iter().filter(|signal| io.line_output(**signal).is_none());
    let missing: Vec<String> =
        missing.into_iter().chain(outputs.map(|signal| format!("io.line_outputs.{}", signal.name()))).collect();
    if !missing.is_empty() {
        let message =
            format!("the handshake with the line needs all of its signals; missing: {}", missing.join(", "));
        section.problem("recipe", message);
        return None;
    }
    Some(Some(Line { recipe: folder.join(recipe?), serial: serial?, order: order?, operator: operator? }))
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    const IO: &str = "[io.outputs]\ntool = 5\n[io.feedbacks]\ntool_running = 20\npart_present = 30\nstart_request = 31\n\
                      [io.line_outputs]\nready = 40\ncycle_done = 41\npass = 42\nfail = 43\nreview = 44\nfault = 45\n";

    fn read(text: &str) -> Result<Option<Line>, String> {
        let cell = Cell::check("cells/cell.toml", text).map_err(|problems| problems.to_string())?;
        Ok(cell.line().cloned())
    }

    #[test]
    fn it_is_off_without_its_table() {
        assert_eq!(read(IO), Ok(None));
        let line =
            read(&format!("{IO}[line]\nrecipe = 'door.toml'\norder = 'WO 7'")).expect("right").expect("a line");
        assert_eq!((line.recipe, line.order), (PathBuf::from("cells/door.toml"), Some("WO 7".to_owned())));
        assert_eq!((line.serial, line.operator), (None, None));
    }

    #[test]
    fn each_mistake_is_named() {
        for (text, words) in [
            (format!("{IO}[line]\n"), "line.recipe: is missing"),
            (
                format!("{}[line]\nrecipe = 'a'", IO.replace("part_present = 30\n", "")),
                "missing: io.feedbacks.part_present",
            ),
            (format!("{}[line]\nrecipe = 'a'", IO.replace("fault = 45\n", "")), "missing: io.line_outputs.fault"),
            (
                IO.replace("pass = 42", "pass = 5"),
                "io.line_outputs.pass: found 5, which is already the number of tool",
            ),
            (
                IO.replace("pass = 42", "passed = 42"),
                "io.line_outputs.passed: is not a signal for a line; valid: ready",
            ),
            (IO.replace("pass = 42", "pass = 41"), "found 41, which is already the number of cycle_done"),
        ] {
            let told = read(&text).expect_err("wrong");
            assert!(told.contains(words), "{words}: {told}");
        }
    }
}
