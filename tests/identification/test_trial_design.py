"""A designed trial stays in its water when it is sailed, tells what was predicted, and is no worse with more room."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from plant import Plant

from autopilot.cli.main import build_parser, main
from autopilot.control.registry import TRIAL_LAW
from autopilot.identification.runs import run_from_columns
from autopilot.identification.trial_design import (
    Boat,
    Candidate,
    Design,
    InstrumentNoise,
    Water,
    berthed,
    cramer_rao,
    design_of,
    designs,
    track_of,
)
from autopilot.operators.trial_script import TrialScript, steps_of
from autopilot.runtime.build import build_pilot, gear_of, limits_of, model_of
from autopilot.signals import SpeedSample, Tick
from autopilot.vessel.file import load_vessel

LANXIN = load_vessel("lanxin")
VESSEL = replace(LANXIN, model=replace(LANXIN.model, K_1_s=0.2, T_s=5.0, n3_s2_rad2=20.0, reference_speed_m_s=2.5))
NOISE = InstrumentNoise(math.radians(0.1), math.radians(0.2))
BOAT = Boat(model_of(VESSEL), gear_of(VESSEL), NOISE, limits_of(VESSEL).angle_max, 2.5, 0.2)
WATER = Water(220.0, 120.0, 150.0, 10.0)


@pytest.fixture(scope="module")
def found() -> list[Design]:
    return designs(BOAT, WATER)


def sailed(command: list[str]) -> tuple[list[Tick], np.ndarray]:
    """Sail a trial's command by the pilot; return ticks and the true track, ahead and to starboard [m]."""
    arguments = build_parser().parse_args(["trial", *command])
    script = TrialScript(steps_of(arguments, math.degrees(limits_of(VESSEL).angle_max) + 1e-9, model_of(VESSEL)))
    plant, pilot = Plant(model_of(VESSEL), gear_of(VESSEL)), build_pilot(VESSEL, TRIAL_LAW)
    ticks: list[Tick] = []
    track = [(0.0, 0.0)]
    while not script.is_over:
        samples = (*plant.sense(), SpeedSample(plant.time, 2.5, source="log"))
        tick = pilot.step(plant.time, samples, script(plant.time, ticks[-1] if ticks else None))
        ticks.append(tick)
        plant.step(tick.command.angle if tick.command.engaged else 0.0, 0.1)
        here = track[-1]
        track.append((here[0] + 0.25 * math.cos(plant.heading), here[1] + 0.25 * math.sin(plant.heading)))
    return ticks, np.array(track)


def test_the_best_of_each_kind_comes_best_first(found: list[Design]) -> None:
    assert {design.candidate.kind for design in found} == {"zigzag", "turning", "prbs"}
    assert [design.score for design in found] == sorted(design.score for design in found)
    worse = design_of(BOAT, WATER, Candidate("zigzag", math.radians(7.5), math.radians(5.0)))
    assert worse is not None
    zigzag = next(design for design in found if design.candidate.kind == "zigzag")
    assert zigzag.score < worse.score


@pytest.mark.parametrize("kind", ["zigzag", "turning", "prbs"])
def test_the_command_sails_it_inside_the_water_and_tells_what_was_predicted(found: list[Design], kind: str) -> None:
    from autopilot.cli.trial import _command

    design = next(one for one in found if one.candidate.kind == kind)
    command = _command(design, "lanxin").replace("--link URL", "--link udpin:127.0.0.1:0").split()
    ticks, track = sailed(command)
    course, berth = design.berth.course, design.berth
    along = berth.behind + track @ np.array([math.cos(course), -math.sin(course)])
    across = berth.to_port + track @ np.array([math.sin(course), math.cos(course)])
    assert -1.0 < along.min() < along.max() < WATER.length + 1.0
    assert -1.0 < across.min() < across.max() < WATER.width + 1.0
    columns = {
        "time_s": np.array([tick.now for tick in ticks[::2]]),
        "heading_rad": np.array([tick.state.heading for tick in ticks[::2]]),
        "yaw_rate_rad_s": np.array([tick.state.rate for tick in ticks[::2]]),
        "rudder_rad": np.array([tick.state.rudder for tick in ticks[::2]]),
        "speed_m_s": np.full(len(ticks[::2]), 2.5),
    }
    bound = cramer_rao([run_from_columns("sailed", columns)], BOAT.model, ("gain", "time_constant", "n3", "n0"), NOISE)
    for name in ("gain", "time_constant", "n3"):
        assert bound[name] == pytest.approx(design.errors[name], rel=0.35)


def test_more_water_or_time_tells_no_less() -> None:
    candidate = Candidate("turning", math.radians(20.0), 15.0)
    small, wide, long = (
        design_of(BOAT, water, candidate)
        for water in (Water(120.0, 80.0, 150.0), Water(400.0, 300.0, 150.0), Water(400.0, 300.0, 300.0))
    )
    assert small is not None
    assert wide is not None
    assert long is not None
    assert small.duration < wide.duration < long.duration
    assert small.score >= wide.score >= long.score


def test_no_trial_is_designed_for_water_that_is_too_small() -> None:
    assert design_of(BOAT, Water(20.0, 10.0, 100.0), Candidate("zigzag", 0.3, 0.3)) is None


