"""A wave glider: equations of motion, both bodies identified against the simulated truth, and the command."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.runs import body_runs
from autopilot.logs.csv_log import WAVE_GLIDER_NEEDS, read_csv
from sitl.wave_glider import Setting, TwoBodies, equivalent_rudder, step, write_record

CRAFT = Setting().craft
QUIET = Setting(back_pull=0.0, wave_speed=0.0, shake=0.0)


def test_the_float_follows_the_glider_and_comes_to_rest_behind_it() -> None:
    bodies = TwoBodies(glider_heading=1.0)
    for _ in range(6000):
        bodies = step(CRAFT, bodies, 0.0, 0.02)
    assert bodies.surface_heading == pytest.approx(1.0, abs=1.0e-3)
    assert bodies.surface_rate == pytest.approx(0.0, abs=1.0e-4)
    assert bodies.glider_heading == 1.0


@given(st.floats(-0.6, 0.6), st.floats(-3.0, 3.0))
def test_a_step_is_that_of_another_integrator(rudder: float, apart: float) -> None:
    def slope(_: float, x: np.ndarray) -> list[float]:
        psi_f, r_f, psi_g, r_g = x
        surface, glider = CRAFT.surface, CRAFT.glider
        pull = surface.gain * CRAFT.fixed_angle * math.sin(psi_g - psi_f)
        return [
            r_f,
            (pull - r_f - surface.n3 * r_f**3) / surface.time_constant,
            r_g,
            (glider.gain * rudder - r_g - glider.n3 * r_g**3) / glider.time_constant,
        ]

    there = solve_ivp(slope, (0.0, 0.1), [0.0, 0.1, apart, -0.1], rtol=1e-10, atol=1e-12).y[:, -1]
    here = step(CRAFT, TwoBodies(0.0, 0.1, apart, -0.1), rudder, 0.1)
    assert here == pytest.approx(tuple(there), abs=1.0e-7)


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_the_equivalent_rudder_turns_the_float_towards_the_glider(glider: float, surface: float) -> None:
    angle = equivalent_rudder(0.5, glider, surface)
    assert abs(angle) <= 0.5
    assert angle * math.sin(glider - surface) >= 0.0
    assert equivalent_rudder(0.5, glider + 2.0 * math.pi, surface) == pytest.approx(angle, abs=1.0e-9)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("wave_glider") / "quiet.csv"
    write_record(path, QUIET, 200.0, 3)
    return path


@pytest.mark.parametrize("method", ["integral", "output-error"])
def test_k_and_t_of_float_and_glider_are_identified_within_five_percent(
    record: Path, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    options = ["--method", method, "--reference-speed-m-s", "0.7", "--json"]
    assert main(["identify", str(record), "--wave-glider", *options]) == 0
    document = json.loads(capsys.readouterr().out)
    for name, truth in (("float", CRAFT.surface), ("glider", CRAFT.glider)):
        found = document[name]["parameters"]
        assert found["K"]["value"] == pytest.approx(truth.gain, rel=0.05), name
        assert found["T"]["value"] == pytest.approx(truth.time_constant, rel=0.05), name
        assert document[name]["runs"][0]["yaw_rate_r2"] > 0.98


def test_waves_and_the_pull_on_the_glider_cost_little(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed, name in ((1, "a.csv"), (2, "b.csv")):
        write_record(tmp_path / name, Setting(), 120.0, seed)
    names = [str(tmp_path / "a.csv"), "--holdout", str(tmp_path / "b.csv")]
    assert main(["identify", *names, "--wave-glider", "--method", "integral", "--reference-speed-m-s", "0.7"]) == 0
    text = capsys.readouterr().out
    assert "FLOAT" in text and "GLIDER" in text and "holdout" in text and "delta_0 = 30 deg" in text


def test_options_that_do_not_go_with_wave_glider_are_refused(
    record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for options, words in (
        (["--out", "x.yaml"], "--out does not go with --wave-glider"),
        (["--steady-turns", "x.csv"], "--steady-turns does not go"),
        (["--fixed-angle-deg", "nan"], "--fixed-angle-deg nan: allowed is 1 to 90"),
        (["--method", "magic"], "no identification method"),
    ):
        assert main(["identify", str(record), "--wave-glider", *options]) == 2
        assert words in capsys.readouterr().err
    assert main(["identify", "--wave-glider"]) == 2
    assert "needs a LOG" in capsys.readouterr().err
    alone = tmp_path / "ship.csv"
    alone.write_text("time_s,rudder_deg,speed_m_s,heading_deg\n0,0,1,0\n1,0,1,0\n")
    assert main(["identify", str(alone), "--wave-glider"]) == 2
    assert "glider_heading" in capsys.readouterr().err
    with pytest.raises(InputError, match="glider_heading_rad"):
        body_runs("ship.csv", {"heading_rad": np.zeros(3)}, 0.5)


def test_the_simulator_writes_a_record_and_the_truth(tmp_path: Path) -> None:
    from sitl.cli import main as sitl

    path = tmp_path / "wg.csv"
    assert sitl(["wave-glider", "--out", str(path), "--duration", "20", "--seed", "4"]) == 0
    assert "simulated float: K 0.5 1/s" in path.read_text()
    table, _ = read_csv(str(path), None, WAVE_GLIDER_NEEDS)
    assert table["time_s"].size == 100
    assert sitl(["wave-glider", "--out", str(tmp_path / "no" / "wg.csv"), "--duration", "1"]) == 2
