//! Tests of the simulated world in operation: the mock controller over TCP in lock step, both cameras, small pictures.

mod reach;

use super::*;
use crate::cameras::{
    Arm, FlangeCamera, Scanner, SimulatedFlangeCamera, SimulatedScanner, conform, simulated_cameras,
};
use crate::mock::{MockServer, Ports};
use crate::robot::{Address, BlockingLink};
use crate::world::contact_errors;
use panelprep_base::geometry::{Camera, KukaPose, Panel, Point};
use panelprep_cell::cell::Feedback;
use panelprep_kuka::eki::{
    ClockMode, Command, CommandId, LinkLimits, MoveJ, MoveLin, Report, SetAccSpeed, SetTcp, Signal as Out, TcpKind,
};
use panelprep_sim::{Scene, WET_FROM_S};
use reach::{ARM, tool, tool_pose_above};
use std::time::Duration;

const DISC_MM: f64 = 30.0;

/// Test bench: a simulated cell with its controller, link and cameras.
struct Bench {
    cell: cell::Cell,
    sim: sim::Cell,
    world: SimulatedWorld,
    scanner: SimulatedScanner,
    flange: SimulatedFlangeCamera,
    link: BlockingLink,
    server: MockServer,
}

impl Bench {
    fn new() -> Self {
        let text = include_str!("../../../../../config/cell.toml");
        let cell = cell::Cell::check("config/cell.toml", text).expect("a shipped file");
        let sim = sim::Cell::new(1, Scene::Good, 8);
        let world = SimulatedWorld::new(sim.clone(), &cell).expect("the shipped file has all names");
        world.mount_disc(DISC_MM);
        let [commands, states] = [panelprep_kuka::eki::CELLCMD, panelprep_kuka::eki::CELLSTAT]
            .map(|text| ChannelFile::parse(text).expect("a shipped file"));
        let controller =
            Controller::new(world.mock_setup(&cell, commands, states), world.terminals()).expect("fits");
        let server = MockServer::start(controller, Ports::free_ports()).expect("starts");
        let address = Address {
            host: "127.0.0.1".to_owned(),
            command_port: server.command_address().port(),
            state_port: server.state_address().port(),
        };
        let link = BlockingLink::start(address, LinkLimits::default(), ClockMode::LockStep).expect("starts");
        let (scanner, flange) = simulated_cameras(&world, &Arm::Mock(server.handle()));
        let mut bench = Bench { cell, sim, world, scanner, flange, link, server };
        bench.until(|report| matches!(report, Report::Connected { .. }));
        bench.link.open_epoch().expect("connected");
        bench.until(|report| matches!(report, Report::EpochOpened { .. }));
        let speed = SetAccSpeed {
            speed_m_s: 0.1,
            acceleration_m_s2: 2.0,
            axis_speed_percent: 50,
            axis_acceleration_percent: 50,
        };
        bench.send(Command::SetAccSpeed(speed));
        bench
    }

    fn until(&mut self, found: impl Fn(&Report) -> bool) {
        for _ in 0..5_000 {
            let report = self.link.next(Duration::from_secs(20)).expect("the controller continues");
            if found(&report) {
                return;
            }
            assert!(matches!(report, Report::State(_) | Report::Progress { .. }), "unexpected: {report:?}");
        }
        panic!("five thousand reports and not the one");
    }

    /// Sends a command and waits until it is executed.
    fn send(&mut self, command: Command) {
        let id = self.link.send(command).expect("good");
        self.until(|report| matches!(report, Report::Progress { done } if *done >= id));
    }

    fn pass_s(&mut self, seconds: f64) {
        let until_ms = self.now_ms() + (seconds * 1_000.0) as u64;
        while self.now_ms() < until_ms {
            self.until(|report| matches!(report, Report::State(_)));
        }
    }

    fn now_ms(&self) -> u64 {
        self.server.handle().with_controller(|controller| controller.time_ms())
    }

    fn switch(&mut self, output: Output, on: bool) {
        let number = self.cell.inputs_outputs().output(output).expect("named");
        self.send(Command::SetDigout(Out { number, on }));
    }

    fn move_j(&mut self, joints: Joints) {
        self.send(Command::MoveJ(MoveJ { joints, axis_speed_percent: 50.0 }));
    }

