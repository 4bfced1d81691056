use super::*;
use crate::world::{Violation, touch::TouchedPoints};
use panelprep_base::geometry::{Joints, KukaPose, Panel};
use panelprep_kuka::eki::{CommandId, Epoch, Mode};
use panelprep_sim::{self as sim, Scene};

const CELL: &str = include_str!("../../../../config/cell.toml");

fn cell() -> Cell {
    Cell::check("cell.toml", CELL).unwrap_or_else(|problems| panic!("{problems}"))
}

fn follower() -> Follower {
    let world = SimulatedWorld::new(sim::Cell::new(1, Scene::Good, 8), &cell()).expect("a world");
    Follower::new(world, &cell())
}

/// Creates a state message: outputs as bits in the order of their numbers, light first, tool last.
fn state_message(time_ms: u32, outputs: u32, base_from_tcp: KukaPose) -> State {
    State {
        time_ms,
        sequence: 1,
        answered: 0,
        epoch: Epoch(1),
        boot: 1,
        programs_checksum: 1,
        mode: Mode::External,
        drives_on: true,
        emergency_stop: false,
        guard_closed: true,
        moving: true,
        motion_possible: true,
        base_set: true,
        tool_set: true,
        stopped: false,
        inputs: 0,
        outputs,
        done: CommandId(0),
        underruns: 0,
        override_percent: 100,
        joints: Joints::default(),
        base_from_tcp,
        active_base: KukaPose { x_mm: 100.0, ..KukaPose::default() },
        flange_from_tool: KukaPose { z_mm: 120.0, ..KukaPose::default() },
    }
}

fn at(x_mm: f64) -> KukaPose {
    KukaPose { x_mm, ..KukaPose::default() }
}

const TOOL: u32 = 0b1_0000;
const SPRAY: u32 = 0b10;
const SHUTTER: u32 = 0b100;
/// The same number as `lens_shut` in the cell's file.
const SHUT_INPUT: u16 = 2;

/// Calculated by hand: the base is at X 100, the TCP 10 to 16 mm in front of the base and the flange 120 mm behind the
/// TCP; 6 mm in steps of 1 mm.
#[test]
fn the_tool_goes_straight_from_one_message_to_the_next() {
    let follower = follower();
    follower.process_state(&state_message(1_000, 0, at(0.0)));
    follower.process_state(&state_message(1_100, TOOL, at(10.0)));
    assert_eq!(follower.trace(9_999).len(), 1, "where it was before the tool ran does not count");
    follower.process_state(&state_message(1_200, TOOL, at(16.0)));
    let trace = follower.trace(9_999);
    let places: Vec<f64> = trace.iter().map(|sample| sample.base_from_tool.origin().mm.x).collect();
    assert_eq!(places.len(), 7);
    for (place, expected) in places.iter().zip([110.0, 111.0, 112.0, 113.0, 114.0, 115.0, 116.0]) {
        assert!((place - expected).abs() < 1e-9, "{places:?}");
    }
    assert!((trace[6].base_from_flange.origin().mm.z + 120.0).abs() < 1e-9);
    assert_eq!(follower.trace(1_100).len(), 1, "only up to that moment");
    follower.process_state(&state_message(1_900, TOOL, at(60.0)));
    assert_eq!(follower.trace(9_999).len(), 8, "a way of 700 ms is not known");
    follower.process_state(&state_message(2_000, 0, at(70.0)));
    assert_eq!(follower.trace(9_999).len(), 8, "the tool is off");
}

#[test]
fn outputs_act_on_the_world_and_time_continues() {
    let follower = follower();
    assert!(follower.current_moment().is_none());
    follower.process_state(&state_message(1_000, 0, at(0.0)));
    follower.process_state(&state_message(1_100, SPRAY, at(0.0)));
    assert_eq!(follower.world.violations(), [(1_000, Violation::SprayOnLens)]);
    follower.process_state(&state_message(1_200, SPRAY, at(0.0)));
    assert_eq!(follower.world.violations().len(), 1, "told once");
    std::thread::sleep(std::time::Duration::from_millis(20));
    assert!(follower.current_moment().expect("told").time_ms() >= 1_220);
    // The controller restarts and counts from zero; the world's time never runs backwards.
    follower.process_state(&state_message(50, 0, at(0.0)));
    assert!((1_250..2_000).contains(&follower.current_moment().expect("told").time_ms()));
}

/// Calculated by hand: the shutter needs 250 ms. It opened at 2.050 s, so the controller reads its feedback at 2.300
/// s. A scan that is taken because of the feedback in that message sees the panel.
#[test]
fn a_lens_whose_feedback_is_reported_is_open() {
    let follower = follower();
    let is_shut = |time_ms: u32| follower.world.terminals().input(SHUT_INPUT, u64::from(time_ms)) == Some(true);
    follower.process_state(&state_message(1_000, 0, at(0.0)));
    follower.process_state(&state_message(1_100, SHUTTER, at(0.0)));
    assert!(is_shut(2_000));
    follower.process_state(&state_message(2_000, SHUTTER, at(0.0)));
    [2_100, 2_200, 2_300]
        .into_iter()
        .for_each(|time_ms| follower.process_state(&state_message(time_ms, 0, at(0.0))));
    assert!(!is_shut(2_300));
    // After late messages, the time of the change is unknown.
    follower.process_state(&state_message(9_000, SHUTTER, at(0.0)));
    assert!(!is_shut(8_899) && is_shut(8_900));
}

/// If messages every 100 ms show a pass over a spot, the spot's grease is removed; with a pass 3 mm above it, this is
/// not so.
#[test]
fn what_the_messages_state_abrades() {
    let follower = follower();
    let truth = follower.world.truth().clone();
    let spot = &truth.spots[0];
    let along = |height_mm: f64| {
        let normal = truth.normal(spot.centre);
        let turn = nalgebra::UnitQuaternion::rotation_between(&nalgebra::Vector3::z(), &-normal.mm).expect("one");
        let place = (spot.centre + normal * height_mm).mm.coords;
        let panel_from_tool =
            Rigid::<Panel, Tool>::from_isometry_unchecked(nalgebra::Isometry3::from_parts(place.into(), turn));
        KukaPose::from_rigid(&(truth.base_from_panel * panel_from_tool))
    };
    let share = |height_mm: f64| {
        let follower = Follower { received_states: Arc::default(), ..follower.clone() };
        let state =
            |time_ms| State { active_base: KukaPose::default(), ..state_message(time_ms, TOOL, along(height_mm)) };
        [0, 100, 200].into_iter().for_each(|time_ms| follower.process_state(&state(time_ms)));
        TouchedPoints::reached_by_disc(&follower.trace(9_999), &truth, 200.0).covered_share(spot)
    };
    assert!((share(0.0) - 1.0).abs() < 1e-12);
    assert_eq!(share(3.0), 0.0);
}

#[test]
fn a_controller_that_is_no_mock_is_not_followed() {
    assert!(Follower::is_simulated_controller(&state_message(0, 0, at(0.0))));
    assert!(!Follower::is_simulated_controller(&State { boot: 813_715_200, ..state_message(0, 0, at(0.0)) }));
}
