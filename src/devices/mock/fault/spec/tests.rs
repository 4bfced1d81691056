//! Tests fault specifications as users write them, and the messages about invalid ones.

use super::*;

fn read(text: &str) -> Result<FaultSpec, FaultSpecError> {
    text.parse()
}

#[test]
fn every_kind_of_item_is_read() {
    let spec = read("seed=7, delay=5ms..15ms,fragment,unplug/2s@10s,refuse=8@#40,cut@250ms,slow=20/1.5s@3s");
    let planned = |when, fault| PlannedFault { when, fault };
    let expected = FaultSpec {
        seed: 7,
        delay_ms: Some((5, 15)),
        fragment: true,
        planned: vec![
            planned(FaultTime::AtMs(10_000), Fault::Unplug { for_ms: Some(2_000) }),
            planned(FaultTime::AtCommand(40), Fault::Refuse(8)),
            planned(FaultTime::AtMs(250), Fault::Cut(ConnectionSide::Both)),
            planned(FaultTime::AtMs(3_000), Fault::Slow { percent: 20, for_ms: Some(1_500) }),
        ],
    };
    assert_eq!(spec, Ok(expected));
    for name in FAULTS {
        let value = match name {
            "refuse" => "=8",
            "slow" | "override" | "measured" => "=50",
            "mode" => "=T1",
            "cut" | "garbage" => "=state",
            _ => "",
        };
        assert!(read(&format!("{name}{value}@1s")).is_ok(), "{name}");
    }
}

#[test]
fn an_invalid_item_is_reported_with_the_valid_values() {
    let cases = [
        ("", "an item is empty; items are separated by single commas"),
        ("cut@1s,,cut@2s", "an item is empty; items are separated by single commas"),
        (
            "cut",
            "\"cut\": the time of the fault is missing; add @TIME (@3s, @250ms) or @#N, the arrival of the Nth command",
        ),
        ("cut=left@1s", "\"cut=left@1s\": the value is \"left\"; valid: command, state or both"),
        ("refuse@1s", "\"refuse@1s\": the value is missing; valid: an Err of 1 to 12"),
        ("refuse=13@1s", "\"refuse=13@1s\": the value is \"13\"; valid: an Err of 1 to 12"),
        ("slow=0@1s", "\"slow=0@1s\": the value is \"0\"; valid: 1 to 100 percent"),
        ("mode=t1@1s", "\"mode=t1@1s\": the value is \"t1\"; valid: T1, T2, AUT or EXT"),
        ("lose-base=1@1s", "\"lose-base=1@1s\": lose-base does not accept a value"),
        ("lose-base/2s@1s", "\"lose-base/2s@1s\": lose-base does not accept a duration"),
        ("seed=7@1s", "\"seed=7@1s\": seed does not accept a time"),
        ("seed=x", "\"seed=x\": the value is \"x\"; valid: a whole number, such as seed=7"),
        (
            "delay=25ms..5ms",
            "\"delay=25ms..5ms\": the value is \"25ms..5ms\"; valid: a time or a range of times, such as 20ms or \
             2ms..25ms, at most 10s",
        ),
        ("unplug/2@1s", "\"unplug/2@1s\": \"2\" is not a time; write 3s, 1.5s or 250ms, at most 1 day"),
        (
            "unplug@-1s",
            "\"unplug@-1s\": \"-1s\" is not a time; write 3s, 1.5s or 250ms, at most 1 day, or #40 for the arrival of \
             the 40th command",
        ),
        ("random=0", "\"random=0\": the value is \"0\"; valid: a count of 1 to 1000, such as random=5/60s"),
    ];
    for (text, message) in cases {
        assert_eq!(read(text).expect_err(text).to_string(), message);
    }
    let unknown = read("unplugg@1s").expect_err("unknown").to_string();
    let start = "\"unplugg@1s\": unplugg is not a fault or setting (did you mean unplug?); valid: seed, delay, \
                 fragment";
    assert!(unknown.starts_with(start), "{unknown}");
}

/// Fifty random faults begin within the given time, and the same seed always gives the same sequence.
#[test]
fn the_seed_determines_the_random_faults() {
    let spec = read("random=50/20s,seed=3").expect("read");
    assert_eq!(spec.planned.len(), 50);
    assert!(spec.planned.iter().all(|planned| matches!(planned.when, FaultTime::AtMs(0..20_000))));
    assert_eq!(read("seed=3,random=50/20s").expect("read"), spec);
    assert_ne!(read("seed=4,random=50/20s").expect("read").planned, spec.planned);
}
