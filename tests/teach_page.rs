//! Tests `panelprep teach` with its drawing page, as a person at the cell uses it: the program, a browser, the recipe's
//! file.

use super::commands::{TEACH, rendered, start_program};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command};

/// Returns the running program and the address of its page, as the program prints it.
pub fn open_page(folder: &Path, command: &str) -> (Child, BufReader<std::process::ChildStderr>, String) {
    let mut child = start_program(folder, command);
    let mut told = BufReader::new(child.stderr.take().expect("its words"));
    let mut line = String::new();
    while !line.contains("http://") {
        line.clear();
        assert!(told.read_line(&mut line).expect("it tells") > 0, "it ended without a page");
    }
    let url = line.split_whitespace().find(|word| word.starts_with("http://")).expect("an address").to_owned();
    (child, told, url)
}

/// Sends a request to a page; returns the whole response, head and body.
pub fn ask(url: &str, method: &str, page: &str, body: &str) -> String {
    let (host, key) =
        url.trim_start_matches("http://").trim_end_matches('/').split_once('/').expect("host and key");
    let mut stream = TcpStream::connect(host).expect("it listens");
    let request = format!(
        "{method} /{key}/{page} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\ncontent-type: application/json\r\n\
         content-length: {}\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(request.as_bytes()).expect("sent");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("answered");
    String::from_utf8_lossy(&answer).into_owned()
}

/// Returns the page as Chromium shows it after it contains `awaited`; `None` if this computer has no Chromium. On a
/// busy computer a browser may end before the page is drawn, so up to five browsers are started, each with its own
/// profile.
pub fn rendered_page(url: &str, awaited: &str) -> Option<String> {
    let mut shown = String::new();
    for _ in 0..5 {
        let profile = tempfile::tempdir().expect("a folder");
        let browser = Command::new("chromium")
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--window-size=1400,900",
                "--virtual-time-budget=20000",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .args(["--dump-dom", url])
            .output()
            .ok()?;
        shown = String::from_utf8_lossy(&browser.stdout).into_owned();
        if shown.contains(awaited) {
            return Some(shown);
        }
        eprintln!(
            "the browser ended ({}) before the page had {awaited:?}: {}",
            browser.status,
            String::from_utf8_lossy(&browser.stderr)
        );
    }
    Some(shown)
}

/// Tests the whole teaching in real time: scan, region, corners; the panel is stored.
#[test]
fn a_panel_is_taught_by_a_new_scan_and_a_drawn_region() {
    let folder = rendered("good");
    let folder = folder.path();
    let before = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("a recipe");
    let command = "teach --live shots --cell cell/cell.toml --recipe cell/recipe.toml --seed 3";
    let (mut child, mut reported, url) = open_page(folder, command);
    let drawing = ask(&url, "GET", "drawing.json", "");
    let object: serde_json::Value =
        serde_json::from_str(drawing.split_once("\r\n\r\n").expect("a body").1).expect("JSON");
    assert_eq!(object["panel"], "simulated-panel");

    match rendered_page(&url, "class=\"corner region") {
        Some(page) => {
            // The page shows the four corners of the region, its outline, and the lines between its rows and columns.
            let count = |what: &str| page.matches(what).count();
            let lines = object["drawn"]["rows"].as_u64().expect("rows")
                + object["drawn"]["columns"].as_u64().expect("columns")
                - 2;
            assert_eq!((count("class=\"corner region"), count("class=\"area region")), (4, 1), "{page}");
            assert_eq!(count("class=\"grid\"") as u64, lines, "{page}");
            assert!(page.contains("simulated-panel") && page.contains("recipe.toml"), "{page}");
        }
        None => eprintln!("not run: there is no chromium on this computer, so the page was not looked at"),
    }

    let mut drawn = object["drawn"].clone();
    drawn["rows"] = 3.into();
    assert!(ask(&url, "POST", "save", &drawn.to_string()).starts_with("HTTP/1.1 200"));
    assert!(ask(&url, "POST", "done", "").starts_with("HTTP/1.1 200"));
    child.stdin.take().expect("its input").write_all(b"\n\n").expect("it listens");
    let mut words = String::new();
    reported.read_to_string(&mut words).expect("it tells");
    let ended = child.wait_with_output().expect("it ends");
    let found: serde_json::Value = serde_json::from_slice(&ended.stdout).expect("JSON");
    assert_eq!(ended.status.code(), Some(0), "{found} {words}");
    assert!(words.contains("the top-left corner") && words.contains("recipe.toml: saved"), "{words}");
    let after = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("a recipe");
    assert!(after.contains("rows = 3\n") && after.lines().count() == before.lines().count(), "{after}");
    assert!(after.contains("# as each taught picture shows it"), "comments stay: {after}");
    for file in ["taught_scan.pcd", "taught_corner1.png", "taught_flange1.json"] {
        assert!(folder.join("shots").join(file).is_file(), "{file}");
    }

    // Now the files exist. The test draws the area of a holder at the panel's upper edge, and an outline that is
    // removed again.
    let (child, mut reported, url) = open_page(folder, &format!("{TEACH} --draw"));
    let corners: Vec<Vec<f64>> = serde_json::from_value(drawn["corners_px"].clone()).expect("four corners");
    let at = |across: f64, down: f64| -> Vec<f64> {
        (0..2)
            .map(|i| {
                let mix = |a: usize, b: usize| corners[a][i] + (corners[b][i] - corners[a][i]) * across;
                mix(0, 1) + (mix(3, 2) - mix(0, 1)) * down
            })
            .collect()
    };
    drawn["held_px"] = serde_json::json!([[at(0.4, -0.3), at(0.6, -0.3), at(0.6, -0.02), at(0.4, -0.02)]]);
    drawn["outline_px"] = serde_json::json!([at(-0.1, -0.1), at(1.1, -0.1), at(1.1, 1.1)]);
    assert!(ask(&url, "POST", "save", &drawn.to_string()).starts_with("HTTP/1.1 200"));
    if let Some(page) = rendered_page(&url, "class=\"corner held") {
        let count = |what: &str| page.matches(what).count();
        assert_eq!(
            (count("class=\"corner outline"), count("class=\"corner held"), count("class=\"area held")),
            (3, 4, 1)
        );
    }
    drawn["outline_px"] = serde_json::json!([]);
    assert!(ask(&url, "POST", "save", &drawn.to_string()).starts_with("HTTP/1.1 200"));
    ask(&url, "POST", "done", "");
    let ended = child.wait_with_output().expect("it ends");
    reported.read_to_string(&mut words).expect("it tells");
    let found: serde_json::Value = serde_json::from_slice(&ended.stdout).expect("JSON");
    let held = found["outline"]["held"].as_f64().expect("a share");
    assert!(ended.status.success() && (0.02..0.2).contains(&held), "{found} {words}");
    let recipe = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("a recipe");
    assert!(
        recipe.contains("panel.name = \"simulated-panel\"") && recipe.contains("panel.outline_px = []"),
        "{recipe}"
    );

    // The person closes the page without a change.
    let (child, mut reported, url) = open_page(folder, &format!("{TEACH} --draw"));
    ask(&url, "POST", "done", "");
    let ended = child.wait_with_output().expect("it ends");
    reported.read_to_string(&mut words).expect("it tells");
    assert!(ended.status.success() && words.contains("nothing was saved"), "{words}");
}
