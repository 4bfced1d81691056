//! Tests which client receives which reply, and when.

use super::super::request_queue::{RequestSender, request_queue};
use super::*;
use panelprep_cell::cycle::{Event, Hold, Id, Intent, Motion, Report, Robot, Trouble, Why, step};
use panelprep_store::tape::LoopMemoryStart;
use std::path::Path;
use std::sync::mpsc;

fn handler() -> (RequestSender, RequestHandler) {
    let (sender, queue) = request_queue();
    (sender, RequestHandler::new(queue, None, parts(mpsc::channel().0)))
}

fn parts(pages: Sender<EndedCycle>) -> ServiceParts {
    let recording = RecordingSwitch::new("store".as_ref(), true);
    let (supervisor, written) = (Supervisor::default(), LastWrittenPage::default());
    ServiceParts { recording, supervisor, pages, written, cameras: None, view: LiveView::default() }
}

fn at(at: At) -> State {
    State { at, ..step(State::INITIAL, Event::Reported(Report::Robot(Robot::Ready))).0 }
}

/// Returns the next request that the loop receives.
fn next(handler: &mut RequestHandler, state: &State) -> Option<RequestKind> {
    handler.next_request(state).expect("no thread is lost").map(|request| request.what)
}

fn requested_action(handler: &mut RequestHandler, state: &State) -> Option<cycle::Request> {
    match next(handler, state) {
        Some(RequestKind::Table(request)) => Some(request),
        _ => None,
    }
}

/// Sends a request as a client that waits for the reply.
fn send(sender: &RequestSender, uid: u32, what: RequestKind) -> oneshot::Receiver<Reply> {
    let (reply, answer) = oneshot::channel();
    let who = RequestAuthor { front: RequestSource::Socket, uid: Some(uid), user: None, from: None };
    sender.send(Request { what, requester: who, reply: Some(reply) }).expect("a place");
    answer
}

/// The first signal requests a stop, the second an abort; a third one requests nothing. The service ends when the cell
/// is idle.
#[test]
fn signals_stop_then_abort_and_leave_at_rest() {
    let (sender, mut handler) = handler();
    let busy = at(At::Execute(Phase::Inspect));
    assert_eq!(requested_action(&mut handler, &busy), None);
    for wanted in [Some(cycle::Request::Stop), Some(cycle::Request::Abort), None] {
        sender.send(Request::signal()).expect("sent");
        assert!(next(&mut handler, &busy).is_none(), "it is read");
        assert_eq!(requested_action(&mut handler, &busy), wanted);
    }
    assert!(next(&mut handler, &at(At::Idle)).is_none(), "idle is not an end");
    assert!(matches!(next(&mut handler, &at(At::Stopped)), Some(RequestKind::Leave)));
}

/// When the verdict is known, the motion to the park pose has not begun yet, so the page is not due.
#[test]
fn a_page_is_due_once_the_cell_rests() {
    let (_sender, queue) = request_queue();
    let (tell, pages) = mpsc::channel();
    let mut handler = RequestHandler::new(queue, None, parts(tell));
    handler.on_loop_event(LoopEvent::Begun(CycleId(7), LoopMemoryStart::Boot));
    handler.on_loop_event(LoopEvent::Concluded(Verdict::Fail));
    next(&mut handler, &at(At::Completing { verdict: Verdict::Fail }));
    assert!(pages.try_recv().is_err());
    for _ in 0..2 {
        next(&mut handler, &at(At::Complete { verdict: Verdict::Fail }));
    }
    assert_eq!(pages.try_iter().map(|ended| ended.id).collect::<Vec<_>>(), [CycleId(7)], "once");
}

