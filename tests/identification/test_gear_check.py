"""The steering gear of the vessel file beside what a sensor, or the boat's turning, shows of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from boat_recordings import zigzag_boat
from zigzag_trials import rudder_with_play

from autopilot.identification.ordered_rudder import rate_limited, slower_rudder
from autopilot.identification.rudder_path import RudderRate, measured_rate
from autopilot.identification.runs import Orders, Run, Segment
from autopilot.identification.verdict import (
    AS_SHOWN,
    UNKNOWN_RATE,
    GearCheck,
    angles_against,
    backlash_of,
    gear_check,
    rests_of,
    unchecked,
)

FILED = math.radians(20.0)


def dockside(scale: float = 1.0, stop_deg: float = 90.0, rate_deg_s: float = 20.0, zero_deg: float = 0.0) -> Orders:
    """Return the dockside trial, 10 deg and 30 deg to both sides, and what a sensor with noise shows of the rudder."""
    time = np.arange(0.0, 32.0, 0.05)
    order = np.radians(np.select([time < 8.0, time < 16.0, time < 24.0], [10.0, -10.0, 30.0], -30.0))
    goal = np.clip(scale * order, -math.radians(stop_deg), math.radians(stop_deg))
    angle = rate_limited(time, np.concatenate([[0.0], goal[1:]]), math.radians(rate_deg_s))
    noise = math.radians(0.2) * np.random.default_rng(2026112701).standard_normal(time.size)
    return Orders(time, rate_limited(time, order, FILED), time, angle + noise + math.radians(zero_deg))


def zigzag(rate_deg_s: float, noise_deg: float = 0.1) -> Run:
    """Return a zigzag whose rudder no sensor shows: its record is its orders at the filed rate."""
    boat, random = zigzag_boat(seconds=120.0, rudder_rate=math.radians(rate_deg_s)), np.random.default_rng(2026112702)
    noise = math.radians(noise_deg) * random.standard_normal((2, boat.time.size))
    columns = (boat.time, boat.heading + noise[0], boat.rate + noise[1], rate_limited(boat.time, boat.order, FILED))
    segment = Segment(*(each[::5] for each in (*columns, boat.speed)))
    return Run("zigzag", (segment,), rudder="estimated")


@pytest.mark.parametrize("zero_deg", [0.0, 2.0])
def test_a_rudder_that_does_as_ordered_contradicts_nothing(zero_deg: float) -> None:
    rests = rests_of(dockside(zero_deg=zero_deg))
    assert len(rests) == 4 and angles_against(rests) == []
    assert angles_against(rests_of(dockside(scale=0.93))) == []


@pytest.mark.parametrize("scale", [35.0 / 20.0, 20.0 / 35.0])
def test_a_wrong_end_stop_typed_is_a_wrong_scale_of_the_servo(scale: float) -> None:
    (clause,) = angles_against(rests_of(dockside(scale)))
    shown = float(clause.partition("shows ")[2].partition(" ")[0])
    assert shown == pytest.approx(scale, rel=0.05) and "helm.rudder_at_full_pwm_deg" in clause


def test_an_end_stop_before_the_typed_one_is_found() -> None:
    (clause,) = angles_against(rests_of(dockside(stop_deg=20.0)))
    assert "stops at 20 deg where 30 were ordered" in clause and "rudder.angle_max_deg" in clause


def test_orders_that_never_rest_or_a_rudder_on_its_way_show_no_angle() -> None:
    assert rests_of(dockside(rate_deg_s=0.7)) == []
    assert angles_against([]) == []


def test_a_measured_rudder_slower_than_typed_is_said_where_more_was_ordered() -> None:
    for slow, is_said in ((10.0, True), (19.0, False), (40.0, False)):
        seen = dockside(rate_deg_s=slow)
        run = zigzag(slow)._replace(rudder="measured", orders=seen)
        found = gear_check([run], FILED, measured_rate([(seen.time, seen.angle)]))
        assert any("rudder.rate_max_deg_s" in clause for clause in found.against) == is_said
    # the orders never asked for more
    calm = seen._replace(order_time=10.0 * seen.order_time)
    assert not gear_check([run._replace(orders=calm)], FILED, RudderRate(math.radians(10.0), 0.001, 9)).against


@pytest.mark.parametrize("play_deg", [0.0, 0.5, 2.0])
def test_play_and_zero_of_a_measured_rudder_are_measured(play_deg: float) -> None:
    found = backlash_of([rudder_with_play(play_deg, zero_deg=1.0)])
    assert found is not None
    assert math.degrees(found.play) == pytest.approx(play_deg, abs=0.2)
    assert abs(found.play - math.radians(play_deg)) < 3.0 * found.play_error
    assert math.degrees(found.zero) == pytest.approx(1.0, abs=0.1)


def test_one_rudder_angle_does_not_tell_play_from_scale() -> None:
    assert backlash_of([rudder_with_play(2.0, (20.0,))]) is None
    assert backlash_of([dockside()]) is None


def test_without_a_sensor_the_boat_turns_as_with_a_rudder_of_the_typed_rate_or_another() -> None:
    alike, slow = zigzag(20.0), zigzag(5.0)
    unsure = slower_rudder([alike], FILED)
    assert unsure is None or not unsure.is_sure
    found = gear_check([alike], FILED, None)
    assert not found.against and "typed rate" in found.beside and "angles are as typed" in found.beside
    rate = slower_rudder([slow], FILED)
    found = gear_check([slow], FILED, rate)
    assert rate is not None and not found.against and "in place of 20" in found.beside
    assert "K counts degrees as they are ordered" in found.note


def test_where_half_the_rate_would_not_have_shown_nothing_is_called_checked() -> None:
    found = gear_check([zigzag(20.0, noise_deg=30.0)], FILED, None)
    assert found.against == (UNKNOWN_RATE,)


def test_a_recording_whose_rudder_is_measured_without_orders_has_nothing_to_compare() -> None:
    run = zigzag(20.0)._replace(rudder="measured")
    found = gear_check([run], FILED, None)
    assert found == GearCheck(beside=unchecked([run]), note=AS_SHOWN)


def test_what_nothing_in_the_log_checks_is_named() -> None:
    run = zigzag(20.0)
    bare = run._replace(segments=tuple(s._replace(rate=np.full(s.time.size, math.nan)) for s in run.segments))
    with_gyro = run._replace(segments=tuple(s._replace(rate=np.zeros(s.time.size)) for s in run.segments))
    assert "fouled log" in unchecked([bare]) and "end stop" in unchecked([bare]) and "compass" in unchecked([bare])
    assert "fouled log" in unchecked([with_gyro])
    assert "end stop" not in unchecked([with_gyro]) and "compass" not in unchecked([with_gyro])
