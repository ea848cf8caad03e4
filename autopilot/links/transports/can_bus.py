"""A CAN bus, which NMEA 2000 goes over: no stream of bytes, so that `autopilot.links.n2k.link` opens it itself."""

from __future__ import annotations

from autopilot.links.base import LinkError, Transport
from autopilot.links.transports.medium import Accepts, LinkUrl, Medium, Place, Scheme, Written
from autopilot.links.transports.sockets import Allows


def _bus(written: Written) -> Place:
    """Return python-can's interface and channel."""
    if not written.behind or any(c.isspace() for c in written.before + written.behind):
        raise LinkError(f"link {written.text!r}: incomplete; write it like {written.example}")
    if ":" in written.before:
        raise LinkError(
            f"link {written.text!r}: {written.before.partition(':')[0]!r} is no kind of NMEA 2000 gateway; write it "
            f"like n2k:ydwg-tcp:HOST:PORT, n2k:actisense:/dev/ttyUSB0, or {written.example} for a CAN bus"
        )
    return Place(host=written.before, path=written.behind)


def _refuse(link: LinkUrl, accepts: Accepts, allows: Allows) -> Transport:
    raise LinkError(f"link {link.text!r}: a CAN bus is no stream of bytes; use it with autopilot run")


MEDIA = (Medium("can", (Scheme("n2k", "n2k", "n2k:socketcan:can0"),), _bus, _refuse),)
