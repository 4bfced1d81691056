//! Computes the checksum that identifies the controller's programs. It is computed from the text of the programs and
//! then from every value in use.
//!
//! `CELL_CHECKSUM` of `cell_tell.src` computes the same checksum on the controller. There, the part that belongs to the
//! text is a constant. Therefore an edit of a program on the pendant does not change the checksum that the controller
//! reports, but it changes the checksum that is computed here from the edited files. The checksum reveals a mix-up of
//! files. It does not protect against intentional manipulation; that is the task of the controller's own checksums of
//! its project and of its safety configuration.

use super::data_list::DataList;
use super::names::{CONFIG, DATA, PROGRAMS, USER, is_named};

/// The modulus of the checksum, as in the controller's programs.
const MODULUS: i64 = 1_000_003;

/// The reason why the checksum cannot be computed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SumError {
    /// A required file was not given.
    #[error("the file {0} is missing, which is part of the programs' checksum")]
    Missing(&'static str),
    /// A value is missing, or is not a number of the required type.
    #[error("{file}: {name} is missing or not a number, but this value is part of the programs' checksum")]
    Value {
        /// The file in which the value is expected.
        file: &'static str,
        /// The name of the value.
        name: String,
    },
    /// The constant in `cell_data.dat` differs from the checksum of the programs' texts.
    #[error(
        "{DATA}:{line}: CELL_PROGRAM_SUM is {stated}, but the checksum of the programs' texts is {computed}: a program \
         was edited, or is of another release"
    )]
    Edited {
        /// The line that states the checksum.
        line: usize,
        /// The checksum that the file states.
        stated: i64,
        /// The checksum of the texts.
        computed: i64,
    },
    /// CELL_USER_REVISION in `cell_config.dat` differs from the checksum of the cell's own subroutines.
    #[error(
        "{CONFIG}:{line}: CELL_USER_REVISION is {stated}, and the text of {USER} has the sum {computed}; write {computed}"
    )]
    UserEdited {
        /// The line that states the checksum.
        line: usize,
        /// The checksum that the file states.
        stated: i64,
        /// The checksum of the text.
        computed: i64,
    },
}

/// Single integers in the checksum, in this order. They come before the arrays.
const FLAGS_AND_TIMERS: [&str; 13] = [
    "CELL_F_CMD_ALIVE",
    "CELL_F_CMD_CAME",
    "CELL_F_STOP",
    "CELL_F_STAT_ALIVE",
    "CELL_F_STAT_CAME",
    "CELL_F_HALT",
    "CELL_T_HEARD",
    "CELL_T_SUBMIT",
    "CELL_T_ACK",
    "CELL_T_STATE",
    "CELL_T_SILENT",
    "CELL_T_OFF",
    "CELL_T_STILL",
];
/// Arrays of variable length in the checksum: the variable with their count, and the arrays, whose elements are added
/// in turn.
const VARIABLE_LENGTH_ARRAYS: [(&str, &[&str]); 5] = [
    ("CELL_OUT_N", &["CELL_OUT"]),
    ("CELL_OFF_N", &["CELL_OFF", "CELL_OFF_MS"]),
    ("CELL_IN_N", &["CELL_IN"]),
    ("CELL_LINE_N", &["CELL_LINE"]),
    ("CELL_VIN_N", &["CELL_VIN", "CELL_VIN_FLAG"]),
];
/// Arrays of REAL with a fixed length; the elements of the two arrays in a pair are added in turn.
const REAL_ARRAYS: [(i32, [&str; 2]); 2] =
    [(6, ["CELL_AXIS_MIN", "CELL_AXIS_MAX"]), (3, ["CELL_BOX_MIN", "CELL_BOX_MAX"])];
/// Single numbers of type REAL in the checksum.
const REAL_VALUES: [&str; 6] =
    ["CELL_STEP_MM", "CELL_VEL_MAX", "CELL_ACC_MAX", "CELL_RETRACT_MM", "CELL_RETRACT_VEL", "CELL_RETRACT_ACC"];
/// Values for the cell's own subroutines: their number, and the checksum of their text.
const SUBROUTINE_VALUES: [&str; 2] = ["CELL_USER_N", "CELL_USER_REVISION"];

