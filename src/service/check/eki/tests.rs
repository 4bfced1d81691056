//! Tests with EthernetKRL files of this program, and with one example of each style of other authors.

use super::*;
use crate::check::{FileReport, check_file, check_files};

const COMMANDS: &str = include_str!("../../../../config/kuka/CELLCMD.xml");
const STATE: &str = include_str!("../../../../config/kuka/CELLSTAT.xml");

/// Returns a valid channel with these lines added to INTERNAL (line 4), RECEIVE (line 6) and SEND (line 8).
fn file(internal: &str, receive: &str, send: &str) -> String {
    format!(
        "<ETHERNETKRL>\n<CONFIGURATION>\n<EXTERNAL><TYPE>Client</TYPE></EXTERNAL>\n<INTERNAL>{internal}</INTERNAL>\n\
         </CONFIGURATION><RECEIVE>\n{receive}\n</RECEIVE>\n<SEND>{send}</SEND></ETHERNETKRL>"
    )
}

const INTERNAL: &str = "<ENVIRONMENT>Submit</ENVIRONMENT><BUFFERING Limit=\"512\"/><ALIVE Set_Flag=\"1\"/>\
                        <IP>172.31.1.147</IP><PORT>54600</PORT>";
const RECEIVE: &str = "<XML><ELEMENT Tag=\"A/@B\" Type=\"INT\"/><ELEMENT Tag=\"A\" Set_Flag=\"2\"/></XML>";

/// Returns the entries of a list as `line key: message`; the tests compare the beginnings of these texts.
fn lines(list: &[Problem]) -> Vec<String> {
    list.iter().map(|problem| format!("{} {}: {}", problem.line, problem.key, problem.message)).collect()
}

fn assert_begins(found: &[String], expected: &[&str], text: &str) {
    let begins =
        found.len() == expected.len() && found.iter().zip(expected).all(|(found, begin)| found.starts_with(begin));
    assert!(begins, "{found:#?}\ninstead of {expected:#?} in\n{text}");
}

fn expect(text: &str, problems: &[&str], warnings: &[&str]) -> FileReport {
    let report = check_file("THEIRS.xml", text);
    assert_begins(&lines(&report.problems), problems, text);
    assert_begins(&lines(&report.warnings), warnings, text);
    report
}

#[test]
fn the_programs_own_files_are_correct_and_described() {
    let reports = check_files(&[("config/kuka/CELLCMD.xml", COMMANDS), ("config/kuka/CELLSTAT.xml", STATE)], None);
    for report in &reports {
        assert_eq!((&report.problems, &report.warnings, report.kind), (&vec![], &vec![], Some("EthernetKRL")));
    }
    assert_eq!(
        reports[0].descriptions,
        [
            "channel CELLCMD: the controller listens on 172.31.1.147, port 54600, TCP, and accepts one client",
            "the channel exists until the submit interpreter is cancelled or the inputs and outputs are reconfigured",
            "at most 512 entries of each tag wait for the program, the oldest entry is read first, one more entry \
             closes the connection; at most 65534 received bytes wait to be interpreted",
            "$FLAG[850] is true while the other system is connected",
            "no Ping: EthernetKRL itself does not detect a disconnected cable",
            "messages: Logging warning, Display on the smartPAD disabled",
            "receives <Cmd>: @Id INT, @Ep INT, @Op INT, @N1 INT, @N2 INT, @R1 REAL, @R2 REAL, P FRAME (X Y Z A B C)",
            "$FLAG[851] is set when a whole <Cmd> has arrived; the program resets it",
            "sends <Ack>: @Rx INT, @Done INT, @Free INT, @Err INT, @ErrId INT, @Ep INT",
        ]
    );
    expect(&file(INTERNAL, RECEIVE, ""), &[], &[]);
}

