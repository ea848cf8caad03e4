"""The supervisor at work: notices what happens in a tick, looks it up in the table, and has the last word on commands.

The table is `autopilot.supervision.states`, what the alarms say and lead to `autopilot.supervision.alarms`, and the
envelope check, which shares no code with the limits that the law obeys, `autopilot.supervision.envelope`. What a
fail-safe tells the rudder is here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HelmCause,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    RudderCommand,
    SupervisorState,
    Tick,
)
from autopilot.supervision.alarms import CATALOGUE, OVERRIDDEN, Response
from autopilot.supervision.envelope import NOT_FINITE, Envelope, Picture, fault
from autopilot.supervision.states import ENDED, ENGAGED, MODES, TABLE, Action, Event, Says

RESUME_AFTER = 2.0
REENGAGE_WITHIN = 120.0
"""A vehicle that is ready this much later [s] than its reboot was noticed has been seen to by people."""
ORDER_WAITS = 30.0
"""An order to engage that is blocked for longer [s] is dropped: nobody expects to be obeyed by then."""

HEADING_LOST = "heading_lost"
LINK_SILENT = "link_silent"
STEERING_ACTIONS = ("dead_reckoning", "windward")
"""Fail-safe actions that the law carries out; the others need no more than the rudder's last place."""
CANNOT_ENGAGE = "cannot_engage"
NO_HEADING = "no heading comes: nothing to steer by"


def waits_to_engage(tick: Tick) -> bool:
    """Return whether an order to engage waits at `tick` for nothing but the helm."""
    return tick.mode is not Mode.ENGAGED and any(alarm.name == CANNOT_ENGAGE for alarm in tick.alarms)


class FailsafeAction(NamedTuple):
    """heading_timeout [s]; action: release, amidships, hold, dead_reckoning, windward or firmware; release_after [s];
    resume by itself or not.

    reengage: engage again by itself when the vehicle, having rebooted under us, is ready again. windward_rudder [rad]:
    the most rudder of the slow turn to windward.
    """

    heading_timeout: float
    action: str
    release_after: float
    resume: bool
    reengage: bool = False
    windward_rudder: float = 0.0


NO_HELM: Mapping[str, HelmSample] = {}
NO_NOTES: Mapping[str, AlarmEvent] = {}


class Memory(NamedTuple):
    """What the supervisor remembers.

    alarm: what ended the engagement, or keeps one from beginning; cause: its name where it ended it. since [s]: when
    the state began. rudder: what moves it. spent: the serial of the order that is used up. blocked: the order that is
    blocked, by its serial, and since when [s]. helm and notes: what each link said last. heading_since and over_since
    [s]: since when nothing is against engaging, and since when what `alarm` names is no longer the case; is_over: for
    long enough. rebooted, reboot_time [s]: a reboot heard of. wrong_since [s]: the envelope's.
    """

    state: SupervisorState = SupervisorState.STANDBY
    alarm: AlarmEvent | None = None
    cause: str = ""
    since: float = -math.inf  # held since ever is released
    rudder: Action = Action.RELEASE
    spent: int = 0
    blocked: tuple[int, float] | None = None
    helm: Mapping[str, HelmSample] = NO_HELM
    notes: Mapping[str, AlarmEvent] = NO_NOTES
    heading_since: float | None = None
    over_since: float | None = None
    is_over: bool = False
    rebooted: bool = False
    reboot_time: float = math.nan
    wrong_since: float | None = None


NOTHING_SEEN = Memory()
"""Standing by, with no order seen."""


