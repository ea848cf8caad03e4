"""The command of the fault matrix on a sample of its cells, its rules, and the page that it has written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
DAY = "2026-11-22"
"""The sample is the same every time; the whole is judged nightly, with seeds of the day."""
ON_A_COURSE = (
    "nothing|heading lost|heading frozen|rudder stuck, with a rudder sensor|backlash of 2 deg|"
    "somebody chooses HOLD|heading jumps by 40 deg|link half open|the law returns no number"
)
MOST_DEG, LONGEST_S = 60.0, 20.0


def matrix(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "benchmarks" / "fault_matrix.py"), "--date", DAY, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)


@pytest.mark.parametrize(
    ("rows", "states", "seeds", "cells"),
    [
        (ON_A_COURSE, "heading", 1, 9),
        ("heading lost|somebody disarms", "trial", 1, 2),
        ("link silent|firmware reboots", "fail-safe", 1, 2),
        # a gyro that was found wrong is not believed again because another compass steers
        ("first of two compasses lost", "degraded", 1, 1),
    ],
)
def test_a_sample_of_cells_is_as_wanted(rows: str, states: str, seeds: int, cells: int) -> None:
    run = matrix("--rows", f"^({rows})$", "--states", states, "--seeds", str(seeds))
    assert run.returncode == 0, run.stdout + run.stderr
    assert f" states, {cells} cells with {seeds} seeds drawn from {DAY}: none failed.\n" in run.stdout


def test_every_run_comes_as_json_and_the_seeds_are_those_of_the_date() -> None:
    asked = ("--rows", "^nothing$", "--states", "standby", "--json")
    one, two = (json.loads(matrix(*asked, "--seeds", seeds).stdout) for seeds in ("1", "2"))
    assert (one["date"], one["cells"], one["failed"]) == (DAY, 1, 0)
    assert [run["seed"] for run in two["runs"]][:1] == [run["seed"] for run in one["runs"]]
    assert len({run["seed"] for run in two["runs"]}) == 2
    assert two["runs"][0]["complaints"] == []
    other = json.loads(matrix("--date", "2026-11-23", *asked, "--seeds", "1").stdout)
    assert other["date"] == "2026-11-23"
    assert other["runs"][0]["seed"] != one["runs"][0]["seed"]


def test_a_jump_in_a_turn_is_no_answer_to_the_rudder(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was held counted as a turn of the boat: a rudder called slow, a course held softly, 35 deg behind."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fault_cells import ROWS, run_cells

    (row,) = (each for each in ROWS if each.name == "heading jumps by 12 deg")
    (cell,) = run_cells([row], ["turn"], 1, seed=1053664086)
    assert len(cell.alarms) == 1
    assert cell.alarms[0].startswith("the compass jumps")
    assert cell.off_deg < 10.0


def test_a_heading_freezes_in_a_sea_that_is_learnt_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rate was found wrong 9 s before, and the sea forgotten, which passed for flat water for 20 s."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fault_cells import ROWS, run_cells

    (row,) = (each for each in ROWS if each.name == "heading frozen, compass without rate")
    (cell,) = run_cells([row], ["degraded"], 1, seed=70267987)
    assert cell.alarms[0].startswith("heading frozen")
    assert cell.detected is not None
    assert cell.detected <= 5.0


@pytest.mark.parametrize("state", ["heading", "track"])
def test_no_disturbance_is_learnt_from_an_instrument_that_stands(monkeypatch: pytest.MonkeyPatch, state: str) -> None:
    """Heading and rate stood, 4 deg off: the boat had turned by 15 deg until that was found, for the estimate took a
    rudder that turns no boat for a disturbance as large, and it was laid harder against it."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fault_cells import ROWS, run_cells

    (row,) = (each for each in ROWS if each.name == "heading and rate frozen")
    (cell,) = run_cells([row], [state], 1, seed=468225452)
    assert cell.off_deg <= 10.0
    assert cell.ends == "failsafe"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_rudder_that_runs_hard_over_in_a_trial_is_found_in_time(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """The doubt that ended the trial counted for too little afterwards, and what the rudder did was learnt as a sea:
    46 and 49 deg off."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fault_cells import ROWS, run_cells

    (row,) = (each for each in ROWS if each.name == "rudder runs hard over")
    (cell,) = run_cells([row], ["trial"], 1, seed=seed)
    assert any("rudder moves the wrong way" in alarm for alarm in cell.alarms), cell.alarms
    assert cell.ends == "failsafe"
    assert cell.off_deg < 45.0


def test_a_rudder_stuck_before_engaging_counts_from_the_first_order_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fault_boat import STATES
    from fault_cells import ROWS, run_cells

    (row,) = (each for each in ROWS if each.name == "rudder stuck before engaging")
    heading, turn = run_cells([row], [state for state in STATES if state != "track"], 1, seed=70267987)
    assert (heading.state, heading.ends, heading.again) == ("heading", "heading", True)
    assert (turn.state, turn.ends, turn.passed[0]) == ("turn", "failsafe", "heading")
    assert turn.alarms[0].startswith("steering gear: rudder not responding")
    assert turn.detected == turn.left
    assert turn.detected is not None
    assert 0.0 < turn.detected < 5.0


@pytest.fixture
def expectations(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import fault_expectations

    return fault_expectations


def a_cell(**what: Any) -> Any:
    from fault_cells import Cell

    whole = {"row": "rudder reversed", "state": "heading", "detected": 2.0, "left": 2.0, "passed": ("heading",)}
    whole |= {"ends": "failsafe", "rudder": "released", "alarms": ("steering gear: rudder moves the wrong way",)}
    whole |= {"off_deg": 5.0, "unnoticed_deg": 5.0, "broken": (), "again": True}
    return Cell(**(whole | what))


def test_what_is_wanted_is_what_a_skipper_can_bear(expectations: Any) -> None:
    from fault_cells import ROWS

    assert {row.name for row in ROWS} == set(expectations.NEEDS)
    for name in expectations.NEEDS:
        for state in expectations.ENGAGED:
            wanted = expectations.expected(a_cell(row=name, state=state))
            # undetected, a boat may never be further off; once it is, the fault has to have been noticed
            assert wanted.unnoticed_deg <= MOST_DEG, (name, state)
            assert wanted.off_deg <= MOST_DEG, (name, state)
            assert wanted.within <= LONGEST_S or wanted.unnoticed_deg <= 40.0, (name, state)


@pytest.mark.parametrize("state", ["heading", "turn", "track", "trial", "degraded"])
@pytest.mark.parametrize(
    ("row", "cell", "said"),
    [
        ("rudder reversed", {"detected": 5.2}, "limit 5 s"),
        ("rudder reversed", {"unnoticed_deg": 15.5, "off_deg": 15.5}, "limit 15 deg"),
        ("rudder reversed", {"detected": None}, "not noticed"),
        ("rudder stuck, with a rudder sensor", {"detected": 3.2, "unnoticed_deg": 11.0}, "limit 10 deg or 3 s"),
        ("rudder stuck, with a rudder sensor", {"detected": None, "unnoticed_deg": 11.0}, "not noticed"),
        ("rudder stuck", {"detected": None, "unnoticed_deg": 41.0, "off_deg": 41.0}, "not noticed"),
        ("rudder runs hard over", {"unnoticed_deg": 46.0}, "limit 45 deg"),
        ("rudder runs hard over", {"detected": None}, "not noticed"),
        ("link deaf: nothing we send arrives", {"detected": 5.1}, "limit 5 s"),
        ("link deaf: nothing we send arrives", {"detected": None}, "not noticed"),
        ("speed 0.15 of the true one", {"detected": None, "unnoticed_deg": 41.0, "off_deg": 41.0}, "not noticed"),
        ("speed 0.15 of the true one", {"detected": 1.0, "off_deg": 46.0}, "46 deg off"),
        ("nothing", {"detected": None, "off_deg": 0.1}, "0 deg off"),
    ],
)
def test_a_cell_that_is_not_as_wanted_fails(
    expectations: Any, row: str, cell: dict[str, Any], state: str, said: str
) -> None:
    complaints = list(expectations.complaints(a_cell(row=row, state=state, **cell)))
    assert any(said in each for each in complaints), complaints


@pytest.mark.parametrize("fails", [False, True])
def test_a_cell_that_fails_is_printed_and_in_the_exit_code(
    expectations: Any, fails: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import fault_matrix

    cell = a_cell(detected=9.0, off_deg=33.0, unnoticed_deg=33.0) if fails else a_cell()
    monkeypatch.setattr(fault_matrix, "run_cells", lambda *_: iter([cell]))
    monkeypatch.setattr(sys, "argv", ["fault_matrix", "--date", DAY, "--seeds", "1"])
    assert fault_matrix.main() == int(fails)
    assert ("FAILED rudder reversed | heading | " in capsys.readouterr().out) == fails