def test_a_straight_track_lies_along_the_diagonal() -> None:
    """100 m straight ahead: a box of 90 m by 60 m holds it across (108 m), one of 70 by 60 only 92 m of it."""
    ahead = np.linspace(0.0, 100.0, 1001)
    rows, berth = berthed(ahead, np.zeros(1001), Water(90.0, 60.0, 60.0))
    assert rows == 1001
    assert abs(math.degrees(berth.course)) in (30.0, 35.0)
    rows, berth = berthed(ahead, np.zeros(1001), Water(70.0, 60.0, 60.0))
    assert ahead[rows - 1] == pytest.approx(math.hypot(70.0, 60.0), rel=0.02)
    assert berth.length <= 70.0
    assert berth.width <= 60.0


def test_a_circle_takes_its_diameter() -> None:
    """A boat that turns at once lies in a square of its turning circle, 2 U/(K d)."""
    quick = BOAT._replace(model=BOAT.model._replace(time_constant=0.05, n3=0.0), spacing=0.05)
    from autopilot.identification.trial_design import planned

    run = planned(quick.model, quick.gear, lambda time, heading: 0.4, 120.0, 0.05, 2.5)
    rows, berth = berthed(*track_of(run.segments[0]), Water(500.0, 500.0, 120.0))
    assert rows == run.segments[0].time.size
    assert berth.length == pytest.approx(2.0 * 2.5 / (0.2 * 0.4), rel=0.1)


def test_the_command_prints_what_to_sail(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", "design", "lanxin", "--water", "110x80", "--time", "25", "--json", "--rate-hz", "5"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {design["kind"] for design in printed["designs"]} == {"zigzag", "turning", "prbs"}
    assert all(0.0 < design["standard_errors"]["gain"] < 0.1 for design in printed["designs"])


@pytest.mark.parametrize(
    ("changed", "code", "expected"),
    [
        ({"--water": "300"}, 2, "write length and width in metres"),
        ({"--water": "300x-2"}, 2, "write length and width in metres"),
        ({"--time": "5"}, 2, "--time 5: allowed is 10 to 36000"),
        ({"--margin-m": "50"}, 2, "--margin-m 50: allowed is 0 to less than half the width, 50"),
        ({"--speed-m-s": "0"}, 2, "--speed-m-s 0: allowed is 0.05 to 100"),
        ({"--water": "10x8"}, 4, "does not hold ten seconds of any trial"),
    ],
)
def test_what_cannot_be_designed_is_one_sentence(
    changed: dict[str, str], code: int, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"--water": "150x100", "--time": "40", "--rate-hz": "5", **changed}
    assert main(["trial", "design", "lanxin", *(f"{name}={value}" for name, value in options.items())]) == code
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert expected in said[0]


@pytest.mark.parametrize(
    ("candidate", "options"),
    [
        (Candidate("zigzag", math.radians(15.0), math.radians(10.0)), ["--rudder-deg=15", "--heading-deg=10"]),
        (Candidate("prbs", math.radians(10.0), 4.0), ["--rudder-deg=10", "--hold=4"]),
    ],
)
def test_what_a_trial_is_predicted_to_tell_is_what_its_design_says(candidate: Candidate, options: list[str]) -> None:
    from autopilot.cli.trial import predicted_accuracy, sailed

    arguments = build_parser().parse_args(["trial", candidate.kind, "lanxin", "--duration=90", *options])
    design = design_of(BOAT._replace(spacing=0.1), Water(2000.0, 2000.0, 90.0), candidate)
    assert design is not None
    first, second = (TrialScript(steps_of(arguments, 30.0, model_of(VESSEL))) for _ in range(2))
    bound = cramer_rao([sailed(first, VESSEL)], BOAT.model, tuple(design.errors), NOISE)
    assert bound == pytest.approx(design.errors, rel=0.01)
    quiet = replace(VESSEL, sensors=replace(VESSEL.sensors, rate_noise_deg_s=0.1, heading_noise_deg=0.2))
    said = predicted_accuracy(second, quiet)
    assert f"K to {100.0 * bound['gain'] / 0.2:.2g} %, T to {100.0 * bound['time_constant'] / 5.0:.2g} %" in said
    assert "It takes 90 s" in said
    alone = replace(quiet, sensors=replace(quiet.sensors, gyro=False))
    again = TrialScript(steps_of(arguments, 30.0, model_of(VESSEL)))
    worse = cramer_rao([sailed(again, VESSEL)], BOAT.model, tuple(design.errors), NOISE._replace(rate=math.inf))
    assert worse["gain"] > bound["gain"]
    third = TrialScript(steps_of(arguments, 30.0, model_of(VESSEL)))
    assert f"K to {100.0 * worse['gain'] / 0.2:.2g} %" in predicted_accuracy(third, alone)


def test_a_trial_without_end_is_predicted_to_its_limit(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", "turning-circle", "lanxin", "--predict", "--turn-deg", "180", "--side", "port"]) == 0
    whole = capsys.readouterr().out
    assert "before its time" not in whole
    assert main(["trial", "turning-circle", "lanxin", "--predict", "--time-limit", "9"]) == 0
    cut = capsys.readouterr().out
    assert "It takes 9 s" in cut
    assert "It would end before its time: the time limit of 9 s is over." in cut


def test_a_trial_that_is_to_be_sailed_needs_a_link(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", "zigzag", "lanxin"]) == 2
    assert "needs --link URL" in capsys.readouterr().err
