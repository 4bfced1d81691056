//! Tests `panelprep label` as a person uses it: the program, a browser, the files beside the clip, and the commands
//! that use these files.

use super::commands::{TEACH, json};
use super::teach_page::{ask, open_page, rendered_page};
use panelprep::files::{read_color, read_gray};
use panelprep::geometry::{ColorPicture, Mask};
use serde_json::{Value, json as value};
use std::io::Read;
use std::path::Path;

const CELL: &str = "--cell cell/cell.toml --recipe cell/recipe.toml";
/// Half of the label rectangle's width and height, px: the rectangle has 16 × 12 pixels.
const LABEL_HALF_SIZE_PX: [f64; 2] = [8.0, 6.0];

/// Returns a small rendered cell with a panel that was taught and located.
fn located_cell() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let render = "render --seed 3 --scene good --reduction 4 --seconds 20 --out cell";
    for arguments in [render, TEACH, &format!("locate {CELL} --scan cell/scan.pcd --out located.json")] {
        let (exit, told) = json(path, arguments);
        assert_eq!(exit, 0, "{arguments}: {told}");
    }
    folder
}

fn body(answer: &str) -> Value {
    let text = answer.split_once("\r\n\r\n").expect("a body").1;
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {answer}"))
}

/// Closes the page; returns the JSON object and the printed text of the command.
fn close_page(
    mut page: (std::process::Child, std::io::BufReader<std::process::ChildStderr>, String),
) -> (Value, String) {
    assert!(ask(&page.2, "POST", "done", "").starts_with("HTTP/1.1 200"));
    let mut words = String::new();
    page.1.read_to_string(&mut words).expect("it tells");
    page.0.stdin.take();
    let output = page.0.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(0), "{words}");
    (serde_json::from_slice(&output.stdout).expect("JSON"), words)
}

fn mask(file: &Path) -> Mask {
    Mask::from_gray(&read_gray(&std::fs::read(file).expect("a mask")).expect("a picture"))
}

fn times(file: &Path) -> ColorPicture {
    read_color(&std::fs::read(file).expect("times")).expect("a picture")
}

/// Returns the middle of a grid, in whole pixels.
fn middle_of(clip: &Value, id: &str) -> [f64; 2] {
    let grids = clip["grids"].as_array().expect("grids");
    let grid = grids.iter().find(|grid| grid["id"] == id).unwrap_or_else(|| panic!("{grids:?}"));
    let edge: Vec<[f64; 2]> = serde_json::from_value(grid["edge_px"].clone()).expect("an edge");
    [0, 1].map(|axis| (edge.iter().map(|place| place[axis]).sum::<f64>() / edge.len() as f64).round())
}

/// Returns the rectangle about this pixel as a shape that begins at this time.
fn shape([u, v]: [f64; 2], from_s: f64) -> Value {
    let (left, right) = (u - LABEL_HALF_SIZE_PX[0] - 0.5, u + LABEL_HALF_SIZE_PX[0] - 0.5);
    let (top, bottom) = (v - LABEL_HALF_SIZE_PX[1] - 0.5, v + LABEL_HALF_SIZE_PX[1] - 0.5);
    value!({"from_s": from_s, "corners_px": [[left, top], [right, top], [right, bottom], [left, bottom]]})
}

fn statement(breaks: &[Value]) -> Value {
    value!({"author": "A. Meier", "clean": breaks.is_empty(), "breaks": breaks})
}

fn close(found: &Value, expected: f64) -> bool {
    found.as_f64().is_some_and(|found| (found - expected).abs() < 1e-9)
}

