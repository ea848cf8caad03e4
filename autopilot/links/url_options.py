"""What may stand behind the `?` of a link URL: `nmea:/dev/ttyUSB1:4800?steer=no&send=HDT:5,ROT:5`."""

from __future__ import annotations

from typing import NamedTuple

from autopilot.links.base import LinkError
from autopilot.links.transports.sockets import Network, network_of

SENTENCES = ("HDG", "HDT", "HTD", "ROT", "RSA", "XDR")
"""Sentences that a link can be asked to send, by their types."""
RATE_MIN, RATE_MAX = 0.1, 50.0
DEFAULT_RATE = 1.0


class UrlOptions(NamedTuple):
    """steers: whether rudder orders leave on this link.  sends: sentence type and rate [Hz] of what is repeated.

    talker: the two letters before the type of what is repeated.  allow: who may come in; empty: everybody.
    """

    steers: bool = True
    sends: tuple[tuple[str, float], ...] = ()
    talker: str = "AG"
    allow: tuple[Network, ...] = ()


def parse_options(text: str, query: str, allowed: tuple[str, ...]) -> UrlOptions:
    """Return the options of `query`, the part of the URL `text` behind its `?`. Raises LinkError."""
    options = UrlOptions()
    seen: set[str] = set()
    for item in query.split("&"):
        name, _, value = item.partition("=")
        if name not in allowed or name in seen:
            offer = f"allowed here, once each, are {', '.join(allowed)}" if allowed else "this kind of link takes none"
            raise LinkError(f"link {text!r}: option {name!r} behind the ? is unknown or repeated; {offer}")
        seen.add(name)
        if name == "steer":
            if value not in ("yes", "no"):
                raise LinkError(f"link {text!r}: steer is {value!r}; write steer=yes or steer=no")
            options = options._replace(steers=value == "yes")
        elif name == "talker":
            if not (len(value) == 2 and value.isascii() and value.isalpha() and value.isupper()):
                raise LinkError(f"link {text!r}: talker is {value!r}; write two capital letters, such as talker=II")
            options = options._replace(talker=value)
        elif name == "allow":
            options = options._replace(allow=tuple(_network(text, item) for item in value.split(",")))
        else:
            options = options._replace(sends=_sends(text, value))
    return options


def _network(text: str, value: str) -> Network:
    try:
        return network_of(value)
    except ValueError as error:
        raise LinkError(
            f"link {text!r}: {value!r} is no network ({error}); write addresses or networks, such as "
            "allow=192.168.1.20,10.0.0.0/24"
        ) from None


def _sends(text: str, value: str) -> tuple[tuple[str, float], ...]:
    sends: dict[str, float] = {}
    for item in value.split(","):
        name, colon, rate = item.partition(":")
        if name not in SENTENCES or name in sends:
            raise LinkError(
                f"link {text!r}: sentence {name!r} cannot be sent or is named twice; "
                f"write send= and some of {', '.join(SENTENCES)}, each with its rate in Hz, such as send=HDT:5,RSA:2"
            )
        sends[name] = _rate(text, name, rate) if colon else DEFAULT_RATE
    return tuple(sends.items())


def _rate(text: str, name: str, digits: str) -> float:
    is_plain = digits.isascii() and digits.replace(".", "", 1).isdigit() and len(digits) <= 8
    rate = float(digits) if is_plain else 0.0
    if not RATE_MIN <= rate <= RATE_MAX:
        raise LinkError(
            f"link {text!r}: the rate {digits!r} of {name} is not a number from {RATE_MIN:g} to {RATE_MAX:g} (Hz)"
        )
    return rate
