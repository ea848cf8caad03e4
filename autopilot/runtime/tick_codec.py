"""One tick as bytes and back, exactly: every float keeps its 64 bits, so that a log replays bit for bit.

Little-endian. A record is its kind (one byte) and its body: HEADER is JSON text, TICK is described by the
structures below. Sources and reasons are UTF-8 with a length byte before them. Alarms are events by name.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from typing import Any

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
            order.heading,
            order.rudder,
            order.heading_change,
            order.serial,
            len(tick.samples),
        ),
    ]
    parts.extend(_encode_sample(sample) for sample in tick.samples)
    parts.append(
        _OUTPUTS.pack(
            state.heading,
            state.rate,
            state.speed,
            state.rudder,
            state.bias,
            state.heading_age,
            state.time,
            state.valid,
            *state[8:],
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
        state=NavState(out[6], out[0], out[1], out[2], out[3], out[4], out[5], *out[7:12]),
        reference=Reference(*out[12:15]),
        demand=out[15],
        command=RudderCommand(now, out[17], out[16], thruster),
        mode=Mode(out[18]),
        alarms=tuple(alarms),
        supervisor=SupervisorState(out[19]),
        siren=Siren(out[20]),
        alarm_states=() if _UNKNOWN in alarm_states else tuple(AlarmState(state) for state in alarm_states),
    )


_KINDS: dict[type[Any], int] = {
    HeadingSample: 0,
    RateSample: 1,
    RudderSample: 2,
    SpeedSample: 3,
    RollSample: 4,
    HelmSample: 5,
    PositionSample: 7,
    ConditionSample: 8,
    AcknowledgeSample: 9,
    WindSample: 10,
    AlarmSample: 11,
    ThrustSample: 12,
    CourseSample: 13,
    ThrusterSample: 14,
    CompassSample: 15,
}
_TYPES = {number: kind for kind, number in _KINDS.items()}


def _encode_sample(sample: Sample) -> bytes:
    kind = _KINDS[type(sample)]
    if isinstance(sample, HelmSample):
        # the cause counts up from 1 where the helm is ours, else down from -1
        value = 1.0 + sample.cause if sample.available else -1.0 - sample.cause
        body = _SAMPLE.pack(kind, sample.time, value) + _text(sample.reason)
    elif isinstance(sample, AlarmSample):
        event = b"" if sample.event is None else _encode_event(sample.event)
        body = _SAMPLE.pack(kind, sample.time, float(sample.event is not None)) + event
    elif isinstance(sample, ConditionSample):
        body = _SAMPLE.pack(kind, sample.time, float(sample.present)) + _text(sample.name) + _text(sample.detail)
    elif isinstance(sample, AcknowledgeSample):
        body = _SAMPLE.pack(kind, sample.time, 0.0) + _text(sample.name)
    elif isinstance(sample, WindSample):
        body = _SAMPLE.pack(kind, sample.time, sample.angle) + _NUMBER.pack(sample.speed)
    elif isinstance(sample, ThrustSample):
        body = _SAMPLE.pack(kind, sample.time, sample.throttle) + _NUMBER.pack(sample.reach)
    elif isinstance(sample, PositionSample):
        body = _SAMPLE.pack(kind, sample.time, sample.latitude) + _NUMBER.pack(sample.longitude)
    elif isinstance(sample, HeadingSample | RollSample):
        body = _SAMPLE.pack(kind, sample.time, sample[1]) + _optional(sample.rate)
    elif isinstance(sample, RateSample | CourseSample | CompassSample):
        body = _SAMPLE.pack(kind, sample.time, sample[1])
    elif isinstance(sample, ThrusterSample):
        body = _SAMPLE.pack(kind, sample.time, float(sample.available)) + _text(sample.disobeyed)
    elif isinstance(sample, RudderSample):
        body = _SAMPLE.pack(kind, sample.time, sample.angle) + bytes([sample.ordered])
    else:
        body = _SAMPLE.pack(kind, sample.time, sample.speed) + bytes([sample.over_ground])
    return body + _text(sample.source)


def _decode_sample(record: bytes, place: int) -> tuple[Sample, int]:
    kind, time, value = _SAMPLE.unpack_from(record, place)
    place += _SAMPLE.size
    made = _TYPES[kind]
    if made is AlarmSample:
        event, place = _decode_event(record, place) if value else (None, place)
        source, place = _read_text(record, place)
        return AlarmSample(time, event, source), place
    if made is HelmSample:
        reason, place = _read_text(record, place)
        source, place = _read_text(record, place)
        return HelmSample(time, value > 0.0, reason, source, HelmCause(int(abs(value) - 1.0))), place
    if made is ConditionSample:
        (name, detail, source), place = _read_texts(record, place, 3)
        return ConditionSample(time, name, bool(value), detail, source), place
    if made is AcknowledgeSample:
        (name, source), place = _read_texts(record, place, 2)
        return AcknowledgeSample(time, name, source), place
    if made in (RateSample, CourseSample, CompassSample):
        source, place = _read_text(record, place)
        return made(time, value, source), place
    if made is ThrusterSample:
        (disobeyed, source), place = _read_texts(record, place, 2)
        return ThrusterSample(time, bool(value), source, disobeyed), place
    if made in (PositionSample, WindSample, ThrustSample):
        (second,) = _NUMBER.unpack_from(record, place)
        source, place = _read_text(record, place + _NUMBER.size)
        return made(time, value, second, source), place
    if made in (HeadingSample, RollSample):
        (second,) = _NUMBER.unpack_from(record, place)
        source, place = _read_text(record, place + _NUMBER.size)
        return made(time, value, None if _is_absent(second) else second, source), place
    flag = bool(record[place])
    source, place = _read_text(record, place + 1)
    sample: Sample = made(time, value, flag, source)
    return sample, place


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


def _is_absent(value: float) -> bool:
    return math.isnan(value) and _NUMBER.pack(value) == _ABSENT


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
