"""QR codes of the page's addresses, so that a phone opens it without typing. Pure."""

from __future__ import annotations

import io
import ipaddress
from typing import Any


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
