"""What people are warned, in tests: the sentences of a tick's alarms."""

from __future__ import annotations

from autopilot.signals import AlarmEvent, Tick
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
