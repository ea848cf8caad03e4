"""ArduRover's GUIDED mode towards a companion: heading or turn rate with a speed, steered by the firmware's own PID.

After ArduPilot's Rover/mode_guided.cpp, Rover/mode.cpp (calc_speed_nudge, calc_speed_max), Rover/GCS_MAVLink_Rover.cpp
(handle_set_attitude_target), libraries/APM_Control/AR_AttitudeControl.cpp and libraries/AR_Motors/AP_MotorsUGV.cpp.
Left out: the filters of the rate controller, stick mixing, and the engine of a boat that loiters without a target: it
stops, and reports the heading at which it began to loiter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.weather import GRAVITY
from sitl.firmware_parameters import ParameterTable

TIMEOUT_S = 3.0
"""A target older than this ends."""
ECHOES_SINCE = (4, 8)
"""From this version on NAV_CONTROLLER_OUTPUT shows the heading of a target; before, nav_bearing is 0 then."""
CONTROLLER_TIMEOUT_S = 0.2
"""After a pause this long the rate controller starts anew (AR_ATTCONTROL_TIMEOUT_MS)."""
SLOWEST = 1.0
"""Speed [m/s] below which the limit of lateral acceleration reckons with this one (AR_ATTCONTROL_STEER_SPEED_MIN)."""
LEAST_LIMIT = math.radians(1.0)
SPEED_LIMIT = 30.0


class GuidedGains(NamedTuple):
    """ATC_STR_ANG_P, ATC_STR_RAT_*, limits in rad/s and rad/s^2 (0: none), and what speed scales steering by."""

    angle_p: float
    rate_p: float
    rate_i: float
    rate_d: float
    rate_ff: float
    integral_max: float
    rate_max: float
    acceleration_max: float
    lateral_max: float
    scale_speed: float
    speed: float
    cruise_speed: float
    cruise_share: float
    speed_max: float


def gains_of(parameters: ParameterTable) -> GuidedGains:
    """Return what the parameters give at this moment."""
    return GuidedGains(
        angle_p=parameters["ATC_STR_ANG_P"],
        rate_p=parameters["ATC_STR_RAT_P"],
        rate_i=parameters["ATC_STR_RAT_I"],
        rate_d=parameters["ATC_STR_RAT_D"],
        rate_ff=parameters["ATC_STR_RAT_FF"],
        integral_max=parameters["ATC_STR_RAT_IMAX"],
        rate_max=math.radians(parameters["ATC_STR_RAT_MAX"]),
        acceleration_max=math.radians(parameters["ATC_STR_ACC_MAX"]),
        lateral_max=parameters["ATC_TURN_MAX_G"] * GRAVITY,
        scale_speed=parameters["MOT_SPD_SCA_BASE"],
        speed=parameters["WP_SPEED"] if parameters["WP_SPEED"] > 0.0 else parameters["CRUISE_SPEED"],
        cruise_speed=parameters["CRUISE_SPEED"],
        cruise_share=parameters["CRUISE_THROTTLE"] / 100.0,
        speed_max=parameters["SPEED_MAX"],
    )


class Target(NamedTuple):
    """heading [rad], or else turn_rate [rad/s]; thrust -1..1 of the default speed; time [s] of arrival."""

    heading: float | None
    turn_rate: float
    thrust: float
    time: float


class GuidedHelm:
    """Target and memory of the controller. `target` is None where the boat has none and stops.

    `loiter`: the heading [rad] at which it began to keep its place.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the target, as on entering the mode."""
        self.target: Target | None = None
        self.loiter: float | None = None
        self._integral = 0.0
        self._rate_wanted: float | None = None
        self._error = 0.0
        self._time = -math.inf
        self._saturated = False

    def take(self, target: Target) -> None:
        """Take a target in the place of the one before."""
        self.target = target

    def has_expired(self, time: float) -> bool:
        """Return whether the target has run out just now; it is forgotten then."""
        if self.target is None or time - self.target.time <= TIMEOUT_S:
            return False
        self.clear()
        return True

    def stopping_text(self, version: tuple[int, int]) -> str:
        """Return the STATUSTEXT about a target that has run out."""
        return f"target not received last {f'{TIMEOUT_S:.1f} ' if version >= ECHOES_SINCE else '3'}secs, stopping"

    def bearings_deg(self, version: tuple[int, int]) -> tuple[int, int]:
        """Return nav_bearing and target_bearing of NAV_CONTROLLER_OUTPUT, whole degrees cut off towards zero."""
        if self.target is not None:
            echoes = self.target.heading is not None and version >= ECHOES_SINCE
            return (int(math.degrees(wrap(self.target.heading or 0.0))) if echoes else 0), 0
        loiters_at = int(math.degrees(self.loiter % math.tau)) if self.loiter is not None else 0
        return loiters_at, loiters_at

    def steering(self, gains: GuidedGains, time: float, heading: float, rate: float, speed: float) -> float:
        """Return the steering share -1..1 for a boat at `heading` [rad], `rate` [rad/s], `speed` [m/s]."""
        if self.target is None:
            return 0.0
        dt = time - self._time
        self._time = time
        if dt > CONTROLLER_TIMEOUT_S or self._rate_wanted is None:
            self._rate_wanted, self._integral, self._error, dt = rate, 0.0, 0.0, 0.0
        wanted = self._limited(gains, self._wanted_rate(gains, self.target, heading), speed, dt)
        self._rate_wanted = wanted
        error = wanted - rate
        integral = self._integral + gains.rate_i * error * dt
        # while the output is at its end, or the boat too slow to steer, the integral may only shrink
        if not self._saturated or abs(integral) < abs(self._integral):
            self._integral = min(max(integral, -gains.integral_max), gains.integral_max)
        slope = gains.rate_d * (error - self._error) / dt if dt > 0.0 else 0.0
        self._error = error
        output = gains.rate_p * error + self._integral + slope + gains.rate_ff * wanted
        is_fast = 0.0 < gains.scale_speed < abs(speed)
        scaled = output * (gains.scale_speed / abs(speed) if is_fast else 1.0) * (-1.0 if speed < 0.0 else 1.0)
        self._saturated = abs(scaled) >= 1.0 or not is_fast
        return min(max(scaled, -1.0), 1.0)

    def speed(self, gains: GuidedGains, stick: float) -> float:
        """Return the speed wanted [m/s]: the target's share, or what the throttle stick (-1..1) asks beyond it."""
        if self.target is None:
            return 0.0
        wanted = self.target.thrust * gains.speed
        nudge = stick * self.fastest(gains)
        if (nudge > 0.0 and wanted < 0.0) or (nudge < 0.0 and wanted >= 0.0):
            return wanted
        return min(wanted, nudge) if wanted < 0.0 else max(wanted, nudge)

    def fastest(self, gains: GuidedGains) -> float:
        """Return the speed [m/s] that full throttle is taken to give."""
        if not 0.05 <= gains.cruise_share <= 1.0:
            most = gains.cruise_speed
        else:
            most = gains.speed_max if gains.speed_max > 0.0 else gains.cruise_speed / gains.cruise_share
        return min(max(most, 0.0), SPEED_LIMIT)

    def _wanted_rate(self, gains: GuidedGains, target: Target, heading: float) -> float:
        if target.heading is None:
            return target.turn_rate
        error = wrap(target.heading - heading)
        rate = gains.angle_p * error
        if gains.acceleration_max > 0.0:
            # no faster than can be stopped in what is left of the turn
            most = math.sqrt(2.0 * abs(error) * gains.acceleration_max)
            rate = min(max(rate, -most), most)
        return rate

    def _limited(self, gains: GuidedGains, wanted_rate: float, speed: float, dt: float) -> float:
        before = self._rate_wanted or 0.0
        if gains.acceleration_max > 0.0:
            change = gains.acceleration_max * dt
            wanted_rate = min(max(wanted_rate, before - change), before + change)
        if gains.rate_max > 0.0:
            wanted_rate = min(max(wanted_rate, -gains.rate_max), gains.rate_max)
        most = max(gains.lateral_max / max(abs(speed), SLOWEST), LEAST_LIMIT)
        return min(max(wanted_rate, -most), most)
