"""The whole pilot on the simulated boat over in-memory lines, brought into a state and then given a fault.

Everything is on one simulated clock and seeded: two runs are the same, bit for bit, and the difference between a run
with a fault and the one without is the fault's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide, Waypoint
from autopilot.links.base import GuideAlarms, Link
from autopilot.links.ground_station.mission import Mission
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.nmea.link import NmeaLink, NmeaSettings
from autopilot.links.reconnect import SelectingLink
from autopilot.links.transports import LoopbackTransport, loopback_pair
from autopilot.operators.skipper import Skipper
from autopilot.runtime.app import App, Plan
from autopilot.runtime.build import follow_of, limits_of, track_settings_of
from autopilot.runtime.build_links import selection_of
from autopilot.signals import Mode, Order, OrderKind, SupervisorState, Tick
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.faults import Fault
from sitl.firmware import Firmware
from sitl.registry import KINDS, FaultKind, Source
from sitl.scenario import SecondOrderSection, load_scenario
from sitl.serve import ChaosPort, Endpoint
from sitl.wire_mavlink import MavlinkVehicle
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

STEP = 0.025
COURSE_DEG = 40.0
WARM_UP_S = 45.0
M_PER_RAD = 6371008.8
SENTENCES = {"HDT": 10.0, "ROT": 10.0, "RSA": 10.0, "VHW": 2.0, "RMC": 2.0}
SEA = SecondOrderSection(frequency_rad_s=1.0, damping=0.1, sigma_deg=30.0)
"""A seaway that yaws the boat by one or two degrees: nothing stands still but what has failed."""
METHODS = ("companion", "instruments", "both")


class Clock:
    """The clock of the session: it never waits."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        """Return the simulated time [s]."""
        return self.time

    def wait(self, descriptors: Iterable[int], until: float) -> None:
        """Never called in lockstep."""
        raise AssertionError("lockstep never waits")


class Injected(NamedTuple):
    """One fault of the simulator, `begin` [s] after the moment of injection to `end`, its size growing over `ramp` [s];
    of one of two compasses, or of both."""

    kind: FaultKind
    size: float | None = None
    begin: float = 0.0
    end: float = math.inf
    source: Source = "both"
    ramp: float = 0.0


class Moment(NamedTuple):
    """What one tick shows of the whole, and where the boat really heads [rad, not wrapped]."""

    tick: Tick
    heading: float
    rudder: float


class FaultBoat:
    """Pilot, skipper, links, lines and boat. method: which links there are, `companion`, `instruments` or `both`."""

    def __init__(self, method: str, seed: int = 1) -> None:
        vessel = boat_of_the_matrix()
        scenario = load_scenario("calm")
        scenario = dataclasses.replace(scenario, waves=dataclasses.replace(scenario.waves, second_order=SEA))
        self.world = World(vessel, scenario, seed)
        self.firmware: Firmware | None = None
        self.clock = Clock()
        self.moments: list[Moment] = []
        self.stalled_until = -math.inf
        self.hooks: list[Callable[[], None]] = []
        self._lines: list[tuple[LoopbackTransport, Endpoint]] = []
        self._seed = seed
        track = TrackGuide(track_settings_of(vessel))
        self.skipper = Skipper(limits_of(vessel).angle_max, PlotterGuide(), Mission(track))
        links: list[Link] = []
        if method in ("companion", "both"):
            links.append(self._companion(vessel))
        if method in ("instruments", "both"):
            links.append(self._instruments(vessel, steers=method == "instruments"))
        if method != "companion":
            priority = SensorSelection(selection_of(vessel))
            links = [SelectingLink(link, priority) for link in links]
        links.append(GuideAlarms(track, "track"))
        self.track = track
        app = App(Plan(vessel, self._order, links=tuple(links)), self.clock)
        self.config, self.session = app.pilot._config, app.session

    def _companion(self, vessel: Vessel) -> Link:
        self.firmware = Firmware(self.world)
        self.firmware.parameters.set("RC7_OPTION", 46.0)
        self.vehicle = MavlinkVehicle(self.firmware)
        near = self._line(self.vehicle)
        full = math.radians(vessel.rudder.angle_max_deg)
        settings = CompanionSettings(
            full,
            as_gcs=True,
            heading_latency=vessel.sensors.heading_latency_s,
            battery_percent=vessel.alarms.battery_percent or 0.0,
        )
        return CompanionLink(near, settings)

    def _instruments(self, vessel: Vessel, steers: bool) -> Link:
        baud = 38400
        near = self._line(NmeaInstruments(self.world, SENTENCES, baud), is_stream=True)
        return NmeaLink(near, NmeaSettings(baud=baud, variation=0.0, steers=steers, follow=follow_of(vessel)))

    def _line(self, endpoint: Endpoint, is_stream: bool = False) -> LoopbackTransport:
        near, far = loopback_pair(f"line {len(self._lines)}")
        near.is_stream = is_stream
        seed = np.random.SeedSequence((7, len(self._lines), self._seed))
        self._lines.append((far, ChaosPort(endpoint, self.world, is_stream, seed)))
        return near

    def _order(self, now: float, tick: Tick | None) -> Order:
        return self.skipper(now, tick)

    @property
    def tick(self) -> Tick:
        """The newest tick."""
        return self.moments[-1].tick

    def run(self, seconds: float, until: Callable[[Tick], bool] | None = None) -> bool:
        """Move on; return whether `until` came true of a tick."""
        for _ in range(round(seconds / STEP)):
            self.clock.time = now = round(self.clock.time + STEP, 9)
            for far, port in self._lines:
                for data in far.receive():
                    port.receive(now, data)
            for hook in self.hooks:
                hook()
            self.world.advance(now)
            for far, port in self._lines:
                for data in port.transmit(now):
                    far.send(data)
            if now >= self.stalled_until and self.session.poll(now):
                assert self.session.tick is not None
                state = self.world.boat.state
                self.moments.append(Moment(self.session.tick, state.heading, state.rudder))
                if until is not None and until(self.session.tick):
                    return True
        return False

    def add(self, fault: Injected) -> None:
        """Inject a fault, its times counted from now."""
        time = self.world.time
        size = KINDS[fault.kind].size if fault.size is None else fault.size
        begin, end = time + fault.begin, time + fault.end
        self.world.faults.add(Fault(fault.kind, begin, end, size, fault.ramp, fault.source))

    def type_line(self, line: str) -> None:
        """Type a line at the helm; what is refused is the pilot's answer, not a mistake here."""
        try:
            self.skipper.type_line(line)
        except InputError:
            return


