"""Boats that steer by thrust through the simulated ArduRover, in lockstep: proof, turns, pivot, faults, refusals."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import pytest
from boat_at_sea import place
from lockstep import Lockstep

from autopilot.angles import wrap
from autopilot.doctor.vehicle import firmware_findings
from autopilot.guidance.manoeuvres import OneThruster
from autopilot.signals import Mode, Order, Tick
from autopilot.vessel.file import load_vessel
from sitl.registry import PLANTS
from sitl.scenario import CurrentSection, FaultSection, Scenario, SecondOrderSection, Start, WavesSection


def sailed(kind: str, *, speed: float | None = None, faults: tuple[FaultSection, ...] = (), **more: Any) -> Lockstep:
    scenario = Scenario(1, kind, plant=kind, start=Start(speed_m_s=speed), faults=faults)
    return Lockstep(load_vessel(kind), scenario=scenario, measured_every=2, **more)


def engaged(boat: Lockstep, course: float = 0.0) -> Lockstep:
    boat.engage(course)
    assert boat.run(10.0, boat.engaged), boat.tick.alarms
    return boat


def off(boat: Lockstep, course: float) -> float:
    return math.degrees(wrap(boat.world.boat.state.heading - math.radians(course)))


@pytest.mark.parametrize("kind", ["twin_thruster", "outboard"])
def test_a_turn_is_made_and_the_course_held(kind: str) -> None:
    boat = engaged(sailed(kind))
    boat.run(5.0)
    boat.engage(60.0)
    worst = -math.inf
    for _ in range(120):
        boat.run(0.1)
        worst = max(worst, off(boat, 60.0))
    assert abs(off(boat, 60.0)) < 1.0
    assert worst < 3.0, "deg past the course"


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
def test_control_is_proved_and_both_thrusters_answer(method: str) -> None:
    boat = engaged(sailed("twin_thruster", settings={"method": method}), 20.0)
    boat.run(1.0)
    left, right = boat.firmware.servos[0], boat.firmware.servos[2]
    assert left > right, "to starboard the left thruster pushes more"


def test_somebody_else_at_the_thrusters_is_noticed() -> None:
    boat = engaged(sailed("twin_thruster"))

    def other(there: Lockstep) -> None:
        there.firmware.overrides.put(1, 1900, there.world.time)

    boat.hooks.append(other)
    assert boat.run(6.0, lambda tick: not tick.command.engaged), "the helm is given up"


def test_a_thruster_s_end_points_that_are_changed_under_way_are_said() -> None:
    boat = engaged(sailed("twin_thruster"))
    for value, is_said in ((1700.0, True), (boat.firmware.parameters["SERVO3_MAX"], False)):
        boat.firmware.parameters.set("SERVO3_MAX", value)
        boat.run(60.0)
        said = [alarm.detail for alarm in boat.tick.alarms if alarm.name == "servo_changed"]
        assert [words.startswith("SERVO3_MAX was changed from") for words in said] == [True] * is_said


def test_a_boat_with_two_thrusters_turns_where_it_lies() -> None:
    boat = sailed("twin_thruster", speed=0.0)
    boat.firmware.sticks[2] = 1500
    engaged(boat)
    boat.run(3.0)
    start = boat.world.boat.state
    boat.engage(90.0)
    boat.run(12.0)
    state = boat.world.boat.state
    assert abs(off(boat, 90.0)) < 2.0
    length = boat.world.boat.plant.hull.length
    assert math.hypot(state.north - start.north, state.east - start.east) < 0.1 * length


@pytest.mark.parametrize("times", [1.0 / 3.0, 3.0])
def test_an_outboard_does_not_overshoot_at_a_third_and_three_times_the_thrust(times: float) -> None:
    motors, speed = PLANTS["outboard"].motors, load_vessel("outboard").model.reference_speed_m_s
    assert motors is not None
    boat = engaged(sailed("outboard"))
    throttle = boat.firmware.setup.throttle_input
    above = throttle.trim + throttle.dead_zone
    share = motors.throttle_of(times * speed)
    boat.firmware.sticks[2] = math.ceil(above + share * (throttle.high - above))
    boat.run(2.0)
    boat.engage(40.0)
    worst = -math.inf
    for _ in range(150):
        boat.run(0.1)
        worst = max(worst, off(boat, 40.0))
    assert abs(off(boat, 40.0)) < 2.0
    assert worst < 3.0, "deg past the course"


def test_an_outboard_without_thrust_waits() -> None:
    boat = engaged(sailed("outboard"))
    boat.firmware.sticks[2] = 1500
    boat.run(3.0)
    assert boat.tick.command.angle == pytest.approx(0.0, abs=1.0e-3)
    assert "low_speed" in {alarm.name for alarm in boat.tick.alarms}


@pytest.mark.parametrize(
    ("kind", "set_up", "words"),
    [
        ("rudder", {}, "set drive.kind: two_thrusters in the vessel file"),
        ("two_thrusters", {"SERVO1_FUNCTION": 26.0, "SERVO3_FUNCTION": 70.0}, "which is rudder"),
        ("two_thrusters", {"SERVO3_FUNCTION": 0.0}, "of 73, 74 only 73 is there"),
        ("two_thrusters", {"PILOT_STEER_TYPE": 1.0}, "PILOT_STEER_TYPE is 1"),
    ],
)
def test_outputs_that_do_not_go_with_the_drive_are_refused_with_what_to_do(
    kind: str, set_up: dict[str, float], words: str
) -> None:
    boat = sailed("twin_thruster", settings={"drive": kind}, parameters=set_up)
    boat.engage(0.0)
    assert not boat.run(9.0, boat.engaged)
    details = " ".join(alarm.detail for alarm in boat.tick.alarms)
    assert words in details


def test_the_doctor_tells_thrusters_that_are_set_up_wrongly() -> None:
    boat = engaged(sailed("twin_thruster"))
    boat.run(1.0)
    vessel = load_vessel("twin_thruster")
    by_name = {each.name: each for each in firmware_findings(boat.link.session.parameters, vessel)}
    assert by_name["thrusters"].verdict.name == "GO"
    plain = dataclasses.replace(vessel, drive=dataclasses.replace(vessel.drive, thrust_exponent=None))
    boat.link.session.parameters.take("MOT_THST_ASYM", 1.0)
    by_name = {each.name: each for each in firmware_findings(boat.link.session.parameters, plain)}
    assert "set MOT_THST_ASYM to thrust ahead" in by_name["thrusters"].cure
    by_name = {each.name: each for each in firmware_findings(boat.link.session.parameters, vessel)}
    assert "the root of thrust ahead over thrust astern" in by_name["thrusters"].cure, "it goes with the square here"


def test_full_throttle_leaves_less_steering_and_the_law_knows() -> None:
    boat = engaged(sailed("twin_thruster"))
    boat.run(1.0)
    easy = boat.pilot.state.estimate.speeds.reach
    boat.firmware.sticks[2] = 2000
    boat.run(4.0)
    assert boat.pilot.state.estimate.speeds.throttle.value == pytest.approx(1.0, abs=0.03)
    assert boat.pilot.state.estimate.speeds.reach < easy


@pytest.mark.parametrize("size", [-0.6, 0.6])
def test_weed_on_one_thruster_is_steered_against(size: float) -> None:
    weed = FaultSection("thruster_weed", 12.0, size=size)
    boat = engaged(sailed("twin_thruster", faults=(weed,)))
    boat.run(60.0)
    assert abs(off(boat, 0.0)) < 3.0


@pytest.mark.parametrize(("fault", "size"), [("thruster_dead", -1.0), ("thruster_dead", 1.0), ("thruster_weed", 0.6)])
def test_a_thruster_that_fails_is_said_within_five_seconds_and_the_course_held(fault: str, size: float) -> None:
    boat = engaged(sailed("twin_thruster", faults=(FaultSection(fault, 20.0, size=size),)))
    boat.run(18.0)

    def is_said(tick: Tick) -> bool:
        return any(alarm.name == "thruster_weak" for alarm in tick.alarms)

    assert not any(is_said(tick) for tick in boat.ticks)
    while boat.world.time < 20.0:
        boat.run(0.1)
    assert boat.run(5.0, is_said)
    alarm = next(alarm for alarm in boat.tick.alarms if alarm.name == "thruster_weak")
    assert alarm.detail == ("starboard" if size > 0.0 else "port")
    boat.run(20.0)
    assert abs(off(boat, 0.0)) < 3.0, "what is left of the thrust holds the course"


@pytest.mark.parametrize(("size", "side"), [(-1.0, "port"), (1.0, "starboard")])
def test_a_thruster_that_is_dead_in_a_turn_is_said_within_five_seconds(size: float, side: str) -> None:
    """From when the turn to starboard, which port makes and starboard ends, asks it for thrust."""
    boat = engaged(sailed("twin_thruster", faults=(FaultSection("thruster_dead", 20.0, size=size),)))
    boat.run(20.0 - boat.world.time)
    boat.engage(60.0)
    assert boat.run(5.0, lambda tick: size * tick.command.angle < -0.1)
    assert boat.run(5.0, lambda tick: any(alarm.name == "thruster_weak" for alarm in tick.alarms))
    assert next(alarm.detail for alarm in boat.tick.alarms if alarm.name == "thruster_weak") == side


@pytest.mark.parametrize("size", [-1.0, 1.0])
def test_one_thruster_drives_the_boat_by_swings_where_holding_the_course_does_not(size: float) -> None:
    boat = engaged(sailed("twin_thruster", faults=(FaultSection("thruster_dead", 15.0, size=size),)))
    boat.run(45.0)
    serial, swings, begun = boat.order.serial, OneThruster(), boat.world.boat.state
    assert begun.speed < 0.1, "it is held, not driven"
    swings.follow("starboard" if size > 0.0 else "port")
    for _ in range(240):
        state = boat.world.boat.state
        where = place(state.north, state.east).place
        boat.order = swings.order(0.0, math.radians(30.0), where)._replace(serial=serial)
        boat.run(0.5)
    state = boat.world.boat.state
    north, east = state.north - begun.north, state.east - begun.east
    assert boat.tick.mode is Mode.ENGAGED
    assert math.hypot(north, east) > 0.06 * 120.0 and abs(math.degrees(math.atan2(east, north))) < 20.0


def test_neither_turns_nor_a_push_are_taken_for_a_thruster_that_fails() -> None:
    gust = FaultSection("yaw_push", 40.0, size=5.0)
    boat = engaged(sailed("twin_thruster", faults=(gust,)))
    for course in (90.0, 0.0, -170.0):
        boat.run(10.0)
        boat.engage(course)
    boat.run(20.0)
    assert not any(alarm.name == "thruster_weak" for tick in boat.ticks for alarm in tick.alarms)


@pytest.mark.parametrize("seed", [6, 10])
def test_neither_a_stream_nor_waves_are_taken_for_a_thruster_that_fails(seed: int) -> None:
    """Each turn changes what the stream does to the speed, and the work against waves drives the boat, too."""
    waves = WavesSection(second_order=SecondOrderSection(0.8, 0.15, 36.5))
    sea = {"waves": waves, "current": CurrentSection(0.25, 150.0), "seed": seed}
    scenario = Scenario(1, "stream", plant="twin_thruster", start=Start(speed_m_s=0.8), **sea)
    boat = engaged(Lockstep(load_vessel("twin_thruster"), scenario=scenario, measured_every=5))
    for course in (60.0, 150.0, 90.0, -160.0):
        boat.run(15.0)
        boat.engage(course)
    boat.run(20.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert not any(alarm.name == "thruster_weak" for tick in boat.ticks for alarm in tick.alarms)


def test_a_speed_that_comes_back_is_not_taken_for_a_thruster_that_fails() -> None:
    """While none is known the boat is steered as at its trial's speed, which it does not make."""
    waves, lost = WavesSection(second_order=SecondOrderSection(0.8, 0.15, 36.5)), FaultSection("speed_lost", 20.0, 45.0)
    scenario = Scenario(
        1, "lost", plant="twin_thruster", start=Start(speed_m_s=0.67), seed=0, waves=waves, faults=(lost,)
    )
    boat = engaged(Lockstep(load_vessel("twin_thruster"), scenario=scenario, measured_every=5))
    boat.run(50.0 - boat.now)
    assert boat.tick.mode is Mode.ENGAGED
    assert not any(alarm.name == "thruster_weak" for tick in boat.ticks for alarm in tick.alarms)


