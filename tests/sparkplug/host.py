"""A primary host application on pysparkplug: prints each decoded message as a line of JSON, and executes the commands from its input.

Arguments: broker's port, user, password, group, edge node, host's name.
"""

import json
import sys

import pysparkplug as psp

PORT, USER, PASSWORD, GROUP, NODE, HOST = sys.argv[1:7]


def tell(**fields):
    print(json.dumps(fields), flush=True)


class Host(psp.Client):
    """Prints messages that cannot be decoded, too, because an exception in a thread of the library would be lost."""

    def _handle_message(self, mqtt_message):
        try:
            return super()._handle_message(mqtt_message)
        except Exception as error:
            tell(kind="undecodable", topic=mqtt_message.topic, error=repr(error))
            raise


def heard(_client, message):
    payload = message.payload
    kind = str(message.topic.message_type)
    if kind == "NCMD":
        return
    metrics = [payload.bd_seq_metric] if kind == "NDEATH" else payload.metrics
    tell(
        kind=kind,
        qos=int(message.qos),
        retain=bool(message.retain),
        seq=getattr(payload, "seq", None),
        timestamp=payload.timestamp,
        metrics={
            metric.name: {"value": metric.value, "null": metric.is_null, "type": metric.datatype.name, "time": metric.timestamp}
            for metric in metrics
        },
    )


client = Host(client_id=HOST, username=USER, password=PASSWORD)
everything = psp.Topic(group_id=GROUP, message_type=psp.SINGLE_LEVEL_WILDCARD, edge_node_id=NODE)
client.subscribe(everything, psp.QoS.AT_LEAST_ONCE, heard)
client.connect("127.0.0.1", port=int(PORT), callback=lambda _client: tell(kind="connected"))


def publish(topic, payload, qos, retain):
    client.publish(psp.Message(topic=topic, payload=payload, qos=qos, retain=retain), include_dtypes=True)


def command(name, value=True, retain=False):
    now = psp.get_current_timestamp()
    metric = psp.Metric(timestamp=now, name=name, datatype=psp.DataType.BOOLEAN, value=value)
    topic = psp.Topic(group_id=GROUP, message_type=psp.MessageType.NCMD, edge_node_id=NODE)
    publish(topic, psp.NCmd(timestamp=now, metrics=(metric,)), psp.QoS.AT_MOST_ONCE, retain)


for line in sys.stdin:
    word, _, rest = line.strip().partition(" ")
    if word == "state":
        said = json.loads(rest)
        topic = psp.Topic(message_type=psp.MessageType.STATE, sparkplug_host_id=HOST)
        publish(topic, psp.State(timestamp=said["timestamp"], online=said["online"]), psp.QoS.AT_LEAST_ONCE, True)
    elif word == "write":
        command(rest)
    elif word == "write-retained":
        command(rest, retain=True)
    elif word == "write-false":
        command(rest, value=False)
    elif word == "flood":
        for number in range(int(rest)):
            command("Node Control/Hold" if number % 2 else "Start")
    elif word == "quit":
        break
client.disconnect()
