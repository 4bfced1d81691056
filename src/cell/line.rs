//! The handshake with a production line by digital signals, for lines without OPC UA: when the line requests a start,
//! and the signals to the line.
//!
//! The line sets two inputs of the robot controller, `part_present` and `start_request`, and reads the outputs `ready`,
//! `cycle_done`, `pass`, `fail`, `review` and `fault`. `line_signals` defines which outputs are on in each state of the
//! cell. [`Handshake`] decides when the line makes a request: at a rising edge after an observed low level, never at a
//! high level alone. The line requests a start and, after the part was removed, a reset. The same checks apply as to
//! the requests of a person. All functions are pure; `daemon/line` exchanges the signals over the robot link.

use crate::cell::LineSignal;
use panelprep_base::verdict::Verdict;

/// The inputs that the line sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LineInputs {
    /// Whether a part is in the fixture.
    pub part_present: bool,
    /// Whether the line requests a cycle.
    pub start_request: bool,
}

/// The part of the cell's state that the signals to the line depend on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellStatus {
    /// The PackML name of the cell's state.
    pub state: String,
    /// Whether a person must decide about a result.
    pub is_review: bool,
    /// The verdict of the last cycle.
    pub verdict: Option<Verdict>,
}

/// A set of signals to the line, as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LineSignals(pub u32);

impl LineSignals {
    /// Creates the set in which exactly these signals are on.
    pub fn from_signals(signals: &[LineSignal]) -> Self {
        LineSignals(signals.iter().fold(0, |bits, signal| bits | signal.bit()))
    }

    /// Returns whether the signal is on.
    pub fn is_on(self, signal: LineSignal) -> bool {
        self.0 & signal.bit() != 0
    }
}

/// Returns the signals to the line. If the cell's control loop does not reply, only `fault` is on, because a person is
/// needed.
pub fn line_signals(cell: Option<&CellStatus>) -> LineSignals {
    use LineSignal::{CycleDone, Fail, Fault, Pass, Ready, Review};
    let Some(cell) = cell else { return LineSignals::from_signals(&[Fault]) };
    match (cell.state.as_str(), cell.verdict) {
        ("idle", _) => LineSignals::from_signals(&[Ready]),
        ("complete", Some(Verdict::Pass)) => LineSignals::from_signals(&[CycleDone, Pass]),
        ("complete", Some(_)) => LineSignals::from_signals(&[CycleDone, Fail]),
        // Without a verdict the line must not continue.
        ("complete", None) => LineSignals::from_signals(&[Fault]),
        ("held", _) if cell.is_review => LineSignals::from_signals(&[Review]),
        ("starting" | "execute" | "completing" | "resetting" | "unholding" | "holding" | "stopping", _) => {
            LineSignals(0)
        }
        // Stopped, held because of a fault, or aborted: a person is needed.
        _ => LineSignals::from_signals(&[Fault]),
    }
}

/// Number of equal consecutive observations at which an observation becomes valid, so that a bouncing contact makes no
/// request.
const MIN_EQUAL_OBSERVATIONS: u8 = 2;

/// A request of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineRequest {
    /// A cycle with the recipe and the part that the cell's file states.
    Start,
    /// A reset after the part was removed.
    Reset,
}

/// The line and the cell at one moment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineObservation {
    /// The inputs that the line sets; `None` if no state message is received from the controller.
    pub inputs: Option<LineInputs>,
    /// The state of the cell; `None` if the control loop does not reply.
    pub cell: Option<CellStatus>,
}

/// The state of the handshake.
///
/// A start is requested if two events follow each other without an interruption of the link: first, the cell is idle
/// and the request is low; then the request becomes high while the part is present and the cell is still idle. A
/// request that was already high when the program started, when the link was restored, or when the cell became idle has
/// no effect until it has been low.
#[derive(Debug, Clone, Default)]
pub struct Handshake {
    /// Whether the request was low since the cell became idle.
    is_armed: bool,
    /// Whether the part was present after its cycle.
    saw_part: bool,
    /// The last request, if it was refused and `fault` is still signalled for it.
    refused: Option<LineRequest>,
    /// The last observation, and how many times in succession it was made.
    steady: Option<(LineObservation, u8)>,
}