/// Tests from the first view to the score: the breaks that the person draws are the ground truth for other commands.
#[test]
fn a_clip_is_labelled_and_scored_against_its_labels() {
    let folder = located_cell();
    let folder = folder.path();
    let clip_folder = folder.join("cell/clip");
    let page = open_page(folder, &format!("label {CELL} --clip cell/clip --located located.json"));
    let clip = body(&ask(&page.2, "GET", "clip.json", ""));
    let shots = clip["shots"].as_array().expect("pictures");
    let wet_from_s = shots.iter().find(|shot| shot["phase"] == "wet").expect("wet")["time_s"].as_f64().expect("s");
    let ends_s = shots.last().expect("pictures")["time_s"].as_f64().expect("s");
    assert_eq!(clip["grids"].as_array().map(Vec::len), Some(24));
    assert_eq!(clip["now"]["said"], value!({"author": "", "clean": false, "breaks": []}));

    // The position at which the rendered film broke first. It is only used to draw a label over a part of this break.
    let truth = times(&folder.join("cell/truth/times.png"));
    let first = (0..truth.rgb.len()).filter(|&index| truth.rgb[index][2] == 255);
    let first = first.min_by_key(|&index| truth.rgb[index]).expect("something broke");
    let [u, v] = [(first % truth.width) as f64, (first / truth.width) as f64];
    let on_break = value!({"closes_s": null, "shapes": [shape([u, v], wet_from_s + 2.5)]});
    let quiet = middle_of(&clip, "r2c3");
    let elsewhere = value!({"closes_s": ends_s, "shapes": [shape(quiet, wet_from_s), shape([quiet[0] + 1.0, quiet[1]], ends_s - 1.0)]});

    // Impossible labels are refused with a list of all their problems.
    let mut late = on_break.clone();
    late["shapes"][0]["from_s"] = value!(ends_s + 0.2);
    let two_corners =
        value!({"closes_s": null, "shapes": [{"from_s": wet_from_s, "corners_px": [[1.0, 1.0], [9.0, 9.0]]}]});
    let refused = ask(&page.2, "POST", "save", &statement(&[late, two_corners]).to_string());
    let problems = body(&refused)["problems"].to_string();
    assert!(refused.starts_with("HTTP/1.1 422"), "{refused}");
    assert!(
        problems.contains("break 1: the break begins at") && problems.contains("after the clip's last wet picture"),
        "{problems}"
    );
    assert!(problems.contains("break 2") && problems.contains("found 2 corners, at least 3"), "{problems}");
    assert!(!clip_folder.join("labels.json").exists());

    // A drawing that was not saved is shown again after a reload.
    let both = statement(&[on_break, elsewhere]);
    assert!(ask(&page.2, "POST", "draft", &both.to_string()).starts_with("HTTP/1.1 200"));
    match rendered_page(&format!("{}#{}", page.2, shots.len() / 2), "class=\"area open") {
        Some(dom) => {
            let count = |what: &str| dom.matches(what).count();
            assert_eq!((count("class=\"area open"), count("class=\"grid\"")), (2, 24), "{dom}");
            assert!(
                dom.contains("The drawing is a draft and is not saved yet.") && dom.contains("cell/clip"),
                "{dom}"
            );
            assert!(dom.contains(&format!("picture {} of {}", shots.len() / 2, shots.len())), "{dom}");
        }
        None => eprintln!("not run: there is no chromium on this computer, so the page was not looked at"),
    }

    // A second save does not overwrite the first labels; they are kept as `labels.1.json`.
    assert!(ask(&page.2, "POST", "save", &statement(&[]).to_string()).starts_with("HTTP/1.1 200"));
    assert_eq!(mask(&clip_folder.join("mask.png")).count(), 0);
    let clean = std::fs::read(clip_folder.join("labels.json")).expect("labels");
    let saved = body(&ask(&page.2, "POST", "save", &both.to_string()));
    assert_eq!(saved["former"], "labels.1.json");
    assert_eq!(std::fs::read(clip_folder.join("labels.1.json")).expect("kept"), clean);
    assert!(!clip_folder.join("labels.draft.json").exists());
    let (output, words) = close_page(page);
    assert_eq!((&output["saved"], &output["unsaved"]), (&value!(2), &value!(false)), "{output} {words}");

    // Expected value, calculated by hand: two rectangles of 16 × 12 pixels. The shape of the second one moves one pixel
    // to the right, which adds 12 pixels.
    let labelled = mask(&clip_folder.join("mask.png"));
    assert_eq!(labelled.count(), 2 * 16 * 12 + 12);
    let coded = times(&clip_folder.join("times.png")).rgb;
    assert_eq!(coded[first], [0, 250, 255], "2.5 s after the first wet picture");

    check_scores(folder, &labelled);
    check_changed_pictures(folder);
}

