"""What every identification method owes its user, asked of each one in the registry."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification import registry
from autopilot.identification.identified import Identified, Question
from autopilot.identification.methods import PARAMETERS, Method, begin, identified_as
from autopilot.identification.registry import METHODS, NAMES, method_named
from autopilot.identification.runs import FloatArray, Run, run_from_columns

K, T, SPEED = 0.6, 2.0, 5.0
NOMOTO = Question("nomoto", reference_speed=SPEED)

RECURSIVE_SHARE = 0.08
"""K and T of a clean record must come this close to the truth; recursive methods begin far off."""


def zigzag(speed: float = SPEED, seconds: float = 40.0, angle: float = 0.25, gain: float = K) -> dict[str, FloatArray]:
    """A zigzag of a linear boat at 10 Hz, Euler steps of 10 ms; K ~ U, T ~ 1/U about `SPEED`."""
    dt, ratio = 0.01, speed / SPEED
    rows = []
    rate = heading = rudder = 0.0
    order = angle
    for i in range(int(seconds / dt)):
        if i % 10 == 0:
            rows.append((i * dt, heading, rate, rudder))
        if heading * math.copysign(1.0, order) >= abs(angle):
            order = -order
        rudder += min(max(order - rudder, -0.3 * dt), 0.3 * dt)
        rate += dt * (gain * ratio * rudder - rate) / (T / ratio)
        heading += dt * rate
    table = np.array(rows)
    names = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad")
    return {**{name: table[:, i] for i, name in enumerate(names)}, "speed_m_s": np.full(len(rows), speed)}


def run_of(table: dict[str, Any], source: str = "zigzag.csv") -> Run:
    return run_from_columns(source, table)


@pytest.fixture(params=[pytest.param(method, id=method.name) for method in METHODS])
def method(request: pytest.FixtureRequest) -> Method:
    return request.param


@functools.cache
def clean() -> Run:
    return run_of(zigzag())


@functools.cache
def clean_answer(method: Method) -> Identified:
    return identify(method, [clean()])


def identify(method: Method, runs: Sequence[Run], question: Question = NOMOTO) -> Identified:
    return method.identify(runs, question)


def test_names_are_unique_and_found_again() -> None:
    assert len(set(NAMES)) == len(NAMES) == len(METHODS)
    assert all(method_named(name).name == name and method_named(name).summary for name in NAMES)
    with pytest.raises(InputError, match="no identification method; there are output-error"):
        method_named("magic")


def test_it_finds_a_linear_boat_and_predicts_it(method: Method) -> None:
    found = clean_answer(method)
    assert found.model.gain == pytest.approx(K, rel=RECURSIVE_SHARE)
    assert found.model.time_constant == pytest.approx(T, rel=RECURSIVE_SHARE)
    assert found.model.n3 == 0.0
    assert found.model.reference_speed == SPEED
    r2 = found.predict(clean()).yaw_rate_r2
    assert r2 is not None
    assert r2 > 0.97


def test_it_says_how_sure_it_is_of_each_parameter_or_that_it_does_not_know(method: Method) -> None:
    found = clean_answer(method)
    assert set(PARAMETERS) <= set(found.standard_errors)
    errors = [error for error in found.standard_errors.values() if error is not None]
    assert all(0.0 <= error < math.inf for error in errors)
    assert errors or any("standard error" in note for note in found.notes), "neither an error nor a word on why not"


def test_a_recursive_method_shows_how_it_came_to_its_estimate(method: Method) -> None:
    found = clean_answer(method)
    if method.name == "output-error":
        assert found.convergence is None
        return
    assert found.convergence is not None
    time, names, values = found.convergence
    assert values.shape == (time.size, len(names)) and time.size > 20
    assert np.all(np.diff(time) >= 0.0) and time[-1] <= clean().segments[0].time[-1] + 1e-9
    for name in ("gain", "time_constant"):
        assert values[-1, names.index(name)] == pytest.approx(getattr(found.model, name), rel=1e-6)


def test_the_same_runs_give_the_same_model_and_are_left_alone(method: Method) -> None:
    before = [array.copy() for array in clean().segments[0]]
    assert identify(method, [clean()]).model == clean_answer(method).model
    for now, then in zip(clean().segments[0], before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_a_boat_much_quicker_than_its_samples_is_said_to_be(method: Method) -> None:
    """It turns as its rudder stands, sampled every 2 s: what is found of T is noise, and no step is as small."""
    time = 2.0 * np.arange(120)
    rudder = np.where((time // 20.0) % 2.0 == 0.0, 0.25, -0.25)
    rate = 0.2 * rudder + 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    heading = np.concatenate([[0.0], np.cumsum(rate[1:] + rate[:-1])])
    table = {"time_s": time, "rudder_rad": rudder, "heading_rad": heading, "yaw_rate_rad_s": rate}
    found = identify(method, [run_of({**table, "speed_m_s": np.full(time.size, SPEED)})])
    assert found.model.time_constant >= 0.4 * (1.0 - 1e-9)
    assert found.model.time_constant > 0.5 or "a fifth of the time between two samples" in found.unidentifiable["T"]


def test_port_mirrors_starboard(method: Method) -> None:
    table = zigzag()
    for name in ("heading_rad", "yaw_rate_rad_s", "rudder_rad"):
        table[name] = -table[name]
    straight, mirrored = clean_answer(method), identify(method, [run_of(table)])
    assert mirrored.model.gain == pytest.approx(straight.model.gain, rel=0.02)
    assert mirrored.model.time_constant == pytest.approx(straight.model.time_constant, rel=0.02)


def test_parameters_are_stated_at_the_reference_speed(method: Method) -> None:
    found = identify(method, [run_of(zigzag(speed=2.0 * SPEED))])
    assert found.model.gain == pytest.approx(K, rel=RECURSIVE_SHARE)
    assert found.model.time_constant == pytest.approx(T, rel=RECURSIVE_SHARE)


def test_it_goes_by_rate_alone_and_by_heading_alone(method: Method) -> None:
    for missing in ("heading_rad", "yaw_rate_rad_s"):
        table = {name: values for name, values in zigzag().items() if name != missing}
        found = identify(method, [run_of(table)])
        assert found.model.gain == pytest.approx(K, rel=2.0 * RECURSIVE_SHARE), missing


def test_blanks_gaps_and_several_runs_are_borne(method: Method) -> None:
    table = zigzag()
    table["heading_rad"][::7] = np.nan
    table["yaw_rate_rad_s"][3::11] = np.nan
    table["rudder_rad"][200:230] = np.nan
    found = identify(method, [run_of(table, "one.csv"), run_of(zigzag(angle=0.2), "two.csv")])
    assert found.model.gain == pytest.approx(K, rel=2.0 * RECURSIVE_SHARE)
    assert found.model.time_constant == pytest.approx(T, rel=2.0 * RECURSIVE_SHARE)


def test_a_rudder_of_the_wrong_sign_is_called_so(method: Method) -> None:
    table = zigzag()
    table["rudder_rad"] = -table["rudder_rad"]
    with pytest.raises(InputError, match=r"zigzag\.csv: .*against its rudder.*--reverse-rudder"):
        identify(method, [run_of(table)])


def test_a_record_that_tells_nothing_is_refused(method: Method) -> None:
    still = {**zigzag(), "rudder_rad": np.zeros(400)}
    with pytest.raises(InputError, match="rudder never moves"):
        identify(method, [run_of(still)])
    adrift = {**zigzag(), "speed_m_s": np.zeros(400)}
    with pytest.raises(InputError, match="no way"):
        method.identify([run_of(adrift)], NOMOTO._replace(reference_speed=None))
    table, rate = zigzag(), np.random.default_rng(5).normal(size=400)
    elsewhere = {
        **table,
        "yaw_rate_rad_s": rate,
        "heading_rad": np.cumsum(rate) * np.gradient(table["time_s"]),
    }
    with pytest.raises(InputError, match="does not follow the rudder"):
        identify(method, [run_of(elsewhere)])


def test_a_course_unstable_boat_is_found_or_refused_in_a_sentence(method: Method) -> None:
    """T r' - r + 20 r^3 = K delta."""
    dt, rows = 0.01, []
    rate = heading = 0.0
    order = 0.25
    for i in range(8000):
        if i % 10 == 0:
            rows.append((i * dt, heading, rate, order))
        if heading * math.copysign(1.0, order) >= 0.25:
            order = -order
        rate += dt * (K * order + rate - 20.0 * rate**3) / T
        heading += dt * rate
    table = np.array(rows)
    names = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad")
    run = run_of({**{name: table[:, i] for i, name in enumerate(names)}, "speed_m_s": np.full(800, SPEED)})
    question = Question(reference_speed=SPEED, course_unstable=True)
    try:
        found = method.identify([run], question)
    except InputError as refused:
        assert "course-unstable" in str(refused)
        return
    assert found.model.n1 == -1.0
    assert found.model.gain == pytest.approx(K, rel=0.2)
    assert found.model.n3 == pytest.approx(20.0, rel=0.3)


class SteadyRatio:
    """A toy: K from the mean rate over the mean rudder, T a second."""

    name, summary, takes = "steady-ratio", "mean rate over mean rudder", frozenset[str]()

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        begun = begin(runs, question).model
        return identified_as(begun._replace(time_constant=1.0), runs, {})


def test_a_method_is_one_line_in_the_registry(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(registry, "METHODS", (*METHODS, SteadyRatio()))
    path, table = tmp_path / "zigzag.csv", zigzag()
    np.savetxt(path, np.stack(list(table.values()), axis=1), delimiter=",", header=",".join(table), comments="")
    assert main(["identify", "--method", "list"]) == 0
    assert "steady-ratio  mean rate over mean rudder" in capsys.readouterr().out
    assert main(["identify", str(path), "--method", "steady-ratio", "--model", "nomoto", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["T"]["value"] == 1.0
    assert main(["identify", str(path), "--method", "steady-ratio", "--trim", "per-run"]) != 0
    assert "--trim per-run goes with --method output-error, not with steady-ratio" in capsys.readouterr().err
