//! Fuzz tests at the level of bytes: valid streams with random damage from a seed.
//!
//! Framer and decoder must not panic, and their results must not depend on the positions at which the stream is cut. A
//! damaged document gives a value in range or an error that names the position. The controller continues, with its
//! channel open or closed.

use super::cell::{Blind, Cell, setup, wire};
use crate::fuzz::documents;
use panelprep::devices::mock::{self, Clock};
use panelprep::eki::{Channel, ClockMode, Report};
use panelprep::eki::{LinkLimits, MAX_DOCUMENT_BYTES, Session, Time};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STREAMS: u64 = 20_000;

/// The messages of the controller during two seconds of a path, by channel.
fn good_streams() -> [Vec<u8>; 2] {
    let mut controller = mock::Controller::new(setup(Clock::Free), Box::new(mock::UnconnectedWorld)).expect("fits");
    let ends = [mock::Channel::Command, mock::Channel::State];
    ends.iter().for_each(|&end| assert!(controller.connect(end)));
    controller.state_bytes(b"<Req Id=\"1\" Ep=\"0\" Op=\"12\" N1=\"1\"></Req>");
    controller.advance_ms(24);
    for id in 1..=40 {
        let command = format!(
            "<Cmd Id=\"{id}\" Ep=\"1\" Op=\"6\" N1=\"1\" N2=\"{}\" R1=\"0.000000\" R2=\"0.000000\"><P X=\"0.000000\" \
             Y=\"0.000000\" Z=\"0.000000\" A=\"0.000000\" B=\"0.000000\" C=\"0.000000\"></P></Cmd>",
            id % 2
        );
        controller.command_bytes(command.as_bytes());
    }
    controller.advance_ms(600);
    ends.map(|end| controller.take_output_bytes(end))
}

/// Damages a stream as real faults do: changed bits, changed bytes, gaps, repeated pieces, foreign pieces.
fn damage(stream: &[u8], draw: &mut Pcg64) -> Vec<u8> {
    const PIECES: [&[u8]; 16] = [
        b"<",
        b">",
        b"/",
        b"\"",
        b"'",
        b"&",
        b"\0",
        b"\xFF",
        b"<!--",
        b"<![CDATA[",
        b"<?",
        b"&lt;",
        b"<St>",
        b"</St>",
        b" A1=\"1\"",
        b"<a b=\"",
    ];
    let mut bytes = stream.to_vec();
    for _ in 0..draw.random_range(1..6) {
        let at = draw.random_range(0..bytes.len());
        let length = draw.random_range(1..40).min(bytes.len() - at);
        match draw.random_range(0..5) {
            0 => bytes[at] ^= 1 << draw.random_range(0..8),
            1 => bytes[at] = draw.random(),
            2 if bytes.len() > 2 * length => drop(bytes.drain(at..at + length)),
            3 => {
                let again = bytes[at..at + length].to_vec();
                bytes.splice(at..at, again);
            }
            _ => {
                let piece = PIECES[draw.random_range(0..PIECES.len())];
                bytes.splice(at..at, piece.iter().copied());
            }
        }
    }
    bytes
}

fn pieces<'a>(stream: &'a [u8], cuts: &[usize]) -> Vec<&'a [u8]> {
    let mut cuts = cuts.to_vec();
    cuts.extend([0, stream.len()]);
    cuts.sort_unstable();
    cuts.windows(2).map(|cut| &stream[cut[0]..cut[1]]).collect()
}

