"""The whole pilot on a boat with a GPS, its skipper, and the link that ground stations see it over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from boats import BOATS, vessel_of
from plant import Plant
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide, Waypoint
from autopilot.links.base import GuideAlarms, Transport
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.transports import loopback_pair
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot, gear_of, limits_of, model_of, track_settings_of
from autopilot.signals import HelmSample, PositionSample, Sample, SpeedSample, Tick, WindSample
from autopilot.vessel.schema import Vessel

M_PER_RAD = 6.3781e6
SPEED = BOATS["lanxin"].speed
LATITUDE, LONGITUDE = 0.5, 0.2
STEP = 0.05


class NoParameters:
    """A parameter store with nothing in it."""

    names: tuple[str, ...] = ()
    revision = 0

    def get(self, name: str) -> float:
        raise KeyError(name)

    def set(self, name: str, value: float) -> str:
        raise KeyError(name)


def place(north: float, east: float) -> Waypoint:
    """A waypoint so many metres from where the boat begins."""
    return Waypoint(LATITUDE + north / M_PER_RAD, LONGITUDE + east / M_PER_RAD / math.cos(LATITUDE))


class Sea:
    """The pilot and its boat, the skipper under test, a GPS that can be lost, a helm that can be taken."""

    def __init__(self, learns: bool = False, vessel: Vessel | None = None) -> None:
        real = vessel_of(BOATS["lanxin"])
        vessel = vessel or real
        self.pilot, self.box = build_pilot(vessel, learns=learns), Plant(model_of(real), gear_of(real))
        self.track = TrackGuide(track_settings_of(vessel))
        self.mission = Mission(self.track)
        self.skipper = Skipper(limits_of(vessel).angle_max, PlotterGuide(), self.mission)
        self.north = self.east = 0.0
        self.current = (0.0, 0.0)
        self.tick: Tick | None = None
        self.route = [place(0.0, 200.0), place(400.0, 200.0)]
        self.links: list[BoatLink] = []
        self.alarms: Any = GuideAlarms(self.track, "track")
        self.ticks: list[Tick] = []

    def sail(self, seconds: float, gps: bool = True, helm: HelmSample | None = None) -> Tick:
        extra: list[Sample] = [] if helm is None else [helm._replace(time=self.box.time)]
        for step in range(round(seconds / STEP)):
            now = self.box.time
            samples = [*self.box.sense(), SpeedSample(now, SPEED), *extra]
            extra = []
            if gps and step % 10 == 0:
                samples.append(PositionSample(now, *place(self.north, self.east).place))
            for link in (self.alarms, *self.links):
                samples.extend(link.receive(now))
            self.tick = self.pilot.step(now, tuple(samples), self.skipper(now, self.tick))
            self.ticks.append(self.tick)
            self.pilot.learn(self.tick)
            for link in self.links:
                link.publish_tick(self.tick)
                link.poll(now)
            self.box.step(self.tick.command.angle if self.tick.command.engaged else 0.0, STEP)
            self.north += STEP * (SPEED * math.cos(self.box.heading) + self.current[0])
            self.east += STEP * (SPEED * math.sin(self.box.heading) + self.current[1])
        assert self.tick is not None
        return self.tick

    def follow(self) -> None:
        self.skipper.hand_to_track()
        self.track.follow(self.route)


class ServedBoat(Sea):
    """The same, seen by ground stations over `transport`, or by `station` over a loopback."""

    def __init__(self, transport: Transport | None = None, armed: bool = False) -> None:
        super().__init__()
        near, self.far = loopback_pair()
        self.commands = Commands(
            self.skipper, armed, self.mission, None, self.skipper.wind, self.pilot.against_engaging
        )
        self.links = [BoatLink(transport or near, self.commands, ParameterServer(NoParameters()))]
        self.station = MavlinkCodec(255, 190)
        self.heard: list[Any] = []

    def ask(self, message: Any, seconds: float = 0.1) -> list[Any]:
        """Send a message from the station and return what it hears in the next seconds; all of it is in `heard`."""
        self.far.send(self.station.encode(message))
        return self.listen(seconds)

    def listen(self, seconds: float, **options: Any) -> list[Any]:
        self.sail(seconds, **options)
        new = [message for data in self.far.receive() for message in self.station.decode(data)]
        self.heard.extend(new)
        return new

    def command(self, command: int, *values: float, place_of: Waypoint | None = None) -> int:
        """Send a command and return the result of its acknowledgement; `place_of` makes it a COMMAND_INT."""
        parameters = [*values, *[0.0] * (7 - len(values))]
        message: Any = dialect.MAVLink_command_long_message(1, 1, command, 0, *parameters)
        if place_of is not None:
            where = (e7(place_of.latitude), e7(place_of.longitude), 0.0)
            message = dialect.MAVLink_command_int_message(1, 1, 6, command, 0, 0, *parameters[:4], *where)
        (ack,) = only(self.ask(message), "COMMAND_ACK")
        assert ack.command == command
        return int(ack.result)


def e7(angle: float) -> int:
    return round(math.degrees(angle) * 1.0e7)


def only(messages: list[Any], kind: str) -> list[Any]:
    return [message for message in messages if message.get_type() == kind]


def item(number: int, waypoint: Waypoint, command: int = 16, frame: int = 6, hold: float = 0.0) -> Any:
    """Return a MISSION_ITEM_INT for our boat."""
    radius = waypoint.radius if math.isfinite(waypoint.radius) else 0.0
    where = (e7(waypoint.latitude), e7(waypoint.longitude), 0.0)
    return dialect.MAVLink_mission_item_int_message(
        1, 1, number, frame, command, 0, 1, hold, radius, 0.0, math.nan, *where
    )


class Vane:
    """A wind vane on the boat, twice a second with 3 deg of noise, and the guide's word to the pilot.

    `gust` [m/s]: standard deviation of the wind's speed, and `veer` [rad] of its direction, both over 10 s.
    `stuck`: what it says whatever blows.
    """

    def __init__(self, sea: Sea) -> None:
        self._sea, self._random = sea, np.random.default_rng(1)
        self._alarms = GuideAlarms(sea.skipper.wind, "wind")
        self._next = 0.0
        self.is_acknowledged = True
        self.wind_from = math.radians(60.0)
        self.gust = self.veer = 0.0
        self._gusts = np.zeros(2)
        self.stuck: WindSample | None = None

    def receive(self, now: float) -> list[Sample]:
        said = self._alarms.receive(now)
        if not self.is_acknowledged or now < self._next:
            return said
        self._next = now + 0.5
        keep = math.exp(-0.05)
        self._gusts = keep * self._gusts + math.sqrt(1.0 - keep * keep) * self._random.standard_normal(2)
        if self.stuck is not None:
            return [*said, self.stuck._replace(time=now)]
        angle, speed = self.felt()
        noise, error = self._random.standard_normal(2)
        return [*said, WindSample(now, wrap(angle + math.radians(3.0) * noise), max(speed + 0.2 * error, 0.0))]

    def felt(self) -> tuple[float, float]:
        """The apparent wind's angle [rad] off the bow and speed: 8 m/s of wind and the boat's own way."""
        heading = self._sea.box.heading
        speed, wind_from = max(8.0 + self.gust * self._gusts[0], 0.5), self.wind_from + self.veer * self._gusts[1]
        north = speed * math.cos(wind_from) + SPEED * math.cos(heading)
        east = speed * math.sin(wind_from) + SPEED * math.sin(heading)
        return wrap(math.atan2(east, north) - heading), math.hypot(north, east)

    def angle(self) -> float:
        return self.felt()[0]

    def true(self) -> float:
        """The true wind's angle [rad] off the bow."""
        return wrap(self.wind_from - self._sea.box.heading)
