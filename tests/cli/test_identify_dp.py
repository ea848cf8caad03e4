"""`autopilot identify-dp` as a user calls it: a simulated trial, its table again, and files that are wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autopilot.cli.main import main

SHIP = """# Zheng's dredger, its k1 and k2 hardly known
length_m: 128
mass_kg: 19413000
surge_mass: 1.05
sway_mass: 1.642
coupling_mass: 0.0375
yaw_mass: 0.0977
lever_m: 50
k1: 0.8
k1_deviation: 0.5
Xu: 0.008
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["identify-dp", *arguments, "--particles", "50", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["identify-dp", *arguments]) == 2
    return capsys.readouterr().err


@pytest.fixture(scope="module")
def sway_table(tmp_path_factory: pytest.TempPathFactory) -> str:
    from autopilot.cli.identify_dp_files import write_trial
    from autopilot.identification.dynamic_positioning import SCENARIOS, simulate_scenario

    path = tmp_path_factory.mktemp("dp") / "s4.csv"
    scenario = SCENARIOS["S4"]._replace(thrust=SCENARIOS["S4"].thrust[:60])
    write_trial(str(path), simulate_scenario(scenario, np.random.default_rng(3)).trial, "one minute of S4")
    return path.read_text()


def test_a_simulated_trial_and_its_recorded_table_give_the_same_ship(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, ship = tmp_path / "trial.csv", tmp_path / "ship.yaml"
    ship.write_text(SHIP)
    simulated = run(capsys, "--scenario", "S2", "--seed", "7", "--record", str(table))
    recorded = run(capsys, str(table), "--ship", str(ship))
    for name in ("Xu", "k1", "k2"):
        first, second = simulated["parameters"][name], recorded["parameters"][name]
        assert first["is_identified"]
        assert abs(first["ekf"]["value"] - first["truth"]) < 4.0 * first["ekf"]["std"]
        assert abs(first["ekf"]["value"] - second["ekf"]["value"]) < 0.3 * first["ekf"]["std"]
        assert abs(second["fpf"]["value"] - second["batch"]["value"]) < 3.0 * second["batch"]["std"]
        assert "truth" not in second
    assert recorded["parameters"]["k1"]["prior"] == {"value": 0.8, "std": 0.5}
    assert recorded["mean_square_prediction_error"] == pytest.approx(1.0, abs=0.2)
    assert recorded["warnings"] == []


def test_what_sixty_seconds_cannot_tell_is_said_instead_of_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify-dp", "--scenario", "S3", "--particles", "50"]) == 0
    printed = capsys.readouterr().out
    for name in ("Yr", "Nv", "Nr"):
        assert f"{name} cannot be identified from this trial" in printed
        (row,) = [line for line in printed.splitlines() if line.startswith(f"{name}  ")]
        assert "cannot be identified" in row
    assert printed.count("cannot be identified from this trial") == 3


def test_noise_that_does_not_fit_the_trial_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, ship = tmp_path / "trial.csv", tmp_path / "ship.yaml"
    ship.write_text(SHIP + "position_noise_m: 0.02\n")
    run(capsys, "--scenario", "S2", "--record", str(table))
    table.write_text("\n".join(table.read_text().splitlines()[:150]))
    (warning,) = run(capsys, str(table), "--ship", str(ship))["warnings"]
    assert "correct the noise in the ship's file" in warning


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "either a TRIAL.csv or --scenario"),
        (("x.csv", "--scenario", "S1"), "either a TRIAL.csv or --scenario"),
        (("x.csv", "--record", "y.csv"), "--record writes the trial that --scenario simulates"),
        (("--scenario", "S1", "--ship", "s.yaml"), "--ship goes with a TRIAL.csv"),
        (("--scenario", "S1", "--particles", "3"), "allowed is a whole number from 10 to 100000"),
        (("--scenario", "S1", "--seed", "-1"), "--seed -1: allowed is a whole number from 0"),
        (("--scenario", "S1", "--gain", "kernel", "--particles", "5000"), "at most 2000"),
        (("--scenario", "S1", "--record", "/nowhere/at/all.csv"), "cannot be written"),
    ],
)
def test_options_that_make_no_sense_are_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert sentence in complaint(capsys, *arguments)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[1, 2]", "a ship is lines such as"),
        (SHIP.replace("mass_kg: 19413000\n", ""), "has no mass_kg"),
        (SHIP + "k9: 1\n", "k9 is not known"),
        (SHIP + "k2: many\n", "k2 must be a number"),
        (SHIP + "k2_deviation: -1\n", "k2_deviation must be above 0"),
        (SHIP + "k2: 0\n", "k2_deviation must say how firmly"),
        (SHIP.replace("coupling_mass: 0.0375", "coupling_mass: 3"), "coupling_mass is too large"),
    ],
)
def test_a_ship_that_cannot_be_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    ship = tmp_path / "ship.yaml"
    ship.write_text(text)
    error = complaint(capsys, "x.csv", "--ship", str(ship))
    assert sentence in error
    assert str(ship) in error