class Supervisor:
    """The state machine of `autopilot.supervision.states` for one tick: `memory` is all that it goes on from."""

    def __init__(self, envelope: Envelope, failsafe: FailsafeAction, memory: Memory = NOTHING_SEEN) -> None:
        self._envelope, self._failsafe, self.memory = envelope, failsafe, memory
        self._serial = memory.spent
        self._went: HelmSample | None = None

    @property
    def mode(self) -> Mode:
        """Who has the rudder."""
        return MODES[self.memory.state]

    def on_sample(self, sample: HelmSample) -> None:
        """Take a link's word on whether the helm is free; one that was away for a moment of this tick was taken."""
        if not sample.available:
            self._went = sample
        self._remember(helm={**self.memory.helm, sample.source: sample})
        if sample.cause is HelmCause.REBOOTED:
            self._remember(rebooted=True)

    def note(self, sample: AlarmSample) -> None:
        """Take a link's word on what the skipper should know though steering goes on."""
        name = f"note of {sample.source}"
        others = {each: event for each, event in self.memory.notes.items() if each != name}
        self._remember(notes=others if sample.event is None else {**self.memory.notes, name: sample.event})

    def decide(
        self, now: float, order: Order, state: NavState, findings: Mapping[str, AlarmEvent] | None = None
    ) -> Mode:
        """Return the mode at `now` [s].

        `findings`: what the monitors have found, by the names of the catalogue.
        """
        self._serial = order.serial
        found, lost = findings or {}, _lost(state, self._failsafe)
        if lost:
            found = {lost: AlarmEvent(lost), **found}
        against = _first(found, Response.FAULT, Response.LET_GO, Response.FAILSAFE) if found else ""
        before, taken = self.memory, _taken(self.memory)
        away, self._went = taken or self._went, None
        if against or before.heading_since is None:
            self._remember(heading_since=None if against else now)
        if before.rebooted:
            self._watch_reboot(now)
        if order.kind is OrderKind.STANDBY:
            self._fire(now, Event.RELEASE)
        elif away is not None and self._is_taken(away):
            self._fire(now, Event.HELM_TAKEN, _alarm_of(away))
        elif against and self._is_ended_by(against):
            self._fire(now, _event_of(against), found[against])
        elif before.state not in ENGAGED:
            self._wait(now, order, state, taken, against, found)
        elif found and _first(found, Response.DEGRADE):
            self._fire(now, Event.DOUBT)
        else:
            if before.state is SupervisorState.DEGRADED:
                self._fire(now, Event.DOUBT_OVER)
            self._fire(now, _order_event(order))
        if self.memory.alarm is not None or self.memory.over_since is not None:
            self._watch_alarm(now, lost)
        return MODES[self.memory.state]

    def _is_taken(self, away: HelmSample) -> bool:
        """Return whether a helm that is away was taken from us, and not only has to be proved on engaging: who steers
        needs the helm, whatever keeps it away."""
        state = self.memory.state
        held = state not in (SupervisorState.STANDBY, SupervisorState.OVERRIDE)
        return state in ENGAGED or (held and away.cause not in NOBODYS)

    def _is_ended_by(self, against: str) -> bool:
        """A fail-safe that moves the rudder is ended by what is worse than a lost heading, too."""
        state = self.memory.state
        moves = state is SupervisorState.FAILSAFE and self.memory.rudder is not Action.RELEASE
        return state in ENGAGED or (moves and CATALOGUE[against].response is not Response.FAILSAFE)

    def _wait(
        self,
        now: float,
        order: Order,
        state: NavState,
        taken: HelmSample | None,
        against: str,
        found: Mapping[str, AlarmEvent],
    ) -> None:
        """While not engaged: whether an order, or what has come back, engages."""
        back, spent = self._returned(now), self.memory.spent
        if order.serial == spent and back is None:
            if self.memory.blocked is not None:
                self._remember(blocked=None)
            return
        # a helm is proved for an order that waits for nothing else: its pulses would come again and again
        if taken is not None and not (against and taken.cause is HelmCause.UNPROVEN):
            self._block(now, order, state, AlarmEvent(CANNOT_ENGAGE, taken.reason))
        elif against:
            event, waits = found[against], against == HEADING_LOST
            self._block(now, order, state, AlarmEvent("waiting_heading", event.detail) if waits else event)
        else:
            self._fire(now, _order_event(order) if order.serial != spent else back)
            # what came back holds a heading; what it is that was ordered is seen at once
            self._fire(now, _order_event(order))

    def _block(self, now: float, order: Order, state: NavState, alarm: AlarmEvent) -> None:
        """An order that cannot be carried out yet: said, and dropped when nobody expects it any more."""
        self._fire(now, Event.ORDER_BLOCKED, alarm)
        blocked = self.memory.blocked
        if order.serial == self.memory.spent or not state.valid:
            # what comes back by itself is no order, and a pilot that never had a heading is not ready yet
            self._remember(blocked=None)
        elif blocked is None or blocked[0] != order.serial:
            self._remember(blocked=(order.serial, now))
        elif now - blocked[1] >= ORDER_WAITS:
            self._fire(now, Event.ORDER_EXPIRED, AlarmEvent("order_dropped", because=alarm))

    def check(
        self, now: float, previous: float, demand: float, limited: float, dt: float, picture: Picture | None = None
    ) -> RudderCommand:
        """Return the command that leaves: `limited` [rad] while the law steers and it is fit, else the fail-safe's.

        `previous` [rad] is the rudder command `dt` [s] before; `demand` [rad] is what the law wanted; `picture`
        is what it was worked out from. The order in force is the one of `decide`.
        """
        memory = self.memory
        is_held = memory.rudder is not Action.RELEASE
        if is_held and memory.state in ENDED and now - memory.since >= self._failsafe.release_after:
            self._fire(now, Event.TIME_UP)
        if self.law_steers:
            name, wrong, since = fault(
                self._envelope, memory.wrong_since, (now, previous, demand, limited, dt), picture
            )
            if since != memory.wrong_since:
                self._remember(wrong_since=since)
            if not name:
                return RudderCommand(now, limited, True)
            self._fire(now, Event.UNFIT_COMMAND, AlarmEvent(name, wrong))
        if self.memory.rudder is Action.RELEASE:
            return RudderCommand(now, 0.0, False)
        return self._held_command(now, previous, dt)

    @property
    def law_steers(self) -> bool:
        """Whether the command is the law's: engaged, or in a fail-safe that steers."""
        state = self.memory.state
        by_law = self.memory.rudder is Action.FAILSAFE and self._failsafe.action in STEERING_ACTIONS
        return state in ENGAGED or (state is SupervisorState.FAILSAFE and by_law)

    def _remember(self, **news: Any) -> None:
        self.memory = self.memory._replace(**news)

    def _watch_alarm(self, now: float, lost: str) -> None:
        """Notice when what ended the engagement is over for RESUME_AFTER, as far as it is seen after the engagement."""
        # while it is engaged, or stands by, the alarm is neither of them
        on, alarm, since = True, self.memory.alarm, self.memory.over_since
        if alarm is not None and alarm.name == HEADING_LOST:
            on = lost == HEADING_LOST
        elif alarm is not None and alarm.name == LINK_SILENT:
            on = any(not each.available and each.cause is HelmCause.SILENT for each in self.memory.helm.values())
        since = None if on else now if since is None else since
        self._remember(over_since=since, is_over=since is not None and now - since >= RESUME_AFTER)

    def _watch_reboot(self, now: float) -> None:
        """Note a reboot heard of, unless we stand by; when it ends an engagement, that is still on."""
        if self.memory.state is not SupervisorState.STANDBY:
            self._remember(reboot_time=now)
        self._remember(rebooted=False)

    def _ended_by_reboot(self, now: float) -> bool:
        """Return whether a reboot not long ago, or the silence that went with it, is what ended the engagement."""
        causes = (HEADING_LOST, LINK_SILENT, "firmware_rebooted")
        return now - self.memory.reboot_time < REENGAGE_WITHIN and self.memory.cause in causes

    def _returned(self, now: float) -> Event | None:
        """Only a lost heading and a reboot heal by themselves: what else ended the engagement would end it again."""
        memory = self.memory
        if memory.heading_since is None or now - memory.heading_since < RESUME_AFTER:
            return None
        if self._failsafe.reengage and self._ended_by_reboot(now):
            return Event.VEHICLE_BACK
        failed = memory.state is SupervisorState.FAILSAFE
        return Event.HEADING_BACK if failed and self._failsafe.resume and memory.cause == HEADING_LOST else None

    def _fire(self, now: float, event: Event | None, alarm: AlarmEvent | None = None) -> None:
        """Carry out the row of the table for the present state and `event`; `alarm` is what is said of it."""
        if event is None:
            return
        row = TABLE[self.memory.state, event]
        for action in row.actions:
            if action is Action.SPEND:
                self._remember(spent=self._serial)
            elif action is Action.FORGET:
                self._remember(reboot_time=math.nan)
            else:
                self._remember(rudder=self._held_by(action))
        if row.next is not self.memory.state:
            cause = alarm.name if alarm is not None else ""
            self._remember(since=now, wrong_since=None, cause=cause, state=row.next)
        if row.says is not Says.NOTHING:
            self._remember(alarm=alarm)

    def _held_by(self, action: Action) -> Action:
        """Return what moves the rudder from now on: a file that says release, or firmware, leaves it nothing."""
        lets_go = self._failsafe.action in ("release", "firmware") or self._failsafe.release_after <= 0.0
        return Action.RELEASE if lets_go and action in (Action.FAILSAFE, Action.HOLD) else action

    def _held_command(self, now: float, previous: float, dt: float) -> RudderCommand:
        most, rate, _ = self._envelope
        safe = max(-most, min(previous, most)) if math.isfinite(previous) else 0.0
        if self.memory.rudder is Action.HOLD or self._failsafe.action == "hold":
            return RudderCommand(now, safe, True)
        reach = rate * dt if math.isfinite(rate) else math.inf
        return RudderCommand(now, math.copysign(max(abs(safe) - reach, 0.0), safe), True)


