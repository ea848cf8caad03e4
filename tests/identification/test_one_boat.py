"""Logs that are not of one boat, a compass that turns otherwise than the gyro, a rudder that stops short of its record,
and a pilot that answers waves, are said to be so.

The boats are those of `benchmarks/independent_boat.py`, which imports nothing of the project.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from independent_boat import Boat, Sea, sailed

from autopilot.identification.compass_and_gyro import on_one_course, turned_apart
from autopilot.identification.identify import identify
from autopilot.identification.interval import interval_of
from autopilot.identification.marginal_likelihood import Rates
from autopilot.identification.one_boat import Differing
from autopilot.identification.residual_tests import ResidualTest
from autopilot.identification.runs import Run, run_from_columns
from autopilot.identification.verdict import verdict_of, verdict_on_runs

BOAT = Boat(0.43 / 3.5, 1.0 / 3.5, 6.0 / 3.5, 0.0015)
LOADED = BOAT._replace(a=BOAT.a / 1.65)
GUSTS = Sea("gusts", gust_deg=1.0, gyro_deg_s=0.1)


def sailed_by(first: Boat, second: Boat, later: Boat | None = None, seed: int = 1) -> list[Run]:
    pair = ((first, 1.0, "one.csv"), (second, -1.0, "two.csv"))
    return [
        run_from_columns(name, sailed(boat, GUSTS, [seed, k], 50.0, side=side, later=later))
        for k, (boat, side, name) in enumerate(pair)
    ]


@pytest.mark.parametrize(
    ("runs", "named"),
    [
        (sailed_by(BOAT, LOADED), ("one.csv and two.csv do not tell",)),
        (sailed_by(BOAT, BOAT, LOADED), ("the first half of each run and the second half do not tell",)),
    ],
    ids=["a log each", "in one log"],
)
def test_two_boats_are_never_called_good(runs: list[Run], named: tuple[str, ...]) -> None:
    found = identify(runs)
    grade, sentence = verdict_on_runs(found, runs, math.inf)
    assert grade == "not enough" and found.differing is not None
    assert all(name in sentence for name in named)
    # by each alone K is that of a boat that was there
    gains = [a / b for a, b, *_ in found.differing.rates]
    assert gains == pytest.approx([0.43, 0.43 / 1.65], rel=0.15)
    error = found.standard_errors["gain"] or 0.0
    assert all(abs(found.model.gain - gain) < 1.96 * error for gain in gains)


def test_one_boat_in_two_logs_is_good() -> None:
    runs = sailed_by(BOAT, BOAT)
    found = identify(runs)
    assert found.differing is None and verdict_on_runs(found, runs, math.inf).grade == "good"
    answering = verdict_on_runs(found._replace(answers=0.7), runs, math.inf)
    assert answering.grade == "start" and "70 % of the rudder's motion goes with" in answering.sentence
    assert verdict_of(found._replace(answers=0.7)).grade == "not enough", (
        "nothing says that rudder and speed explain it"
    )
    whole = np.array(found.likely.rates if found.likely else ())
    for apart, grade in ((1.12, "good"), (1.25, "start"), (1.4, "not enough")):
        differ = Differing("one.csv", "two.csv", (whole, whole * (apart, 1.0, 1.0, 1.0)), whole, (0.0, 0.0), 1.0e-6)
        answer = verdict_on_runs(found._replace(differing=differ), runs, math.inf)
        assert answer.grade == grade
        is_named = (
            "one.csv and two.csv do not tell of one boat: K " in answer.sentence and " s by each" in answer.sentence
        )
        assert is_named == (grade != "good")


def test_parts_that_are_alike_name_the_model_of_both() -> None:
    alone, whole = np.array([0.032, 0.19, 5.0, 0.0]), np.array([0.03, 0.05, 5.0, 0.0])
    sentence = Differing("one.csv", "two.csv", (alone, 0.98 * alone), whole, (0.0, 0.0), 1.0e-6).sentence()
    assert "K 0.168 and 0.168 1/s, T 5.26 and 5.37 s by each alone, but K 0.6 1/s, T 20 s by both together" in sentence
    unlike = Differing("one.csv", "two.csv", (alone, alone * (1.4, 1.0, 1.0, 1.0)), whole, (0.0, 0.0), 1.0e-6)
    assert "by both together" not in unlike.sentence()


def test_two_boats_a_quarter_apart_are_never_called_good() -> None:
    runs = sailed_by(BOAT, BOAT._replace(a=BOAT.a / 1.25))
    grade, sentence = verdict_on_runs(identify(runs), runs, math.inf)
    assert grade == "start" and "one.csv and two.csv do not tell of one boat: K 0." in sentence


def test_parts_that_differ_by_little_are_one_boat() -> None:
    unstable, sea = Boat(0.2, -0.5, 10.0, 0.003), GUSTS._replace(gyro_deg_s=None)
    tables = [sailed(unstable, sea, [64089188, k], 60.0, side=1 - 2 * k) for k in (0, 1)]
    assert identify([run_from_columns(f"{k}.csv", table) for k, table in enumerate(tables)]).differing is None


@pytest.mark.parametrize(
    ("deviates", "scale", "share"), [(0.0, 1.0, 0.0), (8.0, 1.0, 0.14), (0.0, 1.15, 1.0 / 1.15 - 1.0)]
)
def test_compass_and_gyro_that_turn_otherwise_are_named(deviates: float, scale: float, share: float) -> None:
    table = sailed(BOAT, GUSTS, 3, 60.0)
    table["heading_rad"] += math.radians(deviates) * np.sin(table["heading_rad"])
    table["yaw_rate_rad_s"] *= scale
    apart = turned_apart([run_from_columns("zigzag.csv", table)])
    if not share:
        assert apart is None
        return
    assert apart is not None and apart.share == pytest.approx(share, abs=0.02)
    assert "zigzag.csv" in apart.sentence() and f"turns {10.0 * (1.0 + apart.share):.1f}" in apart.sentence()
    # the intervals of K/T and K reach to what either says, whichever the fit went by
    for name, error in (("K/T", math.sqrt(apart.doubt(Rates(0.2, 0.3))[0, 0])), ("gain", 0.2 * apart.doubt_of_gain)):
        low, high = interval_of(name, 0.2, 1.000001 * error)
        for other in (0.2 * (1.0 + apart.share), 0.2 / (1.0 + apart.share)):
            assert low <= other <= high
        assert low > 0.7 * 0.2 and high < 1.3 * 0.2


@pytest.mark.parametrize(("second", "gyro", "is_said"), [(0.0, None, True), (math.pi, None, False), (0.0, 0.1, False)])
def test_what_a_compass_alone_does_not_show_on_one_course_is_said(
    second: float, gyro: float | None, is_said: bool
) -> None:
    sea = GUSTS._replace(gyro_deg_s=gyro)
    tables = [sailed(BOAT, sea, 3, 20.0, heading=course) for course in (0.0, second)]
    runs = [run_from_columns(str(k), table) for k, table in enumerate(tables)]
    assert bool(on_one_course(runs)) == is_said
    if is_said:
        grade, sentence = verdict_on_runs(identify(runs), runs, math.inf)
        assert grade != "good" or "neither a gyro nor another course checks it" in sentence


@pytest.mark.parametrize(("stop_deg", "seed"), [(12.0, 5), (16.0, 6)])
def test_a_rudder_that_stops_short_of_its_record_is_named_and_no_play(stop_deg: float, seed: int) -> None:
    stop = math.radians(stop_deg)
    runs = [
        run_from_columns(f"{k}.csv", sailed(BOAT, GUSTS, [seed, k], 40.0, side=1 - 2 * k, stop=stop)) for k in (0, 1)
    ]
    found = identify(runs)
    grade, sentence = verdict_on_runs(found, runs, math.inf)
    assert grade == "start" and "rudder stopped at some 1" in sentence
    assert found.likely is not None and math.degrees(found.likely.unseen.stop) == pytest.approx(stop_deg, abs=2.1)
    assert found.train.dead_band == 0.0


def test_a_pilot_that_answers_waves_is_not_taken_for_play() -> None:
    waves = GUSTS._replace(gust_deg=0.5, wave_deg=3.0, wave_period_s=5.0)
    quick = Boat(0.25 / 2.0, 1.0 / 2.0, 3.0 / 2.0, 0.001)

    def helm(time: float, heading: float, rate: float) -> float:
        return float(np.clip(2.0 * (0.35 * (int(time / 40.0) % 2) - heading) - 2.0 * rate, -0.5, 0.5))

    runs = [run_from_columns(f"{k}.csv", sailed(quick, waves, [11, k], 150.0, helm=helm)) for k in (0, 1)]
    found = identify(runs)
    assert found.train.dead_band == 0.0
    assert any("so would a pilot or a hand that answered waves" in note for note in found.notes)
    for name, truth in (("gain", 0.25), ("time_constant", 2.0)):
        assert abs(getattr(found.model, name) - truth) < 1.96 * (found.standard_errors[name] or 0.0)


@pytest.mark.parametrize(("size", "is_said"), [(0.2, True), (0.05, False)])
def test_what_goes_with_the_rudder_is_said_where_it_matters(size: float, is_said: bool) -> None:
    test = ResidualTest("heading", 0.0, 0.9, 3.0, 0.5, 1.0, 0.1, size)
    assert test.follows_rudder == is_said
