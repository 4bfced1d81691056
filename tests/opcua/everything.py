"""All actions of a production line with the cell, in each role: reading, calls, refusals, subscriptions and acknowledgements."""

import asyncio
import logging
import sys
import time
from pathlib import Path

from asyncua import Client, ua
from people import PASSWORD, Application, at, bad, call, cell, comes, read, refused, tables, tell

URL, CERTIFICATES = sys.argv[1], Path(sys.argv[2])
FOLDER = CERTIFICATES.parent
ROLES = ["viewer", "operator", "inspector", "engineer", "administrator"]
# Possible status codes of a call that reached the cell.
LET_THROUGH = {"Good", "BadInvalidState", "BadDeviceFailure", "BadInvalidArgument"}


def step(number):
    """Returns the number of the step to which a decision refers."""
    return ua.Variant(number, ua.VariantType.UInt32)


async def offered(_):
    """Checks that only signed and encrypted connections are offered, and no session without an account."""
    endpoints = await Client(URL).connect_and_get_server_endpoints()
    found = sorted((one.SecurityPolicyUri.split("#")[1], one.SecurityMode.name) for one in endpoints)
    assert found == [("Aes256_Sha256_RsaPss", "SignAndEncrypt"), ("Basic256Sha256", "SignAndEncrypt")], found
    for one in endpoints:
        assert one.EndpointUrl == URL, one.EndpointUrl
        kinds = [token.TokenType.name for token in one.UserIdentityTokens]
        assert kinds == ["UserName"], kinds
    assert await refused(Client(URL)) != "Connected", "no connection without security"


async def certificates(known):
    """Checks that unknown, expired, weak and copied certificates are rejected, and a trusted one is accepted."""
    found = await refused(await known.client(URL, "viewer"))
    assert found == "BadCertificateUntrusted", found
    await asyncio.sleep(2.5)
    known.is_trusted_by(CERTIFICATES)
    assert await refused(await known.client(URL, "viewer")) == "Connected"
    for name, settings in {"expired": {"days": 1, "since_days": 30}, "weak": {"bits": 1024}}.items():
        other = Application(FOLDER, name, **settings)
        assert await refused(await other.client(URL, "viewer")) != "Connected"
        await asyncio.sleep(2.5)
        other.is_trusted_by(CERTIFICATES)
        found = await refused(await other.client(URL, "viewer"))
        assert found not in {"Connected", "BadCertificateUntrusted"}, f"{name}: {found}"
        tell(name, found)
    thief = Application(FOLDER, "thief")
    thief.certificate_file, thief.uri = known.certificate_file, known.uri
    found = await refused(await thief.client(URL, "viewer", timeout=3))
    assert found != "Connected", "a copied certificate without its key"


async def passwords(known):
    for user, password in [("viewer", "wrong horse"), ("nobody", PASSWORD), ("viewer#", PASSWORD), ("x' OR 1=1", "")]:
        found = await refused(await known.client(URL, user, password))
        assert found in {"BadUserAccessDenied", "BadIdentityTokenRejected"}, f"{user}: {found}"
    found = await refused(await known.client(URL))
    assert found != "Connected", "no session without an account"


async def browsed(known):
    """Checks that the nodes agree with the table of the program, with types and units, and that none can be written."""
    async with await known.client(URL, "viewer", policy="Aes256Sha256RsaPss") as client:
        root, index = await cell(client)
        found = {}

        async def look(node, path):
            for child in await node.get_children():
                name = (await child.read_browse_name()).Name
                kind = await child.read_node_class()
                if kind == ua.NodeClass.Object:
                    await look(child, f"{path}{name}/")
                elif kind == ua.NodeClass.Variable and name != "EngineeringUnits":
                    found[f"{path}{name}"] = child

        await look(root, "")
        nodes = {node["path"]: node for node in tables()["nodes"]}
        assert set(found) == set(nodes), set(found) ^ set(nodes)
        for path, node in found.items():
            data_type = (await client.get_node(await node.read_data_type()).read_browse_name()).Name
            array = "[]" if await node.read_value_rank() == ua.ValueRank.OneDimension else ""
            assert data_type + array == nodes[path]["type"], path
            assert await node.get_user_access_level() == {ua.AccessLevel.CurrentRead}, path
            assert (await node.read_description()).Text == nodes[path]["meaning"], path
            if nodes[path]["unit"]:
                unit = await (await node.get_child("0:EngineeringUnits")).read_value()
                assert unit.DisplayName.Text == nodes[path]["unit"], path
            await node.read_value()
            try:
                await node.write_value(ua.Variant(1, ua.VariantType.Int32))
                raise AssertionError(f"{path} was written")
            except ua.UaStatusCodeError:
                pass
        commands = await at(client, "Commands")
        methods = sorted([(await method.read_browse_name()).Name for method in await commands.get_methods()])
        assert methods == sorted(method["name"] for method in tables()["methods"]), methods
        assert await read(client, "PackML/Status/StateCurrentName") == "Stopped"
        assert await read(client, "Calibrations/Scanner/Age") < 24
        tell("browsed", len(found))


