"""Norrbin as a node of an NMEA 2000 network: its address, and what every node answers. Pure; time is an argument.

    60928 address claim: the node with the lower NAME keeps a contested address, the other moves or falls silent
    65240 commanded address: the node with that NAME claims the address it is given
    59904 request: answered, or refused by 59392        126208 group function: request, command, acknowledge
    126993 heartbeat                                    126996 product   126998 configuration   126464 groups

Source: address claim after SAE J1939-81; fields of the NAME and of the messages after canboat's canboat.json. A node
that has claimed waits 250 ms for objections before it says anything else; before that it asks who is there, and waits
as long for their answers, so that it wants no address that is taken.

Group function: what one node asks of another, and how it is acknowledged.

    0 request: send a group, at an interval     1 command: set fields of a group    2 acknowledge
    3 read fields    4 its reply    5 write fields    6 its reply

The pilot's alarms stand on the displays of the network: alert, its text, and a display's acknowledgement.

    126983 alert: kind, priority, state, who has it        126985 its text        126984 the answer of a display

The kinds are those of IEC 62923: emergency alarm, alarm, warning, caution. An alarm has a number by its name, always
the same; every time that it comes anew counts as one more occurrence.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple

from autopilot.links.n2k.packets import (
    ACKNOWLEDGEMENT,
    ADDRESS_CLAIM,
    ALERT,
    ALERT_TEXT,
    COMMANDED_ADDRESS,
    CONFIGURATION,
    CONTROL,
    EVERYBODY,
    GROUP_FUNCTION,
    GROUPS,
    HEARTBEAT,
    LAYOUTS,
    OVERBOARD,
    PRODUCT,
    REQUEST,
    RUDDER,
    Message,
    encoded,
    fixed_text,
    text,
)
from autopilot.signals import AlarmState, Tick
from autopilot.supervision.alarms import CATALOGUE, Priority, kind_of
from autopilot.supervision.panel import sentence_of

ASK, COMMAND, ACKNOWLEDGE, READ, WRITE = 0, 1, 2, 3, 5
DONE, UNKNOWN_GROUP, NOT_NOW, DENIED, UNSUPPORTED, NO_READ_OR_WRITE = 0, 1, 2, 3, 4, 6
"""Codes of the group as a whole."""
FIXED_INTERVAL, FIXED_PRIORITY, TOO_OFTEN = 1, 1, 2
"""Codes of the interval, or of the priority, that is asked for."""
NO_SUCH_FIELD, TEMPORARY, OUT_OF_RANGE, FIELD_DENIED, FIELD_UNSUPPORTED = 1, 2, 3, 4, 5
"""Codes of a field."""
AS_IS, AS_BY_DEFAULT = 0xFFFFFFFF, 0xFFFFFFFE
"""Intervals that ask for no change, or for the usual one."""
PRIORITIES_AS_IS = (8, 9, 15)
"""Leave unchanged, the usual one, none given."""


class GroupFunction(NamedTuple):
    """What is asked: kind, group, interval [ms] of a request, priority of a command, number of the fields named.

    pairs: index and bits of the fields of a command whose group is in LAYOUTS; None where they do not fit the data.
    """

    kind: int
    group: int
    interval: int = AS_IS
    priority: int = 8
    named: int = 0
    pairs: tuple[tuple[int, int], ...] | None = None


def group_function(data: bytes) -> GroupFunction | None:
    """Return what a message asks; None where it is too short."""
    if len(data) < 5:
        return None
    kind, group = data[0], int.from_bytes(data[1:4], "little")
    if kind == ASK and len(data) >= 11:
        return GroupFunction(kind, group, int.from_bytes(data[4:8], "little"), named=data[10])
    if kind == COMMAND and len(data) >= 6:
        return GroupFunction(kind, group, priority=data[4] & 15, named=data[5], pairs=_pairs(group, data[5], data[6:]))
    return GroupFunction(kind, group) if kind in (READ, WRITE) else None


def _pairs(group: int, count: int, data: bytes) -> tuple[tuple[int, int], ...] | None:
    """Return index and bits of each field; what is behind one that the group has not cannot be taken apart."""
    layout, found, at = LAYOUTS.get(group), [], 0
    if layout is None:
        return None
    for _ in range(count):
        if at >= len(data) or not 0 < data[at] <= len(layout):
            return None
        bits = layout[data[at] - 1].bits
        end = at + 1 + (bits + 7) // 8
        if end > len(data):
            return None
        found.append((data[at], int.from_bytes(data[at + 1 : end], "little") & (1 << bits) - 1))
        at = end
    return tuple(found)


def acknowledgement(group: int, code: int, other: int = DONE, fields: Sequence[int] = ()) -> bytes:
    """Return the data of an acknowledgement: codes of the group, of interval or priority, and of each field."""
    nibbles = [*fields, *([15] if len(fields) % 2 else [])]
    packed = bytes(low | high << 4 for low, high in zip(nibbles[::2], nibbles[1::2], strict=True))
    return bytes((ACKNOWLEDGE,)) + group.to_bytes(3, "little") + bytes((code | other << 4, len(fields))) + packed


FIRST_ADDRESS, LOWEST, HIGHEST = 204, 128, 251
"""The address claimed first, and those claimed where it is taken: the lowest free one."""
NO_ADDRESS = 254
ANSWERS_S = OBJECTIONS_S = 0.25
AGAIN_S = 10.0
"""Without an address it is asked so long afterwards who is there now."""
LAST_GROUP = (1 << 18) - 1
"""Parameter groups are numbered in 18 bits; what is asked for beyond them is nothing that could even be refused."""
UNIQUE_MOST = 0x1FFFFF
NAME = 1 << 63 | 4 << 60 | 40 << 49 | 150 << 40 | 2046 << 21
"""Arbitrary address capable, marine, class 40 "steering and control surfaces", function 150 "autopilot", maker 2046
(none of the registered ones); the unique number comes below."""
PILOT = (40, 150)
"""Class and function of an autopilot."""
SENT = (ACKNOWLEDGEMENT, REQUEST, ADDRESS_CLAIM, GROUP_FUNCTION, GROUPS, HEARTBEAT, PRODUCT, CONFIGURATION)
HEARTBEAT_S, HEARTBEAT_LEAST_S = 60.0, 1.0
COUNTS = 253
"""Heartbeats are counted from 0 to 252."""
NAK = 1
VERSION = 2100
"""Of NMEA 2000, in thousandths: 2.100, the one whose messages these are."""
UNKNOWN = 0xFFFF


class Device(NamedTuple):
    """What tells this node from others: its unique number, of 21 bits, and the version of the program."""

    unique: int = 1
    version: str = ""


Commanded = Callable[[float, int, tuple[tuple[int, int], ...]], tuple[int, list[int]]]
"""Carries a command of 127237 out: time [s], whose, index and bits of its fields; returns the code, and that of each
field."""


class Node:
    """The node. `current` returns the newest 127237 or 127245 that was sent; `reads`: groups that are listened to.

    Attributes:
        address: ours, NO_ADDRESS where every one was taken: then nothing may be sent but that.
        known: the NAME of each other node, by its address.
    """

    def __init__(
        self, device: Device, reads: tuple[int, ...], current: Callable[[int], bytes | None], commanded: Commanded
    ) -> None:
        self.address = FIRST_ADDRESS
        self.name = NAME | device.unique & UNIQUE_MOST
        self.known: dict[int, int] = {}
        self._device, self._reads, self._current, self._commanded = device, reads, current, commanded
        self._lost: set[int] = set()
        self._began = self._ready = math.inf
        self._period, self._next, self._count = HEARTBEAT_S, -math.inf, 0

    def is_ready(self, now: float) -> bool:
        """Return whether more than claims may be sent at `now` [s]."""
        return self.address != NO_ADDRESS and now >= self._ready

    def is_pilot(self, address: int) -> bool:
        """Return whether a node has said that it is an autopilot."""
        name = self.known.get(address, 0)
        return (name >> 49 & 127, name >> 40 & 255) == PILOT

    def due(self, now: float) -> list[Message]:
        """Return what falls due at `now` [s]: the question who is there and the claim at the start; heartbeats."""
        if self._began == math.inf:
            self._began = now
            return [Message(REQUEST, ADDRESS_CLAIM.to_bytes(3, "little"), NO_ADDRESS)]
        if self._ready == math.inf:
            return [self._take_address(now)] if now >= self._began + ANSWERS_S else []
        if self.address == NO_ADDRESS and now >= self._ready + AGAIN_S:
            # who had them may be gone, or never was
            self.known.clear()
            self._lost.clear()
            self._began, self._ready = now, math.inf
            return [Message(REQUEST, ADDRESS_CLAIM.to_bytes(3, "little"), NO_ADDRESS)]
        if now < self._next or not self.is_ready(now):
            return []
        self._next = now + self._period
        self._count = (self._count + 1) % COUNTS
        return [self._compose(HEARTBEAT, self._heartbeat(), 7)]

    def take(self, now: float, message: Message) -> list[Message]:
        """Return what is to be said to a message at `now` [s]."""
        if message.group == ADDRESS_CLAIM:
            return self._claimed(now, message)
        if message.group == COMMANDED_ADDRESS:
            return self._moved(now, message)
        if message.destination not in (self.address, EVERYBODY) or self._ready == math.inf:
            return []
        if message.group == REQUEST and len(message.data) >= 3:
            return self._requested(now, message, int.from_bytes(message.data[:3], "little"))
        if message.group == GROUP_FUNCTION and self.is_ready(now):
            return self._asked(now, message)
        return []

    def _claim(self) -> Message:
        return Message(ADDRESS_CLAIM, struct.pack("<Q", self.name), self.address)

    def _claimed(self, now: float, message: Message) -> list[Message]:
        if len(message.data) != 8:
            return []
        (name,) = struct.unpack("<Q", message.data)
        # our own claim may come back from a gateway
        if name == self.name or message.source > HIGHEST:
            return []
        is_ours = message.source == self.address and self._ready != math.inf
        if not is_ours or name < self.name:
            self.known[message.source] = name
        if not is_ours:
            return []
        if name < self.name:
            self._lost.add(self.address)
            return [self._take_address(now)]
        return [self._claim()]

    def _moved(self, now: float, message: Message) -> list[Message]:
        """Claim the address that a configuring tool gives to our NAME; who has it objects, as to any claim."""
        if len(message.data) != 9 or self._ready == math.inf:
            return []
        name, address = struct.unpack("<QB", message.data)
        if name != self.name or address > HIGHEST or address == self.address:
            return []
        self._lost.discard(address)
        self.address, self._ready = address, now + OBJECTIONS_S
        return [self._claim()]

    def _take_address(self, now: float) -> Message:
        """Claim the first address, or where that is taken the lowest free one, or say that there is none."""
        taken = self._lost | set(self.known)
        free = (each for each in (FIRST_ADDRESS, *range(LOWEST, HIGHEST + 1)) if each not in taken)
        self.address, self._ready = next(free, NO_ADDRESS), now + OBJECTIONS_S
        return self._claim()

    def _requested(self, now: float, message: Message, group: int) -> list[Message]:
        if group == ADDRESS_CLAIM:
            return [self._claim()]
        if not self.is_ready(now):
            return []
        if group > LAST_GROUP:
            return []
        found = self._answers(group)
        if not found and message.destination != EVERYBODY:
            refusal = encoded(ACKNOWLEDGEMENT, {"control": NAK, "pgn": group})
            return [self._compose(ACKNOWLEDGEMENT, refusal, 6, message.source)]
        return found

    def _answers(self, group: int) -> list[Message]:
        """Return the messages of a group, as they are now; none of one that is not sent."""
        if group == PRODUCT:
            return [self._compose(PRODUCT, product(self._device))]
        if group == CONFIGURATION:
            texts = ("", "", "Norrbin, an open-source autopilot")
            return [self._compose(CONFIGURATION, b"".join(text(each) for each in texts))]
        if group == GROUPS:
            lists = (*SENT, ALERT, ALERT_TEXT, OVERBOARD, CONTROL, RUDDER), self._reads
            packed = [b"".join(each.to_bytes(3, "little") for each in groups) for groups in lists]
            return [self._compose(GROUPS, bytes((kind,)) + each) for kind, each in enumerate(packed)]
        if group == HEARTBEAT:
            return [self._compose(HEARTBEAT, self._heartbeat(), 7)]
        current = self._current(group) if group in (CONTROL, RUDDER, OVERBOARD) else None
        return [] if current is None else [self._compose(group, current, 2)]

    def _heartbeat(self) -> bytes:
        return encoded(
            HEARTBEAT,
            {
                "dataTransmitOffset": self._period,
                "sequenceCounter": self._count,
                "controller1State": "Error Active",
                "equipmentStatus": "Operational",
            },
        )

    def _asked(self, now: float, message: Message) -> list[Message]:
        """Answer a group function. What everybody is asked is answered by who has it, and acknowledged by nobody."""
        asked = group_function(message.data)
        if asked is None:
            return []
        group, is_for_all = asked.group, message.destination == EVERYBODY
        code, other, fields, said = DONE, DONE, [DONE] * asked.named, list[Message]()
        if asked.kind == ASK:
            said = self._answers(group) if group != ADDRESS_CLAIM else [self._claim()]
            other = self._paced(group, asked.interval)
            if not said:
                code, fields = UNKNOWN_GROUP, [FIELD_UNSUPPORTED] * asked.named
            elif asked.named:
                # nobody here has several of a group to choose from
                code, fields, said = UNSUPPORTED, [FIELD_UNSUPPORTED] * asked.named, []
        elif is_for_all:
            return []
        elif asked.kind != COMMAND:
            code = NO_READ_OR_WRITE
        elif group != CONTROL:
            code, fields = UNKNOWN_GROUP, [FIELD_UNSUPPORTED] * asked.named
        elif asked.pairs is None:
            code, fields = UNSUPPORTED, [NO_SUCH_FIELD] * asked.named
        else:
            code, fields = self._commanded(now, message.source, asked.pairs)
            other = DONE if asked.priority in PRIORITIES_AS_IS else FIXED_PRIORITY
        if is_for_all:
            return said
        answer = acknowledgement(group, code, other, fields)
        return [self._compose(GROUP_FUNCTION, answer, 3, message.source), *said]

    def _paced(self, group: int, interval: int) -> int:
        """Take the interval [ms] asked for, of heartbeats alone; return the code of its acknowledgement."""
        if interval in (AS_IS, AS_BY_DEFAULT):
            if group == HEARTBEAT and interval == AS_BY_DEFAULT:
                self._period = HEARTBEAT_S
            return DONE
        if group != HEARTBEAT:
            return FIXED_INTERVAL
        seconds = interval / 1000.0
        if not HEARTBEAT_LEAST_S <= seconds <= HEARTBEAT_S:
            return TOO_OFTEN if 0.0 < seconds < HEARTBEAT_LEAST_S else FIXED_INTERVAL
        self._period = seconds
        self._next = -math.inf
        return DONE

    def _compose(self, group: int, data: bytes, priority: int = 6, destination: int = EVERYBODY) -> Message:
        return Message(group, data, self.address, destination, priority)


def product(device: Device) -> bytes:
    """Return the data of 126996; Norrbin has no product code and no certificate, and takes no power from the bus."""
    texts = ("Norrbin", device.version, "autopilot", f"{device.unique & UNIQUE_MOST:06X}")
    return struct.pack("<HH", VERSION, UNKNOWN) + b"".join(fixed_text(each, 32) for each in texts) + b"\xff\x00"


KINDS = {Priority.EMERGENCY: 1, Priority.ALARM: 2, Priority.WARNING: 5, Priority.CAUTION: 8}
NAVIGATIONAL = 0
NORMAL, ACTIVE, ACKNOWLEDGED, AWAITING = 1, 2, 4, 5
"""States of an alert; the last: it is over, and nobody has acknowledged it."""
CAN_BE_ACKNOWLEDGED, IS_ACKNOWLEDGED = 1 << 4, 1 << 1
AUTOMATIC, EXCEEDED, WITHIN = 1, 1, 0
ENGLISH = 1
NOBODY = 0xFFFFFFFFFFFFFFFF
HEAD = struct.Struct("<BBBHQBBB")
REPEATED_S = 5.0
OCCURRENCES = 250
TEXT_MOST = 120


class _Alert(NamedTuple):
    """One alarm as it was sent last: its kind and words, occurrence, state, and when [s]."""

    kind: int
    words: str
    occurrence: int
    state: int
    sent: float


class Alerts:
    """What is said of the alarms, under the NAME of our node."""

    def __init__(self, name: int) -> None:
        self._name = name
        self._alerts: dict[str, _Alert] = {}

    def due(self, tick: Tick) -> list[tuple[int, bytes]]:
        """Return groups and data that fall due with `tick`: at every change at once, and again while an alarm lasts."""
        said: list[tuple[int, bytes]] = []
        states = dict(zip((each.name for each in tick.alarms), tick.alarm_states, strict=False))
        present = {each.name: each for each in tick.alarms}
        for name, event in present.items():
            before = self._alerts.get(name)
            is_new = before is None or before.state == NORMAL
            is_heard = states.get(name) is AlarmState.ACKNOWLEDGED
            state = ACKNOWLEDGED if is_heard else AWAITING if event.is_past else ACTIVE
            if before is not None and before.state == state and tick.now - before.sent < REPEATED_S:
                continue
            occurrence = 1 if before is None else before.occurrence % OCCURRENCES + is_new
            alert = _Alert(KINDS[kind_of(event).priority], sentence_of(event), occurrence, state, tick.now)
            self._alerts[name] = alert
            said.append((ALERT, self._alert(name, alert)))
            if is_new:
                words = text(alert.words[:TEXT_MOST]) + text("")
                said.append((ALERT_TEXT, self._head(name, alert) + bytes((ENGLISH,)) + words))
        for name, alert in self._alerts.items():
            if name not in present and alert.state != NORMAL:
                self._alerts[name] = over = alert._replace(state=NORMAL, sent=tick.now)
                said.append((ALERT, self._alert(name, over)))
        return said

    def acknowledged(self, data: bytes) -> str:
        """Return the name of the alarm that a response acknowledges or silences; "" where it is none of ours."""
        if len(data) < HEAD.size + 9 or data[HEAD.size + 8] & 3 > 1:
            return ""
        number, owner = HEAD.unpack_from(data)[3:5]
        return next((each for each in self._alerts if owner == self._name and number_of(each) == number), "")

    def _head(self, name: str, alert: _Alert) -> bytes:
        return HEAD.pack(alert.kind | NAVIGATIONAL << 4, 0, 0, number_of(name), self._name, 0, 0, alert.occurrence)

    def _alert(self, name: str, alert: _Alert) -> bytes:
        flags = 0xC0 | CAN_BE_ACKNOWLEDGED | (IS_ACKNOWLEDGED if alert.state == ACKNOWLEDGED else 0)
        threshold = WITHIN if alert.state in (NORMAL, AWAITING) else EXCEEDED
        tail = struct.pack("<BQBBB", flags, NOBODY, AUTOMATIC | threshold << 4, 100, alert.state)
        return self._head(name, alert) + tail


def number_of(name: str) -> int:
    """Return the number of an alarm in 16 bits, from 1 to 65000."""
    return CATALOGUE[name].number % 65000 + 1