/// The smallest possible file: every property has its default value, and each default is a pitfall.
#[test]
fn defaults_are_reported() {
    let report = expect(
        "<ETHERNETKRL><CONFIGURATION><EXTERNAL/>\n<INTERNAL/></CONFIGURATION><RECEIVE><XML>\n\
         <ELEMENT Tag=\"A/@B\" Type=\"INT\"/></XML></RECEIVE></ETHERNETKRL>",
        &[
            "1 CONFIGURATION/EXTERNAL/IP: is missing; the controller connects to",
            "1 CONFIGURATION/EXTERNAL/PORT: is missing; the controller connects to",
        ],
        &[
            "1 CONFIGURATION/EXTERNAL/TYPE: is not stated: the controller assumes Server, connects",
            "2 CONFIGURATION/INTERNAL/ENVIRONMENT: is not stated, so the default, Program, applies",
            "2 CONFIGURATION/INTERNAL/ALIVE: sets no flag",
            "2 CONFIGURATION/INTERNAL/BUFFERING/@Limit: states no Limit: each memory has 16 entries",
            "3 RECEIVE/XML/ELEMENT[A]: no flag is set when a <A> has arrived",
        ],
    );
    assert_eq!(
        report.descriptions[..3],
        [
            "channel THEIRS: the controller connects to an address that is not stated, port not stated, TCP, and gives up after \
             2000 ms",
            "the channel exists until the program is reset or deselected, or the inputs and outputs are reconfigured",
            "at most 16 entries of each tag wait for the program, the oldest entry is read first, one more entry \
             closes the connection; at most 16384 received bytes wait to be interpreted",
        ]
    );
}

/// A typical file for a streaming driver: UDP, a placeholder as the address, and a channel that ends with the program.
#[test]
fn a_placeholder_address_and_udp_are_reported() {
    let internal = "<ENVIRONMENT>Program</ENVIRONMENT><BUFFERING Mode=\"FIFO\" Limit=\"512\"/>\n<ALIVE Set_Flag=\"1\" Ping=\"200\"/>\
                    <IP>address.of.robot</IP><PORT>54600</PORT><PROTOCOL>UDP</PROTOCOL>\n<TIMEOUT Connect=\"60000\"/>";
    let report = expect(
        &file(internal, RECEIVE, ""),
        &[],
        &[
            "4 CONFIGURATION/INTERNAL/ENVIRONMENT: is Program: the channel is deleted",
            "5 CONFIGURATION/INTERNAL/IP: is \"address.of.robot\", which is not an address",
            "5 CONFIGURATION/INTERNAL/PROTOCOL: is UDP, which the manual does not recommend",
            "6 CONFIGURATION/INTERNAL/TIMEOUT/@Connect: stops the channel after 60000 ms",
        ],
    );
    assert!(
        report.descriptions.contains(&"the connection is monitored (Ping 200)".to_owned()),
        "{:?}",
        report.descriptions
    );
}