ROWS = "".join(f"{k},0,1000,{0.1 * k}\n" for k in range(30))
LATER_ROWS = "".join(f"{k + 1e9},0,1000,{0.1 * k}\n" for k in range(30))
SWAY_ROWS = "".join(f"{k},1000,{0.1 * k},\n" for k in range(30))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time_s,thrust_1_n,position_x_m\n0,1,0\n", "has no thrust_2_n, which goes with thrust_1_n, position_x_m"),
        ("time_s,position_x_m\n0,1\n", "has no column thrust_1_n or thrust_3_n"),
        ("time_s,thrust_1_n,thrust_2_n,position_x_m\n0,1,1,0\n", "has 1 rows; at least 20"),
        ("time_s,thrust_1_n,thrust_2_n,position_x_m\n" + ROWS.replace("1000", "0"), "no thruster ever pushes"),
        ("time_s,thrust_1_n,thrust_2_n,position_x_m\n" + ROWS.replace("5,0,1000", "5,,1000", 1), "is blank in row"),
        ("time_s,thrust_3_n,position_y_m,heading_deg\n" + SWAY_ROWS, "blank in the first row"),
        (
            "time_s,thrust_1_n,thrust_2_n,position_x_m\n" + ROWS + LATER_ROWS,
            "A trial under thrusters must go on: cut out one part",
        ),
        (
            "time_s,thrust_1_n,thrust_2_n,thrust_3_n,position_x_m\n" + ROWS.replace(",1000,", ",1000,7,"),
            "main thrusters or of the side thruster alone",
        ),
    ],
)
def test_a_trial_that_tells_nothing_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    trial = tmp_path / "trial.csv"
    trial.write_text(text)
    error = complaint(capsys, str(trial))
    assert sentence in error
    assert str(trial) in error


def test_a_heading_that_passes_north_is_continuous(
    sway_table: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, wrapped = tmp_path / "trial.csv", tmp_path / "wrapped.csv"
    rows = [line.split(",") for line in sway_table.splitlines()[2:]]
    plain = [f"{row[0]},{row[1]},{row[2]},{float(row[3]) * 57.29577951308232:.9g}" for row in rows]
    turned = [f"{row[0]},{row[1]},{row[2]},{(float(row[3]) * 57.29577951308232 + 350.0) % 360.0:.9g}" for row in rows]
    header = "time_s,thrust_3_n,position_y_m,heading_deg"
    table.write_text("\n".join([header, *plain]))
    wrapped.write_text("\n".join([header, *turned]))
    first, second = run(capsys, str(table)), run(capsys, str(wrapped))
    assert first["parameters"]["k3"]["ekf"] == pytest.approx(second["parameters"]["k3"]["ekf"], rel=1e-4)
    assert first["mean_square_prediction_error"] == pytest.approx(second["mean_square_prediction_error"], rel=1e-4)
