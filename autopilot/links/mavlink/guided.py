"""A vehicle that steers itself to our headings: ArduRover's GUIDED mode and PX4's Offboard mode, and the proof. Pure.

GUIDED. Whether the vehicle takes our headings is found out before the pilot may engage, and without starting it.
Nothing acknowledges a heading target, and up to 4.7 ArduRover reports a bearing of 0 whatever it holds. What shows is
the rudder: the firmware's controller lays it to the side of the target, at rest too. So the target lies in turn to
starboard and to port of the present heading, and the steering servo of SERVO_OUTPUT_RAW must change sides with it, four
times over. Newer firmware repeats the heading in NAV_CONTROLLER_OUTPUT: then two sides are enough. Without a steering
servo (two motors) the rate of turn must change sides, which takes way on.

A target lets the boat go at its thrust's speed, or at the throttle stick's if that is more. So the proof asks for no
speed, and where the boat is not under way the stick must be neutral.

SET_ATTITUDE_TARGET is obeyed in GUIDED mode alone, only with its thrust, which is the share of WP_SPEED (CRUISE_SPEED
where that is 0) to go at: a throttle stick that asks for more has its way. Body rates masked out make the quaternion's
yaw a heading. Without a new target for 3 s (GUID_TIMEOUT on newer firmware) the boat stops and loiters.
(ArduPilot, Rover/GCS_MAVLink_Rover.cpp, handle_set_attitude_target; Rover/mode_guided.cpp; Rover/mode.cpp.)

Before the pilot may engage the rudder must show that the headings are taken (`GuidedProof`); while it steers,
NAV_CONTROLLER_OUTPUT must not show a place of the vehicle's own, and the boat must not turn away from the headings.

Offboard. The headings go out as velocities, and PX4 steers and works the throttle. Of a velocity over the ground PX4's
rover modules make a speed and the heading atan2(east, north); a heading or a rate of turn in the message has no say
(AckermannOffboardMode.cpp, 1.16 to 1.18; mavlink_receiver.cpp, handle_message_set_position_target_local_ned). PX4 takes
Offboard only where setpoints come already, and leaves it COM_OF_LOSS_T after the last, 1 s by default, for what
COM_OBL_RC_ACT says. They are a sign of life in any mode: were they sent without an order, one that PX4 had fallen back
from would begin again by itself. So they are sent while an order to engage waits, at no speed, and while we steer. Only
a human changes the mode.

Nothing acknowledges a setpoint, and without speed PX4 lays no rudder. So the proof is sailed when the human has given
both the order and the mode: ahead until there is way on, then to either side, and the rate of turn must change sides.
"""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import compass_text, shortest_turn
from autopilot.links.mavlink.authority import OFFBOARD_MODE, ControlAuthority
from autopilot.links.mavlink.codec import Message
from autopilot.links.rudder_order import Release, ReleaseState, not_held
from autopilot.signals import AlarmEvent, Mode, OrderKind, Tick
from autopilot.supervision.supervisor import waits_to_engage

ASIDE = math.radians(10.0)
"""From the present heading to a side. ArduRover's default gains make 7 % of the rudder of it at 4 m/s."""
STRAYS = math.radians(5.0)
"""The two sides stay where they are while the boat swings by less than this between them."""
SIDES = 5
"""A rudder that swings by itself goes with so many changes at no period longer than two sides."""
ECHOED_SIDES = 2
LEAST_SHARE = 0.02
"""Of full rudder, from side to side: three times what the gyro's noise and the seaway make of default gains."""
LEAST_RATE = math.radians(1.0)
SERVO_SIDE_S, RATE_SIDE_S = 0.8, 3.0
SETTLED = 0.65
"""From this share of a side on its reports count: what shows is as old as the link."""
LATE_S = 1.5
"""A report may be this late on a bad line."""
REPORT_TIMEOUT_S = 1.0
ECHO_WITHIN = math.radians(1.1)
"""The report is in whole degrees, cut off."""
RUN_S = 3.0
"""A boat that ran less than this ago, by a hand or by us, is under way."""
TOO_SELDOM = "the vehicle reports its steering servo too seldom (SERVO_OUTPUT_RAW) to be judged by; use a faster line"
STICK = (
    "a heading would start the boat: the throttle stick asks for way while the vehicle keeps its place in GUIDED; "
    "put the stick to neutral, and ahead when the pilot has engaged"
)
STICK_UNKNOWN = "a heading might start the boat: waiting to see the throttle stick (RC_CHANNELS)"
NO_SERVO = (
    "at rest nothing shows whether the vehicle takes headings: no servo output has the function 26 (GroundSteering); "
    "make way in MANUAL and switch to GUIDED then"
)
NO_REPORTS = "waiting for the vehicle to report its steering servo (SERVO_OUTPUT_RAW)"
OTHER = (
    "another companion or ground station guides the vehicle already: it makes way in GUIDED without a heading of ours; "
    "stop that one first"
)


