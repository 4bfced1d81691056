//! Tests a session, message by message.

use super::*;
use proptest::prelude::*;

fn session() -> Session {
    Session::new(SessionLimits {
        login: "ferba".to_owned(),
        id: 1040,
        period: Duration::from_millis(10),
        reply_within: Duration::from_millis(100),
        rest_set_point: ForceSetPoint::retracted(-20.0),
    })
}

fn live() -> Session {
    let mut session = session();
    assert_eq!(session.connected(Time::from_ms(0)), b"ferbak");
    session.received(b"ferbak", Time::from_ms(3));
    session
}

fn text(bytes: Option<Vec<u8>>) -> String {
    String::from_utf8(bytes.expect("a command")).expect("text")
}

fn lost(session: &Session) -> &LinkLossCause {
    let State::Lost(loss) = session.state() else { panic!("{:?}", session.state()) };
    loss
}

/// Calculated by hand: a command as soon as the session is logged in, the next command 10 ms after the last one;
/// the ramp is part of the command.
#[test]
fn one_command_a_period_and_each_is_answered() {
    let mut session = live();
    assert!(!session.is_receiving(), "nothing is read yet");
    assert_eq!(text(session.tick(Time::from_ms(3))), "1040 -20.00 -20.00 0.000 0.000 0k");
    assert_eq!(session.tick(Time::from_ms(5)), None, "one at a time");
    session.received(b"1040 -20.0 0.1", Time::from_ms(6));
    session.received(b" 0 0k", Time::from_ms(7));
    assert!(session.is_receiving());
    assert_eq!(session.last_reading().map(|(at, read)| (at, read.force_n)), Some((Time::from_ms(7), -20.0)));
    session.set_point_now(ForceSetPoint { force_n: 10.0, no_contact_n: 5.0, ramp_s: 0.06 }, Time::from_ms(8));
    assert_eq!((session.tick(Time::from_ms(12)), session.next_tick()), (None, Some(Time::from_ms(13))));
    assert_eq!(text(session.tick(Time::from_ms(38))), "1040 -5.00 5.00 0.000 0.000 0k");
}

#[test]
fn each_fault_ends_it_by_its_name() {
    let ends = |act: &dyn Fn(&mut Session)| {
        let mut session = live();
        session.tick(Time::from_ms(3));
        act(&mut session);
        lost(&session).to_string()
    };
    let says = |bytes: &'static [u8]| move |session: &mut Session| session.received(bytes, Time::from_ms(9));
    assert_eq!(ends(&|session| drop(session.tick(Time::from_ms(103)))), "the tool has not replied for 100 ms");
    assert!(ends(&says(b"1041 1 2 1 0k")).starts_with("tool id 1041 replied, but the request was for id 1040"));
    assert_eq!(
        ends(&says(b"hellok")),
        "the tool's reply is not valid: the reply has 1 fields instead of five: id, force, position, contact, error"
    );
    assert_eq!(ends(&says(b"1040 1 2 1 0k1040 1 2 1 0k")), "the tool sent data without a request");
    assert!(ends(&says(&[b'1'; 200])).contains("bytes without an end"));
    let mut session = session();
    session.connected(Time::from_ms(0));
    session.received(b"nok", Time::from_ms(1));
    assert!(lost(&session).to_string().contains("log-in text with \"n\""), "{:?}", lost(&session));
    session.connected(Time::from_ms(0));
    session.tick(Time::from_ms(1_000));
    assert_eq!(lost(&session), &LinkLossCause::Silent { ms: 1_000 });
}

/// A new connection forgets the previous set-point of the tool.
#[test]
fn a_new_connection_holds_the_tool_back() {
    let mut session = live();
    session.set_point_now(ForceSetPoint { force_n: 30.0, no_contact_n: 5.0, ramp_s: 0.0 }, Time::from_ms(4));
    session.end_session(LinkLossCause::Closed);
    session.connected(Time::from_ms(50));
    session.received(b"ferbak", Time::from_ms(60));
    assert_eq!(text(session.tick(Time::from_ms(60))), "1040 -20.00 -20.00 0.000 0.000 0k");
}

proptest! {
    /// Any bytes, in any pieces, never cause a panic, and the result does not depend on where they are cut.
    #[test]
    fn bytes_mean_the_same_however_they_are_cut(
        bytes in prop::collection::vec(prop_oneof![Just(b'k'), Just(b' '), b'0'..=b'9', any::<u8>()], 0..150),
        cut in 0_usize..150,
    ) {
        let (mut whole, mut parts) = (live(), live());
        whole.tick(Time::from_ms(3));
        parts.tick(Time::from_ms(3));
        whole.received(&bytes, Time::from_ms(5));
        let cut = cut.min(bytes.len());
        parts.received(&bytes[..cut], Time::from_ms(5));
        parts.received(&bytes[cut..], Time::from_ms(5));
        prop_assert_eq!(whole.state(), parts.state());
        prop_assert_eq!(whole.last_reading(), parts.last_reading());
    }
}
