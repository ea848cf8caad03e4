"""One tick as bytes and back, exactly: every float keeps its 64 bits, so that a log replays bit for bit.

Little-endian. A record is its kind (one byte) and its body: HEADER is JSON text, TICK is described by the
structures below. Sources and reasons are UTF-8 with a length byte before them.

Alarms are events by name. Older logs hold their sentences, and the reason alone of a lost helm: here, and nowhere else,
is looked at how those were worded, to find out what they were.
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
    ConditionSample,
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
    Tick,
    WindSample,
)
from autopilot.supervision.alarms import CATALOGUE, OTHER, VERBATIM
from autopilot.supervision.panel import FORMS, UNHEARD

HEADER = 1
HEADER_MOST = 1 << 20
"""Bytes of a header; ours hold a vessel file and little else."""
TICK_BEFORE_WAVES = 2
"""A tick as the first version wrote it: its state knows no waves."""
VESSEL = 3
"""A vessel file's text, in force from the next tick on."""

TICK_BEFORE_SUPERVISOR = 4
"""A tick whose mode is all that is known of the supervisor."""
TICK_BEFORE_ACKNOWLEDGING = 5
"""A tick that does not know which of its alarms have been acknowledged."""
TICK_BEFORE_EVENTS = 6
"""A tick that holds its alarms as sentences."""
TICK = 7
TICKS = (TICK, TICK_BEFORE_EVENTS, TICK_BEFORE_ACKNOWLEDGING, TICK_BEFORE_SUPERVISOR, TICK_BEFORE_WAVES)
"""Every kind of record that is a tick."""

