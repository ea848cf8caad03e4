"""Commands of ground stations as the boat carries them out: always acknowledged, unknown ones UNSUPPORTED. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.guidance.current import ROUTE_LATITUDE_MOST_DEG, Place
from autopilot.guidance.track import Waypoint
from autopilot.guidance.wind_vane import Manoeuvre, WindGuide
from autopilot.links.base import LastStop
from autopilot.links.ground_station.mission import NO_POSITION, Mission
from autopilot.links.ground_station.orders import (
    ACKNOWLEDGE,
    HEADING,
    LEARNING,
    LEVEL,
    MANUAL,
    MISSION,
    TRACK,
    TRIAL,
    WIND,
    LongCommand,
    Run,
    Tuner,
    TuningCommands,
)
from autopilot.links.north import MAGNETIC_LEADS, Variation
from autopilot.signals import Mode, OrderKind, Tick
from autopilot.supervision.alarms import BY_NUMBER
from autopilot.supervision.supervisor import NO_HEADING

ACCEPTED = int(dialect.MAV_RESULT_ACCEPTED)
REJECTED = int(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(dialect.MAV_RESULT_DENIED)
UNSUPPORTED = int(dialect.MAV_RESULT_UNSUPPORTED)
IN_PROGRESS = int(dialect.MAV_RESULT_IN_PROGRESS)
COUNTERCLOCKWISE = -1.0
RAW_HEADING, COURSE_OVER_GROUND = 1, 0
SET_STANDARD_MODE = 262
"""MAV_CMD_DO_SET_STANDARD_MODE, which the dialect does not have."""
ZIGZAG, TURNING = int(dialect.MAV_CMD_USER_1), int(dialect.MAV_CMD_USER_2)
PATTERN = int(dialect.MAV_CMD_USER_3)
"""USER_1: zigzag; rudder [deg], change of heading [deg] at which it goes over, duration [s].
USER_2: turn at a held rudder; rudder [deg], starboard positive, duration [s].
USER_3: turn pattern; number, side (1 starboard, -1 port), its sizes [m] or [deg]."""
WINDWARD = int(dialect.MAV_CMD_SPATIAL_USER_4)
"""SPATIAL_USER_4: the wind. Parameter 1: 0 hold the apparent, 1 the true wind, at an angle [deg], positive with the
wind from starboard, nan: the present one; 2 tack, 3 gybe, to a side (1 starboard, -1 port, 0 either), third parameter
1: confirmed already; 4 confirm, 5 do not."""
HOLD_APPARENT, HOLD_TRUE, TACK, GYBE, CONFIRM, DECLINE = range(6)
OVERBOARD = int(dialect.MAV_CMD_SPATIAL_USER_3)
"""SPATIAL_USER_3: man overboard; 1 keeps the place, 0 forgets it. The boat goes on as ordered.

Second parameter 1: another system aboard says so, again and again while it is so, at a place [deg] in 5 and 6; both 0:
where the boat is when it is first said."""
COMPASS = int(dialect.MAV_CMD_SPATIAL_USER_2)
"""SPATIAL_USER_2: steer by the compass of this number in the boat's list (`file_server.COMPASSES`), from 1; 0: by the
best one, as the vessel file lists them. The boat stays on its course."""
SYSTEM_ABOARD = "a system aboard"
"""The beacon that it counts as."""
ANGLE_MOST_DEG = 360.0
"""Further, an angle is a slip of the hand: wrapped, it would be another heading than the one that was typed."""
BEYOND_A_TURN = "give an angle of -360 to 360 degrees"


class Instruments(NamedTuple):
    """compasses: what chooses among them, None where nothing does; keep_compass keeps for the next start which was
    chosen, '' for none, and says why it cannot; variation: the magnetic one as the links know it."""

    compasses: SensorSelection | None = None
    keep_compass: Callable[[str], str] = lambda _: ""
    variation: Variation = Variation()


class Helmsman(Protocol):
    """Who carries out what is ordered: the same one as listens to the skipper at the terminal."""

    def engage(self, heading: float | None) -> None:
        """Order a heading [rad], or the present one."""

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] that is being steered: no request to engage again after an override."""

    def stand_by(self) -> None:
        """Give the rudder back."""

    def hand_to_track(self) -> None:
        """Let the track guide lead, engaging on the present heading where none is steered yet."""

    def pattern(self, number: int, side: float, sizes: tuple[float, ...]) -> None:
        """Sail the turn pattern of a number, with its sizes [m] or [deg]. Raises InputError."""

    def zigzag(self, rudder: float, heading_change: float, duration: float) -> Run:
        """Begin a zigzag; angles [rad], time [s]. Raises InputError."""

    def turning(self, rudder: float, duration: float) -> Run:
        """Begin a turn at a held rudder [rad]. Raises InputError."""

    def acknowledge(self, name: str = "") -> None:
        """Silence the alarms of a name, or all that sound."""

    def end_trial(self) -> None:
        """End a trial before its time, and go back to the heading that was steered before."""

    def hold_wind(self, is_true: bool = False, angle: float | None = None) -> None:
        """Hold an angle [rad] of the apparent or true wind, None: the present one. Raises InputError."""

    def ask_turn(self, manoeuvre: Manoeuvre, side: int = 0, confirmed: bool = False) -> None:
        """Ask for a tack or gybe, or begin it where it is confirmed already. Raises InputError."""

    def confirm(self) -> None:
        """Begin the tack or gybe that waits. Raises InputError."""


