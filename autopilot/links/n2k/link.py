"""The link to an NMEA 2000 network: a session carried over a CAN bus (python-can, extra `n2k`) or through a gateway.

How gateways write the messages: one class a form, one line in FORMS.

    ydwg       17:33:21.107 R 19F51323 01 2F 30 70       Yacht Devices RAW: frames; sent without time and direction
    actisense  DLE STX 93 length data checksum DLE ETX   NGT-1 and its like: messages received (93) and to be sent (94)
    n2k-ascii  A173321.107 23FF7 1F513 012F3070002F30709F   Actisense W2K-1, N2K ASCII: source, destination, priority

A gateway of the first kind passes on the addresses that it is given, so that Norrbin is the node. One of the others is
the node itself: it has the address, claims it and answers for it.

Sources: Yacht Devices, manual of the YDWG-02, appendix E; canboat, actisense-serial (framing, start-up message);
Actisense, "NMEA 2000 ASCII output format" of the W2K-1.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from typing import Any

from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.base import LinkError, SessionLink, Transport
from autopilot.links.n2k.packets import EVERYBODY, FAST, IDENTIFIER_MOST, Frame, Framing, Message, is_addressed
from autopilot.links.n2k.session import READ, Helm, N2kSession, N2kSettings
from autopilot.links.north import Variation

LINE_END = b"\r\n"
LINE_MOST = 512
"""Characters of a line; the longest packet has 223 bytes."""
PAIRS = r"(?:[0-9A-Fa-f]{2})"
RAW_LINE = re.compile(rf"\d\d:\d\d:\d\d\.\d{{1,6}} ([RT]) ([0-9A-Fa-f]{{8}})((?: {PAIRS}){{0,8}})", re.ASCII)
ASCII_LINE = re.compile(
    rf"A\d{{6}}\.\d{{1,6}} ({PAIRS})({PAIRS})([0-9A-Fa-f]) ([0-9A-Fa-f]{{4,6}}) ({PAIRS}{{0,223}})", re.ASCII
)


class Form(ABC):
    """A way of writing messages. is_node: whether Norrbin is the node; damaged: lines or packets that were none."""

    is_node = False

    def __init__(self) -> None:
        self.damaged = 0

    def begin(self) -> bytes:
        """Return what is sent at the beginning."""
        return b""

    @abstractmethod
    def feed(self, now: float, data: bytes) -> list[Message]:
        """Return the messages that `data`, which came at `now` [s] and may be cut anywhere, completes. Never raises."""

    @abstractmethod
    def encode(self, message: Message) -> bytes:
        """Return a message as it is sent."""


class _Lines(Form):
    """A form that comes in lines; of one without end no more than `LINE_MOST` characters are kept."""

    def __init__(self) -> None:
        super().__init__()
        self._rest = b""

    def feed(self, now: float, data: bytes) -> list[Message]:
        """Return the messages that `data` completes."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest if len(rest) <= LINE_MOST else b""
        whole = (line.decode("ascii", "replace").strip() for line in lines if len(line) <= LINE_MOST and line.strip())
        return [message for line in whole if (message := self._taken(now, line)) is not None]

    @abstractmethod
    def _taken(self, now: float, line: str) -> Message | None:
        """Return the message that a line completes, None where it completes none; what cannot be read is counted."""


class YachtDevices(_Lines):
    """RAW text. What comes back with a T is what we, or another program, have sent: it is not heard."""

    is_node = True

    def __init__(self) -> None:
        super().__init__()
        self._framing = Framing(FAST, READ)

    def _taken(self, now: float, line: str) -> Message | None:
        parts = RAW_LINE.fullmatch(line)
        if parts is None or int(parts[2], 16) > IDENTIFIER_MOST:
            self.damaged += 1
            return None
        return self._framing.take(now, Frame(int(parts[2], 16), bytes.fromhex(parts[3]))) if parts[1] == "R" else None

    def encode(self, message: Message) -> bytes:
        """Return its frames, a line each."""
        frames = self._framing.frames(message)
        return b"".join(f"{each.identifier:08X} {each.data.hex(' ').upper()}\r\n".encode() for each in frames)