def boat_of_the_matrix() -> Vessel:
    """Return the shipped boat with every monitor on."""
    vessel = load_vessel("lanxin")
    return dataclasses.replace(vessel, alarms=dataclasses.replace(vessel.alarms, roll_deg=30.0, battery_percent=20.0))


def is_engaged(tick: Tick) -> bool:
    """For `until`."""
    return tick.mode is Mode.ENGAGED


def route(boat: FaultBoat) -> list[Waypoint]:
    """Two waypoints ahead, 400 m away and more, in the direction of the course."""
    start = boat.world.scenario.start
    latitude, longitude = math.radians(start.latitude_deg), math.radians(start.longitude_deg)
    course = math.radians(COURSE_DEG)

    def at(distance: float) -> Waypoint:
        return Waypoint(
            latitude + distance * math.cos(course) / M_PER_RAD,
            longitude + distance * math.sin(course) / (M_PER_RAD * math.cos(latitude)),
        )

    return [at(400.0), at(2000.0)]


def bring_into(boat: FaultBoat, state: str) -> None:
    """Bring a new boat into a state of `STATES`. Raises AssertionError where that fails."""
    STATES[state](boat)


def _standby(boat: FaultBoat) -> None:
    boat.run(WARM_UP_S)
    assert boat.tick.mode is Mode.STANDBY, boat.tick.alarms


