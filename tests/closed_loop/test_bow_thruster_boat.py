"""A boat with a bow thruster through the simulated ArduRover, in lockstep: turns without way, and every way to stop."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from lockstep import Lockstep

from autopilot.angles import wrap
from autopilot.links.rudder_order import ReleaseState
from autopilot.runtime.tick_codec import decode_tick, encode_tick
from autopilot.signals import Mode, Order, ThrusterSample
from autopilot.vessel.file import load_vessel
from sitl.firmware import BOW_OUTPUT
from sitl.scenario import FaultSection, Scenario, Start, WindSection

REST_US = 1500


def lying(
    *,
    seed: int = 1,
    speed: float | None = 0.0,
    faults: tuple[FaultSection, ...] = (),
    wind: WindSection | None = None,
    thruster: dict[str, Any] | None = None,
    **more: Any,
) -> Lockstep:
    """Return the boat, engaged on north: without way or throttle, or with both."""
    vessel = load_vessel("bow_thruster")
    fitted = vessel.drive.bow_thruster
    assert fitted is not None
    drive = dataclasses.replace(vessel.drive, bow_thruster=dataclasses.replace(fitted, **(thruster or {})))
    scenario = Scenario(
        1,
        "lying",
        seed=seed,
        plant="small_craft",
        start=Start(speed_m_s=speed),
        faults=faults,
        wind=wind or WindSection(),
    )
    boat = Lockstep(dataclasses.replace(vessel, drive=drive), scenario=scenario, measured_every=2, **more)
    boat.firmware.sticks[2] = 1500 if speed == 0.0 else boat.ahead_us
    boat.engage(0.0)
    assert boat.run(15.0, boat.engaged), boat.tick.alarms
    boat.run(4.0)
    return boat


def off(boat: Lockstep, course: float) -> float:
    return math.degrees(wrap(boat.world.boat.state.heading - math.radians(course)))


def turning(boat: Lockstep) -> Lockstep:
    """Return the boat in the midst of a turn, its thruster at work."""
    boat.engage(120.0)
    assert boat.run(10.0, lambda tick: tick.command.thruster > 0.0), boat.tick.alarms
    boat.run(1.0)
    assert boat.firmware.servos[BOW_OUTPUT - 1] > REST_US
    return boat


def names(boat: Lockstep) -> set[str]:
    return {alarm.name for alarm in boat.tick.alarms}


@pytest.mark.parametrize("proportional", [False, True])
@pytest.mark.parametrize("course", [70.0, -70.0])
def test_a_boat_without_way_turns_and_keeps_its_heading(course: float, proportional: bool) -> None:
    boat = lying(thruster={"proportional": proportional})
    boat.engage(course)
    worst = 0.0
    for _ in range(300):
        boat.run(0.1)
        worst = max(worst, off(boat, course) * math.copysign(1.0, course))
    assert worst < 5.0, "deg past the course"
    for _ in range(300):
        boat.run(0.1)
        assert abs(off(boat, course)) < 6.0


def test_under_way_the_rudder_steers_and_the_thruster_rests() -> None:
    boat = lying(speed=None)
    boat.engage(30.0)
    boat.run(5.0)
    assert not any(tick.command.thruster for tick in boat.ticks)
    assert any(abs(tick.command.angle) > 0.05 for tick in boat.ticks)


@pytest.mark.parametrize("how", ["standby", "mode", "disengaged by silence", "radio lost"])
def test_it_stops_whoever_falls_silent(how: str) -> None:
    boat = turning(lying())
    patience = 1.0
    if how == "standby":
        boat.order = type(boat.order)(serial=boat.order.serial + 1)
    elif how == "mode":
        assert boat.firmware.set_mode(4)
    else:
        patience = 4.0
        boat.firmware.receiver = how != "radio lost"
        last = boat.clock.time
        while boat.firmware.world.time < last + patience:
            boat.vehicle.advance(boat.firmware.world.time + 0.05)
        assert boat.firmware.servos[BOW_OUTPUT - 1] == REST_US
        return
    boat.run(patience)
    assert boat.firmware.servos[BOW_OUTPUT - 1] == REST_US
    assert not boat.tick.command.thruster


def test_without_a_radio_it_stops_too() -> None:
    boat = turning(lying(vehicle={"receiver": False}))
    last = boat.firmware.world.time
    while boat.firmware.world.time < last + 2.0:
        boat.vehicle.advance(boat.firmware.world.time + 0.05)
    assert boat.firmware.servos[BOW_OUTPUT - 1] == REST_US


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"SERVO_RC_FS_MSK": 0.0}, "SERVO_RC_FS_MSK"),
        ({"RC_OVERRIDE_TIME": 10.0}, "RC_OVERRIDE_TIME"),
        ({"RC_FS_TIMEOUT": 8.0}, "RC_FS_TIMEOUT"),
        ({"FS_THR_ENABLE": 0.0}, "FS_THR_ENABLE"),
        ({"ARMING_RUDDER": 2.0}, "ARMING_RUDDER"),
        ({f"SERVO{BOW_OUTPUT}_FUNCTION": 0.0}, "SERVOn_FUNCTION"),
    ],
)
def test_a_set_up_that_would_not_stop_it_is_refused(parameters: dict[str, float], word: str) -> None:
    boat = lying(parameters=parameters)
    boat.engage(90.0)
    boat.run(4.0)
    assert not any(tick.command.thruster for tick in boat.ticks)
    details = [alarm.detail for alarm in boat.tick.alarms if alarm.name == "bow_thruster_off"]
    assert details
    assert word in details[0]


@pytest.mark.parametrize(("channel", "what"), [(9, "is at 123"), (BOW_OUTPUT, f"servo {BOW_OUTPUT} is at")])
def test_an_output_that_does_not_follow_is_said_and_left_alone_until_engaged_anew(channel: int, what: str) -> None:
    boat = lying()
    put = boat.firmware.overrides.put
    if channel == BOW_OUTPUT:
        boat.firmware.parameters.set(f"SERVO{BOW_OUTPUT}_FUNCTION", 0.0)
    else:
        elsewhere = lambda number, pulse, time: put(number, 1234 if number == 9 else pulse, time)  # noqa: E731
        boat.firmware.overrides.put = elsewhere  # type: ignore[method-assign]
    boat.engage(90.0)
    assert boat.run(5.0, lambda tick: "bow_thruster_not_following" in {alarm.name for alarm in tick.alarms}), (
        boat.tick.alarms
    )
    boat.run(1.0)
    (detail,) = [alarm.detail for alarm in boat.tick.alarms if alarm.name == "bow_thruster_not_following"]
    assert what in detail
    assert not boat.tick.command.thruster
    assert boat.tick.mode is Mode.ENGAGED, "the rudder steers on"
    for tick in boat.ticks:
        assert repr(decode_tick(encode_tick(tick))) == repr(tick)
    boat.firmware.overrides.put = put  # type: ignore[method-assign]
    boat.firmware.parameters.set(f"SERVO{BOW_OUTPUT}_FUNCTION", 148.0)
    boat.order = Order(serial=boat.order.serial + 1)
    boat.run(2.0)
    turning(boat)
    assert "bow_thruster_not_following" not in names(boat)


def test_with_way_nothing_is_said_of_an_output_that_is_not_needed() -> None:
    boat = lying(speed=None)
    boat.hooks.append(lambda boat: boat.firmware.overrides.put(9, 1234, boat.firmware.world.time))
    boat.engage(30.0)
    boat.run(5.0)
    assert "bow_thruster_not_following" not in names(boat)


@pytest.mark.parametrize("receiver", [True, False])
@pytest.mark.parametrize("lost", [0, 20])
def test_leaving_releases_it_and_says_so_when_it_has_let_go(receiver: bool, lost: int) -> None:
    boat = turning(lying(vehicle={"receiver": receiver}))
    held = boat.firmware.overrides.put
    ignored = iter(range(lost))

    def put(channel: int, pulse: int, time: float) -> None:
        """The channel's first releases get lost."""
        if channel != 9 or pulse or next(ignored, None) is None:
            held(channel, pulse, time)

    boat.firmware.overrides.put = put  # type: ignore[method-assign]
    boat.link.release(boat.now)
    found = None
    for _ in range(250):
        boat.clock.time = now = round(boat.clock.time + 0.01, 9)
        boat.carry(now)
        boat.link.receive(now)
        found = boat.link.release_result(now)
        if found is not None:
            break
    assert found is not None
    assert found.state is (ReleaseState.CONFIRMED if receiver else ReleaseState.UNSHOWN), found
    assert not receiver or 9 not in boat.firmware.overrides.active(boat.firmware.world.time, 3.0)
    boat.carry(boat.clock.time + 0.02)
    assert boat.firmware.servos[BOW_OUTPUT - 1] == REST_US


