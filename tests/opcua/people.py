"""Clients of the OPC UA server based on asyncua, each with its own name, password and certificate."""

import asyncio
import datetime
import json
import sys
import time
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto import security_policies
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

PASSWORD = "correct horse"
NAMESPACE = "urn:panelprep:cell"
POLICIES = {
    "Basic256Sha256": security_policies.SecurityPolicyBasic256Sha256,
    "Aes256Sha256RsaPss": security_policies.SecurityPolicyAes256Sha256RsaPss,
}


def tell(*words):
    print(*words, flush=True)


def bad(error):
    """Returns the name of the status code of a call or a connection."""
    if isinstance(error, ua.UaStatusCodeError):
        return ua.status_codes.get_name_and_doc(error.code)[0]
    return type(error).__name__


class Application:
    """A client program with its certificate and key."""

    def __init__(self, folder, name, days=365, bits=2048, since_days=1):
        self.uri = f"urn:client:{name}"
        self.key_file, self.certificate_file = folder / f"{name}.pem", folder / f"{name}.der"
        key = rsa.generate_private_key(public_exponent=65537, key_size=bits)
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        since = datetime.datetime.now(datetime.timezone.utc) - datetime.timedelta(days=since_days)
        certificate = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(subject)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(since)
            .not_valid_after(since + datetime.timedelta(days=days))
            .add_extension(
                x509.SubjectAlternativeName([x509.UniformResourceIdentifier(self.uri), x509.DNSName("localhost")]), False
            )
            .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH]), False)
            .add_extension(x509.KeyUsage(True, True, True, True, False, True, False, False, False), True)
            .sign(key, hashes.SHA256())
        )
        self.key_file.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
            )
        )
        self.certificate_file.write_bytes(certificate.public_bytes(serialization.Encoding.DER))

    def is_trusted_by(self, certificates):
        """Moves the rejected certificate to the folder of trusted certificates, as a person does."""
        mine = self.certificate_file.read_bytes()
        found = [file for file in (certificates / "rejected").iterdir() if file.read_bytes() == mine]
        assert len(found) == 1, f"{self.uri}: {found}"
        found[0].rename(certificates / "trusted" / found[0].name)

    async def client(self, url, user=None, password=PASSWORD, policy="Basic256Sha256", timeout=10):
        # Timeout of the client's own check of the connection, whose response is late after a flood of requests.
        client = Client(url, timeout=timeout, watchdog_intervall=timeout / 10)
        client.application_uri = self.uri
        await client.set_security(
            POLICIES[policy], str(self.certificate_file), str(self.key_file), mode=ua.MessageSecurityMode.SignAndEncrypt
        )
        if user:
            client.set_user(user)
            client.set_password(password)
        return client


async def refused(client):
    """Returns the status code with which a connection is refused."""
    try:
        async with client:
            return "Connected"
    except Exception as error:  # the name of any error is returned
        return bad(error)


async def cell(client):
    """Returns the object of the cell, and the index of its namespace."""
    index = await client.get_namespace_index(NAMESPACE)
    return await client.nodes.objects.get_child(f"{index}:Panelprep"), index


async def at(client, path):
    """Returns the node with this path, which begins at the object of the cell."""
    root, index = await cell(client)
    return await root.get_child([f"{index}:{name}" for name in path.split("/")])


async def read(client, path):
    return await (await at(client, path)).read_value()


async def comes(client, path, wanted, patience=20):
    """Waits until a node has this value."""
    since = time.monotonic()
    while (found := await read(client, path)) != wanted:
        assert time.monotonic() - since < patience, f"{path}: {found}, not {wanted}"
        await asyncio.sleep(0.1)


async def call(client, method, *arguments):
    """Returns the status code of a method call."""
    commands = await at(client, "Commands")
    _, index = await cell(client)
    try:
        await commands.call_method(f"{index}:{method}", *arguments)
        return "Good"
    except ua.UaStatusCodeError as error:
        return bad(error)


def tables():
    """Returns the program's tables of nodes and methods, which the test wrote to a file."""
    return json.loads(Path(sys.argv[3]).read_text())
