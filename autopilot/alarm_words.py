"""The sentences of alarms, made here and nowhere else, where they are shown: on a screen, in a STATUSTEXT, in a report.

Nothing is decided by them: what follows from an alarm stands in the table of `autopilot.alarms`. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable

from autopilot.alarms import APART, AT_STOP, CATALOGUE, FAILED, OVERRIDDEN, VERBATIM
from autopilot.signals import AlarmEvent

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
