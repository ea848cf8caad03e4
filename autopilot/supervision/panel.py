"""What people hear and read of alarms: which of them sound, until when, and the sentences of all.

The sentences of alarms, made here and nowhere else, where they are shown: on a screen, in a STATUSTEXT, in a report.

Nothing is decided by them: what follows from an alarm stands in the table of `autopilot.supervision.alarms`. Pure.

Which alarms sound: until they are acknowledged or over, and louder when nobody has for half a minute. Pure.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass

from autopilot.signals import AcknowledgeSample, AlarmEvent, AlarmState, Order, Sample, Siren
from autopilot.supervision.alarms import APART, AT_STOP, CATALOGUE, FAILED, OVERRIDDEN, VERBATIM, kind_of

ESCALATES_AFTER = 30.0
REMEMBERED = 10.0
"""An alarm that comes back within this time [s] is the same one."""


@dataclass(slots=True)
class _Entry:
    since: float
    last: float
    is_heard: bool = False
    past_since: float | None = None


class AlarmPanel:
    """`update` every tick with what is the case; an order of the skipper's acknowledges what sounds by then.

    Attributes:
        states: of the events that `update` returned last.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._entries: dict[str, _Entry] = {}
        self._order: tuple[int, int] | None = None
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
        past: names that are the case no more: said as past until they are acknowledged, then gone.
        """
        self._forget(now)
        for sample in samples:
            if isinstance(sample, AcknowledgeSample):
                self._acknowledge(sample.name)
        given = (int(order.kind), order.serial)
        if self._order is not None and given != self._order:
            self._acknowledge("")
        self._order = given
        shown, states, siren = [], [], Siren.QUIET
        for name, event in raised.items():
            entry = self._entries.setdefault(name, _Entry(now, now))
            entry.last = now
            if name in past:
                entry.past_since = now if entry.past_since is None else entry.past_since
                if entry.is_heard:
                    continue
                event = event._replace(is_past=True)
            elif entry.past_since is not None:
                if now - entry.past_since > REMEMBERED:
                    entry = self._entries[name] = _Entry(now, now)
                entry.past_since = None
            heard = AlarmState.ACKNOWLEDGED if entry.is_heard else AlarmState.SOUNDING
            state = heard if kind_of(event).sounds else AlarmState.NOTICE
            sounds = state is AlarmState.SOUNDING
            states.append(state)
            escalated = sounds and now - entry.since >= ESCALATES_AFTER
            shown.append(event._replace(is_escalated=True) if escalated else event)
            if sounds:
                siren = max(siren, Siren.ESCALATED if escalated else Siren.SOUNDING)
        self.states = tuple(states)
        return tuple(shown), siren

    def _acknowledge(self, name: str) -> None:
        for known, entry in self._entries.items():
            if name in ("", known):
                entry.is_heard = True

    def _forget(self, now: float) -> None:
        for name in [name for name, entry in self._entries.items() if not now - entry.last <= REMEMBERED]:
            del self._entries[name]


UNHEARD = "NOT ACKNOWLEDGED: "
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
    return f"{UNHEARD}{said}" if event.is_escalated else said


def sentences_of(events: Iterable[AlarmEvent]) -> tuple[str, ...]:
    """Return what is said of each."""
    return tuple(sentence_of(event) for event in events)


def _said(event: AlarmEvent) -> str:
    kind = CATALOGUE[event.name]
    pattern = FORMS[event.form] if event.form else kind.sentence
    names_it = "{text}" in pattern
    said = pattern.format(
        text=f"{kind.text} (past)" if event.is_past else kind.text,
        detail=event.detail,
        bracketed=f" ({event.detail})" if event.detail else "",
        remedy=kind.remedy,
        because="" if event.because is None else _reason(event.because),
    )
    return said if names_it or not event.is_past else f"past: {said}"


def _reason(event: AlarmEvent) -> str:
    """Return why an order was dropped: what was against it, without saying once more that it cannot be done."""
    return event.detail if event.name == "cannot_engage" and event.detail else _said(event)
