"""Whole pilot, boat, rudder and compass on a route, in a current: the mean cross-track error goes to zero."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import pytest
from boats import BOATS, vessel_of
from plant import Plant

from autopilot.guidance.current import EQUATOR_RADIUS
from autopilot.guidance.plotter import PlotterGuide, PlotterLeg
from autopilot.guidance.track import TrackGuide, Waypoint
from autopilot.links.ground_station.mission import Mission
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot, gear_of, limits_of, model_of, track_settings_of
from autopilot.signals import Order, OrderKind, PositionSample, Sample, SpeedSample, Tick
from autopilot.vessel.file import load_vessel

LATITUDE, LONGITUDE = math.radians(57.7), math.radians(11.9)


def waypoint(north: float, east: float) -> Waypoint:
    # radii of curvature of the ellipsoid, written out
    sine2 = 0.00669437999014 * math.sin(LATITUDE) ** 2
    prime = EQUATOR_RADIUS / math.sqrt(1.0 - sine2)
    meridional = prime * (1.0 - 0.00669437999014) / (1.0 - sine2)
    return Waypoint(LATITUDE + north / meridional, LONGITUDE + east / prime / math.cos(LATITUDE))


class Row(NamedTuple):
    time: float
    target: int
    cross_track: float
    heading: float


def sail_route(name: str, route: list[tuple[float, float]], current: tuple[float, float], seconds: float) -> list[Row]:
    """Sail a route with a GPS of 1 Hz; stops at its end."""
    boat = BOATS[name]
    vessel = vessel_of(boat)
    pilot, box = build_pilot(vessel), Plant(model_of(vessel), gear_of(vessel), heading_noise=0.003)
    guide = TrackGuide(track_settings_of(vessel))
    guide.follow([waypoint(*at) for at in route])
    order, rows, north, east = Order(), [], 0.0, 0.0
    dt = 0.05 if boat.T < 1.0 else 0.1
    for step in range(round(seconds / dt)):
        samples = [*box.sense(), SpeedSample(box.time, boat.speed)]
        if step % round(1.0 / dt) == 0:
            position = PositionSample(box.time, *waypoint(north, east).place)
            samples.append(position)
            guide.take(position)
        tick = pilot.step(box.time, tuple(samples), order)
        heading = guide.course(box.time, tick.state.heading, boat.speed)
        order = Order(OrderKind.HEADING, heading, serial=1)
        box.step(tick.command.angle if tick.command.engaged else 0.0, dt)
        north += dt * (boat.speed * math.cos(box.heading) + current[0])
        east += dt * (boat.speed * math.sin(box.heading) + current[1])
        if guide.leg is not None:
            rows.append(Row(box.time, guide.target, _off(route, guide.target, north, east), box.heading))
        if guide.is_complete:
            break
    return rows


def _off(route: list[tuple[float, float]], target: int, north: float, east: float) -> float:
    """Cross-track error from the true place, not from what the guide believes."""
    start, end = (0.0, 0.0) if target == 0 else route[target - 1], route[target]
    along = math.atan2(end[1] - start[1], end[0] - start[0])
    return (east - start[1]) * math.cos(along) - (north - start[0]) * math.sin(along)


@pytest.mark.parametrize("name", list(BOATS))
def test_the_mean_error_in_a_steady_current_goes_to_zero(name: str) -> None:
    speed = BOATS[name].speed
    rows = sail_route(name, [(5000.0, 0.0)], (0.1 * speed, 0.3 * speed), 450.0)
    settled = [row.cross_track for row in rows if row.time > 350.0]
    assert max(abs(row.cross_track) for row in rows) > 3.0, "the current was felt"
    assert abs(sum(settled) / len(settled)) < 0.2
    assert max(abs(value) for value in settled) < 1.5


@pytest.mark.parametrize("name", list(BOATS))
def test_corners_are_taken_without_running_wide(name: str) -> None:
    settings = track_settings_of(vessel_of(BOATS[name]))
    size = 8.0 * settings.turn_radius + 15.0 * BOATS[name].speed
    route = [(size, 0.0), (size, size), (2.0 * size, size), (size, 0.0)]
    rows = sail_route(name, route, (0.0, 0.0), 1200.0)
    assert rows[-1].target == 3
    for target, inside in ((1, 1.0), (2, -1.0)):
        offs = [inside * row.cross_track for row in rows if row.target == target]
        wide = -min(offs)
        assert wide < 2.0 + 0.25 * settings.turn_radius, (
            f"{wide:.1f} m wide, turning radius {settings.turn_radius:.0f} m"
        )
        assert abs(offs[-1]) < 0.1 * settings.turn_radius


@pytest.mark.parametrize("name", ["container_ship", "frigate"])
def test_a_ship_does_not_go_to_and_fro_across_a_plotter_s_leg(name: str) -> None:
    """With a cross-track error once a second, in a current of 0.2 U; it begins across the leg."""
    vessel = load_vessel(name)
    pilot, box = build_pilot(vessel), Plant(model_of(vessel), gear_of(vessel))
    settings = track_settings_of(vessel)
    skipper = Skipper(limits_of(vessel).angle_max, PlotterGuide(), Mission(TrackGuide(settings)))
    skipper.type_line("e 60")
    skipper.follow()
    tick: Tick | None = None
    off, offs, step = -0.5 * settings.turn_radius, [], 0.2
    for count in range(round(10.0 * settings.turn_radius / settings.speed / step)):
        samples: list[Sample] = [*box.sense(), SpeedSample(box.time, settings.speed)]
        if count % 5 == 0:
            skipper.plotter.take(PlotterLeg(box.time, 0.0, off, 1.852, "WP1"))
            offs.append(off / settings.turn_radius)
        tick = pilot.step(box.time, tuple(samples), skipper(box.time, tick))
        pilot.learn(tick)
        box.step(tick.command.angle if tick.command.engaged else 0.0, step)
        off += step * settings.speed * (math.sin(box.heading) + 0.2)
    crossings = sum(one * other < 0.0 for one, other in itertools.pairwise(offs))
    assert crossings <= 1
    assert abs(offs[-1]) < 0.05
