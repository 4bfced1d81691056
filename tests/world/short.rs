//! The worlds of each test run: some seeds, worlds that failed once, and tests of the world itself.

use crate::world::{Counts, World, parse, print};

/// Number of seeds in each test run; for more, set `WORLD_SEEDS=1000`.
const SEEDS: u64 = 120;

/// Worlds in which a fault of the product was once detected: the seed, the script, and the violation.
const FOUND_ONCE: [(u64, &str, &str); 17] = [
    (
        949326,
        r#"[{"place":"abrade","visit":1,"after_ms":2383,"fault":{"Press":"Hold"}},{"place":"holding","visit":1,"after_ms":0,"fault":{"Controller":"drives/2355ms"}}]"#,
        "waypoints of a contact path were forgotten where drives went off while a hold waited for the end of its epoch",
    ),
    (
        961429,
        r#"[{"place":"verify","visit":1,"after_ms":0,"fault":{"Controller":"stall/217ms"}},{"place":"verify","visit":1,"after_ms":0,"fault":{"Controller":"deselect/157ms"}}]"#,
        "a robot program that was selected anew while the other interpreter stood still counts from zero, and what it had executed was taken for waiting",
    ),
    (
        938546,
        r#"[{"place":"dry","visit":1,"after_ms":0,"fault":{"Bytes":{"to_robot":true,"channel":0,"harm":{"Damage":{"byte":124,"bit":1}}}}}]"#,
        "a damaged digit sent an axis 0.2° beside the parked pose, and the arm was taken for parked: half a degree was allowed",
    ),
    (
        934133,
        r#"[{"place":"resetting","visit":1,"after_ms":131,"fault":{"Press":"Everything"}},{"place":"locate","visit":1,"after_ms":472,"fault":{"Foreign":{"operation":11,"number":127714}}},{"place":"refine","visit":1,"after_ms":250,"fault":{"Controller":"reboot/816ms"}}]"#,
        "an abort was waited for at a controller that was started again in the same moment",
    ),
    (
        240001,
        r#"[{"place":"abrade","visit":1,"after_ms":1537,"fault":{"Deaf":2175}},{"place":"aborting","visit":1,"after_ms":0,"fault":{"Away":39630}}]"#,
        "extraction that goes off 30 s after the controller's own end of the epoch was counted from the client's, two seconds before",
    ),
    (
        504171,
        r#"[{"place":"abrade","visit":1,"after_ms":2261,"fault":{"Controller":"slow=5/3835ms"}}]"#,
        "a retract that a twentieth of the speed had held up was taken for a motion without a command",
    ),
    (
        507142,
        r#"[{"place":"resetting","visit":1,"after_ms":0,"fault":{"Power":{"writing":39,"power":"Kill"}}},{"place":"stopped","visit":1,"after_ms":0,"fault":{"Press":"Stop"}}]"#,
        "a process was killed after a commit's writing and before its flush; the next one read that row, told the head of it, and a power cut took the row",
    ),
    (
        1433,
        r#"[{"place":"idle","visit":1,"after_ms":2464,"fault":{"Disk":{"writing":9,"harm":"Io","times":2}}}]"#,
        "a commit fails at the disk, and so does closing the store: its lines are in the log, and the head no longer said that they may be",
    ),
    (
        3668,
        r#"[{"place":"rinse","visit":1,"after_ms":178,"fault":{"Disk":{"writing":1,"harm":"Full","times":10}}},{"place":"rinse","visit":1,"after_ms":138,"fault":{"Disk":{"writing":0,"harm":"Full","times":30}}}]"#,
        "the simulated disk stayed full although the reserve had been given up",
    ),
    (
        100994,
        r#"[{"place":"holding","visit":1,"after_ms":0,"fault":{"Disk":{"writing":6,"harm":"Full","times":1}}},{"place":"dry","visit":1,"after_ms":1119,"fault":{"Disk":{"writing":8,"harm":"Full","times":2}}}]"#,
        "the simulated disk was full once more in a process that had just given up its reserve",
    ),
    (
        101200,
        r#"[{"place":"verify","visit":1,"after_ms":1713,"fault":{"Bytes":{"to_robot":true,"channel":0,"harm":"Half"}}},{"place":"retract","visit":1,"after_ms":160,"fault":{"Cut":{"channel":1,"by_robot":true,"loses":true}}}]"#,
        "half a message that waited at the controller was taken for no trouble of the cycle after it",
    ),
    (
        100228,
        r#"[{"place":"abrade","visit":1,"after_ms":292,"fault":{"ForeignProgram":3971}},{"place":"aborted","visit":1,"after_ms":163,"fault":{"Controller":"wrong-base"}}]"#,
        "a base that was wrong when it was next set was taken for no trouble of that cycle",
    ),
    (
        20001041,
        r#"[{"place":"idle","visit":1,"after_ms":1213,"fault":{"Bytes":{"to_robot":true,"channel":0,"harm":"Lose"}}},{"place":"refine","visit":1,"after_ms":112,"fault":{"Controller":"reboot/335ms"}},{"place":"clearing","visit":1,"after_ms":300,"fault":{"Foreign":{"operation":11,"number":0}}},{"place":"idle","visit":1,"after_ms":1949,"fault":"Backup"},{"place":"aborted","visit":1,"after_ms":1504,"fault":"Restore"}]"#,
        "epochs that neither a restored store nor a controller that was started again knows were taken for ended",
    ),
    (
        20200704,
        r#"[{"place":"completing","visit":1,"after_ms":2288,"fault":{"Press":"Accept"}}]"#,
        "a cycle that found the arm near the panel, where no path had left it, was taken for one without trouble",
    ),
    (
        30000045,
        r#"[{"place":"abrade","visit":1,"after_ms":4276,"fault":{"Controller":"override=1/501ms"}}]"#,
        "a retract at an override of 1 % was expected to leave the panel as fast as at 100 %",
    ),
    (
        30001108,
        r#"[{"place":"abrade","visit":1,"after_ms":180,"fault":{"Disk":{"writing":7,"harm":"Io","times":30}}}]"#,
        "an arm whose tip was 100 mm off the panel, and whose tool 39 mm, was expected to go to its park pose without a jog",
    ),
    (
        41010845,
        r#"[{"place":"abrade","visit":1,"after_ms":2489,"fault":{"Disk":{"writing":21,"harm":"Io","times":30}}},{"place":"abrade","visit":1,"after_ms":2116,"fault":{"Controller":"override=99/534ms"}}]"#,
        "motions after a contact path, the end of which the disk refused, were counted as its waypoints",
    ),
];

