"""What a vehicle and its surroundings say beside its state: battery, fence, shallow water, another pilot.

And the mode of its own that the vehicle is handed over to in a fail-safe: asked for until it shows in its heartbeat.

SYS_STATUS and BATTERY_STATUS: charge and charge state; SYS_STATUS: fence, compass, AHRS where enabled and unhealthy;
FENCE_STATUS: breached; STATUSTEXT: "Fence Breached" (ArduPilot, AC_Fence) and what has "shallow" in it; HEARTBEAT: a
MAV_STATE of a fail-safe.

EKF_STATUS_REPORT: the heading in ATTITUDE comes from a filter whose compass innovations, as a share of what it lets
pass, are compass_variance. ArduRover acts from FS_EKF_THRESH (0.8) on, and only where the velocity is as bad, so that a
disturbed compass alone shows here and nowhere else (Rover/ekf_check.cpp, over_threshold; AP_NavEKF3_Outputs.cpp,
send_status_report). A vehicle without such a filter sends nothing but zeros.

Another pilot on the same boat is known by what it says of itself every second: NAMED_VALUE_INT "PILOT". Both pilots
have the vehicle's system id and component 191. ArduPilot passes messages without a target on to its other links, but no
heartbeat to a link on which the same address was heard (libraries/GCS_MAVLink/MAVLink_routing.cpp), so a heartbeat
would not do. What we have sent ourselves, and comes back, is not another's. Pure.
"""

from __future__ import annotations

import math
from collections import deque
from enum import IntEnum

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import Message, message_id
from autopilot.links.mavlink.requests import vehicle_command
from autopilot.signals import AlarmEvent, ConditionSample, Mode, Sample
from autopilot.supervision.supervisor import CANNOT_ENGAGE

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
ATTITUDE = (dialect.MAV_SYS_STATUS_SENSOR_3D_MAG, dialect.MAV_SYS_STATUS_AHRS)
"""What the heading of ATTITUDE rests on: without its compass a vehicle goes on by gyro, and says so here alone."""
DOUBTED_FROM, TRUSTED_BELOW = 0.8, 0.5
"""ArduRover's own limit, and where it is over, so that a value that wavers about the limit is one alarm."""
DOUBTED_FOR_S = 3.0
"""A turn past a steel pier is over sooner."""
FAILED = {
    dialect.MAV_STATE_EMERGENCY: "emergency",
    dialect.MAV_STATE_POWEROFF: "it shuts down",
    dialect.MAV_STATE_FLIGHT_TERMINATION: "it ends its own voyage",
}
SYSTEM = dialect.MAVLINK_MSG_ID_SYS_STATUS
HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
FILTER = dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT
BATTERY = dialect.MAVLINK_MSG_ID_BATTERY_STATUS
FENCING = dialect.MAVLINK_MSG_ID_FENCE_STATUS
TEXT = dialect.MAVLINK_MSG_ID_STATUSTEXT


class VehicleHealth:
    """Takes the vehicle's messages and returns what has begun or ended.

    `battery_percent`: a charge below it is low; -inf: not watched.

    Attributes:
        said: what was said in words, and until when [s] that lasts; `pass_time` ends it.
    """

    def __init__(self, battery_percent: float = -math.inf) -> None:
        self._limit = battery_percent
        self.said: dict[str, tuple[str, float]] = {}
        self._present: set[str] = set()
        self._filter_runs, self._doubted_since = False, math.inf

    def restart(self) -> None:
        """Take that the vehicle has restarted: its filter aligns itself anew, which is no fault."""
        self._filter_runs, self._doubted_since = False, math.inf

    def take(self, now: float, message: Message) -> list[Sample]:
        """Return the conditions that `message`, come at `now` [s], begins or ends."""
        kind = message_id(message)
        if kind == SYSTEM:
            ill = message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health
            return [
                *self._charge(now, message.battery_remaining, False),
                *self._set(now, "geofence", bool(ill & FENCE), ""),
                *self._set(now, "attitude_unhealthy", any(ill & part for part in ATTITUDE), ""),
            ]
        if kind == BATTERY:
            return self._charge(now, message.battery_remaining, message.charge_state in BAD_CHARGES)
        if kind == HEARTBEAT:
            state = message.system_status
            return [
                *self._set(now, "vehicle_failsafe", state == dialect.MAV_STATE_CRITICAL, ""),
                *self._set(now, "vehicle_failed", state in FAILED, FAILED.get(state, "")),
            ]
        if kind == FILTER:
            return self._filter(now, message.flags, message.compass_variance)
        if kind == FENCING:
            return self._set(now, "geofence", bool(message.breach_status), "")
        return self._read(now, message.text) if kind == TEXT else []

    def _filter(self, now: float, flags: int, ratio: float) -> list[Sample]:
        has_attitude = bool(flags & dialect.EKF_ATTITUDE)
        self._filter_runs = self._filter_runs or has_attitude
        lost = self._filter_runs and flags != 0 and not has_attitude
        limit = TRUSTED_BELOW if "compass_doubtful" in self._present else DOUBTED_FROM
        if not (lost or ratio >= limit):
            self._doubted_since = math.inf
        else:
            self._doubted_since = min(self._doubted_since, now)
        words = "its filter has no attitude" if lost else f"{ratio:.1f} of what its filter lets pass"
        return self._set(now, "compass_doubtful", now - self._doubted_since >= DOUBTED_FOR_S, words)

    def pass_time(self, now: float) -> list[Sample]:
        """Return the conditions that nobody has spoken of for long, as over."""
        over = [name for name, (_, until) in self.said.items() if now >= until]
        ended: list[Sample] = []
        for name in over:
            del self.said[name]
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
                self.said[name] = (text, now + TEXT_LASTS_S)
        return found

    def _set(self, now: float, name: str, present: bool, detail: str) -> list[Sample]:
        if name in self.said and not present:
            return []  # what was said in words lasts its time
        if present is (name in self._present):
            return []
        (self._present.add if present else self._present.discard)(name)
        return [ConditionSample(now, name, present, detail if present else "", "vehicle")]


