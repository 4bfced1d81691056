"""A second host application, on mqtt-spb-wrapper: prints the result of its parser for each message as a line of JSON.

Arguments: broker's port, user, password, group.
"""

import json
import sys

from mqtt_spb_wrapper import MqttSpbEntityApp, MqttSpbEntityScada

PORT, USER, PASSWORD, GROUP = sys.argv[1:5]


def tell(kind, payload):
    if payload is None:
        print(json.dumps({"kind": "undecodable", "of": kind}), flush=True)
        return
    metrics = [
        {key: metric.get(key) for key in ("name", "alias", "value", "isNull")} for metric in payload.get("metrics", [])
    ]
    print(json.dumps({"kind": kind, "seq": payload.get("seq"), "metrics": metrics}), flush=True)


app = MqttSpbEntityApp(
    GROUP,
    "second",
    callback_birth=lambda topic, payload: tell(topic.message_type, payload),
    callback_data=lambda topic, payload: tell(topic.message_type, payload),
    callback_death=lambda topic, payload: tell(topic.message_type, payload),
)
scada = MqttSpbEntityScada(GROUP, "second-scada")
for entity in (app, scada):
    entity.connect("127.0.0.1", int(PORT), USER, PASSWORD, skip_death=True)
print(json.dumps({"kind": "connected" if app.is_connected() and scada.is_connected() else "unconnected"}), flush=True)

for line in sys.stdin:
    word, _, rest = line.strip().partition(" ")
    if word == "write":
        node, _, name = rest.partition(" ")
        scada.send_command(name, True, node)
    elif word == "quit":
        break
for entity in (app, scada):
    entity.disconnect(skip_death_publish=True)