    fn park(&mut self) {
        self.move_j(self.cell.park_pose().expect("named"));
    }

    fn gray(&mut self, point: Point<Panel>) -> f64 {
        let picture = self.scanner.capture_2d().expect("simulated").picture;
        gray_at(&self.sim, &picture, point)
    }

    /// Wets the panel for four seconds, and then waits for `stands_s` with the film on it.
    fn wet(&mut self, stands_s: f64) {
        self.switch(Output::LensShutter, true);
        self.pass_s(0.3);
        self.switch(Output::Spray, true);
        self.pass_s(4.0);
        self.switch(Output::Spray, false);
        self.pass_s(0.3);
        self.switch(Output::LensShutter, false);
        self.pass_s(stands_s);
    }

    /// Moves the running disc over a square of 40 mm around a point of the true surface.
    fn sand(&mut self, middle: Point<Panel>) {
        let truth = self.world.truth().clone();
        let base = KukaPose::from_rigid(&truth.base_from_panel);
        let place = |across_mm: f64, up_mm: f64, height_mm: f64| {
            let aside =
                middle + panelprep_base::geometry::Vector::new(nalgebra::Vector3::new(0.0, across_mm, up_mm));
            let on = aside + truth.normal(aside) * -truth.distance_mm(aside);
            tool_pose_above(&truth, on, height_mm)
        };
        let rows = [-18.0, -6.0, 6.0, 18.0].map(|up_mm| {
            let row = (-4..=4).map(move |step| (f64::from(step) * 5.0, up_mm));
            if up_mm == -6.0 || up_mm == 18.0 { row.rev().collect::<Vec<_>>() } else { row.collect() }
        });
        let mut poses: Vec<_> = vec![(place(-20.0, -18.0, 30.0), false)];
        poses.extend(rows.concat().into_iter().map(|(across_mm, up_mm)| (place(across_mm, up_mm, 0.0), true)));
        poses.push((place(-20.0, 18.0, 30.0), false));
        let above = truth.base_from_panel * poses[0].0 * tool().inverse();
        self.move_j(ARM.nearest(&above, &self.cell.park_pose().expect("named")).expect("in reach"));
        let flange_from_tool = KukaPose::from_rigid(&tool());
        self.send(Command::SetBase(base));
        self.send(Command::SetTcp(SetTcp { flange_from_tool, kind: TcpKind::Sanding }));
        self.switch(Output::Extraction, true);
        self.pass_s(1.0);
        self.switch(Output::Tool, true);
        self.pass_s(1.1);
        let line = |(pose, contact): (Rigid<Panel, panelprep_base::geometry::Tool>, bool)| MoveLin {
            pose: KukaPose::from_rigid(&pose),
            blend_mm: if contact { 1.0 } else { 0.0 },
            contact,
            speed_m_s: None,
        };
        let last: CommandId = self.link.send_path(poses.into_iter().map(line).collect()).expect("a good path");
        self.until(|report| matches!(report, Report::PathDone { last: done } if *done == last));
        self.switch(Output::Tool, false);
    }
}

/// Returns the mean brightness of the 3 × 3 pixels around the position of a point of the true panel in the scanner's
/// picture.
fn gray_at(sim: &sim::Cell, picture: &ColorPicture, point: Point<Panel>) -> f64 {
    let truth = sim.truth();
    let seen: Point<Camera> = truth.base_from_camera.inverse() * (truth.base_from_panel * point);
    let pixel = sim.scanner().project_inside(seen).expect("in the picture");
    let (column, row) = (pixel.u.round() as usize, pixel.v.round() as usize);
    let gray = picture.to_gray();
    let of = |index: usize| f64::from(gray.gray[(row + index / 3 - 1) * gray.width + column + index % 3 - 1]);
    (0..9).map(of).sum::<f64>() / 9.0
}

