"""What came over a line on which no heading was found: kept until the first heading, put into words where none comes.

So a skipper reads what is wrong: a silent port, another protocol, another baud rate, or messages without a heading.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from autopilot.links.base import Transport
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.transports import UdpInTransport
from autopilot.links.transports.medium import peer_of
from autopilot.links.url import NETWORKS, SCHEMES, split_scheme

KEPT_BYTES = 30_000
NAMES_MOST = 8
SENTENCE = re.compile(rb"[$!][A-Z]{1,2}([A-Z]{3}),[\x20-\x7e]*")
SENTENCES_LEAST = 2
HEADING_SENTENCES = ("HDG", "HDM", "HDT", "THS")
MAGNETIC = ("HDG", "HDM")
MAVLINK_HEADING = "ATTITUDE"


class RecordingTransport:
    """A transport that keeps the beginning of what comes, until `forget`."""

    def __init__(self, inside: Transport, protocol: str) -> None:
        self.inside = inside
        self.protocol = protocol
        self.name = inside.name
        self.is_stream = inside.is_stream
        self.is_local = inside.is_local
        self.fileno, self.send = inside.fileno, inside.send
        self.forget_peer, self.close = inside.forget_peer, inside.close
        self.count = 0
        self.kept: list[bytes] = []
        self._room = KEPT_BYTES

    def receive(self) -> list[bytes]:
        """Return what waits. Raises LinkError."""
        chunks = self.inside.receive()
        for chunk in chunks if self._room > 0 else ():
            self.count += len(chunk)
            self._room -= len(chunk)
            self.kept.append(chunk)
        return chunks

    def waiting_to_send(self) -> int:
        """Return how many bytes wait in a serial line's driver, 0 elsewhere."""
        waiting = getattr(self.inside, "waiting_to_send", None)
        return 0 if waiting is None else int(waiting())

    def forget(self) -> None:
        """Keep nothing any more."""
        self.kept, self._room = [], 0

    @property
    def words(self) -> str:
        """What came and what to do about it, as a part of a sentence."""
        data, sender = b"".join(self.kept), peer_of(self.inside)
        refused = self.inside.refused if isinstance(self.inside, UdpInTransport) and not data else None
        if refused is not None:
            data, sender = refused
        where = f" from {sender}" if sender else ""
        if not data:
            return f"nothing came over {self.name}: check that the other side is on and sends here{self._wiring()}"
        sentences, messages = sentence_names(data), message_names(data, self.is_stream)
        if self.protocol == "mavlink" and messages:
            return _without_heading(self.name, f"MAVLink{where}", messages, _about_messages(messages))
        if self.protocol == "nmea" and sentences:
            return _without_heading(self.name, f"NMEA 0183{where}", sentences, _about_sentences(sentences))
        if self.protocol in NETWORKS and (groups := group_names(data, self.protocol)):
            return _without_heading(self.name, f"NMEA 2000{where}", groups, _about_groups(groups))
        if sentences and self.protocol != "nmea":
            return f"NMEA 0183 ({_listed(sentences)}) came over {self.name}{where}: {self._instead('nmea')}"
        if messages and self.protocol != "mavlink":
            return f"MAVLink ({_listed(messages)}) came over {self.name}{where}: {self._instead('mavlink')}"
        came = f"{max(self.count, len(data))} bytes that mean nothing came over {self.name}{where}"
        other = "what is plugged in there" if self._is_serial() else "which program sends there"
        return f"{came}: check {'the baud rate and ' if self._is_serial() else ''}{other}"

    def _is_serial(self) -> bool:
        return self.is_stream and hasattr(self.inside, "baud")

    def _wiring(self) -> str:
        return ", and the wiring (RX to TX)" if self._is_serial() else ""

    def _instead(self, protocol: str) -> str:
        """Return the URL that reads what comes."""
        scheme, rest = split_scheme(self.name)
        medium = SCHEMES[scheme][1]
        same = [name for name, (speaks, over) in SCHEMES.items() if (speaks, over) == (protocol, medium)]
        return f"write --link {same[0]}:{rest}" if same else "give that line its own kind of link"


def sentence_names(data: bytes) -> Counter[str]:
    """Return the NMEA 0183 sentences in `data` by name, whatever their checksums; none where it is no text of them."""
    found = Counter(match[1].decode() for match in SENTENCE.finditer(data))
    return found if found.total() >= SENTENCES_LEAST or data.count(b"$") == found.total() > 0 else Counter()


def message_names(data: bytes, is_stream: bool = True) -> Counter[str]:
    """Return the MAVLink messages in `data` by name."""
    found = Counter(message.get_type() for message in MavlinkCodec(is_stream=True).decode(data))
    return Counter({name: count for name, count in found.items() if name != "BAD_DATA"})


def group_names(data: bytes, form: str) -> Counter[str]:
    """Return the groups of NMEA 2000 in `data`, of those that are read."""
    from autopilot.links.n2k.link import FORMS

    return Counter(str(message.group) for message in FORMS[form]().feed(0.0, data))


def came(transports: Iterable[RecordingTransport]) -> str:
    """Return what came over each line, as a sentence."""
    return "; ".join(each.words for each in transports)


def _listed(names: Counter[str]) -> str:
    shown = [name for name, _ in names.most_common(NAMES_MOST)]
    return ", ".join([*shown, *(["..."] if len(names) > len(shown) else [])])


def _without_heading(name: str, what: str, names: Counter[str], advice: str) -> str:
    return f"{names.total()} messages of {what} came over {name} ({_listed(names)}), no heading among them: {advice}"


def _about_sentences(names: Counter[str]) -> str:
    if any(name in names for name in ("HDT", "THS")):
        return "their fields are empty, marked invalid or simulated, or their checksums wrong; look at the compass"
    if any(name in names for name in MAGNETIC):
        return (
            "a magnetic heading needs the variation: set sensors.variation_deg, send RMC or HDG with it, or set "
            "sensors.magnetic: true to steer magnetic courses"
        )
    return f"let the compass send {', '.join(HEADING_SENTENCES)}"


def _about_groups(names: Counter[str]) -> str:
    if "127250" in names:
        return (
            "a magnetic heading needs the variation: set sensors.variation_deg, let the GPS send 127258, or set "
            "sensors.magnetic: true to steer magnetic courses"
        )
    return "let the compass send 127250"


def _about_messages(names: Counter[str]) -> str:
    if MAVLINK_HEADING in names:
        return "the vehicle's attitude is not valid yet, or it is another vehicle's; see --vehicle-system"
    if "HEARTBEAT" in names:
        return f"the vehicle sends no {MAVLINK_HEADING}; check its stream rates and that it hears us"
    return "there is no vehicle's HEARTBEAT; check which program sends there"