impl Handshake {
    /// Evaluates an observation, and returns the request that the line makes with it.
    pub fn evaluate(&mut self, look: LineObservation) -> Option<LineRequest> {
        let count = match &self.steady {
            Some((before, count)) if *before == look => count.saturating_add(1),
            _ => 1,
        };
        self.steady = Some((look.clone(), count));
        let (Some(inputs), Some(cell)) = (look.inputs, look.cell) else {
            // Edges and removed parts cannot be observed while the link is interrupted.
            (self.is_armed, self.saw_part) = (false, false);
            return None;
        };
        // The cell's state does not bounce, so a change of it is valid immediately.
        self.is_armed &= cell.state == "idle";
        self.saw_part &= cell.state == "complete";
        match cell.state.as_str() {
            _ if count < MIN_EQUAL_OBSERVATIONS => None,
            "idle" => self.on_idle(inputs),
            "complete" => self.complete(inputs),
            _ => None,
        }
    }

    /// Records that a request was refused. The line receives `fault`: after a refused start until its request is low,
    /// after a refused reset until a person has reset the cell, because the part was already removed and no further
    /// request follows.
    pub fn refused(&mut self, request: LineRequest) {
        self.refused = Some(request);
    }

    /// Returns the present signals to the line.
    pub fn output_signals(&mut self, look: &LineObservation) -> LineSignals {
        let is_over = match self.refused {
            Some(LineRequest::Start) => look.inputs.is_some_and(|inputs| !inputs.start_request),
            Some(LineRequest::Reset) => look.cell.as_ref().is_some_and(|cell| cell.state != "complete"),
            None => true,
        };
        if !is_over {
            return LineSignals::from_signals(&[LineSignal::Fault]);
        }
        self.refused = None;
        line_signals(look.cell.as_ref())
    }

    fn on_idle(&mut self, inputs: LineInputs) -> Option<LineRequest> {
        if !inputs.start_request {
            self.is_armed = true;
            return None;
        }
        // Each edge makes at most one request. Without a part it has no effect, even if a part arrives later.
        let was_armed = std::mem::take(&mut self.is_armed);
        (was_armed && inputs.part_present).then_some(LineRequest::Start)
    }

    fn complete(&mut self, inputs: LineInputs) -> Option<LineRequest> {
        if inputs.part_present {
            self.saw_part = true;
            return None;
        }
        if !self.saw_part || inputs.start_request {
            return None;
        }
        self.saw_part = false;
        Some(LineRequest::Reset)
    }
}

#[cfg(test)]
mod tests {
    //! Tests of the handshake without a controller: edges, levels, interruptions of the link, and the signals to the
    //! line.

    use super::*;
    use crate::cell::LineSignal;
    use panelprep_base::verdict::Verdict;
    use proptest::prelude::*;
    use strum::VariantArray;

    const STATES: [&str; 14] = [
        "idle",
        "complete",
        "held",
        "stopped",
        "aborted",
        "execute",
        "starting",
        "completing",
        "resetting",
        "unholding",
        "holding",
        "stopping",
        "aborting",
        "clearing",
    ];

    fn look(state: &str, part_present: bool, start_request: bool) -> LineObservation {
        let cell = CellStatus { state: state.to_owned(), is_review: false, verdict: Some(Verdict::Pass) };
        LineObservation { inputs: Some(LineInputs { part_present, start_request }), cell: Some(cell) }
    }

    /// Makes each observation three times in succession, and returns the requests.
    fn asked(handshake: &mut Handshake, looks: &[LineObservation]) -> Vec<LineRequest> {
        looks
            .iter()
            .flat_map(|look| std::iter::repeat_n(look, 3))
            .filter_map(|look| handshake.evaluate(look.clone()))
            .collect()
    }

