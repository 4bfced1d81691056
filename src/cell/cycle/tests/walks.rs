//! Tests the state table with thousands of seeded random walks, in which nine of ten events are the next event of a
//! cell without faults. Also searches all states that can be reached with small limits, and finds from each state a
//! sequence of events to rest.

use super::super::interlocks::{
    CLEARING_CONDITIONS, COMPLETING_CONDITIONS, LEAVE_CONDITIONS, LEAVE_MOTION_CONDITIONS, LEAVE_TOOL_CONDITIONS,
    Need, RESETTING_CONDITIONS, STARTING_CONDITIONS, UNHOLDING_CONDITIONS, UNHOLDING_LOCATED_CONDITIONS,
    action_needs,
};
use super::super::*;
use super::cell::Cell;
use super::healthy::{REQUESTS, answers};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};

const WALKS: u64 = 6_000;
const STEPS: usize = 300;

/// Number of times that the walks reached each situation.
type Coverage = BTreeMap<&'static str, u64>;

fn phase(at: At) -> &'static str {
    match at {
        At::Execute(Phase::Locate) => "locate",
        At::Execute(Phase::Refine { .. }) => "refine",
        At::Execute(Phase::Dry) => "dry",
        At::Execute(Phase::Wet) => "wet",
        At::Execute(Phase::Inspect) => "inspect",
        At::Execute(Phase::Plan) => "plan",
        At::Execute(Phase::Verify) => "verify",
        At::Execute(Phase::Abrade) => "abrade",
        At::Execute(Phase::Retract) => "retract",
        At::Execute(Phase::Assess { .. }) => "assess",
        At::Execute(Phase::Rinse) => "rinse",
        other => other.keyword(),
    }
}

fn note(coverage: &mut Coverage, cell: &Cell, before: State) {
    let now = cell.state;
    if now.at != before.at {
        *coverage.entry(phase(now.at)).or_default() += 1;
    }
    let contact = |state: State| state.intent.filter(|intent| intent.motion.path == Path::Contact);
    let mut happened = |what, is: bool| *coverage.entry(what).or_default() += u64::from(is);
    let holds = matches!(now.at, At::Holding(_)) && before.at != now.at;
    happened("held in contact", holds && contact(before).is_some_and(|intent| intent.done > 0));
    happened("aborted in contact", contact(now).is_some() && matches!(now.at, At::Aborting { .. }));
    happened("planned again", matches!(before.at, At::Unholding { .. }) && now.at == At::Execute(Phase::Plan));
    let was_left = matches!(before.at, At::Execute(Phase::Assess { left: true }));
    happened("a path that was cut short is graded", was_left && now.at == At::Execute(Phase::Plan));
    let is_held = matches!(now.at, At::Held(hold) if hold.is_for_contact());
    happened("a contact waits for a person", is_held && now.at != before.at);
    happened("a contact path done", contact(before).is_some() && now.at == At::Execute(Phase::Retract));
    let air = |state: State| state.intent.is_some_and(|intent| intent.motion.path == Path::Air);
    happened("an air path done", air(before) && now.at == At::Execute(Phase::Retract));
    happened("a second pass", before.job.pass == 1 && now.job.pass == 2);
    happened("a third pass", before.job.pass == 2 && now.job.pass == 3);
    happened("a report dropped", now.dropped > before.dropped);
    if let (At::Complete { verdict }, true) = (now.at, now.at != before.at) {
        happened(verdict.keyword(), true);
    }
}

/// Maximum number of events between the last fault and the start of a cycle.
const MAX_RECOVERY_EVENTS: usize = 120;