def against_engaging(memory: Memory, failsafe: FailsafeAction, state: NavState) -> str:
    """Return what would keep an order to engage waiting: no heading, or who has the helm; '' where nothing would.

    A helm that has only to be proved on engaging is none of it: the order is what has it proved.
    """
    if _lost(state, failsafe):
        return NO_HEADING
    taken = _taken(memory)
    return "" if taken is None or taken.cause is HelmCause.UNPROVEN else taken.reason


def _lost(state: NavState, failsafe: FailsafeAction) -> str:
    heading, rate = state.heading, state.rate
    if heading != heading or rate != rate:
        return NOT_FINITE
    if not state.valid or not state.heading_age <= failsafe.heading_timeout:
        return HEADING_LOST
    return ""


def _taken(memory: Memory) -> HelmSample | None:
    """Return who says that the helm is away, if anybody; whose helm is nobody's comes last."""
    away: HelmSample | None = None
    for sample in memory.helm.values():
        if sample.available:
            continue
        if away is None or _rank(sample) < _rank(away):
            away = sample
    return away


def _rank(away: HelmSample) -> int:
    return NOBODYS.get(away.cause, 0)


def _first(found: Mapping[str, AlarmEvent], *responses: Response) -> str:
    """Return the name of the first finding that calls for one of `responses`, in their order."""
    for response in responses:
        for name in found:
            if CATALOGUE[name].response is response:
                return name
    return ""


