"""What a ground station gets to know of the boat: standard messages made from a tick. Pure.

ATTITUDE, GLOBAL_POSITION_INT, VFR_HUD, NAV_CONTROLLER_OUTPUT (bearing steered now and bearing ordered or of the
waypoint, in degrees; distance to it; cross-track error, positive to starboard of the track), MISSION_CURRENT,
CURRENT_MODE, SYS_STATUS, SYSTEM_TIME, AUTOPILOT_VERSION, and NAMED_VALUE_FLOAT for rudder, rudder order and bias, for
the loop's health: ticks a second, the longest gap between two ticks since the last report, and the heading's age; and
for the wind: the apparent one under ArduPilot's names (m/s, degrees off the bow), the true one, the angle held.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import compass_deg, wrap
from autopilot.guidance.wind_vane import WindGuide
from autopilot.links.ground_station.commands import Instruments
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.orders import Tuner, current_mode, mode_of
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.frames import CurrentMode
from autopilot.signals import AlarmState, Mode, OrderKind, PositionSample, RollSample, Tick

FRESH_S = 2.0
SHOWN_MOST = 9
"""Compasses whose headings are sent."""
LEARNT_S = 2.0
FURTHEST = 65535
FASTEST_HZ = 50.0
POSITION_FRESH_S = 5.0
VERSION = int.from_bytes((0, 2, 0, dialect.FIRMWARE_VERSION_TYPE_DEV), "big")
CAPABILITIES = (
    dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | dialect.MAV_PROTOCOL_CAPABILITY_FTP
)
COMPASS = dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
HEALTH: dict[int, tuple[str, ...]] = {
    int(dialect.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL): ("rate_disagrees", "innovation", "low_speed"),
    int(dialect.MAV_SYS_STATUS_SENSOR_YAW_POSITION): ("off_course", "rudder_at_stop"),
    int(dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS): (
        "rudder_stuck",
        "rudder_not_following",
        "rudder_reversed",
        "runaway",
    ),
    int(dialect.MAV_SYS_STATUS_AHRS): (
        "heading_lost",
        "heading_frozen",
        "heading_jumping",
        "compass_jumped",
        "heading_disagrees",
        "attitude_unhealthy",
        "compass_doubtful",
    ),
    int(dialect.MAV_SYS_STATUS_LOGGING): ("disk_full",),
    int(dialect.MAV_SYS_STATUS_GEOFENCE): ("geofence", "shallow"),
    int(dialect.MAV_SYS_STATUS_SENSOR_BATTERY): ("battery_low",),
}
"""Which alarms make which of MAVLink's subsystems unhealthy in SYS_STATUS."""
RATES_HZ = {
    dialect.MAVLINK_MSG_ID_ATTITUDE: 4.0,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 2.0,
    dialect.MAVLINK_MSG_ID_VFR_HUD: 2.0,
    dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 2.0,
    dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: 2.0,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    CurrentMode.id: 0.5,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 0.5,
}
"""Unasked; SET_MESSAGE_INTERVAL changes them."""