DLE, STX, ETX = 0x10, 0x02, 0x03
RECEIVED, TO_SEND, TO_GATEWAY = 0x93, 0x94, 0xA1
ALL_MESSAGES = bytes((0x11, 0x02, 0x00))
"""Operating mode of the NGT-1: every message is passed on."""
PACKET_BYTES = 260


class Actisense(Form):
    """The binary packets of the NGT-1; a byte DLE in a packet is sent twice, and all its bytes add up to 0."""

    def __init__(self) -> None:
        super().__init__()
        self._packet: bytearray | None = None
        self._is_escaped = False

    def begin(self) -> bytes:
        """Return what has every message passed on."""
        return framed(TO_GATEWAY, ALL_MESSAGES)

    def feed(self, now: float, data: bytes) -> list[Message]:
        """Return the messages that `data` completes."""
        found: list[Message] = []
        for byte in data:
            if not self._is_escaped:
                self._is_escaped = byte == DLE
                if self._packet is not None and not self._is_escaped:
                    self._packet.append(byte)
                    if len(self._packet) > PACKET_BYTES:
                        self._packet, self.damaged = None, self.damaged + 1
                continue
            self._is_escaped = False
            if byte == STX:
                self.damaged += self._packet is not None
                self._packet = bytearray()
            elif byte == DLE and self._packet is not None:
                self._packet.append(byte)
            elif self._packet is not None:
                packet, self._packet = bytes(self._packet), None
                if byte == ETX and len(packet) >= 3 and sum(packet) & 0xFF == 0 and packet[1] == len(packet) - 3:
                    message = _received(packet[0], packet[2:-1])
                    found += [] if message is None else [message]
                else:
                    self.damaged += 1
        return found

    def encode(self, message: Message) -> bytes:
        """Return the packet; the gateway puts its own address in."""
        group = message.group.to_bytes(3, "little")
        head = bytes((message.priority,)) + group + bytes((message.destination, len(message.data)))
        return framed(TO_SEND, head + message.data)


def framed(command: int, data: bytes) -> bytes:
    """Return the packet of a command with its data."""
    body = bytes((command, len(data))) + data
    body += bytes((-sum(body) & 0xFF,))
    return bytes((DLE, STX)) + body.replace(b"\x10", b"\x10\x10") + bytes((DLE, ETX))


def _received(command: int, data: bytes) -> Message | None:
    """Return the message in a packet; None where it is another: priority, group, addresses, time, length, data."""
    if command != RECEIVED or len(data) < 11 or data[10] != len(data) - 11:
        return None
    group = int.from_bytes(data[1:4], "little")
    return _addressed(group, data[11:], data[5], data[4], data[0] & 7)


def _addressed(group: int, data: bytes, source: int, destination: int, priority: int) -> Message | None:
    if group not in READ:
        return None
    return Message(group, data, source, destination if is_addressed(group) else EVERYBODY, priority)


class ActisenseAscii(_Lines):
    """N2K ASCII."""

    def _taken(self, now: float, line: str) -> Message | None:
        parts = ASCII_LINE.fullmatch(line)
        if parts is None:
            self.damaged += 1
            return None
        source, destination, priority, group = (int(parts[number], 16) for number in range(1, 5))
        return _addressed(group, bytes.fromhex(parts[5]), source, destination, priority & 7)

    def encode(self, message: Message) -> bytes:
        """Return its line; the time is the gateway's own affair."""
        head = f"A000000.000 {message.source:02X}{message.destination:02X}{message.priority:X}"
        return f"{head} {message.group:05X} {message.data.hex().upper()}\r\n".encode()


FORMS: dict[str, type[Form]] = {"ydwg": YachtDevices, "actisense": Actisense, "n2k-ascii": ActisenseAscii}
"""By what is spoken on a link."""


def is_spoken(form: str, datagram: bytes) -> bool:
    """Return whether a datagram is of a form: some of it is a message, or nothing of it is damaged."""
    reader = FORMS[form]()
    return bool(reader.feed(0.0, datagram + LINE_END)) or (reader.damaged == 0 and bool(datagram.strip()))


FRAMES_MOST = 500
"""Frames taken in one `receive`, so that a busy bus cannot hold the loop."""
EXTRA = "install Norrbin with its extra n2k: pip install '.[n2k]'"


