//! Compares a signed record with the record in the store: which changes are reported as differences, and which are
//! not.

use super::super::differences;
use serde_json::json;

#[test]
fn differences_name_their_place_and_let_a_later_program_keep_more() {
    let signed = json!({"panel": "wing", "findings": [{"numbers": [1, 2]}], "asked": [1], "events": 5});
    let same = json!({"panel": "wing", "findings": [{"numbers": [1, 2]}], "asked": [1, 2], "events": 7, "new": 1});
    assert_eq!(differences(&signed, &same), [] as [String; 0]);
    let other = json!({"findings": [{"numbers": [1, 3]}], "asked": [], "events": 4});
    let told = differences(&signed, &other).join("; ");
    for words in [
        "/panel: signed value \"wing\", present value null",
        "/findings/0/numbers/1: signed value 2, present value 3",
        "/asked: signed value a list of 1, present value a list of 0",
        "/events: signed value 5, present value 4",
    ] {
        assert!(told.contains(words), "no {words} in {told}");
    }
}

/// After an abort is signed, the robot may still report the end of a motion, and a request in the journal gets its
/// answer.
#[test]
fn what_comes_after_a_cycle_is_no_difference() {
    let motion =
        |outcome: Option<&str>, done: u32| json!({"motion": {"epoch": 3}, "outcome": outcome, "done": done});
    let asked = |answer: Option<&str>| json!({"wanted": "stop", "who": answer.map(|_| "ada"), "answer": answer});
    let record =
        |motion: serde_json::Value, asked: serde_json::Value| json!({"motions": [motion], "asked": [asked]});
    let signed = record(motion(None, 0), asked(None));
    assert_eq!(differences(&signed, &record(motion(Some("cleared"), 7), asked(Some("done")))), [] as [String; 0]);
    let closed = record(motion(Some("done"), 7), asked(Some("done")));
    let told = differences(&closed, &record(motion(Some("done"), 8), asked(Some("refused")))).join("; ");
    assert!(told.contains("/motions/0/done: signed value 7, present value 8"), "{told}");
    assert!(told.contains("/asked/0/answer: signed value \"done\", present value \"refused\""), "{told}");
    let other = json!({"motions": [{"motion": {"epoch": 4}, "outcome": null, "done": 0}], "asked": []});
    let told = differences(&signed, &other).join("; ");
    assert!(
        told.contains("/motions/0/motion/epoch: signed value 3, present value 4") && told.contains("/asked: "),
        "{told}"
    );
}