_INPUTS = struct.Struct("<IdBdddIB")
"""number, now, order kind (with LED where a guide leads), order heading, rudder, heading change, serial, count of
samples."""
_OUTPUTS = struct.Struct("<7d?4d3dd?dBBB")
"""state: heading, rate, speed, rudder, bias, age, time; valid; its four of the waves; reference; demand; engaged;
angle; mode; state of the supervisor; siren."""
_OUTPUTS_BEFORE_SUPERVISOR = struct.Struct("<7d?4d3dd?dB")
_OUTPUTS_BEFORE_WAVES = struct.Struct("<7d?3dd?dB")
_SAMPLE = struct.Struct("<Bdd")
_NUMBER = struct.Struct("<d")
_LED = 0x80
_OLD_CAUSES = {
    "the vehicle has rebooted": HelmCause.REBOOTED,
    "no heartbeat from the vehicle": HelmCause.SILENT,
    "the radio is lost": HelmCause.RADIO_LOST,
}
_OLD_BEGINNINGS = {
    "the boat does not move as ": "innovation",
    "the boat turns against ": "runaway",
    "the boat is pushed harder than ": "overpowered",
}
"""Alarms that older logs put into other words: how their sentences began."""
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
    parts = [
        bytes([TICK]),
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
    heard = tick.heard if len(tick.heard) == len(tick.alarms) else (_UNKNOWN,) * len(tick.alarms)
    parts.extend(bytes([state]) + _encode_event(alarm) for state, alarm in zip(heard, tick.alarms, strict=True))
    return b"".join(parts)


def decode_tick(record: bytes) -> Tick:
    """Return the tick of a record. Raises InputError where it is damaged."""
    try:
        return _decode_tick(record)
    except (struct.error, IndexError, ValueError, OverflowError) as error:
        raise InputError(f"a tick in the log is damaged: {error}; give another log.") from error


def _decode_tick(record: bytes) -> Tick:
    number, now, kind, heading, rudder, change, serial, count = _INPUTS.unpack_from(record, 1)
    place = 1 + _INPUTS.size
    samples: list[Sample] = []
    for _ in range(count):
        sample, place = _decode_sample(record, place)
        samples.append(sample)
    if record[0] == TICK_BEFORE_WAVES:
        old = _OUTPUTS_BEFORE_WAVES.unpack_from(record, place)
        out = (*old[:8], 0.0, 0.0, 0.0, 0.0, *old[8:], _STATES[old[-1]], 0)
        place += _OUTPUTS_BEFORE_WAVES.size
    elif record[0] == TICK_BEFORE_SUPERVISOR:
        old = _OUTPUTS_BEFORE_SUPERVISOR.unpack_from(record, place)
        out = (*old, _STATES[old[-1]], 0)
        place += _OUTPUTS_BEFORE_SUPERVISOR.size
    else:
        out = _OUTPUTS.unpack_from(record, place)
        place += _OUTPUTS.size
    alarms: list[AlarmEvent] = []
    heard: list[int] = []
    while place < len(record):
        if record[0] in (TICK, TICK_BEFORE_EVENTS):
            heard.append(record[place])
            place += 1
        if record[0] == TICK:
            alarm, place = _decode_event(record, place)
        else:
            sentence, place = _read_text(record, place)
            alarm = _event_of(sentence)
        alarms.append(alarm)
    return Tick(
        number=number,
        now=now,
        samples=tuple(samples),
        order=Order(OrderKind(kind & ~_LED), heading, rudder, change, serial, bool(kind & _LED)),
        state=NavState(out[6], out[0], out[1], out[2], out[3], out[4], out[5], *out[7:12]),
        reference=Reference(*out[12:15]),
        demand=out[15],
        command=RudderCommand(now, out[17], out[16]),
        mode=Mode(out[18]),
        alarms=tuple(alarms),
        supervisor=SupervisorState(out[19]),
        siren=Siren(out[20]),
        heard=() if _UNKNOWN in heard else tuple(AlarmState(state) for state in heard),
    )


_KINDS: tuple[type[Any], ...] = (
    HeadingSample,
    RateSample,
    RudderSample,
    SpeedSample,
    RollSample,
    HelmSample,
    AlarmSample,
    PositionSample,
    ConditionSample,
    AcknowledgeSample,
    WindSample,
)
_SENTENCE = _KINDS.index(AlarmSample)
"""An `AlarmSample` of an older log: its sentence, empty where it takes back."""
_EVENT = len(_KINDS)
_STATES = (SupervisorState.STANDBY, SupervisorState.HEADING, SupervisorState.OVERRIDE, SupervisorState.FAILSAFE)
"""What an old log's mode comes to."""


def _encode_sample(sample: Sample) -> bytes:
    kind = _EVENT if isinstance(sample, AlarmSample) else _KINDS.index(type(sample))
    if isinstance(sample, HelmSample):
        # the cause counts up from 1 where the helm is ours, else down from -1; older logs have 1 and 0
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
    elif isinstance(sample, PositionSample):
        body = _SAMPLE.pack(kind, sample.time, sample.latitude) + _NUMBER.pack(sample.longitude)
    elif isinstance(sample, HeadingSample):
        body = _SAMPLE.pack(kind, sample.time, sample.heading) + _optional(sample.rate)
    elif isinstance(sample, RollSample):
        body = _SAMPLE.pack(kind, sample.time, sample.roll) + _optional(sample.rate)
    elif isinstance(sample, RateSample):
        body = _SAMPLE.pack(kind, sample.time, sample.rate)
    elif isinstance(sample, RudderSample):
        body = _SAMPLE.pack(kind, sample.time, sample.angle) + bytes([sample.ordered])
    else:
        body = _SAMPLE.pack(kind, sample.time, sample.speed) + bytes([sample.over_ground])
    return body + _text(sample.source)


def _cause_of(value: float, reason: str) -> HelmCause:
    """Return the cause of a lost helm; in older logs the beginning of the reason has it."""
    if value == 0.0:
        return next((cause for begins, cause in _OLD_CAUSES.items() if reason.startswith(begins)), HelmCause.TAKEN)
    return HelmCause(int(abs(value) - 1.0))


def _decode_sample(record: bytes, place: int) -> tuple[Sample, int]:
    kind, time, value = _SAMPLE.unpack_from(record, place)
    place += _SAMPLE.size
    if kind == _EVENT:
        event, place = _decode_event(record, place) if value else (None, place)
        source, place = _read_text(record, place)
        return AlarmSample(time, event, source), place
    made = _KINDS[kind]
    if made is HelmSample:
        reason, place = _read_text(record, place)
        source, place = _read_text(record, place)
        return HelmSample(time, value > 0.0, reason, source, _cause_of(value, reason)), place
    if kind == _SENTENCE:
        text, place = _read_text(record, place)
        source, place = _read_text(record, place)
        return AlarmSample(time, _event_of(text) if text else None, source), place
    if made is ConditionSample:
        (name, detail, source), place = _read_texts(record, place, 3)
        return ConditionSample(time, name, bool(value), detail, source), place
    if made is AcknowledgeSample:
        (name, source), place = _read_texts(record, place, 2)
        return AcknowledgeSample(time, name, source), place
    if made is RateSample:
        source, place = _read_text(record, place)
        return RateSample(time, value, source), place
    if made in (PositionSample, WindSample):
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


def _event_of(sentence: str) -> AlarmEvent:
    """Return the alarm that a sentence of an older log is of, by how it begins; the sentence stays as it was."""
    said = sentence.removeprefix(UNHEARD)
    begins = {kind.text: name for name, kind in CATALOGUE.items()} | _OLD_BEGINNINGS
    name = next((name for text, name in begins.items() if said.startswith(text)), OTHER)
    return AlarmEvent(name, said, VERBATIM, is_escalated=said != sentence)


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