#[test]
fn feedbacks_follow_their_outputs_in_the_controllers_time() {
    let mut bench = Bench::new();
    let feedbacks = [Feedback::LightOn, Feedback::WaterOff, Feedback::ExtractionFlow, Feedback::ToolRunning];
    let bits = feedbacks.map(|feedback| bench.cell.inputs_outputs().feedback_bit(feedback).expect("named"));
    let says = |bench: &mut Bench| loop {
        if let Some(Report::State(state)) = bench.link.next(Duration::from_secs(20)) {
            break bits.map(|bit| state.inputs >> bit & 1 == 1);
        }
    };
    bench.pass_s(0.2);
    assert_eq!(says(&mut bench), [false, true, false, false]);
    bench.switch(Output::Light, true);
    bench.switch(Output::Spray, true);
    assert_eq!(says(&mut bench), [false, false, false, false]);
    bench.pass_s(0.4);
    assert_eq!(says(&mut bench), [true, false, false, false]);
    bench.switch(Output::Spray, false);
    bench.switch(Output::Extraction, true);
    bench.pass_s(1.0);
    bench.switch(Output::Tool, true);
    assert_eq!(says(&mut bench), [true, true, true, false]);
    bench.pass_s(0.5);
    assert_eq!(says(&mut bench), [true, true, true, false], "it spins up");
    bench.pass_s(0.6);
    assert_eq!(says(&mut bench), [true, true, true, true]);
    let violations: Vec<Violation> = bench.world.violations().into_iter().map(|(_, violation)| violation).collect();
    assert_eq!(violations, [Violation::SprayOnLens]);
}

/// The picture is rendered from the true pose of the arm, not from the commanded one.
#[test]
fn a_flange_picture_shows_the_view_from_the_executed_pose() {
    let mut bench = Bench::new();
    let view = bench.sim.corner_views()[0];
    let aim = bench.sim.displaced_corner_pose(&view);
    bench.move_j(ARM.nearest(&aim, &bench.cell.park_pose().expect("named")).expect("in reach"));
    let taken = bench.flange.capture().expect("simulated");
    let executed = bench
        .server
        .handle()
        .with_controller(|controller| controller.executed_motions().last().copied())
        .expect("one");
    let stood = taken.base_from_flange.expect("the simulation knows it");
    assert_eq!(stood, executed.base_from_flange);
    // The link transfers angles as f32, so the pose is close to the commanded one but not equal.
    let off_mm = stood.origin().distance_mm(aim.origin());
    assert!(off_mm > 0.0 && off_mm < 0.01, "{off_mm}");
    let place = bench.sim.truth().base_from_panel;
    assert!(taken.picture == bench.sim.flange_picture_at(&executed.base_from_flange, &place));
    let refused = bench.scanner.capture_3d().expect_err("the arm is before the camera").to_string();
    assert!(
        refused.contains("the arm at standstill in its park pose")
            && refused.contains("and the arm is at standstill"),
        "{refused}"
    );
    assert_eq!(bench.world.violations().len(), 1);
    bench.park();
    let shot = bench.scanner.capture_3d().expect("parked");
    assert_eq!((shot.cloud.width(), shot.cloud.height()), (1944 / 8, 1200 / 8));
    assert_eq!(bench.world.violations().len(), 1);
}

/// With a colour sensor's filters, a picture over the network equals the picture without a network. On average it
/// differs from the rendered picture by at most two of 255 grey levels.
#[cfg(feature = "gige")]
#[test]
fn a_flange_picture_over_gige_is_the_one_without() {
    use crate::cameras::{BayerFlangeCamera, LoopbackFlangeCamera};
    let _alone = crate::gige::tests::lock_port();
    let mut bench = Bench::new();
    let aim = bench.sim.displaced_corner_pose(&bench.sim.corner_views()[0]);
    bench.move_j(ARM.nearest(&aim, &bench.cell.park_pose().expect("named")).expect("in reach"));
    let begun = std::time::Instant::now();
    let mut over_gige = loop {
        match LoopbackFlangeCamera::start(bench.flange.clone(), bench.sim.flange_camera()) {
            Err(CameraError::Missing { reason, .. }) if reason.contains("taken") => {
                assert!(begun.elapsed() < Duration::from_secs(300), "{reason}");
                std::thread::sleep(Duration::from_millis(200));
            }
            started => break started.unwrap_or_else(|error| panic!("{error}")),
        }
    };
    over_gige.check_ready().expect("it delivers");
    let came = over_gige.capture().unwrap_or_else(|error| panic!("{error}"));
    let without = BayerFlangeCamera::new(bench.flange.clone()).capture().expect("simulated");
    assert!(came.picture == without.picture);
    assert_eq!(over_gige.gauge().statistics().accepted, 1);
    let seen = bench.flange.capture().expect("simulated").picture;
    let off = |(came, seen): (&u8, &u8)| u64::from(came.abs_diff(*seen));
    let levels: u64 = came.picture.rgb.as_flattened().iter().zip(seen.rgb.as_flattened()).map(off).sum();
    let mean = levels as f64 / (3 * seen.rgb.len()) as f64;
    assert!(mean > 0.0 && mean < 2.0, "{mean}");
}

