//! Converts values to XML documents and back: the four kinds of message, with tags and their order from the EthernetKRL
//! files.
//!
//! `Cmd` and `Req` are sent, `Ack` and `St` are received. Numbers are written in the controller's own format, `%d` and
//! `%f`: six decimals, no exponent. A number that does not fit this format is refused when the command is queued.

use super::channel::ChannelFile;
use super::command::{Command, CommandError, CommandFields, Request};
use super::ids::{CommandId, Epoch};
use super::schema::{DecodeError, Field, Schema, SchemaError, integer_field, number_field};
use super::state::{ACK, Ack, STATE, State};

/// These ranges are not needed for encoding: a command is checked when it is queued, and a request contains only
/// counters.
const COMMAND: [Field; 13] = [
    integer_field("Cmd/@Id", 1, i32::MAX),
    integer_field("Cmd/@Ep", 1, i32::MAX),
    integer_field("Cmd/@Op", 1, 8),
    integer_field("Cmd/@N1", 0, i32::MAX),
    integer_field("Cmd/@N2", 0, i32::MAX),
    number_field("Cmd/@R1", f64::MAX),
    number_field("Cmd/@R2", f64::MAX),
    number_field("Cmd/P/@X", f64::MAX),
    number_field("Cmd/P/@Y", f64::MAX),
    number_field("Cmd/P/@Z", f64::MAX),
    number_field("Cmd/P/@A", f64::MAX),
    number_field("Cmd/P/@B", f64::MAX),
    number_field("Cmd/P/@C", f64::MAX),
];

const REQUEST: [Field; 4] = [
    integer_field("Req/@Id", 1, i32::MAX),
    integer_field("Req/@Ep", 0, i32::MAX),
    integer_field("Req/@Op", 9, 12),
    integer_field("Req/@N1", 0, i32::MAX),
];

/// The message formats of both channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Wire {
    command: Schema,
    ack: Schema,
    request: Schema,
    state: Schema,
}

impl Wire {
    /// Creates the message formats from the two channel files.
    ///
    /// # Errors
    /// If a file does not define a required tag, or defines a tag that this program does not know.
    pub fn new(command_channel: &ChannelFile, state_channel: &ChannelFile) -> Result<Self, SchemaError> {
        Ok(Wire {
            command: Schema::new(&command_channel.received, &COMMAND)?,
            ack: Schema::new(&command_channel.sent, &ACK)?,
            request: Schema::new(&state_channel.received, &REQUEST)?,
            state: Schema::new(&state_channel.sent, &STATE)?,
        })
    }

    /// Encodes a command; `to_come` is the number of points of the same path that follow.
    ///
    /// # Errors
    /// If a value is not finite or out of range, or the function cannot be sent on the command channel.
    pub fn encode_command(
        &self,
        id: CommandId,
        epoch: Epoch,
        command: &Command,
        to_come: u32,
    ) -> Result<Vec<u8>, CommandError> {
        let CommandFields { operation, n, r, p } = command.fields(to_come)?;
        let head = [f64::from(id.0), f64::from(epoch.0)].into_iter();
        let rest = [operation, n[0], n[1]].map(f64::from);
        let values: Vec<f64> = head.chain(rest).chain(r).chain(p).collect();
        Ok(self.command.encode(&values))
    }

    /// Encodes a request; `id` is the number of the request on this connection, from 1.
    pub fn encode_request(&self, id: u32, epoch: Epoch, request: &Request) -> Vec<u8> {
        let (operation, number) = match *request {
            Request::State => (9, 0),
            Request::Heartbeat { last_sent } => (10, last_sent),
            Request::Abort { next } => (11, next.0),
            Request::Reset { next } => (12, next.0),
            Request::Line { bits } => (13, bits),
        };
        self.request.encode(&[id, epoch.0, operation, number].map(f64::from))
    }

    /// Decodes an acknowledgement.
    ///
    /// # Errors
    /// If the document is not exactly one valid `Ack` element.
    pub fn decode_ack(&self, document: &str) -> Result<Ack, DecodeError> {
        Ack::from_values(&self.ack.decode(document)?).ok_or(DecodeError::Missing { field: "Ack" })
    }

