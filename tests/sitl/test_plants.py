"""The plants with equations of their own: mechanics that holds for each of them, and each steered by its own file."""

from __future__ import annotations

import ast
import dataclasses
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lockstep import Lockstep

from autopilot.angles import wrap
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel
from sitl.ardupilot import ArdupilotPhysics
from sitl.boat import STILL, Boat, BoatState, Disturbance
from sitl.cli import main as sitl
from sitl.registry import PLANT_MODULES, PLANTS, USUAL
from sitl.scenario import CurrentSection, GearSection, Scenario, WindSection, load_scenario
from sitl.serve import afloat
from sitl.world import World

KINDS = [kind for kind in PLANTS if kind != USUAL]
each = pytest.mark.parametrize("kind", KINDS)
DT = 0.01


def plant_of(kind: str, **keys: Any) -> Any:
    return PLANTS[kind].of(load_vessel(kind), Scenario(1, kind, plant=kind, **keys))


def boat_of(kind: str, state: BoatState, plant: Any = None) -> Boat:
    return Boat(plant_of(kind) if plant is None else plant, state, PLANTS[kind].step)


def sailed(boat: Boat, seconds: float, order: float, thrust: float, acting: Disturbance = STILL) -> list[BoatState]:
    steps = range(round(seconds / DT))
    return [boat.step(step * DT, order, thrust, acting, DT) for step in steps]


def after_lengths(boat: Boat, lengths: float, order: float, thrust: float, speed: float) -> list[BoatState]:
    """The states while a boat of that `speed` goes so many lengths, a hundred steps to each."""
    dt = 0.01 * boat.plant.hull.length / speed
    return [boat.step(step * dt, order, thrust, STILL, dt) for step in range(round(100.0 * lengths))]


def cruise_of(kind: str) -> float:
    return load_vessel(kind).model.reference_speed_m_s


def under_way(kind: str) -> BoatState:
    speed = cruise_of(kind)
    return BoatState(speed=speed, north_speed=speed)


@pytest.mark.parametrize("module", [module for module in (*PLANT_MODULES, "craft") if module != "boat"])
def test_no_equation_of_motion_comes_from_the_pilots_models(module: str) -> None:
    tree = ast.parse((Path(__file__).parents[2] / "sitl" / f"{module}.py").read_text(encoding="utf-8"))
    taken = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    assert {name for name in taken if name.startswith("autopilot.models")} <= {"autopilot.models.steering_gear"}


@each
def test_what_lies_still_stays_where_it_is(kind: str) -> None:
    # two propellers turn a boat on the spot
    order = 0.0 if kind == "twin_thruster" else 0.3
    state = sailed(boat_of(kind, BoatState()), 10.0, order, 0.0)[-1]
    assert state._replace(rudder=0.0) == BoatState()


@each
def test_without_engine_a_moving_boat_comes_to_rest(kind: str) -> None:
    speed = cruise_of(kind)
    length = plant_of(kind).hull.length
    start = BoatState(speed=speed, sway=0.2 * speed, rate=0.3 * speed / length, roll=0.1)
    states = after_lengths(boat_of(kind, start), 60.0, 0.0, 0.0, speed)
    lively = [math.hypot(state.speed, state.sway, length * state.rate) for state in states]
    assert max(lively) <= 1.05 * lively[0]
    assert lively[-1] < 0.2 * lively[0]
    assert abs(states[-1].roll) < 0.01


@each
def test_the_engine_holds_the_speed_ordered(kind: str) -> None:
    speed = cruise_of(kind)
    for share in (0.5, 1.0):
        boat = boat_of(kind, BoatState(speed=0.8 * speed))
        assert after_lengths(boat, 80.0, 0.0, share * speed, speed)[-1].speed == pytest.approx(share * speed, rel=0.03)


@each
def test_starboard_rudder_turns_to_starboard_with_the_stern_outside(kind: str) -> None:
    speed = cruise_of(kind)
    boat = boat_of(kind, under_way(kind))
    state = after_lengths(boat, 8.0, math.radians(15.0), speed, speed)[-1]
    assert state.rate > 0.0 and state.heading > 0.2
    assert state.sway < 0.0