class Verdict(Enum):
    """How the proof stands."""

    OPEN = 0
    PASSED = 1
    FAILED = 2


class Shown(NamedTuple):
    """What the vehicle shows; times in s, None or -inf where it has not come.

    has_servo: whether an output steers; servo_time: of its last report.  stick_asks: the throttle stick is out of
    neutral.  runs: the engine runs by heading and speed in GUIDED.  ran_time: when it last ran by a hand or by us.
    ours_time: of our last target.
    """

    has_servo: bool = False
    servo_time: float = -math.inf
    stick_asks: bool | None = None
    runs: bool = False
    ran_time: float = -math.inf
    ours_time: float = -math.inf

    def is_under_way(self, now: float) -> bool:
        """Return whether the boat makes way that a heading target only goes on with."""
        return now - self.ran_time <= RUN_S

    def obstacle(self, now: float) -> str:
        """Return why no proof may begin; empty where one may."""
        if self.runs and not self.is_under_way(now) and now - self.ours_time > RUN_S:
            return OTHER
        if not self.is_under_way(now):
            if self.stick_asks is None:
                return STICK_UNKNOWN
            if self.stick_asks:
                return STICK
        if not self.has_servo:
            return "" if self.is_under_way(now) else NO_SERVO
        return NO_REPORTS if now - self.servo_time > REPORT_TIMEOUT_S else ""


class GuidedProof:
    """One try, begun at `now` [s]; `by_servo`: the steering servo is judged, otherwise the rate of turn."""

    def __init__(self, now: float, by_servo: bool) -> None:
        self._by_servo = by_servo
        self._side_s = SERVO_SIDE_S if by_servo else RATE_SIDE_S
        self._reports: list[list[float]] = [[]]
        self._echoes: list[bool] = [False]
        self._began = now
        self._base: float | None = None

    def heading(self, heading: float) -> float:
        """Return the target [rad] for a boat that heads for `heading` [rad]."""
        strayed = 0.0 if self._base is None else shortest_turn(self._base, heading)
        self._base = heading - min(max(strayed, -STRAYS), STRAYS)
        return self._base + (ASIDE if len(self._reports) % 2 == 1 else -ASIDE)

    def take(self, now: float, value: float) -> None:
        """Take the servo's share of full rudder, or the rate of turn [rad/s], starboard positive."""
        if self._is_settled(now):
            self._reports[-1].append(value)

    def bearing(self, now: float, target: float, bearing: float) -> None:
        """Take the bearing [rad] reported while `target` [rad] is sent."""
        if self._is_settled(now):
            self._echoes[-1] = abs(shortest_turn(target, bearing)) < ECHO_WITHIN

    @property
    def echoes(self) -> bool:
        """Whether the vehicle repeats the headings that it is sent."""
        return len(self._echoes) >= ECHOED_SIDES and all(self._echoes[:ECHOED_SIDES])

    def verdict(self, now: float) -> Verdict:
        """Return how the proof stands at `now`; a side lasts until it has been reported of."""
        if self.echoes:
            return Verdict.PASSED
        if now - self._began < self._side_s:
            return Verdict.OPEN
        if not self._reports[-1]:
            return Verdict.OPEN if now - self._began < self._side_s + LATE_S else Verdict.FAILED
        if len(self._reports) == SIDES:
            return Verdict.PASSED if not self.refusal else Verdict.FAILED
        self._reports.append([])
        self._echoes.append(False)
        self._began = now
        return Verdict.OPEN

    @property
    def refusal(self) -> str:
        """Why the vehicle does not take our headings, as its reports tell after all sides; empty where it does."""
        if len(self._reports) < SIDES or not all(self._reports):
            return TOO_SELDOM
        levels = [sum(reports) / len(reports) for reports in self._reports]
        least = LEAST_SHARE if self._by_servo else LEAST_RATE
        steps = [before - after for before, after in pairwise(levels)]
        if all((step if number % 2 == 0 else -step) >= least for number, step in enumerate(steps)):
            return ""
        shows = "its steering servo does not move" if self._by_servo else "it does not turn"
        return (
            f"the vehicle does not take our heading targets: {shows} to their side, from port to starboard and back; "
            "stop what else guides it, and check its steering gains (ATC_STR_RAT_FF, ATC_STR_ANG_P; with PX4 RO_YAW_P, "
            "RO_YAW_RATE_P)"
        )

    def _is_settled(self, now: float) -> bool:
        return now - self._began >= SETTLED * self._side_s


