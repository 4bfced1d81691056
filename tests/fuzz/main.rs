//! Searches for bytes with which a reader fails, guided by coverage: libFuzzer on stable Rust (`make fuzz`, `make
//! fuzz-krl`). The environment variable `FUZZ_TARGET` names the target. If `FUZZ_SEEDS` names a folder, the seeds of
//! the target are written there.
#![no_main]

mod seeds;
mod session;
mod targets;

use std::path::Path;
use std::sync::OnceLock;
use targets::{TARGETS, Target};

static TARGET: OnceLock<&'static Target> = OnceLock::new();

fn chosen() -> &'static Target {
    TARGET.get_or_init(|| {
        let name = std::env::var("FUZZ_TARGET").unwrap_or_default();
        let names = TARGETS.each_ref().map(|target| target.name);
        let target = TARGETS.iter().find(|target| target.name == name);
        target.unwrap_or_else(|| panic!("FUZZ_TARGET is '{name}'; allowed: {}", names.join(", ")))
    })
}

libfuzzer_sys::fuzz_target!(
    init: {
        if let Ok(folder) = std::env::var("FUZZ_SEEDS") {
            for (index, seed) in (chosen().seeds)().iter().enumerate() {
                std::fs::write(Path::new(&folder).join(format!("seed-{index}")), seed).expect("written");
            }
        }
    },
    |bytes: &[u8]| {
        (chosen().run)(bytes);
    }
);
