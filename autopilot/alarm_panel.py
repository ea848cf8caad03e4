"""Which alarms sound: until they are acknowledged or over, and louder when nobody has for half a minute. Pure."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

from autopilot.alarms import kind_of
from autopilot.signals import AcknowledgeSample, AlarmEvent, AlarmState, Order, Sample, Siren

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
