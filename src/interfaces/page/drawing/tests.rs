//! The page as a browser requests it.

use super::*;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::thread::JoinHandle;

const RECIPE: &str = "panel = \"door\" # the left one\n\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\n\
                      [region]\ncorners_px = [[10, 10], [90, 10], [90, 60], [10, 60]] # from the ruler\nrows = 2\ncolumns = 3\n";

struct Open {
    url: String,
    serving: JoinHandle<u32>,
    folder: tempfile::TempDir,
}

fn open() -> Open {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = folder.path().join("door.toml");
    std::fs::write(&recipe, RECIPE).expect("written");
    let file = recipe.clone();
    let write = Box::new(move |text: &str| std::fs::write(&file, text).map_err(|error| error.to_string()));
    let sheet = DrawingSheet { recipe, picture_png: vec![1, 2, 3], size_px: [100, 80], write };
    let local = LocalServer::listen(([127, 0, 0, 1], 0).into()).expect("a port");
    let url = local.url();
    Open { url, serving: std::thread::spawn(move || serve(local, sheet).expect("served")), folder }
}

impl Open {
    fn host(&self) -> &str {
        self.url.trim_start_matches("http://").split('/').next().expect("a host")
    }

    /// Sends a request as this host; returns the status and the body.
    fn ask_as(&self, host: &str, method: &str, path: &str, body: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(self.host()).expect("it listens");
        let request = format!(
            "{method} {path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\ncontent-type: application/json\r\n\
             content-length: {}\r\n\r\n{body}",
            body.len()
        );
        stream.write_all(request.as_bytes()).expect("sent");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("answered");
        let status = answer.split(' ').nth(1).and_then(|word| word.parse().ok()).expect("a status");
        (status, answer.split_once("\r\n\r\n").map_or(String::new(), |(_, body)| body.to_owned()))
    }

    fn ask(&self, method: &str, page: &str, body: &str) -> (u16, String) {
        let key = self.url.trim_end_matches('/').rsplit('/').next().expect("a key").to_owned();
        self.ask_as(self.host(), method, &format!("/{key}/{page}"), body)
    }

    fn recipe(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("door.toml")).expect("the recipe")
    }
}

const DRAWN: &str = r#"{"corners_px":[[12,10],[90,10],[90.26,60],[10,60]],"rows":4,"columns":3,"masked_px":[[[20,20],[30,20],[30,30],[20,30]]],"outline_px":[[2,2],[97,2],[97,70],[2,70]],"held_px":[[[40,0],[60,0],[60,6],[40,6]]]}"#;

#[test]
fn what_a_person_draws_comes_into_the_recipe() {
    let page = open();
    let (status, found) = page.ask("GET", "drawing.json", "");
    assert!(status == 200 && found.contains(r#""corners_px":[[10.0,10.0],[90.0,10.0]"#), "{status} {found}");
    for (file, words) in [
        ("", "Region of panel"),
        ("sheet.js", "pointerdown"),
        ("drawing.js", "./sheet.js"),
        ("sheet.css", ".corner"),
    ] {
        let (status, text) = page.ask("GET", file, "");
        assert!(status == 200 && text.contains(words), "{file}: {status}");
    }
    let html = page.ask("GET", "", "").1;
    assert!(html.contains("Add a mask") && !html.contains("{draw.") && !html.contains("{words}"), "{html}");
    let (status, reported) = page.ask("POST", "save", DRAWN);
    assert!(status == 200 && reported.contains("door.toml"), "{status} {reported}");
    let expected = RECIPE
        .replace("[[10, 10], [90, 10], [90, 60], [10, 60]]", "[[12, 10], [90, 10], [90.3, 60], [10, 60]]")
        .replace("rows = 2", "rows = 4")
        .replace("panel = \"door\" # the left one\n", "panel.name = \"door\" # the left one\n\
                 panel.outline_px = [[2, 2], [97, 2], [97, 70], [2, 70]]\npanel.held_px = [[[40, 0], [60, 0], [60, 6], [40, 6]]]\n");
    assert!(page.recipe().starts_with(&expected), "{}", page.recipe());
    assert!(page.recipe().contains("masked_px = [[[20, 20], [30, 20], [30, 30], [20, 30]]]"));
    assert_eq!(page.ask("POST", "done", "").0, 200);
    assert_eq!(page.serving.join().expect("it ends"), 1, "saved once");
}

#[test]
fn what_is_no_region_changes_nothing() {
    let page = open();
    let crossed = DRAWN.replace("[12,10],[90,10]", "[90,10],[12,10]");
    let twisted = DRAWN.replace("[2,2],[97,2]", "[97,2],[2,2]");
    let outside = DRAWN.replace("[12,10]", "[100,10]");
    for (body, words) in [
        (&*crossed, "must be in order around"),
        (&twisted, "the outline crosses itself"),
        (&outside, "outside the picture (100×80 px)"),
    ] {
        let (status, told) = page.ask("POST", "save", body);
        assert!(status == 422 && told.contains(words), "{status} {told}");
    }
    assert!(page.ask("POST", "save", "{}").0 >= 400);
    assert_eq!(page.recipe(), RECIPE);
}

/// Another page in the same browser does not know the key and does not use this host name.
#[test]
fn no_other_client_is_served() {
    let page = open();
    assert_eq!(page.ask_as(page.host(), "GET", "/", "").0, 404);
    assert_eq!(page.ask_as(page.host(), "GET", "/0123/drawing.json", "").0, 404);
    let key = page.url.trim_end_matches('/').rsplit('/').next().expect("a key");
    assert_eq!(page.ask_as("evil.example", "GET", &format!("/{key}/drawing.json"), "").0, 403);
    assert!(LocalServer::listen(([0, 0, 0, 0], 0).into()).is_err(), "not for the whole network");
}