/// Two screens show review 1. One person accepts, and the cell continues until it is held with review 2. The other
/// person accepts on the outdated screen: this decision does not reach the state table, and the refusal states what has
/// changed. A decision on the displayed step is executed.
#[test]
fn a_decision_is_valid_only_for_the_step_that_was_shown() {
    let (sender, mut handler) = handler();
    let held = |resume, step| State { step, ..at(At::Held(Hold { why: Why::Review, resume })) };
    let (first, second) = (held(Phase::Plan, 7), held(Phase::Assess { left: false }, 11));
    let shown = |state: &State, handler: &mut RequestHandler| {
        let mut answer = send(&sender, 8, RequestKind::State);
        assert!(next(handler, state).is_none());
        answer.try_recv().expect("answered").step.expect("shown")
    };
    let screens = [shown(&first, &mut handler), shown(&first, &mut handler)];
    assert_eq!(screens, [7, 7]);

    let accept = |step| RequestKind::Decided { request: cycle::Request::Accept, step };
    let mut taken = send(&sender, 7, accept(screens[0]));
    assert_eq!(requested_action(&mut handler, &first), Some(cycle::Request::Accept));
    next(&mut handler, &State { step: 8, ..at(At::Unholding { resume: Phase::Plan, verify: false }) });
    assert_eq!(taken.try_recv().expect("answered").answer, RequestResult::Done);

    let mut stale = send(&sender, 8, accept(screens[1]));
    let Some(RequestKind::Outdated { request, reasons }) = next(&mut handler, &second) else {
        panic!("it went through")
    };
    let reply = stale.try_recv().expect("answered");
    assert_eq!((request, &reply.reasons, reply.answer), (cycle::Request::Accept, &reasons, RequestResult::Refused));
    assert_eq!((&*reasons[0].code, reply.step), ("outdated", Some(11)));
    assert_eq!(
        reasons[0].message,
        "accept refers to step 7 (held, plan (review)), but the cell is now at step 11 (held, assess (review)); read the state and decide again"
    );
    // A decision on a step from before the start of this service is refused in the same way.
    for request in [cycle::Request::Clear, cycle::Request::Unhold { dried: true }] {
        let mut stale = send(&sender, 8, RequestKind::Decided { request, step: 2 });
        assert!(matches!(next(&mut handler, &second), Some(RequestKind::Outdated { .. })));
        let reply = stale.try_recv().expect("answered");
        assert!(reply.reasons[0].message.contains("a state that this service does not know"), "{reply:?}");
    }
    let _waits = send(&sender, 8, accept(shown(&second, &mut handler)));
    assert_eq!(requested_action(&mut handler, &second), Some(cycle::Request::Accept));
}

#[test]
fn each_request_has_one_reply() {
    let (sender, mut handler) = handler();
    let (idle, busy) = (at(At::Idle), at(At::Execute(Phase::Wet)));
    let mut state = send(&sender, 7, RequestKind::State);
    assert!(next(&mut handler, &busy).is_none());
    let reply = state.try_recv().expect("answered");
    assert_eq!((reply.answer, reply.phase.as_deref()), (RequestResult::Done, Some("wet")));

    let mut taken = send(&sender, 7, RequestKind::Table(cycle::Request::Hold));
    assert_eq!(requested_action(&mut handler, &busy), Some(cycle::Request::Hold));
    assert!(taken.try_recv().is_err(), "not before the table has taken it");
    next(&mut handler, &busy);
    assert_eq!(taken.try_recv().expect("answered").answer, RequestResult::Done);

    handler.on_loop_event(LoopEvent::Noted(vec![Reason::new("film", "it broke")]));
    for request in [cycle::Request::Reset, cycle::Request::Hold] {
        let mut refused = send(&sender, 7, RequestKind::Table(request));
        assert_eq!(requested_action(&mut handler, &idle), Some(request));
        handler.on_loop_event(LoopEvent::Refused(request, Refusal::NotNow));
        let reply = refused.try_recv().expect("answered");
        assert_eq!((reply.answer, &*reply.reasons[0].code), (RequestResult::Refused, "not_now"));
        assert_eq!(handler.problems.len(), 1, "a refusal changes nothing");
        next(&mut handler, &idle);
        assert!(refused.try_recv().is_err(), "answered once");
    }
}

