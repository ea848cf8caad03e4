"""What people are warned, in tests: the sentences of a tick's alarms."""

from __future__ import annotations

from autopilot.signals import AlarmEvent, Mode, NavState, Order, Reference, RudderCommand, Tick
from autopilot.supervision.panel import sentence_of, sentences_of


def words_of(tick: Tick) -> tuple[str, ...]:
    """Return what is shown of a tick's alarms."""
    return sentences_of(tick.alarms)


def text_of(name: str, detail: str = "") -> str:
    """Return what is said of an alarm of the table."""
    return sentence_of(AlarmEvent(name, detail))


def other(words: str) -> AlarmEvent:
    """Return an alarm that is of no kind but the words of who noticed it."""
    return AlarmEvent("other", words)


def words(event: AlarmEvent | None) -> str:
    """Return what is said of an alarm, '' of none."""
    return "" if event is None else sentence_of(event)


def shown(now: float, mode: Mode = Mode.STANDBY, alarms: tuple[AlarmEvent, ...] = ()) -> Tick:
    """Return a tick that shows who has the rudder and what is wrong, of a boat that nothing is known of."""
    state = NavState(now, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)
    command = RudderCommand(now, 0.0, mode is Mode.ENGAGED)
    return Tick(1, now, (), Order(), state, Reference(0.0), 0.0, command, mode, alarms)