def _event_of(name: str) -> Event:
    """Return the event that an alarm of the catalogue is, which ends an engagement."""
    events = {Response.FAULT: Event.UNFIT_COMMAND, Response.LET_GO: Event.RUDDER_TROUBLE}
    return events.get(CATALOGUE[name].response, Event.TROUBLE)


def _order_event(order: Order) -> Event:
    if order.kind is not OrderKind.HEADING:
        return Event.ORDER_TRIAL
    return Event.ORDER_TRACK if order.is_led else Event.ORDER_HEADING


NOBODYS = {HelmCause.UNREADY: 1, HelmCause.UNPROVEN: 2}
"""Causes by which nobody has taken the helm, and their ranks: of two the lower weighs more."""
TAKEN_BY = {
    HelmCause.TAKEN: "human_override",
    HelmCause.REBOOTED: "firmware_rebooted",
    HelmCause.SILENT: LINK_SILENT,
    HelmCause.RADIO_LOST: "radio_lost",
    HelmCause.UNPROVEN: "human_override",
    HelmCause.STOOD_STILL: "stood_still",
    HelmCause.UNREADY: "human_override",
}
"""The alarm that each cause of a lost helm is."""


def _alarm_of(taken: HelmSample) -> AlarmEvent:
    """Return the alarm where a link gives a cause and a reason for the lost helm."""
    return AlarmEvent(TAKEN_BY[taken.cause], taken.reason, OVERRIDDEN)
