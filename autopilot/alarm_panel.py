"""Which alarms sound: until they are acknowledged or over, and louder when nobody has for half a minute. Pure."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

from autopilot.alarms import CATALOGUE, Response, Severity, kind_of, past_of
from autopilot.signals import AcknowledgeSample, AlarmState, Order, Sample, Siren

ESCALATES_AFTER = 30.0
UNHEARD = "NOT ACKNOWLEDGED: "
"""Before the text of an alarm that has escalated: it is said again."""
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
        states: of the texts that `update` returned last.
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
        raised: Mapping[str, str],
        samples: tuple[Sample, ...],
        order: Order,
        past: Container[str] = (),
    ) -> tuple[tuple[str, ...], Siren]:
        """Return the texts to be shown at `now` [s], and what is to be heard.

        raised: the texts by the alarms' names; names that are not in the catalogue are taken for warnings.
        past: names of the catalogue that are the case no more: said as past until they are acknowledged, then gone.
        """
        self._forget(now)
        for sample in samples:
            if isinstance(sample, AcknowledgeSample):
                self._acknowledge(sample.name)
        given = (int(order.kind), order.serial)
        if self._order is not None and given != self._order:
            self._acknowledge("")
        self._order = given
        texts, states, siren = [], [], Siren.QUIET
        for name, text in raised.items():
            entry = self._entries.setdefault(name, _Entry(now, now))
            entry.last = now
            if name in past:
                entry.past_since = now if entry.past_since is None else entry.past_since
                if entry.is_heard:
                    continue
                text = past_of(name, text)
            elif entry.past_since is not None:
                if now - entry.past_since > REMEMBERED:
                    entry = self._entries[name] = _Entry(now, now)
                entry.past_since = None
            heard = AlarmState.ACKNOWLEDGED if entry.is_heard else AlarmState.SOUNDING
            state = heard if _sounds(name, text) else AlarmState.NOTICE
            sounds = state is AlarmState.SOUNDING
            states.append(state)
            escalated = sounds and now - entry.since >= ESCALATES_AFTER
            texts.append(f"{UNHEARD}{text}" if escalated else text)
            if sounds:
                siren = max(siren, Siren.ESCALATED if escalated else Siren.SOUNDING)
        self.states = tuple(states)
        return tuple(texts), siren

    def _acknowledge(self, name: str) -> None:
        for known, entry in self._entries.items():
            if name in ("", known):
                entry.is_heard = True

    def _forget(self, now: float) -> None:
        for name in [name for name, entry in self._entries.items() if not now - entry.last <= REMEMBERED]:
            del self._entries[name]


def _sounds(name: str, text: str) -> bool:
    """Notices make no noise and never escalate; what links say in the catalogue's words is of that kind."""
    kind = CATALOGUE.get(name) or kind_of(text)
    return kind is None or (kind.severity <= Severity.WARNING and kind.response is not Response.WAIT)
