//! The flange camera's link: transfers full-size colour pictures of the simulated cell by GigE Vision over loopback for
//! SECONDS. Every picture is compared byte by byte, and every missing picture is counted. `cargo bench --bench cameras
//! -- SECONDS`, 600 by default.

#[path = "goal.rs"]
mod goal;

use goal::Figure;
use panelprep::devices::gige::{
    CameraSelector, ExposureMode, Frame, GigeCamera, GigeError, LOOPBACK_ADDRESS, LoopbackCamera, PACKET_BYTES,
    PixelFormat, Settings, Statistics, mosaic,
};
use panelprep::sim;
use std::process::ExitCode;
use std::time::{Duration, Instant};

const FORMAT: PixelFormat = PixelFormat::BayerRG8;
const FRAMES_PER_S: f64 = 10.0;
/// Maximum fraction of lost pictures; some losses are accepted, because the machine may be busy.
const MAX_LOST_FRACTION: f64 = 0.05;

fn main() -> ExitCode {
    let seconds = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(600);
    match run(Duration::from_secs(seconds)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Writes the picture of this exposure: one of the cell's pictures, with the exposure's number in its first eight
/// bytes.
fn expose(pictures: &[Vec<u8>], exposure: u64, pixels: &mut [u8]) {
    let shown = &pictures[exposure as usize % pictures.len()];
    let both = shown.len().min(pixels.len());
    pixels[..both].copy_from_slice(&shown[..both]);
    pixels[..8].copy_from_slice(&exposure.to_be_bytes());
}

fn run(span: Duration) -> Result<(), String> {
    let cell = sim::Cell::new(1, sim::Scene::Good, 1);
    let views = cell.corner_views();
    let render = |view: &sim::CornerView| cell.flange_picture(&view.base_from_flange, sim::PanelPosition::Nominal);
    let pictures: Vec<Vec<u8>> = views.iter().map(|view| mosaic(&render(view), FORMAT)).collect();
    let size_px = [cell.flange_camera().width_px, cell.flange_camera().height_px];
    println!(
        "{}×{} {}, {FRAMES_PER_S} pictures a second, {} s",
        size_px[0],
        size_px[1],
        FORMAT.name(),
        span.as_secs()
    );

    let shows = pictures.clone();
    let fill = move |exposure: u64, pixels: &mut [u8]| expose(&shows, exposure, pixels);
    let loopback =
        LoopbackCamera::start("BENCH", size_px, FORMAT, Box::new(fill)).map_err(|error| error.to_string())?;
    let settings = Settings {
        selector: CameraSelector::Address(LOOPBACK_ADDRESS.to_owned()),
        serial: None,
        user_set: "Default".to_owned(),
        size_px,
        format: FORMAT,
        exposure_us: None,
        gain_db: None,
        exposure_mode: ExposureMode::FreeRunning { frames_per_s: FRAMES_PER_S },
        packet_bytes: PACKET_BYTES,
        may_repeat: false,
    };
    let mut camera = GigeCamera::open(settings).map_err(|error| error.to_string())?;
    let frame = camera.picture().map_err(|error| error.to_string())?;
    let (begun, mut said, before) = (Instant::now(), Instant::now(), camera.statistics());
    let number_of = |frame: &Frame| frame.pixels.first_chunk().map_or(u64::MAX, |first| u64::from_be_bytes(*first));
    let first = number_of(&frame);
    let (mut last, mut wrong) = (first, 0_u64);
    let mut sent = vec![0; size_px[0] * size_px[1]];
    while begun.elapsed() < span {
        let frame = match camera.picture() {
            // A busy machine may deliver late; missing pictures are counted.
            Err(GigeError::Timeout { .. }) => continue,
            taken => taken.map_err(|error| error.to_string())?,
        };
        let number = number_of(&frame);
        expose(&pictures, number, &mut sent);
        if frame.pixels == sent {
            last = number;
        } else {
            wrong += 1;
        }
        if said.elapsed() > Duration::from_secs(60) {
            said = Instant::now();
            println!("{:4} s: {}", begun.elapsed().as_secs(), camera.statistics());
        }
    }
    let counted = camera.statistics();
    let exposed = last - first;
    drop((camera, loopback));
    println!("{exposed} exposures: {counted}; {wrong} received pictures that differ");
    let seen = |counted: Statistics| counted.accepted + counted.refused + counted.lost;
    let accounted = seen(counted) - seen(before);
    let taken = counted.accepted - before.accepted;
    let missing = exposed.saturating_sub(taken) as f64 / exposed.max(1) as f64;
    println!("not received: {:.2} %, all of them counted: {}", 100.0 * missing, accounted == exposed);
    let found = format!("{wrong} of {taken}");
    let is_same = wrong == 0 && taken > 0;
    Figure("cameras: flange camera over GigE Vision: pictures that differ").report("0", &found, is_same);
    let goal = format!("{} %", 100.0 * MAX_LOST_FRACTION);
    let is_whole = missing <= MAX_LOST_FRACTION && exposed > 0;
    Figure("cameras: not taken").report(&goal, &format!("{:.2} %", 100.0 * missing), is_whole);
    let held = wrong == 0 && accounted == exposed && missing <= MAX_LOST_FRACTION && exposed > 0;
    if held { Ok(()) } else { Err("the link misses its target".to_owned()) }
}
