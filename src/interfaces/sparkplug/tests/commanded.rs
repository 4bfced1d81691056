//! Tests of commands: accepted commands, refused commands, and a flood of commands.

use super::super::*;
use super::{at, node_after_birth, published, values_in_state};
use prost::Message as _;

/// Returns a command message that writes this value to a metric.
fn written(name: Option<&str>, alias: Option<u64>, value: Option<WireType>) -> Vec<u8> {
    let metric = Metric { name: name.map(str::to_owned), alias, value, ..Metric::default() };
    Payload { timestamp: Some(5), metrics: vec![metric], seq: None }.encode_to_vec()
}

fn write_true(name: &str) -> Vec<u8> {
    written(Some(name), None, Some(WireType::Boolean(true)))
}

fn send_command(node: &mut EdgeNode, payload: &[u8], ms: u64) -> Vec<NodeAction> {
    node.step(NodeEvent::Received { topic: "spBv1.0/G/NCMD/cell", payload, is_retained: false }, at(ms))
}

fn refusal(acts: &[NodeAction]) -> String {
    let [NodeAction::Note(AuditNote { refused: Some(why), .. })] = acts else { panic!("{acts:?}") };
    why.clone()
}

/// Each command is accepted with its name, with its alias and with both. There is no start command.
#[test]
fn allowed_commands_are_requested() {
    for (command, alias) in [(NodeCommand::Hold, 1_001), (NodeCommand::Stop, 1_002), (NodeCommand::Abort, 1_003)] {
        let (name, yes) = (command.name(), Some(WireType::Boolean(true)));
        for (name, alias) in [(Some(name), None), (None, Some(alias)), (Some(name), Some(alias))] {
            let acts = send_command(&mut node_after_birth(true), &written(name, alias, yes.clone()), 1);
            assert_eq!(acts, [NodeAction::Ask { command, is_noted: true }]);
        }
        let why = refusal(&send_command(&mut node_after_birth(false), &self::write_true(name), 1));
        assert!(why.contains("is not permitted by [sparkplug] commands") && why.contains(name), "{why}");
    }
    for name in ["Node Control/Start", "Node Control/Reset", "Node Control/Clear", "Node Control/Unhold", "Start"] {
        let why = refusal(&send_command(&mut node_after_birth(true), &write_true(name), 1));
        assert!(why.contains("valid: Node Control/Rebirth, Node Control/Hold"), "{why}");
    }
}

#[test]
fn a_rebirth_publishes_all_values_under_the_same_number() {
    let mut node = node_after_birth(false);
    node.step(NodeEvent::Seen(values_in_state("held")), at(10));
    let acts = send_command(&mut node, &write_true("Node Control/Rebirth"), 20);
    let [(kind, birth)] = &published(&acts)[..] else { panic!("{acts:?}") };
    assert_eq!((kind.as_str(), birth.seq), ("NBIRTH", Some(0)));
    assert!(birth.metrics.iter().any(|one| one.value == Some(WireType::Text("held".to_owned()))));
    assert!(
        matches!(&acts[1], NodeAction::Note(AuditNote { what, refused: None, .. }) if what == "rebirth"),
        "{acts:?}"
    );

    // A second rebirth immediately afterwards is delayed, and no data message is published before it.
    assert_eq!(send_command(&mut node, &write_true("Node Control/Rebirth"), 30), []);
    assert_eq!(node.step(NodeEvent::Seen(values_in_state("idle")), at(500)), []);
    let acts = node.step(NodeEvent::Seen(values_in_state("idle")), at(1_020));
    assert_eq!(published(&acts).iter().map(|(kind, _)| kind.as_str()).collect::<Vec<_>>(), ["NBIRTH"]);
    let acts = node.step(NodeEvent::Seen(values_in_state("held")), at(1_500));
    assert_eq!(published(&acts)[0].1.seq, Some(1), "and on it goes");
}

/// All other messages have no effect, and the audit trail records the reason.
#[test]
fn other_messages_are_refused() {
    let stop = NodeCommand::Stop.name();
    let null = Metric {
        name: Some(stop.to_owned()),
        is_null: Some(true),
        value: Some(WireType::Boolean(true)),
        ..Metric::default()
    };
    let of = |metrics| Payload { timestamp: None, metrics, seq: None }.encode_to_vec();
    let cases: [(Vec<u8>, &str); 12] = [
        (vec![], "no metric"),
        (b"stop".to_vec(), "not a Sparkplug B payload"),
        (vec![0xff; 40], "not a Sparkplug B payload"),
        (of(vec![Metric::default(); 33]), "has 33 metrics (limit 32)"),
        (of(vec![Metric::default()]), "without a name or an alias"),
        (of(vec![null]), "valid: the Boolean true"),
        (written(Some(stop), None, Some(WireType::Boolean(false))), "valid: the Boolean true"),
        (written(Some(stop), None, Some(WireType::Int(1))), "valid: the Boolean true"),
        (written(Some(stop), None, None), "valid: the Boolean true"),
        (written(Some(stop), Some(1_001), Some(WireType::Boolean(true))), "cannot be written; valid"),
        (written(None, Some(2), Some(WireType::Boolean(true))), "\"State/number\", which is read-only"),
        (written(None, Some(999), Some(WireType::Boolean(true))), "with the alias 999"),
    ];
    for (payload, words) in cases {
        let why = refusal(&send_command(&mut node_after_birth(true), &payload, 1));
        assert!(why.contains(words), "{words}: {why}");
    }
    let long = "\u{1b}[31m".repeat(1_000);
    let why = refusal(&send_command(&mut node_after_birth(true), &write_true(&long), 1));
    assert!(why.len() < 1_000 && !why.contains('\u{1b}'), "{why}");
}

