//! The compliant tool: a FerRobotics ACF over TCP, and a mock of this tool inside the program.
//!
//! - `tool`: a compliant tool as the loop uses it, its commands and its reports
//! - `link`: a thread of its own that keeps the session; its received data is read without waiting
//! - `mock`: a simulated tool, bytes in and bytes out, with faults, some of which begin during a path; its stroke ends
//!   when the disc touches; and the same tool behind a TCP port, for tests of the link
//! - `simulated`: session and mock in the time of the simulated world
//!
//! **The driver has not run on a real tool yet.** To be proven on site: that the log-in word is echoed, what the tool
//! does automatically when its link is cut, and that its force agrees with a scale.

mod link;
mod mock;
mod simulated;
mod tool;

pub use link::{AcfLink, AcfStartError};
pub use mock::{MockAcf, MockAcfServer, PlannedToolFault, PlannedToolFaultError, ToolFault, ToolSurroundings};
pub use simulated::{SimulatedAcf, SimulatedPanel, Surroundings};
pub use tool::{ConnectedTool, ToolReport, session_limits};

#[cfg(test)]
mod tests {
    //! The link over a real socket, with each fault; and the mock's actuator, calculated by hand.

    use super::*;
    use panelprep_cell::cell::{Cell, CompliantTool, ToolAddress};
    use panelprep_cell::force::ForceSetPoint;
    use std::time::{Duration, Instant};

    fn tool() -> CompliantTool {
        let cell = Cell::check("f", "[tool]\nkind = 'simulated'").unwrap_or_else(|problems| panic!("{problems}"));
        cell.tool().compliant().expect("compliant").clone()
    }

    fn started(server: &MockAcfServer) -> AcfLink {
        let address = ToolAddress { host: "127.0.0.1".to_owned(), port: server.address().port() };
        AcfLink::start(&tool(), &address).expect("a thread")
    }

    /// Returns the expected report if it arrives within four seconds, and the time until then.
    fn wait(link: &mut AcfLink, wanted: impl Fn(&ToolReport) -> bool) -> (ToolReport, Duration) {
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(4) {
            match link.next_report().filter(&wanted) {
                Some(news) => return (news, began.elapsed()),
                None => std::thread::sleep(Duration::from_millis(1)),
            }
        }
        panic!("nothing came");
    }

    /// After a command to press, the tool presses, and its force and position are read back.
    #[test]
    fn a_tool_over_a_socket_presses_as_commanded() {
        let server = MockAcfServer::start(&tool(), 15.0).expect("a port");
        let mut link = started(&server);
        let held = |news: &ToolReport| matches!(news, ToolReport::Reading { reading, .. } if !reading.contact);
        wait(&mut link, held);
        link.set_force(ForceSetPoint { force_n: 20.0, no_contact_n: 5.0, ramp_s: 0.1 });
        let pressed = |news: &ToolReport| matches!(news, ToolReport::Reading { reading, .. } if (reading.force_n - 20.0).abs() < 0.5);
        let (news, _) = wait(&mut link, pressed);
        let ToolReport::Reading { reading, age_ms } = news else { panic!("{news:?}") };
        assert!(
            reading.contact && (reading.position_mm - 15.0).abs() < 0.1 && age_ms < 200,
            "{reading:?} {age_ms}"
        );
    }

    /// Each fault of the link is reported by its name within the reply's deadline and the delay of a busy machine; then
    /// the link is established again.
    #[test]
    fn each_fault_of_the_link_is_reported_and_the_link_restored() {
        let server = MockAcfServer::start(&tool(), 15.0).expect("a port");
        let mut link = started(&server);
        let reads = |news: &ToolReport| matches!(news, ToolReport::Reading { .. });
        for (fault, word) in [
            (ToolFault::LinkCut, "closed"),
            (ToolFault::Silent, "has not replied for 1"),
            (ToolFault::Late(140), "has not replied for 1"),
            (ToolFault::Garbage, "reply is not valid"),
            (ToolFault::OtherId, "id 1041 replied"),
        ] {
            server.set_fault(None);
            wait(&mut link, reads);
            server.set_fault(Some(fault));
            let (news, took) = wait(&mut link, |news| matches!(news, ToolReport::Lost(_)));
            let ToolReport::Lost(loss) = news else { panic!("{news:?}") };
            assert!(loss.to_string().contains(word), "{fault}: {loss}");
            assert!(took < Duration::from_millis(400), "{fault} took {took:?}");
        }
        server.set_fault(None);
        wait(&mut link, reads);
    }

    /// Calculated by hand: at 250 mm/s, the actuator needs 60 ms to extend by 15 mm; then it presses with 20 N and, if it
    /// points down, additionally with its 1.5 kg: 34.7 N.
    #[test]
    fn the_mocks_actuator_extends_until_contact() {
        let mut mock = MockAcf::new(&tool());
        mock.receive(b"ferbak1040 20.00 20.00 0.000 0.000 0k", 0);
        let at = |time_ms, downwards| ToolSurroundings { time_ms, contact_extension_mm: 15.0, downwards };
        mock.advance(at(0, 0.0));
        mock.advance(at(30, 0.0));
        assert!((mock.position_mm() - 7.5).abs() < 1e-9 && !mock.contact);
        mock.advance(at(70, 0.0));
        assert!((mock.position_mm() - 15.0).abs() < 1e-9 && mock.contact);
        mock.advance(at(80, 1.0));
        // The sensor reports the actuator's force.
        assert!((mock.sensor_n - 20.0).abs() <= 0.2, "{}", mock.sensor_n);
        mock.set_fault(Some(ToolFault::ForceOff(12.0)));
        mock.advance(at(90, 0.0));
        assert!((mock.sensor_n - 32.0).abs() <= 0.2, "{}", mock.sensor_n);
        mock.advance(ToolSurroundings { time_ms: 100, contact_extension_mm: -2.0, downwards: 0.0 });
        assert!(mock.position_mm() == 0.0 && mock.sensor_n > 100.0, "pushed against its stop");
    }
}