NAME = "PILOT"


class PilotState(IntEnum):
    """The value under that name."""

    IDLE = 0
    WAITS = 1
    STEERS = 2


PERIOD_S = 1.0
SILENT_S = 3.5
LISTENS_S = 1.2
"""Each speaks every second: so long it takes to know that nobody else is there."""
OWN_KEPT = 8
LISTENING = "listening for another pilot on this boat"
STEERED = "another pilot steers this boat; let it stand by, or start with --with-other-pilot"


class OtherPilot:
    """Says what we are, and hears what others say. `is_forced`: we engage though another steers.

    Attributes:
        is_there: whether another has ever said that it steers, or waits to.  steers: whether the last word was so.
        due_at: when [s] it is time to say what we are.
    """

    def __init__(self, is_forced: bool = False) -> None:
        self._is_forced = is_forced
        self._own: deque[bytes] = deque(maxlen=OWN_KEPT)
        self._state = PilotState.IDLE
        self.is_there, self.steers, self.due_at = False, False, -math.inf
        self._began: float | None = None
        self._steers_time = self._waits_time = -math.inf

    def publish_status(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Take our own mode and alarms; a change of what we are is said at once."""
        state = PilotState.IDLE
        if mode in (Mode.ENGAGED, Mode.FAILSAFE):
            state = PilotState.STEERS
        elif any(alarm.name == CANNOT_ENGAGE for alarm in alarms):
            state = PilotState.WAITS
        if state is not self._state:
            self._state, self.due_at = state, now

    def due(self, now: float) -> Message | None:
        """Return what we say of ourselves, when it is time to."""
        if now < self.due_at:
            return None
        self.due_at = now + PERIOD_S
        return dialect.MAVLink_named_value_int_message(int(now * 1000.0) & 0xFFFFFFFF, NAME.encode(), self._state)

    def sent(self, packet: bytes) -> None:
        """Take a packet of our own as it left, which may come back to us."""
        self._own.append(packet)

    def take(self, now: float, message: Message) -> None:
        """Take any message that arrived and is not the vehicle's."""
        if message_id(message) != dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT or bytes(message._msgbuf) in self._own:
            return
        if message.name != NAME:
            return
        self.is_there = self.is_there or message.value in (PilotState.STEERS, PilotState.WAITS)
        self._steers_time = now if message.value == PilotState.STEERS else -math.inf
        self._waits_time = now if message.value == PilotState.WAITS else -math.inf
        self.steers = message.value == PilotState.STEERS

    def obstacle(self, now: float) -> str:
        """Return why we may not try to take the helm at `now` [s]; empty where nobody else is known to have it."""
        self._began = now if self._began is None else self._began
        return STEERED if now - self._steers_time <= SILENT_S and not self._is_forced else ""

    def waiting(self, now: float) -> str:
        """Return that it is not yet known whether anybody else is there."""
        is_new = self._began is not None and now - self._began < LISTENS_S
        return LISTENING if is_new and not self._is_forced else ""

    def alarm(self, now: float, is_steering: bool) -> AlarmEvent | None:
        """Return what the skipper of a boat that we steer should know of another pilot."""
        if not is_steering:
            return None
        if now - self._steers_time <= SILENT_S:
            return AlarmEvent("other_pilot")
        return AlarmEvent("other_pilot_waits") if now - self._waits_time <= SILENT_S else None


HANDOVER_REPEAT_S = 0.5
HANDOVER_PATIENCE_S = 3.0
"""A vehicle that is not in the mode after this does not take it; it is asked on, but people must know."""
HANDOVER_ENDS_S = 30.0


class ModeHandover:
    """Hands the boat over to a mode of the flight controller in a fail-safe, and sees whether it goes."""

    def __init__(self, mode: int) -> None:
        self._mode = mode
        self._since: float | None = None
        self._next = math.nan
        self._is_done = self._is_reported = False

    def publish_status(self, now: float, mode: Mode) -> None:
        """Take the pilot's mode: a fail-safe or a fault begins the handover. Who takes the helm then is not fought."""
        if mode not in (Mode.FAILSAFE, Mode.FAULT):
            self._since = None
        elif self._since is None:
            self._since, self._next, self._is_done = now, now, False

    def due(self, now: float, vehicle: int) -> list[Message]:
        """Return the command that is due: until the vehicle is in the mode, or half a minute has passed."""
        if self._since is None or self._is_done or now < self._next or now - self._since > HANDOVER_ENDS_S:
            return []
        self._next = now + HANDOVER_REPEAT_S
        flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return [vehicle_command(vehicle, dialect.MAV_CMD_DO_SET_MODE, flags, self._mode)]

    def seen(self, now: float, mode: int, link: str) -> list[ConditionSample]:
        """Take the vehicle's mode; return what has changed in whether it refuses."""
        self._is_done = self._is_done or (self._since is not None and mode == self._mode)
        refuses = self._since is not None and not self._is_done and now - self._since > HANDOVER_PATIENCE_S
        if refuses == self._is_reported:
            return []
        self._is_reported = refuses
        return [ConditionSample(now, "handback_refused", refuses, f"still in mode {mode}" if refuses else "", link)]