/// Checks that Clear, Reset and Start succeed after the last fault, in any state.
fn recovers(cell: &mut Cell, random: &mut Pcg64) -> Result<(), String> {
    let mut asked = [0; 2];
    for _ in 0..MAX_RECOVERY_EVENTS {
        let begun = matches!(cell.state.at, At::Execute(Phase::Locate)) && asked[1] > 0;
        if begun {
            return Ok(());
        }
        let works = matches!(cell.state.at, At::Execute(_) | At::Starting | At::Unholding { .. });
        let stop = (works && asked[1] == 0 && !cell.condition_due).then_some(Event::Asked(Request::Stop));
        let event = stop.or_else(|| cell.next_recovery_event(random)).ok_or_else(|| "a dead end".to_owned())?;
        asked[0] += usize::from(event == Event::Asked(Request::Clear));
        asked[1] += usize::from(matches!(event, Event::Asked(Request::Start { .. })));
        if asked[0] > 1 {
            return Err("one clear is not enough".to_owned());
        }
        cell.feed(event).and_then(|()| cell.send_waypoints())?;
    }
    Err(format!("no cycle begins within {MAX_RECOVERY_EVENTS} steps of the last fault"))
}

/// Performs one random walk; the error states what was wrong, with the last events.
fn walk(dropped: Option<Need>, seed: u64, coverage: &mut Coverage) -> Result<(), String> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut cell = Cell::new(dropped);
    // Ten percent on average: walks with few unexpected events reach late phases, walks with many reach every
    // situation.
    let surprises = random.random_range(0.01..0.19);
    for index in 0..STEPS {
        let before = cell.state;
        let said = if random.random_bool(surprises) {
            Some(cell.unexpected_event(&mut random))
        } else {
            cell.next_healthy_event(&mut random)
        };
        let event = said.ok_or_else(|| "a dead end".to_owned());
        let done = event.and_then(|event| cell.feed(event)).and_then(|()| cell.send_waypoints());
        done.map_err(|wrong| {
            let last: Vec<String> =
                cell.journal.iter().rev().take(25).rev().map(|event| format!("  {event:?}")).collect();
            format!(
                "{wrong}\nseed {seed}, step {index}, {:?}\nwas {:?}\n{}",
                cell.state,
                before.at,
                last.join("\n")
            )
        })?;
        note(coverage, &cell, before);
    }
    let at = cell.state.at;
    recovers(&mut cell, &mut random).map_err(|wrong| format!("{wrong}\nseed {seed}, after the walk, was {at:?}"))
}

#[test]
fn no_walk_finds_a_forbidden_state_and_the_walks_reach_every_situation() {
    let mut coverage = Coverage::new();
    for seed in 0..WALKS {
        walk(None, seed, &mut coverage).unwrap_or_else(|wrong| panic!("{wrong}"));
    }
    println!("{coverage:#?}");
    let often = [
        "stopped",
        "resetting",
        "idle",
        "starting",
        "locate",
        "refine",
        "dry",
        "wet",
        "inspect",
        "plan",
        "verify",
        "abrade",
        "retract",
        "assess",
        "rinse",
        "holding",
        "held",
        "unholding",
        "completing",
        "complete",
        "stopping",
        "aborting",
        "aborted",
        "clearing",
        "held in contact",
        "aborted in contact",
        "planned again",
        "a contact path done",
        "a path that was cut short is graded",
        "a contact waits for a person",
        "an air path done",
        "a second pass",
        "a third pass",
        "a report dropped",
        "pass",
        "fail",
        "invalid",
        "reject",
    ];
    let rare: Vec<_> = often.iter().map(|what| (what, coverage.get(what).copied().unwrap_or(0))).collect();
    assert!(rare.iter().all(|(_, count)| *count >= 100), "the walks do not reach: {rare:?}");
}

