//! Requests, with the person and the result.

use super::*;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{Event, Request};
use panelprep_cell::record::{Answer, CycleId, RequestAuthor, RequestRecord, RequestSource, RequestedAction};

fn asked(wanted: RequestedAction, answer: Answer) -> RequestRecord {
    let who =
        RequestAuthor { front: RequestSource::Socket, uid: Some(1_000), user: Some("ada".to_owned()), from: None };
    let reasons = match answer {
        Answer::Done => vec![],
        _ => vec![Reason::new("not_now", "not in this state")],
    };
    RequestRecord { unix_ms: 0, wanted, who: Some(who), answer: Some(answer), reasons, findings: None }
}

fn ask(store: &mut Store, request: Request, cycle: Option<CycleId>, answer: Answer) {
    let line = store.append(&Event::Asked(request), cycle).expect("written");
    store.store_request(&asked(RequestedAction::For(request), answer), cycle, Some(line)).expect("kept");
}

fn words(asked: &[RequestRecord]) -> Vec<(RequestedAction, Option<Answer>)> {
    asked.iter().map(|asked| (asked.wanted.clone(), asked.answer)).collect()
}

/// Between two cycles a disc is mounted and a clear is refused. In the second cycle a request is refused. Another
/// request is interrupted by the end of the program before its answer is stored.
#[test]
fn requests_are_where_they_were_asked_with_their_answers() {
    let (folder, mut store) = new_store();
    let one = store.begin_cycle(&super::cycles::start()).expect("begun");
    ask(&mut store, Request::Start { max_passes: 2, max_moves: 3, dries: false }, Some(one), Answer::Done);
    store.conclude(one, Verdict::Pass, &[]).expect("concluded");
    ask(&mut store, Request::Clear, None, Answer::Refused);
    store.store_request(&asked(RequestedAction::NewDisc, Answer::Done), None, None).expect("kept");
    let two = store.begin_cycle(&super::cycles::start()).expect("begun");
    ask(&mut store, Request::Start { max_passes: 2, max_moves: 3, dries: false }, Some(two), Answer::Done);
    ask(&mut store, Request::Accept, Some(two), Answer::Refused);
    store.append(&Event::Asked(Request::Hold), Some(two)).expect("written");
    store.store_request(&asked(RequestedAction::NewDisc, Answer::Refused), Some(two), None).expect("kept");
    drop(store);

    let store = Store::open(&folder.path().join("store")).expect("for reading");
    let (first, second) = (store.cycle(one).expect("there"), store.cycle(two).expect("there"));
    let start = RequestedAction::For(Request::Start { max_passes: 2, max_moves: 3, dries: false });
    assert_eq!(words(&first.asked), [(start.clone(), Some(Answer::Done))]);
    assert_eq!(words(&first.asked_before), []);
    let between = [
        (RequestedAction::For(Request::Clear), Some(Answer::Refused)),
        (RequestedAction::NewDisc, Some(Answer::Done)),
    ];
    assert_eq!(words(&second.asked_before), between);
    let mut during = words(&second.asked);
    assert!(during.contains(&(RequestedAction::For(Request::Hold), None)), "its answer is not known: {during:?}");
    during.retain(|(wanted, _)| *wanted != RequestedAction::For(Request::Hold));
    assert_eq!(
        during,
        [
            (start, Some(Answer::Done)),
            (RequestedAction::For(Request::Accept), Some(Answer::Refused)),
            (RequestedAction::NewDisc, Some(Answer::Refused))
        ]
    );
    let accept =
        &second.asked.iter().find(|asked| asked.wanted == RequestedAction::For(Request::Accept)).expect("there");
    assert_eq!(accept.who.as_ref().and_then(|who| who.user.as_deref()), Some("ada"));
    assert!(accept.unix_ms > 1_700_000_000_000 && accept.reasons[0].code == "not_now");
    let mut reader = store;
    assert!(matches!(
        reader.store_request(&asked(RequestedAction::NewDisc, Answer::Done), None, None),
        Err(StoreError::ReadOnly { .. })
    ));
}

/// Five requests of one millisecond: pages of two contain each request once.
#[test]
fn pages_contain_each_request_of_one_millisecond_once() {
    let (_folder, mut store) = new_store();
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(2_000);
    let request = asked(RequestedAction::NewDisc, Answer::Done);
    (0..5).for_each(|_| store.store_request(&request, None, None).expect("kept"));
    let (mut before, mut pages) = (None, Vec::new());
    loop {
        let page = store.requests(before, 2).expect("read");
        let Some(last) = page.last() else { break };
        before = Some(TrailPosition { unix_ms: last.request.unix_ms, number: last.number });
        pages.push(page.iter().map(|kept| kept.number).collect::<Vec<_>>());
    }
    assert_eq!(pages, [vec![5, 4], vec![3, 2], vec![1]]);
}