#[test]
fn properties_that_the_controller_refuses_are_problems() {
    let internal = |more: &str| file(&format!("{INTERNAL}\n{more}"), RECEIVE, "");
    let received =
        |element: &str| file(INTERNAL, &format!("<XML>{element}<ELEMENT Tag=\"A\" Set_Flag=\"2\"/></XML>"), "");
    let cases = [
        (
            internal("<BUFFSIZE Limit=\"70000\"/>"),
            "5 CONFIGURATION/INTERNAL/BUFFSIZE/@Limit: is \"70000\"; valid: a whole number 1 to 65534",
        ),
        (internal("<PORT>54601</PORT>"), "5 CONFIGURATION/INTERNAL/PORT: appears twice"),
        (
            internal("<PROTOCOL>TPC</PROTOCOL>"),
            "5 CONFIGURATION/INTERNAL/PROTOCOL: is \"TPC\"; valid: one of TCP, UDP",
        ),
        (internal("<TIMEOUT Connect=\"-1\"/>"), "5 CONFIGURATION/INTERNAL/TIMEOUT/@Connect: is \"-1\""),
        (internal("<MESSAGES Logging=\"all\"/>"), "5 CONFIGURATION/INTERNAL/MESSAGES/@Logging: is \"all\""),
        (internal("<PROTOCOL></PROTOCOL>"), "5 CONFIGURATION/INTERNAL/PROTOCOL: is empty; valid: one of TCP, UDP"),
        (
            internal("").replace("54600", "7000"),
            "4 CONFIGURATION/INTERNAL/PORT: is 7000; the controller's firewall lets only ports 54600 to 54615 through",
        ),
        (
            received("<ELEMENT Tag=\"A/@B\" Type=\"AXIS\"/>"),
            "6 RECEIVE/XML/ELEMENT[A/@B]/@Type: is \"AXIS\"; valid: one of STRING, REAL, INT, BOOL, FRAME; send axes as",
        ),
        (
            received("<ELEMENT Tag=\"A/@B\" Type=\"FRAME\"/>"),
            "6 RECEIVE/XML/ELEMENT[A/@B]: is a FRAME in an attribute",
        ),
        (received("<ELEMENT Type=\"INT\"/>"), "6 RECEIVE/XML/ELEMENT: has no Tag"),
        (
            received("<ELEMENT Tag=\"/A/B\" Type=\"INT\"/>"),
            "6 RECEIVE/XML/ELEMENT[/A/B]/@Tag: is \"/A/B\"; write the path",
        ),
        (
            received("<ELEMENT Tag=\"A/B\" Type=\"INT\" type=\"REAL\"/>"),
            "6 RECEIVE/XML/ELEMENT[A/B]/@type: appears twice in one element",
        ),
        (
            received("<ELEMENT Tag=\"A/B\" Type=\"INT\"/>\n<ELEMENT Tag=\"A/B\" Type=\"REAL\"/>"),
            "7 RECEIVE/XML/ELEMENT[A/B]: is defined twice with different types (line 6)",
        ),
        (
            received("<ELEMENT Tag=\"A/B\" Type=\"INT\" Set_Flag=\"2\"/>"),
            "6 RECEIVE ELEMENT[A]: $FLAG[2] is also set by the arrival of A/B (line 6)",
        ),
        (
            received("<ELEMENT Tag=\"A/B\" Type=\"INT\" Set_Flag=\"1\"/>"),
            "6 RECEIVE ELEMENT[A/B]: $FLAG[1] is also set by a connection (line 4)",
        ),
        (
            file(INTERNAL, "<RAW><ELEMENT Tag=\"B\" Type=\"STREAM\" Set_Flag=\"3\"/></RAW>", ""),
            "6 RECEIVE/RAW/ELEMENT: is a STREAM without EOS",
        ),
        (
            file(INTERNAL, "<RAW><ELEMENT Tag=\"B\" Type=\"BYTE\"/></RAW>", ""),
            "6 RECEIVE/RAW/ELEMENT: is of type BYTE without",
        ),
        (
            file(
                INTERNAL,
                "<RAW><ELEMENT Tag=\"B\" Type=\"BYTE\" Size=\"9\"/></RAW>\n<XML><ELEMENT Tag=\"A\" Set_Flag=\"2\"/></XML>",
                "",
            ),
            "6 RECEIVE/RAW/ELEMENT: XML and RAW cannot be mixed",
        ),
        (
            file(INTERNAL, "<RAW><ELEMENT Type=\"BYTE\" Size=\"9\"/><ELEMENT Type=\"BYTE\" Size=\"9\"/></RAW>", ""),
            "6 RECEIVE/RAW/ELEMENT: a channel has at most one RAW element",
        ),
        (
            file(INTERNAL, "<RAW><ELEMENT Tag=\"B\" Type=\"STREAM\" EOS=\"13,256\"/></RAW>", ""),
            "6 RECEIVE/RAW/ELEMENT[B]/@EOS: is \"13,256\"",
        ),
    ];
    for (text, problem) in cases {
        expect(&text, &[problem], &[]);
    }
}