/// The commands that accept a ground truth accept the labelled clip.
fn check_scores(folder: &Path, labelled: &Mask) {
    let inspect = format!("inspect {CELL} --located located.json");
    let (exit, output) = json(folder, &format!("{inspect} --clip cell/clip --truth cell/clip --pictures pictures"));
    assert_eq!((exit, output["verdict"].as_str()), (1, Some("fail")), "{output}");
    let found = mask(&folder.join("pictures/mask.png"));
    let count = |of: fn(bool, bool) -> bool| {
        found.inside.iter().zip(&labelled.inside).filter(|(found, real)| of(**found, **real)).count() as f64
    };
    let both = count(|found, real| found && real);
    assert!(both > 20.0, "the label lies over a part of what is found: {both} px");
    let score = &output["score"];
    assert!(close(&score["iou"], both / count(|found, real| found || real)), "{score}");
    assert!(close(&score["precision"], both / found.count() as f64), "{score}");
    assert!(close(&score["recall"], both / labelled.count() as f64), "{score}");

    // The same clip is scored as the only clip of a set.
    std::fs::create_dir(folder.join("set")).expect("a folder");
    std::os::unix::fs::symlink(folder.join("cell/clip"), folder.join("set/0001")).expect("a link");
    let (exit, set) = json(folder, &format!("{inspect} --truth set"));
    assert_eq!(exit, 0, "{set}");
    assert_eq!((&set["score"]["clips"], &set["score"]["iou"]), (&value!(1), &score["iou"]), "{set}");
    assert!(set["score"]["timed"].as_u64().is_some_and(|timed| timed >= 1), "its times count: {set}");
    let (exit, output) =
        json(folder, &format!("tune {CELL} --located located.json --clip cell/clip --truth cell/clip"));
    assert!((0..=1).contains(&exit), "{output}");

    let (exit, output) = json(folder, &format!("{inspect} --clip cell/clip --pictures cell/clip"));
    assert!(
        exit == 2 && output["reasons"][0]["message"].as_str().unwrap_or_default().contains("labels of a person"),
        "{output}"
    );
}

/// Labels are valid only for the pictures for which they were drawn, and the page states this.
fn check_changed_pictures(folder: &Path) {
    let [one, other] = ["cell/clip/00030.jpg", "cell/clip/00031.jpg"].map(|name| folder.join(name));
    std::fs::copy(&other, &one).expect("copied");
    let inspect = format!("inspect {CELL} --located located.json --clip cell/clip --truth cell/clip");
    let (exit, told) = json(folder, &inspect);
    let message = told["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && message.contains("made for other pictures"), "{told}");
    // Without a recipe no cell is needed. The existing labels are shown, and nothing is saved.
    let page = open_page(folder, "label --clip cell/clip --cell nowhere.toml");
    let clip = body(&ask(&page.2, "GET", "clip.json", ""));
    assert_eq!(clip["now"]["said"]["breaks"].as_array().map(Vec::len), Some(2));
    assert!(clip["now"]["note"].as_str().is_some_and(|note| note.contains("has changed")), "{clip}");
    assert!(ask(&page.2, "POST", "draft", &statement(&[]).to_string()).starts_with("HTTP/1.1 200"));
    let (told, _) = close_page(page);
    assert_eq!(
        (&told["saved"], &told["unsaved"], told["labels"].is_string()),
        (&value!(0), &value!(true), true),
        "{told}"
    );
    let kept = std::fs::read_to_string(folder.join("cell/clip/labels.json")).expect("labels");
    assert!(kept.contains("\"clean\": false"), "a draft is no label: {kept}");
}

#[test]
fn a_folder_that_is_no_clip_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let clip = folder.join("clip");
    let refused = |words: &str| {
        let (exit, told) = json(folder, "label --clip clip");
        let message = told["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(exit == 2 && message.contains(words), "{words}: {told}");
    };
    refused("clip: there is no clip.csv; a clip is a folder of numbered pictures");
    std::fs::create_dir(&clip).expect("a folder");
    refused("there is no clip.csv");
    std::fs::write(clip.join("clip.csv"), "file,time_s,phase\n").expect("written");
    refused("clip.csv: the clip is empty");
    std::fs::write(clip.join("clip.csv"), "file,time_s\n1.png,0\n").expect("written");
    refused("1.png: No such file");
    let picture = panelprep::files::write_color_png(&ColorPicture::uniform(4, 2, [9; 3])).expect("packed");
    std::fs::write(clip.join("1.png"), picture).expect("written");
    std::fs::write(clip.join("labels.json"), "{\"version\": 7}").expect("written");
    refused("labels.json: the label file has version 7; this program reads version 1; move the file away");
    std::fs::write(clip.join("labels.json"), "{").expect("written");
    refused("labels.json: the content is not a valid label file");
}
