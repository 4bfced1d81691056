//! The page on which a person labels the breaks in a clip: polygons on its pictures, with times.
//!
//! `GET .` the page · `GET clip.json` the clip, the grids, and the stored labels · `GET picture/N` picture N of the
//! clip, from 1 · `POST draft` the present drawing, stored unchanged so that a reload of the page loses nothing · `POST
//! save` the present drawing, stored as labels if it is valid, otherwise the problems are returned · `POST done` ends
//! the page.

use super::{LocalError, LocalServer, Session};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use panelprep_base::disk;
use panelprep_cell::files::{self, ClipEntry};
use panelprep_cell::labels::Statement;
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE_SHEET: &str = "text/css; charset=utf-8";
/// The files of the page.
const FILES: [(&str, &str, &str); 9] = [
    ("", HTML, include_str!("label.html")),
    ("label.css", STYLE_SHEET, include_str!("label.css")),
    ("label.js", SCRIPT, include_str!("label.js")),
    ("breaks.js", SCRIPT, include_str!("breaks.js")),
    ("overlay.js", SCRIPT, include_str!("overlay.js")),
    ("film.js", SCRIPT, include_str!("film.js")),
    ("keys.js", SCRIPT, include_str!("keys.js")),
    ("panel.js", SCRIPT, include_str!("panel.js")),
    ("program.js", SCRIPT, include_str!("program.js")),
];

/// The outline of a grid in the clip's pictures.
#[derive(Debug, Clone, Serialize)]
pub struct GridOutline {
    /// The name of the grid.
    pub id: String,
    /// The closed outline of the grid, px.
    pub edge_px: Vec<[f64; 2]>,
}

/// The stored labels or draft.
#[derive(Debug, Clone, Serialize)]
pub struct CurrentLabels {
    /// The labels as the person drew them.
    pub said: Statement,
    /// Time at which labels were last saved, UTC; `None` if they were never saved.
    pub saved_at: Option<String>,
    /// Whether the labels are a draft that has not been saved yet.
    pub is_draft: bool,
    /// A remark for the person who labels.
    pub note: Option<String>,
}

/// The result of saving labels.
#[derive(Debug, Clone, Serialize)]
pub struct SaveResult {
    /// The path of the saved labels.
    pub labels: String,
    /// Time at which the labels were saved, UTC.
    pub saved_at: String,
    /// File name under which the previous labels are kept.
    pub former: Option<String>,
}

/// The storage of labels.
pub trait LabelStorage: Send + Sync {
    /// Returns the stored labels or draft.
    ///
    /// # Errors
    /// If a stored file is invalid; the error is a text for people.
    fn now(&self) -> Result<CurrentLabels, String>;

    /// Stores the present drawing as a draft, without checking it.
    ///
    /// # Errors
    /// If the file cannot be written; the error is a text for people.
    fn store_draft(&self, said: &Statement) -> Result<(), String>;

    /// Saves the drawing as labels.
    ///
    /// # Errors
    /// All problems of the labels, or the reason why the files cannot be written, as texts.
    fn save(&self, said: &Statement) -> Result<SaveResult, Vec<String>>;
}

/// The clip to label, with its pictures and its panel.
pub struct LabelSheet {
    /// The folder of the clip.
    pub folder: PathBuf,
    /// The pictures of the clip.
    pub shots: Vec<ClipEntry>,
    /// Width and height of the pictures, px.
    pub size_px: [usize; 2],
    /// The outlines of the grids, if they are known.
    pub grids: Vec<GridOutline>,
    /// The storage of the labels.
    pub keep: Arc<dyn LabelStorage>,
}

struct PageState {
    sheet: LabelSheet,
    session: Session,
}

/// Serves the page until the person ends it, and returns how many times labels were saved.
///
/// # Errors
/// If the server cannot be run.
pub fn serve(local: LocalServer, sheet: LabelSheet) -> Result<u32, LocalError> {
    let (session, done) = Session::new();
    let inside = Arc::new(PageState { sheet, session });
    let mut pages = Router::new();
    for (name, kind, text) in FILES {
        pages = pages.route(&local.path(name), get(move || async move { ([(header::CONTENT_TYPE, kind)], text) }));
    }
    let pages = pages
        .route(&local.path("clip.json"), get(clip))
        .route(&local.path("picture/{number}"), get(picture))
        .route(&local.path("draft"), post(handle_draft))
        .route(&local.path("save"), post(save))
        .route(&local.path("done"), post(end))
        .with_state(inside.clone());
    local.serve(pages, done)?;
    Ok(inside.session.save_count())
}