#[test]
fn a_file_without_a_channel_is_reported() {
    for (text, problem) in [
        ("", "1 : not XML: the file contains no element"),
        ("<ETHERNETKRL>\n<SEND>", "2 : not XML: SEND is never closed"),
        ("<ETHERNETKRL>\n</SEND>", "2 : not XML:"),
        ("<ETHERNETKRL/>\n<ETHERNETKRL/>", "2 : not XML: ETHERNETKRL follows the end"),
        ("; comment\n<ETHERNETKRL/>", "1 : not XML: \"; comment\" is outside"),
        ("<!DOCTYPE a>\n<ETHERNETKRL/>", "1 : not XML: a document type"),
        (
            "\n<Robot/>",
            "2 Robot: the root element is Robot; the root element of an EthernetKRL file is ETHERNETKRL",
        ),
        (
            "<Channel Version=\"1.0\"><Connection Protocol=\"TCP\"/></Channel>",
            "1 Channel: the file is a channel of EthernetKRL 6 (iiQKA.OS2)",
        ),
    ] {
        let report = expect(text, &[problem], &[]);
        assert_eq!(report.descriptions, Vec::<String>::new());
    }
    let deep = "<ETHERNETKRL>".to_owned() + &"<A>".repeat(100_000);
    expect(&deep, &["1 : not XML: elements are nested more than 32 levels deep"], &[]);
}

/// Unknown elements, names in other capitals, and comments as in a data list are read and reported.
#[test]
fn the_nearest_known_name_is_suggested_for_unknown_names() {
    let internal =
        format!("{INTERNAL}\n<BUFERING Limit=\"9\"/><SENDFLAG>1</SENDFLAG>\n<ENVIROMENT>Submit</ENVIROMENT>");
    expect(
        &file(&internal, "<XML><ELEMENT Tag=\"A\" Setflag=\"2\" Set_Flag=\"3\" Colour=\"x\"/></XML>", "")
            .replace("<EXTERNAL>", "<EXTERNAL><PROTOCOL>TCP</PROTOCOL>"),
        &[],
        &[
            "3 CONFIGURATION/EXTERNAL/PROTOCOL: no manual describes this element here; its place is \
             CONFIGURATION/INTERNAL/PROTOCOL; the controller ignores it",
            "5 CONFIGURATION/INTERNAL/BUFERING: no manual describes this element here; did you mean BUFFERING?",
            "5 CONFIGURATION/INTERNAL/SENDFLAG: no manual describes this element here; valid here: ENVIRONMENT, \
             BUFFERING,",
            "6 CONFIGURATION/INTERNAL/ENVIROMENT: no manual describes this element here; did you mean ENVIRONMENT?",
            "8 RECEIVE/XML/ELEMENT[A]/@Setflag: no manual describes this attribute; did you mean Set_Flag?",
            "8 RECEIVE/XML/ELEMENT[A]/@Colour: no manual describes this attribute; valid here: Tag, Type, Set_Flag, \
             Set_Out, Mode",
        ],
    );
    expect(
        &file(
            &INTERNAL.replace("ALIVE Set_Flag", "Alive SET_FLAG"),
            "<XML>;nothing\n<ELEMENT Tag=\"A\" Set_Flag=\"3\"/></XML>",
            "",
        ),
        &[],
        &[
            "4 CONFIGURATION/INTERNAL/ALIVE: found Alive, but the manual writes ALIVE",
            "4 CONFIGURATION/INTERNAL/ALIVE/@SET_FLAG: found SET_FLAG, but the manual writes Set_Flag",
            "6 RECEIVE/XML: the text \";nothing\" is not valid here",
        ],
    );
}