async def as_each_role(known):
    """Calls every method in every role: the call is accepted, or refused because of the role."""
    values = {"String": "", "Boolean": False, "UInt32": step(10**6)}
    for role in ROLES:
        async with await known.client(URL, role) as client:
            for method in tables()["methods"]:
                # A stop or an abort is tried at the end, so that the cell keeps its state here.
                if method["name"] in {"Stop", "Abort", "Reset"}:
                    continue
                found = await call(client, method["name"], *[values[kind] for kind in method["arguments"]])
                is_allowed = role in method["roles"]
                assert (found in LET_THROUGH) if is_allowed else found == "BadUserAccessDenied", (role, method, found)
            # Wrong arguments are reported before the call reaches the cell.
            assert await call(client, "Start", 1, 2, 3, 4, 5) != "Good"
            assert await call(client, "Start", "one") != "Good"
            assert await call(client, "Hold", "too many") != "Good"
    tell("roles", len(ROLES))


class Changes:
    """Collects the values of a node as they change."""

    def __init__(self):
        self.seen = []

    def datachange_notification(self, node, value, data):
        self.seen.append(value)

    async def come(self, wanted, patience=120):
        since = time.monotonic()
        while wanted not in self.seen:
            assert time.monotonic() - since < patience, f"{wanted} never came: {self.seen}"
            await asyncio.sleep(0.05)


async def a_part(known):
    """Runs a part as a production line does: start, hold, continue, accept; meanwhile checks the reported values."""
    async with await known.client(URL, "operator") as client, await known.client(URL, "inspector") as inspector:
        changes = Changes()
        subscription = await inspector.create_subscription(100, changes)
        await subscription.subscribe_data_change(await at(inspector, "PackML/Status/StateCurrentName"))
        for _ in range(100):
            if await call(client, "Reset") == "Good":
                break
            await asyncio.sleep(0.5)
        await changes.come("Idle")
        known_as = dict(zip(await read(client, "Recipes/Names"), await read(client, "Recipes/Hashes")))["recipe.toml"]
        assert await call(client, "Start", "../cell.toml", known_as, "", "", False) == "BadInvalidArgument"
        assert await call(client, "Start", "recipe.toml", "0" * 64, "", "", False) == "BadInvalidArgument"
        assert await call(client, "Start", "recipe.toml", known_as, "SN 7", "WO 12", False) == "Good"
        await changes.come("Execute")
        # In virtual time the cycle may end before the hold arrives.
        held = await call(client, "Hold")
        assert held in LET_THROUGH, held
        if held == "Good":
            await changes.come("Held")
            now = await read(client, "Cycle/Step")
            assert await call(inspector, "Unhold", False, step(now)) == "BadUserAccessDenied"
            assert "unhold" in await read(client, "Cycle/PossibleCommands")
            # A decision on an earlier step is refused.
            assert await call(client, "Unhold", False, step(now - 1)) == "BadInvalidState"
            assert await call(client, "Unhold", False, step(now)) == "Good"
        since = time.monotonic()
        while await read(client, "PackML/Status/StateCurrentName") != "Complete":
            assert time.monotonic() - since < 240, changes.seen
            if await read(client, "Cycle/WaitsForReview"):
                tell("accept", await call(inspector, "Accept", step(await read(client, "Cycle/Step"))))
            await asyncio.sleep(0.2)
        await comes(client, "Cycle/Verdict", "pass")
        await comes(client, "Part/SerialNumber", "SN 7")
        await comes(client, "Part/WorkOrder", "WO 12")
        await comes(client, "Part/Operator", "operator")
        await comes(client, "Grids/States", ["whole"] * len(await read(client, "Grids/Ids")))
        await comes(client, "Counters/Passed", 1)
        await comes(client, "PackML/Admin/ProdProcessedCount", 1)
        await subscription.delete()
        tell("states", changes.seen)
        assert await call(client, "Hold") == "BadInvalidState"
        await comes(client, "Service/LastRefusal/Method", "Hold")
        assert "hold is not possible" in await read(client, "Service/LastRefusal/Message")