#[test]
fn the_simulated_scanner_passes_the_tests_of_all_scanners() {
    let mut bench = Bench::new();
    let lens = *bench.sim.scanner();
    bench.park();
    conform::check_shot(&mut bench.scanner, &lens);
    bench.switch(Output::Light, true);
    bench.pass_s(1.5);
    conform::check_pictures(&mut bench.scanner, &lens);
    let mut scanner = bench.scanner.clone();
    conform::check_clips(&mut scanner, &lens, || bench.pass_s(0.03));
}

/// Expected time, calculated by hand: in a clip of two pictures per second, the third picture is due after one second.
/// Missed pictures are not captured afterwards.
#[test]
fn a_simulated_clip_follows_the_worlds_time() {
    let mut bench = Bench::new();
    let mut scanner = bench.scanner.clone();
    scanner.begin_clip(2.0).expect("begun");
    let (mut times_s, until_ms) = (Vec::new(), bench.now_ms() + 1_300);
    while bench.now_ms() < until_ms {
        times_s.extend(scanner.next_clip_picture().expect("it continues").map(|picture| picture.time_s));
        bench.pass_s(0.1);
    }
    let since: Vec<f64> = times_s.iter().map(|time_s| time_s - times_s[0]).collect();
    assert!(since.len() == 3 && (since[1] - 0.5).abs() < 0.2 && (since[2] - 1.0).abs() < 0.2, "{since:?}");
}

#[test]
fn a_moving_arm_gives_no_picture() {
    let mut bench = Bench::new();
    let joints = bench.cell.park_pose().expect("named");
    bench.link.send(Command::MoveJ(MoveJ { joints, axis_speed_percent: 5.0 })).expect("good");
    bench.pass_s(0.5);
    assert!(matches!(bench.flange.capture(), Err(CameraError::ArmMoves)));
    assert!(matches!(bench.scanner.capture_3d(), Err(CameraError::ArmInView { moving: true, .. })));
    let violations: Vec<Violation> = bench.world.violations().into_iter().map(|(_, violation)| violation).collect();
    assert_eq!(violations, [Violation::ArmMoves, Violation::ArmInView]);
}

#[test]
fn without_light_it_is_dark_and_without_water_there_is_no_film() {
    let mut bench = Bench::new();
    let spot = bench.world.truth().spots[0].clone();
    let dark = bench.scanner.capture_2d().expect("simulated").picture;
    assert!(dark.rgb.iter().all(|pixel| *pixel == [0; 3]));
    bench.switch(Output::Light, true);
    bench.pass_s(0.4);
    let first = bench.scanner.capture_2d().expect("simulated");
    let dry = gray_at(&bench.sim, &first.picture, spot.centre);
    bench.pass_s(30.0);
    let later = bench.scanner.capture_2d().expect("simulated");
    assert!((gray_at(&bench.sim, &later.picture, spot.centre) - dry).abs() < 3.0, "dry it stays");
    assert!(first.picture != later.picture, "each picture has its own noise");
    assert!((later.time_s - first.time_s - 30.0).abs() < 0.2);
    // With the lens cover closed, the camera sees nothing.
    bench.switch(Output::LensShutter, true);
    bench.pass_s(0.4);
    assert_eq!(bench.gray(spot.centre), 0.0);
}

