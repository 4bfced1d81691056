//! Tests how a person or a script follows a cell: `ctl state`, `ctl watch`, `ctl start --wait`, and files for the next
//! command.

use super::commands::{TEACH, json, rendered, start_program};
use super::service::{START, Service, taught};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

/// `--wait` ends with the cycle and returns its exit code. Meanwhile `watch` prints each change, one object per line.
/// The page shows the part, and a new disc is confirmed.
#[test]
fn a_cycle_is_followed_to_its_end() {
    let folder = taught("good");
    let folder = folder.path();
    let service = Service::start(folder);
    let confirmed = service.done("new-disc");
    assert!(confirmed["done"].as_str().is_some_and(|words| words.contains("new disc is mounted")), "{confirmed}");
    assert_eq!(service.done("state")["done"], Value::Null, "it is reported to who asked");
    service.reset();
    let mut watch = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args("ctl watch --json --cell cell/cell.toml".split_whitespace())
        .current_dir(folder)
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(watch.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let object = |line: String| -> Value { serde_json::from_str(&line).expect("an object a line") };
    let first = object(lines.next().expect("how it stands"));
    assert!(first["state"] == "idle" && first["panel"].is_null(), "{first}");
    let (exit, ended) = service.ctl(&format!("{START} --wait --part SN-7<b> --order W-4 --operator Anna"));
    let found = (exit, ended["verdict"].as_str(), ended["state"].as_str());
    assert_eq!(found, (0, Some("pass"), Some("complete")), "{ended}");
    let output: Vec<Value> = lines.map(object).take_while(|output| output["page"].is_null()).collect();
    watch.kill().and_then(|()| watch.wait()).expect("ended");
    assert!(output.windows(2).all(|pair| pair[0] != pair[1]), "only changes are told");
    // The number of phases that are reported depends on the machine.
    let at_work: Vec<&Value> = output.iter().filter(|output| output["state"] == "execute").collect();
    assert!(at_work.iter().all(|output| output["phase"].is_string()) && !at_work.is_empty(), "{output:#?}");
    let panel = ended["panel"].as_str().expect("a name");
    assert!(at_work.iter().all(|output| output["panel"] == panel), "{output:#?}");
    assert_eq!(ended["pass"], 1);
    let page =
        std::fs::read_to_string(folder.join(ended["page"].as_str().expect("a page"))).expect("it is written");
    for words in ["SN-7&lt;b&gt;", "W-4", "Anna"] {
        assert!(page.contains(words), "{words}");
    }
    service.reset();
    let (exit, refused) = service.ctl(&format!("{START} --part SN\u{1}7"));
    assert!(exit == 2 && refused["reasons"].to_string().contains("control characters"), "{refused}");

    // A start without a recipe proposes that of the panel in the cell; nothing starts before the panel's name is typed.
    let start_proposed = |typed: &str| {
        let mut starts = start_program(folder, "ctl start --wait --cell cell/cell.toml");
        starts.stdin.take().expect("piped").write_all(typed.as_bytes()).expect("it reads");
        starts
    };
    let refused = start_proposed("yes\n").wait_with_output().expect("it ends");
    let proposed = object(String::from_utf8(refused.stdout).expect("UTF-8"));
    assert_eq!((refused.status.code(), proposed["panel"].as_str()), (Some(2), Some(panel)), "{proposed}");
    assert_eq!(service.state(), "idle");

    // A held cell reports where it will continue. A client that waits continues to wait, and is informed of the
    // stop.
    let mut waits = start_proposed(&format!("{panel}\n"));
    service.wait("work", |service| service.state() == "execute");
    service.done("hold");
    service.reach("held");
    let held = service.done("state");
    assert!(held["phase"].as_str().is_some() && held["panel"].as_str() == Some(panel), "{held}");
    assert!(waits.try_wait().expect("its status").is_none(), "a held cycle is not over");
    service.done("stop");
    assert_eq!(waits.wait().expect("its status").code(), Some(3), "stopped: aborted, a cycle's own code");
}

/// A store that was left in the state Aborted is cleared without a service, by the command that the message names.
#[test]
fn a_cell_without_a_service_is_cleared() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done("abort");
    service.reach("aborted");
    service.signal(rustix::process::Signal::TERM);
    service.wait_for_end();
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3";
    let (exit, refused) = json(folder, cycle);
    let words = refused["reasons"][0]["message"].as_str().unwrap_or_default().to_owned();
    assert!(exit == 2 && words.contains("`panelprep clear --cell cell/cell.toml`"), "{refused}");
    let (exit, cleared) = json(folder, "clear --cell cell/cell.toml");
    assert_eq!((exit, cleared["state"].as_str()), (0, Some("stopped")), "{cleared}");
    let (exit, again) = json(folder, "clear --cell cell/cell.toml");
    assert_eq!((exit, again["verdict"].as_str()), (0, Some("accept")), "{again}");
    let (_, ran) = json(folder, cycle);
    assert!(ran["cycle_id"].as_i64().is_some(), "{ran}");
}

/// The next command accepts the file that `--out` wrote.
#[test]
fn the_next_command_accepts_the_file_of_out() {
    let folder = rendered("clean");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    let cell = "--cell cell/cell.toml --recipe cell/recipe.toml";
    let written = |name: &str| -> Value {
        serde_json::from_slice(&std::fs::read(folder.join(name)).expect("written")).expect("JSON")
    };
    let (exit, located) = json(folder, &format!("locate {cell} --scan cell/scan.pcd --out out/located.json"));
    assert_eq!((exit, &located), (0, &written("out/located.json")));
    let corner = "--corner cell/corner.png --flange cell/flange.json --out refined.json";
    let (exit, refined) = json(folder, &format!("refine {cell} --located out/located.json {corner}"));
    assert_eq!((exit, &refined), (0, &written("refined.json")));
    assert_ne!(refined["base_from_panel"], located["base_from_panel"]);
}
