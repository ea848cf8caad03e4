"""The wind hold on the whole pilot and a boat that sails by an apparent wind: held, shifted, lost, refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from alarm_texts import words_of
from boat_at_sea import SPEED, Sea

from autopilot.angles import shortest_turn, wrap
from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.links.alarm_outputs import GuideAlarms
from autopilot.signals import HelmSample, Mode, Sample, WindSample


class Vane:
    """A wind vane on the boat, twice a second with 3 deg of noise, and the guide's word to the pilot."""

    def __init__(self, sea: Sea) -> None:
        self._sea, self._random = sea, np.random.default_rng(1)
        self._alarms = GuideAlarms(sea.skipper.wind, "wind")
        self._next = 0.0
        self.is_acknowledged = True
        self.wind_from = math.radians(60.0)

    def receive(self, now: float) -> list[Sample]:
        said = self._alarms.receive(now)
        if not self.is_acknowledged or now < self._next:
            return said
        self._next = now + 0.5
        noise = math.radians(3.0) * self._random.standard_normal()
        return [*said, WindSample(now, wrap(self.angle() + noise), 8.0)]

    def angle(self) -> float:
        """The apparent wind's true angle [rad] off the bow: 8 m/s of wind and the boat's own way."""
        heading = self._sea.box.heading
        north = 8.0 * math.cos(self.wind_from) + SPEED * math.cos(heading)
        east = 8.0 * math.sin(self.wind_from) + SPEED * math.sin(heading)
        return wrap(math.atan2(east, north) - heading)


@pytest.fixture
def sea() -> Sea:
    sea = Sea()
    sea.alarms = Vane(sea)
    return sea


def test_the_angle_is_held_through_a_shift_and_nothing_jumps(sea: Sea) -> None:
    sea.sail(10.0)
    before, heading = sea.alarms.angle(), sea.box.heading
    assert sea.skipper.type_line("w") == "holding the wind's angle"
    assert sea.sail(30.0).mode is Mode.ENGAGED
    assert abs(math.degrees(shortest_turn(heading, sea.box.heading))) < 3.0
    for _ in range(40):
        sea.alarms.wind_from += math.radians(0.5)
        sea.sail(1.0)
    tick = sea.sail(30.0)
    assert math.degrees(sea.alarms.angle()) == pytest.approx(math.degrees(before), abs=3.0)
    assert math.degrees(sea.box.heading) == pytest.approx(math.degrees(heading) + 20.0, abs=5.0)
    assert words_of(tick) == ()
    assert tick.order.serial == 1, "following the wind is no new action"
    steps = [abs(b.command.angle - a.command.angle) for a, b in itertools.pairwise(sea.ticks)]
    assert max(steps) <= math.radians(20.0) * 0.05 + 1.0e-9


def test_a_wind_that_is_lost_leaves_the_heading_and_is_reported(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    ordered = sea.sail(20.0).order.heading
    sea.alarms.is_acknowledged = False
    tick = sea.sail(10.0)
    assert tick.mode is Mode.ENGAGED
    assert any("wind lost" in alarm for alarm in words_of(tick))
    sea.alarms.is_acknowledged, sea.alarms.wind_from = True, math.radians(100.0)
    held = sea.sail(20.0).order.heading
    assert held == sea.sail(5.0).order.heading
    assert abs(math.degrees(shortest_turn(ordered, held))) < 3.0
    sea.skipper.type_line("w")
    tick = sea.sail(1.0)
    assert not words_of(tick)
    assert abs(math.degrees(shortest_turn(sea.box.heading, tick.order.heading))) < 3.0


@pytest.mark.parametrize("line", ["e 10", "+10", "s", "e"])
def test_any_other_order_ends_the_hold(sea: Sea, line: str) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    sea.sail(5.0)
    sea.skipper.type_line(line)
    order = sea.sail(1.0).order
    sea.alarms.wind_from += 1.0
    assert not sea.skipper.wind.following
    assert sea.sail(20.0).order == order


def test_who_takes_the_helm_keeps_it(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    sea.sail(5.0)
    assert sea.sail(2.0, helm=HelmSample(0.0, False, "stick moved", "rc")).mode is Mode.OVERRIDE
    assert not sea.skipper.wind.following


def test_without_a_wind_it_is_refused_and_the_order_stays(sea: Sea) -> None:
    sea.alarms.is_acknowledged = False
    sea.skipper.type_line("e 10")
    order = sea.sail(10.0).order
    with pytest.raises(InputError, match="no wind"):
        sea.skipper.type_line("w")
    assert sea.sail(1.0).order == order


def test_ordered_from_the_start_it_waits_for_the_wind_and_says_so(sea: Sea) -> None:
    sea.alarms.is_acknowledged = False
    sea.skipper.await_wind()
    tick = sea.sail(10.0)
    assert tick.mode is Mode.STANDBY
    assert any("no wind is heard" in alarm for alarm in words_of(tick))
    sea.alarms.is_acknowledged = True
    tick = sea.sail(2.0)
    assert tick.mode is Mode.ENGAGED
    assert words_of(tick) == ()
    assert sea.skipper.wind.following


def test_another_order_ends_the_waiting(sea: Sea) -> None:
    sea.alarms.is_acknowledged = False
    sea.skipper.await_wind()
    sea.sail(1.0)
    sea.skipper.type_line("s")
    sea.alarms.is_acknowledged = True
    tick = sea.sail(5.0)
    assert (tick.mode, words_of(tick)) == (Mode.STANDBY, ())


def test_a_boat_without_an_nmea_link_is_refused_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "lanxin", "--link", "udpin:127.0.0.1:0", "--engage", "wind"]) == 4
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "wind vane" in lines[0]