/// A retained command may be a day old. The other topics are not subscribed to: only a faulty broker sends messages on
/// them.
#[test]
fn retained_commands_and_other_topics_are_refused() {
    let payload = write_true(NodeCommand::Stop.name());
    let topic = "spBv1.0/G/NCMD/cell";
    let acts =
        node_after_birth(true).step(NodeEvent::Received { topic, payload: &payload, is_retained: true }, at(1));
    assert!(refusal(&acts).contains("its age is unknown"));
    for topic in
        ["spBv1.0/G/NCMD/other", "spBv1.0/G/DCMD/cell/x", "spBv1.0/G/NBIRTH/cell", "", "spBv1.0/STATE/scada"]
    {
        let acts = node_after_birth(true)
            .step(NodeEvent::Received { topic, payload: &payload, is_retained: false }, at(1));
        assert!(refusal(&acts).contains("has not subscribed"), "{topic}");
    }
}

/// In ten seconds, ten thousand stops and ten thousand invalid messages arrive. The cell receives at most one request
/// per second, and the last stop is not lost. The audit trail gets a limited number of entries, and one entry with the
/// number of the others.
#[test]
fn a_flood_of_commands_is_limited_and_loses_no_stop() {
    let mut node = node_after_birth(true);
    let (mut asked, mut notes) = (vec![], vec![]);
    let mut keep = |acts: Vec<NodeAction>, ms: u64| {
        for act in acts {
            match act {
                NodeAction::Ask { command, .. } => asked.push((command, ms)),
                NodeAction::Note(note) => notes.push(note),
                _ => {}
            }
        }
    };
    for ms in 0..10_000 {
        keep(send_command(&mut node, &write_true(NodeCommand::Stop.name()), ms), ms);
        keep(send_command(&mut node, b"nonsense", ms), ms);
        if ms % 500 == 0 {
            keep(node.step(NodeEvent::Seen(values_in_state("idle")), at(ms)), ms);
        }
    }
    keep(node.step(NodeEvent::Seen(values_in_state("idle")), at(10_500)), 10_500);
    assert!(asked.iter().all(|(command, _)| *command == NodeCommand::Stop));
    assert!((10..=11).contains(&asked.len()), "{asked:?}");
    assert_eq!(asked[0].1, 0, "the first one continues at once");
    assert!(asked.last().is_some_and(|(_, ms)| *ms >= 9_999), "and so does the last one: {asked:?}");
    assert_eq!(notes.len(), 20);
    let acts = node.step(NodeEvent::Seen(values_in_state("idle")), at(60_000));
    let why = refusal(&acts);
    assert!(why.starts_with("9980 further messages"), "{why}");
    assert!(send_command(&mut node, b"nonsense", 60_001).len() == 1, "a new minute");
}

/// A delayed command is discarded with its connection, and is not passed on after the next connect.
#[test]
fn waiting_commands_end_with_their_connection() {
    for command in [NodeCommand::Hold, NodeCommand::Stop, NodeCommand::Abort] {
        let mut node = node_after_birth(true);
        let asked = |acts: &[NodeAction]| acts.iter().filter(|act| matches!(act, NodeAction::Ask { .. })).count();
        assert_eq!(asked(&send_command(&mut node, &write_true(command.name()), 1)), 1);
        assert_eq!(asked(&send_command(&mut node, &write_true(command.name()), 500)), 0, "it waits");
        node.step(NodeEvent::Lost, at(600));
        node.step(NodeEvent::Connecting, at(100_000));
        let acts = [
            node.step(NodeEvent::Subscribed, at(100_000)),
            node.step(NodeEvent::Seen(values_in_state("idle")), at(180_000)),
        ];
        assert_eq!(asked(&acts.concat()), 0, "{command:?} of minutes ago");
        assert_eq!(
            asked(&send_command(&mut node, &write_true(command.name()), 180_001)),
            1,
            "a new one is passed on"
        );
    }
}
