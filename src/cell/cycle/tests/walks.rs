//! Thousands of seeded random walks: nine of ten steps are the next event of a healthy cell.

use super::super::rules::{Rule, Rules};
use super::super::*;
use super::cell::Cell;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use strum::IntoEnumIterator;

const WALKS: u64 = 6_000;
const STEPS: usize = 300;

/// The situations that the walks reached, with their counts.
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

/// Maximum number of events from the last fault to the begin of a cycle.
const RECOVERY: usize = 120;

/// Checks that clear, reset and start succeed after the last fault, whatever happened before.
fn recovers(cell: &mut Cell, random: &mut Pcg64) -> Result<(), String> {
    let mut asked = [0; 2];
    for _ in 0..RECOVERY {
        let begun = matches!(cell.state.at, At::Execute(Phase::Locate)) && asked[1] > 0;
        if begun {
            return Ok(());
        }
        let works = matches!(cell.state.at, At::Execute(_) | At::Starting | At::Unholding { .. });
        let stop = (works && asked[1] == 0 && !cell.condition_due).then_some(Event::Asked(Request::Stop));
        let event = stop.or_else(|| cell.recovering(random)).ok_or_else(|| "a dead end".to_owned())?;
        asked[0] += usize::from(event == Event::Asked(Request::Clear));
        asked[1] += usize::from(matches!(event, Event::Asked(Request::Start { .. })));
        if asked[0] > 1 {
            return Err("one clear is not enough".to_owned());
        }
        cell.feed(event).and_then(|()| cell.pump())?;
    }
    Err(format!("no cycle begins within {RECOVERY} steps of the last fault"))
}

/// Performs one random walk; the error states what was wrong, with the last events.
fn walk(rules: Rules, seed: u64, coverage: &mut Coverage) -> Result<(), String> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut cell = Cell::new(rules);
    // Ten percent on average: walks with few surprises get far, walks with many reach every situation.
    let surprises = random.random_range(0.01..0.19);
    for index in 0..STEPS {
        let before = cell.state;
        let said = if random.random_bool(surprises) {
            Some(cell.surprise(&mut random))
        } else {
            cell.healthy(&mut random)
        };
        let event = said.ok_or_else(|| "a dead end".to_owned());
        let done = event.and_then(|event| cell.feed(event)).and_then(|()| cell.pump());
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
fn no_walk_finds_what_must_never_be_and_the_walks_see_everything() {
    let mut coverage = Coverage::new();
    for seed in 0..WALKS {
        walk(Rules::ALL, seed, &mut coverage).unwrap_or_else(|wrong| panic!("{wrong}"));
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

/// Proves that the walks are effective: each rule is removed in turn, and the walks must then find the situation
/// that it prevented.
#[test]
fn without_any_one_rule_the_walks_find_what_it_kept_away() {
    let mut missed = Vec::new();
    for rule in Rule::iter() {
        let found = (0..WALKS).find_map(|seed| walk(Rules::without(rule), seed, &mut Coverage::new()).err());
        match found {
            Some(wrong) => println!("{rule:?}: {}", wrong.lines().next().unwrap_or_default()),
            None => missed.push(rule),
        }
    }
    assert!(missed.is_empty(), "missing: {missed:?}");
}
