//! The desk: who is answered what, and when.

use super::super::letters::{Letters, letters};
use super::*;
use crate::cycle::{Event, Hold, Id, Intent, Motion, Report, Robot, Why, step};
use std::sync::mpsc;

fn desk() -> (Letters, Desk) {
    let (letters, taken) = letters();
    (letters, Desk::new(taken, None, beside(mpsc::channel().0)))
}

fn beside(pages: Sender<EndedCycle>) -> Beside {
    let taping = Taping::new("store".as_ref(), true);
    Beside { taping, supervisor: Supervisor::default(), pages, written: WrittenPage::default(), cameras: None }
}

fn at(at: At) -> State {
    State { at, ..step(State::NEW, Event::Told(Report::Robot(Robot::Ready))).0 }
}

fn asks(ask: &Ask) -> Option<Request> {
    match ask {
        Ask::For(request) => Some(*request),
        _ => None,
    }
}

/// Two signals: a stop, an abort; a third asks nothing. The service leaves once the cell is at rest.
#[test]
fn signals_stop_then_abort_and_leave_at_rest() {
    let (letters, mut desk) = desk();
    let busy = at(At::Execute(Phase::Inspect));
    assert_eq!(asks(&desk.next(&busy)), None);
    for wanted in [Some(Request::Stop), Some(Request::Abort), None] {
        letters.send(Letter::Signal).expect("sent");
        assert!(matches!(desk.next(&busy), Ask::Nothing), "it is read");
        assert_eq!(asks(&desk.next(&busy)), wanted);
    }
    assert!(!matches!(desk.next(&at(At::Idle)), Ask::Leave), "idle is not an end");
    assert!(matches!(desk.next(&at(At::Stopped)), Ask::Leave));
}

/// Its park move is still to come when the verdict is known.
#[test]
fn a_page_is_due_once_the_cell_rests() {
    let (_letters, taken) = letters();
    let (tell, pages) = mpsc::channel();
    let mut desk = Desk::new(taken, None, beside(tell));
    desk.begun(CycleId(7), Begin::Boot);
    desk.concluded(Verdict::Fail);
    desk.next(&at(At::Completing { verdict: Verdict::Fail }));
    assert!(pages.try_recv().is_err());
    for _ in 0..2 {
        desk.next(&at(At::Complete { verdict: Verdict::Fail }));
    }
    assert_eq!(pages.try_iter().map(|ended| ended.id).collect::<Vec<_>>(), [CycleId(7)], "once");
}

#[test]
fn each_letter_has_one_answer() {
    let (letters, mut desk) = desk();
    let (idle, busy) = (at(At::Idle), at(At::Execute(Phase::Wet)));
    let ask = |asked| {
        let (reply, answer) = oneshot::channel();
        let who = Caller { uid: Some(7), user: None };
        letters.send(Letter::Asked { asked, who, reply }).expect("sent");
        answer
    };
    let mut state = ask(Asked::State);
    assert!(matches!(desk.next(&busy), Ask::Nothing));
    let reply = state.try_recv().expect("answered");
    assert_eq!((reply.answer, reply.phase.as_deref()), (Exit::Done, Some("wet")));

    let mut taken = ask(Asked::For(Request::Hold));
    assert_eq!(asks(&desk.next(&busy)), Some(Request::Hold));
    assert!(taken.try_recv().is_err(), "not before the table has taken it");
    desk.next(&busy);
    assert_eq!(taken.try_recv().expect("answered").answer, Exit::Done);

    desk.noted(&[Reason::new("film", "it broke")]);
    for request in [Request::Reset, Request::Hold] {
        let mut refused = ask(Asked::For(request));
        assert_eq!(asks(&desk.next(&idle)), Some(request));
        desk.refused(request, Refusal::NotNow);
        let reply = refused.try_recv().expect("answered");
        assert_eq!((reply.answer, &*reply.reasons[0].code), (Exit::Refused, "not_now"));
        assert_eq!(desk.noted.len(), 1, "a refusal changes nothing");
        desk.next(&idle);
        assert!(refused.try_recv().is_err(), "answered once");
    }
}

/// Whoever asks for the state without end takes no turn from a stop.
#[test]
fn a_stop_is_taken_in_the_round_in_which_it_comes() {
    let (letters, mut desk) = desk();
    let busy = at(At::Execute(Phase::Wet));
    let mut answers = Vec::new();
    for uid in (0..3).cycle().take(24) {
        let (reply, answer) = oneshot::channel();
        let who = Caller { uid: Some(uid), user: None };
        letters.send(Letter::Asked { asked: Asked::State, who, reply }).expect("a place");
        answers.push(answer);
    }
    let (reply, _answer) = oneshot::channel();
    let who = Caller { uid: Some(1), user: None };
    letters.send(Letter::Asked { asked: Asked::For(Request::Stop), who, reply }).expect("always a place");
    assert_eq!(asks(&desk.next(&busy)), Some(Request::Stop));
    assert!(matches!(desk.next(&busy), Ask::Nothing));
    assert!(answers.iter_mut().all(|answer| answer.try_recv().is_ok()), "and the others in the next one");
}

/// A thread that is lost ends the loop, whatever else is asked.
#[test]
fn a_lost_thread_is_told_to_the_loop() {
    let (_letters, taken) = letters();
    let (thread, watched) = supervised("socket", Duration::MAX);
    let beside = beside(mpsc::channel().0);
    beside.supervisor.watch(watched);
    let mut desk = Desk::new(taken, None, beside);
    let idle = at(At::Idle);
    assert!(matches!(desk.next(&idle), Ask::Nothing));
    drop(thread);
    assert!(matches!(desk.next(&idle), Ask::GiveUp(fault) if fault.thread == "socket"));
}

/// Where a cycle is held, its phase is the one in which it goes on; a path tells its waypoints, a film its seconds.
#[test]
fn the_state_tells_how_far_the_work_is() {
    let (_letters, mut desk) = desk();
    (desk.panel, desk.cycle) = (Some("wing".to_owned()), Some(CycleId(3)));
    desk.filmed(12.5);
    let told = |desk: &Desk, state: State| desk.reply(Exit::Done, vec![], &state);
    let films = told(&desk, at(At::Execute(Phase::Inspect)));
    assert_eq!((films.film_s, films.waypoint, films.panel.as_deref()), (Some(12.5), None, Some("wing")));
    let motion = Motion { epoch: 4, path: PathKind::Contact, plan: 1, waypoints: 101 };
    let intent = Some(Intent { id: Id(1), motion, done: 45 });
    let abrades = told(&desk, State { intent, ..at(At::Execute(Phase::Abrade)) });
    assert_eq!((abrades.film_s, abrades.waypoint, abrades.of), (None, Some(45), Some(101)));
    let held = told(&desk, at(At::Held(Hold { why: Why::Asked, resume: Phase::Verify })));
    assert_eq!((held.phase.as_deref(), held.page), (Some("verify"), None));
    desk.beside.written.is(CycleId(3), Path::new("/store/reports/cycle-000003.html"));
    let page = |desk: &Desk| told(desk, at(At::Idle)).page.map(|page| page.display().to_string());
    assert_eq!(page(&desk).as_deref(), Some("/store/reports/cycle-000003.html"));
    desk.cycle = Some(CycleId(4));
    assert_eq!(page(&desk), None, "it is another cycle's");
}