def _heading(boat: FaultBoat) -> None:
    boat.run(3.0)
    boat.type_line(f"e {COURSE_DEG:g}")
    assert boat.run(8.0, until=is_engaged), boat.tick.alarms
    boat.run(WARM_UP_S - boat.clock.time)
    assert boat.tick.mode is Mode.ENGAGED, boat.tick.alarms


def _turn(boat: FaultBoat) -> None:
    """Half a second into a turn of 120 deg to starboard."""
    _heading(boat)
    boat.type_line("+120")
    boat.run(1.0)


def _track(boat: FaultBoat) -> None:
    boat.run(3.0)
    boat.skipper.hand_to_track()
    boat.track.follow(route(boat))
    assert boat.run(8.0, until=is_engaged), boat.tick.alarms
    boat.run(WARM_UP_S - boat.clock.time)
    assert boat.track.following
    assert boat.tick.mode is Mode.ENGAGED, boat.tick.alarms


def _trial(boat: FaultBoat) -> None:
    """In the middle of a zigzag of 10 deg by 10 deg."""
    _heading(boat)
    boat.skipper.zigzag(math.radians(10.0), math.radians(10.0), 60.0)
    boat.run(5.0)
    assert boat.tick.order.kind is OrderKind.ZIGZAG


def _degraded(boat: FaultBoat) -> None:
    """Engaged with a rate gyro that is off by 10 deg/s, which has been noticed."""
    _heading(boat)
    boat.add(Injected("rate_bias", 10.0))
    boat.run(12.0)
    assert boat.tick.supervisor is SupervisorState.DEGRADED, boat.tick.alarms


def _override(boat: FaultBoat) -> None:
    """Somebody has put the vehicle into HOLD."""
    _heading(boat)
    boat.add(Injected("mode", 4.0))
    boat.run(5.0)
    assert boat.tick.mode is Mode.OVERRIDE, (boat.tick.mode, boat.tick.alarms)


def _failsafe(boat: FaultBoat) -> None:
    """The heading has been lost three seconds ago; the rudder is amidships and not yet released."""
    _heading(boat)
    boat.add(Injected("heading_dropout"))
    boat.run(4.0)
    assert boat.tick.mode is Mode.FAILSAFE, boat.tick.alarms


STATES: dict[str, Callable[[FaultBoat], None]] = {
    "standby": _standby,
    "heading": _heading,
    "turn": _turn,
    "track": _track,
    "trial": _trial,
    "degraded": _degraded,
    "override": _override,
    "fail-safe": _failsafe,
}


def _begin_heading(boat: FaultBoat) -> None:
    """Take over on the course that the boat has."""
    boat.type_line("e")


def _begin_turn(boat: FaultBoat) -> None:
    boat.type_line("e 120")


def _begin_track(boat: FaultBoat) -> None:
    boat.skipper.hand_to_track()
    boat.track.follow(route(boat))


BEGINNINGS: dict[str, Callable[[FaultBoat], None]] = {
    "heading": _begin_heading,
    "turn": _begin_turn,
    "track": _begin_track,
}
"""How a boat that nobody steers yet is put into a state: with these the pilot's first order comes in it."""
ALONE_S = 3.0


def engage(boat: FaultBoat, state: str) -> None:
    """Put a boat that nobody steers yet into a state of `BEGINNINGS`, and go on until the pilot steers. Raises
    AssertionError where that fails."""
    BEGINNINGS[state](boat)
    assert boat.run(8.0, until=is_engaged), boat.tick.alarms


def deviation_deg(faulty: list[Moment], clean: list[Moment]) -> list[tuple[float, float]]:
    """Return (time [s], how far the boat heads from where it would without the fault [deg]) of every tick."""
    times = np.array([moment.tick.now for moment in clean])
    headings = np.array([moment.heading for moment in clean])
    return [
        (moment.tick.now, abs(math.degrees(wrap(moment.heading - float(np.interp(moment.tick.now, times, headings))))))
        for moment in faulty
    ]
