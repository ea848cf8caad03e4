"""What is forecast of a boat that steers by thrust, against one that shares nothing with the model.

It is turned by a moment that does not go with its speed, is slowed by a drag that goes with r|r|, and slides:

    r' = A m - B r - C r|r| + D v,   v' = -(v + S r)/tau
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from memory import measured
from slopes import check_slope
from thrust_intervals import off_by

from autopilot.cli.identify_drive_roll import identified_by_thrust
from autopilot.cli.main import build_parser, main
from autopilot.errors import InputError
from autopilot.identification import drive_effect
from autopilot.identification.drive_effect import (
    DriveFit,
    Prediction,
    at_one_throttle,
    fit_drive,
    likely_drive,
    predict_drive,
)
from autopilot.identification.likelihood_fit import LikelihoodFit, memory_of, scales
from autopilot.identification.likelihood_record import Form, Surroundings, beside_of, record_of
from autopilot.identification.likelihood_search import Space
from autopilot.identification.marginal_likelihood import Rates, Weather
from autopilot.identification.prediction_bands import boats_of, forecast, widened
from autopilot.identification.rudder_path import DIRECT
from autopilot.identification.runs import FloatArray, Run, run_from_columns
from autopilot.identification.verdict import verdict_by_thrust
from autopilot.models.drives import DRIVES, DriveLaw
from autopilot.models.steering_gear import SteeringGear
from autopilot.vessel.file import dump_vessel, load_vessel

A, B, C, D, S, TAU = 2.6, 1.2, 6.0, 0.8, 1.0, 0.8
STEP, EVERY, LAG = 0.01, 5, 0.15
TWO = DRIVES["two_thrusters"]
MOTION = ("heading_rad", "yaw_rate_rad_s")
GEAR = SteeringGear(math.inf, math.inf, LAG)


class Sailed(NamedTuple):
    columns: dict[str, FloatArray]
    overshoots: list[float]


def sailed(
    angle_deg: float, side: int, lasts: float, seed: int | None, times: float = 1.0, by_angle: float = 0.0
) -> Sailed:
    """Sail a zigzag at a thrust of so many times the usual one, which steers with the power 1 + `by_angle` of its
    angle and at 22 deg as usual; the overshoots of the true heading [rad]."""
    random = np.random.default_rng(seed)
    angle, order = math.radians(angle_deg), math.radians(angle_deg) * side
    heading = rate = sway = rudder = 0.0
    rows, beyond = [], list[float]()
    called = 0.0
    for k in range(round(lasts / STEP)):
        if heading * math.copysign(1.0, order) >= angle:
            order, called = -order, abs(heading)
            beyond.append(0.0)
        if beyond:
            beyond[-1] = max(beyond[-1], -math.copysign(1.0, order) * heading - called)
        if k % EVERY == 0:
            noise = np.radians([0.3, 0.2]) * random.standard_normal(2) * (seed is not None)
            # the faster it turns, the faster it goes: what turns it does not go with that
            speed = 1.0 + 1.5 * abs(rate)
            rows.append((k * STEP, rudder, speed, heading + noise[0], rate + noise[1]))
        rudder += STEP / LAG * (order - rudder)
        sway -= STEP / TAU * (sway + S * rate)
        steers = rudder * max(abs(rudder) / math.radians(22.0), 0.01) ** by_angle
        rate += STEP * (times * A * steers - B * rate - C * rate * abs(rate) + D * sway)
        heading += STEP * rate
    names = ("time_s", "rudder_rad", "speed_m_s", "heading_rad", "yaw_rate_rad_s")
    return Sailed(dict(zip(names, np.array(rows).T, strict=True)), beyond)


def runs_of(angle_deg: float = 22.0) -> list[Run]:
    return [run_from_columns(f"{side:+d}", sailed(angle_deg, side, 50.0, 3 + side).columns) for side in (1, -1)]


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return runs_of()


@pytest.fixture(scope="module")
def fit(runs: list[Run]) -> DriveFit:
    return fit_drive(runs, TWO.usual, TWO.needs)


@pytest.fixture(scope="module")
def likely(runs: list[Run], fit: DriveFit) -> LikelihoodFit:
    found = likely_drive(runs, fit)
    assert found is not None
    return found


def test_a_zigzag_with_half_the_angle_is_forecast(runs: list[Run], fit: DriveFit, likely: LikelihoodFit) -> None:
    expected = forecast(likely, runs, fit.model.reference_speed, GEAR).overshoots[10.0]
    for band, true in zip(expected, sailed(10.0, 1, 20.0, None).overshoots, strict=False):
        # no skipper sees less
        assert abs(band.middle - true) < math.radians(0.5)
        assert band.high - band.low < math.radians(1.5)


@pytest.mark.parametrize("by_angle", [0.0, -0.08])
def test_overshoots_in_a_calm_are_held_where_thrust_does_not_go_by_the_model(by_angle: float) -> None:
    """Neither speed nor angle do what the model has them do, and runs with one angle do not tell."""
    runs = [run_from_columns(f"{side}", sailed(22.0, side, 50.0, 3 + side, 1.0, by_angle).columns) for side in (1, -1)]
    fit = fit_drive(runs, TWO.usual, TWO.needs)
    likely = likely_drive(runs, fit)
    assert likely is not None
    expected = forecast(likely, runs, fit.model.reference_speed, GEAR).overshoots
    for angle, bands in expected.items():
        for band, true in zip(bands, sailed(angle, 1, 20.0, None, 1.0, by_angle).overshoots, strict=False):
            assert band.low < true < band.high
            # and the bands say something
            assert band.high - band.low < math.radians(1.5)


def test_the_lag_of_what_steers_is_in_the_overshoot(runs: list[Run], fit: DriveFit, likely: LikelihoodFit) -> None:
    at_once = forecast(likely, runs, fit.model.reference_speed, GEAR._replace(lag=0.0)).overshoots[10.0]
    true = sailed(10.0, 1, 20.0, None).overshoots[0]
    assert at_once[0].middle < true - math.radians(0.5)


def test_a_boat_that_slides_remembers_its_rudder_where_a_stretch_begins(
    runs: list[Run], fit: DriveFit, likely: LikelihoodFit
) -> None:
    assert likely.train.lead > likely.train.lag > 0.0
    # its own runs, in calm water, are predicted as well as it says
    assert widened(likely, runs, fit.model.reference_speed).weather.gust < 3.0 * likely.weather.gust


def test_lag_and_lead_are_drawn_as_they_go_together(likely: LikelihoodFit) -> None:
    assert likely.joint is not None
    # with the law's power of the speed: others have a lag of their own
    boats = boats_of(likely._replace(power=None), np.ones(1), np.random.default_rng(1), draws=4000)
    drawn = np.cov([boats.a, boats.b, np.log(boats.lag), np.log(boats.lead)])
    size = np.sqrt(np.diag(drawn))
    expected = likely.joint[np.ix_([0, 1, 4, 5], [0, 1, 4, 5])]
    assert drawn / np.outer(size, size) == pytest.approx(expected / np.outer(size, size), abs=0.15)


def test_runs_at_other_throttles_are_made_one_throttles() -> None:
    law = DriveLaw(0.0, 2.0, 0.0, throttle=0.5)
    columns = sailed(20.0, 1, 20.0, 1, times=4.0).columns
    (one,) = at_one_throttle([run_from_columns("full", columns)._replace(throttle=1.0)], law)
    assert one.segments[0].rudder == pytest.approx(4.0 * columns["rudder_rad"])


def test_a_boat_that_does_not_follow_is_not_forecast(runs: list[Run], fit: DriveFit) -> None:
    assert likely_drive(runs, fit._replace(model=fit.model._replace(gain=0.0))) is None


@pytest.mark.parametrize(
    ("gain", "r2", "spread", "lasted", "grade"),
    [
        (0.05, 0.95, True, 11.0, "good"),
        (0.05, 0.95, False, 11.0, "start"),
        (0.05, 0.8, True, 11.0, "start"),
        (0.2, 0.95, True, 11.0, "start"),
        (0.4, 0.95, True, 11.0, "not enough"),
        (0.05, 0.2, True, 11.0, "not enough"),
        (math.nan, 0.95, True, 11.0, "not enough"),
        (0.05, 0.95, True, 9.0, "not enough"),
    ],
)
def test_what_is_little_known_is_not_called_good(
    fit: DriveFit, gain: float, r2: float, spread: bool, lasted: float, grade: str
) -> None:
    """lasted: in time constants."""
    errors = {"gain": gain * fit.model.gain, "time_constant": 0.0} | ({"exponent": 0.1} if spread else {})
    predictions = [Prediction(0.99, 0.0), Prediction(r2, 0.0)]
    verdict = verdict_by_thrust(fit._replace(errors=errors), predictions, lasted * fit.model.time_constant)
    assert verdict.grade == grade and verdict.sentence.endswith(".")


@pytest.mark.parametrize("gust_deg", [0.0, 1.0])
def test_intervals_are_as_wide_as_the_errors(gust_deg: float) -> None:
    """Within a factor of three too wide, and of two too narrow, in a calm and in gusts."""
    found = [off_by(seed, gust_deg) for seed in range(5)]
    for name in ("K", "T", "K/T", "n1/T"):
        size = math.sqrt(float(np.mean([each[name][0] ** 2 for each in found])))
        assert 1.0 / 3.0 < size < 2.0, name
    # a helm that answers gusts makes no boat of them: T and n3/T as a skipper wants them after three minutes
    off = {name: math.sqrt(float(np.mean([each[name][1] ** 2 for each in found]))) for name in ("T", "n3/T")}
    assert off["T"] < 3.0 and off["n3/T"] < 10.0


def test_the_slope_of_the_loss_by_powers_of_speed_and_throttle_is_that_of_its_differences() -> None:
    """And by the share of the damping that goes with the speed, at two throttles."""
    segments = [part for run in runs_of() for part in run.segments]
    guess, law = Rates(2.4, 1.1, 5.0, 0.01), DriveLaw(0.3, 1.5, 0.4, slowest=0.05, fastest=math.inf)
    record = record_of(segments, 1.2, memory_of(guess, segments))
    scale = scales(segments, guess)
    names = ("speed_exponent", "throttle_exponent", "damping_share")
    beside = beside_of(record, segments, Surroundings(names, law, TWO.usual, (0.6, 1.3)), 1.2, scale.e, Form(law))
    space = Space(record, guess, Weather(0.05, 6.0, 0.01, 3.0e-3, 5.0e-3), DIRECT, (), scale, beside, np.array([0, 1]))
    assert space.beside_at(space.start).opened(dict(zip(space.names, space.start, strict=True))) == law
    _, _, known = space.slope(space.start)
    assert np.linalg.eigvalsh(known).min() > 0.0
    check_slope(space)


def test_errors_of_many_short_runs_beside_a_long_one_take_no_more_memory_than_their_samples() -> None:
    known = np.zeros((4000, 40), dtype=bool)
    known[:, 0], known[:20] = True, True
    random = np.random.default_rng(5)
    jacobian, left = (random.normal(size=(np.count_nonzero(known), *shape)) for shape in ((46,), ()))
    drive_effect._covariance(known[:10], jacobian[:400], left[:400])
    covariance, taken = measured(lambda: drive_effect._covariance(known, jacobian, left))
    assert taken.peak < 8 * jacobian.nbytes
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance) / np.diag(inverse)), 1.0, atol=0.2)


@pytest.mark.parametrize(
    ("damaged", "words"),
    [
        ({"rudder_rad": lambda columns: np.full_like(columns["rudder_rad"], 0.1)}, "the rudder never moves"),
        ({"speed_m_s": lambda columns: np.zeros_like(columns["speed_m_s"])}, "the boat makes no way"),
        ({"rudder_rad": lambda columns: -columns["rudder_rad"]}, "pass --reverse-rudder"),
        ({name: lambda columns: np.zeros_like(columns["time_s"]) for name in MOTION}, "does not follow the rudder"),
        (
            {
                name: lambda columns: np.random.default_rng(7).normal(0.0, 0.004, columns["time_s"].size)
                for name in MOTION
            },
            "does not follow the rudder",
        ),
    ],
    ids=["constant thrust", "no way", "other side", "still", "straight"],
)
def test_runs_that_tell_nothing_end_in_a_sentence(
    damaged: dict[str, Callable[[dict[str, FloatArray]], FloatArray]], words: str
) -> None:
    columns = sailed(22.0, 1, 12.0, 4).columns
    run = run_from_columns("run", {**columns, **{name: change(columns) for name, change in damaged.items()}})
    with pytest.raises(InputError, match=words):
        fit_drive([run], TWO.usual, TWO.needs)


def test_a_run_that_stands_still_has_no_share_to_predict_and_no_say(fit: DriveFit) -> None:
    columns = sailed(22.0, 1, 12.0, 4).columns
    still = run_from_columns("run", {**columns, **{name: np.zeros_like(columns["time_s"]) for name in MOTION}})
    with np.errstate(all="raise"):
        found = predict_drive(still, fit)
    assert found.r2 is None and found.rms > 0.0
    assert verdict_by_thrust(fit, [Prediction(0.99, 0.01), found], 100.0).grade != "not enough"


def test_a_boat_that_runs_away_ends_at_a_rate_and_not_in_what_is_no_number() -> None:
    columns = sailed(22.0, 1, 5.0, 4).columns
    stack = drive_effect._stacked([run_from_columns("run", columns)], 1.0, math.nan)
    runaway = np.array([2.0, 0.0, 1.0, 0.0, 1.0e9, 1.0])
    with np.errstate(all="raise"):
        rates = drive_effect._simulated(stack, runaway, stack.rate[0], by_throttle=False)
    assert np.all(np.abs(rates) <= drive_effect.RATE_MOST)


@pytest.mark.parametrize(("error", "share"), [(0.05, 1.0), (0.01, 1.05)])
def test_no_more_than_all_of_the_damping_goes_with_the_speed_by_chance(error: float, share: float) -> None:
    values, free = np.array([1.6, 2.0, 0.8, 1.05 * 0.8, 1.5, 0.0]), list(range(6))
    spread = np.diag(np.square([0.01, 0.01, 1.0e-6, error * 0.8, 0.01, 0.001]))
    asked = drive_effect._Asked(TWO.usual, TWO.needs, 1.2, 0.5, True, (0.7, 1.2, 2.2), (0.3, 0.5, 0.9))
    found = drive_effect._drive_fit(values, free, spread, asked)
    assert found.law.damping_share == pytest.approx(share)
    assert found.errors["damping_share"] == pytest.approx(error, rel=0.01)


def saved(tmp_path: Path, lasts: float) -> list[str]:
    paths = []
    for side in (1, -1):
        columns = sailed(22.0, side, lasts, 3 + side).columns
        paths.append(tmp_path / f"zigzag{side}.csv")
        with paths[-1].open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(columns)
            rows.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    return [str(path) for path in paths]


def test_a_fit_whose_file_cannot_be_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> str:
        raise InputError("no command could read it")

    monkeypatch.setattr("autopilot.vessel.file.text_for", refuse)
    asked = ["identify", *saved(tmp_path, 12.0), "--vessel", "twin_thruster", "--out", str(tmp_path / "boat.yaml")]
    assert main(asked) == 2
    shown = capsys.readouterr()
    assert "Prediction of the yaw rate" in shown.out and "no command could read it" in shown.err
    assert "Wrote" not in shown.out


def test_identify_says_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs = saved(tmp_path, 50.0)
    assert main(["identify", *logs, "--vessel", "twin_thruster", "--json"]) == 0
    bands = json.loads(capsys.readouterr().out)["forecast"]
    first = bands["first overshoot of a 10/10 zigzag"]
    assert 0.0 < first["low_deg"] < first["middle_deg"] < first["high_deg"]
    assert main(["identify", *logs, "--vessel", "twin_thruster"]) == 0
    assert "second overshoot of a 20/20 zigzag" in capsys.readouterr().out


def identified(exponent: float | None, runs: list[Run]) -> str:
    shipped = load_vessel("blueboat")
    vessel = replace(shipped, drive=replace(shipped.drive, thrust_exponent=exponent))
    found = identified_by_thrust(
        build_parser().parse_args(["identify", "a.csv", "--vessel", "blueboat"]), vessel, runs, []
    )
    assert found is not None
    return found[0]


def test_logs_sailed_by_another_thrust_curve_are_not_identified(runs: list[Run]) -> None:
    own = [run._replace(vessel=dump_vessel(load_vessel("blueboat"))) for run in runs]
    assert "K " in identified(None, own)
    with pytest.raises(InputError, match="another drive"):
        identified(2.0, own)