async def stopped_by_anybody(known):
    """Checks that a viewer can stop and abort the cell, and that an operator can clear it."""
    async with await known.client(URL, "viewer") as viewer, await known.client(URL, "operator") as operator:
        changes = Changes()
        subscription = await operator.create_subscription(100, changes)
        await subscription.subscribe_data_change(await at(operator, "PackML/Status/StateCurrentName"))
        assert await call(operator, "Reset") == "Good"
        await changes.come("Idle")
        known_as = dict(zip(await read(operator, "Recipes/Names"), await read(operator, "Recipes/Hashes")))["recipe.toml"]
        assert await call(operator, "Start", "recipe.toml", known_as, "", "", False) == "Good"
        assert await call(viewer, "Abort") == "Good"
        await changes.come("Aborted")
        await comes(viewer, "PackML/Admin/StopReasonCode", "asked")
        now = await read(operator, "Cycle/Step")
        assert await call(viewer, "Clear", step(now)) == "BadUserAccessDenied"
        assert await call(operator, "Clear", step(now)) == "Good"
        await changes.come("Stopped")
        assert await call(viewer, "Stop") in {"Good", "BadInvalidState"}
        await subscription.delete()


class Events:
    """Collects the events in order of arrival."""

    def __init__(self):
        self.seen = []

    def event_notification(self, event):
        self.seen.append(event)


FIELDS = {
    "BaseEventType": ["EventId", "EventType", "SourceName", "Time", "Message", "Severity"],
    "ConditionType": ["ConditionName", "Retain", "ClientUserId", "EnabledState/Id"],
    "AcknowledgeableConditionType": ["AckedState/Id"],
    "AlarmConditionType": ["ActiveState/Id"],
}


def of_alarms():
    """Subscribes to alarms with their fields, each with its own type, as the standard requires (asyncua uses one type for all of them)."""
    chosen = ua.EventFilter()
    for kind, paths in FIELDS.items():
        for path in paths:
            names = [ua.QualifiedName(name, 0) for name in path.split("/")]
            chosen.SelectClauses.append(
                ua.SimpleAttributeOperand(
                    TypeDefinitionId=ua.NodeId(getattr(ua.ObjectIds, kind)),
                    BrowsePath=names,
                    AttributeId=ua.AttributeIds.Value,
                )
            )
    condition = ua.SimpleAttributeOperand(
        TypeDefinitionId=ua.NodeId(ua.ObjectIds.ConditionType), AttributeId=ua.AttributeIds.NodeId
    )
    chosen.SelectClauses.append(condition)
    element = ua.ContentFilterElement(FilterOperator=ua.FilterOperator.OfType)
    alarm = ua.NodeId(ua.ObjectIds.AlarmConditionType)
    element.FilterOperands.append(ua.LiteralOperand(Value=ua.Variant(alarm)))
    chosen.WhereClause = ua.ContentFilter(Elements=[element])
    return chosen


