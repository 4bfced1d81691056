//! The contents that a cell's file needs for a purpose: decided here for every command.
//!
//! A file may omit what offline work does not need. A lack that would make a motion or a cycle refuse later is
//! refused here before anything begins, and `panelprep check` reports it at the desk. [`unmet_requirements`] examines only the
//! cell's file, [`incomplete_files`] also the files that it names; `check`, `doctor`, `run` and `cycle` all use these
//! two. `panelprep doctor` checks whether devices answer.

mod findings;
mod named_files;
pub mod recipe_fits;

pub use findings::{ProblemKind, Purpose, UnmetRequirement, to_problems};
pub use named_files::{CALIBRATION_ADVICE, NamedFile, ReadNamed, is_same_correction, skip_file};

use nalgebra::Isometry3;
use panelprep_base::geometry::{Joints, Rigid};
use panelprep_base::number_text::{fixed_decimals, shortest_text};
use panelprep_cell::cell::{Camera, Cell, Output, Robot, RobotKind};
use panelprep_toolpath::path::Kinematics;
use panelprep_toolpath::path::reach::joint_motion;

/// Returns everything that this purpose needs and the cell's file does not contain; empty if nothing is missing.
pub fn unmet_requirements(cell: &Cell, purpose: Purpose) -> Vec<UnmetRequirement> {
    let is_mock = cell.robot().kind() == RobotKind::Mock;
    match purpose {
        Purpose::Robot if is_mock => names(cell, true).into_iter().chain(check_park(cell)).collect(),
        Purpose::Robot => Vec::new(),
        Purpose::Cycle => {
            let simulates = is_mock || simulated_cameras(cell).iter().any(|(_, is)| *is);
            let parts = [
                names(cell, simulates),
                check_park(cell),
                poses(cell),
                limits(cell),
                calibrations(cell),
                cameras(cell),
            ];
            parts.concat()
        }
    }
}

/// Returns the result of [`unmet_requirements`], the files named in the cell's file that are missing or wrong, and the missing
/// acceptance of a real controller's programs.
pub fn incomplete_files(cell: &Cell, purpose: Purpose, read: ReadNamed<'_>) -> Vec<UnmetRequirement> {
    let of_files = named_files::unmet_files(cell, purpose, read);
    unmet_requirements(cell, purpose).into_iter().chain(of_files).chain(acceptance(cell, purpose)).collect()
}

/// Requires the sum of the programs with which the cell was accepted. A rehearsal with `mock-robot` on this computer
/// needs none. This is an early notice and no permission: a real controller behind a tunnel is recognised by its
/// state, and nothing moves in automatic mode without its signed proofs, which need the sum.
fn acceptance(cell: &Cell, purpose: Purpose) -> Option<UnmetRequirement> {
    let robot = cell.robot();
    let message = "is missing: with which programs of the controller this cell was accepted is NOT PROVEN, and others would not \
                   be noticed; run `panelprep doctor --kuka DIR --accept` with the controller's files and add the \
                   line that it prints";
    let lacks = purpose == Purpose::Cycle && is_elsewhere(robot) && robot.programs_sum().is_none();
    lacks.then(|| UnmetRequirement {
        kind: ProblemKind::Acceptance,
        ..UnmetRequirement::new("robot.programs_sum", message)
    })
}

/// Returns whether the controller is another machine, by its address.
fn is_elsewhere(robot: &Robot) -> bool {
    robot.kind() == RobotKind::Eki && !robot.is_local_controller()
}

