//! Checks that the programs agree with the EthernetKRL files, client, mock, example cell and installation page.

use super::each;
use super::krl::{data, files, folder};
use panelprep::cell::Cell;
use panelprep::devices::mock::{Arm, Refusal};
use panelprep::eki::{CELLCMD, CELLSTAT, ChannelFile, Element, Kind, LinkLimits, MAX_EPOCH_STEP};
use std::collections::{BTreeMap, BTreeSet};

fn page() -> String {
    std::fs::read_to_string(folder().join("README.md")).expect("the page")
}

fn channels() -> [(&'static str, ChannelFile); 2] {
    [("CELLCMD", CELLCMD), ("CELLSTAT", CELLSTAT)]
        .map(|(name, text)| (name, ChannelFile::parse(text).expect("a shipped file")))
}

fn is_of(kind: Kind, function: &str) -> bool {
    match kind {
        Kind::Int => function.ends_with("INT"),
        Kind::Real => function.ends_with("REAL"),
        Kind::Frame => function.ends_with("FRAME"),
        Kind::Bool | Kind::Text => false,
    }
}

/// The programs read only elements that they receive and set only elements that they send, both by their type. Every
/// element of the files is used.
#[test]
fn programs_and_channel_files_name_the_same_elements() {
    let files = files();
    let channels = BTreeMap::from(channels());
    let mut used = BTreeSet::new();
    each(&files, |routine, statement| {
        for (function, arguments) in statement.calls().iter().filter(|(name, _)| name.starts_with("EKI_")) {
            let at = format!("{}:{}: {}", routine.file, statement.line, statement.code);
            let text = |place: usize| arguments[place].trim_matches('"').to_owned();
            let file = channels.get(text(0).as_str()).unwrap_or_else(|| panic!("{at}: no such channel"));
            assert!(statement.code.starts_with("RET=EKI_"), "{at}: its status is looked at");
            let find = |elements: &[Element]| elements.iter().find(|element| element.tag == text(1)).cloned();
            match function.as_str() {
                "EKI_INIT" | "EKI_OPEN" | "EKI_CLEAR" => assert_eq!(arguments.len(), 1, "{at}"),
                "EKI_CHECKBUFFER" => {
                    assert!(find(&file.received).is_some_and(|found| found.kind.is_some()), "{at}")
                }
                "EKI_SEND" => {
                    let root = format!("{}/", text(1));
                    assert!(file.sent.iter().all(|element| element.tag.starts_with(&root)), "{at}");
                }
                get_or_set => {
                    let elements = if get_or_set.starts_with("EKI_GET") { &file.received } else { &file.sent };
                    let element = find(elements).unwrap_or_else(|| panic!("{at}: not in {}.xml", text(0)));
                    assert!(element.kind.is_some_and(|kind| is_of(kind, get_or_set)), "{at}: {:?}", element.kind);
                    assert!(used.insert(text(1)), "{at}: twice");
                }
            }
        }
    });
    let all: BTreeSet<String> = channels
        .values()
        .flat_map(|file| file.received.iter().chain(&file.sent))
        .filter(|element| element.kind.is_some())
        .map(|element| element.tag.clone())
        .collect();
    assert_eq!(used, all);
}

fn number(data: &BTreeMap<String, String>, name: &str) -> f64 {
    data.get(name).unwrap_or_else(|| panic!("no {name}")).parse().unwrap_or_else(|_| panic!("{name} is no number"))
}

/// Flags and timers have the same numbers where they are declared, in the XML files, in the interrupts and on the page.
#[test]
fn flags_and_timers_agree_everywhere() {
    let files = files();
    let data = data(&files);
    let [(_, commands), (_, states)] = channels();
    let flag = |name: &str| number(&data, name) as u32;
    let root = |file: &ChannelFile| file.received.iter().find_map(|element| element.set_flag).expect("a flag");
    assert_eq!(commands.alive_flag, Some(flag("CELL_F_CMD_ALIVE")));
    assert_eq!(root(&commands), flag("CELL_F_CMD_CAME"));
    assert_eq!(states.alive_flag, Some(flag("CELL_F_STAT_ALIVE")));
    assert_eq!(root(&states), flag("CELL_F_STAT_CAME"));
    let motion = &files.iter().find(|file| file.name == "cell_motion.src").expect("it").text;
    for declared in [
        format!("INTERRUPT DECL 20 WHEN $FLAG[{}]==TRUE DO CELL_ISR_HALT( )", flag("CELL_F_HALT")),
        format!("INTERRUPT DECL 21 WHEN $FLAG[{}]==TRUE DO CELL_ISR_STOP( )", flag("CELL_F_STOP")),
        format!("INTERRUPT DECL 22 WHEN $TIMER_FLAG[{}]==TRUE DO CELL_ISR_STOP( )", flag("CELL_T_SUBMIT")),
    ] {
        assert!(motion.contains(&declared), "{declared}");
    }
    let page = page();
    let named: Vec<&String> =
        data.keys().filter(|name| name.starts_with("CELL_F_") || name.starts_with("CELL_T_")).collect();
    assert_eq!(named.len(), 13);
    for name in &named {
        let kind = if name.starts_with("CELL_F_") { "$FLAG" } else { "$TIMER" };
        let row = format!("| `{kind}` | {} | `{name}` |", data[*name]);
        assert!(page.contains(&row), "the page lacks {row}");
    }
    let numbers: BTreeSet<&String> = named.iter().map(|name| &data[*name]).collect();
    assert_eq!(numbers.len(), named.len(), "each number once");
    // CELL_INIT starts the timers in one loop.
    let timers = [
        "CELL_T_HEARD",
        "CELL_T_SUBMIT",
        "CELL_T_ACK",
        "CELL_T_STATE",
        "CELL_T_SILENT",
        "CELL_T_OFF",
        "CELL_T_STILL",
    ];
    let timers = timers.map(|name| number(&data, name));
    assert!(timers.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "the timers follow one another");
    // In all other places the programs use flags, timers and signals by their names.
    each(&files, |routine, statement| {
        for array in ["$FLAG[", "$TIMER[", "$TIMER_FLAG[", "$TIMER_STOP[", "$OUT[", "$IN["] {
            for (at, _) in statement.code.match_indices(array) {
                let literal = statement.code[at + array.len()..].starts_with(|c: char| c.is_ascii_digit());
                let allowed = statement.code.starts_with("INTERRUPT DECL");
                assert!(!literal || allowed, "{}:{}: {}", routine.file, statement.line, statement.code);
            }
        }
    });
}

/// Returns the value of `const NAME: … = value;` anywhere in the mock.
fn mock_constant(name: &str) -> f64 {
    let folder = folder().join("../../src/devices/mock");
    let mut texts = Vec::new();
    let mut folders = vec![folder];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("the mock") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                texts.push(std::fs::read_to_string(path).expect("readable"));
            }
        }
    }
    let declared = format!("const {name}: ");
    let mut values = texts.iter().flat_map(|text| text.lines()).filter_map(|line| {
        let (_, value) = line.split_once(&declared)?.1.split_once('=')?;
        value.trim().trim_end_matches(';').replace('_', "").parse().ok()
    });
    values.next().unwrap_or_else(|| panic!("the mock has no {name}"))
}