#[test]
fn no_world_violates_a_rule() {
    let seeds = std::env::var("WORLD_SEEDS").map_or(SEEDS, |seeds| seeds.parse().expect("a number of seeds"));
    let mut counts = Counts::default();
    for seed in 0..seeds {
        let world = World::from_seed(seed);
        let outcome = world.run();
        counts.add(&outcome.counts);
        if let Some(violation) = outcome.violation {
            let script = print(&world.shortest(violation.judge).script);
            panic!("{violation:?}\ncargo bench --bench world -- seed={seed} script='{script}'");
        }
    }
    println!("{counts:#?}");
    for judge in ["interlocks", "facts", "stop", "liveness", "nothing acknowledged is lost", "record and page"] {
        assert!(counts.judged.get(judge).is_some_and(|times| *times > 0), "{judge} has not judged");
    }
    assert!(counts.cuts > 0 && counts.kills > 0 && counts.cycles >= seeds, "{counts:?}");
}

/// The same seed gives the same world, to the last entry of its journal.
#[test]
fn a_seed_always_gives_the_same_world() {
    for seed in [4, 9, 17] {
        let [one, other] = [World::from_seed(seed).run(), World::from_seed(seed).run()];
        assert_eq!((one.trace, one.counts.time_ms), (other.trace, other.counts.time_ms), "seed {seed}");
    }
}

/// A printed script is read back unchanged.
#[test]
fn a_script_reads_back() {
    for seed in 0..200 {
        let script = World::from_seed(seed).script;
        assert_eq!(parse(&print(&script)).expect("a script"), script);
    }
}

#[test]
fn worlds_that_failed_once_do_not_fail_again() {
    for (seed, script, found) in FOUND_ONCE {
        let outcome = World::with(seed, parse(script).expect("a script")).run();
        assert_eq!(outcome.violation, None, "{found}");
    }
}
