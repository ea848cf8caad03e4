"""What of all that is passed on leaves over one link: which senders' messages, and how often each. Pure.

For a ground station or a logger behind a slow radio, while the flight controller's own link runs at full rate.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import LinkError
from autopilot.links.ground_station.access import Budget
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import EVERYBODY, Address, identity_of, instance_of, source_of, target_of
from autopilot.links.mavlink.messages import KNOWN
from autopilot.links.transports.medium import LinkUrl

OTHERS = "others"
"""Stands for every stream that is not named."""
EACH_COUNTS = frozenset(
    int(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))
    for name in (
        *("HEARTBEAT", "STATUSTEXT", "PING", "TIMESYNC", "AUTOPILOT_VERSION", "COMMAND_ACK", "MAG_CAL_REPORT"),
        *("PARAM_VALUE", "PARAM_EXT_VALUE", "MISSION_ITEM_REACHED", "LOG_ENTRY", "LOG_DATA"),
    )
)
"""No stream of which the newest is enough: who misses one misses something. They are held back only by name."""
COMMANDS = (int(dialect.MAVLINK_MSG_ID_COMMAND_LONG), int(dialect.MAVLINK_MSG_ID_COMMAND_INT))
SAVED, SAVED_AT_FIRST = 2.0, 0.5
"""Messages saved up, at most and behind the first: jitter of half a period costs none, and the mean is the rate."""
MOST_STREAMS = 512
"""Streams whose rate is watched: a flood of invented ones fills no memory."""
HIGHEST = 1 << 24


class OutgoingFilter:
    """Says frame by frame what leaves over a link; every stream (sender, message, instance) has a rate of its own.

    Args:
        rates: at most so many [Hz] of a message, by its id; 0: none.
        others: the same for every stream that is not named, and whose messages do not each count.
        sources: whose messages leave, component 0: those of the whole system; empty: everybody's.
    """

    def __init__(
        self, rates: Mapping[int, float], others: float = math.inf, sources: frozenset[Address] = frozenset()
    ) -> None:
        self._rates, self._others, self._sources = dict(rates), others, sources
        self._streams: dict[tuple[Address, int, bytes], Budget] = {}

    @property
    def sets_rates(self) -> bool:
        """Whether any message has a rate here."""
        return bool(self._rates) or math.isfinite(self._others)

    def passes(self, now: float, frame: bytes) -> bool:
        """Return whether a frame leaves at `now` [s]; it is taken to leave then."""
        source = source_of(frame)
        if self._sources and self._sources.isdisjoint((source, Address(source.system, 0))):
            return False
        identity = identity_of(frame)
        rate = self._rates.get(identity)
        if rate is None:
            if math.isinf(self._others) or identity in EACH_COUNTS or target_of(frame) != EVERYBODY:
                return True
            rate = self._others
        if rate == 0.0:
            return False
        stream = (source, identity, instance_of(frame))
        budget = self._streams.get(stream)
        if budget is not None:
            return budget.spend(now, 1.0)
        if len(self._streams) >= MOST_STREAMS:
            del self._streams[next(iter(self._streams))]
        self._streams[stream] = budget = Budget(rate, SAVED)
        return budget.spend(now, SAVED - SAVED_AT_FIRST)


def asks_for_streams(frame: bytes) -> bool:
    """Return whether a frame asks a flight controller to send a message more or less often."""
    identity = identity_of(frame)
    if identity == dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM:
        return True
    if identity not in COMMANDS:
        return False
    return any(message.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL for message in MavlinkCodec().decode(frame))


def filter_of(url: LinkUrl) -> OutgoingFilter | None:
    """Return what the URL of a link says of what leaves there; None where it says nothing. Raises LinkError."""
    options = url.options
    if not options.rates and not options.sources:
        return None
    rates = {_identity_of(url.text, name): rate for name, rate in options.rates if name != OTHERS}
    sources = frozenset(Address(*source) for source in options.sources)
    return OutgoingFilter(rates, dict(options.rates).get(OTHERS, math.inf), sources)


def _identity_of(text: str, name: str) -> int:
    if name.isascii() and name.isdigit() and len(name) <= 8 and int(name) < HIGHEST:
        return int(name)
    ids = {kind.msgname: identity for identity, kind in KNOWN.items()}
    if name in ids:
        return ids[name]
    near = difflib.get_close_matches(name.upper(), ids, n=3) or ["ATTITUDE"]
    raise LinkError(
        f"link {text!r}: there is no MAVLink message {name!r}; write a name such as {', '.join(near)}, a message's "
        f"number, or {OTHERS}"
    )