def test_at_twice_the_speed_a_slide_after_a_turn_is_not_taken_for_a_sea() -> None:
    boat = engaged(sailed("twin_thruster", speed=2.0 * load_vessel("twin_thruster").model.reference_speed_m_s))
    boat.run(5.0)
    for course in (30.0, 0.0):
        boat.engage(course)
        boat.run(4.0)
        late = [abs(off(boat, course)) for _ in range(100) if not boat.run(0.1)]
        assert max(late) < 1.5, "deg off the course"
    boat.engage(90.0)
    boat.run(2.0)
    assert abs(boat.pilot.state.way.guide.slide) > math.radians(5.0)
    boat.run(25.0)
    assert abs(boat.pilot.state.estimate.fusion.state.slide) < math.radians(0.1), "it is over"
    boat.engage(0.0)
    boat.run(2.0)
    boat.order = Order()
    boat.run(0.2)
    assert boat.pilot.state.way.guide.slide == 0.0, "nobody steers"


def test_after_a_turn_the_rudder_works_no_more_than_on_the_course_before() -> None:
    boat = engaged(sailed("outboard"))
    boat.run(5.0)
    travel = []
    for course, waits in ((0.0, 0.0), (90.0, 9.0)):
        boat.engage(course)
        boat.run(waits)
        angles = [boat.tick.command.angle for _ in range(400) if not boat.run(0.05)]
        travel.append(sum(abs(after - before) for before, after in itertools.pairwise(angles)))
    assert travel[1] < 1.3 * travel[0]