#[test]
fn constants_agree_with_client_and_mock() {
    let data = data(&files());
    let of = |name: &str| number(&data, name);
    let limits = LinkLimits::default();
    assert_eq!(of("CELL_WATCHDOG_MS"), limits.watchdog.as_millis() as f64);
    assert!(of("CELL_STATE_MS") <= limits.heartbeat.as_millis() as f64);
    assert!(of("CELL_RING_N") >= 2.0 * limits.window_commands as f64, "a ring that the client cannot fill");
    // The client closes the connection to a silent controller after 1 s. The controller waits longer, so that the
    // client closes first.
    assert!(of("CELL_SILENT_MS") > 1000.0);
    for (ours, mocks, unit) in [
        ("CELL_WATCHDOG_MS", "WATCHDOG_TIMEOUT_MS", 1.0),
        ("CELL_RING_N", "RING_ENTRIES", 1.0),
        ("CELL_PER_CYCLE", "COMMANDS_PER_TICK", 1.0),
        ("CELL_ADVANCE", "ADVANCE_MOTIONS", 1.0),
        ("CELL_STATE_MS", "STATE_INTERVAL_MS", 1.0),
        ("CELL_ACK_MS", "ACK_INTERVAL_MS", 1.0),
        ("CELL_CYCLE_MS", "TICK_MS", 1.0),
        ("CELL_SILENT_MS", "CLIENT_SILENCE_TIMEOUT_MS", 1.0),
        ("CELL_EPOCH_STEP", "MAX_EPOCH_STEP", 1.0),
        ("CELL_OFF_AGAIN_MS", "FORCED_OFF_DURATION_MS", 1.0),
        ("CELL_LINE_ALONE", "UNCONNECTED_LINE_OUTPUTS", 1.0),
        ("CELL_RETRACT_MM", "RETRACT_MM", 1.0),
        ("CELL_RETRACT_VEL", "RETRACT_MM_S", 1000.0),
        ("CELL_RETRACT_ACC", "RETRACT_MM_S2", 1000.0),
    ] {
        assert_eq!(of(ours) * unit, mock_constant(mocks), "{ours} and the mock's {mocks}");
    }
    assert_eq!(data["CELL_RING_N"], "100");
    assert_eq!(of("CELL_EPOCH_STEP"), f64::from(MAX_EPOCH_STEP), "of the client");
    assert!(files().iter().any(|file| file.text.contains("CELL_RING[100]")), "the array is as long");
    let arm = Arm::kr6_r700_2();
    for (axis, [low, high]) in arm.limits_deg.into_iter().enumerate() {
        assert_eq!(of(&format!("CELL_AXIS_MIN[{}]", axis + 1)), low);
        assert_eq!(of(&format!("CELL_AXIS_MAX[{}]", axis + 1)), high);
    }
}

