"""One tick as bytes and back, exactly: every float keeps its 64 bits, so that a log replays bit for bit.

Little-endian. A record is its kind (one byte) and its body: HEADER is JSON text, TICK is described by the
structures below. Sources and reasons are UTF-8 with a length byte before them. Alarms are events by name.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.files.printable import printable
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    AlarmSample,
    AlarmState,
    CompassSample,
    ConditionSample,
    CourseSample,
    HeadingSample,
    HelmCause,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    RateSample,
    Reference,
    RollSample,
    RudderCommand,
    RudderSample,
    Sample,
    Siren,
    SpeedSample,
    SupervisorState,
    ThrusterSample,
    ThrustSample,
    Tick,
    WindSample,
)
from autopilot.supervision.alarms import CATALOGUE, OTHER
from autopilot.supervision.panel import FORMS

HEADER = 1
HEADER_MOST = 1 << 20
"""Bytes of a header; ours hold a vessel file and little else."""
VESSEL = 3
"""A vessel file's text, in force from the next tick on."""
TICK = 7
"""2 and 4 to 6 were ticks before the first release."""
TICK_WITH_THRUSTER = 8
"""The same with the share of a bow thruster that runs behind its outputs."""
TICKS = (TICK, TICK_WITH_THRUSTER)

_INPUTS = struct.Struct("<IdBdddIB")
"""number, now, order kind (with LED where a guide leads), order heading, rudder, heading change, serial, count of
samples."""
_OUTPUTS = struct.Struct("<7d?4d3dd?dBBB")
"""state: heading, rate, speed, rudder, bias, age, time; valid; its four of the waves; reference; demand; engaged;
angle; mode; state of the supervisor; siren."""
_SAMPLE = struct.Struct("<Bdd")
_NUMBER = struct.Struct("<d")
_LED = 0x80
_READ_AGAIN: dict[str, tuple[Callable[[object], bool], str]] = {
    "part": (lambda value: type(value) is int and 1 <= value < 1 << 32, "a whole number from 1"),
    "first": (lambda value: type(value) is int and 0 <= value < 1 << 32, "a whole number from 0"),
    "run": (lambda value: isinstance(value, str), "a text"),
    "vessel": (lambda value: isinstance(value, str), "a text"),
    "law": (lambda value: value is None or isinstance(value, str), "a text or null"),
}
"""What a header is read again for, and what each may be."""
_UNKNOWN = 0xFF
"""In the place of an alarm's state that nobody knows."""


def encode_header(fields: dict[str, Any]) -> bytes:
    """Return the record that opens a log: what is needed to build the pilot again."""
    return bytes([HEADER]) + json.dumps(fields, ensure_ascii=False, sort_keys=True).encode()


def decode_header(record: bytes) -> dict[str, Any]:
    """Return the fields of a header record. Raises InputError."""
    fields = parse_json(record[1:], "the log's header is damaged", HEADER_MOST)
    if not isinstance(fields, dict):
        raise InputError("the log's header is damaged: not a mapping")
    for name, (is_right, allowed) in _READ_AGAIN.items():
        if name in fields and not is_right(fields[name]):
            said = f"{name} is {printable(fields[name], 20)}, and {allowed} is allowed"
            raise InputError(f"the log's header is damaged: {said}; give another log.")
    return fields


def encode_tick(tick: Tick) -> bytes:
    """Return the record of one tick."""
    order, state, reference = tick.order, tick.state, tick.reference
    thruster = tick.command.thruster
    parts = [
        bytes([TICK_WITH_THRUSTER if thruster else TICK]),
        _INPUTS.pack(
            tick.number,
            tick.now,
            order.kind | (_LED if order.is_led else 0),
            *order[1:5],
            len(tick.samples),
        ),
    ]
    parts.extend(_encode_sample(sample) for sample in tick.samples)
    parts.append(
        _OUTPUTS.pack(
            *state[1:7],
            state.time,
            *state[7:],
            *reference,
            tick.demand,
            tick.command.engaged,
            tick.command.angle,
            tick.mode,
            tick.supervisor,
            tick.siren,
        )
    )
    if thruster:
        parts.append(_NUMBER.pack(thruster))
    alarm_states = tick.alarm_states if len(tick.alarm_states) == len(tick.alarms) else (_UNKNOWN,) * len(tick.alarms)
    parts.extend(bytes([state]) + _encode_event(alarm) for state, alarm in zip(alarm_states, tick.alarms, strict=True))
    return b"".join(parts)