class Telemetry:
    """Makes each message from the newest tick; `start` [s] of the loop's clock is our boot."""

    def __init__(
        self,
        mission: Mission,
        tuner: Tuner | None = None,
        wind: WindGuide | None = None,
        instruments: Instruments = Instruments(),  # noqa: B008 - nobody changes it
    ) -> None:
        self._mission, self._tuner, self._wind, self._instruments = mission, tuner, wind, instruments
        self._learnt_due = self._north_due = -math.inf
        self._periods = {identity: 1.0 / rate for identity, rate in RATES_HZ.items()}
        self._due = dict.fromkeys(self._periods, -math.inf)
        self._start: float | None = None
        self._roll: RollSample | None = None
        self._position: PositionSample | None = None
        self.tick: Tick | None = None
        self._reported_time = math.nan
        self._ticks = 0
        self._longest_gap = 0.0
        self._makers: dict[int, Callable[[Tick], list[Message]]] = {
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._where,
            dialect.MAVLINK_MSG_ID_VFR_HUD: self._hud,
            dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self._navigation,
            dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: lambda tick: [
                *self._rudder(tick),
                *self._loop(tick),
                *self._learnt(tick),
                *self._winds(tick),
                *self._overboard(tick),
                *self._north(tick),
            ],
            dialect.MAVLINK_MSG_ID_MISSION_CURRENT: lambda _: [self._mission.message()],
            CurrentMode.id: lambda tick: [current_mode(self.mode(tick))],
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self._status,
            dialect.MAVLINK_MSG_ID_SYSTEM_TIME: self._time,
            dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda _: [version()],
        }

    def take(self, tick: Tick) -> None:
        """Remember the newest tick."""
        if self._start is None:
            self._start = self._reported_time = tick.now
        if self.tick is not None:
            self._longest_gap = max(self._longest_gap, tick.now - self.tick.now)
        self._ticks += 1
        self.tick = tick
        for sample in tick.samples:
            if isinstance(sample, RollSample):
                self._roll = sample
            elif isinstance(sample, PositionSample):
                self._position = sample

    def mode(self, tick: Tick) -> int:
        """Return our custom mode."""
        return mode_of(tick, self._mission.is_followed, self._wind is not None and self._wind.following)

    def set_interval(self, identity: int, interval_us: float) -> int:
        """Send a message every so many microseconds, as by default for 0, never for -1; return the MAV_RESULT."""
        if identity not in self._makers:
            return int(dialect.MAV_RESULT_UNSUPPORTED)
        if interval_us == -1.0:
            self._due.pop(identity, None)
            return int(dialect.MAV_RESULT_ACCEPTED)
        if not (interval_us >= 0.0 and math.isfinite(interval_us)):
            return int(dialect.MAV_RESULT_DENIED)
        usual = 1.0 / RATES_HZ.get(identity, 1.0)
        self._periods[identity] = max(interval_us * 1.0e-6, 1.0 / FASTEST_HZ) if interval_us else usual
        self._due[identity] = -math.inf
        return int(dialect.MAV_RESULT_ACCEPTED)

    def due(self, now: float) -> list[Message]:
        """Return the messages that fall due by `now` [s]."""
        messages = []
        for identity, due in self._due.items():
            if now >= due:
                period = self._periods[identity]
                self._due[identity] = due + period if due + period > now else now + period
                messages.extend(self.make(identity))
        return messages

    def make(self, identity: int) -> list[Message]:
        """Return the messages of one id as of the newest tick; none before the first, or without a fresh heading."""
        return self._makers[identity](self.tick) if self.tick is not None and identity in self._makers else []

    def _boot_ms(self, tick: Tick) -> int:
        return int((tick.now - (self._start or 0.0)) * 1000.0) & 0xFFFFFFFF

    def _attitude(self, tick: Tick) -> list[Message]:
        if not _fresh(tick):
            return []
        roll, rate = 0.0, 0.0
        if self._roll is not None and tick.now - self._roll.time < FRESH_S:
            roll, rate = self._roll.roll, self._roll.rate or 0.0
        state = tick.state
        return [dialect.MAVLink_attitude_message(self._boot_ms(tick), roll, 0.0, state.heading, rate, 0.0, state.rate)]

    def _where(self, tick: Tick) -> list[Message]:
        """GLOBAL_POSITION_INT while position and heading are fresh; the speed is taken to be along the heading."""
        position = self._position
        if position is None or tick.now - position.time > POSITION_FRESH_S or not _fresh(tick):
            return []
        state = tick.state
        north, east = state.speed * math.cos(state.heading), state.speed * math.sin(state.heading)
        return [
            dialect.MAVLink_global_position_int_message(
                self._boot_ms(tick),
                round(math.degrees(position.latitude) * 1.0e7),
                round(math.degrees(position.longitude) * 1.0e7),
                0,
                0,
                round(north * 100.0),
                round(east * 100.0),
                0,
                round(compass_deg(state.heading) * 100.0) % 36000,
            )
        ]

    def _hud(self, tick: Tick) -> list[Message]:
        if not _fresh(tick):
            return []
        heading = int(compass_deg(tick.state.heading))
        return [dialect.MAVLink_vfr_hud_message(0.0, tick.state.speed, heading, 0, 0.0, 0.0)]

    def _navigation(self, tick: Tick) -> list[Message]:
        if tick.mode is not Mode.ENGAGED:
            return []
        target = self._target(tick)
        distance, cross_track = 0, 0.0
        leg = self._mission.guide.leg
        if leg is not None and self._mission.guide.following:
            target, distance, cross_track = leg.target, min(round(leg.distance), FURTHEST), leg.cross_track
        bearings = (_signed_deg(tick.reference.heading), _signed_deg(target))
        return [dialect.MAVLink_nav_controller_output_message(0.0, 0.0, *bearings, distance, 0.0, 0.0, cross_track)]

    def _target(self, tick: Tick) -> float:
        """Return the heading [rad] ordered; the one held where none was named."""
        return tick.order.heading if math.isfinite(tick.order.heading) else tick.reference.heading

    def _compass(self, tick: Tick, heading: float) -> float:
        """Return a heading [rad] from 0 to 2 pi, not a number while none is steered."""
        steered = tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
        return heading % (2.0 * math.pi) if steered else math.nan

    def _rudder(self, tick: Tick) -> list[Message]:
        values = {
            "rud_deg": tick.state.rudder,
            "rudcmd_deg": tick.command.angle if tick.command.engaged else math.nan,
            "bias_deg": tick.state.bias,
            "ref_deg": self._compass(tick, tick.reference.heading),
            "ord_deg": self._compass(tick, self._target(tick)),
        }
        return self._named(tick, {name: math.degrees(value) for name, value in values.items()})

    def _loop(self, tick: Tick) -> list[Message]:
        """How the loop has kept time since the last report; and which north headings count from."""
        variation, passed = self._instruments.variation, tick.now - self._reported_time
        values = {
            "ticks_hz": self._ticks / passed if passed > 0.0 else math.nan,
            "gap_ms": 1000.0 * self._longest_gap,
            "hdg_age_ms": 1000.0 * tick.state.heading_age,
            "alarms": float(len(tick.alarms)),
            "alarms_new": float(sum(state is AlarmState.SOUNDING for state in tick.alarm_states)),
            "magnetic": float(self._mission.guide.settings.magnetic),
            "var_deg": math.nan if variation.value is None else math.degrees(variation.value),
        }
        self._reported_time, self._ticks, self._longest_gap = tick.now, 0, 0.0
        return self._named(tick, values)

    def _learnt(self, tick: Tick) -> list[Message]:
        """What was learnt, and the response level, every two seconds."""
        if self._tuner is None or tick.now < self._learnt_due:
            return []
        self._learnt_due = tick.now + LEARNT_S
        return self._named(tick, {"level": self._tuner.level, **self._tuner.learnt()})

    def _winds(self, tick: Tick) -> list[Message]:
        """The wind, not a number while none is known, and the angle of it that is held; a turn that waits to be
        confirmed is 1 for a tack, 2 for a gybe. Nothing before the first wind."""
        guide = self._wind
        if guide is None or guide.vane.newest is None:
            return []
        newest, wind, hold = guide.vane.newest, guide.vane.wind, guide.hold
        known = 1.0 if guide.is_known(tick.now) else math.nan
        true = known if math.isfinite(wind.way) else math.nan
        values = {"AppWndSpd": newest.speed * known, "AppWndDir": math.degrees(newest.angle) * known}
        values["TruWndSpd"] = wind.speed * true
        values["TruWndDir"] = math.degrees(wrap(wind.bearing - tick.state.heading)) * true
        values["wnd_hold"] = math.nan if hold is None else math.degrees(hold.angle)
        values["wnd_true"] = float(hold is not None and hold.is_true)
        values["wnd_ask"] = 0.0 if guide.asked is None else float(guide.asked.manoeuvre)
        return self._named(tick, values)

    def _overboard(self, tick: Tick) -> list[Message]:
        """Where somebody went overboard, as seen from the boat, and how long ago, while that is so."""
        overboard = self._mission.overboard
        seen = overboard.seen_from(self._mission.guide.fix)
        if seen is None:
            return []
        bearing, distance = seen
        bearing_deg = compass_deg(bearing)
        return self._named(tick, {"mob_brg": bearing_deg, "mob_dist": distance, "mob_s": tick.now - overboard.since})

    def _north(self, tick: Tick) -> list[Message]:
        """Every two seconds: who says what the variation is, `Origin`, and of a model its date; of two compasses and
        more how many there are, the number of the one that steers, that of the one chosen, 0: none, and the headings of
        the first, not a number while one is not heard."""
        chooser, variation = self._instruments.compasses, self._instruments.variation
        if tick.now < self._north_due:
            return []
        self._north_due = tick.now + LEARNT_S
        values = {"var_from": float(variation.origin), "var_year": variation.year} if variation.origin else {}
        known = () if chooser is None else chooser.compasses(tick.now)
        if chooser is not None and len(known) > 1:
            sources = ["", *(each.source for each in known)]
            which = {"cmp_steers": chooser.selected("heading"), "cmp_chosen": chooser.chosen}
            values |= {name: float(sources.index(each) if each in sources else 0) for name, each in which.items()}
            shown = enumerate(known[:SHOWN_MOST], 1)
            values |= {
                "cmp_n": float(len(known)),
                **{f"cmp{number}": compass_deg(each.heading) for number, each in shown},
            }
        return self._named(tick, values)

    def _named(self, tick: Tick, values: dict[str, float]) -> list[Message]:
        return [
            dialect.MAVLink_named_value_float_message(self._boot_ms(tick), name.encode(), value)
            for name, value in values.items()
        ]

    def _status(self, tick: Tick) -> list[Message]:
        present = COMPASS | sum(HEALTH)
        ill = 0 if _fresh(tick) else COMPASS
        for alarm in tick.alarms:
            ill |= sum(bit for bit, names in HEALTH.items() if alarm.name in names)
        return [
            dialect.MAVLink_sys_status_message(present, present, present & ~ill, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0),
        ]

    def _time(self, tick: Tick) -> list[Message]:
        return [dialect.MAVLink_system_time_message(0, self._boot_ms(tick))]


def version() -> Message:
    """Return AUTOPILOT_VERSION: what we can do, and which version this is."""
    nothing = [0] * 8
    return dialect.MAVLink_autopilot_version_message(CAPABILITIES, VERSION, 0, 0, 0, nothing, nothing, nothing, 0, 0, 1)


def _fresh(tick: Tick) -> bool:
    return tick.state.valid and tick.state.heading_age < FRESH_S


def _signed_deg(heading: float) -> int:
    return round(math.degrees(math.remainder(heading, 2.0 * math.pi)))