#[test]
fn damaged_streams_give_the_same_result_at_any_cut_and_no_panic() {
    let (streams, wire) = (good_streams(), wire());
    let (mut whole, mut broken, mut refused) = (0, 0, 0);
    for seed in 0..STREAMS {
        let mut draw = Pcg64::seed_from_u64(seed);
        let good = &streams[(seed % 2) as usize];
        let start = draw.random_range(0..good.len() / 2);
        let start = start + good[start..].iter().position(|&byte| byte == b'<').expect("a tag");
        let stream = damage(&good[start..(start + 1_200).min(good.len())], &mut draw);
        let cuts: Vec<usize> = (0..draw.random_range(0..6)).map(|_| draw.random_range(0..stream.len())).collect();
        let (found, error) = documents(&[&stream]);
        assert_eq!(documents(&pieces(&stream, &cuts)), (found.clone(), error.clone()), "seed {seed}");
        for document in &found {
            assert!(document.len() <= MAX_DOCUMENT_BYTES);
            let read = (wire.decode_ack(document).err(), wire.decode_state(document).err());
            match read {
                (None, None) => panic!("seed {seed}: both an acknowledgement and a state: {document}"),
                (Some(ack), Some(state)) => {
                    assert!(!ack.to_string().is_empty() && !state.to_string().is_empty());
                    refused += 1;
                }
                _ => whole += 1,
            }
        }
        broken += usize::from(error.is_some());
    }
    // Some documents survive the damage, and some do not.
    assert!(whole > 1_000 && broken > 1_000 && refused > 1_000, "{whole} {broken} {refused}");
}

/// With any damaged stream, the session ends its connection or continues; it never opens an epoch without a request.
#[test]
fn a_session_survives_any_stream() {
    let streams = good_streams();
    for seed in 0..STREAMS / 10 {
        let mut draw = Pcg64::seed_from_u64(seed);
        let mut session = Session::new(wire(), LinkLimits::default(), ClockMode::Wall);
        session.connected(Time::from_ms(0));
        session.push_state_bytes(&damage(&streams[1], &mut draw), Time::from_ms(1));
        session.push_command_bytes(&damage(&streams[0], &mut draw), Time::from_ms(1));
        session.time_passed(Time::from_ms(2));
        while let Some((channel, bytes)) = session.poll_transmit(Time::from_ms(2)) {
            assert!(channel == Channel::State && bytes.starts_with(b"<Req "), "seed {seed}");
        }
        let opened =
            std::iter::from_fn(|| session.poll_report()).any(|report| matches!(report, Report::EpochOpened { .. }));
        assert!(!opened && session.epoch().is_none(), "seed {seed}");
    }
}

/// Sends damaged commands to the controller: none of them moves the arm, and a correct client is served afterwards.
#[test]
fn a_controller_survives_any_stream() {
    let good = "<Cmd Id=\"1\" Ep=\"1\" Op=\"2\" N1=\"0\" N2=\"0\" R1=\"2.000000\" R2=\"0.000000\"><P X=\"1.000000\" Y=\"0.000000\" \
                Z=\"0.000000\" A=\"0.000000\" B=\"0.000000\" C=\"0.000000\"></P></Cmd>";
    for seed in 0..STREAMS / 20 {
        let mut draw = Pcg64::seed_from_u64(seed);
        let mut cell = Cell::new(setup(Clock::Free), LinkLimits::default(), seed);
        assert!(cell.until(1_000, |report| matches!(report, Report::Connected { .. })));
        let bytes = damage(good.repeat(4).as_bytes(), &mut draw);
        cell.controller.command_bytes(&bytes);
        cell.controller.state_bytes(&damage(b"<Req Id=\"2\" Ep=\"1\" Op=\"10\" N1=\"0\"></Req>", &mut draw));
        cell.run(200, &mut Blind);
        assert!(cell.executed().is_empty(), "seed {seed}: rubbish moved the arm");
    }
}

proptest! {
    /// Valid documents of each kind that are cut at any position give the same documents.
    #[test]
    fn any_split_of_a_stream_gives_the_same_documents(
        kinds in prop::collection::vec(0..3usize, 1..12),
        cuts in prop::collection::vec(0.0..1.0f64, 0..20),
    ) {
        let streams = good_streams();
        let first = |stream: &[u8], root: &str| documents(&[stream]).0.into_iter().find(|text| text.starts_with(root));
        let known = [first(&streams[0], "<Ack").expect("one"), first(&streams[1], "<St").expect("one"), "\r\n\0".to_owned()];
        let stream: String = kinds.iter().map(|&kind| known[kind].as_str()).collect();
        let expected: Vec<String> = kinds.iter().filter(|&&kind| kind < 2).map(|&kind| known[kind].clone()).collect();
        let cuts: Vec<usize> = cuts.iter().map(|place| (place * stream.len() as f64) as usize).collect();
        prop_assert_eq!(documents(&pieces(stream.as_bytes(), &cuts)), (expected, None));
    }
}
