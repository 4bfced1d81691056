//! Tests of the node without a broker, message by message.

mod commanded;
mod walks;

use super::metrics::unit_mode;
use super::*;
use panelprep_cell::cycle::{At, Hold, Phase, Robot, State, Why};
use prost::Message as _;
use std::collections::BTreeSet;

/// Creates a node of the group G.
fn node(primary_host: Option<&str>, commands_allowed: bool, aliases: bool) -> EdgeNode {
    let ids = CellIds {
        group_id: "G".to_owned(),
        edge_node_id: "cell".to_owned(),
        primary_host_id: primary_host.map(str::to_owned),
    };
    EdgeNode::new(NodeSetup { ids, commands_allowed, aliases })
}

/// Returns this time for both the wall clock and the monotonic clock.
fn at(ms: u64) -> NodeTime {
    NodeTime { unix_ms: 1_700_000_000_000 + ms, steady_ms: ms }
}

/// Returns the values of a cell in this state.
fn values_in_state(state: &str) -> Vec<Value> {
    let hold = Hold { why: Why::Asked, resume: Phase::Locate };
    let at = [At::Stopped, At::Idle, At::Starting, At::Held(hold)]
        .into_iter()
        .find(|at| at.keyword() == state)
        .expect("a state");
    let now = LoopView { table: Some(State { at, ..State::INITIAL }), ..LoopView::default() };
    values(&CellView { now, ..CellView::default() })
}

/// Returns the messages that these actions publish, each with the message type in its topic.
fn published(acts: &[NodeAction]) -> Vec<(String, Payload)> {
    let message = |act: &NodeAction| match act {
        NodeAction::Publish(message) => {
            let kind = message.topic.split('/').nth(2).expect("a kind").to_owned();
            assert_eq!(message.qos, u8::from(kind == "NDEATH"), "{}", message.topic);
            Some((kind, Payload::decode(&*message.payload).expect("a payload")))
        }
        _ => None,
    };
    acts.iter().filter_map(message).collect()
}

/// Creates a node that is connected and has published its birth message.
fn node_after_birth(commands_allowed: bool) -> EdgeNode {
    let mut node = node(None, commands_allowed, true);
    node.step(NodeEvent::Connecting, at(0));
    node.step(NodeEvent::Seen(values_in_state("idle")), at(0));
    assert_eq!(published(&node.step(NodeEvent::Subscribed, at(0))).len(), 1);
    node
}

fn metric<'p>(payload: &'p Payload, name: &str) -> &'p Metric {
    payload.metrics.iter().find(|metric| metric.name.as_deref() == Some(name)).expect("it is there")
}

/// Expected bytes, encoded by hand according to the protobuf definition of the specification: the time (08) 1 700 000
/// 000 000 is 80 D0 95 FF BC 31 as a varint; a metric (12) has a name (0A), a time (18), the data type 4 (20 04) and
/// the long value 0 (58 00).
#[test]
fn a_death_has_the_bytes_of_the_specification() {
    let mut node = node(None, false, true);
    node.step(NodeEvent::Connecting, at(0));
    let will = node.last_will(at(0));
    let time = [0x80, 0xd0, 0x95, 0xff, 0xbc, 0x31];
    let metric = [&[0x0a, 5][..], b"bdSeq", &[0x18], &time, &[0x20, 4, 0x58, 0]].concat();
    let bytes = [&[0x08][..], &time, &[0x12, metric.len() as u8], &metric].concat();
    assert_eq!((will.topic.as_str(), will.qos, will.payload), ("spBv1.0/G/NDEATH/cell", 1, bytes));
}

