//! The handshake without a controller: edges, levels, interruptions of the link, and the signals to the line.

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

/// Returns the requests that follow if each of these observations is made three times in a row.
fn asked(handshake: &mut Handshake, looks: &[LineObservation]) -> Vec<LineRequest> {
    looks
        .iter()
        .flat_map(|look| std::iter::repeat_n(look, 3))
        .filter_map(|look| handshake.evaluate(look.clone()))
        .collect()
}

#[test]
fn an_edge_asks_once_and_the_part_that_is_taken_resets() {
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

/// High when the program begins, when the cell becomes idle, and when the link comes back: none of these makes a
/// request.
#[test]
fn a_level_asks_for_nothing() {
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
fn without_a_part_nothing_begins_even_where_one_comes_later() {
    let mut handshake = Handshake::default();
    let looks = [look("idle", false, false), look("idle", false, true), look("idle", true, true)];
    assert_eq!(asked(&mut handshake, &looks), []);
}

#[test]
fn a_contact_that_bounces_asks_for_nothing() {
    let mut handshake = Handshake::default();
    asked(&mut handshake, &[look("idle", true, false)]);
    for _ in 0..20 {
        assert_eq!(handshake.evaluate(look("idle", true, true)), None);
        assert_eq!(handshake.evaluate(look("idle", true, false)), None);
    }
    assert_eq!(asked(&mut handshake, &[look("idle", true, true)]), [LineRequest::Start]);
}

/// Before the cell is reset for the next cycle, the part must have been seen after the cycle, and the request must
/// be low.
#[test]
fn a_reset_needs_a_part_that_went() {
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

/// A refused start is signalled as a fault until the line withdraws its request, a refused reset until a person has
/// reset the cell.
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

/// Every state with every verdict: at most one of ready, cycle done, review and fault is on. Pass and fail are on
/// only together with cycle done, and pass with no other verdict than pass.
#[test]
fn what_is_reported_is_never_two_things() {
    use LineSignal::{CycleDone, Fail, Fault, Pass, Ready, Review};
    let verdicts = [None, Some(Verdict::Pass), Some(Verdict::Fail), Some(Verdict::Invalid), Some(Verdict::Reject)];
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
    /// For any observations: before each start, the request was low in the same idle state without an interruption of
    /// the link; a part is present, and each start has an edge of its own. Before each reset, a part was seen and then
    /// removed, in the same complete state after a cycle.
    #[test]
    fn what_is_asked_for_was_earned(
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
