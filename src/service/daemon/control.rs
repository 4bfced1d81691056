//! Single point of control: a selector switch at the cell determines which side may command the cell (ISO 10218-2).
//!
//! The input `local_control` of `[io.feedbacks]` is on while the switch is in the position local. Stop, Abort and Hold
//! are accepted from every side. Clear, Unhold, Accept, and the first Start after a start of the program or after a
//! Clear require a person at the cell: they are accepted only with the switch at local, and only from the page, the
//! socket or a command. Every other request that starts something is accepted only from the selected side. A cell
//! without this input has no selection: every interface may command the cell within the permissions of its accounts.

use crate::setup::is_input_on;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::Request;
use panelprep_cell::record::RequestSource;
use panelprep_kuka::eki::State;

/// The state of the selector switch, and whether a person at the cell has started the first cycle.
#[derive(Debug, Default)]
pub(super) struct Control {
    /// The switch's bit in `In` of the state message.
    bit: Option<u32>,
    /// Whether a person at the cell has started a cycle since the start of the program and since the last Clear.
    is_started: bool,
}

impl Control {
    /// Creates the control. `bit` is the switch's bit of `In` in the state message; `None` if the cell has no switch.
    pub fn new(bit: Option<u32>) -> Self {
        Control { bit, is_started: false }
    }

    /// Returns the reason why a request from this interface is refused; `None` if it is accepted.
    pub fn refusal(&self, request: Request, front: RequestSource, state: Option<&State>) -> Option<Reason> {
        let bit = self.bit?;
        if matches!(request, Request::Stop | Request::Abort | Request::Hold) {
            return None;
        }
        let Some(state) = state else {
            let message = "without a connection to the controller the selector switch cannot be read: only stop, \
                           abort and hold are accepted";
            return Some(Reason::new("control_unknown", message));
        };
        let (is_local, is_at_cell) = (is_input_on(state, bit), is_local_request(front));
        let starts = matches!(request, Request::Start { .. } | Request::AirRun { .. });
        let needs_person = request.is_operator_decision() || (starts && !self.is_started);
        let (selected, other) = if is_local { ("local", "remote") } else { ("remote", "local") };
        if needs_person && !(is_local && is_at_cell) {
            let message = format!(
                "this request is accepted only from a person at the cell, with the selector switch at local (now \
                 {selected}). Set the switch to local, look at the cell, then repeat the request on the page or \
                 with `panelprep ctl`"
            );
            return Some(Reason::new("local_control", message));
        }
        (is_local != is_at_cell).then(|| {
            let message = format!(
                "the selector switch is set to {selected}, but the request came from the {other} side; set the \
                 switch to {other}"
            );
            Reason::new("not_selected", message)
        })
    }

    /// Updates the state after an accepted request. After the first Start, the selected side may start; after a Clear,
    /// the next Start is treated as the first Start.
    pub fn on_request_accepted(&mut self, request: Request) {
        match request {
            Request::Start { .. } | Request::AirRun { .. } => self.is_started = true,
            Request::Clear => self.is_started = false,
            _ => {}
        }
    }
}

/// Returns whether a request from this interface may come from a person at the cell. The page and the socket can also
/// be used from elsewhere; therefore the switch, which a person at the cell sets, limits the requests further.
fn is_local_request(front: RequestSource) -> bool {
    match front {
        RequestSource::Socket
        | RequestSource::Page
        | RequestSource::Command
        | RequestSource::Signal
        | RequestSource::Program => true,
        RequestSource::OpcUa | RequestSource::Sparkplug | RequestSource::Line => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    const START: Request = Request::Start { max_passes: 1, max_moves: 1, dries: false };

    fn refused(control: &Control, request: Request, front: RequestSource, is_local: bool) -> Option<String> {
        let state = State { inputs: u32::from(is_local), ..crate::daemon::tests::standing_state() };
        control.refusal(request, front, Some(&state)).map(|reason| reason.code.to_string())
    }

    #[test]
    fn decisions_and_the_first_start_need_a_person_at_the_cell() {
        let mut control = Control::new(Some(0));
        for request in [Request::Clear, Request::Unhold { dried: false }, Request::Accept, START] {
            for (front, is_local, is_taken) in [
                (RequestSource::Page, true, true),
                (RequestSource::Page, false, false),
                (RequestSource::OpcUa, true, false),
                (RequestSource::OpcUa, false, false),
            ] {
                let code = refused(&control, request, front, is_local);
                assert_eq!(
                    code.as_deref(),
                    (!is_taken).then_some("local_control"),
                    "{request:?} {front:?} {is_local}"
                );
            }
        }
        control.on_request_accepted(START);
        // After the first Start, only the selected side may start.
        assert_eq!(refused(&control, START, RequestSource::Line, false), None);
        assert_eq!(refused(&control, START, RequestSource::Line, true).as_deref(), Some("not_selected"));
        assert_eq!(refused(&control, START, RequestSource::Page, false).as_deref(), Some("not_selected"));
        control.on_request_accepted(Request::Clear);
        assert_eq!(refused(&control, START, RequestSource::Line, false).as_deref(), Some("local_control"));
    }

    #[test]
    fn stop_requests_are_accepted_from_every_side() {
        let control = Control::new(Some(0));
        for request in [Request::Stop, Request::Abort, Request::Hold] {
            for front in [RequestSource::Socket, RequestSource::OpcUa, RequestSource::Line] {
                assert_eq!(
                    refused(&control, request, front, true).or(refused(&control, request, front, false)),
                    None
                );
                assert_eq!(control.refusal(request, front, None), None);
            }
        }
        let unknown = control.refusal(START, RequestSource::Page, None).expect("the controller is not there");
        assert_eq!(unknown.code, "control_unknown");
        assert_eq!(
            refused(&Control::default(), Request::Clear, RequestSource::OpcUa, false),
            None,
            "a cell without a switch"
        );
    }
}