/// If a reset fails before its reply is sent, the reply states the problem, and the state states it afterwards. The
/// next request after the reset gets its own reply.
#[test]
fn a_failed_reset_states_the_problems_found() {
    let (sender, mut handler) = handler();
    let stopped = at(At::Stopped);
    let failed = || LoopEvent::Refused(cycle::Request::Reset, Refusal::Failed(Trouble::Camera));
    let found = || LoopEvent::Noted(vec![Reason::new("scanner", "the worker stays down")]);
    let codes = |reasons: &[Reason]| reasons.iter().map(|reason| reason.code.clone()).collect::<Vec<_>>();
    handler.on_loop_event(LoopEvent::Noted(vec![Reason::new("film", "it broke")]));

    let mut reset = send(&sender, 7, RequestKind::Table(cycle::Request::Reset));
    assert_eq!(requested_action(&mut handler, &stopped), Some(cycle::Request::Reset));
    handler.on_loop_event(found());
    handler.on_loop_event(failed());
    let reply = reset.try_recv().expect("answered");
    assert_eq!(
        (reply.answer, codes(&reply.reasons)),
        (RequestResult::Fault, vec!["camera".into(), "scanner".into()])
    );
    assert_eq!(codes(&handler.problems), ["camera", "scanner"]);

    let mut reset = send(&sender, 7, RequestKind::Table(cycle::Request::Reset));
    assert_eq!(requested_action(&mut handler, &stopped), Some(cycle::Request::Reset));
    let mut disc = send(&sender, 7, RequestKind::NewDisc);
    assert!(matches!(next(&mut handler, &stopped), Some(RequestKind::NewDisc)));
    assert_eq!(reset.try_recv().expect("answered").answer, RequestResult::Done, "it was taken");
    handler.on_loop_event(found());
    handler.on_loop_event(failed());
    assert!(disc.try_recv().is_err(), "it is no reset");
    assert_eq!(codes(&handler.problems), ["camera", "scanner"]);
}

/// A client that requests the state continuously does not delay a stop.
#[test]
fn a_stop_is_accepted_in_the_iteration_in_which_it_arrives() {
    let (sender, mut handler) = handler();
    let busy = at(At::Execute(Phase::Wet));
    let mut answers: Vec<_> = (0..3).cycle().take(24).map(|uid| send(&sender, uid, RequestKind::State)).collect();
    let _stop = send(&sender, 1, RequestKind::Table(cycle::Request::Stop));
    assert_eq!(requested_action(&mut handler, &busy), Some(cycle::Request::Stop));
    assert!(next(&mut handler, &busy).is_none());
    assert!(answers.iter_mut().all(|answer| answer.try_recv().is_ok()), "and the others in the next one");
}

/// A failed thread ends the loop, even if requests are waiting.
#[test]
fn a_lost_thread_is_reported_to_the_loop() {
    let (_sender, queue) = request_queue();
    let (thread, watched) = supervise("socket", Duration::MAX);
    let parts = parts(mpsc::channel().0);
    parts.supervisor.add_thread(watched);
    let mut handler = RequestHandler::new(queue, None, parts);
    let idle = at(At::Idle);
    assert!(next(&mut handler, &idle).is_none());
    drop(thread);
    assert!(matches!(handler.next_request(&idle), Err(fault) if fault.thread == "socket"));
}