def decode_tick(record: bytes) -> Tick:
    """Return the tick of a record. Raises InputError where it is damaged."""
    try:
        return _decode_tick(record)
    except (struct.error, LookupError, ValueError, OverflowError) as error:
        raise InputError(f"a tick in the log is damaged: {error}; give another log.") from error


def _decode_tick(record: bytes) -> Tick:
    number, now, kind, heading, rudder, change, serial, count = _INPUTS.unpack_from(record, 1)
    place = 1 + _INPUTS.size
    samples: list[Sample] = []
    for _ in range(count):
        sample, place = _decode_sample(record, place)
        samples.append(sample)
    out = _OUTPUTS.unpack_from(record, place)
    place += _OUTPUTS.size
    thruster = 0.0
    if record[0] == TICK_WITH_THRUSTER:
        (thruster,) = _NUMBER.unpack_from(record, place)
        place += _NUMBER.size
    alarms: list[AlarmEvent] = []
    alarm_states: list[int] = []
    while place < len(record):
        alarm_states.append(record[place])
        alarm, place = _decode_event(record, place + 1)
        alarms.append(alarm)
    return Tick(
        number=number,
        now=now,
        samples=tuple(samples),
        order=Order(OrderKind(kind & ~_LED), heading, rudder, change, serial, bool(kind & _LED)),
        state=NavState(out[6], *out[:6], *out[7:12]),
        reference=Reference(*out[12:15]),
        demand=out[15],
        command=RudderCommand(now, out[17], out[16], thruster),
        mode=Mode(out[18]),
        alarms=tuple(alarms),
        supervisor=SupervisorState(out[19]),
        siren=Siren(out[20]),
        alarm_states=() if _UNKNOWN in alarm_states else tuple(AlarmState(state) for state in alarm_states),
    )


def _encode_sample(sample: Sample) -> bytes:
    number, carried, parts = _SAMPLES[type(sample)]
    behind = b"".join(part.write(getattr(sample, name)) for name, part in parts.items()) + _text(sample.source)
    if isinstance(sample, HelmSample):
        # the cause counts up from 1 where the helm is ours, else down from -1
        return _SAMPLE.pack(number, sample.time, (1.0 if sample.available else -1.0) * (1.0 + sample.cause)) + behind
    if isinstance(sample, AlarmSample):
        event = b"" if sample.event is None else _encode_event(sample.event)
        return _SAMPLE.pack(number, sample.time, sample.event is not None) + event + behind
    return _SAMPLE.pack(number, sample.time, getattr(sample, carried, 0.0)) + behind


def _decode_sample(record: bytes, place: int) -> tuple[Sample, int]:
    kind, time, value = _SAMPLE.unpack_from(record, place)
    place += _SAMPLE.size
    made = _TYPES[kind]
    _, carried, parts = _SAMPLES[made]
    fields: dict[str, Any] = {carried: bool(value) if carried in _YES_OR_NO else value} if carried else {}
    if made is HelmSample:
        fields = {"available": value > 0.0, "cause": HelmCause(int(abs(value) - 1.0))}
    elif made is AlarmSample:
        fields["event"], place = _decode_event(record, place) if value else (None, place)
    for name, part in parts.items():
        fields[name], place = part.read(record, place)
    source, place = _read_text(record, place)
    return made(time=time, source=source, **fields), place


_PAST, _ESCALATED, _HAS_REASON = 1, 2, 4