fn refused(status: StatusCode, problems: &[String]) -> Response {
    (status, Json(json!({ "problems": problems }))).into_response()
}

async fn clip(State(inside): State<Arc<PageState>>) -> Response {
    let LabelSheet { folder, shots, size_px, grids, keep } = &inside.sheet;
    let shots: Vec<_> = shots
        .iter()
        .map(|shot| json!({"file": shot.file, "time_s": shot.time_s, "phase": shot.phase.keyword()}))
        .collect();
    match keep.now() {
        Ok(now) => {
            let clip = folder.display().to_string();
            Json(json!({"clip": clip, "shots": shots, "size_px": size_px, "grids": grids, "now": now}))
                .into_response()
        }
        Err(problem) => refused(StatusCode::UNPROCESSABLE_ENTITY, &[problem]),
    }
}

async fn picture(State(inside): State<Arc<PageState>>, Path(number): Path<String>) -> Response {
    let LabelSheet { folder, shots, .. } = &inside.sheet;
    let shot = number.parse::<usize>().ok().and_then(|number| shots.get(number.checked_sub(1)?));
    let Some(shot) = shot else {
        let problem = format!("the clip has no picture {number}; valid: 1 to {}", shots.len());
        return refused(StatusCode::NOT_FOUND, &[problem]);
    };
    let file = folder.join(&shot.file);
    match disk::read(&file).map_err(|error| error.to_string()).and_then(browser_picture) {
        Ok((kind, bytes)) => ([(header::CONTENT_TYPE, kind)], bytes).into_response(),
        Err(problem) => refused(StatusCode::UNPROCESSABLE_ENTITY, &[format!("{}: {problem}", file.display())]),
    }
}

/// Returns a picture in a format for browsers, with exactly the pixels that the program decodes. PNG and JPEG files are
/// sent unchanged, TIFF is converted to PNG. A browser rotates a picture according to its EXIF data, which would shift
/// the drawing: a picture that may contain EXIF data is encoded again.
fn browser_picture(bytes: Vec<u8>) -> Result<(&'static str, Vec<u8>), String> {
    let has = |name: &[u8]| bytes.windows(name.len()).any(|part| part == name);
    if bytes.starts_with(b"\x89PNG") && !has(b"eXIf") {
        return Ok(("image/png", bytes));
    }
    if bytes.starts_with(&[0xff, 0xd8]) && !has(b"Exif") {
        return Ok(("image/jpeg", bytes));
    }
    let png = files::read_color(&bytes).and_then(|picture| files::write_color_png(&picture));
    png.map(|png| ("image/png", png)).map_err(|error| error.to_string())
}

async fn handle_draft(State(inside): State<Arc<PageState>>, Json(said): Json<Statement>) -> Response {
    match inside.sheet.keep.store_draft(&said) {
        Ok(()) => Json(json!({ "kept": true })).into_response(),
        Err(problem) => refused(StatusCode::UNPROCESSABLE_ENTITY, &[problem]),
    }
}

async fn save(State(inside): State<Arc<PageState>>, Json(said): Json<Statement>) -> Response {
    match inside.sheet.keep.save(&said) {
        Ok(saved) => {
            inside.session.count_save();
            Json(saved).into_response()
        }
        Err(problems) => refused(StatusCode::UNPROCESSABLE_ENTITY, &problems),
    }
}

async fn end(State(inside): State<Arc<PageState>>) -> Response {
    inside.session.end()
}

/// Tests of the page with requests like those of a browser.
#[cfg(test)]
mod tests {
    use super::super::local_client;
    use super::*;
    use panelprep_base::phase::Phase;
    use std::sync::Mutex;
    use std::thread::JoinHandle;

    /// Stores labels in memory, and accepts labels with an author's name.
    #[derive(Default)]
    struct Memory(Mutex<(Statement, u32)>);

    impl LabelStorage for Memory {
        fn now(&self) -> Result<CurrentLabels, String> {
            let (said, saved) = self.0.lock().expect("no thread failed").clone();
            Ok(CurrentLabels {
                said,
                saved_at: (saved > 0).then(|| "today".to_owned()),
                is_draft: saved == 0,
                note: None,
            })
        }

        fn store_draft(&self, said: &Statement) -> Result<(), String> {
            self.0.lock().expect("no thread failed").0 = said.clone();
            Ok(())
        }

