//! Runs the water-break test on rendered clips of many seeds with all effects that make a film difficult to evaluate.
//! The test also runs on clips of a second, optical renderer and on damaged clips, and its speed and memory are
//! measured. `cargo bench --bench inspect -- [clips] [optics] [damage] [speed] [memory] [seeds=1-64] [reduction=1]
//! [observed_s=20] [kind=clean]`: without a named part, all parts run; optics uses seeds 1 to 60 unless seeds are
//! given. The environment variable `INSPECT` contains additional lines for the recipe's table, `PICTURES` a folder for
//! the results.

#[path = "inspect/clips.rs"]
mod clips;
#[path = "inspect/conditions.rs"]
mod conditions;
#[path = "inspect/damage.rs"]
mod damage;
#[path = "goal.rs"]
mod goal;
#[path = "inspect/optics/mod.rs"]
mod optics;
#[path = "inspect/speed.rs"]
mod speed;
#[path = "inspect/tally.rs"]
mod tally;

fn main() -> std::process::ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let value = |name: &str| arguments.iter().find_map(|argument| argument.strip_prefix(name)?.strip_prefix('='));
    let number = |name: &str, usual: f64| value(name).map_or(usual, |text| text.parse().expect("a number"));
    let (first, last) = value("seeds").unwrap_or("1-64").split_once('-').expect("the first seed and the last");
    let [first, last] = [first, last].map(|seed| seed.parse::<u64>().expect("a seed"));
    let (reduction, observed_s) = (number("reduction", 1.0) as usize, number("observed_s", 20.0));
    let named = |part: &str| arguments.iter().any(|argument| argument == part);
    let all = !["clips", "optics", "damage", "speed", "memory"].into_iter().any(named);
    if all || named("clips") {
        let kind = value("kind").map(str::to_owned);
        clips::run(&clips::Extent { seeds: first..=last, reduction, observed_s, kind });
    }
    if all || named("optics") {
        let seeds = if value("seeds").is_some() { first..=last } else { 1..=60 };
        optics::run(seeds, reduction, observed_s, value("kind"));
    }
    if all || named("damage") {
        damage::run(last.min(4), reduction);
    }
    if all || named("speed") {
        speed::run(reduction);
    }
    if all || named("memory") {
        speed::memory(reduction);
    }
    if goal::missed() == 0 { std::process::ExitCode::SUCCESS } else { std::process::ExitCode::FAILURE }
}