@each
def test_a_current_carries_water_and_boat_alike(kind: str) -> None:
    stream = Disturbance(current_north=0.3, current_east=-0.4)
    still = sailed(boat_of(kind, BoatState(speed=cruise_of(kind))), 20.0, 0.2, cruise_of(kind))
    carried = sailed(boat_of(kind, BoatState(speed=cruise_of(kind))), 20.0, 0.2, cruise_of(kind), stream)
    for one, other in zip(still, carried, strict=True):
        assert other[2:9] == one[2:9]
    assert carried[-1].north - still[-1].north == pytest.approx(0.3 * 20.0, rel=1e-3)
    assert carried[-1].east - still[-1].east == pytest.approx(-0.4 * 20.0, rel=1e-3)


@each
def test_a_push_is_worth_its_rudder_at_the_service_speed_and_at_rest(kind: str) -> None:
    push = Disturbance(rudder=0.05)
    moving = sailed(boat_of(kind, under_way(kind)), DT, 0.0, cruise_of(kind), push)[-1]
    calm = sailed(boat_of(kind, under_way(kind)), DT, 0.0, cruise_of(kind))[-1]
    resting = sailed(boat_of(kind, BoatState()), DT, 0.0, 0.0, push)[-1]
    assert moving.rate - calm.rate == pytest.approx(resting.rate, rel=0.05)
    assert resting.rate == pytest.approx(0.05 * boat_of(kind, BoatState()).plant.push * DT, rel=0.05)


@each
def test_wind_drives_away_from_where_it_comes_from(kind: str) -> None:
    speed = cruise_of(kind)
    abeam = sailed(boat_of(kind, under_way(kind)), 5.0, 0.0, speed, Disturbance(wind_starboard=8.0))[-1]
    calm = sailed(boat_of(kind, under_way(kind)), 5.0, 0.0, speed)[-1]
    assert abeam.sway < calm.sway
    ahead = sailed(boat_of(kind, under_way(kind)), 5.0, 0.0, speed, Disturbance(wind_ahead=8.0))[-1]
    astern = sailed(boat_of(kind, under_way(kind)), 5.0, 0.0, speed, Disturbance(wind_ahead=-8.0))[-1]
    assert ahead.speed < calm.speed < astern.speed


@each
def test_wind_waves_and_faults_of_a_scenario_reach_the_plant(kind: str) -> None:
    weather = load_scenario("ittc")
    rough = dataclasses.replace(
        weather,
        plant=kind,
        wind=WindSection(speed_m_s=4.0, from_deg=60.0, gust_m_s=0.5),
        current=CurrentSection(0.2, 90.0),
    )
    calm = dataclasses.replace(load_scenario("calm"), plant=kind)
    states = []
    for scenario in (rough, calm):
        world = World(load_vessel(kind), scenario)
        world.advance(10.0)
        states.append(world.boat.state)
    assert all(math.isfinite(value) for value in states[0])
    assert abs(states[0].heading - states[1].heading) > 1e-4 and abs(states[0].roll - states[1].roll) > 1e-5


@each
def test_half_the_step_gives_the_same_motion(kind: str) -> None:
    speed, ends = cruise_of(kind), []
    for dt in (0.01, 0.005):
        boat = boat_of(kind, under_way(kind))
        for step in range(round(20.0 / dt)):
            boat.step(step * dt, 0.2, speed, STILL, dt)
        ends.append(np.array(boat.state))
    np.testing.assert_allclose(ends[0][2:], ends[1][2:], rtol=2e-3, atol=2e-3 * speed)
    # where a circle happens to end says nothing of how exactly it was sailed
    np.testing.assert_allclose(ends[0][:2], ends[1][:2], rtol=0.0, atol=1e-3 * 20.0 * speed)


