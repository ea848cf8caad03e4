"""The supervisor as one table: in each state, for each event, the next state, what is done, and what is said.

Nothing here decides: `autopilot.supervision.supervisor` notices events and looks them up. The pictures of
docs/supervisor.md are drawn from the table (`docs/supervisor_pages.py`). Every pair of state and event has
its cell.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple

from autopilot.signals import Mode, SupervisorState

STANDBY, OVERRIDE = SupervisorState.STANDBY, SupervisorState.OVERRIDE
HEADING, TRACK, TRIAL = SupervisorState.HEADING, SupervisorState.TRACK, SupervisorState.TRIAL
DEGRADED = SupervisorState.DEGRADED
FAILSAFE, FAULT = SupervisorState.FAILSAFE, SupervisorState.FAULT

ENGAGED = (HEADING, TRACK, TRIAL, DEGRADED)
"""The states in which the rudder goes where the orders want it."""
ENDED = (OVERRIDE, FAILSAFE, FAULT)
"""The states in which something else than an order has ended the engagement."""

MODES = {
    STANDBY: Mode.STANDBY,
    HEADING: Mode.ENGAGED,
    TRACK: Mode.ENGAGED,
    TRIAL: Mode.ENGAGED,
    DEGRADED: Mode.ENGAGED,
    OVERRIDE: Mode.OVERRIDE,
    FAILSAFE: Mode.FAILSAFE,
    FAULT: Mode.FAULT,
}


class Event(Enum):
    """What the supervisor notices in a tick; the value says what it is."""

    RELEASE = "the order to stand by"
    HELM_TAKEN = "a human or the firmware takes the helm, or the link to the rudder is lost"
    UNFIT_COMMAND = "a value is not finite, or a command outside of its envelope"
    TROUBLE = "a monitor finds what the vessel file's fail-safe is for: heading lost, frozen, jumping"
    RUDDER_TROUBLE = "a monitor finds that the rudder does not answer, or answers the wrong way"
    TIME_UP = "the time of the fail-safe's action is over"
    DOUBT = "a monitor doubts something that steering rests on"
    DOUBT_OVER = "no monitor doubts anything any more"
    ORDER_HEADING = "the order to hold a heading, new, with nothing against it"
    ORDER_TRACK = "the order to follow a track, new, with nothing against it"
    ORDER_TRIAL = "the order of a rudder angle or a zigzag, new, with nothing against it"
    ORDER_BLOCKED = "a new order to engage, while the helm is taken or a trouble lasts"
    ORDER_EXPIRED = "a new order to engage has been blocked for long"
    HEADING_BACK = "a lost heading is back, and the vessel file says resume"
    VEHICLE_BACK = "a vehicle that rebooted is ready again, and the vessel file says reengage_after_reboot"

    # members are equal where they are the same: Enum would hash the name each time that the table is asked
    __hash__ = object.__hash__


ORDERS = (Event.ORDER_HEADING, Event.ORDER_TRACK, Event.ORDER_TRIAL)
"""The orders of people."""
RETURNS = (Event.HEADING_BACK, Event.VEHICLE_BACK)
"""What engages by itself, and only where the vessel file says so."""
ENDINGS = (Event.HELM_TAKEN, Event.UNFIT_COMMAND, Event.TROUBLE, Event.RUDDER_TROUBLE)


class Action(Enum):
    """What is done on the way into a row's next state; the value says what it is."""

    TAKE_HELM = "take the rudder without a bump, from where it is"
    RELEASE = "release the rudder"
    FAILSAFE = "move the rudder as the vessel file's failsafe.action says"
    HOLD = "hold the rudder at its last command, for failsafe.release_after_s, then release it"
    SPEND = "the order in force is spent: only a new one engages"
    FORGET = "forget what ended the last engagement"


class Says(Enum):
    """What the skipper hears of a row; the value says what it is."""

    NOTHING = "nothing"
    SILENCE = "the alarm that ended the engagement is over"
    OVERRIDDEN = "overridden: who has the helm, and why"
    UNFIT = "not_finite or envelope"
    MONITOR = "the monitor's own alarm"
    BLOCKED = "not engaged: what is against it"
    EXPIRED = "the order to engage was dropped: what was against it"


class Row(NamedTuple):
    """A cell of the table."""

    next: SupervisorState
    actions: tuple[Action, ...] = ()
    says: Says = Says.NOTHING