/// Every metric has a name, a data type, a time, and either a value or the flag for no value. All aliases are
/// different; the rebirth has no alias.
#[test]
fn a_birth_contains_every_metric() {
    for (aliases, commands_allowed) in [(true, true), (true, false), (false, true)] {
        let mut node = node(None, commands_allowed, aliases);
        node.step(NodeEvent::Connecting, at(0));
        node.step(NodeEvent::Subscribed, at(1));
        let acts = node.step(NodeEvent::Seen(values_in_state("held")), at(2));
        let [NodeAction::Publish(message)] = &acts[..] else { panic!("{acts:?}") };
        assert_eq!(message.topic, "spBv1.0/G/NBIRTH/cell");
        let (_, payload) = &published(&acts)[0];
        assert_eq!((payload.seq, payload.timestamp), (Some(0), Some(at(2).unix_ms)));
        let written = if commands_allowed { 4 } else { 1 };
        assert_eq!(payload.metrics.len(), 1 + written + METRICS.len());
        for metric in &payload.metrics {
            assert!(metric.name.is_some() && metric.datatype.is_some(), "{metric:?}");
            assert_eq!(metric.timestamp, Some(at(2).unix_ms));
            assert_eq!(metric.value.is_none(), metric.is_null == Some(true), "{metric:?}");
        }
        let numbers: Vec<u64> = payload.metrics.iter().filter_map(|metric| metric.alias).collect();
        let all = if aliases { payload.metrics.len() - 2 } else { 0 };
        assert_eq!((numbers.len(), numbers.iter().collect::<BTreeSet<_>>().len()), (all, all));
        let rebirth = metric(payload, "Node Control/Rebirth");
        assert_eq!((rebirth.alias, &rebirth.value), (None, &Some(WireType::Boolean(false))));
        assert_eq!(rebirth.datatype, Some(11));
        let bd_seq = metric(payload, "bdSeq");
        assert_eq!((bd_seq.datatype, &bd_seq.value), (Some(4), &Some(WireType::Long(0))));
        assert_eq!(metric(payload, "State/number").value, Some(WireType::Long(11)));
        assert_eq!(metric(payload, "State/word").value, Some(WireType::Text("held".to_owned())));
        assert_eq!(metric(payload, "Cycle/panel").is_null, Some(true), "there was none");
    }
}

/// A data message contains only changed values, each with its alias and without a name. Without a change there is no
/// message.
#[test]
fn data_messages_contain_only_changes() {
    let mut node = node_after_birth(false);
    assert_eq!(node.step(NodeEvent::Seen(values_in_state("idle")), at(10)), []);
    let acts = node.step(NodeEvent::Seen(values_in_state("starting")), at(20));
    let (kind, payload) = &published(&acts)[0];
    assert_eq!((kind.as_str(), payload.seq, payload.timestamp), ("NDATA", Some(1), Some(at(20).unix_ms)));
    let told: Vec<_> = payload.metrics.iter().map(|one| (one.alias, one.value.clone())).collect();
    let expected = [(Some(2), Some(WireType::Long(3))), (Some(3), Some(WireType::Text("starting".to_owned())))];
    assert_eq!(told, expected);
    for one in &payload.metrics {
        assert_eq!((&one.name, one.datatype, one.timestamp), (&None, None, Some(at(20).unix_ms)));
    }
    let acts = node.step(NodeEvent::Seen(values(&CellView::default())), at(30));
    let (_, payload) = &published(&acts)[0];
    assert!(payload.metrics.iter().all(|one| one.is_null == Some(true) && one.value.is_none()), "{payload:?}");
}

/// Without aliases, data messages contain names and data types.
#[test]
fn without_aliases_data_contain_names_and_types() {
    let mut node = node(None, false, false);
    node.step(NodeEvent::Connecting, at(0));
    node.step(NodeEvent::Subscribed, at(0));
    node.step(NodeEvent::Seen(values_in_state("idle")), at(0));
    let acts = node.step(NodeEvent::Seen(values_in_state("held")), at(1));
    let (_, payload) = &published(&acts)[0];
    assert_eq!(metric(payload, "State/number").datatype, Some(4));
    assert!(payload.metrics.iter().all(|one| one.alias.is_none()));
}