@each
def test_backlash_and_a_valve_are_options_of_every_gear(kind: str) -> None:
    play = plant_of(kind, gear=GearSection(play_deg=2.0))
    boat = boat_of(kind, under_way(kind), play)
    stiff = sailed(boat, 5.0, math.radians(10.0), cruise_of(kind))[-1]
    assert math.degrees(stiff.rudder) == pytest.approx(8.0, abs=0.01)
    back = sailed(boat, 5.0, math.radians(7.0), cruise_of(kind))[-1]
    assert back.rudder == pytest.approx(stiff.rudder, abs=1e-6), "within the play"
    valve = plant_of(kind, gear=GearSection(on_off=True, dead_band_deg=1.0, rate_deg_s=5.0))
    moves = np.diff([0.0, *(state.rudder for state in sailed(boat_of(kind, under_way(kind), valve), 4.0, 0.2, 1.0))])
    full = math.radians(5.0) * DT
    assert np.all((np.abs(moves) < 1e-12) | (np.abs(moves - full) < 1e-9)), "at its full rate or not at all"
    assert moves.sum() == pytest.approx(0.2, abs=math.radians(1.0) + full)


@each
def test_the_vessel_file_knows_the_steering_gear_of_its_plant(kind: str) -> None:
    gear, rudder = plant_of(kind).gear, load_vessel(kind).rudder
    assert math.degrees(gear.angle_max) == pytest.approx(rudder.angle_max_deg)
    assert math.degrees(gear.rate_max) == pytest.approx(rudder.rate_max_deg_s or math.inf)
    assert gear.lag == rudder.lag_s


@each
def test_its_own_file_steers_it_through_a_turn_and_holds_it(kind: str) -> None:
    vessel = load_vessel(kind)
    boat = Lockstep(vessel, scenario=dataclasses.replace(load_scenario("calm"), plant=kind), measured_every=2)
    boat.engage(0.0)
    assert boat.run(60.0, boat.engaged)
    boat.run(10.0)
    boat.engage(30.0)
    lasts = max(40.0, 20.0 * plant_of(kind).hull.length / cruise_of(kind))
    errors = []
    for _ in range(round(lasts)):
        boat.run(1.0)
        errors.append(math.degrees(wrap(boat.world.boat.state.heading - math.radians(30.0))))
    assert boat.tick.mode is Mode.ENGAGED
    assert max(errors) < 6.0, "past the course"
    assert max(abs(error) for error in errors[-len(errors) // 4 :]) < 3.0, "on the course"


@each
@pytest.mark.parametrize("command", ["serve", "serve --nmea", "ardupilot-physics"])
def test_every_command_takes_the_name_of_a_plant(
    kind: str, command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    if command == "ardupilot-physics":
        physics = ArdupilotPhysics(load_vessel(kind), afloat(kind, load_scenario("calm")))
        for frame in range(500):
            pulses = [1700, 1500, 1750, *[1500] * 13]
            assert physics.answer(struct.pack("<HHI16H", 18458, 100, frame, *pulses))
        assert physics.state.speed > 0.05 * cruise_of(kind) and physics.state.rate > 0.0
    else:
        truth = tmp_path / "truth.csv"
        line = ["--nmea", f"{tmp_path / 'line'}:38400"] if "nmea" in command else ["--mavlink", "udpin:127.0.0.1:0"]
        assert sitl(["serve", kind, *line, "--duration", "2", "--speedup", "20", "--truth", str(truth)]) == 0
        rows = np.loadtxt(truth, delimiter=",", skiprows=1)
        assert rows[-1, 1] == pytest.approx(2.0 * cruise_of(kind), rel=0.1), "went straight ahead"


def test_a_named_plant_gives_way_to_the_scenarios() -> None:
    calm = load_scenario("calm")
    assert afloat("mmg_tanker", calm).plant == "mmg_tanker"
    assert afloat("lanxin", calm).plant == USUAL
    assert afloat("blueboat", calm, "two_thrusters").plant == "twin_thruster"
    other = dataclasses.replace(calm, plant="mmg_tanker")
    assert afloat("lanxin", other).plant == "mmg_tanker"
