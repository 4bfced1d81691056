//! The water-break test on rendered clips of many seeds with everything that makes a film hard to read, on damaged clips,
//! and its speed. `cargo bench --bench inspect -- [CLIPS] [REDUCTION] [OBSERVED_S] [clips|damage|speed]`
//! `INSPECT` holds more lines for the recipe's table, `PICTURES` a folder for what was found.

#[path = "inspect/clips.rs"]
mod clips;
#[path = "inspect/damage.rs"]
mod damage;
#[path = "inspect/speed.rs"]
mod speed;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let mut numbers = arguments.iter().filter_map(|argument| argument.parse::<f64>().ok());
    let clips = numbers.next().unwrap_or(64.0) as u64;
    let reduction = numbers.next().unwrap_or(1.0) as usize;
    let observed_s = numbers.next().unwrap_or(20.0);
    let all = !arguments.iter().any(|argument| ["clips", "damage", "speed"].contains(&argument.as_str()));
    let asked = |part: &str| all || arguments.iter().any(|argument| argument == part);
    if asked("clips") {
        clips::run(clips::Extent { clips, reduction, observed_s });
    }
    if asked("damage") {
        damage::run(if all { 4 } else { clips.min(4) }, reduction);
    }
    if asked("speed") {
        speed::run(reduction);
        speed::memory(reduction);
    }
}