/// Elements over several lines, commented-out elements, a flag on a leaf, a repeated tag, a missing type.
#[test]
fn each_element_is_checked() {
    let receive = "<XML>\n<!-- <ELEMENT Tag=\"A/@Z\" Type=\"AXIS\"/> &lt;!&ndash; -->\n<ELEMENT Tag=\"A/@B\"\n  Type=\"STRING\"\n  \
                   Set_Flag=\"5\"/>\n<ELEMENT Tag=\"A/@C\"/>\n<ELEMENT Tag=\"A/@B\" Type=\"STRING\"/>\n\
                   <ELEMENT Tag=\"F/G\" Type=\"FRAME\" Mode=\"LIFO\"/><ELEMENT Tag=\"F/G/@X\" Type=\"REAL\"/>\n\
                   <ELEMENT Tag=\"F\" Set_Flag=\"1025\"/></XML>";
    let report = expect(
        &file(INTERNAL, receive, ""),
        &[],
        &[
            "8 RECEIVE/XML/ELEMENT[A]: no flag is set when a whole <A> has arrived: a message without A/@B does not \
             set the flag of this element",
            "11 RECEIVE/XML/ELEMENT[A/@C]: has neither Type nor flag nor output",
            "12 RECEIVE/XML/ELEMENT[A/@B]: is defined twice (line 8); both share one memory",
            "13 RECEIVE/XML/ELEMENT[F/G]/@Mode: reads the newest entry first",
            "13 RECEIVE/XML/ELEMENT[F/G]: is a FRAME, but F/G/@X (line 13) is defined as a part of this FRAME",
            "14 RECEIVE ELEMENT[F]: $FLAG ends at 1024",
        ],
    );
    let rises = "$FLAG[5] is set when A/@B has arrived; the program resets it".to_owned();
    assert!(report.descriptions.contains(&rises), "{:?}", report.descriptions);
}

/// The flag of an element with two child elements is set when both have arrived. It does not cover a further element
/// outside of that element.
#[test]
fn a_flag_of_an_element_with_all_data_is_enough() {
    let receive = "<XML><ELEMENT Tag=\"A/C/@N\" Type=\"INT\"/><ELEMENT Tag=\"A/C/P\" Type=\"FRAME\"/>\
                   <ELEMENT Tag=\"A/C\" Set_Flag=\"5\"/></XML>";
    let report = expect(&file(INTERNAL, receive, ""), &[], &[]);
    assert!(
        report.descriptions.contains(&"receives <A>: C/@N INT, C/P FRAME (X Y Z A B C)".to_owned()),
        "{:?}",
        report.descriptions
    );
    let rises = "$FLAG[5] is set when a whole <A/C> has arrived; the program resets it".to_owned();
    assert!(report.descriptions.contains(&rises), "{:?}", report.descriptions);
    let beside = receive.replace("<XML>", "<XML><ELEMENT Tag=\"A/@M\" Type=\"INT\"/>");
    expect(
        &file(INTERNAL, &beside, ""),
        &[],
        &["6 RECEIVE/XML/ELEMENT[A]: no flag is set when a whole <A> has arrived"],
    );
}

/// Records of bytes; a controller that connects as a client; two root elements to send, one with a text and an
/// attribute.
#[test]
fn other_kinds_of_channel_are_described() {
    let says = |text: &str| check_file("x/y\\B.xml", text).descriptions;
    let bytes =
        file(INTERNAL, "<RAW><ELEMENT Tag=\"Buffer\" Type=\"BYTE\" Set_Flag=\"3\" Size=\"256\"/></RAW>", "");
    let bytes = says(&bytes.replace("<SEND></SEND>", "<SEND/>"));
    assert!(bytes[0].starts_with("channel B: the controller listens"), "{bytes:?}");
    assert!(bytes.contains(&"receives records of bytes, size 256".to_owned()), "{bytes:?}");
    assert!(bytes.contains(&"has no elements to send; EKI_Send can send a plain text".to_owned()), "{bytes:?}");
    let send = "<XML><ELEMENT Tag=\"S/@VR\"/><ELEMENT Tag=\"R\" Type=\"INT\"/><ELEMENT Tag=\"S/T\"/><ELEMENT Tag=\"S/T/@U\" \
                Type=\"REAL\"/></XML>";
    let dials = file(INTERNAL, "", send)
        .replace("<TYPE>Client</TYPE>", "<TYPE>Server</TYPE><IP>192.168.1.2</IP><PORT>7000</PORT>");
    let dials = says(&dials);
    assert_eq!(
        dials[0],
        "channel B: the controller connects to 192.168.1.2, port 7000, TCP, and gives up after 2000 ms"
    );
    assert!(
        dials.ends_with(&[
            "sends <S>: @VR, T, T/@U REAL".to_owned(),
            "sends <R>: its text INT".to_owned(),
            "receives nothing".to_owned()
        ]),
        "{dials:?}"
    );
}