/// The first film breaks on both spots. The disc moves over one of them; the break in the current film remains. The
/// next film holds on this spot and breaks on the other.
#[test]
fn an_abraded_spot_holds_water_after_it_is_wetted_again() {
    let mut bench = Bench::new();
    let spots = bench.world.truth().spots.clone();
    let (abraded, left) = (spots[0].clone(), spots[1].clone());
    bench.switch(Output::Light, true);
    bench.park();
    bench.pass_s(0.4);
    let dry = [&abraded, &left].map(|spot| bench.gray(spot.centre));
    let all_broken_s = spots.iter().map(|spot| spot.grown_at_s).fold(0.0, f64::max) - WET_FROM_S + 1.0;
    bench.wet(0.5);
    let wet = [&abraded, &left].map(|spot| bench.gray(spot.centre));
    assert!((0..2).all(|i| wet[i] < 0.75 * dry[i]), "a whole film: {wet:?} of {dry:?}");
    bench.pass_s(all_broken_s);
    let broken = [&abraded, &left].map(|spot| bench.gray(spot.centre));
    assert!((0..2).all(|i| broken[i] > 0.9 * dry[i]), "both break: {broken:?} of {dry:?}");

    bench.sand(abraded.centre);
    bench.park();
    let trace = bench.server.handle().with_controller(|controller| controller.trace().to_vec());
    let touched = TouchedPoints::reached_by_disc(&trace, bench.world.truth(), DISC_MM);
    assert!(touched.covered_share(&abraded) > 0.999 && touched.covered_share(&left) == 0.0);
    let errors = contact_errors(&trace, bench.world.truth()).expect("it sanded");
    assert!(errors.surface_max_mm < 0.2 && errors.normal_max_deg < 0.5 && errors.samples > 100, "{errors:?}");
    assert!(bench.gray(abraded.centre) > 0.8 * dry[0], "the old film does not mend");

    bench.wet(all_broken_s);
    let after = [&abraded, &left].map(|spot| bench.gray(spot.centre));
    // The sanded area has another brightness: at most 1.4 times the dry brightness, of which a film leaves two thirds.
    assert!(after[0] < 0.66 * 1.4 * dry[0], "it holds its film: {after:?} of {dry:?}");
    assert!(after[1] > 0.8 * dry[1], "untouched, it breaks again: {after:?} of {dry:?}");
    assert_eq!(bench.world.greasy_spots(), bench.sim.spots()[1..]);
    assert_eq!(bench.world.violations(), []);
}

#[test]
fn a_value_that_is_missing_in_the_cells_file_is_reported() {
    let cell = |text: &str| cell::Cell::check("f", text).unwrap_or_else(|problems| panic!("{problems}"));
    let told = |text: &str| {
        let made = SimulatedWorld::new(sim::Cell::new(1, Scene::Clean, 8), &cell(text));
        made.err().expect("refused").to_string()
    };
    assert_eq!(told(""), "[io.outputs] light is missing; the simulated world needs its number");
    let outputs = "io.outputs = {light = 1, spray = 2, lens_shutter = 3, extraction = 4, tool = 5}";
    assert_eq!(told(outputs), "[io.feedbacks] light_on is missing; the simulated world needs its number");
}

/// When a part is removed, its films are removed as well. No third part is brought, so the third film is the second
/// film of the second part.
#[test]
fn the_films_of_a_part_are_removed_with_it() {
    const READY: u16 = 40;
    let text = include_str!("../../../../../config/cell.toml")
        .replace("water_off = 1\n", "water_off = 1\npart_present = 30\nstart_request = 31\n");
    let line = "[io.line_outputs]\nready = 40\ncycle_done = 41\npass = 42\nfail = 43\nreview = 44\nfault = 45\n[line]\nrecipe = 'a.toml'\n";
    let cell =
        cell::Cell::check("config/cell.toml", &(text + line)).unwrap_or_else(|problems| panic!("{problems}"));
    let world = SimulatedWorld::new(sim::Cell::new(1, Scene::Good, 8), &cell).expect("all names");
    world.bring_parts(2, &cell).expect("all signals");
    let spray = cell.inputs_outputs().output(Output::Spray).expect("named");
    let moment = |time_ms| RobotMoment {
        time_ms,
        joints: cell.park_pose().expect("named"),
        base_from_flange: KukaPose::default().to_rigid(),
        moving: false,
    };
    let films = [0, 100_000, 200_000].map(|begins_ms| {
        for (number, on, after_ms) in
            [(READY, true, 0), (spray, true, 2_000), (spray, false, 6_000), (READY, false, 7_000)]
        {
            world.terminals().on_output(number, on, begins_ms + after_ms);
        }
        world.picture(&moment(begins_ms + 10_000));
        world.true_breaks().len()
    });
    assert_eq!(films, [1, 1, 2]);
}
