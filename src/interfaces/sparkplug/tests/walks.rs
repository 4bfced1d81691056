//! Random walks: for any sequence of events, the broker receives a valid Sparkplug session.

use super::super::*;
use super::{at, metric, node, published, values_in_state};
use proptest::prelude::*;
use prost::Message as _;

/// A step of a random walk.
#[derive(Debug, Clone)]
enum Step {
    Connect,
    Subscribed,
    Lose,
    See(u8),
    Host { online: bool, timestamp: u64 },
    Rebirth,
    Bytes(Vec<u8>),
    Leave,
}

/// Returns a random step: usually the next step of a connection without faults, so that the walk reaches birth and data
/// messages.
fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => Just(Step::Connect),
        3 => Just(Step::Subscribed),
        1 => Just(Step::Lose),
        8 => (0..4_u8).prop_map(Step::See),
        4 => (any::<bool>(), 0..20_u64).prop_map(|(online, timestamp)| Step::Host { online, timestamp }),
        2 => Just(Step::Rebirth),
        1 => proptest::collection::vec(any::<u8>(), 0..40).prop_map(Step::Bytes),
        1 => Just(Step::Leave),
    ]
}

/// The values that a host application collects from the messages of one connection.
#[derive(Default)]
struct Host {
    /// The connection number (`bdSeq`) in the will.
    bd_seq: u64,
    born: bool,
    seq: u64,
    values: Vec<Option<WireType>>,
}

impl Host {
    fn receive(&mut self, kind: &str, payload: &Payload) {
        match kind {
            "NBIRTH" => {
                assert_eq!(payload.seq, Some(0));
                assert_eq!(metric(payload, "bdSeq").value, Some(WireType::Long(self.bd_seq)));
                (self.born, self.seq) = (true, 0);
                self.values = METRICS.iter().map(|one| metric(payload, one.name).value.clone()).collect();
            }
            "NDATA" => {
                assert!(self.born, "data before a birth");
                self.seq = (self.seq + 1) % 256;
                assert_eq!(payload.seq, Some(self.seq));
                assert!(!payload.metrics.is_empty());
                for one in &payload.metrics {
                    let place = one.alias.expect("an alias") as usize - 1;
                    assert_ne!(self.values[place], one.value, "it did not change");
                    self.values[place].clone_from(&one.value);
                }
            }
            "NDEATH" => {
                assert!(self.born, "a death without a birth");
                assert_eq!((payload.seq, payload.metrics.len()), (None, 1));
                assert_eq!(metric(payload, "bdSeq").value, Some(WireType::Long(self.bd_seq)));
                self.born = false;
            }
            other => panic!("{other}"),
        }
    }
}

const STATES: [&str; 4] = ["stopped", "idle", "starting", "held"];

proptest! {
    #[test]
    fn the_broker_receives_a_valid_session(
        with_host in any::<bool>(),
        walk in proptest::collection::vec((step(), 0..800_u64), 1..120),
    ) {
        let mut node = node(with_host.then_some("scada"), true, true);
        let (mut host, mut ms, mut connected) = (Host::default(), 0, false);
        // The values that were last read, and whether the primary host has reported that it is online on this
        // connection.
        let (mut seen, mut online) = (None, false);
        for (step, passed) in walk {
            ms += passed;
            let ncmd = "spBv1.0/G/NCMD/cell";
            let rebirth = Metric {
                name: Some("Node Control/Rebirth".to_owned()),
                value: Some(WireType::Boolean(true)),
                ..Metric::default()
            };
            let bytes = match &step {
                Step::Host { online, timestamp } => {
                    format!("{{\"online\":{online},\"timestamp\":{timestamp}}}").into_bytes()
                }
                Step::Rebirth => Payload { timestamp: None, metrics: vec![rebirth], seq: None }.encode_to_vec(),
                Step::Bytes(bytes) => bytes.clone(),
                _ => vec![],
            };
            let payload = &bytes[..];
            let event = match &step {
                Step::Connect if connected => continue,
                Step::Connect => NodeEvent::Connecting,
                Step::Subscribed if !connected || node.has_published_birth() => continue,
                Step::Subscribed => NodeEvent::Subscribed,
                Step::Lose => NodeEvent::Lost,
                Step::See(state) => {
                    seen = Some(STATES[usize::from(*state)]);
                    NodeEvent::Seen(values_in_state(STATES[usize::from(*state)]))
                }
                Step::Host { .. } | Step::Rebirth | Step::Bytes(_) if !connected => continue,
                Step::Host { online: is_online, .. } => {
                    online |= *is_online;
                    NodeEvent::Received { topic: "spBv1.0/STATE/scada", payload, is_retained: false }
                }
                Step::Rebirth | Step::Bytes(_) => NodeEvent::Received { topic: ncmd, payload, is_retained: false },
                Step::Leave => NodeEvent::Leaving,
            };
            let begins = event == NodeEvent::Connecting;
            let ends = matches!(event, NodeEvent::Lost | NodeEvent::Leaving);
            let acts = node.step(event, at(ms));
            if begins {
                let will = Payload::decode(&*node.last_will(at(ms)).payload).expect("a payload");
                let Some(WireType::Long(bd_seq)) = metric(&will, "bdSeq").value else { panic!("{will:?}") };
                (host, connected, online) = (Host { bd_seq, ..Host::default() }, true, false);
            }
            for (kind, payload) in published(&acts) {
                prop_assert!(connected, "{kind} without a connection");
                prop_assert!(!with_host || online || kind == "NDEATH", "{kind} without its host");
                host.receive(&kind, &payload);
            }
            // After the values of the cell were read, the host application has all of them.
            if host.born && matches!(step, Step::See(_)) {
                let word = METRICS.iter().position(|one| one.name == "State/word").expect("it is there");
                let reported = host.values[word].clone();
                let lags = reported != seen.map(|state| WireType::Text(state.to_owned()));
                // Data messages are missing only while a rebirth is pending.
                prop_assert!(!lags || node.is_rebirth_pending());
            }
            if ends || acts.contains(&NodeAction::Disconnect) {
                (connected, host.born) = (false, false);
            }
        }
    }
}
