//! Compares the data list that a cell engineer edits (`cell_config.dat`) with the cell's file: signals, outputs that
//! are switched off at a stop, flags, timers, axes, workspace and speeds.

use super::data_list::{DataList, Number, format_variable_name};
use super::names::{
    AIR_ACCELERATION_M_S2, CONFIG, Difference, Differences, RETRACT_M_S2, RETRACT_MM, RETRACT_MM_S,
};
use crate::cell::{Cell, Output};
use std::collections::{BTreeMap, BTreeSet};

/// Highest valid number of an input or output.
const MAX_SIGNAL_NUMBER: i32 = 4096;
/// Highest valid number of a flag.
const MAX_FLAG_NUMBER: i32 = 1024;
/// Highest valid number of a timer.
const MAX_TIMER_NUMBER: i32 = 64;
/// Maximum length of a list of signals that is sent as the bits of one INT.
const MAX_SIGNALS_PER_INT: i32 = 31;
/// Maximum length of the list of mapped inputs.
const MAX_MAPPED_INPUTS: i32 = 8;
/// Number of outputs to a production line.
const LINE_OUTPUT_COUNT: i32 = 6;
/// Maximum ratio between the controller's limits of speed and step length and the limits of the cell's file.
const MAX_RATIO_TO_CELL: f64 = 1.25;
/// Maximum distance by which the controller's workspace may extend beyond the cell's workspace, mm.
const BOX_TOLERANCE_MM: f64 = 50.0;
/// Maximum checksum: it is computed modulo 1000003.
const MAX_CHECKSUM: i32 = 1_000_002;
/// Relative rounding tolerance of a 32-bit REAL.
const REAL_ROUNDING: f64 = 1e-3;

/// Names of the flags in the data list.
const FLAGS: [&str; 6] =
    ["CELL_F_CMD_ALIVE", "CELL_F_CMD_CAME", "CELL_F_STOP", "CELL_F_STAT_ALIVE", "CELL_F_STAT_CAME", "CELL_F_HALT"];
/// Names of the timers; their numbers must be consecutive.
const TIMERS: [&str; 7] =
    ["CELL_T_HEARD", "CELL_T_SUBMIT", "CELL_T_ACK", "CELL_T_STATE", "CELL_T_SILENT", "CELL_T_OFF", "CELL_T_STILL"];

/// Compares a data list with the cell's file.
pub(super) struct DataComparison<'a> {
    pub config: &'a DataList,
    /// Names without declaration and value in the data list. They are already reported, so that their values are not
    /// reported again.
    pub missing: BTreeSet<String>,
    pub cell: &'a Cell,
    pub found: &'a mut Differences,
}

