//! The page as a browser requests it.

use super::*;
use panelprep_base::phase::Phase;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::Mutex;
use std::thread::JoinHandle;

/// Stores labels in memory, and accepts those with an author's name.
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

/// Opens a clip with a PNG, a JPEG and a TIFF picture, and one that is missing.
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
        self.url.trim_start_matches("http://").split('/').next().expect("a host")
    }

    fn key(&self) -> &str {
        self.url.trim_end_matches('/').rsplit('/').next().expect("a key")
    }

    /// Sends a request as this host; returns the status and the whole answer.
    fn ask_as(&self, host: &str, method: &str, path: &str, body: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(self.host()).expect("it listens");
        let request = format!(
            "{method} {path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\ncontent-type: application/json\r\n\
             content-length: {}\r\n\r\n{body}",
            body.len()
        );
        stream.write_all(request.as_bytes()).expect("sent");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("answered");
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.split(' ').nth(1).and_then(|word| word.parse().ok()).expect("a status");
        (status, answer)
    }

    fn ask(&self, method: &str, page: &str, body: &str) -> (u16, String) {
        self.ask_as(self.host(), method, &format!("/{}/{page}", self.key()), body)
    }
}

const SAID: &str = r#"{"author":"","clean":false,"breaks":[{"closes_s":null,"shapes":[{"from_s":1.0,"corners_px":[[0.0,0.0],[3.5,0.0]]}]}]}"#;

#[test]
fn what_is_drawn_is_kept_and_what_is_right_is_saved() {
    let page = open();
    for (file, words) in
        [("", "Breaks in"), ("label.js", "pointerdown"), ("label.css", ".corner"), ("film.js", "picture/")]
    {
        let (status, text) = page.ask("GET", file, "");
        assert!(status == 200 && text.contains(words), "{file}: {status}");
    }
    let (status, clip) = page.ask("GET", "clip.json", "");
    assert!(status == 200 && clip.contains(r#""phase":"dry""#) && clip.contains("r1c1"), "{clip}");
    // A draft may be unfinished: here it has two corners and no name.
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
fn each_picture_comes_as_a_browser_shows_it() {
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

/// EXIF data that state by which rotation the picture must be shown: one entry, the tag 0x0112.
fn turned(orientation: u8) -> Vec<u8> {
    let entry = [0x01, 0x12, 0, 3, 0, 0, 0, 1, 0, orientation, 0, 0];
    [&b"MM\0*\0\0\0\x08\0\x01"[..], &entry, &[0; 4]].concat()
}

/// Calculates the CRC of a PNG's chunk.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 })
    })
}

/// A camera that hangs upside down, or on its side, states this in its pictures, and browsers rotate them. Labels are
/// drawn on pixels, so the picture is sent with the same pixels and without rotation data, for each file format.
#[test]
fn a_picture_is_shown_as_its_pixels_are() {
    let rgb = (0..8_u8).map(|index| [index * 30, 255 - index * 30, 90]).collect();
    let picture = panelprep_base::geometry::ColorPicture { width: 4, height: 2, rgb };
    let (plain_jpeg, plain_png) =
        (files::write_color_jpeg(&picture).expect("packed"), files::write_color_png(&picture).expect("packed"));
    for orientation in [3, 6, 8] {
        let exif = turned(orientation);
        let segment = [&b"Exif\0\0"[..], &exif].concat();
        let length = u16::try_from(segment.len() + 2).expect("short").to_be_bytes();
        let jpeg = [&plain_jpeg[..2], &[0xff, 0xe1], &length, &segment, &plain_jpeg[2..]].concat();
        let chunk = [&b"eXIf"[..], &exif].concat();
        let length = u32::try_from(exif.len()).expect("short").to_be_bytes();
        // The chunk of 13 bytes is inserted after the header.
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

/// Another page in the same browser does not know the key and does not use this host name.
#[test]
fn no_other_client_is_served() {
    let page = open();
    let wrong = "0".repeat(32);
    for path in ["/".to_owned(), format!("/{wrong}/"), format!("/{wrong}/clip.json"), format!("/{wrong}/picture/1")]
    {
        assert_eq!(page.ask_as(page.host(), "GET", &path, "").0, 404, "{path}");
    }
    for what in ["save", "draft", "done"] {
        assert_eq!(page.ask_as(page.host(), "POST", &format!("/{wrong}/{what}"), SAID).0, 404, "{what}");
    }
    assert_eq!(page.ask_as("evil.example", "GET", &format!("/{}/clip.json", page.key()), "").0, 403);
    assert!(!page.ask("GET", "clip.json", "").1.contains("corners_px"), "nothing was kept");
}