/// The number of the connection and the sequence number of the messages continue with 0 after 255. Each birth message
/// has the sequence number 0.
#[test]
fn numbers_continue_at_0_after_255() {
    let mut node = node(None, false, true);
    for connection in 0..300_u64 {
        node.step(NodeEvent::Connecting, at(connection));
        let will = Payload::decode(&*node.last_will(at(0)).payload).expect("a payload");
        assert_eq!((will.metrics.len(), will.seq), (1, None));
        assert_eq!(metric(&will, "bdSeq").value, Some(WireType::Long(connection % 256)));
        node.step(NodeEvent::Seen(values_in_state("idle")), at(connection));
        let acts = node.step(NodeEvent::Subscribed, at(connection));
        let (_, birth) = &published(&acts)[0];
        assert_eq!(metric(birth, "bdSeq").value, Some(WireType::Long(connection % 256)));
        assert_eq!(birth.seq, Some(0));
        node.step(NodeEvent::Lost, at(connection));
        assert_eq!(node.step(NodeEvent::Seen(values_in_state("held")), at(connection)), [], "nothing is sent");
    }
    let mut node = node_after_birth(false);
    for message in 1..600_u64 {
        let state = if message % 2 == 0 { "idle" } else { "held" };
        let acts = node.step(NodeEvent::Seen(values_in_state(state)), at(message));
        assert_eq!(published(&acts)[0].1.seq, Some(message % 256));
    }
}

/// At the end of a session the node publishes its death message, with the connection number of its birth messages.
#[test]
fn the_node_ends_its_session_with_its_death() {
    let mut node = node_after_birth(false);
    let acts = node.step(NodeEvent::Leaving, at(5));
    assert_eq!(acts.last(), Some(&NodeAction::Disconnect));
    let [(kind, payload)] = &published(&acts)[..] else { panic!("{acts:?}") };
    assert_eq!((kind.as_str(), payload.seq), ("NDEATH", None));
    assert_eq!(metric(payload, "bdSeq").value, Some(WireType::Long(0)));
    let mut unborn = self::node(None, false, true);
    unborn.step(NodeEvent::Connecting, at(0));
    assert_eq!(
        unborn.step(NodeEvent::Leaving, at(1)),
        [NodeAction::Disconnect],
        "what was never born does not die"
    );
}

fn host_statement(node: &mut EdgeNode, text: &str, ms: u64) -> Vec<NodeAction> {
    let payload = text.as_bytes();
    node.step(NodeEvent::Received { topic: "spBv1.0/STATE/scada", payload, is_retained: true }, at(ms))
}