async def alarms(known):
    """Checks that an active alarm is a condition: it is reported at a refresh, and acknowledged by its event."""
    async with await known.client(URL, "operator") as operator:
        while await read(operator, "PackML/Status/StateCurrentName") != "Idle":
            await call(operator, "Reset")
            await asyncio.sleep(0.3)
        # This recipe permits less shift than the panel has.
        known_as = dict(zip(await read(operator, "Recipes/Names"), await read(operator, "Recipes/Hashes")))["strict.toml"]
        assert await call(operator, "Start", "strict.toml", known_as, "", "", False) == "Good"
        while await read(operator, "PackML/Status/StateCurrentName") != "Complete":
            await asyncio.sleep(0.3)
        await comes(operator, "Cycle/Verdict", "reject")
        await comes(operator, "PackML/Admin/StopReasonCode", "shift_limit")
        await comes(operator, "PackML/Admin/ProdDefectiveCount", 1)
        await comes(operator, "Alarms/Codes", ["shift_limit"])
    async with await known.client(URL, "inspector") as client, await known.client(URL, "viewer") as viewer:
        events = Events()
        subscription = await client.create_subscription(100, events)
        await subscription.subscribe_events(client.nodes.server, evfilter=of_alarms(), queuesize=50)
        refresh = client.get_node(ua.ObjectIds.ConditionType)
        number = ua.Variant(subscription.subscription_id, ua.VariantType.UInt32)
        await refresh.call_method("0:ConditionRefresh", number)
        await asyncio.sleep(2)
        ids = await read(client, "Alarms/Ids")
        assert ids, "a panel that is rejected is an alarm until somebody resets the cell"
        codes = await read(client, "Alarms/Codes")
        lasting = {event.ConditionName: event for event in events.seen if getattr(event, "ConditionName", None)}
        assert set(codes) <= set(lasting), (codes, set(lasting))
        event = lasting[codes[0]]
        assert getattr(event, "ActiveState/Id") is True and event.Retain is True and event.Severity == 600, event
        assert getattr(event, "AckedState/Id") is False
        node, method = event.NodeId, ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge)
        arguments = [ua.Variant(event.EventId, ua.VariantType.ByteString), ua.Variant(ua.LocalizedText("seen"))]

        async def acknowledge(by):
            request = ua.CallMethodRequest(ObjectId=node, MethodId=method, InputArguments=arguments)
            [result] = await by.uaclient.call([request])
            return ua.status_codes.get_name_and_doc(result.StatusCode.value)[0]

        assert await acknowledge(viewer) == "BadUserAccessDenied"
        found = await acknowledge(client)
        assert found == "Good", found
        await asyncio.sleep(2)
        acknowledged = await read(client, "Alarms/AcknowledgedBy")
        assert any("inspector" in who for who in acknowledged), acknowledged
        assert any(getattr(event, "AckedState/Id", None) is True for event in events.seen), "the acknowledgement is an event"
        again = await acknowledge(client)
        assert again != "Good", again
        assert await call(client, "AcknowledgeAlarm", "1/none/2") == "BadInvalidArgument"
        # After a reset of the cell, the alarm is cleared.
        async with await known.client(URL, "operator") as operator:
            assert await call(operator, "Reset") == "Good"
        since = time.monotonic()
        while not any(getattr(event, "ActiveState/Id", None) is False for event in events.seen):
            assert time.monotonic() - since < 30, events.seen
            await asyncio.sleep(0.1)
        await comes(client, "Alarms/Codes", [])
        tell("alarms", codes)


async def flood(known):
    """Sends thousands of calls: a few are accepted, the others are refused immediately, and the cell continues to answer."""
    async with await known.client(URL, "operator", timeout=60) as client:
        since = time.monotonic()
        found = await asyncio.gather(*[call(client, "Hold") for _ in range(1000)])
        counts = {status: found.count(status) for status in set(found)}
        assert counts.get("BadTooManyOperations", 0) > 800, counts
        stops = await asyncio.gather(*[call(client, "Stop") for _ in range(300)])
        assert set(stops) <= LET_THROUGH, set(stops)
        assert await read(client, "Service/Answers") is True
        tell("flood", counts, f"{time.monotonic() - since:.1f} s")


async def changed_accounts(known):
    """Checks that a person with a disabled account can read nothing: the connection ends, and a new one is refused."""
    async with await known.client(URL, "administrator") as client:
        changes = Changes()
        subscription = await client.create_subscription(100, changes)
        await subscription.subscribe_data_change(await at(client, "PackML/Admin/StateCurrentTime"))
        disable = await asyncio.create_subprocess_exec(
            sys.argv[4], "user", "disable", "administrator", "--cell", str(CERTIFICATES.parents[1] / "cell.toml")
        )
        assert await disable.wait() == 0
        since = time.monotonic()
        try:
            while await read(client, "Service/Answers"):
                assert time.monotonic() - since < 10, "the session goes on"
                await asyncio.sleep(0.2)
        except (ua.UaError, ConnectionError, asyncio.TimeoutError) as error:
            tell("disabled", bad(error))
    assert await refused(await known.client(URL, "administrator")) != "Connected"


async def main():
    known = Application(FOLDER, "line")
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    steps = [certificates, passwords, browsed, as_each_role, a_part, stopped_by_anybody, alarms, flood, offered, changed_accounts]
    for step in [step for step in steps if len(sys.argv) < 6 or step.__name__ in sys.argv[5:]]:
        await step(known)
        tell("done", step.__name__)
    tell("whole")


if __name__ == "__main__":
    asyncio.run(main())