    /// Decodes a state message.
    ///
    /// # Errors
    /// If the document is not exactly one valid `St` element.
    pub fn decode_state(&self, document: &str) -> Result<State, DecodeError> {
        State::from_values(&self.state.decode(document)?).ok_or(DecodeError::Missing { field: "St" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eki::fixture::{ACK as ACK_TEXT, STATE as STATE_TEXT, wire};
    use crate::eki::{
        CELLCMD, CELLSTAT, Kind, Mode, MoveJ, MoveLin, Refusal, SetAccSpeed, SetTcp, Signal, TcpKind,
    };
    use panelprep_base::geometry::{Joints, KukaPose};

    fn text(id: u32, epoch: u32, command: &Command, to_come: u32) -> String {
        let bytes = wire().encode_command(CommandId(id), Epoch(epoch), command, to_come).expect("a good command");
        String::from_utf8(bytes).expect("ASCII")
    }

    /// Compares the encoded bytes of the functions of Table 3.1, except the two that are never sent, with the expected
    /// text.
    #[test]
    fn commands_are_written_as_the_file_states() {
        let pose =
            KukaPose { x_mm: 1.0, y_mm: -2.5, z_mm: 0.000_000_4, a_deg: 90.0, b_deg: 1e-7, c_deg: -179.123_456_78 };
        let pose_text = "<P X=\"1.000000\" Y=\"-2.500000\" Z=\"0.000000\" A=\"90.000000\" B=\"0.000000\" C=\"-179.123457\"></P></Cmd>";
        let zero = "<P X=\"0.000000\" Y=\"0.000000\" Z=\"0.000000\" A=\"0.000000\" B=\"0.000000\" C=\"0.000000\"></P></Cmd>";
        let joints =
            Joints { a1_deg: 1.0, a2_deg: -90.0, a3_deg: 90.0, a4_deg: 0.0, a5_deg: 45.5, a6_deg: -185.25 };
        let speed = SetAccSpeed {
            speed_m_s: 0.05,
            acceleration_m_s2: 1.5,
            axis_speed_percent: 30,
            axis_acceleration_percent: 50,
        };
        let cases = [
            (
                Command::MoveLin(MoveLin { pose, blend_mm: 2.0, contact: true, speed_m_s: Some(0.06) }),
                format!("<Cmd Id=\"17\" Ep=\"3\" Op=\"2\" N1=\"12\" N2=\"1\" R1=\"2.000000\" R2=\"0.060000\">{pose_text}"),
            ),
            (
                Command::MoveJ(MoveJ { joints, axis_speed_percent: 20.0 }),
                "<Cmd Id=\"17\" Ep=\"3\" Op=\"1\" N1=\"0\" N2=\"0\" R1=\"20.000000\" R2=\"0.000000\"><P X=\"1.000000\" \
                 Y=\"-90.000000\" Z=\"90.000000\" A=\"0.000000\" B=\"45.500000\" C=\"-185.250000\"></P></Cmd>"
                    .to_owned(),
            ),
            (
                Command::SetBase(pose),
                format!("<Cmd Id=\"17\" Ep=\"3\" Op=\"3\" N1=\"0\" N2=\"0\" R1=\"0.000000\" R2=\"0.000000\">{pose_text}"),
            ),
            (
                Command::SetTcp(SetTcp { flange_from_tool: pose, kind: TcpKind::Sanding }),
                format!("<Cmd Id=\"17\" Ep=\"3\" Op=\"4\" N1=\"1\" N2=\"0\" R1=\"0.000000\" R2=\"0.000000\">{pose_text}"),
            ),
            (
                Command::SetAccSpeed(speed),
                format!("<Cmd Id=\"17\" Ep=\"3\" Op=\"5\" N1=\"30\" N2=\"50\" R1=\"0.050000\" R2=\"1.500000\">{zero}"),
            ),
            (
                Command::SetDigout(Signal { number: 7, on: true }),
                format!("<Cmd Id=\"17\" Ep=\"3\" Op=\"6\" N1=\"7\" N2=\"1\" R1=\"0.000000\" R2=\"0.000000\">{zero}"),
            ),
            (
                Command::CallSubroutine { index: 4 },
                format!("<Cmd Id=\"17\" Ep=\"3\" Op=\"8\" N1=\"4\" N2=\"0\" R1=\"0.000000\" R2=\"0.000000\">{zero}"),
            ),
        ];
        for (command, expected) in cases {
            assert_eq!(text(17, 3, &command, 12), expected, "{}", command.name());
        }
    }

    #[test]
    fn requests_are_written_as_the_file_states() {
        let cases = [
            (Request::State, "<Req Id=\"5\" Ep=\"3\" Op=\"9\" N1=\"0\"></Req>"),
            (Request::Heartbeat { last_sent: 17 }, "<Req Id=\"5\" Ep=\"3\" Op=\"10\" N1=\"17\"></Req>"),
            (Request::Line { bits: 34 }, "<Req Id=\"5\" Ep=\"3\" Op=\"13\" N1=\"34\"></Req>"),
            (Request::Abort { next: Epoch(4) }, "<Req Id=\"5\" Ep=\"3\" Op=\"11\" N1=\"4\"></Req>"),
            (Request::Reset { next: Epoch(4) }, "<Req Id=\"5\" Ep=\"3\" Op=\"12\" N1=\"4\"></Req>"),
        ];
        for (request, expected) in cases {
            assert_eq!(wire().encode_request(5, Epoch(3), &request), expected.as_bytes());
        }
    }

    #[test]
    fn each_number_of_a_state_is_read() {
        let state = wire().decode_state(STATE_TEXT).expect("a good state");
        assert_eq!((state.time_ms, state.sequence, state.answered, state.epoch), (1200, 7, 3, Epoch(2)));
        assert_eq!((state.boot, state.programs_checksum, state.mode), (77, -12_345, Mode::External));
        // 119 = 1 + 2 + 4 + 16 + 32 + 64: all flags except moving (8) and stopped (128).
        assert!(state.drives_on && state.guard_closed && state.motion_possible && state.base_set && state.tool_set);
        assert!(!state.emergency_stop && !state.moving && !state.stopped);
        assert_eq!((state.inputs, state.outputs, state.done, state.underruns), (5, 2, CommandId(17), 0));
        let joints = Joints {
            a1_deg: 4.999_516,
            a2_deg: -90.000_031,
            a3_deg: 90.0,
            a4_deg: 0.0,
            a5_deg: 45.5,
            a6_deg: -185.25,
        };
        assert_eq!(state.joints, joints);
        assert_eq!(state.base_from_tcp.c_deg, -179.959_747);
        assert_eq!((state.active_base.x_mm, state.active_base.a_deg), (400.0, 0.5));
        assert_eq!(state.flange_from_tool, KukaPose { z_mm: 120.0, ..KukaPose::default() });
    }

    /// Each bit sets its own flag and no other.
    #[test]
    fn each_flag_has_its_bit() {
        let read = |flags: u32| {
            let document = STATE_TEXT.replace("Flags=\"119\"", &format!("Flags=\"{flags}\""));
            let state = wire().decode_state(&document).expect("a good state");
            let possible =
                [state.drives_on, !state.emergency_stop, state.guard_closed, state.moving, state.motion_possible];
            [&possible[..], &[state.base_set, state.tool_set, state.stopped]].concat()
        };
        for bit in 0..8 {
            let expected: Vec<bool> = (0..8).map(|flag| flag == bit).collect();
            assert_eq!(read(1 << bit), expected, "bit {bit}");
        }
    }

    #[test]
    fn acknowledgements_are_read_and_refusals_have_names() {
        let ack = wire().decode_ack(ACK_TEXT).expect("a good acknowledgement");
        let expected =
            Ack { received: CommandId(20), done: CommandId(17), free: 97, refused: None, epoch: Epoch(2) };
        assert_eq!(ack, expected);
        let read = |error: u32| {
            let document = ACK_TEXT.replace("Err=\"0\" ErrId=\"0\"", &format!("Err=\"{error}\" ErrId=\"19\""));
            wire().decode_ack(&document).expect("a good acknowledgement").refused
        };
        assert_eq!(read(1), Some((CommandId(19), Refusal::IdGap)));
        assert_eq!(read(6), Some((CommandId(19), Refusal::FramesNotSet)));
        assert_eq!(read(10), Some((CommandId(19), Refusal::Stopped)));
    }

    /// Each line has one error in an otherwise valid document, and the expected message.
    #[test]
    fn faulty_acknowledgements_give_exact_errors() {
        let with = |old: &str, new: &str| {
            assert!(ACK_TEXT.contains(old), "{old}");
            ACK_TEXT.replace(old, new)
        };
        let range = "0 to 2147483647";
        let cases = [
            (with(" Free=\"97\"", ""), "Ack/@Free is missing".to_owned()),
            (with("Rx=\"20\"", ""), "Ack/@Rx is missing".into()),
            (with("Rx=\"20\"", "Rx=\"20\" Rx=\"20\""), "Ack/@Rx appears twice".into()),
            (with("Rx=\"20\"", "Rx=\"20\" Ry=\"1\""), "Ack/@Ry is not defined in the channel's file".into()),
            (with("Rx=", "rx="), "Ack/@rx is not defined in the channel's file".into()),
            (with("Rx=\"20\"", "Rx=\"\""), "Ack/@Rx is empty: it was not set on the controller".into()),
            (with("Rx=\"20\"", "Rx=\" 20\""), "Ack/@Rx is \" 20\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"+20\""), "Ack/@Rx is \"+20\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"20.0\""), "Ack/@Rx is \"20.0\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"2e1\""), "Ack/@Rx is \"2e1\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"0x14\""), "Ack/@Rx is \"0x14\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"TRUE\""), "Ack/@Rx is \"TRUE\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"-\""), "Ack/@Rx is \"-\", which is not a whole number".into()),
            (with("Rx=\"20\"", "Rx=\"-1\""), format!("Ack/@Rx is -1; the limits are {range}")),
            (with("Rx=\"20\"", "Rx=\"2147483648\""), format!("Ack/@Rx is 2147483648; the limits are {range}")),
            (
                with("Rx=\"20\"", "Rx=\"99999999999999999999\""),
                format!("Ack/@Rx is 100000000000000000000; the limits are {range}"),
            ),
            (with("Err=\"0\"", "Err=\"13\""), "Ack/@Err is 13; the limits are 0 to 12".into()),
            (with("<Ack ", "<St ").replace("</Ack>", "</St>"), "the document is <St>, expected <Ack>".into()),
            (with("</Ack>", "<A></A></Ack>"), "the element Ack/A is not defined in the channel's file".into()),
            (with("</Ack>", "x</Ack>"), "text inside <Ack>, which may contain only elements".into()),
            (with("</Ack>", "&lt;</Ack>"), "an entity inside <Ack>, which may contain only elements".into()),
            (with("</Ack>", "<!-- --></Ack>"), "a comment inside <Ack>, which may contain only elements".into()),
            (with("</Ack>", "<![CDATA[]]></Ack>"), "CDATA inside <Ack>, which may contain only elements".into()),
            (
                with("</Ack>", "<?x y?></Ack>"),
                "an instruction inside <Ack>, which may contain only elements".into(),
            ),
            (
                format!("<!DOCTYPE a>{ACK_TEXT}"),
                "a document type inside <>, which may contain only elements".into(),
            ),
            (format!("{ACK_TEXT}{ACK_TEXT}"), "a second root element, <Ack>, follows the first".into()),
            (String::new(), "Ack/@Rx is missing".into()),
        ];
        for (document, verdict) in cases {
            let error = wire().decode_ack(&document).expect_err(&document);
            assert_eq!(error.to_string(), verdict, "{document}");
        }
    }

    #[test]
    fn faulty_states_give_exact_errors() {
        let with = |old: &str, new: &str| {
            assert!(STATE_TEXT.contains(old), "{old}");
            STATE_TEXT.replacen(old, new, 1)
        };
        let number = |found: &str| format!("St/J/@A1 is \"{found}\", which is not a number such as -12.345678");
        let range = "the limits are -3600 to 3600";
        let a1 = |value: &str| with("A1=\"4.999516\"", &format!("A1=\"{value}\""));
        let joints_start = STATE_TEXT.find("<J ").expect("joints");
        let joints_end = STATE_TEXT.find("<Tcp").expect("tip");
        let joints = &STATE_TEXT[joints_start..joints_end];
        let cases = [
            (a1("nan"), number("nan")),
            (a1("NaN"), number("NaN")),
            (a1("-1.#IND00"), number("-1.#IND00")),
            (a1("inf"), number("inf")),
            (a1("-Infinity"), number("-Infinity")),
            (a1("1e400"), number("1e400")),
            (a1("1.0e+02"), number("1.0e+02")),
            (a1("4,999516"), number("4,999516")),
            (a1("4."), number("4.")),
            (a1(".5"), number(".5")),
            (a1("--4.0"), number("--4.0")),
            (a1("4.0.0"), number("4.0.0")),
            (a1("4.0 "), number("4.0 ")),
            (a1(""), "St/J/@A1 is empty: it was not set on the controller".to_owned()),
            (a1("3600.5"), format!("St/J/@A1 is 3600.5; {range}")),
            (a1("-3600.5"), format!("St/J/@A1 is -3600.5; {range}")),
            (
                with("Z=\"300.125000\"", "Z=\"100001.0\""),
                "St/Tcp/@Z is 100001; the limits are -100000 to 100000".into(),
            ),
            (with("Mode=\"4\"", "Mode=\"5\""), "St/@Mode is 5; the limits are 1 to 4".into()),
            (with("Mode=\"4\"", "Mode=\"0\""), "St/@Mode is 0; the limits are 1 to 4".into()),
            (with("Flags=\"119\"", "Flags=\"256\""), "St/@Flags is 256; the limits are 0 to 255".into()),
            (
                with("Boot=\"77\"", "Boot=\"-2147483649\""),
                "St/@Boot is -2147483649; the limits are -2147483648 to 2147483647".into(),
            ),
            (with(joints, ""), "St/J/@A1 is missing".into()),
            (with(joints, &format!("{joints}{joints}")), "the element St/J appears twice".into()),
            (with("<J ", "<J B1=\"0\" "), "St/J/@B1 is not defined in the channel's file".into()),
            (with("<J ", "<J X=\"0\" "), "St/J/@X is not defined in the channel's file".into()),
            (with("</J>", "<J></J></J>"), "the element St/J/J is not defined in the channel's file".into()),
            (with("</Tool>", "</Tool>stop"), "text inside <St>, which may contain only elements".into()),
            (ACK_TEXT.to_owned(), "the document is <Ack>, expected <St>".into()),
        ];
        for (document, verdict) in cases {
            let error = wire().decode_state(&document).expect_err(&document);
            assert_eq!(error.to_string(), verdict, "{document}");
        }
        for broken in
            [with("</J>", "</K>"), with("</St>", ""), with("A1=\"4.999516\"", "A1=4.9"), with("A1=\"4", "A1 \"4")]
        {
            let error = wire().decode_state(&broken).expect_err(&broken);
            assert!(matches!(error, DecodeError::NotXml { .. }), "{error}: {broken}");
        }
    }

    #[test]
    fn numbers_that_cannot_be_sent_are_refused_with_their_field() {
        let lin = |pose, blend_mm| Command::MoveLin(MoveLin { pose, blend_mm, contact: false, speed_m_s: None });
        let at = |x_mm| KukaPose { x_mm, ..KukaPose::default() };
        let speed = |speed_m_s, axis_speed_percent| {
            Command::SetAccSpeed(SetAccSpeed {
                speed_m_s,
                acceleration_m_s2: 1.0,
                axis_speed_percent,
                axis_acceleration_percent: 100,
            })
        };
        let cases = [
            (lin(at(f64::NAN), 0.0), "move_lin: X (mm) is NaN; the limits are -100000 to 100000"),
            (lin(at(f64::NEG_INFINITY), 0.0), "move_lin: X (mm) is -inf; the limits are -100000 to 100000"),
            (lin(at(0.0), -1.0), "move_lin: blend (mm) is -1; the limits are 0 to 1000"),
            (Command::SetBase(at(1e6)), "set_base: X (mm) is 1000000; the limits are -100000 to 100000"),
            (
                Command::MoveJ(MoveJ { joints: Joints::default(), axis_speed_percent: 0.0 }),
                "move_j: axis speed (%) is 0; the limits are 1 to 100",
            ),
            (speed(0.0, 50), "set_acc_speed: speed (m/s) is 0; the limits are 0.001 to 3"),
            (speed(0.1, 101), "set_acc_speed: axis speed (%) is 101; the limits are 1 to 100"),
            (
                Command::SetDigout(Signal { number: 4097, on: true }),
                "set_digout: output is 4097; the limits are 1 to 4096",
            ),
            (Command::CallSubroutine { index: 1001 }, "call_subroutine: index is 1001; the limits are 0 to 1000"),
            (Command::SetDigin(Signal { number: 0, on: true }), "set_digin: input is 0; the limits are 1 to 4096"),
        ];
        for (command, verdict) in cases {
            let error = wire().encode_command(CommandId(1), Epoch(1), &command, 0).expect_err(verdict);
            assert_eq!(error.to_string(), verdict);
        }
    }

    /// Tags and order come only from the channel's file: if the order in the file changes, the order in the message
    /// changes, and a missing tag is an error.
    #[test]
    fn tags_and_order_come_from_the_file() {
        let state = ChannelFile::parse(CELLSTAT).expect("reads");
        let with = |from: &str, to: &str| {
            assert!(CELLCMD.contains(from), "{from}");
            let file = ChannelFile::parse(&CELLCMD.replace(from, to)).expect("reads");
            Wire::new(&file, &state)
        };
        let swapped = "<ELEMENT Tag=\"Cmd/@Ep\" Type=\"INT\"/>\n      <ELEMENT Tag=\"Cmd/@Id\" Type=\"INT\"/>";
        let swapped =
            with("<ELEMENT Tag=\"Cmd/@Id\" Type=\"INT\"/>\n      <ELEMENT Tag=\"Cmd/@Ep\" Type=\"INT\"/>", swapped);
        let call = Command::CallSubroutine { index: 4 };
        let bytes = swapped.expect("fits").encode_command(CommandId(9), Epoch(3), &call, 0).expect("good");
        assert!(bytes.starts_with(b"<Cmd Ep=\"3\" Id=\"9\" Op=\"8\""));

        let free = "<ELEMENT Tag=\"Ack/@Free\" Type=\"INT\"/>";
        assert_eq!(with(free, ""), Err(SchemaError::Missing { tag: "Ack/@Free" }));
        let unknown = SchemaError::Unknown { line: 37, tag: "Ack/@Fee".to_owned() };
        assert_eq!(with("Ack/@Free", "Ack/@Fee"), Err(unknown));
        let twice = SchemaError::Twice { line: 38, tag: "Ack/@Free".to_owned() };
        assert_eq!(with(free, &format!("{free}\n{free}")), Err(twice));
        let wrong_type =
            SchemaError::Type { line: 37, tag: "Ack/@Free".to_owned(), needed: "INT", found: Kind::Real };
        assert_eq!(with(free, &free.replace("INT", "REAL")), Err(wrong_type));
        // Six REAL attributes are encoded to the same bytes as a FRAME.
        let six = ["X", "Y", "Z", "A", "B", "C"]
            .map(|name| format!("<ELEMENT Tag=\"Cmd/P/@{name}\" Type=\"REAL\"/>"))
            .concat();
        let six = with("<ELEMENT Tag=\"Cmd/P\" Type=\"FRAME\"/>", &six).expect("fits");
        assert_eq!(six, wire());
    }
}