/// While a cycle is held, the reported phase is the phase in which it continues. For a path the waypoints are reported,
/// and for a film its present duration.
#[test]
fn the_state_reports_the_progress() {
    let (_sender, mut handler) = handler();
    (handler.panel, handler.cycle) = (Some("wing".to_owned()), Some(CycleId(3)));
    handler.on_loop_event(LoopEvent::Filmed(12.5));
    let told = |handler: &RequestHandler, state: State| handler.reply(RequestResult::Done, vec![], &state);
    let films = told(&handler, at(At::Execute(Phase::Inspect)));
    assert_eq!((films.film_s, films.waypoint, films.panel.as_deref()), (Some(12.5), None, Some("wing")));
    let motion = Motion { epoch: 4, path: PathKind::Contact, plan: 1, waypoints: 101 };
    let intent = Some(Intent { id: Id(1), motion, done: 45 });
    let abrades = told(&handler, State { intent, ..at(At::Execute(Phase::Abrade)) });
    assert_eq!((abrades.film_s, abrades.waypoint, abrades.of), (None, Some(45), Some(101)));
    let held = told(&handler, at(At::Held(Hold { why: Why::Asked, resume: Phase::Verify })));
    assert_eq!((held.phase.as_deref(), held.page), (Some("verify"), None));
    handler.parts.written.set_page(CycleId(3), Path::new("/store/reports/cycle-000003.html"));
    let page = |handler: &RequestHandler| told(handler, at(At::Idle)).page.map(|page| page.display().to_string());
    assert_eq!(page(&handler).as_deref(), Some("/store/reports/cycle-000003.html"));
    handler.cycle = Some(CycleId(4));
    assert_eq!(page(&handler), None, "it is another cycle's");
}

/// The buttons show exactly the possible requests: drying is shown only if the state table accepts it.
#[test]
fn drying_is_offered_where_it_is_accepted() {
    let (_sender, handler) = handler();
    let held = |why, resume| handler.page_data(&at(At::Held(Hold { why, resume }))).possible;
    for (why, resume, is_offered) in [
        (Why::Review, Phase::Plan, true),
        (Why::Drying, Phase::Locate, true),
        (Why::Review, Phase::Assess { left: false }, false),
    ] {
        let possible = held(why, resume);
        assert_eq!(possible.contains(&"unhold --dried"), is_offered, "{why:?} {possible:?}");
        assert!(!possible.contains(&"unhold"), "{why:?} {possible:?}");
    }
}

/// The reason of a hold belongs to this hold and its author; a refused second hold does not change it.
#[test]
fn a_hold_names_its_author_and_reason_while_it_lasts() {
    let (sender, mut handler) = handler();
    let busy = at(At::Execute(Phase::Wet));
    let held = at(At::Held(Hold { why: Why::Asked, resume: Phase::Wet }));
    let told = |handler: &RequestHandler, state: &State| -> Vec<String> {
        let reasons = handler.reasons(state).into_iter().filter(|reason| reason.code == "held_by");
        reasons.map(|reason| reason.message).collect()
    };
    let ask = |handler: &mut RequestHandler, state: &State, user: &str, what| {
        let who = RequestAuthor { user: Some(user.to_owned()), ..RequestAuthor::from_source(RequestSource::Page) };
        sender.send(Request::new(what, who)).expect("a place");
        assert!(next(handler, state).is_some());
    };
    ask(&mut handler, &busy, "anna", RequestKind::Hold { why: "a hair".to_owned() });
    assert_eq!(told(&handler, &held), ["anna: a hair"]);
    ask(&mut handler, &held, "ben", RequestKind::Table(cycle::Request::Hold));
    assert_eq!(told(&handler, &held), ["anna: a hair"]);
    assert!(told(&handler, &busy).is_empty());
    assert!(told(&handler, &at(At::Held(Hold { why: Why::Review, resume: Phase::Plan }))).is_empty());
    ask(&mut handler, &busy, "ben", RequestKind::Table(cycle::Request::Hold));
    assert_eq!(told(&handler, &held), ["ben"]);
}

/// After a cycle has begun, no picture of the former part is shown.
#[test]
fn a_cycle_begins_without_a_picture() {
    let (_sender, mut handler) = handler();
    let view = handler.parts.view.clone();
    view.newest_picture();
    view.offer_picture(|| {
        let picture = Arc::new(panelprep_base::geometry::ColorPicture::uniform(1, 1, [7; 3]));
        Some(crate::daemon::live_view::LiveFrame { name: "film".to_owned(), picture, film: None })
    });
    assert!(view.newest_picture().1.is_some());
    handler.on_loop_event(LoopEvent::Begun(CycleId(3), LoopMemoryStart::Boot));
    assert!(view.newest_picture().1.is_none());
}