/// Returns every need of a row, once.
fn all_needs() -> Vec<Need> {
    let paths = [Path::Park, Path::Corner { view: 0 }, Path::Approach, Path::Contact, Path::Air, Path::Retract];
    let moves = paths.map(|path| Action::Move(State::INITIAL.motion(path)));
    let others = [
        Action::Locate,
        Action::DryPicture,
        Action::Film,
        Action::Refine { view: 0 },
        Action::Switch(Switch::Rinse),
        Action::Switch(Switch::ToolOn),
        Action::Switch(Switch::WaterOff),
    ];
    let of_states: [&[Need]; 9] = [
        &LEAVE_MOTION_CONDITIONS,
        &LEAVE_TOOL_CONDITIONS,
        &LEAVE_CONDITIONS,
        &CLEARING_CONDITIONS,
        &RESETTING_CONDITIONS,
        &STARTING_CONDITIONS,
        &UNHOLDING_CONDITIONS,
        &UNHOLDING_LOCATED_CONDITIONS,
        &COMPLETING_CONDITIONS,
    ];
    let mut all = Vec::new();
    for need in moves.into_iter().chain(others).flat_map(action_needs).chain(of_states.concat()) {
        if !all.contains(&need) {
            all.push(need);
        }
    }
    all
}

/// Proves that the walks are effective: each need is dropped from its rows in turn, and the walks must then find the
/// situation that it prevented. The rules of the code between the rows are changed by `make mutants`.
#[test]
fn without_any_single_need_the_walks_find_what_it_prevents() {
    let mut missed = Vec::new();
    for need in all_needs() {
        let found = (0..WALKS).find_map(|seed| walk(Some(need), seed, &mut Coverage::new()).err());
        match found {
            Some(wrong) => println!("{need:?}: {}", wrong.lines().next().unwrap_or_default()),
            None => missed.push(need),
        }
    }
    assert!(missed.is_empty(), "missing: {missed:?}");
}

/// Returns the state without the parts that do not influence decisions: ids are renumbered, causes are made equal, and
/// data of an ended cycle are removed.
fn canonical(mut state: State) -> State {
    if !state.job.running {
        state.job = State::INITIAL.job;
    }
    if state.facts.robot != Robot::Ready {
        state.facts.robot = Robot::Unknown;
    }
    match &mut state.at {
        At::Aborting { cause, .. } | At::Aborted { cause } | At::Clearing { cause } => *cause = Cause::Asked,
        At::Holding(Hold { why, .. }) | At::Held(Hold { why, .. })
            if matches!(why, Why::TokenOver | Why::Trouble(_)) =>
        {
            *why = Why::Asked;
        }
        _ => {}
    }
    state.last_id = Id(9);
    (state.epoch, state.dropped, state.step) = (1, 0, 0);
    if let Some(due) = state.due.as_mut() {
        due.id = Id(1);
        match &mut due.act {
            Action::OpenEpoch { above: epoch }
            | Action::EndEpoch { epoch }
            | Action::Move(Motion { epoch, .. }) => *epoch = 1,
            _ => {}
        }
    }
    if let Some(intent) = state.intent.as_mut() {
        (intent.id, intent.motion.epoch) = (Id(2), 1);
    }
    if let Light::Settling { until } = &mut state.facts.light {
        *until = Id(3);
    }
    if let Water::Rinsing { until } | Water::Spraying { until } | Water::Draining { until } = &mut state.facts.water
    {
        *until = Id(4);
    }
    state.facts.token = state.facts.token.map(|_| Id(5));
    if let At::Stopping { until } = &mut state.at {
        *until = Id(6);
    }
    state
}

/// Returns the deadlines that this state waits for.
fn timers(state: &State) -> Vec<(Deadline, Id)> {
    let light = match state.facts.light {
        Light::Settling { until } => Some((Deadline::Settle, until)),
        _ => None,
    };
    let water = match state.facts.water {
        Water::Rinsing { until } => Some((Deadline::Rinse, until)),
        Water::Spraying { until } => Some((Deadline::Spray, until)),
        Water::Draining { until } => Some((Deadline::Drain, until)),
        _ => None,
    };
    light.into_iter().chain(water).collect()
}

