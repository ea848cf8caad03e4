"""What a vehicle says of its battery, its fence and the water below it, as conditions for the pilot. Pure.

SYS_STATUS and BATTERY_STATUS: charge and charge state; SYS_STATUS: the fence where it is enabled and unhealthy;
FENCE_STATUS: breached; STATUSTEXT: "Fence Breached" (ArduPilot, AC_Fence) and what has "shallow" in it.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message, message_id
from autopilot.signals import ConditionSample, Sample

TEXT_LASTS_S = 60.0
"""A vehicle says once in words what is the case; nobody says when it is over."""
RECOVERED_PERCENT = 3.0
"""A charge that wavers about its limit is one alarm: it is over this far above."""
BAD_CHARGES = (
    dialect.MAV_BATTERY_CHARGE_STATE_LOW,
    dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
    dialect.MAV_BATTERY_CHARGE_STATE_FAILED,
    dialect.MAV_BATTERY_CHARGE_STATE_UNHEALTHY,
)
FENCE = dialect.MAV_SYS_STATUS_GEOFENCE
SYSTEM = dialect.MAVLINK_MSG_ID_SYS_STATUS
BATTERY = dialect.MAVLINK_MSG_ID_BATTERY_STATUS
FENCING = dialect.MAVLINK_MSG_ID_FENCE_STATUS
TEXT = dialect.MAVLINK_MSG_ID_STATUSTEXT
HEARD = (SYSTEM, BATTERY, FENCING, TEXT)


class VehicleHealth:
    """Takes the vehicle's messages and returns what has begun or ended.

    `battery_percent`: a charge below it is low; -inf: not watched.
    """

    def __init__(self, battery_percent: float = -math.inf) -> None:
        self._limit = battery_percent
        self._said: dict[str, tuple[str, float]] = {}
        self._present: set[str] = set()

    def take(self, now: float, message: Message) -> list[Sample]:
        """Return the conditions that `message`, come at `now` [s], begins or ends."""
        kind = message_id(message)
        if kind == SYSTEM:
            fenced = message.onboard_control_sensors_enabled & FENCE
            ill = fenced and not message.onboard_control_sensors_health & FENCE
            return [*self._charge(now, message.battery_remaining, False), *self._set(now, "geofence", bool(ill), "")]
        if kind == BATTERY:
            return self._charge(now, message.battery_remaining, message.charge_state in BAD_CHARGES)
        if kind == FENCING:
            return self._set(now, "geofence", bool(message.breach_status), "")
        return self._read(now, message.text) if kind == TEXT else []

    def pass_time(self, now: float) -> list[Sample]:
        """Return the conditions that nobody has spoken of for long, as over."""
        over = [name for name, (_, until) in self._said.items() if now >= until]
        ended: list[Sample] = []
        for name in over:
            del self._said[name]
            ended += self._set(now, name, False, "")
        return ended

    def _charge(self, now: float, percent: int, is_bad: bool) -> list[Sample]:
        if not 0 <= percent <= 100 and not is_bad:
            return []  # -1: the vehicle does not know
        limit = self._limit + (RECOVERED_PERCENT if "battery_low" in self._present else 0.0)
        low = math.isfinite(self._limit) and (is_bad or percent < limit)
        return self._set(now, "battery_low", low, f"{percent} %" if 0 <= percent <= 100 else "")

    def _read(self, now: float, text: str) -> list[Sample]:
        words = text.lower()
        found: list[Sample] = []
        for name, is_said in (("geofence", "fence breach" in words), ("shallow", "shallow" in words)):
            if is_said:
                found += self._set(now, name, True, text[:60])
                self._said[name] = (text, now + TEXT_LASTS_S)
        return found

    def _set(self, now: float, name: str, present: bool, detail: str) -> list[Sample]:
        if name in self._said and not present:
            return []  # what was said in words lasts its time
        if present is (name in self._present):
            return []
        (self._present.add if present else self._present.discard)(name)
        return [ConditionSample(now, name, present, detail if present else "", "vehicle")]
