//! Tests cycles of the service that are recorded and replayed.

use super::fake::Cell as Fake;
use super::serving::{Script, complete};
use super::*;
use panelprep_cell::cycle::State;
use panelprep_store::tape::{Entry, EntryReader, LoopMemoryStart, Topic, check_recording};
use std::path::Path as File;

/// Maximum number of attempts of a test that uses the wall clock.
const MAX_ATTEMPTS: usize = 5;

/// Serves this script, records the second cycle that it requests, and replays the recording. Returns the recorded
/// entries and the verdict.
fn recorded(mut fake: Fake, script: impl FnOnce(Script, &Fake, &Fake) -> Script) -> (Vec<Entry>, Option<Verdict>) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cycle.mcap");
    let mut plain = Fake::new(Scene::Clean);
    (plain.more_recipe, plain.more_cell) = (fake.more_recipe, fake.more_cell);
    fake.record = Some(file.clone());
    let mut script = script(Script::default(), &plain, &fake);
    fake.serve(|cameras| cameras, vec![], &mut script);
    let (ended, played) = fake.replay(&file);
    assert!(played.differences.is_empty() && played.is_complete && played.error.is_none(), "{played:?}");
    assert_eq!(ended.verdict.as_ref(), script.verdicts.last());
    (entries(&file), ended.verdict)
}

fn entries(file: &File) -> Vec<Entry> {
    let bytes = std::fs::read(file).expect("a recording");
    let start = check_recording(&bytes[..]).expect("whole").start;
    assert!(matches!(start.begin, LoopMemoryStart::Cycle { robot: Some(_), .. }), "{start:?}");
    EntryReader::new(&bytes[..], start.unix_ns).collect::<Result<_, _>>().expect("read")
}

fn asked(entries: &[Entry]) -> Vec<String> {
    let heard = entries.iter().filter(|entry| entry.topic == Topic::Request && !entry.reply.is_null());
    heard.map(|entry| entry.reply.to_string()).collect()
}

/// The first cycle is not recorded; its deadlines remain active. The second cycle is recorded completely, with contact
/// and a second film.
#[test]
fn a_cycle_of_the_service_replays_without_a_difference() {
    let (entries, verdict) = recorded(Fake::new(Scene::Good), |script, plain, taped| {
        script.reset().start(plain).reset().start(taped).leave_when(complete)
    });
    assert_eq!(verdict, Some(Verdict::Pass));
    let asked = asked(&entries);
    assert!(asked.len() == 2 && asked[0].contains("start") && asked[1].contains("leave"), "{asked:?}");
}

/// Requests of people are part of the recording: a new disc, a review that a person accepts, a start that is not
/// possible at that time, and a hold.
#[test]
fn requests_during_a_cycle_are_replayed() {
    let mut fake = Fake::new(Scene::Good);
    (fake.more_recipe, fake.worn_mm2) = ("[path]\ndisc_life_mm2 = 1000000\n", 999_900.0);
    let held = |state: &State| matches!(state.at, At::Held(_));
    let films = |state: &State| matches!(state.at, At::Execute(panelprep_cell::cycle::Phase::Inspect));
    let (entries, verdict) = recorded(fake, |script, plain, taped| {
        let dries = taped.dries();
        script
            .reset()
            .start(taped)
            .when(held, RequestKind::NewDisc)
            .when(held, RequestKind::Table(cycle::Request::Accept))
            .when(films, RequestKind::Begin(Box::new(plain.prepared())))
            .when(films, RequestKind::Table(cycle::Request::Hold))
            .when(move |state| held(state) && dries(), RequestKind::Table(cycle::Request::Unhold { dried: true }))
            .leave_when(complete)
    });
    let findings =
        || entries.iter().filter(|e| e.topic == Topic::Finding).map(|e| e.action["judgement"].to_string());
    assert_eq!(verdict, Some(Verdict::Pass), "{:#?}", findings().collect::<Vec<_>>());
    let asked = asked(&entries);
    assert_eq!(asked.len(), 7, "{asked:?}");
    for (word, heard) in ["start", "new_disc", "accept", "start", "hold", "unhold", "leave"].iter().zip(&asked) {
        assert!(heard.contains(word), "{word}: {asked:?}");
    }
}

/// With the wall clock the robot continues to report during a computation; in the replay, the result arrives at the
/// recorded point. The cycle is stopped in the middle of its film.
#[test]
fn with_the_wall_clock_results_arrive_at_the_recorded_time() {
    let stopped_in_the_film = || {
        let mut fake = Fake::new(Scene::Clean);
        fake.by_the_wall = true;
        let mut looks = 0;
        let films = move |state: &State| {
            looks += u32::from(matches!(state.at, At::Execute(panelprep_cell::cycle::Phase::Inspect)));
            looks > 2 || matches!(state.at, At::Aborted { .. })
        };
        let (entries, verdict) = recorded(fake, |script, _, taped| {
            script
                .reset()
                .start(taped)
                .when(films, RequestKind::Table(cycle::Request::Stop))
                .leave_when(|state| matches!(state.at, At::Stopped | At::Aborted { .. }) || complete(state))
        });
        assert_eq!(verdict, Some(Verdict::Aborted));
        // The robot reported its state while the scan was evaluated.
        let scan = entries.iter().position(|entry| entry.action == "scan")?;
        let located = entries.iter().skip(scan).position(|entry| entry.topic == Topic::Result)?;
        Some(entries[scan..scan + located].iter().filter(|entry| entry.topic == Topic::Report).count())
    };
    // On a busy machine, deadlines of the connection may end the cycle before its scan is evaluated.
    let reports = (0..MAX_ATTEMPTS).find_map(|_| stopped_in_the_film()).expect("a cycle that reaches its film");
    assert!(reports > 0, "the robot did not report while the scan was evaluated");
}

/// The commands and reports of the compliant tool are part of the recording; the replay of the cycle gives the same
/// result.
#[test]
fn a_cycle_with_a_compliant_tool_replays_without_a_difference() {
    let mut fake = Fake::new(Scene::Good).step_by_step();
    (fake.more_recipe, fake.more_cell) =
        ("[path]\nforce_n = 20\n", "tool_error_mm = 1.0\n[tool]\nkind = 'simulated'\n");
    let (entries, verdict) = recorded(fake, |script, plain, taped| {
        script.reset().start(plain).reset().start(taped).leave_when(complete)
    });
    assert_eq!(verdict, Some(Verdict::Pass));
    let of_tool = entries.iter().filter(|entry| entry.topic == Topic::Tool);
    let (told, heard): (Vec<_>, Vec<_>) = of_tool.partition(|entry| !entry.action.is_null());
    assert!(told.len() > 4 && heard.len() > 100, "{} {}", told.len(), heard.len());
}