    #[test]
    fn an_edge_requests_one_start_and_the_removed_part_a_reset() {
        let mut handshake = Handshake::default();
        let cycle = [
            look("idle", false, false),
            look("idle", true, false),
            look("idle", true, true),
            look("idle", true, true),
            look("starting", true, true),
            look("execute", true, false),
            look("complete", true, false),
            look("complete", false, false),
            look("resetting", false, false),
            look("idle", false, false),
        ];
        for _ in 0..2 {
            assert_eq!(asked(&mut handshake, &cycle), [LineRequest::Start, LineRequest::Reset]);
        }
    }

    /// A request that is already high when the program starts, when the cell becomes idle, or when the link is restored
    /// has no effect.
    #[test]
    fn a_level_makes_no_request() {
        let high = look("idle", true, true);
        let gone = LineObservation { inputs: None, ..high.clone() };
        let silent = LineObservation { cell: None, ..high.clone() };
        assert_eq!(asked(&mut Handshake::default(), std::slice::from_ref(&high)), []);
        for before in [look("complete", true, true), look("stopped", true, false), gone, silent] {
            let mut handshake = Handshake::default();
            asked(&mut handshake, &[look("idle", true, false), before.clone(), high.clone()]);
            assert_eq!(asked(&mut handshake, &[look("idle", true, false), before, high.clone()]), []);
            assert_eq!(
                asked(&mut handshake, &[look("idle", true, false), high.clone()]),
                [LineRequest::Start],
                "after it was low"
            );
        }
    }

    #[test]
    fn without_a_part_no_start_is_requested_even_if_one_comes_later() {
        let mut handshake = Handshake::default();
        let looks = [look("idle", false, false), look("idle", false, true), look("idle", true, true)];
        assert_eq!(asked(&mut handshake, &looks), []);
    }

    #[test]
    fn a_bouncing_contact_makes_no_request() {
        let mut handshake = Handshake::default();
        asked(&mut handshake, &[look("idle", true, false)]);
        for _ in 0..20 {
            assert_eq!(handshake.evaluate(look("idle", true, true)), None);
            assert_eq!(handshake.evaluate(look("idle", true, false)), None);
        }
        assert_eq!(asked(&mut handshake, &[look("idle", true, true)]), [LineRequest::Start]);
    }

    /// A reset is requested only if the part was present after the cycle and was then removed, and the start request is
    /// low.
    #[test]
    fn a_reset_needs_a_part_that_was_removed() {
        let mut handshake = Handshake::default();
        assert_eq!(asked(&mut handshake, &[look("complete", false, false)]), [], "it never saw the part");
        let kept = [look("complete", true, true), look("complete", false, true)];
        assert_eq!(asked(&mut handshake, &kept), [], "the line still asks");
        assert_eq!(asked(&mut handshake, &[look("complete", false, false)]), [LineRequest::Reset]);
        for state in STATES.iter().filter(|state| **state != "complete") {
            let mut handshake = Handshake::default();
            let looks = [look(state, true, false), look(state, false, false)];
            assert_eq!(asked(&mut handshake, &looks), [], "{state}");
        }
    }