class Commands:
    """Carries commands out. `armed`: a ground station, or `run --engage`, has said that the pilot may engage. `wind`:
    what the helmsman holds the wind by, None where nobody does. `against_engaging`: what keeps the pilot from engaging
    after a tick, '' for nothing (`Pilot.against_engaging`). `last_stop`: when the pilot left the helm last."""

    def __init__(
        self,
        helmsman: Helmsman,
        armed: bool,
        mission: Mission,
        tuner: Tuner | None = None,
        wind: WindGuide | None = None,
        against_engaging: Callable[[Tick], str] = lambda _: "",
    ) -> None:
        self._helmsman = helmsman
        self._against_engaging = against_engaging
        self.wind = wind
        self.mission = mission
        self.instruments = Instruments()
        self.last_stop = LastStop()
        self.tuner = tuner
        self.tuning = TuningCommands(tuner)
        self.armed = armed
        self.refusal = ""
        """Why the last command was refused, for people."""
        self.running: LongCommand | None = None
        self._turned: tuple[Tick | None, float] = None, math.nan
        """The heading [rad] ordered last, and after which tick."""
        self._actions: dict[int, Callable[[Tick | None, tuple[float, ...]], int]] = {
            int(dialect.MAV_CMD_COMPONENT_ARM_DISARM): self._arm,
            int(dialect.MAV_CMD_DO_SET_MODE): self._set_mode,
            SET_STANDARD_MODE: self._set_standard_mode,
            int(dialect.MAV_CMD_CONDITION_YAW): self._yaw,
            int(dialect.MAV_CMD_GUIDED_CHANGE_HEADING): self._change_heading,
            int(dialect.MAV_CMD_DO_REPOSITION): self._reposition,
            int(dialect.MAV_CMD_MISSION_START): self._start_mission,
            int(dialect.MAV_CMD_DO_SET_MISSION_CURRENT): self._set_current,
            ZIGZAG: self._zigzag,
            TURNING: self._turning,
            PATTERN: self._pattern,
            ACKNOWLEDGE: self._acknowledge,
            WINDWARD: self._windward,
            OVERBOARD: self._overboard,
            COMPASS: self._compass,
            LEARNING: lambda _, parameters: self._tune(LEARNING, parameters[0]),
            LEVEL: lambda _, parameters: self._tune(LEVEL, parameters[0]),
        }

    def execute(self, command: int, parameters: tuple[float, ...], tick: Tick | None) -> int:
        """Carry out `command` with its parameters 1 to 7, the pilot being at `tick`; return the MAV_RESULT."""
        self.refusal = ""
        action = self._actions.get(command)
        return action(tick, parameters) if action else UNSUPPORTED

    def set_mode(self, mode: int, tick: Tick | None) -> int:
        """Go to one of our custom modes; return the MAV_RESULT."""
        self.refusal = ""
        if mode == MANUAL:
            self._helmsman.stand_by()
            return ACCEPTED
        if mode == TRIAL:
            return self._refuse(DENIED, "a trial is begun by its command: MAV_CMD_USER_1 or USER_2")
        if mode not in (HEADING, TRACK, WIND):
            known = f"MANUAL ({MANUAL}), GUIDED ({HEADING}), AUTO ({TRACK}) and ACRO, the wind ({WIND}),"
            return self._refuse(DENIED, f"mode {mode} is not known: {known} are")
        if obstacle := self._obstacle(tick):
            return self._refuse(REJECTED, obstacle)
        if mode == TRACK:
            return self._follow_mission(tick)
        if mode == WIND:
            return self._hold_wind(tick, False, None) if self.wind is not None else UNSUPPORTED
        if tick is None or not _steers(tick):
            self._helmsman.engage(None)
        elif self.mission.is_followed or (tick.order.is_led and not self.mission.guide.following):
            # out of a route, a turn pattern, or where wind or plotter lead; going to a place belongs to this mode
            self._helmsman.turn_to(self._ordered(tick))
        return ACCEPTED

    def cancel(self, command: int) -> bool:
        """End a command that is being carried out; return whether there is one."""
        running = self.running
        if running is None or running.run.is_over or running.command != command or command in (LEARNING, LEVEL):
            return False
        running.is_cancelled = True
        self._helmsman.end_trial()
        return True

    def _follow_mission(self, tick: Tick | None) -> int:
        mission = self.mission
        if mission.is_followed and tick is not None and _steers(tick):
            return ACCEPTED
        obstacle = mission.obstacle(tick.now if tick is not None else math.inf)
        if obstacle:
            return self._refuse(REJECTED, obstacle)
        self._helmsman.hand_to_track()
        mission.follow()
        return ACCEPTED

    def _start_mission(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        first, last = parameters[:2]
        if last not in (0.0, len(self.mission.items) - 1.0) or not math.isfinite(first):
            return self._refuse(DENIED, "a route is followed to its end: set the last item to 0")
        if obstacle := self._obstacle(tick):
            return self._refuse(REJECTED, obstacle)
        if not self.mission.set_current(int(first)):
            return self._refuse(DENIED, f"there is no waypoint {first:g} in a route of {len(self.mission.items)}")
        return self._follow_mission(tick)

    def _set_current(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        number = parameters[0]
        if number == -1.0:
            number = float(self.mission.current)
        if not (math.isfinite(number) and number == int(number) and self.mission.set_current(int(number))):
            return self._refuse(DENIED, f"there is no waypoint {number:g} in a route of {len(self.mission.items)}")
        return ACCEPTED

    def _reposition(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        speed, flags, radius, _, latitude_deg, longitude_deg, _ = parameters
        if speed > 0.0:
            return self._refuse(UNSUPPORTED, "the speed is not ours to set: leave it at -1")
        is_nowhere = latitude_deg == longitude_deg == 0.0
        if is_nowhere or not (abs(latitude_deg) <= ROUTE_LATITUDE_MOST_DEG and abs(longitude_deg) <= 180.0):
            most = f"{ROUTE_LATITUDE_MOST_DEG:g} and a longitude of up to 180 degrees"
            return self._refuse(DENIED, f"give a latitude of up to {most}")
        if self.mission.guide.settings.magnetic:
            return self._refuse(DENIED, MAGNETIC_LEADS)
        if tick is None or not self.mission.guide.fix.is_fresh(tick.now):
            return self._refuse(REJECTED, NO_POSITION)
        changes_mode = math.isfinite(flags) and int(flags) & dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if not _steers(tick):
            if not changes_mode or not self._is_armed(tick):
                return self._refuse(REJECTED, "not engaged: arm, and set mode GUIDED or the flag that changes it")
            if obstacle := self._obstacle(tick):
                return self._refuse(REJECTED, obstacle)
        elif self.mission.is_followed and not changes_mode:
            return self._refuse(REJECTED, "a route is followed: set mode GUIDED first, or the flag that changes it")
        within = radius if math.isfinite(radius) and radius > 0.0 else math.nan
        self._helmsman.hand_to_track()
        place = Waypoint(math.radians(latitude_deg), math.radians(longitude_deg), within)
        self.mission.guide.follow([place], ending="place_reached")
        return ACCEPTED

    def _zigzag(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        rudder_deg, change_deg, duration = given = parameters[:3]
        angles = math.radians(rudder_deg), math.radians(change_deg)
        return self._sail_trial(tick, ZIGZAG, given, lambda: self._helmsman.zigzag(*angles, duration))

    def _turning(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        rudder_deg, duration = given = parameters[:2]
        rudder = math.radians(rudder_deg)
        return self._sail_trial(tick, TURNING, given, lambda: self._helmsman.turning(rudder, duration))

    def _pattern(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        number, side, *sizes = parameters[:4]
        if not (math.isfinite(number) and number == int(number)):
            return DENIED
        if obstacle := self._obstacle(tick):
            return self._refuse(REJECTED, obstacle)
        return self._tried(lambda: self._helmsman.pattern(int(number), side, tuple(sizes)), DENIED)

    def _hold_wind(self, tick: Tick | None, is_true: bool, angle: float | None) -> int:
        wind = self.wind
        held = wind.hold if wind is not None and wind.following and not wind.lost else None
        if angle is None and held is not None and held.is_true is is_true and tick and tick.mode is Mode.ENGAGED:
            return ACCEPTED
        return self._tried(lambda: self._helmsman.hold_wind(is_true, angle))

    def _windward(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        action, value, confirmed = parameters[:3]
        helmsman = self._helmsman
        if self.wind is None:
            return UNSUPPORTED
        if action in (HOLD_APPARENT, HOLD_TRUE):
            if obstacle := self._obstacle(tick):
                return self._refuse(REJECTED, obstacle)
            return self._hold_wind(tick, action == HOLD_TRUE, None if math.isnan(value) else math.radians(value))
        if action in (TACK, GYBE) and value in (-1.0, 0.0, 1.0):
            manoeuvre = Manoeuvre.TACK if action == TACK else Manoeuvre.GYBE
            return self._tried(lambda: helmsman.ask_turn(manoeuvre, int(value), confirmed == 1.0))
        if action == CONFIRM:
            return self._tried(helmsman.confirm)
        if action == DECLINE:
            self.wind.decline()
            return ACCEPTED
        return DENIED

    def _overboard(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        if parameters[0] not in (0.0, 1.0):
            return DENIED
        overboard, fix = self.mission.overboard, self.mission.guide.fix
        if parameters[0] == 0.0:
            overboard.clear()
            return ACCEPTED
        now = tick.now if tick else math.inf
        if parameters[1] != 1.0:
            return self._tried(lambda: overboard.mark(now, fix))
        latitude_deg, longitude_deg = parameters[4:6]
        if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
            return self._refuse(DENIED, "give a latitude of up to 90 and a longitude of up to 180 degrees")
        place = Place(math.radians(latitude_deg), math.radians(longitude_deg))
        if latitude_deg == longitude_deg == 0.0:
            return self._tried(lambda: overboard.report_here(now, fix, SYSTEM_ABOARD))
        overboard.report(now, place, SYSTEM_ABOARD)
        return ACCEPTED

    def _compass(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        number, compasses = parameters[0], self.instruments.compasses
        if compasses is None:
            return UNSUPPORTED
        if tick is None:
            return self._refuse(REJECTED, NO_HEADING)
        known = compasses.compasses(tick.now)
        if number not in range(len(known) + 1):
            return self._refuse(DENIED, f"there is no compass {number:g} among {len(known)}")
        if tick.mode is Mode.FAILSAFE:
            return self._refuse(REJECTED, "a fail-safe has the helm")
        if tick.mode is Mode.ENGAGED and (tick.order.is_led or tick.order.kind is not OrderKind.HEADING):
            return self._refuse(REJECTED, "what leads goes by the present compass: hold a heading first, or stand by")
        source = known[int(number) - 1].source if number else ""
        return self._tried(lambda: self._choose(compasses, tick.now, source))

    def _choose(self, compasses: SensorSelection, now: float, source: str) -> None:
        before = compasses.chosen
        compasses.choose(now, source)
        if source != before and (trouble := self.instruments.keep_compass(source)):
            self.refusal = f"steered by, but not kept for the next start: {trouble}"

    def _tried(self, act: Callable[[], None], otherwise: int = REJECTED) -> int:
        try:
            act()
        except InputError as error:
            return self._refuse(otherwise, str(error))
        return ACCEPTED

    def _tune(self, command: int, value: float) -> int:
        """Begin a change that is worked out beside the loop; what it came to is said at its end."""
        return self._begin(
            (command, (value,)),
            lambda: self.tuning.begin(command, value),
            "something else is under way: let it end first",
        )

    def _acknowledge(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        number = parameters[0]
        kind = BY_NUMBER.get(int(number)) if math.isfinite(number) else None
        if number != 0.0 and kind is None:
            return self._refuse(DENIED, f"there is no alarm of the number {number:g}")
        self._helmsman.acknowledge(kind.name if kind is not None else "")
        return ACCEPTED

    def _sail_trial(
        self, tick: Tick | None, command: int, parameters: tuple[float, ...], begin: Callable[[], Run]
    ) -> int:
        busy, obstacle = "a trial is being sailed: cancel it first", self._obstacle(tick)
        return self._begin((command, parameters), begin, busy, obstacle)

    def _begin(
        self, asked: tuple[int, tuple[float, ...]], begin: Callable[[], Run | None], busy: str, obstacle: str = ""
    ) -> int:
        """Begin what takes a while. `busy` is said while something else does, `obstacle` is what stands against it."""
        running = self.running
        if running is not None and not running.run.is_over:
            return IN_PROGRESS if (running.command, running.parameters) == asked else self._refuse(REJECTED, busy)
        if obstacle:
            return self._refuse(REJECTED, obstacle)
        try:
            run = begin()
        except InputError as error:
            return self._refuse(DENIED, str(error))
        if run is None:
            return UNSUPPORTED
        self.running = LongCommand(*asked, run)
        return IN_PROGRESS

    def _is_armed(self, tick: Tick | None) -> bool:
        """Armed, or engaged from the terminal: what the heartbeat calls armed."""
        return self.armed or (tick is not None and tick.mode is Mode.ENGAGED)

    def _obstacle(self, tick: Tick | None) -> str:
        """Return why an order that engages is not taken at `tick`; '' where it is, or where the pilot steers anyway.

        An order that waited for its boat would engage when nobody expects it any more.
        """
        if not self._is_armed(tick):
            return "arm first"
        if tick is None:
            return NO_HEADING
        return "" if tick.mode is Mode.ENGAGED else self._against_engaging(tick)

    def _arm(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        if parameters[0] not in (0.0, 1.0):
            return UNSUPPORTED
        self.armed = parameters[0] == 1.0
        if not self.armed:
            self._helmsman.stand_by()
        return ACCEPTED

    def _set_mode(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        base, custom = parameters[:2]
        if not (math.isfinite(base) and math.isfinite(custom) and custom == int(custom)):
            return DENIED
        if not int(base) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return UNSUPPORTED
        return self.set_mode(int(custom), tick)

    def _set_standard_mode(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        return self.set_mode(TRACK, tick) if parameters[0] == MISSION else UNSUPPORTED

    def _yaw(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        angle_deg, _, direction, relative = parameters[:4]
        if not math.isfinite(angle_deg) or relative not in (0.0, 1.0):
            return DENIED
        if abs(angle_deg) > ANGLE_MOST_DEG:
            return self._refuse(DENIED, BEYOND_A_TURN)
        if relative == 0.0:
            return self._steer(tick, math.radians(angle_deg))
        if tick is None or not math.isfinite(self._ordered(tick)):
            return self._refuse(REJECTED, "no heading is being steered yet")
        turn = -abs(angle_deg) if direction == COUNTERCLOCKWISE else angle_deg
        return self._steer(tick, self._ordered(tick) + math.radians(turn))

    def _ordered(self, tick: Tick) -> float:
        """Return the heading [rad] that is ordered after `tick`: the next tick has what came since."""
        since, heading = self._turned
        return heading if since is tick else tick.order.heading

    def _change_heading(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        kind, heading_deg = parameters[:2]
        if kind == COURSE_OVER_GROUND:
            return self._refuse(UNSUPPORTED, "a course over the ground cannot be steered; give a heading (type 1)")
        if kind != RAW_HEADING or not math.isfinite(heading_deg):
            return DENIED
        if abs(heading_deg) > ANGLE_MOST_DEG:
            return self._refuse(DENIED, BEYOND_A_TURN)
        return self._steer(tick, math.radians(heading_deg))

    def _steer(self, tick: Tick | None, heading: float) -> int:
        if tick is None or not _steers(tick):
            return self._refuse(REJECTED, "not engaged: arm and set mode GUIDED first")
        self._turned = tick, wrap(heading)
        self._helmsman.turn_to(wrap(heading))
        return ACCEPTED

    def _refuse(self, result: int, reason: str) -> int:
        self.refusal = reason
        return result


def _steers(tick: Tick) -> bool:
    return tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
