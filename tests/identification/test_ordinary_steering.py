"""`identify` on what nobody sailed as a trial: a model with intervals that hold, or what to sail."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.runs import Run, run_from_columns
from autopilot.identification.verdict import verdict_of

SPEED = 4.0
A, B, D, E = 0.25, 0.3, 6.0, 0.002
FINE, EVERY = 0.02, 25


def columns(seed: int, seconds: float, courses_deg: float, gusts_deg: float = 1.0) -> dict[str, np.ndarray]:
    """A hand that leaves harbour in gusts and waves and answers them; r' = A delta - B r - D r^3 - E, no gyro."""
    random, rows = np.random.default_rng(seed), []
    noise = random.standard_normal
    psi = r = rudder = gust = wave = swing = order = 0.0
    for i in range(round(seconds / FINE)):
        time = i * FINE
        if i % EVERY == 0:
            shown = psi + math.radians(0.3) * noise()
            rows.append((time, rudder, SPEED, shown))
            course = math.radians(courses_deg) * (1.0, -0.4, 0.3, -1.0)[int(time / 30.0) % 4]
            order = min(max(course - shown - 2.0 * (r + math.radians(0.5) * noise()), -0.4), 0.4)
        gust += -gust * FINE / 5.0 + math.radians(gusts_deg) * math.sqrt(2.0 * FINE / 5.0) * noise()
        swing += FINE * (-0.3 * swing - 2.25 * wave) + math.radians(gusts_deg) * math.sqrt(0.675 * FINE) * noise()
        wave += FINE * swing
        rudder += min(max(order - rudder, -0.2 * FINE), 0.2 * FINE)
        push = A * (rudder + gust + wave) - E
        middle = r + 0.5 * FINE * (push - B * r - D * r**3)
        r += FINE * (push - B * middle - D * middle**3)
        psi += FINE * middle
    table = np.array(rows).T
    return dict(zip(("time_s", "rudder_rad", "speed_m_s", "heading_rad"), table, strict=True))


def harbour(seed: int, seconds: float, courses_deg: float) -> Run:
    return run_from_columns("harbour", columns(seed, seconds, courses_deg))


def test_course_changes_by_hand_in_gusts_give_the_boat_and_intervals_that_hold_it() -> None:
    held, sharp = [], []
    for seed in (20261124, 20261125, 20261126, 20261127):
        found = identify([harbour(seed, 240.0, 35.0)], Question(reference_speed=SPEED))
        assert found.ratios is not None
        values, errors = np.array(found.ratios.values), np.array(found.ratios.errors)
        held.append(np.abs(values - (A, B, D, E)) <= SURE_OF_IT * errors)
        sharp.append(errors[0] / A)
    # chance leaves four of sixteen 95 % intervals outside once in a hundred
    assert np.sum(held) >= 12, held
    assert max(sharp) < 0.25


def test_a_straight_course_is_not_enough_and_the_verdict_says_what_to_sail() -> None:
    try:
        found = identify([harbour(3, 120.0, 0.0)], Question(reference_speed=SPEED))
    except InputError as error:
        assert "zigzag" in str(error) or "does not follow the rudder" in str(error)
        return
    verdict = verdict_of(found)
    assert verdict.grade != "good"
    assert "sail" in verdict.sentence


def test_the_command_takes_a_harbour_exit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, table = tmp_path / "exit.csv", columns(20261128, 180.0, 35.0)
    lines = [",".join(table), *(",".join(f"{value:.6g}" for value in row) for row in zip(*table.values(), strict=True))]
    log.write_text("\n".join(lines), encoding="utf-8")
    assert main(["identify", str(log), "--length-m", "10"]) == 0
    assert capsys.readouterr().out.startswith(("Good", "Not enough"))
