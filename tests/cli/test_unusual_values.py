"""Values that a vessel file may have and hardly any boat has: taken, and doubted with file, key and what is usual."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.vessel.file import doubts, load_vessel, shipped_vessels, vessel_document

TEXT = """schema_version: 2
name: mine
length_m: 7
model: {{K_1_s: {gain}, T_s: {time_constant}, reference_speed_m_s: 4.0}}
rudder: {{angle_max_deg: 30, rate_max_deg_s: {rate}}}
"""


def boat(folder: Path, gain: float = 0.7, time_constant: float = 1.0, rate: float = 20.0) -> str:
    path = folder / "mine.yaml"
    path.write_text(TEXT.format(gain=gain, time_constant=time_constant, rate=rate))
    return str(path)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"gain": 50.0}, "model.K_1_s is 50, usual are 0.001 to 20 and allowed 1e-05 to 100"),
        ({"time_constant": 0.02}, "model.T_s is 0.02, usual are 0.05 to 2000 and allowed 0.01 to 10000"),
        ({"time_constant": 300.0}, "model.T_s is 300, usual for 7 m at 4 m/s are 0.0875 to 105 (T' 0.05 to 60)"),
        ({"rate": 500.0}, "rudder.rate_max_deg_s is 500, usual are 0.5 to 400 and allowed 0.1 to 1000"),
        ({"rate": 0.2}, "rudder.rate_max_deg_s is 0.2, usual are 0.5 to 400 and allowed 0.1 to 1000"),
    ],
)
def test_what_hardly_any_boat_has_is_said_with_its_line_and_what_is_usual(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], values: dict[str, float], said: str
) -> None:
    path = boat(tmp_path, **values)
    line = 4 if said.startswith("model") else 5
    assert main(["params", "check", path]) == 0
    printed = capsys.readouterr()
    assert f"{path}, line {line}, column " in printed.err and said in printed.err
    assert "to be looked at" in printed.out and "nothing wrong" not in printed.out


@pytest.mark.parametrize(
    "values", [{"time_constant": 1.0e6}, {"time_constant": 1.0e-3}, {"rate": 0.01}, {"gain": 1000.0}]
)
def test_what_no_boat_can_have_is_refused(tmp_path: Path, values: dict[str, float]) -> None:
    with pytest.raises(InputError, match=r"line [45], column .* allowed|line [45], column .* from"):
        load_vessel(boat(tmp_path, **values))


def test_a_command_that_steers_by_the_file_says_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["trial", "zigzag", boat(tmp_path, rate=500.0), "--predict"])
    assert "rudder.rate_max_deg_s is 500, usual are" in capsys.readouterr().err


def test_no_shipped_boat_is_doubted() -> None:
    assert {name: found for name in shipped_vessels() if (found := [*doubts(load_vessel(name))])} == {}
    assert vessel_document("lanxin").value
