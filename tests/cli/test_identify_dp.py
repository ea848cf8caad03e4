"""`autopilot identify-dp` as a user calls it: a log, the verdict, and files that are wrong."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dp_intervals import CONDITIONS, sailed

from autopilot.cli.identify_dp import load_ship, load_trial
from autopilot.cli.main import main

SHIP = """# Zheng's dredger
schema_version: 1
length_m: 128
mass_kg: 19413000
thrusters:
  - {angle_deg: 0, x_m: -60}
  - {angle_deg: 0, x_m: -60, y_m: 0}
  - {angle_deg: 90, x_m: 50}
thrust_lag_s: 0
"""
ONE = SHIP[: SHIP.index("  - {angle_deg: 0, x_m: -60, y_m: 0}")] + "thrust_lag_s: 0\n"
HEAD = "time_s,thrust_1_n,thrust_2_n,thrust_3_n,north_m,east_m,heading_deg"
ROWS = "".join(f"{k},0,1000,0,{0.1 * k},0,0\n" for k in range(30))

Write = Callable[[str, str], str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(name: str, text: str) -> str:
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return written


def table(rows: list[list[float]], head: str = HEAD) -> str:
    return "\n".join([head, *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n"


def log_of(seed: int, rows: int = 601) -> str:
    trial = sailed("all", seed, **CONDITIONS["wind"])
    values = np.column_stack(
        [trial.time, trial.orders, trial.measured[:, :2], np.degrees(trial.measured[:, 2]) % 360.0]
    )
    return table(values[:rows].tolist())


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["identify-dp", *arguments]) == 2
    return capsys.readouterr().err


def test_a_log_gives_a_verdict_intervals_and_a_ship_for_the_next_log(
    write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ship = write("ship.yaml", SHIP.replace("thrust_lag_s: 0\n", ""))
    out = tmp_path / "found.yaml"
    assert main(["identify-dp", write("log.csv", log_of(3)), "--ship", ship, "--out", str(out), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert document["level"] in ("good", "start")
    parameters = document["parameters"]
    low, high = parameters["Xu"]["interval"]
    assert low < 0.0112 * 19413000.0 * math.sqrt(9.81 / 128.0) < high
    assert parameters["k3"]["is_identified"] and parameters["lag"]["unit"] == "s"
    known = load_ship(str(out)).known
    assert known["k1"].value == pytest.approx(parameters["k1"]["value"])
    assert known["k1"].std == pytest.approx(parameters["k1"]["std"])
    # a minute more, from what is known: nothing known gets lost
    assert main(["identify-dp", write("short.csv", log_of(4, 60)), "--ship", str(out)]) == 0
    assert capsys.readouterr().out.startswith("Good")


def test_a_minute_is_not_enough_and_what_to_do_is_said(write: Write, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify-dp", write("log.csv", log_of(3, 45)), "--ship", write("ship.yaml", SHIP)]) == 0
    printed = capsys.readouterr().out
    assert (printed.startswith("Not enough: ") and "Make the log longer" in printed) or "Move each thruster" in printed
    assert "cannot be identified from this log" in printed


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[1, 2]", "needed is a mapping"),
        (SHIP.replace("mass_kg: 19413000\n", ""), "mass_kg"),
        (SHIP + "k9: 1\n", "k9"),
        (SHIP + "known: {k9: {value: 1, std: 1}}\n", "known.k9 is no coefficient of this ship"),
        (SHIP + "known: {k2: {value: 1, std: -1}}\n", "std"),
        (SHIP + "known: {lag: {value: 1, std: 1}}\n", "does not go with thrust_lag_s"),
        (SHIP + "coupling_mass: 0.9\n", "coupling_mass squared"),
        (SHIP.replace("schema_version: 1", "schema_version: 2"), "it must be 1"),
        (SHIP[: SHIP.index("thrusters")] + "thrusters: []\n", "allowed are 1 to 8"),
    ],
)
def test_a_ship_that_cannot_be_is_one_sentence(
    write: Write, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    ship = write("ship.yaml", text)
    error = complaint(capsys, "x.csv", "--ship", ship)
    assert sentence in error
    assert ship in error


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (HEAD.replace("thrust_2_n,", "") + "\n0,1,0,0,0,0\n", "has no thrust_2_n and no thrust_2_percent"),
        (HEAD.replace("_2_n", "_2_percent") + "\n" + ROWS, "thrust_2_percent needs full_n"),
        (HEAD.replace("north_m,east_m", "a,b") + "\n" + ROWS, "has no position"),
        (HEAD.replace("east_m", "b") + "\n" + ROWS, "has no east_m, which goes with north_m and east_m"),
        (HEAD.replace("heading_deg", "b") + "\n" + ROWS, "has no heading_deg"),
        (HEAD + "\n0,1,1,1,0,0,0\n", "has 1 rows; at least 20"),
        (HEAD + "\n" + ROWS.replace("1000", "0"), "no thruster ever pushes"),
        (HEAD + "\n" + ROWS.replace("5,0,1000", "5,,1000", 1), "is blank in row"),
        (HEAD + "\n" + ROWS.replace("0,0,1000,0,0.0,", "0,0,1000,0,,", 1), "north_m is blank in the first row"),
        (HEAD + ",thrust_4_n\n" + ROWS.replace("\n", ",5\n"), "has thrust_4_n, and the ship's file has 3 thrusters"),
        (
            HEAD + "\n" + ROWS + "".join(f"{k + 1e9},0,1000,0,1,0,0\n" for k in range(30)),
            "A trial under thrusters must go on: cut out one part",
        ),
    ],
)
def test_a_log_that_tells_nothing_is_one_sentence(
    write: Write, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    trial = write("trial.csv", text)
    error = complaint(capsys, trial, "--ship", write("ship.yaml", SHIP))
    assert sentence in error
    assert trial in error


def test_columns_of_every_kind_are_the_same_trial(write: Write) -> None:
    """Newtons or per cent, metres or degrees, headings that pass north; x and y in the frame of the first heading."""
    ship = load_ship(write("ship.yaml", ONE.replace("x_m: -60", "full_n: 2000, is_square: true")))
    turns = [350.0 + k for k in range(30)]
    plain = [[k, 500.0 if k % 2 else -500.0, 10.0 * k, 5.0 * k, turns[k]] for k in range(30)]
    a_metre = math.degrees(1.0 / 6371008.8)
    globe = [
        [k, 0.1 * thrust, north * a_metre, east * a_metre, heading % 360.0] for k, thrust, north, east, heading in plain
    ]
    first = load_trial(write("a.csv", table(plain, "time_s,thrust_1_n,north_m,east_m,heading_deg")), ship)
    second = load_trial(
        write("b.csv", table(globe, "time_s,thrust_1_percent,latitude_deg,longitude_deg,heading_deg")), ship
    )
    for row in globe:  # and across the date line
        row[3] = (row[3] + 359.9999) % 360.0 - 180.0
    third = load_trial(
        write("d.csv", table(globe, "time_s,thrust_1_percent,latitude_deg,longitude_deg,heading_deg")), ship
    )
    np.testing.assert_allclose(first.measured[:, :2], third.measured[:, :2], atol=0.06)
    own = load_trial(write("c.csv", table(plain, "time_s,thrust_1_n,position_x_m,position_y_m,heading_deg")), ship)
    np.testing.assert_allclose(first.orders, second.orders)
    np.testing.assert_allclose(first.measured[:, :2], second.measured[:, :2], atol=1e-3)
    np.testing.assert_allclose(np.diff(first.measured[:, 2]), np.diff(second.measured[:, 2]), atol=1e-6)
    assert own.measured[0, 2] == 0.0 and own.measured[-1, 2] == pytest.approx(math.radians(29.0))