#[test]
fn files_of_one_controller_are_compared() {
    let other = file(INTERNAL, RECEIVE, "");
    let away = other.replace("54600", "54605").replace("Set_Flag=\"1\"", "Set_Flag=\"11\"");
    let reports = check_files(
        &[("a/ONE.xml", &other), ("cell.toml", ""), ("b/TWO.xml", &away), ("CELLCMD.xml", COMMANDS)],
        None,
    );
    assert_begins(
        &lines(&reports[0].problems),
        &[
            "4 CONFIGURATION/INTERNAL/PORT: is 54600, as in CELLCMD.xml; each channel needs its own port: while one of \
             the two is open, EKI_Open of the other fails",
            "6 RECEIVE ELEMENT[A]: $FLAG[2] is also set by the arrival of A in b/TWO.xml (line 6)",
        ],
        &other,
    );
    assert_begins(
        &lines(&reports[2].problems),
        &["6 RECEIVE ELEMENT[A]: $FLAG[2] is also set by the arrival of A in a/ONE.xml"],
        &away,
    );
    assert_begins(
        &lines(&reports[3].problems),
        &["13 CONFIGURATION/INTERNAL/PORT: is 54600, as in a/ONE.xml"],
        COMMANDS,
    );
    let reports = check_files(&[("a/ONE.xml", &away), ("b/one.XML", COMMANDS)], None);
    assert_begins(&lines(&reports[1].problems), &["1 : a/ONE.xml also defines the channel ONE"], COMMANDS);
}

/// The flag number 2,688, taken from a real project, is out of the manual's range; it is reported once.
#[test]
fn a_flag_number_out_of_range_is_reported_once() {
    let flags = |number: &str| {
        let receive = RECEIVE.replace("Set_Flag=\"2\"", &format!("Set_Flag=\"{number}\""));
        assert_ne!(receive, RECEIVE);
        let report = check_file("a.xml", &file(INTERNAL, &receive, ""));
        let about =
            |list: &[Problem]| lines(list).into_iter().filter(|line| line.contains("1025")).collect::<Vec<_>>();
        [about(&report.problems), about(&report.warnings)]
    };
    let [problems, warnings] = flags("2688");
    assert!(problems.len() == 1 && problems[0].contains("valid: a whole number 1 to 1025"), "{problems:?}");
    assert_eq!(warnings, Vec::<String>::new());
    let [problems, warnings] = flags("1025");
    assert_eq!((problems.len(), warnings.len()), (0, 1), "{warnings:?}");
    assert_eq!(flags("1024"), [Vec::<String>::new(), vec![]]);
}

/// One channel has an address in another network: the controller opens this channel on that adapter, or not at all.
#[test]
fn channels_at_two_addresses_are_reported() {
    let address = "<IP>172.31.1.147</IP>";
    assert!(COMMANDS.contains(address) && STATE.contains(address));
    let other = STATE.replace(address, "<IP>192.168.1.147</IP>");
    let told = |second: &str| {
        let reports = check_files(&[("CELLCMD.xml", COMMANDS), ("CELLSTAT.xml", second)], None);
        assert!(reports.iter().all(|report| report.problems.is_empty()), "{reports:?}");
        reports.into_iter().map(|report| lines(&report.warnings)).collect::<Vec<_>>()
    };
    assert_eq!(told(STATE), [Vec::<String>::new(), vec![]]);
    let [first, second] = &told(&other)[..] else { panic!("two files") };
    assert_eq!((first.len(), second.len()), (0, 1), "{second:?}");
    assert!(second[0].contains("CONFIGURATION/INTERNAL/IP: is 192.168.1.147, and CELLCMD.xml has 172.31.1.147"));
    // A controller that connects as a client states no address of its own in the file.
    let dials = other.replace("<TYPE>Client</TYPE>", "<TYPE>Server</TYPE><IP>172.31.1.10</IP><PORT>7000</PORT>");
    let reports = check_files(&[("CELLCMD.xml", COMMANDS), ("CELLSTAT.xml", &dials)], None);
    assert!(!lines(&reports[1].warnings).iter().any(|line| line.contains("has 172.31.1.147")), "{reports:?}");
}
