"""The supervisor: who has the rudder, and the last word on every command.

    STANDBY  --order with a new serial, heading fresh, helm free-->  ENGAGED
    ENGAGED  --order STANDBY-->                                      STANDBY
    ENGAGED, FAILSAFE --human or firmware takes the helm-->          OVERRIDE
    ENGAGED  --heading stale, anything not finite, envelope broken,
               compass frozen, boat turns against its rudder-->      FAILSAFE
    OVERRIDE, FAILSAFE  --order with a new serial-->                 ENGAGED
    OVERRIDE, FAILSAFE  --order STANDBY-->                           STANDBY
    FAILSAFE, heading lost --heading back for RESUME_AFTER, file says resume--> ENGAGED
    OVERRIDE, FAILSAFE  --vehicle rebooted and ready again, file says so-->    ENGAGED

The envelope check shares no code with the limits that the law obeys.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.signals import (
    REBOOTED,
    SILENT,
    AlarmSample,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    RudderCommand,
    Tick,
)

RESUME_AFTER = 2.0
REENGAGE_WITHIN = 120.0
"""A vehicle that is ready this much later [s] than its reboot was noticed has been seen to by people."""
ENVELOPE_SLACK = 1.0e-9

WAITING_HEADING = "waiting for a heading: check that the compass or the vehicle sends one"
HEADING_LOST = "heading lost: steer by hand, check the compass and its link"
NOT_FINITE = "a value was not finite: steer by hand, keep the log"
ENVELOPE = "command outside its envelope: steer by hand, keep the log"
OVERRIDDEN = "overridden"
CANNOT_ENGAGE = "cannot engage"


def waits_to_engage(tick: Tick) -> bool:
    """Return whether an order to engage waits at `tick` for nothing but the helm."""
    return tick.mode is not Mode.ENGAGED and any(alarm.startswith(CANNOT_ENGAGE) for alarm in tick.alarms)


class FailsafeAction(NamedTuple):
    """heading_timeout [s]; action release, amidships or hold; release_after [s]; resume by itself or not.

    reengage: engage again by itself when the vehicle, having rebooted under us, is ready again.
    """

    heading_timeout: float
    action: str
    release_after: float
    resume: bool
    reengage: bool = False


class Envelope(NamedTuple):
    """What no command may exceed: angle_max [rad], rate_max [rad/s]."""

    angle_max: float
    rate_max: float


class Supervisor:
    """The state machine in the module's docstring. Memory: mode, since when, and which order is spent."""

    def __init__(self, envelope: Envelope, failsafe: FailsafeAction) -> None:
        self._envelope = envelope
        self._failsafe = failsafe
        self.reset()

    def reset(self) -> None:
        """Stand by, with no order seen."""
        self.mode = Mode.STANDBY
        self.reason = ""
        self._cause = ""
        self._since = -math.inf
        self._spent = 0
        self._helm: dict[str, HelmSample] = {}
        self._notes: dict[str, str] = {}
        self._heading_since: float | None = None
        self._rebooted = False
        self._reboot_time = -math.inf

    def reconfigure(self, envelope: Envelope, failsafe: FailsafeAction) -> None:
        """Go on under other limits; mode and memory stay."""
        self._envelope, self._failsafe = envelope, failsafe

    def hear(self, sample: HelmSample) -> None:
        """Take a link's word on whether the helm is free."""
        self._helm[sample.source] = sample
        self._rebooted = self._rebooted or sample.reason.startswith(REBOOTED)

    def note(self, sample: AlarmSample) -> None:
        """Take a link's word on what the skipper should know though steering goes on."""
        if sample.text:
            self._notes[sample.source] = sample.text
        else:
            self._notes.pop(sample.source, None)

    def decide(self, now: float, order: Order, state: NavState, monitored: str = "") -> Mode:
        """Return the mode at `now` [s]: the table in the module's docstring.

        `monitored`: the trouble that a monitor has found, "" for none.
        """
        trouble = self._trouble(state) or monitored
        self._watch_heading(now, trouble)
        self._watch_reboot(now)
        taken = next((sample.reason for sample in self._helm.values() if not sample.available), None)
        if order.kind is OrderKind.STANDBY:
            self._enter(now, Mode.STANDBY, "")
        elif taken is not None and self._steers(now):
            # a fail-safe that still moves the rudder gives way to a hand on the helm as well
            self._enter(now, Mode.OVERRIDE, f"{OVERRIDDEN}: {taken}", spend=order)
        elif self.mode is Mode.ENGAGED:
            if trouble:
                self._enter(now, Mode.FAILSAFE, trouble, spend=order)
        elif order.serial != self._spent or self._may_resume(now):
            if taken is not None:
                self.reason = f"{CANNOT_ENGAGE}: {taken}"
            elif trouble:
                self.reason = WAITING_HEADING if trouble == HEADING_LOST else trouble
            else:
                self._enter(now, Mode.ENGAGED, "")
        return self.mode

    def check(
        self, now: float, order: Order, previous: float, demand: float, limited: float, dt: float
    ) -> RudderCommand:
        """Return the command that leaves: `limited` [rad] when engaged and inside the envelope, else the fail-safe's.

        `previous` [rad] is what the rudder was told `dt` [s] before; `demand` [rad] is what the law wanted.
        """
        if self.mode is Mode.ENGAGED:
            if not math.isfinite(demand):
                self._enter(now, Mode.FAILSAFE, NOT_FINITE, spend=order)
            elif not self._inside(previous, limited, dt):
                self._enter(now, Mode.FAILSAFE, ENVELOPE, spend=order)
            else:
                return RudderCommand(now, limited, True)
        if self.mode is Mode.FAILSAFE:
            return self._failsafe_command(now, previous, dt)
        return RudderCommand(now, 0.0, False)

    def alarms(self) -> tuple[str, ...]:
        """Return what the skipper must hear now, with what to do; () when all is well."""
        notes = tuple(self._notes.values())
        return (self.reason, *notes) if self.reason else notes

    def _trouble(self, state: NavState) -> str:
        if math.isnan(state.heading) or math.isnan(state.rate):
            return NOT_FINITE
        if not state.valid or not state.heading_age <= self._failsafe.heading_timeout:
            return HEADING_LOST
        return ""

    def _watch_heading(self, now: float, trouble: str) -> None:
        if trouble:
            self._heading_since = None
        elif self._heading_since is None:
            self._heading_since = now

    def _steers(self, now: float) -> bool:
        return self.mode is Mode.ENGAGED or (self.mode is Mode.FAILSAFE and not self._is_released(now))

    def _is_released(self, now: float) -> bool:
        return self._failsafe.action == "release" or now - self._since >= self._failsafe.release_after

    def _watch_reboot(self, now: float) -> None:
        """Note a reboot heard of, unless we stand by; in the tick that ends the engagement the old mode is still on."""
        if self._rebooted and self.mode is not Mode.STANDBY:
            self._reboot_time = now
        self._rebooted = False

    def _ended_by_reboot(self, now: float) -> bool:
        """Return whether a reboot not long ago, or the silence that went with it, is what ended the engagement."""
        causes = (HEADING_LOST, f"{OVERRIDDEN}: {REBOOTED}", f"{OVERRIDDEN}: {SILENT}")
        return now - self._reboot_time < REENGAGE_WITHIN and self._cause.startswith(causes)

    def _may_resume(self, now: float) -> bool:
        """Only a lost heading and a reboot heal by themselves: what else ended the engagement would end it again."""
        if self._heading_since is None or now - self._heading_since < RESUME_AFTER:
            return False
        if self._failsafe.reengage and self._ended_by_reboot(now):
            return True
        return self.mode is Mode.FAILSAFE and self._failsafe.resume and self._cause == HEADING_LOST

    def _enter(self, now: float, mode: Mode, reason: str, spend: Order | None = None) -> None:
        if spend is not None:
            self._spent = spend.serial
        if mode is not self.mode:
            self._since = now
        if mode in (Mode.ENGAGED, Mode.STANDBY):
            self._reboot_time = -math.inf
        self.mode = mode
        self.reason = self._cause = reason

    def _inside(self, previous: float, command: float, dt: float) -> bool:
        if not math.isfinite(command) or abs(command) > self._envelope.angle_max + ENVELOPE_SLACK:
            return False
        return abs(command - previous) <= self._reach(dt) + ENVELOPE_SLACK

    def _reach(self, dt: float) -> float:
        return self._envelope.rate_max * dt if math.isfinite(self._envelope.rate_max) else math.inf

    def _failsafe_command(self, now: float, previous: float, dt: float) -> RudderCommand:
        if self._is_released(now):
            return RudderCommand(now, 0.0, False)
        safe = previous if math.isfinite(previous) else 0.0
        if self._failsafe.action == "hold":
            return RudderCommand(now, safe, True)
        return RudderCommand(now, math.copysign(max(abs(safe) - self._reach(dt), 0.0), safe), True)
