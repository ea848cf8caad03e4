"""Heading targets for an ArduRover in GUIDED mode, in which the firmware's own controller moves the rudder. Pure.

SET_ATTITUDE_TARGET is obeyed in GUIDED mode alone, only with its thrust, which is the share of WP_SPEED (CRUISE_SPEED
where that is 0) to go at: a throttle stick that asks for more has its way. Body rates masked out make the quaternion's
yaw a heading. Without a new target for 3 s (GUID_TIMEOUT on newer firmware) the boat stops and loiters.
(ArduPilot, Rover/GCS_MAVLink_Rover.cpp, handle_set_attitude_target; Rover/mode_guided.cpp; Rover/mode.cpp.)

Nothing acknowledges a target, so NAV_CONTROLLER_OUTPUT must show its bearing before the pilot may engage, and after.
"""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import compass_deg, shortest_turn
from autopilot.links.helm_watch import HelmWatch
from autopilot.links.mavlink_codec import Message
from autopilot.links.release import Release, ReleaseState, not_held
from autopilot.safety import waits_to_engage
from autopilot.signals import Mode, OrderKind, Tick

IGNORED = (
    dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
    | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
)
REFRESH_S = 0.2
CHANGE_S = 0.1
"""A heading that changes is sent at this interval."""
CHANGE = math.radians(0.1)
HISTORY_S = 1.2
"""A report may show any heading sent within this time."""
SHOWN_WITHIN = math.radians(1.1)
"""The report is in whole degrees, cut off."""
FOLLOWS_WITHIN = math.radians(4.0)
"""A heading in a turn moves on between two targets."""
TOLD_APART = math.radians(3.0)
ASIDE = math.radians(6.0)
"""Where the vehicle steers the present heading already, the proof asks for one this much to starboard."""
SEEN_REPORTS = 2
PATIENCE_S = 2.5
RETRY_S = 4.0
REPORT_TIMEOUT_S = 3.0
FAR_OFF = math.radians(20.0)
PROGRESS = math.radians(2.0)
PROGRESS_S = 15.0
"""A boat that is far off her ordered heading comes nearer by this much in this time."""

TIMEOUT_S = 3.0
"""A target older than this ends (GUID_TIMEOUT on newer firmware)."""
GOES_ON = (
    "no more headings are sent; in GUIDED the flight controller goes on with the last one for 3 s, then stops and "
    "loiters"
)

UNPROVEN = "checking that the vehicle takes heading targets"
UNFIT = "the firmware steers (guided): only headings can be ordered, no rudder angles"
NOT_REPORTED = "waiting for the vehicle to report the bearing it steers (NAV_CONTROLLER_OUTPUT)"
LAGGING = (
    "the vehicle takes our headings but does not turn: check that it makes way (throttle stick, "
    "helm.guided_speed_share) and its steering gains (ATC_STR_RAT_FF, ATC_STR_ANG_P)"
)