_RELEASED = Row(STANDBY, (Action.RELEASE, Action.FORGET), Says.SILENCE)
_OVERRIDDEN = Row(OVERRIDE, (Action.RELEASE, Action.SPEND), Says.OVERRIDDEN)
_UNFIT = Row(FAULT, (Action.HOLD, Action.SPEND), Says.UNFIT)
_TROUBLE = Row(FAILSAFE, (Action.FAILSAFE, Action.SPEND), Says.MONITOR)
_RUDDER_TROUBLE = Row(FAILSAFE, (Action.RELEASE, Action.SPEND), Says.MONITOR)

Rules = list[tuple[Iterable[SupervisorState], Event, Row | None]]
"""None: the state stays, nothing is done, nothing is said."""


def _orders() -> Rules:
    rules: Rules = []
    for event, state in zip(ORDERS, (HEADING, TRACK, TRIAL), strict=True):
        engage = Row(state, (Action.TAKE_HELM, Action.FORGET), Says.SILENCE)
        rules.append(((STANDBY, *ENDED), event, engage))
        rules.append(([other for other in (HEADING, TRACK, TRIAL) if other is not state], event, Row(state)))
        # a doubt outlives a change of order; what is steered comes back with DOUBT_OVER
        rules.append(((state, DEGRADED), event, None))
    return rules


_RULES: Rules = [
    (SupervisorState, Event.RELEASE, _RELEASED),
    ((*ENGAGED, FAILSAFE, FAULT), Event.HELM_TAKEN, _OVERRIDDEN),
    ((STANDBY, OVERRIDE), Event.HELM_TAKEN, None),
    (ENGAGED, Event.UNFIT_COMMAND, _UNFIT),
    ((FAILSAFE,), Event.UNFIT_COMMAND, _UNFIT),
    ((STANDBY, OVERRIDE, FAULT), Event.UNFIT_COMMAND, None),
    (ENGAGED, Event.TROUBLE, _TROUBLE),
    ((STANDBY, *ENDED), Event.TROUBLE, None),
    (ENGAGED, Event.RUDDER_TROUBLE, _RUDDER_TROUBLE),
    ((FAILSAFE,), Event.RUDDER_TROUBLE, _RUDDER_TROUBLE),
    ((STANDBY, OVERRIDE, FAULT), Event.RUDDER_TROUBLE, None),
    ((FAILSAFE,), Event.TIME_UP, Row(FAILSAFE, (Action.RELEASE,))),
    ((FAULT,), Event.TIME_UP, Row(FAULT, (Action.RELEASE,))),
    ((STANDBY, *ENGAGED, OVERRIDE), Event.TIME_UP, None),
    ((HEADING, TRACK, TRIAL), Event.DOUBT, Row(DEGRADED, (), Says.MONITOR)),
    ((STANDBY, DEGRADED, *ENDED), Event.DOUBT, None),
    ((DEGRADED,), Event.DOUBT_OVER, Row(HEADING, (), Says.SILENCE)),
    ((STANDBY, HEADING, TRACK, TRIAL, *ENDED), Event.DOUBT_OVER, None),
    *_orders(),
    *[((state,), Event.ORDER_BLOCKED, Row(state, (), Says.BLOCKED)) for state in (STANDBY, *ENDED)],
    (ENGAGED, Event.ORDER_BLOCKED, None),
    *[((state,), Event.ORDER_EXPIRED, Row(state, (Action.SPEND,), Says.EXPIRED)) for state in (STANDBY, *ENDED)],
    (ENGAGED, Event.ORDER_EXPIRED, None),
    ((FAILSAFE,), Event.HEADING_BACK, Row(HEADING, (Action.TAKE_HELM, Action.FORGET), Says.SILENCE)),
    ((STANDBY, *ENGAGED, OVERRIDE, FAULT), Event.HEADING_BACK, None),
    ((FAILSAFE, OVERRIDE), Event.VEHICLE_BACK, Row(HEADING, (Action.TAKE_HELM, Action.FORGET), Says.SILENCE)),
    ((STANDBY, *ENGAGED, FAULT), Event.VEHICLE_BACK, None),
]


def _table() -> dict[tuple[SupervisorState, Event], Row]:
    table: dict[tuple[SupervisorState, Event], Row] = {}
    for states, event, row in _RULES:
        for state in states:
            if (state, event) in table:
                raise ValueError(f"the supervisor's table has two rows for {state.name} and {event.name}")
            table[state, event] = Row(state) if row is None else row
    return table


TABLE = _table()
"""Every state and event, and what comes of it."""