/// Nothing is published before the primary host is online. If the host goes offline, the node publishes its death
/// message and connects again. A STATE message of an earlier connection of the host has no effect.
#[test]
fn nothing_is_published_while_the_primary_host_is_offline() {
    let mut node = node(Some("scada"), false, true);
    assert_eq!(node.subscriptions(), ["spBv1.0/G/NCMD/cell", "spBv1.0/STATE/scada"]);
    node.step(NodeEvent::Connecting, at(0));
    node.step(NodeEvent::Seen(values_in_state("idle")), at(0));
    assert_eq!(node.step(NodeEvent::Subscribed, at(0)), []);
    let other = NodeEvent::Received {
        topic: "spBv1.0/STATE/other",
        payload: br#"{"online":true,"timestamp":9}"#,
        is_retained: true,
    };
    assert_eq!(published(&node.step(other, at(1))), [], "another host");
    assert_eq!(host_statement(&mut node, r#"{"online":false,"timestamp":100}"#, 2), []);
    assert_eq!(host_statement(&mut node, r#"{"online":true,"timestamp":99}"#, 3), [], "older than what was heard");
    let acts = host_statement(&mut node, r#"{"online":true,"timestamp":100,"more":1}"#, 4);
    assert_eq!(published(&acts)[0].0, "NBIRTH");
    assert_eq!(host_statement(&mut node, r#"{"online":false,"timestamp":99}"#, 5), [], "of an earlier connection");
    assert!(node.has_published_birth());
    let acts = host_statement(&mut node, r#"{"online":false,"timestamp":100}"#, 6);
    assert_eq!((published(&acts)[0].0.as_str(), acts.last()), ("NDEATH", Some(&NodeAction::Disconnect)));
    assert_eq!(node.step(NodeEvent::Seen(values_in_state("held")), at(7)), []);
    node.step(NodeEvent::Lost, at(8));

    node.step(NodeEvent::Connecting, at(9));
    assert_eq!(
        node.step(NodeEvent::Subscribed, at(10)),
        [],
        "the host is not known to be online at this connection"
    );
    assert_eq!(host_statement(&mut node, r#"{"online":true,"timestamp":50}"#, 11), []);
    let acts = host_statement(&mut node, r#"{"online":true,"timestamp":200}"#, 12);
    let (kind, birth) = &published(&acts)[0];
    assert_eq!((kind.as_str(), &metric(birth, "bdSeq").value), ("NBIRTH", &Some(WireType::Long(1))));
}

#[test]
fn an_invalid_host_state_is_refused() {
    for text in
        ["", "ONLINE", "{}", r#"{"online":1,"timestamp":2}"#, r#"{"online":true,"timestamp":-1}"#, "[true,2"]
    {
        assert_eq!(HostState::read(text.as_bytes()), None, "{text}");
        let mut node = node(Some("scada"), false, true);
        node.step(NodeEvent::Connecting, at(0));
        node.step(NodeEvent::Subscribed, at(0));
        node.step(NodeEvent::Seen(values_in_state("idle")), at(0));
        let acts = host_statement(&mut node, text, 1);
        let [NodeAction::Note(note)] = &acts[..] else { panic!("{acts:?}") };
        assert!(note.refused.as_ref().is_some_and(|why| why.contains("\"timestamp\"")), "{note:?}");
    }
}

/// All names are different even without upper and lower case, and none is the name of a command or of the connection
/// number.
#[test]
fn metric_names_are_unique() {
    let names: Vec<_> = METRICS.iter().map(|one| one.name.to_lowercase()).collect();
    assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len());
    assert!(names.iter().all(|name| !name.starts_with("node control/") && name != "bdseq"));
    assert_eq!(values(&CellView::default()).len(), METRICS.len());
}

/// The numbers of the states are those of `packml`, whose own tests check all of them.
#[test]
fn state_and_mode_are_reported_by_number_and_word() {
    let mut state = State { at: At::Idle, ..State::INITIAL };
    state.facts.robot = Robot::Ready;
    let told = |state: State| {
        let now = LoopView { table: Some(state), ..LoopView::default() };
        let all = values(&CellView { now, ..CellView::default() });
        ["State/number", "State/word", "Mode/number", "Mode/word"]
            .map(|name| all[METRICS.iter().position(|one| one.name == name).expect("it is there")].clone())
    };
    let text = |word: &str| Value::Text(word.to_owned());
    assert_eq!(told(state), [Value::Whole(4), text("idle"), Value::Whole(1), text("production")]);
    (state.job.running, state.job.air) = (true, true);
    assert_eq!(told(state)[2..], [Value::Whole(2), text("maintenance")]);
    state.facts.robot = Robot::NotAutomatic;
    assert_eq!(told(state)[2..], [Value::Whole(3), text("manual")]);
}

#[test]
fn the_mode_is_null_without_reports_of_the_robot() {
    let heard = |robot: Robot| {
        let mut state = State::INITIAL;
        state.facts.robot = robot;
        unit_mode(&LoopView { table: Some(state), ..LoopView::default() })
    };
    assert_eq!([heard(Robot::LinkLost), heard(Robot::Unknown), unit_mode(&LoopView::default())], [None; 3]);
}

/// NaN is published as null.
#[test]
fn a_number_that_is_not_finite_is_null() {
    let kept = StoreView { disc_worn_mm2: Some(f64::NAN), free_mb: Some(1_799), ..StoreView::default() };
    let all = values(&CellView { kept, ..CellView::default() });
    let of = |name: &str| &all[METRICS.iter().position(|one| one.name == name).expect("it is there")];
    assert_eq!((of("Disc/worn_mm2"), of("Disk/free_MB")), (&Value::Null, &Value::Whole(1_700)));
}