/// Computes the checksum that a controller with these files reports as `St/@Sum`. File names are without folder, in
/// upper or lower case.
///
/// # Errors
/// If a file or a value is missing, or if a stated checksum differs from that of the text.
pub fn program_sum(files: &[(&str, &str)]) -> Result<i32, SumError> {
    let find = |name: &'static str| {
        let named = files.iter().find(|(file, _)| is_named(file, name));
        named.map(|(_, text)| *text).ok_or(SumError::Missing(name))
    };
    let texts = PROGRAMS.iter().map(|name| find(name)).collect::<Result<Vec<_>, _>>()?;
    let data = DataList::parse(DATA, find(DATA)?);
    let computed = checksum_of_texts(&texts);
    let stated = data.get("CELL_PROGRAM_SUM");
    let stated = stated.ok_or_else(|| SumError::Value { file: DATA, name: "CELL_PROGRAM_SUM".to_owned() })?;
    if stated.value != computed as f64 {
        return Err(SumError::Edited { line: stated.line, stated: stated.value as i64, computed });
    }
    let config = DataList::parse(CONFIG, find(CONFIG)?);
    let user = text_sum(find(USER)?);
    match config.get(SUBROUTINE_VALUES[1]) {
        Some(stated) if stated.value != user as f64 => {
            Err(SumError::UserEdited { line: stated.line, stated: stated.value as i64, computed: user })
        }
        _ => checksum_of_values(computed, &config),
    }
}

/// Computes the checksum of texts: for each byte, the previous checksum times 31 plus the byte. Line ends, headers and
/// the line that states the checksum are skipped, because KSS writes its own line ends and increments the revision in a
/// header.
fn checksum_of_texts(texts: &[&str]) -> i64 {
    let counts = |line: &&str| !line.contains("CELL_PROGRAM_SUM=") && !line.starts_with('&');
    texts
        .iter()
        .flat_map(|text| text.lines())
        .filter(counts)
        .flat_map(str::bytes)
        .fold(0, |sum, byte| (sum * 31 + i64::from(byte)) % MODULUS)
}

/// Computes the checksum of one text, such as CELL_USER_REVISION for the cell's own subroutines.
pub(super) fn text_sum(text: &str) -> i64 {
    checksum_of_texts(&[text])
}

fn checksum_of_values(programs: i64, config: &DataList) -> Result<i32, SumError> {
    let lacks = |name: &str| SumError::Value { file: CONFIG, name: name.to_owned() };
    let single = |name: &str| config.get(name).ok_or_else(|| lacks(name));
    let whole = |name: &str| single(name)?.as_integer().ok_or_else(|| lacks(name));
    let at = |name: &str, index: i32| config.element(name, index).ok_or_else(|| lacks(&format!("{name}[{index}]")));
    let mut sum = ChecksumMixer(programs);
    for name in FLAGS_AND_TIMERS {
        sum.add_integer(whole(name)?);
    }
    for (count, arrays) in VARIABLE_LENGTH_ARRAYS {
        let places = whole(count)?;
        sum.add_integer(places);
        for index in 1..=places {
            for array in arrays {
                sum.add_integer(at(array, index)?.as_integer().ok_or_else(|| lacks(array))?);
            }
        }
    }
    for (places, arrays) in REAL_ARRAYS {
        for index in 1..=places {
            for array in arrays {
                sum.add_real(at(array, index)?.value);
            }
        }
    }
    for name in REAL_VALUES {
        sum.add_real(single(name)?.value);
    }
    for name in SUBROUTINE_VALUES {
        sum.add_integer(whole(name)?);
    }
    i32::try_from(sum.0).map_err(|_| lacks("CELL_SUM"))
}

/// Computes the checksum of values like `CELL_MIX` and `CELL_MIX_REAL` on the controller.
struct ChecksumMixer(i64);

impl ChecksumMixer {
    fn add_integer(&mut self, value: i32) {
        let mixed = self.0 * 31 + i64::from(value) + MODULUS;
        self.0 = mixed - (mixed / MODULUS) * MODULUS;
    }

    /// Adds a REAL in thousandths, rounded to the nearest integer, as KRL does when it assigns a 32-bit REAL to an INT.
    fn add_real(&mut self, value: f64) {
        self.add_integer((value as f32 * 1_000.0).round() as i32);
    }
}

/// Returns the names of all values in the checksum; a test compares them with the controller's programs.
#[cfg(test)]
pub(super) fn checksum_value_names() -> std::collections::BTreeSet<&'static str> {
    let lists = VARIABLE_LENGTH_ARRAYS
        .iter()
        .flat_map(|(count, arrays)| std::iter::once(*count).chain(arrays.iter().copied()));
    let reals = REAL_ARRAYS.iter().flat_map(|(_, arrays)| arrays.iter().copied());
    FLAGS_AND_TIMERS.into_iter().chain(lists).chain(reals).chain(REAL_VALUES).chain(SUBROUTINE_VALUES).collect()
}
