"""A self-signed certificate for a server on the local network, made by ``openssl``."""

import hashlib
import shutil
import socket
import ssl
import subprocess
import tempfile
from pathlib import Path

from sim2vr_harness.base.errors import InputError

_DAYS = 2
_TIMEOUT_S = 30.0
_ELSEWHERE = ("192.0.2.1", 9)
"""An address for documentation (RFC 5737): nothing is sent there."""


def local_address() -> str:
    """Return this machine's address on the local network.

    Raises:
        InputError: It has none.
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(_ELSEWHERE)
            address = str(probe.getsockname()[0])
    except OSError:
        address = "127.0.0.1"
    if address.startswith("127."):
        raise InputError("--lan", "a machine without a network", "an address on the local network")
    return address


def self_signed(host: str) -> tuple[ssl.SSLContext, str]:
    """Return settings of a server with a certificate for an address, and its fingerprint.

    The private key is in no file when the function has returned.

    Raises:
        InputError: There is no ``openssl``, or it fails.
    """
    program = shutil.which("openssl")
    if program is None:
        raise InputError("--lan", "no openssl on the PATH", "it (apt-get install openssl)")
    with tempfile.TemporaryDirectory() as folder:
        key, certificate = Path(folder) / "key.pem", Path(folder) / "certificate.pem"
        # fmt: off
        command = [
            program, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
            "-nodes", "-days", str(_DAYS), "-subj", "/CN=sim2vr", "-keyout", str(key),
            "-out", str(certificate), "-addext", f"subjectAltName=IP:{host}",
        ]
        # fmt: on
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=_TIMEOUT_S)
        except (subprocess.SubprocessError, OSError) as error:
            raise InputError("--lan", f"openssl, which fails: {error}", "openssl 1.1.1") from error
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, key)
        content = ssl.PEM_cert_to_DER_cert(certificate.read_text())
    return context, hashlib.sha256(content).digest().hex(":").upper()