def test_a_hand_on_its_lever_keeps_it() -> None:
    boat = lying()
    boat.firmware.sticks[8] = 1700
    boat.run(2.0)
    boat.engage(90.0)
    boat.run(3.0)
    assert boat.firmware.servos[BOW_OUTPUT - 1] == 1700
    assert "bow_thruster_off" in names(boat)


def test_a_boat_that_drifts_has_no_way() -> None:
    boat = lying(seed=41, wind=WindSection(speed_m_s=3.0, from_deg=90.0))
    boat.run(10.0)
    assert boat.tick.state.speed > 0.1, "over the ground it goes faster than its rudder needs"
    assert boat.tick.command.angle == 0.0, "the rudder waits amidships"


@pytest.mark.parametrize(("seed", "wind_from"), [(42, 45.0), (43, 90.0), (44, 180.0), (45, 300.0)])
def test_in_wind_that_drives_the_boat_away_it_comes_to_its_course_and_stays(seed: int, wind_from: float) -> None:
    wind = WindSection(speed_m_s=2.0, from_deg=wind_from, gust_m_s=0.4)
    boat = lying(seed=seed, wind=wind)
    boat.engage(90.0)
    boat.run(60.0)
    for _ in range(300):
        boat.run(0.1)
        assert abs(off(boat, 90.0)) < 15.0
    assert not {"bow_thruster_weak", "human_override"} & names(boat)


