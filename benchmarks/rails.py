"""Track keeping in a current, corners included: the plants of the simulator on a route.

    python benchmarks/rails.py [--kinds mmg_tanker ...] [--currents 0.3 0.6] [--seeds 2] [--no-log]

Each plant steers with the vessel file that was identified from it. A route of four legs with turns of 60, -90 and 30
deg; the current sets across the first leg, so that the others meet it from ahead and astern. Instruments are those of
the simulator: heading and yaw rate at 20 Hz, positions with 0.5 m and velocities over the ground with 0.05 m/s of white
noise at 5 Hz, a log at 1 Hz (or none, --no-log). The cross-track error is that of the true place from the path that
the guide has planned, legs and arcs, in lengths of the hull; `wide` is how far the boat came outside of a leg.
"""

from __future__ import annotations

import argparse
import json
import math
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.guidance.fix import Place, offset
from autopilot.guidance.path import on_arc, swept
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide, TrackSettings, Waypoint
from autopilot.links.ground_station.mission import Mission
from autopilot.operators.skipper import RouteSkipper
from autopilot.runtime.build import build_pilot, limits_of, track_settings_of
from autopilot.signals import CourseSample, HeadingSample, PositionSample, Sample, SpeedSample, Tick
from autopilot.vessel.file import load_vessel
from sitl.plants import PLANTS
from sitl.scenario import CurrentSection, Scenario
from sitl.sensors import EARTH_RADIUS
from sitl.world import Orders, Pace, World

KINDS = ("mmg_tanker", "roll_ship", "small_craft", "twin_thruster", "outboard")
TURNS_DEG = (60.0, -90.0, 30.0)
TICK = 0.05
BEFORE_S = 60.0
"""The boat holds its course for so long before the route is followed."""
JOINED = 0.3
"""Share of the first leg on which the boat finds to it, from a heading without room for the current."""
LONGEST_S = 3000.0
FRESH = 20261124


class Found(NamedTuple):
    """rms of the cross-track error [lengths], of the whole and of the legs alone; the largest; how far outside of a
    leg behind its corner [lengths]; rudder travel [deg/s]; whether the route was ended; alarms."""

    rms: float
    legs: float
    worst: float
    wide: float
    travel: float
    is_complete: bool
    alarms: tuple[str, ...]


def place_of(scenario: Scenario, north: float, east: float) -> Place:
    """Return a place so many metres from the start, as the simulator has it."""
    latitude = math.radians(scenario.start.latitude_deg) + north / EARTH_RADIUS
    return Place(latitude, math.radians(scenario.start.longitude_deg) + east / (EARTH_RADIUS * math.cos(latitude)))


def route_of(scenario: Scenario, settings: TrackSettings, length: float) -> list[Waypoint]:
    """Return the waypoints, from where the boat will be when it begins to follow them."""
    leg = max(25.0 * length, 10.0 * settings.turn_radius)
    north, east = BEFORE_S * settings.speed, BEFORE_S * scenario.current.speed_m_s
    places, course = [], 0.0
    for turn in (0.0, *TURNS_DEG):
        course += math.radians(turn)
        north, east = north + leg * math.cos(course), east + leg * math.sin(course)
        places.append(Waypoint(*place_of(scenario, north, east)))
    return places


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
        self.length = PLANTS[kind].of(vessel, self.scenario).hull.length
        self.guide = TrackGuide(track_settings_of(vessel))
        self.skipper = RouteSkipper(limits_of(vessel).angle_max, PlotterGuide(), Mission(self.guide))
        self.skipper.engage(0.0)
        self.pilot = build_pilot(vessel)
        self.world.helms.append(self)
        self.tick: Tick | None = None
        self._has_log, self._steps = has_log, 0

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


def sail(kind: str, share: float, seed: int, *, has_log: bool = True) -> Found:
    """Sail the route of a kind of plant in a current of `share` of its speed."""
    run = Run(kind, share, seed, has_log=has_log)
    guide, boat = run.guide, run.world.boat
    errors: list[tuple[float, bool, float]] = []
    alarms: list[str] = []
    travel = 0.0
    for _ in range(round(LONGEST_S / TICK)):
        before = boat.state.rudder
        tick = run.step()
        leg, known = guide.leg, guide.known
        if leg is not None and known is not None and (guide.target > 0 or leg.remaining < (1.0 - JOINED) * leg.length):
            travel += abs(boat.state.rudder - before)
            there = offset(known.origin, place_of(run.scenario, boat.state.north, boat.state.east))
            error, is_leg = true_error(guide, *there)
            is_behind = is_leg and guide.target > 0 and guide.behind is None
            side = math.copysign(1.0, TURNS_DEG[guide.target - 1])
            errors.append((error / run.length, is_leg, -error * side / run.length if is_behind else 0.0))
        alarms += [each.name for each in (guide.alarm, *tick.alarms) if each is not None and each.name not in alarms]
        if guide.is_complete or "rudder_stuck" in alarms or "rudder_reversed" in alarms:
            break
    if not errors:
        return Found(math.nan, math.nan, math.nan, math.nan, math.nan, False, tuple(alarms))
    off, is_leg, wide = np.array(errors).T
    return Found(
        float(np.sqrt(np.mean(off**2))),
        float(np.sqrt(np.mean(off[is_leg > 0.0] ** 2))),
        float(np.max(np.abs(off))),
        float(np.max(wide)),
        math.degrees(travel) / (len(errors) * TICK),
        guide.is_complete,
        tuple(alarms),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--currents", nargs="+", type=float, default=(0.3, 0.6))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=FRESH)
    parser.add_argument("--no-log", action="store_true")
    given = parser.parse_args()
    for kind in given.kinds:
        for share in given.currents:
            for seed in range(given.first, given.first + given.seeds):
                found = sail(kind, share, seed, has_log=not given.no_log)
                print(kind, share, seed, json.dumps(found._asdict()), flush=True)


if __name__ == "__main__":
    main()