def stray_bearing(bearing: float, target_bearing: float, distance: float) -> str:
    """Return the sentence about a vehicle that steers to a point of its own; empty while it holds heading and speed.

    With a heading and a speed all three of NAV_CONTROLLER_OUTPUT are 0 [rad, rad, m], or the first is the heading.
    """
    if not target_bearing and not distance:
        return ""
    return (
        f"the vehicle has left our headings for a place of its own, {distance:.0f} m off in "
        f"{compass_text(bearing)} deg: our targets do not arrive, or another guides it"
    )


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
FOLLOWS_WITHIN = math.radians(4.0)
"""A heading in a turn moves on between two targets."""
RETRY_S = 4.0
FAR_OFF = math.radians(20.0)
AWAY = math.radians(30.0)
WRONG_SIDE = 0.1
"""Share of full rudder."""
AWAY_S = 2.0
"""A boat far off the heading sent that turns further away, or has its rudder on the wrong side, for this long follows
somebody else."""
PROGRESS = math.radians(2.0)
PROGRESS_S = 15.0
"""A boat that is far off its ordered heading comes nearer by this much in this time."""

TIMEOUT_S = 3.0
"""A target older than this ends (GUID_TIMEOUT on newer firmware)."""
GOES_ON = (
    "no more headings are sent; in GUIDED the flight controller goes on with the last one for 3 s, then stops and "
    "loiters"
)

UNPROVEN = "checking that the vehicle takes heading targets"
UNFIT = "the firmware steers (guided): only headings can be ordered, no rudder angles"
TURNS_AWAY = "the boat turns away from the headings we send: another companion or ground station guides it"