/// Returns all possible events in this state: one of each kind that the table distinguishes.
fn events(state: &State) -> Vec<Event> {
    let mut reported = vec![
        Report::Boot,
        Report::StoreChanged,
        Report::StoreRestored,
        Report::Trouble(Trouble::Store),
        Report::Trouble(Trouble::Starved),
    ];
    let over = [None, Some(Trouble::Refused), Some(Trouble::Starved)];
    reported.extend(over.map(|trouble| Report::EpochOver { trouble }));
    let robots = [Robot::Ready, Robot::LinkLost, Robot::EmergencyStop, Robot::GuardOpen];
    reported.extend(robots.map(Report::Robot));
    reported.extend([true, false].map(Report::FullOverride));
    reported.extend(state.facts.proven_switches().map(Report::Contrary));
    if let Some(Due { id, act }) = state.due {
        reported.extend(answers(act, id));
        let failed = |trouble| Report::Answered { id, answer: Answer::Failed(trouble) };
        reported.extend([failed(Trouble::Camera), failed(Trouble::Gate)]);
        reported.extend([Report::Deadline { id, which: Deadline::Answer }, Report::Progress { id, done: 1 }]);
    }
    let mut armed = timers(state);
    armed.extend(state.facts.token.map(|id| (Deadline::Token, id)));
    if let At::Stopping { until } = state.at {
        armed.push((Deadline::Stop, until));
    }
    reported.extend(armed.into_iter().map(|(which, id)| Report::Deadline { id, which }));
    let asked = REQUESTS.iter().filter(|request| !matches!(request, Request::Start { max_passes: 2, .. }));
    asked.map(|request| Event::Asked(*request)).chain(reported.into_iter().map(Event::Reported)).collect()
}

/// Returns the next report of a cell without faults; no requests.
fn next_healthy_report(state: &State) -> Option<Event> {
    let answer = state.due.map(|due| answers(due.act, due.id)[0]);
    let timer = || timers(state).first().map(|&(which, id)| Report::Deadline { id, which });
    answer.or_else(timer).map(Event::Reported)
}

#[test]
fn every_state_leads_to_rest_and_from_rest_to_a_cycle() {
    let start = canonical(State::INITIAL);
    let mut seen = HashSet::from([start]);
    let mut to_visit = VecDeque::from([start]);
    while let Some(state) = to_visit.pop_front() {
        for event in events(&state) {
            let next = canonical(step(state, event).0);
            if seen.insert(next) {
                to_visit.push_back(next);
            }
        }
    }
    println!("{} states", seen.len());
    assert!(seen.len() > 10_000, "only {} states", seen.len());
    let mut words: HashMap<&str, u32> = HashMap::new();
    seen.iter().for_each(|state| *words.entry(state.at.keyword()).or_default() += 1);
    assert_eq!(words.len(), 14, "every PackML state is reached: {words:?}");

    let mut comes_to_rest: HashSet<State> = seen.iter().filter(|state| state.at.is_at_rest()).copied().collect();
    for &state in &seen {
        let (mut now, mut way) = (state, Vec::new());
        while !comes_to_rest.contains(&now) {
            way.push(now);
            assert!(way.len() < 300, "{state:?} never rests");
            let event = next_healthy_report(&now).unwrap_or_else(|| panic!("a dead end: {now:?}"));
            now = canonical(step(now, event).0);
        }
        comes_to_rest.extend(way);
    }
    for state in seen.iter().filter(|state| state.at.is_at_rest()) {
        let mut now = step(*state, Event::Reported(Report::Robot(Robot::Ready))).0;
        for _ in 0..60 {
            let request = match now.at {
                At::Execute(_) => break,
                At::Idle => Request::Start { max_passes: 1, max_moves: 1, dries: false },
                At::Aborted { .. } => Request::Clear,
                At::Held(_) => Request::Stop,
                _ => Request::Reset,
            };
            now = step(
                now,
                next_healthy_report(&now).filter(|_| !now.at.is_at_rest()).unwrap_or(Event::Asked(request)),
            )
            .0;
        }
        assert_eq!(now.at, At::Execute(Phase::Locate), "no way to a cycle from {state:?}");
    }
}
