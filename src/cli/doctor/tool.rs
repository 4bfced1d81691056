//! Checks the compliant tool: whether it answers and reports no fault. The tool is held back, and nothing is pressed.

use super::check::Check;
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::cell::{Cell, CompliantTool};
use panelprep_cell::force::{LinkLossCause, ToolReading, not_ready_reason};
use panelprep_devices::acf::{AcfLink, ConnectedTool as _, ToolReport};
use std::time::{Duration, Instant};

const NAME: &str = "compliant tool";
/// Time limit for the tool to answer and to move back.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(3);

/// Checks the tool of a cell; `None` if it is a spring. `served` states that the service runs and holds the tool.
pub(super) fn check_tool(cell: &Cell, served: bool) -> Option<Check> {
    let tool = cell.tool().compliant()?;
    Some(match &tool.address {
        None => Check::passed(NAME, "simulated: the tool presses on the simulated panel"),
        Some(_) if served => {
            Check::passed(NAME, "in use by the service, which reports at a reset whether the tool is ready")
        }
        Some(address) => match AcfLink::start(tool, address) {
            Ok(link) => wait_until_ready(tool, link),
            Err(error) => {
                Check::failed(NAME, error.to_string(), "end the programs that use up the computer's threads")
            }
        },
    })
}

/// Waits until the tool is ready, up to the time limit.
fn wait_until_ready(tool: &CompliantTool, mut link: AcfLink) -> Check {
    let began = Instant::now();
    let (mut last, mut lost): (Option<ToolReading>, Option<LinkLossCause>) = (None, None);
    while began.elapsed() < RESPONSE_TIMEOUT {
        match link.next_report() {
            Some(ToolReport::Reading { reading, .. }) => (last, lost) = (Some(reading), None),
            Some(ToolReport::Lost(loss)) => lost = Some(loss),
            None => std::thread::sleep(Duration::from_millis(5)),
        }
        if last.is_some_and(|reading| not_ready_reason(&reading, tool.stroke_mm).is_none()) {
            break;
        }
    }
    describe_tool_state(tool, last, lost)
}

/// Describes the tool's state in words.
fn describe_tool_state(tool: &CompliantTool, last: Option<ToolReading>, lost: Option<LinkLossCause>) -> Check {
    let place =
        tool.address.as_ref().map_or(String::new(), |address| format!("{}, port {}", address.host, address.port));
    let Some(reading) = last.filter(|_| lost.is_none()) else {
        let why = lost.map_or("the tool does not answer".to_owned(), |loss| loss.to_string());
        let advice = "check the tool's power, cable and address (`ping`), end other programs that are connected to the \
                      tool, and compare [tool] with the tool's settings";
        return Check::failed(NAME, format!("{place}: {why}"), advice);
    };
    let says = format!(
        "{place}: responds; force {} N, extended {} mm of {} mm",
        fixed_decimals(reading.force_n, 1),
        fixed_decimals(reading.position_mm, 1),
        fixed_decimals(tool.stroke_mm, 1)
    );
    match not_ready_reason(&reading, tool.stroke_mm) {
        None => Check::passed(NAME, says),
        Some(why) => Check::failed(
            NAME,
            format!("{says}; {}", why.message),
            "correct the reported problem; until then, no cycle starts",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_devices::acf::{MockAcfServer, ToolFault};

    fn cell(port: u16) -> Cell {
        let text = format!(
            "[tool]\nkind = 'acf'\nhost = '127.0.0.1'\ntcp_port = {port}\nstroke_mm = 30\nmin_force_n = -60\nmax_force_n = 100\n\
             payload_kg = 1.5\n"
        );
        Cell::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"))
    }

    /// A spring is not checked. A tool that answers passes; one that is broken or missing is reported with
    /// advice.
    #[test]
    fn the_tool_is_looked_at() {
        let spring = Cell::check("f", "").unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(check_tool(&spring, false), None);
        let tool = cell(1);
        let server = MockAcfServer::start(tool.tool().compliant().expect("one"), 15.0).expect("a port");
        let there = cell(server.address().port());
        let right = check_tool(&there, false).expect("looked at");
        assert!(
            right.is_passed() && right.found.contains("responds; force") && right.found.contains("of 30.0 mm"),
            "{right:?}"
        );
        assert!(
            check_tool(&there, true)
                .is_some_and(|check| check.is_passed() && check.found.contains("in use by the service"))
        );
        server.set_fault(Some(ToolFault::Errors(2)));
        let wrong = check_tool(&there, false).expect("looked at");
        assert!(!wrong.is_passed() && wrong.found.contains("its sensor has an error"), "{wrong:?}");
        drop(server);
        let away = check_tool(&there, false).expect("looked at");
        assert!(
            !away.is_passed() && away.found.contains("the connection failed") && away.advice.contains("ping"),
            "{away:?}"
        );
    }
}
