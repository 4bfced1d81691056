"""A client without an account, if the cell's file permits reading: which values it can read, and that it can request nothing except a stop."""

import asyncio
import logging
import sys
from pathlib import Path

from asyncua import Client, ua
from people import Application, call, read, refused, tables, tell

URL, CERTIFICATES = sys.argv[1], Path(sys.argv[2])


async def main():
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    endpoints = await Client(URL).connect_and_get_server_endpoints()
    modes = {one.SecurityMode.name: [token.TokenType.name for token in one.UserIdentityTokens] for one in endpoints}
    assert modes == {"None_": ["Anonymous"], "SignAndEncrypt": ["Anonymous", "UserName"]}, modes
    values = {"String": "", "Boolean": False, "UInt32": ua.Variant(0, ua.VariantType.UInt32)}
    async with Client(URL) as client:
        assert await read(client, "PackML/Status/StateCurrentName") == "Stopped"
        for node in tables()["nodes"]:
            await read(client, node["path"])
        for method in tables()["methods"]:
            found = await call(client, method["name"], *[values[kind] for kind in method["arguments"]])
            if method["name"] in {"Stop", "Abort"}:
                assert found in {"Good", "BadInvalidState"}, (method, found)
            else:
                assert found == "BadUserAccessDenied", (method, found)
        for _ in range(50):
            state = await read(client, "PackML/Status/StateCurrentName")
            if state == "Aborted":
                break
            await asyncio.sleep(0.1)
        assert state == "Aborted", f"an abort needs no account: {state}"
    # No password is sent over a connection on which others could read it.
    client = Client(URL)
    client.set_user("operator")
    client.set_password("correct horse")
    found = await refused(client)
    assert found != "Connected", found
    tell("password without encryption", found)
    # After five wrong passwords, the right password is refused for a minute.
    application = Application(CERTIFICATES.parent, "line")
    await refused(await application.client(URL, "operator"))
    await asyncio.sleep(2.5)
    application.is_trusted_by(CERTIFICATES)
    for _ in range(5):
        assert await refused(await application.client(URL, "operator", "wrong horse")) != "Connected"
    assert await refused(await application.client(URL, "operator")) != "Connected", "the account pauses"
    assert await refused(await application.client(URL, "viewer")) == "Connected", "another one does not"
    tell("whole")


asyncio.run(main())
