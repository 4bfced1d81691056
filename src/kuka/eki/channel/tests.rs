use super::*;
use crate::eki::{CELLCMD, CELLSTAT};

/// Returns the smallest file with these lines inside `INTERNAL` and `RECEIVE/XML`, from lines 3 and 4.
fn file(internal: &str, received: &str) -> String {
    format!(
        "<ETHERNETKRL><CONFIGURATION>\n<EXTERNAL><TYPE>Client</TYPE></EXTERNAL>\n<INTERNAL>{internal}</INTERNAL>\n\
         </CONFIGURATION><RECEIVE><XML>{received}</XML></RECEIVE><SEND/></ETHERNETKRL>"
    )
}

#[test]
fn the_shipped_files_state_who_listens_where_and_what_travels() {
    let command = ChannelFile::parse(CELLCMD).expect("reads");
    assert_eq!((command.peer, command.port, command.environment), (PeerRole::Client, 54_600, Environment::Submit));
    assert_eq!(command.memory, Memory { order: ReadOrder::Fifo, entries: 512, bytes: 65_534 });
    assert_eq!(command.alive_flag, Some(850));
    let received: Vec<&str> = command.received.iter().map(|element| element.tag.as_str()).collect();
    assert_eq!(received[..3], ["Cmd/@Id", "Cmd/@Ep", "Cmd/@Op"]);
    assert_eq!(received[7..], ["Cmd/P", "Cmd"]);
    assert_eq!((command.received[7].kind, command.received[8].kind), (Some(Kind::Frame), None));
    assert_eq!((command.received[8].set_flag, command.received[8].line), (Some(851), 29));
    assert_eq!(command.sent.len(), 6);
    let state = ChannelFile::parse(CELLSTAT).expect("reads");
    assert_eq!((state.port, state.received.len(), state.sent.len()), (54_601, 5, 37));
    assert_eq!((command.unknown, state.unknown), (vec![], vec![]));
}

/// The manual's defaults apply if a file states nothing; if the controller connects, the port is that of the other
/// machine.
#[test]
fn what_a_file_does_not_state_is_the_manuals_default() {
    let silent = ChannelFile::parse(&file("", "")).expect("reads");
    assert_eq!(silent.memory, Memory { order: ReadOrder::Fifo, entries: 16, bytes: 16_384 });
    assert_eq!((silent.port, silent.environment, silent.protocol), (54_600, Environment::Program, Protocol::Tcp));
    let dials = "<ETHERNETKRL><CONFIGURATION><EXTERNAL><IP>192.168.1.2</IP><PORT>18735</PORT></EXTERNAL>\
                 <INTERNAL><IP>address.of.controller</IP><PORT>54605</PORT></INTERNAL></CONFIGURATION>\
                 <RECEIVE></RECEIVE></ETHERNETKRL>";
    let dials = ChannelFile::parse(dials).expect("reads");
    assert_eq!((dials.peer, dials.port, dials.address.as_deref()), (PeerRole::Server, 18_735, Some("192.168.1.2")));
}

#[test]
fn any_case_is_read_and_what_no_manual_names_is_kept() {
    let text =
        file("<buffering mode=\"lifo\" LIMIT=\"15\"/><Sendflag>1</Sendflag><ALIVE ElementName=\"x\"/>", ";text");
    let read = ChannelFile::parse(&text).expect("reads");
    assert_eq!((read.memory.order, read.memory.entries), (ReadOrder::Lifo, 15));
    let unknown: Vec<(usize, &str)> =
        read.unknown.iter().map(|unknown| (unknown.line, unknown.key.as_str())).collect();
    assert_eq!(
        unknown,
        [
            (3, "CONFIGURATION/INTERNAL/SENDFLAG"),
            (3, "CONFIGURATION/INTERNAL/ALIVE/@ElementName"),
            (4, "RECEIVE/XML")
        ]
    );
}

#[test]
fn what_the_controller_would_refuse_is_named_with_its_line() {
    let cases = [
        (
            file("<BUFFERING Limit=\"513\"/>", ""),
            "line 3: CONFIGURATION/INTERNAL/BUFFERING/@Limit: is \"513\"; valid: a whole number 1 to 512",
        ),
        (
            file("<PORT>abc</PORT>", ""),
            "line 3: CONFIGURATION/INTERNAL/PORT: is \"abc\"; valid: a whole number 1 to 65534",
        ),
        (
            file("<ENVIRONMENT>Robot</ENVIRONMENT>", ""),
            "line 3: CONFIGURATION/INTERNAL/ENVIRONMENT: is \"Robot\"; valid: one of Program, Submit, System",
        ),
        (
            file("", "<ELEMENT Tag=\"A/@B\" Type=\"AXIS\"/>"),
            "line 4: RECEIVE/XML/ELEMENT[A/@B]/@Type: is \"AXIS\"; valid: one of STRING, REAL, INT, BOOL, FRAME; send \
             axes as six REAL attributes or in a FRAME",
        ),
        (
            file("", "<ELEMENT Type=\"INT\"/>"),
            "line 4: RECEIVE/XML/ELEMENT: has no Tag; an element without this path transfers no data",
        ),
        (
            file("", "<ELEMENT Tag=\"/A\"/>"),
            "line 4: RECEIVE/XML/ELEMENT[/A]/@Tag: is \"/A\"; write the path as Root/Child or Root/Child/@Attribute",
        ),
        (
            file("", "<ELEMENT Tag=\"A\" tag=\"B\"/>"),
            "line 4: RECEIVE/XML/ELEMENT[A]/@tag: appears twice in one element",
        ),
        (
            "\n<EthernetKRL2></EthernetKRL2>".to_owned(),
            "line 2: EthernetKRL2: the root element is EthernetKRL2; the root element of an EthernetKRL file is \
             ETHERNETKRL",
        ),
        ("<ETHERNETKRL>\n<SEND>".to_owned(), "line 2: not XML: SEND is never closed"),
        (
            "<ETHERNETKRL><RECEIVE>\n<RAW><ELEMENT/></RAW></RECEIVE></ETHERNETKRL>".to_owned(),
            "line 2: found a RAW channel, which transfers bytes; this program supports only XML channels",
        ),
    ];
    for (text, verdict) in cases {
        let error = ChannelFile::parse(&text).expect_err(&text);
        assert_eq!(error.to_string(), verdict);
    }
    for text in ["", "<A", "<ETHERNETKRL></B>", "<!DOCTYPE a><ETHERNETKRL/>"] {
        assert!(ChannelFile::parse(text).is_err(), "{text}");
    }
}
