"""The live helm page and what the terminal helm shares with it: one more MAVLink client of a running pilot.

Here is what the page is served with: its files, the certificate for https, and the QR code of its address. A browser
keeps the screen on and installs a page only in a secure context: https, or the boat's own computer. The certificate is
read strictly, and tried as a browser would.
"""

from __future__ import annotations

import io
import ipaddress
import re
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.errors import InputError

if TYPE_CHECKING:
    import ssl


COMMENTS = re.compile(rb"^ *(?://.*|/\*(?:(?!\*/)[\s\S])*\*/ *)\n", re.MULTILINE)
"""Lines of scripts and styles that are for who reads their sources: a twentieth of the page."""


def page_files() -> dict[str, bytes]:
    """Return the page and all it loads, by name, as it travels: our own scripts and styles without their comments."""
    folder = files("autopilot.web").joinpath("page")
    found = {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}
    ours = {name for name in found if name.endswith((".js", ".css")) and not name.startswith("uplot")}
    return found | {name: COMMENTS.sub(b"", found[name]) for name in ours}


def require_extra() -> None:
    """Raise InputError with the sentence that names the extra, where the page's libraries are missing."""
    try:
        import starlette
        import uvicorn  # noqa: F401 - only whether it is there
    except ImportError as error:
        raise InputError(
            f"autopilot web needs the extra `web` ({error.name} is missing): install it with "
            "`pip install '.[web]'`, or use `autopilot helm` in a terminal"
        ) from None
    del starlette


def context_of(certificate: Path, key: Path | None, host: str) -> ssl.SSLContext:
    """Return what a server encrypts with; key: None where the certificate's file holds it too.

    Raises InputError, with what makes a certificate for `host` where there is none.
    """
    import ssl

    for option, path in (("--cert", certificate), ("--key", key)):
        if path is not None and not path.is_file():
            raise InputError(f"{option} {path}: {'is no' if path.exists() else 'no such'} file; {made_by(host)}")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    named = f"--cert {certificate}" if key is None else f"--cert {certificate} --key {key}"
    try:
        context.load_cert_chain(certificate, key, password=_nobody_types)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise InputError(f"{named}: this key is not that of the certificate; give the two of a pair") from error
        both = (
            "both PEM, the certificate with its chain first" if key is not None else "PEM, the key in it, or give --key"
        )
        raise InputError(f"{named}: not a certificate and its key ({both}); {made_by(host)}") from error
    except OSError as error:
        raise InputError(f"{named}: {error.strerror}") from error
    return context


def doubts(context: ssl.SSLContext, certificate: Path, host: str) -> str:
    """Return what a browser will object to at `host`, and what helps; "" where nothing.

    A handshake in memory, first with the certificate itself as the trusted one: what it then says is of its dates and
    names. Then with this machine's authorities alone.
    """
    own = _objection(context, host, (certificate,))
    if own:
        return f"browsers will object to {certificate} at {host}: {own}; {made_by(host)}"
    if _objection(context, host, ()):
        return (
            f"{certificate} is of no authority that this machine knows: a browser warns once, and installs the page "
            "only after you have made the certificate known to the phone (settings, security, install a certificate)"
        )
    return ""


def made_by(host: str) -> str:
    """Return what to type for a certificate of one's own for `host`."""
    try:
        name = f"IP:{ipaddress.ip_address(host)}"
    except ValueError:
        name = f"DNS:{host}"
    return (
        "one of your own is made by: openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes "
        f"-days 365 -subj /CN=norrbin -addext subjectAltName={name} -keyout web.key -out web.crt"
    )


def _nobody_types() -> str:
    raise InputError(
        "the key is locked by a pass phrase, and nobody types one when a service starts; unlock a copy that only its "
        "owner reads: (umask 077; openssl pkey -in web.key -out web-open.key)"
    )


def _objection(server: ssl.SSLContext, host: str, trusted: Iterable[Path]) -> str:
    """Return why a client that trusts this machine's authorities and `trusted` ends the handshake, else ""."""
    import ssl

    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.load_default_certs()
    for path in trusted:
        client.load_verify_locations(path)
        client.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    asking = client.wrap_bio(to_client, to_server, server_hostname=host)
    answering = server.wrap_bio(to_server, to_client, server_side=True)
    for _ in range(4):  # a handshake is two journeys there and back
        for side in (asking, answering):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLCertVerificationError as error:
                return error.verify_message.rstrip(".")
    return ""


def svg_of(address: str) -> str:
    """Return the code of an address as SVG, "" where the package segno is missing."""
    code = _code(address)
    return "" if code is None else str(code.svg_inline(border=2, light="#fff", omitsize=True))


def text_of(address: str) -> str:
    """Return the code of an address in half blocks for a terminal, "" where the package segno is missing."""
    code = _code(address)
    if code is None:
        return ""
    lines = io.StringIO()
    code.terminal(out=lines, border=1, compact=True)
    return lines.getvalue()


def is_reachable(host: str) -> bool:
    """Return whether another machine can open a page at this host: an address or a name."""
    try:
        return not ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host not in ("", "localhost")


def _code(address: str) -> Any:
    try:
        import segno
    except ImportError:
        return None
    return segno.make(address, micro=False)