        fn save(&self, said: &Statement) -> Result<SaveResult, Vec<String>> {
            if said.author.is_empty() {
                return Err(vec!["no cell signs".to_owned(), "and more".to_owned()]);
            }
            let mut kept = self.0.lock().expect("no thread failed");
            *kept = (said.clone(), kept.1 + 1);
            Ok(SaveResult { labels: "labels.json".to_owned(), saved_at: "today".to_owned(), former: None })
        }
    }

    struct Open {
        url: String,
        serving: JoinHandle<u32>,
        _folder: tempfile::TempDir,
    }

    /// Opens the page for a clip with a PNG, a JPEG, a TIFF and a missing picture.
    fn open() -> Open {
        let folder = tempfile::tempdir().expect("a folder");
        let picture = panelprep_base::geometry::ColorPicture::uniform(4, 2, [9, 8, 7]);
        let png = files::write_color_png(&picture).expect("packed");
        std::fs::write(folder.path().join("1.png"), png).expect("written");
        std::fs::write(folder.path().join("2.jpg"), files::write_color_jpeg(&picture).expect("packed"))
            .expect("written");
        let pixels = image::RgbImage::from_pixel(4, 2, image::Rgb([9, 8, 7]));
        pixels.save(folder.path().join("3.tif")).expect("written");
        let names = [("1.png", Phase::Dry), ("2.jpg", Phase::Wet), ("3.tif", Phase::Wet), ("4.png", Phase::Wet)];
        let shot = |(index, (file, phase)): (usize, (&str, Phase))| ClipEntry {
            file: file.to_owned(),
            time_s: index as f64,
            phase,
        };
        let sheet = LabelSheet {
            folder: folder.path().to_owned(),
            shots: names.into_iter().enumerate().map(shot).collect(),
            size_px: [4, 2],
            grids: vec![GridOutline { id: "r1c1".to_owned(), edge_px: vec![[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]] }],
            keep: Arc::new(Memory::default()),
        };
        let local = LocalServer::listen(([127, 0, 0, 1], 0).into()).expect("a port");
        let url = local.url();
        Open { url, serving: std::thread::spawn(move || serve(local, sheet).expect("served")), _folder: folder }
    }

    impl Open {
        fn host(&self) -> &str {
            local_client::address(&self.url)
        }

        fn key(&self) -> &str {
            self.url.trim_end_matches('/').rsplit('/').next().expect("a key")
        }

        /// Sends a request with this host name, and returns the status and the complete response.
        fn ask_as(&self, host: &str, method: &str, path: &str, body: &str) -> (u16, String) {
            local_client::ask(self.host(), host, [method, path, body])
        }

        fn ask(&self, method: &str, page: &str, body: &str) -> (u16, String) {
            self.ask_as(self.host(), method, &format!("/{}/{page}", self.key()), body)
        }
    }

    const SAID: &str = r#"{"author":"","clean":false,"breaks":[{"closes_s":null,"shapes":[{"from_s":1.0,"corners_px":[[0.0,0.0],[3.5,0.0]]}]}]}"#;

