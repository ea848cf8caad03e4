"""PX4's Offboard mode: the headings go out as velocities, and PX4 steers and works the throttle. Pure.

Of a velocity over the ground PX4's rover modules make a speed and the heading atan2(east, north); a heading or a rate
of turn in the message has no say (AckermannOffboardMode.cpp, 1.16 to 1.18; mavlink_receiver.cpp,
handle_message_set_position_target_local_ned). PX4 takes Offboard only where setpoints come already, and leaves it
COM_OF_LOSS_T after the last, 1 s by default, for what COM_OBL_RC_ACT says. They are a sign of life in any mode: were
they sent without an order, one that PX4 had fallen back from would begin again by itself. So they are sent while an
order to engage waits, at no speed, and while we steer. Only a human changes the mode.

Nothing acknowledges a setpoint, and without speed PX4 lays no rudder. So the proof is sailed when the human has given
both the order and the mode: ahead until there is way on, then to either side, and the rate of turn must change sides.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.authority import OFFBOARD_MODE, ControlAuthority
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.guided import CHANGE_S, GuidedTargets
from autopilot.signals import Tick
from autopilot.supervision.supervisor import waits_to_engage

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
OTHER = (
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
            self._refusal = OTHER
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