@pytest.mark.parametrize(
    ("seed", "wind", "wind_from", "course"),
    [(8101, 3.0, 67.0, 69.0), (8102, 2.0, 71.0, -18.0), (8108, 2.0, 70.0, 58.0), (8104, 3.0, 339.0, -85.0)],
)
def test_a_slow_boat_that_drifts_keeps_its_healthy_rudder(
    seed: int, wind: float, wind_from: float, course: float
) -> None:
    """At half the trial's speed, set across by as much as it goes ahead."""
    section = WindSection(speed_m_s=wind, from_deg=wind_from, gust_m_s=0.2 * wind)
    boat = lying(seed=seed, speed=0.16, wind=section)
    boat.run(10.0)
    boat.engage(course)
    boat.run(60.0)
    said = {alarm.name for tick in boat.ticks for alarm in tick.alarms}
    assert not {"rudder_stuck", "rudder_reversed", "rudder_not_following", "trial_doubtful"} & said
    assert boat.tick.mode is Mode.ENGAGED


def test_what_the_boat_does_while_its_thruster_turns_it_is_no_evidence() -> None:
    """With way that the rudder steers by, and a course far off: the thruster helps."""
    boat = lying(speed=0.18, wind=WindSection(speed_m_s=3.0, from_deg=90.0))
    boat.engage(120.0)
    helped = 0
    for _ in range(600):
        boat.run(0.1)
        if boat.tick.command.thruster and not boat.pilot.state.way.waits:
            helped += 1
            assert math.isnan(boat.pilot.state.monitors.rudder.response.evidence.since)
    assert helped > 20


def test_a_dead_thruster_is_found_and_rests() -> None:
    boat = lying(faults=(FaultSection("bow_thruster_dead", 0.0),))
    boat.engage(90.0)
    boat.run(15.0)
    assert "bow_thruster_weak" in names(boat)
    assert boat.firmware.servos[BOW_OUTPUT - 1] == REST_US


def test_it_rests_when_it_has_run_for_as_long_as_it_may() -> None:
    boat = lying(thruster={"run_s": 3.0, "rest_s": 1000.0})
    boat.engage(150.0)
    boat.run(30.0)
    ran = 0.05 * sum(1 for tick in boat.ticks if tick.command.thruster)
    assert ran < 3.5
    assert "bow_thruster_hot" in names(boat)


def test_its_orders_survive_the_log() -> None:
    boat = turning(lying())
    ran = [tick for tick in boat.ticks if tick.command.thruster]
    heard = [tick for tick in boat.ticks if any(isinstance(sample, ThrusterSample) for sample in tick.samples)]
    assert ran
    assert heard
    for tick in (*ran, *heard):
        assert repr(decode_tick(encode_tick(tick))) == repr(tick)