#[test]
fn refusals_and_operations_have_the_same_numbers() {
    let files = files();
    let data = data(&files);
    let refusals = [
        ("CELL_E_ID_GAP", Refusal::IdGap),
        ("CELL_E_EPOCH", Refusal::WrongEpoch),
        ("CELL_E_RING_FULL", Refusal::RingFull),
        ("CELL_E_OPERATION", Refusal::UnknownOperation),
        ("CELL_E_RANGE", Refusal::OutOfRange),
        ("CELL_E_NO_FRAMES", Refusal::NoBaseOrTool),
        ("CELL_E_READ_ONLY", Refusal::ReadOnly),
        ("CELL_E_REACH", Refusal::Unreachable),
        ("CELL_E_NO_MOTION", Refusal::NoMotion),
        ("CELL_E_STOPPED", Refusal::Stopped),
        ("CELL_E_OVERRIDE", Refusal::Override),
        ("CELL_E_SPACE", Refusal::OutsideBox),
    ];
    for (name, refusal) in refusals {
        assert_eq!(number(&data, name), f64::from(refusal as i32), "{name}");
    }
    assert_eq!(data.keys().filter(|name| name.starts_with("CELL_E_")).count(), refusals.len());
    let mut cases = BTreeMap::new();
    for file in &files {
        for statement in file.statements().iter().filter(|statement| !statement.comment.is_empty()) {
            if let Some(number) = statement.code.strip_prefix("CASE ") {
                let name = statement.comment.to_uppercase();
                assert_eq!(number.parse(), Ok(mock_constant(&name)), "{}: {name}", file.name);
                cases.entry(file.name.as_str()).or_insert_with(Vec::new).push(name);
            }
        }
    }
    assert_eq!(cases["cell_motion.src"].len(), 8);
    assert_eq!(cases["cell_judge.src"].len(), 8);
    assert_eq!(cases["cell_link.src"], ["ABORT", "RESET", "LINE"]);
}

