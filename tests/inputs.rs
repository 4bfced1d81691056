//! Tests inputs of an unexpected kind: pipes instead of files, and picture formats in which damage cannot be detected.

use super::commands::{TEACH, VERIFY, json, rendered};
use panelprep::files::{read_color, write_color_jpeg};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit for one command. A program that waits for the writer of a pipe would never end; a program that refuses
/// the pipe ends immediately.
const TIMEOUT: Duration = Duration::from_secs(60);

fn begin(folder: &Path, arguments: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts")
}

/// Each file that each command reads is replaced by a pipe to which no process writes: the command refuses the pipe.
#[test]
fn no_reader_waits_for_a_pipe() {
    let folder = rendered("clean");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    mknodat(CWD, folder.join("pipe.png"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
    std::fs::create_dir(folder.join("clip")).expect("a folder");
    mknodat(CWD, folder.join("clip/clip.csv"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
    let cell = "--cell cell/cell.toml --recipe cell/recipe.toml";
    let corner = "--corner cell/taught_corner.png --flange cell/taught_flange.json";
    let commands = [
        format!("teach {cell} --scan pipe.png {corner}"),
        format!(
            "{} --corner pipe.png --flange cell/taught_flange.json",
            TEACH.split(" --corner").next().expect("there")
        ),
        format!("teach {cell} --scan cell/taught_scan.pcd --corner cell/taught_corner.png --flange pipe.png"),
        "locate --cell cell/cell.toml --recipe pipe.png --scan cell/scan.pcd".to_owned(),
        "locate --cell pipe.png --recipe cell/recipe.toml --scan cell/scan.pcd".to_owned(),
        format!("locate {cell} --scan pipe.png"),
        format!("refine {cell} --located pipe.png --corner cell/corner.png --flange cell/flange.json"),
        format!("inspect {cell} --clip clip"),
        format!("plan {cell} --located pipe.png"),
        VERIFY[0].replace("cell/target/scanner.png", "pipe.png"),
        "calibrate intrinsics --board 9x6 --square-mm 25 --out lens.toml pipe.png".to_owned(),
        "calibrate tcp --poses pipe.png --out tool.toml".to_owned(),
        "check pipe.png".to_owned(),
        "replay pipe.png".to_owned(),
    ];
    for command in commands {
        let mut child = begin(folder, &command);
        let since = Instant::now();
        while child.try_wait().expect("its status").is_none() {
            if since.elapsed() > TIMEOUT {
                child.kill().expect("killed");
                panic!("{command}: it still waits");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let output = child.wait_with_output().expect("ended");
        let words = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
        assert!(output.status.code() == Some(2) && words.contains("is a pipe"), "{command}: {words}");
    }
}

/// A picture from which a position is measured must have a format in which damage is detected. The message states what
/// to do.
#[test]
fn no_position_is_measured_in_a_jpeg() {
    let folder = rendered("clean");
    let folder = folder.path();
    for name in ["taught_corner", "corner", "target/scanner", "target/flange_camera"] {
        let png = std::fs::read(folder.join(format!("cell/{name}.png"))).expect("rendered");
        let jpeg = write_color_jpeg(&read_color(&png).expect("a picture")).expect("packed");
        std::fs::write(folder.join(format!("cell/{name}.jpg")), jpeg).expect("written");
    }
    let refused = |arguments: &str| {
        let (exit, output) = json(folder, arguments);
        let words = output["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(
            exit == 2
                && words.contains(".jpg: positions are measured in this picture, but its format is JPEG")
                && words.contains("PNG"),
            "{output}"
        );
    };
    refused(&TEACH.replace("taught_corner.png", "taught_corner.jpg"));
    assert_eq!(json(folder, TEACH).0, 0);
    let cell = "--cell cell/cell.toml --recipe cell/recipe.toml";
    let (exit, located) = json(folder, &format!("locate {cell} --scan cell/scan.pcd"));
    assert_eq!(exit, 0, "{located}");
    std::fs::write(folder.join("located.json"), located.to_string()).expect("written");
    refused(&format!("refine {cell} --located located.json --corner cell/corner.jpg --flange cell/flange.json"));
    for (look, picture) in VERIFY.into_iter().zip(["scanner", "flange_camera"]) {
        refused(&look.replace(&format!("{picture}.png"), &format!("{picture}.jpg")));
    }
}