def _encode_event(event: AlarmEvent) -> bytes:
    """Return flags, name, detail and form, and the same of the event that stands behind it."""
    flags = (_PAST if event.is_past else 0) | (_ESCALATED if event.is_escalated else 0)
    behind = b"" if event.because is None else _encode_event(event.because._replace(because=None))
    flags |= _HAS_REASON if behind else 0
    return bytes([flags]) + _text(event.name) + _text(event.detail) + _text(event.form) + behind


def _decode_event(record: bytes, place: int, is_behind: bool = False) -> tuple[AlarmEvent, int]:
    """Return an event; of a kind that is not known, as a newer version may write it, no more than its detail."""
    flags = record[place]
    (name, detail, form), place = _read_texts(record, place + 1, 3)
    if name not in CATALOGUE or (form and form not in FORMS):
        name, detail, form = OTHER, detail or name, ""
    because = None
    if flags & _HAS_REASON:
        if is_behind:
            raise ValueError("an alarm stands behind one that stands behind another")
        because, place = _decode_event(record, place, is_behind=True)
    return AlarmEvent(name, detail, form, because, bool(flags & _PAST), bool(flags & _ESCALATED)), place


_ABSENT = struct.pack("<Q", 0x7FF8_4E4F_4E45_0000)
"""A quiet NaN with a payload of our own stands for None: a NaN that was measured stays a NaN."""


def _optional(value: float | None) -> bytes:
    return _ABSENT if value is None else _NUMBER.pack(value)


def _read_optional(record: bytes, place: int) -> tuple[float | None, int]:
    value, behind = _read_number(record, place)
    return None if math.isnan(value) and record[place:behind] == _ABSENT else value, behind


def _read_number(record: bytes, place: int) -> tuple[float, int]:
    return *_NUMBER.unpack_from(record, place), place + _NUMBER.size


def _text(text: str) -> bytes:
    data = text.encode()[:255]
    return bytes([len(data)]) + data


def _read_texts(record: bytes, place: int, count: int) -> tuple[list[str], int]:
    texts = []
    for _ in range(count):
        text, place = _read_text(record, place)
        texts.append(text)
    return texts, place


def _read_text(record: bytes, place: int) -> tuple[str, int]:
    length = record[place]
    end = place + 1 + length
    if end > len(record):
        raise IndexError("text runs past the end")
    return record[place + 1 : end].decode(errors="replace"), end


class _Part(NamedTuple):
    """How a field is written, and how it is read at a place of a record, with the place behind it."""

    write: Callable[[Any], bytes]
    read: Callable[[bytes, int], tuple[Any, int]]


_REAL, _OPTIONAL, _TEXT = _Part(_NUMBER.pack, _read_number), _Part(_optional, _read_optional), _Part(_text, _read_text)
_FLAG = _Part(lambda value: bytes([value]), lambda record, place: (bool(record[place]), place + 1))
_SAMPLES: dict[type[Any], tuple[int, str, dict[str, _Part]]] = {
    HeadingSample: (0, "heading", {"rate": _OPTIONAL}),
    RateSample: (1, "rate", {}),
    RudderSample: (2, "angle", {"ordered": _FLAG}),
    SpeedSample: (3, "speed", {"over_ground": _FLAG}),
    RollSample: (4, "roll", {"rate": _OPTIONAL}),
    HelmSample: (5, "", {"reason": _TEXT}),
    PositionSample: (7, "latitude", {"longitude": _REAL}),
    ConditionSample: (8, "present", {"name": _TEXT, "detail": _TEXT}),
    AcknowledgeSample: (9, "", {"name": _TEXT}),
    WindSample: (10, "angle", {"speed": _REAL}),
    AlarmSample: (11, "", {}),
    ThrustSample: (12, "throttle", {"reach": _REAL}),
    CourseSample: (13, "course", {}),
    ThrusterSample: (14, "available", {"disobeyed": _TEXT}),
    CompassSample: (15, "turn", {}),
}
"""Of each kind of sample its number, the field that stands as a number behind the time, and those behind that, in their
order; the source comes last."""
_TYPES = {number: kind for kind, (number, _, _) in _SAMPLES.items()}
_YES_OR_NO = ("present", "available")
