//! `[line]`: the handshake with a line by digital signals. It is off until `[line]` is present.

use super::line_signal::LineSignal;
use super::names::InputsOutputs;
use panelprep_base::config::Section;
use std::path::{Path, PathBuf};
use strum::VariantArray;

/// The inputs that the line sets, by their names in `[io.feedbacks]`.
pub const LINE_INPUTS: [&str; 2] = ["part_present", "start_request"];

/// The data for a cycle that the line requests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// The recipe's file.
    pub recipe: PathBuf,
    /// The part's serial number, if each part has the same one.
    pub serial: Option<String>,
    /// Its work order.
    pub order: Option<String>,
    /// The responsible person, who is named as the operator.
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
    fn it_is_off_until_the_table_is_there() {
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