def open_bus(text: str, interface: str, channel: str) -> Any:
    """Return python-can's bus of `interface` and `channel`. Raises LinkError with one sentence."""
    try:
        import can
    except ImportError as error:
        raise LinkError(f"link {text!r}: a CAN bus needs the package python-can; {EXTRA}") from error
    try:
        return can.Bus(interface=interface, channel=channel)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise LinkError(
            f"link {text!r}: the CAN bus cannot be opened: {error}; check that it is up "
            f"(ip link set {channel} up type can bitrate 250000) and that {interface} is one of {known}"
        ) from error


class CanBus:
    """The frames of a bus of python-can."""

    def __init__(self, name: str, bus: Any) -> None:
        from can import Message as CanFrame

        self.name, self._bus, self._make = name, bus, CanFrame

    def fileno(self) -> int:
        """Return the bus's descriptor, or -1 where it has none (virtual)."""
        try:
            return int(self._bus.fileno())
        except (NotImplementedError, OSError):
            return -1

    def frames(self) -> list[Frame]:
        """Return the frames that wait, at most FRAMES_MOST of them looked at; LinkError when the bus is gone."""
        found: list[Frame] = []
        for _ in range(FRAMES_MOST):
            try:
                frame = self._bus.recv(timeout=0.0)
            except Exception as error:
                # python-can's drivers raise errors of their own beside its CanError
                raise LinkError(f"{self.name}: the CAN bus is gone: {error}; plug it in and start again") from error
            if frame is None:
                break
            if frame.is_extended_id and not frame.is_error_frame and not frame.is_remote_frame:
                found.append(Frame(frame.arbitration_id, bytes(frame.data)))
        return found

    def put(self, frame: Frame) -> bool:
        """Send a frame; False where the bus does not take it: its queue is full, or nobody else is there."""
        made = self._make(arbitration_id=frame.identifier, data=frame.data, is_extended_id=True)
        try:
            self._bus.send(made, timeout=0.0)
        except Exception:
            return False  # seen by a rudder that does not follow
        return True

    def forget_peer(self) -> None:
        """Do nothing: a bus is open to all."""

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


class BusLine(CanBus):
    """The messages of a bus. `unsent`: those that it did not take.

    is_node: whether Norrbin is the node of the network there.
    """

    is_node = True

    def __init__(self, name: str, bus: Any) -> None:
        super().__init__(name, bus)
        self.unsent = 0
        self._framing = Framing(FAST, READ)

    def receive(self, now: float) -> list[Message]:
        """Return the messages that have arrived by `now` [s]; LinkError when the bus is gone."""
        return [found for frame in self.frames() if (found := self._framing.take(now, frame)) is not None]

    def send(self, message: Message) -> bool:
        """Send the frames of a message; False where the bus does not take one."""
        is_sent = all(map(self.put, self._framing.frames(message)))
        self.unsent += not is_sent
        return is_sent


class GatewayLine:
    """A gateway on a transport, in one of `autopilot.links.n2k.link.FORMS`."""

    def __init__(self, transport: Transport, form: Form) -> None:
        self.name, self.is_node = transport.name, form.is_node
        self.unsent = 0
        self._transport, self._form = transport, form
        self.fileno, self.forget_peer, self.close = transport.fileno, transport.forget_peer, transport.close
        self._has_begun = False

    def receive(self, now: float) -> list[Message]:
        """Return the messages that have arrived by `now` [s]; LinkError when the transport is gone."""
        if not self._has_begun:
            self._has_begun = not (beginning := self._form.begin()) or self._transport.send(beginning)
        # a datagram ends its line
        ends = b"" if self._transport.is_stream else LINE_END
        return [message for chunk in self._transport.receive() for message in self._form.feed(now, chunk + ends)]

    def send(self, message: Message) -> bool:
        """Send a message."""
        is_sent = self._transport.send(self._form.encode(message))
        self.unsent += not is_sent
        return is_sent


class N2kLink(SessionLink[Message]):
    """A `Link` over NMEA 2000."""

    def __init__(
        self,
        line: BusLine | GatewayLine,
        settings: N2kSettings = N2kSettings(),  # noqa: B008 - immutable
        guide: PlotterGuide | None = None,
        helm: Helm | None = None,
        variation: Variation | None = None,
    ) -> None:
        self.session = N2kSession(line.name, settings, line.is_node, guide, helm, variation)
        super().__init__(line, self.session, line.receive)