class GuidedTargets:
    """Makes the targets for one vehicle from the pilot's ticks, and watches that they are taken.

    Args:
        authority: gets what we send, and judges what is reported.  speed_share: the thrust in each target, 0 to 1.

    Attributes:
        target: the vehicle's system id.  alarm: what the skipper should know though steering goes on.
        timeout [s]: a target older than this ends.  goes_on: what the vehicle does then, once we have left.
        unproven: what is said while the proof is under way.
    """

    timeout = TIMEOUT_S
    goes_on = GOES_ON
    unproven = UNPROVEN

    def __init__(self, authority: ControlAuthority, speed_share: float) -> None:
        if not 0.0 <= speed_share <= 1.0:
            raise ValueError(f"guided speed share: allowed is 0 to 1, got {speed_share}")
        self.target = 0
        self._authority = authority
        self._thrust = speed_share
        self._start: float | None = None
        self._unfit = self._stray = ""
        self._shown = Shown()
        self._echoes = False
        self._share = 0.0
        self._engaged_time = -math.inf
        self._last_target: float | None = None
        self.reset()

    def reset(self) -> None:
        """Ask for the proof anew, as after a reboot, an override, or a pause."""
        self._authority.released()
        self._refusal, self._has_failed = self.unproven, False
        self._passed = False
        self._proof: GuidedProof | None = None
        self._was_at_rest = True
        self._next_try = -math.inf
        self._sent: deque[tuple[float, float]] = deque()
        self._last: float | None = None
        self._nearest: tuple[float, float] | None = None
        self._away_since: float | None = None
        self.alarm: AlarmEvent | None = None

    @property
    def reason(self) -> str:
        """Why the helm is not ours yet; empty once the vehicle has shown that it takes our headings."""
        return self._unfit or ("" if self._passed else self._refusal)

    def report(self, now: float, bearing: float, target_bearing: float = 0.0, distance: float = 0.0) -> None:
        """Take nav_bearing and target_bearing [rad] and the distance [m] of NAV_CONTROLLER_OUTPUT."""
        self._stray = stray_bearing(bearing, target_bearing, distance)
        if self._proof is not None and not self._passed:
            if self._sent and not self._stray:
                self._proof.bearing(now, self._sent[-1][1], bearing)
        elif self._authority.steering:
            agrees, sentence = not self._stray, self._stray
            if self._echoes and not self._stray:
                agrees = any(abs(shortest_turn(sent, bearing)) < FOLLOWS_WITHIN for _, sent in self._sent)
                wanted = compass_text(self._sent[-1][1]) if self._sent else "none"
                sentence = (
                    f"the vehicle does not follow our headings: it steers {compass_text(bearing)} deg while "
                    f"{wanted} is sent (another companion or ground station guides it)"
                )
            if self._authority.echo.disagrees(now, "NAV_CONTROLLER_OUTPUT", agrees):
                self._authority.refuse(sentence)

    def rudder(self, now: float, share: float) -> None:
        """Take where the steering servo stands: its share of full rudder, starboard positive."""
        self._shown = self._shown._replace(servo_time=now)
        self._share = share
        if self._proof is not None and self._shown.has_servo:
            self._proof.take(now, share)

    def outputs(self, has_servo: bool) -> None:
        """Take whether a servo output steers."""
        self._shown = self._shown._replace(has_servo=has_servo)

    def stick(self, asks: bool | None) -> None:
        """Take whether the throttle stick is out of neutral; None: unknown."""
        self._shown = self._shown._replace(stick_asks=asks)

    def engine(self, now: float, is_running: bool, is_guided: bool) -> None:
        """Take whether the engine runs, and whether in GUIDED."""
        if is_running and (not is_guided or now - self._engaged_time <= RUN_S):
            self._shown = self._shown._replace(ran_time=now, runs=False)
        else:
            self._shown = self._shown._replace(runs=is_running and is_guided and not self._stray)

    def next_target(self, tick: Tick, may_prove: bool) -> Message | None:
        """Return the target that is due after `tick`, None where none is; `may_prove`: all else allows to steer."""
        now = tick.now
        heading = self._request(tick, may_prove)
        self._watch_course(tick)
        self._watch_side(tick)
        if heading is None:
            if self._sent:
                refusal, has_failed, next_try = self._refusal, self._has_failed, self._next_try
                self.reset()
                self._refusal, self._has_failed, self._next_try = refusal, has_failed, next_try
            return None
        last_time, last = self._sent[-1] if self._sent else (-math.inf, heading)
        # a proof has little time for each side, and a bad line loses some of it
        changed = abs(shortest_turn(last, heading)) > CHANGE or not tick.command.engaged
        if now - last_time < (CHANGE_S if changed else REFRESH_S):
            return None
        self._sent.append((now, heading))
        while now - self._sent[0][0] > HISTORY_S:
            self._sent.popleft()
        self._shown = self._shown._replace(ours_time=now)
        if tick.command.engaged:
            self._engaged_time = now
            self._authority.commanded(now, None)
        return self._message(now, heading, self._pace(now))

    def parting(self, now: float) -> list[Message]:
        """Return what is sent last, on the way out."""
        return []

    def release(self, now: float, link: str) -> Release:
        """Return what becomes of the rudder when no more targets are sent: there is no message that takes one back."""
        if self._last_target is None or now - self._last_target > self.timeout:
            return not_held(link)
        return Release(link, ReleaseState.UNSHOWN, lapse=self.goes_on)

    def _request(self, tick: Tick, may_prove: bool) -> float | None:
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
        return self._proof_heading(tick)

    def _proof_heading(self, tick: Tick) -> float | None:
        now, shown = tick.now, self._shown
        if not math.isfinite(tick.state.heading):
            return None
        if self._proof is None:
            if now < self._next_try:
                return None
            if obstacle := self._obstacle(now):
                self._refusal, self._has_failed = obstacle, False
                return None
            self._proof, self._passed = GuidedProof(now, shown.has_servo), False
            self._was_at_rest = not shown.is_under_way(now)
            # what the last try found stays said while the next is under way
            self._refusal = self._refusal if self._has_failed else self.unproven
        elif self._was_at_rest and shown.stick_asks and not self._passed:
            self._fail(now, STICK)
            self._has_failed = False
            return None
        elif not self._passed:
            if not shown.has_servo:
                self._proof.take(now, tick.state.rate)
            verdict = self._proof.verdict(now)
            if verdict is Verdict.FAILED:
                self._fail(now, self._proof.refusal)
                return None
            self._passed, self._echoes = verdict is Verdict.PASSED, self._proof.echoes
        return self._proof.heading(tick.state.heading) if not self._passed else tick.state.heading

    def _obstacle(self, now: float) -> str:
        """Return why no proof may begin; empty where one may."""
        return self._shown.obstacle(now)

    def _pace(self, now: float) -> float:
        """Return the thrust: a proof goes on with what we ran the boat at, and starts none."""
        return self._thrust if now - self._engaged_time <= RUN_S else 0.0

    def _fail(self, now: float, refusal: str) -> None:
        self._proof, self._refusal, self._has_failed, self._next_try = None, refusal, True, now + RETRY_S

    def _watch_course(self, tick: Tick) -> None:
        """A vehicle without way on takes every target and turns to none."""
        error = abs(shortest_turn(tick.order.heading, tick.state.heading)) if tick.mode is Mode.ENGAGED else 0.0
        if not error > FAR_OFF:
            self._nearest, self.alarm = None, None
        elif self._nearest is None or error < self._nearest[1] - PROGRESS or error > self._nearest[1] + FAR_OFF:
            self._nearest, self.alarm = (tick.now, error), None
        elif tick.now - self._nearest[0] > PROGRESS_S:
            self.alarm = AlarmEvent("targets_lag")

    def _watch_side(self, tick: Tick) -> None:
        """Give the helm up where the boat follows another's headings, which no report shows."""
        error = shortest_turn(tick.state.heading, self._sent[-1][1]) if self._sent else 0.0
        turns_away = abs(error) > AWAY and error * tick.state.rate < 0.0
        is_over = abs(error) > FAR_OFF and error * self._share < 0.0 and abs(self._share) > WRONG_SIDE
        is_away = self._authority.steering and (turns_away or is_over)
        if not is_away:
            self._away_since = None
        elif self._away_since is None:
            self._away_since = tick.now
        elif tick.now - self._away_since > AWAY_S:
            self._authority.refuse(TURNS_AWAY)

    def _elapsed_ms(self, now: float) -> int:
        """Return the time that a target of now carries, and take that it is sent."""
        self._last_target = now
        if self._start is None:
            self._start = now
        return int((now - self._start) * 1000.0) & 0xFFFFFFFF

    def _message(self, now: float, heading: float, pace: float) -> Message:
        turn = [math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)]
        return dialect.MAVLink_set_attitude_target_message(
            self._elapsed_ms(now), self.target, 1, IGNORED, turn, 0.0, 0.0, 0.0, pace
        )