    /// `fault` is on after a refused start until the line withdraws its request, and after a refused reset until a
    /// person has reset the cell.
    #[test]
    fn a_refusal_is_reported() {
        let mut handshake = Handshake::default();
        let (low, high) = (look("idle", true, false), look("idle", true, true));
        assert_eq!(handshake.output_signals(&high), LineSignals::from_signals(&[LineSignal::Ready]));
        handshake.refused(LineRequest::Start);
        for _ in 0..3 {
            assert_eq!(handshake.output_signals(&high), LineSignals::from_signals(&[LineSignal::Fault]));
        }
        assert_eq!(handshake.output_signals(&low), LineSignals::from_signals(&[LineSignal::Ready]));
        assert_eq!(
            handshake.output_signals(&high),
            LineSignals::from_signals(&[LineSignal::Ready]),
            "it was taken back"
        );
        handshake.refused(LineRequest::Reset);
        let silent = LineObservation { cell: None, ..low.clone() };
        for look in
            [look("complete", false, false), look("complete", true, true), silent, look("complete", false, false)]
        {
            assert_eq!(handshake.output_signals(&look), LineSignals::from_signals(&[LineSignal::Fault]));
        }
        assert_eq!(handshake.output_signals(&look("resetting", false, false)), LineSignals(0));
        assert_eq!(handshake.output_signals(&low), LineSignals::from_signals(&[LineSignal::Ready]));
    }

    /// For every state with every verdict: at most one of `ready`, `cycle_done`, `review` and `fault` is on. `pass` and
    /// `fail` are on only together with `cycle_done`, and `pass` only with the verdict pass.
    #[test]
    fn at_most_one_state_signal_is_on() {
        use LineSignal::{CycleDone, Fail, Fault, Pass, Ready, Review};
        let verdicts =
            [None, Some(Verdict::Pass), Some(Verdict::Fail), Some(Verdict::Invalid), Some(Verdict::Reject)];
        for state in STATES {
            for verdict in verdicts {
                for is_review in [false, true] {
                    let now = line_signals(Some(&CellStatus { state: state.to_owned(), is_review, verdict }));
                    let one = [Ready, CycleDone, Review, Fault].iter().filter(|signal| now.is_on(**signal)).count();
                    assert!(one <= 1, "{state} {verdict:?}");
                    assert_eq!(now.is_on(CycleDone), now.is_on(Pass) != now.is_on(Fail), "{state} {verdict:?}");
                    assert_eq!(now.is_on(Pass), state == "complete" && verdict == Some(Verdict::Pass));
                    assert_eq!(now.is_on(Ready), state == "idle");
                }
            }
        }
        assert_eq!(line_signals(None), LineSignals::from_signals(&[Fault]));
        let held = |is_review| CellStatus { state: "held".to_owned(), is_review, verdict: None };
        assert_eq!(line_signals(Some(&held(true))), LineSignals::from_signals(&[Review]));
        assert_eq!(line_signals(Some(&held(false))), LineSignals::from_signals(&[Fault]));
        let bits: Vec<u32> = LineSignal::VARIANTS.iter().map(|signal| signal.bit()).collect();
        assert_eq!(bits, [1, 2, 4, 8, 16, 32], "as the controller has them");
    }

    proptest! {
        /// For random observations: before each start, the request was low in the same idle state without an
        /// interruption of the link, a part is present, and each start has its own edge. Before each reset, a part was
        /// present and then removed in the same complete state.
        #[test]
        fn each_request_has_its_preconditions(
            walk in proptest::collection::vec((0..3_usize, any::<bool>(), any::<bool>(), 0..12_u8, 1..4_usize), 1..80),
        ) {
            let mut handshake = Handshake::default();
            let (mut low, mut part) = (false, false);
            for (state, part_present, start_request, trouble, times) in walk {
                for _ in 0..times {
                    let mut now = look(["idle", "complete", "execute"][state], part_present, start_request);
                    if trouble == 0 { now.inputs = None; }
                    if trouble == 1 { now.cell = None; }
                    let is_whole = trouble > 1;
                    match handshake.evaluate(now) {
                        Some(LineRequest::Start) => {
                            prop_assert!(is_whole && state == 0 && part_present && start_request && low);
                            low = false;
                        }
                        Some(LineRequest::Reset) => {
                            prop_assert!(is_whole && state == 1 && !part_present && !start_request && part);
                            part = false;
                        }
                        None => {}
                    }
                    low = is_whole && state == 0 && (low || !start_request);
                    part = is_whole && state == 1 && (part || part_present);
                }
            }
        }
    }
}