/// Returns the names of the cameras, each with a flag that states whether the camera is simulated.
fn simulated_cameras(cell: &Cell) -> [(&'static str, bool); 2] {
    [
        ("scanner", matches!(cell.scanner(), Camera::Simulated)),
        ("flange_camera", matches!(cell.flange_camera(), Camera::Simulated)),
    ]
}

/// Finds missing outputs and feedbacks. The simulated world reports the effect of an output by every feedback.
fn names(cell: &Cell, simulates: bool) -> Vec<UnmetRequirement> {
    let io = cell.inputs_outputs();
    let mut missing = Vec::new();
    for output in Output::ALL.iter().copied() {
        let (name, feedback) = (output.name(), output.feedback());
        if io.output(output).is_none() {
            let message = "is missing; a cycle switches this output: state the number n of its $OUT[n]";
            missing.push(UnmetRequirement::new(format!("io.outputs.{name}"), message));
        }
        // The light is proven by its output as the controller reports it, and by `light_on` only if that feedback
        // exists.
        let is_read = simulates || output != Output::Light;
        if is_read && io.feedback(feedback).is_none() {
            let message = format!(
                "is missing; this feedback proves that {name} was switched: state the number n of its $IN[n]"
            );
            missing.push(UnmetRequirement::new(format!("io.feedbacks.{}", feedback.name()), message));
        }
    }
    missing.extend(io.undecided().into_iter().map(|name| {
        let message = "does not state what a stop does with it; state its time in [io.off_after_s] (0 for all that moves \
                       or lets water run), or name it in [io] may_stay_on";
        UnmetRequirement::new(format!("io.outputs.{name}"), message)
    }));
    missing
}

fn check_park(cell: &Cell) -> Vec<UnmetRequirement> {
    let message = "is missing; every cycle starts from this pose: state the axis angles with the arm clear of the \
                   panel and of both cameras' view";
    let missing = cell.park_pose().is_none().then(|| UnmetRequirement::new("poses.park", message));
    missing.into_iter().collect()
}

/// Checks that the arm can reach the poses of a cycle, and can turn its axes from one pose to the other without
/// meeting an obstacle.
fn poses(cell: &Cell) -> Vec<UnmetRequirement> {
    let (park, ready) = (cell.park_pose(), cell.pose("ready"));
    let named: Vec<(&str, Joints)> =
        [("park", park), ("ready", ready)].into_iter().filter_map(|(name, pose)| Some((name, pose?))).collect();
    let beyond: Vec<UnmetRequirement> =
        named.iter().flat_map(|(name, pose)| axes_beyond_limits(cell, name, pose)).collect();
    if !beyond.is_empty() {
        return beyond;
    }
    // The check ignores the tool, which a calibration determines: any obstacle of the arm alone is also an obstacle
    // with a tool.
    let (arm, no_tool) = (Kinematics::new(cell.arm()), Rigid::from_isometry_unchecked(Isometry3::identity()));
    let first = named.first().map(|first| (*first, *first));
    let both = named.first().zip(named.get(1)).into_iter();
    let ways = first.into_iter().chain(both.flat_map(|(park, ready)| [(*park, *ready), (*ready, *park)]));
    let unmet_poses = |((from, start), (to, end)): ((&str, Joints), (&str, Joints))| {
        let obstacle = joint_motion(&arm, no_tool, &start, &end).err()?;
        let way =
            if from == to { "in this pose,".to_owned() } else { format!("on the motion from [poses] {from}:") };
        Some(UnmetRequirement::new(
            format!("poses.{to}"),
            format!("the arm cannot reach this pose: {way} {obstacle}"),
        ))
    };
    let mut unmet_poses: Vec<UnmetRequirement> = ways.filter_map(unmet_poses).collect();
    unmet_poses.truncate(1);
    unmet_poses
}

/// Finds the axes of a pose that are beyond the arm's limits.
fn axes_beyond_limits(cell: &Cell, name: &str, pose: &Joints) -> Vec<UnmetRequirement> {
    let axes = cell.arm().axes();
    let angles = pose.degrees();
    let of_axis = |(axis, angle): (usize, f64)| {
        let (low, high) = (axes.min_deg[axis], axes.max_deg[axis]);
        let message = || {
            let [angle, low, high] = [angle, low, high].map(shortest_text);
            format!(
                "found {angle}, the limits are {low} to {high}: the arm's axis {} cannot turn farther",
                axis + 1
            )
        };
        (!(low..=high).contains(&angle))
            .then(|| UnmetRequirement::new(format!("poses.{name}.a{}_deg", axis + 1), message()))
    };
    angles.into_iter().enumerate().filter_map(of_axis).collect()
}

fn limits(cell: &Cell) -> Vec<UnmetRequirement> {
    let Some(space) = cell.limits().workspace() else {
        let message = "is missing, and box_max_mm, too; without this box for the tool centre point (TCP), the robot \
                       makes no linear motions";
        return vec![UnmetRequirement::new("limits.box_min_mm", message)];
    };
    let [low, high] = [space.min, space.max].map(|corner| [corner.mm.x, corner.mm.y, corner.mm.z]);
    check_box_unit("limits.box_max_mm", low, high).into_iter().collect()
}

/// The working volume of a robot is never smaller than this, mm: the numbers of a smaller box are metres.
const MIN_BOX_MM: f64 = 10.0;

/// Reports a box with a longest edge so short that its numbers must be metres.
fn check_box_unit(key: &str, low: [f64; 3], high: [f64; 3]) -> Option<UnmetRequirement> {
    let edges = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let message = || {
        let [x, y, z] = edges.map(|edge| fixed_decimals(edge, 2));
        format!("found a box of {x} × {y} × {z} mm; are these metres? write millimetres")
    };
    edges.iter().all(|edge| *edge < MIN_BOX_MM).then(|| UnmetRequirement::new(key, message()))
}

fn calibrations(cell: &Cell) -> Vec<UnmetRequirement> {
    let files = cell.calibration();
    let named = [
        ("scanner", files.scanner.is_some()),
        ("flange_camera", files.flange_camera.is_some()),
        ("base_from_camera", files.base_from_camera.is_some()),
        ("flange_from_camera", files.flange_from_camera.is_some()),
        ("flange_from_tool", files.flange_from_tool.is_some()),
    ];
    let missing = named.into_iter().filter(|(_, is_named)| !is_named);
    let message =
        "is missing; name the file that `panelprep calibrate` writes, or `panelprep render` for a simulated cell";
    missing.map(|(key, _)| UnmetRequirement::new(format!("calibration.{key}"), message)).collect()
}

/// Checks whether the cameras match the robot, and have what they need for a shot.
fn cameras(cell: &Cell) -> Vec<UnmetRequirement> {
    let mut wrong = Vec::new();
    let robot = cell.robot();
    if is_elsewhere(robot) {
        let message = format!(
            "found \"simulated\", a camera of the simulated cell, but [robot] is a controller at {}; configure the \
             real camera or a recording, or test with `panelprep mock-robot` and host = \"127.0.0.1\"",
            robot.host()
        );
        let simulated = simulated_cameras(cell).into_iter().filter(|(_, is)| *is);
        wrong.extend(simulated.map(|(table, _)| UnmetRequirement::new(format!("{table}.kind"), message.clone())));
    }
    if let Camera::Device(zivid) = cell.scanner() {
        for (key, is_named) in
            [("settings", zivid.settings.is_some()), ("settings_2d", zivid.settings_2d.is_some())]
        {
            let message = "is missing; kind = \"zivid\" needs it to take a shot: name the file that Zivid Studio saved \
                           (settings for 3D shots with colour, settings_2d for pictures)";
            wrong.extend((!is_named).then(|| UnmetRequirement::new(format!("scanner.{key}"), message)));
        }
    }
    if cfg!(not(feature = "gige")) && matches!(cell.flange_camera(), Camera::Device(_)) {
        let message = "found \"gige\", but this program was built without the cargo feature gige; use a build with \
                       this feature; valid without it: \"simulated\" and \"recorded\"";
        wrong.push(UnmetRequirement::new("flange_camera.kind", message));
    }
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = include_str!("../../config/cell.toml");

    fn keys(text: &str, purpose: Purpose) -> Vec<String> {
        let cell = Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        unmet_requirements(&cell, purpose).into_iter().map(|unmet| unmet.key).collect()
    }

    /// Each case is one change of the shipped cell's file, and the keys that are then reported.
    #[test]
    fn each_thing_that_a_cycle_would_refuse_is_named() {
        assert_eq!(keys(WHOLE, Purpose::Cycle), [""; 0]);
        let robot = "[robot]\nkind = \"mock\"";
        let eki = |host: &str| WHOLE.replace(robot, &format!("[robot]\nkind = \"eki\"\nhost = \"{host}\""));
        assert!(WHOLE.contains(robot));
        let replaced = |from: &str, to: &str| {
            let text = WHOLE.replacen(from, to, 1);
            assert_ne!(text, WHOLE, "{from}");
            text
        };
        let post = "\n[[keep_out]]\nname = \"post\"\nmin_mm = [-250, 200, 0]\nmax_mm = [-150, 300, 900]\n";
        for (text, expected) in [
            (replaced("park = { a1_deg = -120.0", "park = { a1_deg = -320.0"), vec!["poses.park.a1_deg"]),
            (replaced("ready = { a1_deg = 0.0", "ready = { a1_deg = 190.0"), vec!["poses.ready.a1_deg"]),
            (replaced("spray = 2 ", ""), vec!["io.outputs.spray"]),
            (replaced("lens_shut = 2", ""), vec!["io.feedbacks.lens_shut"]),
            (replaced("light_on = 5", ""), vec!["io.feedbacks.light_on"]),
            (replaced("box_min_mm = [", "# [").replacen("box_max_mm = [", "# [", 1), vec!["limits.box_min_mm"]),
            (replaced("flange_from_tool =", "# "), vec!["calibration.flange_from_tool"]),
            (
                replaced("box_min_mm = [", "box_min_mm = [0.1, -0.4, 0.0] # [").replacen(
                    "box_max_mm = [",
                    "box_max_mm = [0.8, 0.4, 0.9] # [",
                    1,
                ),
                vec!["limits.box_max_mm"],
            ),
            (eki("172.31.1.147"), vec!["scanner.kind", "flange_camera.kind"]),
            (eki("127.0.0.1"), vec![]),
            (eki("localhost").replace("light_on = 5", ""), vec!["io.feedbacks.light_on"]),
            (
                replaced("[scanner]\nkind = \"simulated\"", "[scanner]\nkind = \"zivid\"\nsettings = \"a.yml\""),
                vec!["scanner.settings_2d"],
            ),
            (format!("{WHOLE}{post}"), vec!["poses.park"]),
            (replaced("spray = 2 ", "pump = 9\nspray = 2 "), vec!["io.outputs.pump"]),
            (replaced("spray = 2 ", "pump = 9\nspray = 2 ") + "\n[io]\nmay_stay_on = [\"pump\"]\n", vec![]),
        ] {
            assert_eq!(keys(&text, Purpose::Cycle), expected, "{text}");
        }
    }

    /// No cycle starts on a real controller whose programs were not accepted; single functions, with which the cell is
    /// commissioned, need no acceptance, and a rehearsal on this computer has none.
    #[test]
    fn a_cycle_on_a_real_controller_needs_accepted_programs() {
        let example = include_str!("../../config/cell-example.toml");
        let needs = |text: &str, purpose| {
            let cell = Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
            let all = incomplete_files(&cell, purpose, &skip_file);
            all.into_iter().any(|unmet| unmet.kind == ProblemKind::Acceptance && unmet.key == "robot.programs_sum")
        };
        let accepted = example.replacen("# programs_sum = ", "programs_sum = ", 1);
        assert_ne!(accepted, example);
        let here = example.replacen("host = \"172.31.1.147\"", "host = \"127.0.0.1\"", 1);
        assert!(needs(example, Purpose::Cycle));
        assert!(!needs(example, Purpose::Robot) && !needs(&accepted, Purpose::Cycle));
        assert!(!needs(&here, Purpose::Cycle) && !needs(WHOLE, Purpose::Cycle));
    }

    #[test]
    fn a_real_cell_needs_no_feedback_of_its_light_and_its_robot_alone_needs_nothing() {
        let example = include_str!("../../config/cell-example.toml");
        assert_eq!(keys(example, Purpose::Cycle), [""; 0]);
        assert_eq!(keys(&example.replacen("light_on = 21", "", 1), Purpose::Cycle), [""; 0]);
        assert_eq!(keys("[robot]\nkind = 'eki'\nhost = 'krc'\n", Purpose::Robot), [""; 0]);
        let bare = keys("", Purpose::Robot);
        assert_eq!(bare.len(), 11, "five outputs, five feedbacks, the park pose: {bare:?}");
        assert_eq!(keys("", Purpose::Cycle).len(), 17, "with the box and five calibrations");
    }
}
