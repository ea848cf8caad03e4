"""Track keeping in a current, corners included: the plants of the simulator on a route, the pilot beside two peers.

    python benchmarks/rails.py [--kinds mmg_tanker ...] [--currents 0.3 0.6] [--seeds 2] [--no-log]
    python benchmarks/rails.py --peers [--evaluations 200]

Each plant steers with the vessel file that was identified from it. A route of four legs with turns of 60, -90 and 30
deg; the current sets across the first leg, so that the others meet it from ahead and astern. Instruments are those of
the simulator: heading and yaw rate at 20 Hz, positions with 0.5 m and velocities over the ground with 0.05 m/s of white
noise at 5 Hz, a log at 1 Hz (or none, --no-log). The cross-track error is that of the true place from the path that
the helmsman has planned, legs and corners, in lengths of the hull; `drawn` is that from the nearest leg as it is drawn,
where whoever turns cuts the corner or runs wide; `wide` is how far the boat came outside of a leg behind its corner.

The peers (`rails_peers`) are searched on each plant by runs of their own seeds in both currents, and judged on the
pilot's. The pilot is not searched.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from front_peers import Rudder
from rails_peers import (
    FIX_TICKS,
    LOG_TICKS,
    LOST,
    PEERS,
    TICK,
    TICK_STEPS,
    Boat,
    Given,
    Kind,
    Route,
    Sight,
    begins,
    leg_of,
    off_route,
    planned,
    searched,
)

from autopilot.angles import wrap
from autopilot.guidance.current import Place, offset
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide, TrackSettings, Waypoint, on_arc, swept
from autopilot.links.ground_station.mission import Mission
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot, gear_of, limits_of, model_of, track_settings_of
from autopilot.signals import CourseSample, HeadingSample, PositionSample, Sample, SpeedSample, Tick
from autopilot.vessel.file import load_vessel
from sitl.registry import PLANTS
from sitl.scenario import CurrentSection, Scenario
from sitl.sensors import EARTH_RADIUS, noise_of
from sitl.world import Orders, Pace, World

KINDS = ("mmg_tanker", "roll_ship", "small_craft", "twin_thruster", "outboard")
TURNS_DEG = (60.0, -90.0, 30.0)
BEFORE_S = 60.0
"""The boat holds its course for so long before the route is followed."""
JOINED = 0.3
"""Share of the first leg on which the boat finds to it, from a heading without room for the current."""
LONGEST_S = 3000.0
FRESH = 20261127
CURRENTS = (0.3, 0.6)
TRAINING, SEARCH = (101,), 42
SLOWEST_WAY = 12.0
"""A peer may take so many lengths of a leg, at its speed through the water, for the route."""


class Found(NamedTuple):
    """rms of the cross-track error [lengths], of the whole, of the legs alone and from the drawn legs; the largest;
    how far outside of a leg behind its corner [lengths]; rudder travel [deg/s]; whether the route was ended; alarms."""

    rms: float
    legs: float
    drawn: float
    worst: float
    wide: float
    travel: float
    is_complete: bool
    alarms: tuple[str, ...]


class Off(NamedTuple):
    """A tick: the error from the helmsman's path, whether that is a leg there, from the drawn legs, and outside of the
    leg behind its corner [m]."""

    own: float
    is_leg: bool
    drawn: float
    wide: float


def place_of(scenario: Scenario, north: float, east: float) -> Place:
    """Return a place so many metres from the start, as the simulator has it."""
    latitude = math.radians(scenario.start.latitude_deg) + north / EARTH_RADIUS
    return Place(latitude, math.radians(scenario.start.longitude_deg) + east / (EARTH_RADIUS * math.cos(latitude)))


def legs_of(settings: TrackSettings, length: float, north: float, east: float) -> Route:
    """Return the route [m] of a boat of a `length` [m] from a place on."""
    leg = max(25.0 * length, 10.0 * settings.turn_radius)
    norths, easts, course = [north], [east], 0.0
    for turn in (0.0, *TURNS_DEG):
        course += math.radians(turn)
        norths.append(norths[-1] + leg * math.cos(course))
        easts.append(easts[-1] + leg * math.sin(course))
    return Route(np.array(norths), np.array(easts), settings.speed, settings.turn_radius)


def route_of(scenario: Scenario, settings: TrackSettings, length: float) -> list[Waypoint]:
    """Return the waypoints, from where the boat will be when it begins to follow them."""
    legs = legs_of(settings, length, BEFORE_S * settings.speed, BEFORE_S * scenario.current.speed_m_s)
    places = zip(legs.north[1:], legs.east[1:], strict=True)
    return [Waypoint(*place_of(scenario, float(north), float(east))) for north, east in places]


def true_error(guide: TrackGuide, north: float, east: float) -> tuple[float, bool]:
    """Return how far [m] a place is from the planned path, to starboard, and whether it is on a leg."""
    known, arc = guide.known, guide.behind
    assert known is not None and guide.start is not None
    if arc is not None and arc.turn != 0.0 and (gone := swept(arc, north, east)) < abs(arc.turn):
        if gone >= 0.0:
            return on_arc(arc, north, east, 0.0).cross_track, False
        # the guide is a little ahead of the true place: this one is still on the leg before
        sine, cosine = math.sin(arc.begin), math.cos(arc.begin)
        off = (east - arc.east) * cosine - (north - arc.north) * sine
        return off + arc.side * arc.radius, True
    start, end = offset(known.origin, guide.start), offset(known.origin, guide.route[guide.target].place)
    bearing = math.atan2(end[1] - start[1], end[0] - start[0])
    return (east - start[1]) * math.cos(bearing) - (north - start[0]) * math.sin(bearing), True


class Run:
    """A plant, its pilot and its skipper, one tick of 50 ms at a time."""

    def __init__(self, kind: str, share: float, seed: int, *, has_log: bool) -> None:
        vessel = load_vessel(kind)
        speed = vessel.model.reference_speed_m_s
        self.scenario = Scenario(1, kind, plant=kind, current=CurrentSection(round(share * speed, 6), 90.0))
        self.world = World(vessel, self.scenario, seed, pace=Pace(5, 5))
        self.length = self.world.boat.plant.hull.length
        self.guide = TrackGuide(track_settings_of(vessel))
        self.skipper = Skipper(limits_of(vessel).angle_max, PlotterGuide(), Mission(self.guide))
        self.skipper.engage(0.0)
        self.pilot = build_pilot(vessel)
        self.world.helms.append(self)
        self.tick: Tick | None = None
        self._has_log, self._steps = has_log, 0
        self._first: Place | None = None

    def orders(self, time: float) -> Orders:
        """Return the rudder that was commanded last."""
        command = self.tick.command if self.tick is not None else None
        return Orders(rudder=command.angle if command is not None and command.engaged else 0.0)

    def step(self) -> Tick:
        """Sail on by a tick."""
        self._steps += 1
        now = round(self._steps * TICK, 9)
        self.world.advance(now)
        shown = self.world.sensors.latest(now)
        assert shown is not None
        samples: list[Sample] = [HeadingSample(now, wrap(shown.heading), shown.rate)]
        if self._has_log and self._steps % 20 == 0:
            samples.append(SpeedSample(now, shown.water_speed))
        if self._steps % 4 == 0:
            samples.append(PositionSample(now, math.radians(shown.latitude), math.radians(shown.longitude)))
            samples.append(SpeedSample(now, shown.ground_speed, True))
            samples.append(CourseSample(now, wrap(shown.course)))
        if self._steps == round(BEFORE_S / TICK):
            self.skipper.hand_to_track()
            self.guide.follow(route_of(self.scenario, self.guide.settings, self.length))
        self.tick = self.pilot.step(now, tuple(samples), self.skipper(now, self.tick))
        return self.tick

    @property
    def is_complete(self) -> bool:
        """Whether the last waypoint is behind."""
        return self.guide.is_complete

    @property
    def alarms(self) -> list[str]:
        """The names of the alarms that stand."""
        raised = self.tick.alarms if self.tick is not None else ()
        return [each.name for each in (self.guide.alarm, *raised) if each is not None]

    def off(self, north: float, east: float) -> Off | None:
        """Return how far the true place [m] is from the path; None until the boat has found to the first leg."""
        guide, leg, known = self.guide, self.guide.leg, self.guide.known
        if leg is None or known is None or (guide.target == 0 and leg.remaining >= (1.0 - JOINED) * leg.length):
            return None
        assert guide.start is not None
        there = offset(known.origin, place_of(self.scenario, north, east))
        error, is_leg = true_error(guide, *there)
        is_behind = is_leg and guide.target > 0 and guide.behind is None
        if self._first is None:
            self._first = guide.start
        corners = [offset(known.origin, place) for place in (self._first, *(each.place for each in guide.route))]
        drawn = off_route(Route(*np.array(corners).T, guide.settings.speed, 0.0), *there)
        side = math.copysign(1.0, TURNS_DEG[guide.target - 1])
        return Off(error, is_leg, drawn, -error * side if is_behind else 0.0)


class PeerRun:
    """A plant and a peer of the pilot, which is on the first leg from the beginning, one tick of 50 ms at a time."""

    alarms: tuple[str, ...] = ()

    def __init__(self, kind: str, share: float, seed: int, helm: Any, step: Callable[..., Any]) -> None:
        vessel = load_vessel(kind)
        speed = vessel.model.reference_speed_m_s
        self.scenario = Scenario(1, kind, plant=kind, current=CurrentSection(round(share * speed, 6), 90.0))
        self.world = World(vessel, self.scenario, seed, pace=Pace(5, 5))
        self.length = self.world.boat.plant.hull.length
        self.route = legs_of(track_settings_of(vessel), self.length, 0.0, 0.0)
        self.world.helms.append(self)
        self._helm, self._step, self._memory, self._order = helm, step, begins(speed), 0.0
        self._planned, self._ticks = planned(helm, self.route), 0

    def orders(self, time: float) -> Orders:
        """Return the rudder that was commanded last."""
        return Orders(rudder=self._order)

    def step(self) -> None:
        """Sail on by a tick."""
        self._ticks += 1
        now = round(self._ticks * TICK, 9)
        self.world.advance(now)
        shown, start = self.world.sensors.latest(now), self.scenario.start
        assert shown is not None
        place = (math.nan,) * 4
        if self._ticks % FIX_TICKS == 0:
            north = math.radians(shown.latitude - start.latitude_deg) * EARTH_RADIUS
            parallel = EARTH_RADIUS * math.cos(math.radians(shown.latitude))
            east = math.radians(shown.longitude - start.longitude_deg) * parallel
            place = north, east, shown.north_speed, shown.east_speed
        speed = shown.water_speed if self._ticks % LOG_TICKS == 0 else math.nan
        seen = Sight(wrap(shown.heading), shown.rate, speed, *place)
        self._order, self._memory = self._step(self._helm, self._memory, self.route, seen, TICK)

    @property
    def is_complete(self) -> bool:
        """Whether the last waypoint is behind."""
        return bool(self._memory.done)

    def off(self, north: float, east: float) -> Off | None:
        """Return how far the true place [m] is from the path; None until the boat has found to the first leg."""
        target, route = self._memory.target, self.route
        cosine, sine, length = leg_of(route, target)
        n, e = north - route.north[target - 1], east - route.east[target - 1]
        if target == 1 and n * cosine + e * sine < JOINED * length:
            return None
        own = off_route(self._planned, north, east)
        is_leg = self._memory.turned < 0.0
        outside = (n * sine - e * cosine) * math.copysign(1.0, TURNS_DEG[target - 2]) if target > 1 and is_leg else 0.0
        return Off(own, is_leg, off_route(route, north, east), outside)


def sailed(run: Run | PeerRun) -> Found:
    """Sail a run to its end."""
    boat, offs, alarms, travel = run.world.boat, list[Off](), list[str](), 0.0
    for _ in range(round(LONGEST_S / TICK)):
        before = boat.state.rudder
        run.step()
        off = run.off(boat.state.north, boat.state.east)
        if off is not None:
            travel += abs(boat.state.rudder - before)
            offs.append(off)
        alarms += [each for each in run.alarms if each not in alarms]
        is_lost = off is not None and off.drawn > LOST * run.length
        if run.is_complete or is_lost or "rudder_stuck" in alarms or "rudder_reversed" in alarms:
            break
    if not offs:
        return Found(*(math.nan,) * 6, False, tuple(alarms))
    own, is_leg, drawn, wide = np.array(offs).T / run.length
    return Found(
        float(np.sqrt(np.mean(own**2))),
        float(np.sqrt(np.mean(own[is_leg > 0.0] ** 2))),
        float(np.sqrt(np.mean(drawn**2))),
        float(np.max(np.abs(own))),
        float(np.max(wide)),
        math.degrees(travel) / (len(offs) * TICK),
        run.is_complete,
        tuple(alarms),
    )


def sail(kind: str, share: float, seed: int, *, has_log: bool = True) -> Found:
    """Sail the route of a kind of plant in a current of `share` of its speed."""
    return sailed(Run(kind, share, seed, has_log=has_log))


def searched_peer(kind: str, peer: Kind, evaluations: int) -> Any:
    """Return a peer with the numbers that suit a plant best in the currents of CURRENTS."""
    vessel, scenario = load_vessel(kind), Scenario(1, kind, plant=kind)
    settings, gear, plant = track_settings_of(vessel), gear_of(vessel), PLANTS[kind].of(vessel, scenario)
    model, length = model_of(vessel), plant.hull.length
    rudder = Rudder(gear.angle_max, gear.rate_max)
    step = PLANTS[kind].step
    boat = Boat(plant, step, model.gain, model.time_constant, settings.speed, length, rudder, settings.turn_radius)
    route, noise, own = legs_of(settings, length, 0.0, 0.0), noise_of(vessel, scenario), scenario.sensors
    deviations = [noise.heading, noise.rate, noise.speed, *[own.position_noise_m] * 2, *[noise.speed] * 2]
    ticks = round(SLOWEST_WAY * leg_of(route, 1)[2] / settings.speed / TICK)
    runs = []
    for share, seed in itertools.product(CURRENTS, TRAINING):
        deviates = np.random.default_rng(seed).standard_normal((ticks, 7)) * deviations
        late = round(plant.gear.delay / TICK * TICK_STEPS)
        runs.append(Given(route, route, share * settings.speed, deviates, length, late))
    return searched(peer, boat, runs, evaluations, SEARCH)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--currents", nargs="+", type=float, default=CURRENTS)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=FRESH)
    parser.add_argument("--no-log", action="store_true")
    parser.add_argument("--peers", action="store_true", help="the peers beside the pilot")
    parser.add_argument("--evaluations", type=int, default=200, help="settings tried for each peer and plant")
    given = parser.parse_args()
    for kind in given.kinds:
        helms: dict[str, Any] = {"pilot": None}
        if given.peers:
            helms |= {name: searched_peer(kind, peer, given.evaluations) for name, peer in PEERS.items()}
        for share in given.currents:
            for seed in range(given.first, given.first + given.seeds):
                for name, helm in helms.items():
                    run = Run(kind, share, seed, has_log=not given.no_log) if helm is None else None
                    found = sailed(run or PeerRun(kind, share, seed, helm, PEERS[name].step))
                    print(kind, share, seed, name, json.dumps(found._asdict()), flush=True)


if __name__ == "__main__":
    main()