/// The bits of In and Out have the numbers of the example cell, in ascending order, as in the client.
#[test]
fn the_mapped_signals_are_those_of_the_example_cell() {
    let data = data(&files());
    let text = std::fs::read_to_string(folder().join("../cell-example.toml")).expect("the example");
    let cell = Cell::check("cell-example.toml", &text).expect("right");
    for (array, count, named) in [
        ("CELL_IN", "CELL_IN_N", cell.inputs_outputs().feedbacks()),
        ("CELL_OUT", "CELL_OUT_N", cell.inputs_outputs().outputs()),
    ] {
        let numbers: BTreeSet<u16> = named.values().copied().collect();
        assert_eq!(number(&data, count), numbers.len() as f64);
        for (index, expected) in numbers.into_iter().enumerate() {
            assert_eq!(number(&data, &format!("{array}[{}]", index + 1)), f64::from(expected));
        }
    }
    // The outputs that the controller switches off automatically: all except the lens shutter, with the numbers and
    // times of the example cell.
    let after_ms: BTreeMap<u16, f64> = cell
        .inputs_outputs()
        .off_delays_s()
        .iter()
        .map(|(name, s)| (cell.inputs_outputs().outputs()[name], 1_000.0 * f64::from(*s)))
        .collect();
    assert_eq!(number(&data, "CELL_OFF_N"), after_ms.len() as f64);
    for (index, (output, ms)) in after_ms.iter().enumerate() {
        assert_eq!(number(&data, &format!("CELL_OFF[{}]", index + 1)), f64::from(*output));
        assert_eq!(number(&data, &format!("CELL_OFF_MS[{}]", index + 1)), *ms);
    }
    let left_on: Vec<&String> = cell
        .inputs_outputs()
        .outputs()
        .iter()
        .filter(|(_, number)| !after_ms.contains_key(number))
        .map(|(name, _)| name)
        .collect();
    assert_eq!(left_on, ["lens_shutter"]);
    for name in ["tool", "spray"] {
        assert_eq!(after_ms[&cell.inputs_outputs().outputs()[name]], 0.0, "{name} goes off at once");
    }
}

/// Computes the checksum: sum times 31 plus the byte, modulo 1000003, over the programs that are not edited, without
/// their headers.
#[test]
fn the_stated_checksum_is_that_of_the_programs() {
    let files = files();
    let mut sum = 0u64;
    for file in files.iter().filter(|file| !["cell_config.dat", "cell_user.src"].contains(&file.name.as_str())) {
        // The revision in a header increases when KSS saves the file.
        let counts = |line: &&str| !line.contains("CELL_PROGRAM_SUM=") && !line.starts_with('&');
        for line in file.text.lines().filter(counts) {
            sum = line.bytes().fold(sum, |sum, byte| (sum * 31 + u64::from(byte)) % 1_000_003);
        }
    }
    let found = number(&data(&files), "CELL_PROGRAM_SUM");
    assert_eq!(found, sum as f64, "programs were changed: CELL_PROGRAM_SUM in cell_data.dat must be {sum}");
    // Every value that may be edited is included in the checksum.
    let tell = &files.iter().find(|file| file.name == "cell_tell.src").expect("it").text;
    for name in data(&files[..1]).keys() {
        let name = name.split('[').next().unwrap_or_default();
        assert!(
            tell.contains(&format!("({name})")) || tell.contains(&format!("({name}[I])")),
            "{name} is not mixed in"
        );
    }
}

/// The installation page names every file, every refusal that a person may see, and both folds.
#[test]
fn the_installation_page_is_complete() {
    let page = page();
    for file in files() {
        assert!(page.contains(&format!("`{}`", file.name)), "{}", file.name);
    }
    for word in
        ["CELLCMD.xml", "CELLSTAT.xml", "CELL_INIT( )", "CELL_CYCLE( )", "USER INIT", "USER PLC", "172.31.1.147"]
    {
        assert!(page.contains(word), "{word}");
    }
    for code in 1..=12 {
        assert!(page.contains(&format!("\n| {code} | ")), "Err {code}");
    }
    for (_, file) in channels() {
        assert!(page.contains(&file.port.to_string()) && page.contains(&file.address.expect("an address")));
    }
}