VELOCITY_ALONE = (
    dialect.POSITION_TARGET_TYPEMASK_X_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_Z_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    | dialect.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)
STILL = 1.0e-8
"""Speed [m/s] that PX4 takes for none (FLT_EPSILON is 1.2e-7): the motor stops, and the velocity still has a heading.
That of a velocity of nothing is north, and PX4 turns there where RO_DECEL_LIM stops it slowly."""
WAY_ON = 0.5
"""Share of the ordered speed at which the proof begins."""
RUN_UP_S = 12.0
STOPPING_S = 0.5
"""So long no speed is ordered before the setpoints end."""
LOSS_S = 1.0
"""COM_OF_LOSS_T by default."""
OURS_S = 3.0
"""A vehicle that is in Offboard so long [s] after our last setpoint is kept there by another's."""
OTHER_SETPOINTS = (
    "another companion or ground station sends setpoints already: the vehicle is in Offboard without one of ours; stop "
    "that one first, or leave Offboard"
)
NO_WAY = (
    "the boat makes no way on our velocities: stop what else sends setpoints, let PX4 take them from this link "
    "(MAV_FWDEXTSP), and check its speed control (RO_MAX_THR_SPEED, RO_SPEED_LIM)"
)


class OffboardTargets(GuidedTargets):
    """Velocities in the place of heading targets; `speed` [m/s] is that to go at. ValueError where it is none."""

    timeout = LOSS_S
    unproven = "checking that the vehicle takes our headings: it makes way and swings 10 deg to either side"
    goes_on = (
        "no speed was ordered last and no more setpoints are sent: the flight controller leaves Offboard after "
        "COM_OF_LOSS_T (1 s by default), for the mode that COM_OBL_RC_ACT says"
    )

    def __init__(self, authority: ControlAuthority, speed: float) -> None:
        if not 0.0 < speed < math.inf:
            raise ValueError(f"offboard speed: allowed is a positive number of m/s, got {speed}")
        super().__init__(authority, 0.0)
        self._speed = speed
        self._stopping = -math.inf

    def reset(self) -> None:
        """Ask for the proof anew, and run up to it."""
        super().reset()
        self._run_up: tuple[float, float] | None = None

    def next_target(self, tick: Tick, may_prove: bool) -> Message | None:
        """Return the setpoint that is due after `tick`; at no speed where an order waits, or has just ended."""
        now, waits = tick.now, waits_to_engage(tick)
        since = math.inf if self._last_target is None else now - self._last_target
        if self._authority.obstacle:
            return None
        if since > OURS_S and self._is_obeyed:
            self._refusal = OTHER_SETPOINTS
            return None
        found = super().next_target(tick, may_prove)
        if found is not None:
            self._stopping = now + STOPPING_S
            return found
        has_reason = not tick.command.engaged and (waits or (now < self._stopping and self._is_obeyed))
        if not has_reason or since < CHANGE_S or not math.isfinite(tick.state.heading):
            return None
        return self._message(now, tick.state.heading, STILL)

    def parting(self, now: float) -> list[Message]:
        """Return what stops the boat before the setpoints end, none where it does not follow ours."""
        if self._last_target is None or now - self._last_target > LOSS_S or not self._is_obeyed:
            return []
        return [self._message(now, self._last_heading, STILL) for _ in range(3)]

    @property
    def _is_obeyed(self) -> bool:
        return self._authority.armed and self._authority.mode == OFFBOARD_MODE

    def _obstacle(self, now: float) -> str:
        return ""

    def _pace(self, now: float) -> float:
        return self._speed

    def _proof_heading(self, tick: Tick) -> float | None:
        now, heading = tick.now, tick.state.heading
        if self._proof is not None or now < self._next_try or tick.state.speed >= WAY_ON * self._speed:
            self._run_up = None
            return super()._proof_heading(tick)
        if not math.isfinite(heading):
            return None
        began, ahead = self._run_up = self._run_up or (now, heading)
        if now - began > RUN_UP_S:
            self._run_up = None
            self._fail(now, NO_WAY)
            return None
        return ahead

    def _message(self, now: float, heading: float, pace: float) -> Message:
        self._last_heading = heading
        return dialect.MAVLink_set_position_target_local_ned_message(
            self._elapsed_ms(now),
            self.target,
            1,
            dialect.MAV_FRAME_LOCAL_NED,
            VELOCITY_ALONE,
            *(0.0, 0.0, 0.0),
            *(pace * math.cos(heading), pace * math.sin(heading), 0.0),
            *(0.0, 0.0, 0.0, 0.0, 0.0),
        )
