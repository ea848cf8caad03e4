"""What people hear and read of alarms: which of them sound, until when, and the sentences of all.

The sentences of alarms, made here and nowhere else, where they are shown: on a screen, in a STATUSTEXT, in a report.

Nothing is decided by them: what follows from an alarm stands in the table of `autopilot.supervision.alarms`. Pure.

Which alarms sound: until they are acknowledged or over, and louder when nobody has for half a minute. Pure.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import NamedTuple

from autopilot.signals import AcknowledgeSample, AlarmEvent, AlarmState, Order, OrderKind, Sample, Siren
from autopilot.supervision.alarm_words import WORDS
from autopilot.supervision.alarms import APART, AT_STOP, FAILED, OVERRIDDEN, VERBATIM, kind_of

ESCALATES_AFTER = 30.0
REMEMBERED = 10.0
"""An alarm that comes back within this time [s] is the same one."""


class Entry(NamedTuple):
    """An alarm since when, and when last, it was the case [s]; whether it was acknowledged; since when it is past."""

    since: float
    last: float
    is_acknowledged: bool = False
    past_since: float | None = None


NO_ENTRIES: Mapping[str, Entry] = {}


class Memory(NamedTuple):
    """What the panel remembers: the alarms by name, and the order that was given last."""

    entries: Mapping[str, Entry] = NO_ENTRIES
    order: tuple[OrderKind, int] | None = None


QUIET = Memory()


class AlarmPanel:
    """`update` every tick with what is the case; an order of the skipper's acknowledges what sounds by then. For as
    long as a tick lasts: what it remembers is `memory`.

    Attributes:
        states: of the events that `update` returned last.
    """

    def __init__(self, memory: Memory = QUIET) -> None:
        self.memory = memory
        self.states: tuple[AlarmState, ...] = ()

    def update(
        self,
        now: float,
        raised: Mapping[str, AlarmEvent],
        samples: tuple[Sample, ...],
        order: Order,
        past: Container[str] = (),
    ) -> tuple[tuple[AlarmEvent, ...], Siren]:
        """Return the alarms to be shown at `now` [s], and what is to be heard.

        raised: the alarms by their names, or by who says them.
        past: names that are the case no more: said as ended until they are acknowledged, then gone.
        """
        given, before = (order.kind, order.serial), self.memory
        if not raised and not before.entries:
            self.states = ()
            if before.order != given:
                self.memory = Memory(before.entries, given)
            return (), Siren.QUIET
        entries = {name: entry for name, entry in before.entries.items() if now - entry.last <= REMEMBERED}
        for sample in samples:
            if isinstance(sample, AcknowledgeSample):
                alike = {key for key, event in raised.items() if event.name == sample.name}
                entries = acknowledged(entries, {*alike, sample.name} if sample.name else entries.keys())
        if before.order is not None and given != before.order:
            entries = acknowledged(entries, entries.keys())
        shown, states, siren = [], [], Siren.QUIET
        for name, event in raised.items():
            entry = entries[name] = raised_at(entries.get(name, Entry(now, now)), now, is_past=name in past)
            if entry.past_since is not None:
                if entry.is_acknowledged:
                    continue
                event = event._replace(is_past=True)
            audible = AlarmState.ACKNOWLEDGED if entry.is_acknowledged else AlarmState.SOUNDING
            state = audible if kind_of(event).sounds else AlarmState.NOTICE
            sounds = state is AlarmState.SOUNDING
            states.append(state)
            escalated = sounds and now - entry.since >= ESCALATES_AFTER
            shown.append(event._replace(is_escalated=True) if escalated else event)
            if sounds:
                siren = max(siren, Siren.ESCALATED if escalated else Siren.SOUNDING)
        self.states, self.memory = tuple(states), Memory(entries, given)
        return tuple(shown), siren


def raised_at(entry: Entry, now: float, *, is_past: bool) -> Entry:
    """Return the alarm that is raised at `now` [s], or said as ended."""
    if is_past:
        past_since = now if entry.past_since is None else entry.past_since
        return Entry(entry.since, now, entry.is_acknowledged, past_since)
    if entry.past_since is not None and now - entry.past_since > REMEMBERED:
        return Entry(now, now)
    return Entry(entry.since, now, entry.is_acknowledged)


def acknowledged(entries: dict[str, Entry], keys: Container[str]) -> dict[str, Entry]:
    """Return the alarms after the skipper has heard those of `keys`."""
    return {key: entry._replace(is_acknowledged=True) if key in keys else entry for key, entry in entries.items()}


UNACKNOWLEDGED = "NOT ACKNOWLEDGED: "
"""Before an alarm that has escalated: it is said again."""
FORMS = {
    OVERRIDDEN: "overridden: {detail}; {remedy}",
    AT_STOP: "{text} {detail}, the rudder at its stop: more way or less sail, check that the rudder moves",
    APART: (
        "{text} by {detail}; compare with a bearing, then put the right one first in sensors.priority, check deviation "
        "and variation"
    ),
    FAILED: "{text}: {detail}; restart the one that failed, and compare both with a bearing",
    VERBATIM: "{detail}",
}
"""The sentences beside an alarm's own."""


def sentence_of(event: AlarmEvent) -> str:
    """Return what is said of an alarm: what is the case, and what to do. KeyError for a name not in the table."""
    said = _said(event)
    return f"{UNACKNOWLEDGED}{said}" if event.is_escalated else said


def sentences_of(events: Iterable[AlarmEvent]) -> tuple[str, ...]:
    """Return what is said of each."""
    return tuple(sentence_of(event) for event in events)


def _said(event: AlarmEvent) -> str:
    words = WORDS[event.name]
    pattern = FORMS[event.form] if event.form else words.sentence
    names_it = "{text}" in pattern
    said = pattern.format(
        text=f"{words.text} (ended)" if event.is_past else words.text,
        detail=event.detail,
        bracketed=f" ({event.detail})" if event.detail else "",
        remedy=words.remedy,
        because="" if event.because is None else _reason(event.because),
    )
    return said if names_it or not event.is_past else f"ended: {said}"


def _reason(event: AlarmEvent) -> str:
    """Return why an order was dropped: what was against it, without saying once more that it cannot be done."""
    return event.detail if event.name == "cannot_engage" and event.detail else _said(event)