class GuidedTargets:
    """Makes the targets for one vehicle from the pilot's ticks, and watches that they are taken.

    Args:
        watch: told what we send, and judges what is reported.  speed_share: the thrust in each target, 0 to 1.

    Attributes:
        target: the vehicle's system id.  alarm: what the skipper should know though steering goes on.
    """

    def __init__(self, watch: HelmWatch, speed_share: float) -> None:
        if not 0.0 <= speed_share <= 1.0:
            raise ValueError(f"guided speed share: allowed is 0 to 1, got {speed_share}")
        self.target = 0
        self._watch = watch
        self._thrust = speed_share
        self._start: float | None = None
        self._bearing: tuple[float, float] | None = None
        self._unfit = ""
        self._last_target: float | None = None
        self.reset()

    def reset(self) -> None:
        """Ask for the proof anew, as after a reboot, an override, or a pause."""
        self._refusal = UNPROVEN
        self._passed = False
        self._proof: float | None = None
        self._began = self._next_try = -math.inf
        self._seen = 0
        self._sent: deque[tuple[float, float]] = deque()
        self._last: float | None = None
        self._nearest: tuple[float, float] | None = None
        self.alarm = ""

    @property
    def reason(self) -> str:
        """Why the helm is not ours yet; empty once the vehicle has shown that it takes our headings."""
        return self._unfit or ("" if self._passed else self._refusal)

    def report(self, now: float, bearing: float) -> None:
        """Take the bearing [rad] that the vehicle reports to steer."""
        self._bearing = (now, bearing)
        if self._proof is not None and not self._passed:
            self._judge_proof(now, bearing)
        elif self._watch.steering:
            agrees = any(abs(shortest_turn(sent, bearing)) < FOLLOWS_WITHIN for _, sent in self._sent)
            wanted = compass_deg(self._sent[-1][1]) if self._sent else math.nan
            sentence = (
                f"the vehicle does not follow our headings: it steers {compass_deg(bearing):.0f} deg while "
                f"{wanted:.0f} is sent (another companion or ground station guides it)"
            )
            self._watch.judge(now, "NAV_CONTROLLER_OUTPUT", agrees, sentence)

    def show(self, tick: Tick, may_prove: bool) -> Message | None:
        """Return the target that is due after `tick`, None where none is; `may_prove`: all else allows to steer."""
        now = tick.now
        heading = self._wish(tick, may_prove)
        self._watch_course(tick)
        if heading is None:
            if self._sent:
                self._watch.released()
                self.reset()
            return None
        last_time, last = self._sent[-1] if self._sent else (-math.inf, heading)
        changed = abs(shortest_turn(last, heading)) > CHANGE
        if now - last_time < (CHANGE_S if changed else REFRESH_S):
            return None
        self._sent.append((now, heading))
        while now - self._sent[0][0] > HISTORY_S:
            self._sent.popleft()
        if tick.command.engaged:
            self._watch.commanded(now, None)
        return self._message(now, heading)

    def release(self, now: float, link: str) -> Release:
        """Return what becomes of the rudder when no more targets are sent: there is no message that takes one back."""
        if self._last_target is None or now - self._last_target > TIMEOUT_S:
            return not_held(link)
        return Release(link, ReleaseState.UNSHOWN, lapse=GOES_ON)

    def _wish(self, tick: Tick, may_prove: bool) -> float | None:
        """Return the heading [rad] that the vehicle shall steer now, None for none."""
        is_heading = tick.order.kind is OrderKind.HEADING
        self._unfit = "" if is_heading or tick.order.kind is OrderKind.STANDBY else UNFIT
        if tick.command.engaged:
            # in a fail-safe that still has the helm, the boat goes on by the firmware's own compass
            if tick.mode is Mode.ENGAGED and is_heading and math.isfinite(tick.reference.heading):
                self._last, self._proof = tick.reference.heading, None
            return self._last if not self._unfit else None
        if not (may_prove and is_heading and tick.state.valid and waits_to_engage(tick)):
            return None
        return self._proof_heading(tick.now, tick.state.heading)

    def _proof_heading(self, now: float, heading: float) -> float | None:
        if self._bearing is None or now - self._bearing[0] > REPORT_TIMEOUT_S:
            self._refusal = NOT_REPORTED
            return None
        if self._proof is None:
            if now < self._next_try or not math.isfinite(heading):
                return None
            there = abs(shortest_turn(self._bearing[1], heading)) < TOLD_APART
            self._proof = heading + ASIDE if there else heading
            self._began, self._seen, self._passed = now, 0, False
            # what the last try found stays said while the next is under way
            self._refusal = UNPROVEN if self._refusal == NOT_REPORTED else self._refusal
        return self._proof

    def _judge_proof(self, now: float, bearing: float) -> None:
        assert self._proof is not None
        self._seen = self._seen + 1 if abs(shortest_turn(self._proof, bearing)) < SHOWN_WITHIN else 0
        if self._seen >= SEEN_REPORTS:
            self._passed = True
        elif now - self._began > PATIENCE_S:
            refusal = (
                f"the vehicle does not take our heading targets: it steers {compass_deg(bearing):.0f} deg while "
                f"{compass_deg(self._proof):.0f} is sent; stop what else guides it"
            )
            self.reset()
            self._refusal, self._next_try = refusal, now + RETRY_S

    def _watch_course(self, tick: Tick) -> None:
        """A vehicle without way on takes every target and turns to none."""
        error = abs(shortest_turn(tick.order.heading, tick.state.heading)) if tick.mode is Mode.ENGAGED else 0.0
        if not error > FAR_OFF:
            self._nearest, self.alarm = None, ""
        elif self._nearest is None or error < self._nearest[1] - PROGRESS or error > self._nearest[1] + FAR_OFF:
            self._nearest, self.alarm = (tick.now, error), ""
        elif tick.now - self._nearest[0] > PROGRESS_S:
            self.alarm = LAGGING

    def _message(self, now: float, heading: float) -> Message:
        self._last_target = now
        if self._start is None:
            self._start = now
        elapsed_ms = int((now - self._start) * 1000.0) & 0xFFFFFFFF
        turn = [math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)]
        return dialect.MAVLink_set_attitude_target_message(
            elapsed_ms, self.target, 1, IGNORED, turn, 0.0, 0.0, 0.0, self._thrust
        )