impl DataComparison<'_> {
    pub fn compare_all(&mut self) {
        for problem in &self.config.problems {
            self.found.push(Difference { file: CONFIG, problem: problem.clone() });
        }
        for stated in self.config.duplicates() {
            let key = format_variable_name(&stated.name, stated.index);
            self.note(stated.line, key, "is set twice, and the controller uses the last value; remove one");
        }
        for (key, line) in self.config.unread() {
            let message = "is not a plain number, so it was not compared, and the controller uses the last value; write the \
                           number";
            self.note(line, key, message);
        }
        let (outputs, off) = (self.compare_outputs(), self.automatic_off_outputs());
        self.check_off_outputs(&outputs, &off);
        self.compare_inputs();
        self.check_line_outputs(&outputs);
        self.check_mapped_inputs();
        self.check_flags();
        self.check_timers();
        self.compare_axes();
        self.compare_speeds();
        self.compare_workspace();
        self.compare_subroutines();
    }

    fn note(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.found.note(CONFIG, line, key, message);
    }

    /// Reports a missing value, unless the whole name is missing and already reported.
    fn note_missing_value(&mut self, line: usize, name: &str, key: impl Into<String>, message: impl Into<String>) {
        if !self.missing.contains(name) {
            self.note(line, key, message);
        }
    }

    /// Returns the number with this name. A missing number is reported.
    fn single_number(&mut self, name: &str) -> Option<Number> {
        let found = self.config.get(name);
        if found.is_none() {
            self.note_missing_value(1, name, name, "is not stated as a number, and the programs need it");
        }
        found
    }

    /// Returns the integer with this name. A value outside of the range is reported.
    fn integer_in_range(&mut self, name: &str, low: i32, high: i32) -> Option<i32> {
        let number = self.single_number(name)?;
        let whole = number.as_integer().filter(|whole| (low..=high).contains(whole));
        if whole.is_none() {
            self.note(
                number.line,
                name,
                format!("is {}, valid: a whole number from {low} to {high}", number.value),
            );
        }
        whole
    }

    /// Returns the values of an array whose number of elements is in the variable `count`, each with its line. Missing
    /// values, values outside of the range `numbers`, and values beyond the count are reported.
    fn counted_array(&mut self, array: &str, count: &str, most: i32, numbers: (i32, i32)) -> Vec<(i32, usize)> {
        let Some(places) = self.integer_in_range(count, 0, most) else { return Vec::new() };
        let stated = self.config.array(array);
        let mut all = Vec::new();
        for index in 1..=places {
            let key = format!("{array}[{index}]");
            match stated.get(&index) {
                None => self.note_missing_value(
                    self.config.get(count).map_or(1, |count| count.line),
                    array,
                    key,
                    format!(
                        "is missing, but {count} is {places}: reading the missing value would stop the submit \
                         interpreter"
                    ),
                ),
                Some(number) => match number.as_integer().filter(|whole| (numbers.0..=numbers.1).contains(whole)) {
                    Some(whole) => all.push((whole, number.line)),
                    None => {
                        let (low, high) = numbers;
                        let message = format!("is {}, valid: a whole number from {low} to {high}", number.value);
                        self.note(number.line, key, message);
                    }
                },
            }
        }
        for (index, number) in
            stated.iter().filter(|(index, number)| !(1..=places).contains(*index) && number.value != 0.0)
        {
            let message = format!(
                "is {}, but {count} is {places}, so this value has no effect; increase the count or remove the value",
                number.value
            );
            self.note(number.line, format!("{array}[{index}]"), message);
        }
        all
    }

    /// Returns the names of signals in the cell's file, by signal number.
    fn names_by_number(named: &BTreeMap<String, u16>) -> BTreeMap<i32, &str> {
        named.iter().map(|(name, number)| (i32::from(*number), name.as_str())).collect()
    }

    /// Compares an array of signals with those of the cell's file. The array must be in ascending order, because the
    /// signals are sent as bits in this order.
    fn compare_bit_array(
        &mut self,
        array: &str,
        count: &str,
        table: &str,
        named: &BTreeMap<String, u16>,
    ) -> Vec<(i32, usize)> {
        let found = self.counted_array(array, count, MAX_SIGNALS_PER_INT, (1, MAX_SIGNAL_NUMBER));
        let names = Self::names_by_number(named);
        let word = |number: i32| {
            names
                .get(&number)
                .map_or(format!("{number}, which is not in {table}"), |name| format!("{number} ({name})"))
        };
        let expected: Vec<i32> = names.keys().copied().collect();
        for (place, (number, line)) in found.iter().enumerate() {
            if expected.get(place) == Some(number) {
                continue;
            }
            let wanted = expected.get(place).map_or("nothing".to_owned(), |number| word(*number));
            let message = format!(
                "is {}, but {table} of the cell's file has {wanted} at this position (numbers in ascending order): the \
                 PC would confuse the signals",
                word(*number)
            );
            self.note(*line, format!("{array}[{}]", place + 1), message);
        }
        if let Some(stated) = self.config.get(count).filter(|stated| stated.value != expected.len() as f64) {
            let message = format!(
                "is {}, but the number of entries in {table} of the cell's file is {}",
                stated.value,
                expected.len()
            );
            self.note(stated.line, count, message);
        }
        found
    }

    fn compare_outputs(&mut self) -> Vec<(i32, usize)> {
        let cell = self.cell;
        self.compare_bit_array("CELL_OUT", "CELL_OUT_N", "[io.outputs]", cell.inputs_outputs().outputs())
    }

    fn compare_inputs(&mut self) {
        let cell = self.cell;
        self.compare_bit_array("CELL_IN", "CELL_IN_N", "[io.feedbacks]", cell.inputs_outputs().feedbacks());
    }

    /// Returns the outputs that are switched off at the end of an epoch: number, line, and delay, ms.
    fn automatic_off_outputs(&mut self) -> Vec<(i32, usize, Option<Number>)> {
        let off = self.counted_array("CELL_OFF", "CELL_OFF_N", MAX_SIGNALS_PER_INT, (1, MAX_SIGNAL_NUMBER));
        let times = self.config.array("CELL_OFF_MS");
        let places = self.config.array("CELL_OFF");
        let place = |line: usize| places.iter().find(|(_, number)| number.line == line).map(|(index, _)| *index);
        let counted = self.config.get("CELL_OFF_N").and_then(Number::as_integer).unwrap_or(0);
        let surplus = times.iter().filter(|(index, _)| **index > counted);
        let surplus: Vec<(i32, usize)> = surplus.map(|(index, number)| (*index, number.line)).collect();
        for (index, line) in surplus {
            self.note(
                line,
                format!("CELL_OFF_MS[{index}]"),
                format!("has no effect, because CELL_OFF_N is {counted}"),
            );
        }
        off.into_iter()
            .map(|(output, line)| (output, line, place(line).and_then(|index| times.get(&index).copied())))
            .collect()
    }

    /// Checks that every output that must be switched off is switched off within its time, and that no other output is
    /// switched off.
    fn check_off_outputs(&mut self, outputs: &[(i32, usize)], off: &[(i32, usize, Option<Number>)]) {
        let io = self.cell.inputs_outputs();
        let names = Self::names_by_number(io.outputs());
        let line_of_count = self.config.get("CELL_OFF_N").map_or(1, |count| count.line);
        for (name, after_s) in io.off_delays_s() {
            let Some(number) = io.outputs().get(name) else { continue };
            let number = i32::from(*number);
            let found: Vec<_> = off.iter().filter(|(output, ..)| *output == number).collect();
            let after_ms = 1_000.0 * f64::from(*after_s);
            match found.as_slice() {
                [] if *after_s == 0 => {
                    let what = if name == Output::Tool.name() { "the tool" } else { "water" };
                    let message = format!(
                        "NO STOP SWITCHES {} OFF: $OUT[{number}] ({name}) is not in CELL_OFF. At a stop, an abort or a \
                         lost link {what} would keep running. Add this output with CELL_OFF_MS 0",
                        name.to_uppercase()
                    );
                    self.note(line_of_count, "CELL_OFF", message);
                }
                [] => {
                    let message = format!(
                        "$OUT[{number}] ({name}) is not in CELL_OFF, but the cell's file switches it off after \
                         {after_s} s"
                    );
                    self.note(line_of_count, "CELL_OFF", message);
                }
                [(_, line, None), ..] => {
                    let message = format!(
                        "$OUT[{number}] ({name}) has no CELL_OFF_MS, but the cell's file switches it off after \
                         {after_s} s"
                    );
                    self.note(*line, "CELL_OFF_MS", message);
                }
                [(_, _, Some(ms)), rest @ ..] => {
                    if ms.value != after_ms {
                        let at_once = if *after_s == 0 {
                            "; TOOL AND WATER MUST BE SWITCHED OFF IMMEDIATELY (0 ms)"
                        } else {
                            ""
                        };
                        let message = format!(
                            "$OUT[{number}] ({name}) is switched off after {} ms, but [io.off_after_s] of the cell's \
                             file states {after_ms} ms{at_once}",
                            ms.value
                        );
                        self.note(ms.line, "CELL_OFF_MS", message);
                    }
                    for (_, line, _) in rest {
                        self.note(*line, "CELL_OFF", format!("$OUT[{number}] ({name}) is listed twice"));
                    }
                }
            }
        }
        for name in io.undecided() {
            let message = format!(
                "NO STOP SWITCHES {} OFF: $OUT[{}] ({name}) has no time in [io.off_after_s] of the cell's file, and \
                 [io] may_stay_on does not name it. At a stop, an abort or a lost link it would keep running. State its \
                 time there and in CELL_OFF_MS, or name it in may_stay_on",
                name.to_uppercase(),
                io.outputs().get(name).copied().unwrap_or_default()
            );
            self.note(line_of_count, "CELL_OFF", message);
        }
        for (output, line, _) in off {
            let name = names.get(output);
            if name.is_some_and(|name| io.off_delays_s().contains_key(*name)) {
                continue;
            }
            let message = match name {
                Some(name) => format!(
                    "$OUT[{output}] ({name}) would be switched off at the end of an epoch, but is not in \
                     [io.off_after_s]"
                ),
                None if outputs.iter().any(|(number, _)| number == output) => {
                    format!("$OUT[{output}] is not an output of [io.outputs]")
                }
                None => format!(
                    "$OUT[{output}] is neither in CELL_OUT nor in [io.outputs]: an output of another program would be \
                     switched off"
                ),
            };
            self.note(*line, "CELL_OFF", message);
        }
    }

    /// Checks the outputs to the production line, in their order.
    fn check_line_outputs(&mut self, outputs: &[(i32, usize)]) {
        let Some(count) = self.integer_in_range("CELL_LINE_N", LINE_OUTPUT_COUNT, LINE_OUTPUT_COUNT) else {
            return;
        };
        let expected = self.cell.inputs_outputs().line_outputs();
        let words = ["ready", "cycle_done", "pass", "fail", "review", "fault"];
        for (index, (expected, word)) in (1..=count).zip(expected.iter().zip(words)) {
            let key = format!("CELL_LINE[{index}]");
            let Some(number) = self.config.element("CELL_LINE", index) else {
                self.note_missing_value(1, "CELL_LINE", key, "is not stated; 0 if the line has none");
                continue;
            };
            if number.value != f64::from(*expected) {
                let message = format!(
                    "is {}, but [io.line_outputs] of the cell's file has {expected} for {word} (0: none)",
                    number.value
                );
                self.note(number.line, key.clone(), message);
            }
            if number.value != 0.0 && outputs.iter().any(|(output, _)| f64::from(*output) == number.value) {
                self.note(
                    number.line,
                    key,
                    format!(
                        "$OUT[{}] is also in CELL_OUT: an output that switches a device must not be a signal to the \
                         line",
                        number.value
                    ),
                );
            }
        }
    }

    /// Checks the inputs that are mapped to flags.
    fn check_mapped_inputs(&mut self) {
        let inputs = self.counted_array("CELL_VIN", "CELL_VIN_N", MAX_MAPPED_INPUTS, (1, MAX_SIGNAL_NUMBER));
        let flags = self.counted_array("CELL_VIN_FLAG", "CELL_VIN_N", MAX_MAPPED_INPUTS, (1, MAX_FLAG_NUMBER));
        let mapped: BTreeSet<i32> =
            self.cell.inputs_outputs().mapped_inputs().values().map(|number| i32::from(*number)).collect();
        let found: BTreeSet<i32> = inputs.iter().map(|(number, _)| *number).collect();
        for number in mapped.difference(&found) {
            let line = self.config.get("CELL_VIN_N").map_or(1, |count| count.line);
            self.note(
                line,
                "CELL_VIN",
                format!("does not contain input {number}, which [io.mapped_inputs] of the cell's file names"),
            );
        }
        for (number, line) in inputs.iter().filter(|(number, _)| !mapped.contains(number)) {
            self.note(*line, "CELL_VIN", format!("input {number} is not in [io.mapped_inputs] of the cell's file"));
        }
        let own: Vec<(&str, f64)> =
            FLAGS.iter().filter_map(|name| Some((*name, self.config.get(name)?.value))).collect();
        let mut seen = BTreeSet::new();
        for (flag, line) in flags {
            if let Some((name, _)) = own.iter().find(|(_, own)| *own == f64::from(flag)) {
                self.note(
                    line,
                    "CELL_VIN_FLAG",
                    format!("$FLAG[{flag}] is already used by {name}: a mapped input would set this flag"),
                );
            }
            if !seen.insert(flag) {
                self.note(line, "CELL_VIN_FLAG", format!("$FLAG[{flag}] is used for two inputs"));
            }
        }
    }

    fn check_flags(&mut self) {
        let mut seen: BTreeMap<i32, &str> = BTreeMap::new();
        for name in FLAGS {
            let Some(flag) = self.integer_in_range(name, 1, MAX_FLAG_NUMBER) else { continue };
            if let Some(first) = seen.insert(flag, name) {
                let line = self.config.get(name).map_or(1, |number| number.line);
                self.note(line, name, format!("is {flag}, which is already used by {first}"));
            }
        }
    }

    fn check_timers(&mut self) {
        let mut before: Option<(i32, &str)> = None;
        for name in TIMERS {
            let timer = self.integer_in_range(name, 1, MAX_TIMER_NUMBER);
            if let (Some((number, first)), Some(timer)) = (before, timer)
                && timer != number + 1
            {
                let line = self.config.get(name).map_or(1, |number| number.line);
                let message = format!(
                    "is {timer}, but the previous timer, {first}, is {number}: the seven timers must have consecutive \
                     numbers"
                );
                self.note(line, name, message);
            }
            before = timer.map(|timer| (timer, name));
        }
    }

    /// Compares the axis limits with those in the cell's file.
    fn compare_axes(&mut self) {
        let axes = *self.cell.arm().axes();
        for (array, expected) in [("CELL_AXIS_MIN", axes.min_deg), ("CELL_AXIS_MAX", axes.max_deg)] {
            for (index, expected) in (1..).zip(expected) {
                self.check_array_element(array, index, |found| {
                    let differs = (found - expected).abs() > REAL_ROUNDING;
                    differs.then(|| {
                        format!("is {found}°, but [arm] of the cell's file has {expected}°; make both the same")
                    })
                });
            }
        }
    }

    /// Checks one element of an array of REAL. `wrong` returns the problem of a value, if there is one.
    fn check_array_element(&mut self, array: &str, index: i32, wrong: impl FnOnce(f64) -> Option<String>) {
        let key = format!("{array}[{index}]");
        match self.config.element(array, index) {
            None => self.note_missing_value(1, array, key, "is not stated as a number, and the programs need it"),
            Some(number) => {
                if let Some(message) = wrong(number.value) {
                    self.note(number.line, key, message);
                }
            }
        }
    }

    fn compare_speeds(&mut self) {
        let cell_m_s = self.cell.limits().max_speed_mm_s() / 1_000.0;
        if let Some(number) = self.single_number("CELL_VEL_MAX") {
            let found = number.value;
            if found < cell_m_s - REAL_ROUNDING {
                let message = format!(
                    "is {found} m/s, but [limits] max_speed_mm_s of the cell's file allows {cell_m_s} m/s: the \
                     controller would refuse faster lines"
                );
                self.note(number.line, "CELL_VEL_MAX", message);
            } else if found > MAX_RATIO_TO_CELL * cell_m_s + REAL_ROUNDING {
                let message = format!(
                    "is {found} m/s, the limit is {MAX_RATIO_TO_CELL} times [limits] max_speed_mm_s of the cell's \
                     file, {} m/s: the controller must limit the speed if the PC does not",
                    MAX_RATIO_TO_CELL * cell_m_s
                );
                self.note(number.line, "CELL_VEL_MAX", message);
            }
        }
        let fastest = self.config.get("CELL_VEL_MAX").map_or(f64::INFINITY, |number| number.value);
        let planned_m_s = RETRACT_MM_S / 1_000.0;
        for (name, low, high, why) in [
            (
                "CELL_ACC_MAX",
                AIR_ACCELERATION_M_S2,
                10.0,
                "m/s²: the PC sends motions in the air with the lower one",
            ),
            ("CELL_RETRACT_MM", RETRACT_MM, RETRACT_MM, "mm: the PC plans the retract with this length"),
            (
                "CELL_RETRACT_VEL",
                planned_m_s.min(cell_m_s),
                planned_m_s.min(fastest),
                "m/s: the PC plans the retract with the higher one",
            ),
            (
                "CELL_RETRACT_ACC",
                RETRACT_M_S2,
                10.0,
                "m/s²: with less, the tool leaves the panel later than the safety concept states",
            ),
        ] {
            if let Some(number) = self.single_number(name)
                && !(number.value >= low - REAL_ROUNDING && number.value <= high + REAL_ROUNDING)
            {
                let message = format!("is {}, the limits are {low} to {high} {why}", number.value);
                self.note(number.line, name, message);
            }
        }
    }

    /// Compares the workspace and the maximum step length of linear motions.
    fn compare_workspace(&mut self) {
        let limits = self.cell.limits();
        for (array, stated, outwards) in
            [("CELL_BOX_MIN", limits.box_min_mm(), -1.0), ("CELL_BOX_MAX", limits.box_max_mm(), 1.0)]
        {
            for axis in 0..3_usize {
                let expected = stated.map(|corner| corner[axis]);
                let index = i32::try_from(axis + 1).unwrap_or(1);
                self.check_array_element(array, index, |found| {
                    let expected = expected?;
                    let beyond = outwards * (found - expected);
                    (!(-REAL_ROUNDING..=BOX_TOLERANCE_MM + REAL_ROUNDING).contains(&beyond)).then(|| {
                        format!(
                            "is {found} mm, but [limits] of the cell's file has {expected} mm; valid: 0 to \
                             {BOX_TOLERANCE_MM} mm outside of the cell's limit"
                        )
                    })
                });
            }
        }
        let step_mm = limits.max_step_mm();
        if let Some(number) = self.single_number("CELL_STEP_MM")
            && !(number.value >= step_mm - REAL_ROUNDING
                && number.value <= MAX_RATIO_TO_CELL * step_mm + REAL_ROUNDING)
        {
            let message = format!(
                "is {} mm, but [limits] max_step_mm of the cell's file is {step_mm} mm; valid: 1 to \
                 {MAX_RATIO_TO_CELL} times the cell's value",
                number.value
            );
            self.note(number.line, "CELL_STEP_MM", message);
        }
    }

    fn compare_subroutines(&mut self) {
        self.integer_in_range("CELL_USER_N", 0, 1_000);
        self.integer_in_range("CELL_USER_REVISION", 0, MAX_CHECKSUM);
    }
}
