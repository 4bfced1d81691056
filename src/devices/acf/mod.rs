//! The compliant tool (a FerRobotics ACF over TCP), and a mock of it in this program.
//!
//! - `tool`: the interface of a compliant tool for the control loop: commands and reports
//! - `link`: the connection to a real tool, in its own thread; received reports are read without waiting
//! - `mock`: a simulated tool with injected faults, some of which begin during a path; it can also listen on a TCP
//!   port, for tests of the link
//! - `simulated`: session and mock in the time of the simulated world
//!
//! **The driver has not been tested with a real tool yet.** To be tested on site: that the tool echoes the log-in word,
//! what the tool does when its connection is lost, and that its force agrees with a scale.

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
    //! Tests the link over a real socket with each injected fault, and the mock's actuator against values calculated by
    //! hand.

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

    /// Waits up to four seconds for the expected report; returns the report and the waiting time.
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

    /// After a force is commanded, the tool presses with it, and the client receives its measured force and position.
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

    /// Each injected fault of the link is reported by its name within the reply timeout plus the delay of a busy
    /// computer. Then the connection is opened again.
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

    /// Expected values, calculated by hand: at 250 mm/s the actuator needs 60 ms to extend by 15 mm. Then it presses
    /// with 20 N. If it points down, the weight of its 1.5 kg is added: 34.7 N.
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
        // The sensor measures the force of the actuator, without the weight.
        assert!((mock.sensor_n - 20.0).abs() <= 0.2, "{}", mock.sensor_n);
        mock.set_fault(Some(ToolFault::ForceOff(12.0)));
        mock.advance(at(90, 0.0));
        assert!((mock.sensor_n - 32.0).abs() <= 0.2, "{}", mock.sensor_n);
        mock.advance(ToolSurroundings { time_ms: 100, contact_extension_mm: -2.0, downwards: 0.0 });
        assert!(mock.position_mm() == 0.0 && mock.sensor_n > 100.0, "pushed against its stop");
    }
}
