//! Searches every state that the table can reach with small bounds, and from each state a sequence of events that
//! leads to rest.

use super::super::*;
use super::healthy::{REQUESTS, answers};
use std::collections::{HashMap, HashSet, VecDeque};

/// Returns the state without the parts that do not influence the table's decisions: ids are only compared and counted
/// up, causes are not distinguished, and nothing from a cycle that is over is used.
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

/// Returns the deadlines for which this state waits.
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

/// All possible events in this state, one of each kind that the table distinguishes.
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

/// The next report of a healthy cell without a request.
fn good_news(state: &State) -> Option<Event> {
    let answer = state.due.map(|due| answers(due.act, due.id)[0]);
    let timer = || timers(state).first().map(|&(which, id)| Report::Deadline { id, which });
    answer.or_else(timer).map(Event::Reported)
}

#[test]
fn every_state_comes_to_rest_and_every_rest_to_a_cycle() {
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
            let event = good_news(&now).unwrap_or_else(|| panic!("a dead end: {now:?}"));
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
            now = step(now, good_news(&now).filter(|_| !now.at.is_at_rest()).unwrap_or(Event::Asked(request))).0;
        }
        assert_eq!(now.at, At::Execute(Phase::Locate), "no way to a cycle from {state:?}");
    }
}