    #[test]
    fn drafts_are_stored_and_valid_labels_are_saved() {
        let page = open();
        for (file, words) in
            [("", "Breaks in"), ("label.js", "pointerdown"), ("label.css", ".corner"), ("film.js", "picture/")]
        {
            let (status, text) = page.ask("GET", file, "");
            assert!(status == 200 && text.contains(words), "{file}: {status}");
        }
        let (status, clip) = page.ask("GET", "clip.json", "");
        assert!(status == 200 && clip.contains(r#""phase":"dry""#) && clip.contains("r1c1"), "{clip}");
        // A draft may be incomplete: this one has only two corners and no author.
        assert_eq!(page.ask("POST", "draft", SAID).0, 200);
        let (_, clip) = page.ask("GET", "clip.json", "");
        assert!(clip.contains("[[0.0,0.0],[3.5,0.0]]") && clip.contains(r#""is_draft":true"#), "{clip}");
        let (status, told) = page.ask("POST", "save", SAID);
        assert!(status == 422 && told.contains(r#"["no cell signs","and more"]"#), "{status} {told}");
        assert_eq!(page.ask("POST", "save", &SAID.replace(r#""author":"""#, r#""author":"A""#)).0, 200);
        assert!(page.ask("GET", "clip.json", "").1.contains(r#""saved_at":"today""#));
        for wrong in ["{}", "[", r#"{"author":"A","clean":true,"breaks":[],"more":1}"#] {
            assert!((400..500).contains(&page.ask("POST", "save", wrong).0), "{wrong}");
        }
        assert_eq!(page.ask("POST", "done", "").0, 200);
        assert_eq!(page.serving.join().expect("it ends"), 1, "saved once");
    }

    #[test]
    fn each_picture_is_sent_in_a_format_for_browsers() {
        let page = open();
        for (number, kind) in [("1", "image/png"), ("2", "image/jpeg"), ("3", "image/png")] {
            let (status, answer) = page.ask("GET", &format!("picture/{number}"), "");
            assert!(status == 200 && answer.contains(&format!("content-type: {kind}")), "{number}: {status}");
        }
        for number in ["0", "5", "-1", "x", "..%2Fclip.csv"] {
            let (status, answer) = page.ask("GET", &format!("picture/{number}"), "");
            assert!(status == 404 && answer.contains("valid: 1 to 4"), "{number}: {status} {answer}");
        }
        let (status, answer) = page.ask("GET", "picture/4", "");
        assert!(status == 422 && answer.contains("4.png: No such file"), "{status} {answer}");
    }

    /// Returns EXIF data with one entry, the orientation of the picture (tag 0x0112).
    fn exif_with_orientation(orientation: u8) -> Vec<u8> {
        let entry = [0x01, 0x12, 0, 3, 0, 0, 0, 1, 0, orientation, 0, 0];
        [&b"MM\0*\0\0\0\x08\0\x01"[..], &entry, &[0; 4]].concat()
    }

    /// Computes the CRC of a PNG chunk.
    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(
                crc ^ u32::from(*byte),
                |crc, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 },
            )
        })
    }

    /// A camera that is mounted upside down, or on its side, may state its orientation in the EXIF data, and browsers
    /// rotate such a picture. Labels are drawn on pixels, so in every file format the same pixels are sent without EXIF
    /// data.
    #[test]
    fn pictures_are_sent_without_exif_rotation() {
        let rgb = (0..8_u8).map(|index| [index * 30, 255 - index * 30, 90]).collect();
        let picture = panelprep_base::geometry::ColorPicture { width: 4, height: 2, rgb };
        let (plain_jpeg, plain_png) =
            (files::write_color_jpeg(&picture).expect("packed"), files::write_color_png(&picture).expect("packed"));
        for orientation in [3, 6, 8] {
            let exif = exif_with_orientation(orientation);
            let segment = [&b"Exif\0\0"[..], &exif].concat();
            let length = u16::try_from(segment.len() + 2).expect("short").to_be_bytes();
            let jpeg = [&plain_jpeg[..2], &[0xff, 0xe1], &length, &segment, &plain_jpeg[2..]].concat();
            let chunk = [&b"eXIf"[..], &exif].concat();
            let length = u32::try_from(exif.len()).expect("short").to_be_bytes();
            // The EXIF chunk is inserted after the header chunk.
            let png = [&plain_png[..33], &length, &chunk, &crc(&chunk).to_be_bytes(), &plain_png[33..]].concat();
            for (bytes, plain) in [(jpeg, &plain_jpeg), (png, &plain_png)] {
                let expected = files::read_color(plain).expect("a picture");
                assert_eq!(files::read_color(&bytes).expect("a picture"), expected, "the program takes the pixels");
                let (kind, sent) = browser_picture(bytes).expect("it is shown");
                assert_eq!((kind, files::read_color(&sent).expect("a picture")), ("image/png", expected));
                let has = |name: &[u8]| sent.windows(name.len()).any(|part| part == name);
                assert!(!has(b"Exif") && !has(b"eXIf"), "no word of a turn");
            }
        }
        for plain in [plain_jpeg, plain_png] {
            assert_eq!(browser_picture(plain.clone()).expect("it is shown").1, plain, "as it is");
        }
    }

    /// A page of another website in the same browser does not know the key, and its requests name another host.
    #[test]
    fn no_other_client_is_served() {
        let page = open();
        let wrong = "0".repeat(32);
        for path in
            ["/".to_owned(), format!("/{wrong}/"), format!("/{wrong}/clip.json"), format!("/{wrong}/picture/1")]
        {
            assert_eq!(page.ask_as(page.host(), "GET", &path, "").0, 404, "{path}");
        }
        for what in ["save", "draft", "done"] {
            assert_eq!(page.ask_as(page.host(), "POST", &format!("/{wrong}/{what}"), SAID).0, 404, "{what}");
        }
        assert_eq!(page.ask_as("evil.example", "GET", &format!("/{}/clip.json", page.key()), "").0, 403);
        assert!(!page.ask("GET", "clip.json", "").1.contains("corners_px"), "nothing was kept");
    }
}
