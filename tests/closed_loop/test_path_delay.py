"""A path to the vehicle that is slower than its file says: learnt from the echo of the orders, and steered by."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from lockstep import BadLine, Lockstep

from autopilot.angles import wrap
from autopilot.cli.steering import path_words
from autopilot.estimation.path_delay import NOT_ECHOED
from autopilot.runtime.record import replay
from autopilot.vessel.file import load_vessel


class SlowLine(BadLine):
    """Everything comes so many seconds later."""

    def __init__(self, delay: float) -> None:
        super().__init__()
        self._later = delay

    def put(self, now: float, data: bytes) -> None:
        super().put(now + self._later, data)


def turned(delay: float, log: Path | None = None) -> tuple[Lockstep, float]:
    """Return the boat after a turn of 30 deg in which the path shows itself, and one back of 20, and by how much the
    second went too far [deg]."""
    boat = Lockstep(load_vessel("lanxin"), lines=(SlowLine(delay), SlowLine(delay)), log=log)
    boat.engage(30.0)
    boat.run(10.0)
    boat.engage(10.0)
    headings: list[float] = []
    boat.hooks.append(lambda boat: headings.append(math.degrees(wrap(boat.world.boat.state.heading))))
    boat.run(8.0)
    boat.session.close()
    return boat, 10.0 - min(headings)


def test_a_slow_line_is_learnt_and_turns_do_not_go_too_far() -> None:
    boat, over = turned(0.4)
    path = boat.pilot.state.estimate.path
    assert path.delay == pytest.approx(0.8, abs=0.05)
    assert over < 3.0
    assert [each.name for each in boat.tick.alarms] == ["path_late"]
    assert boat.tick.alarms[0].detail == f"measured {0.05 + path.late:.2f} s, filed 0.05 s"
    assert path_words(path, 0.05).startswith(f"path delay measured {path.delay:.2f} s, filed 0.05 s; ")


def test_what_was_learnt_replays_bit_for_bit(tmp_path: Path) -> None:
    log = tmp_path / "a.tlog"
    boat, over = turned(0.15, log)
    assert boat.pilot.state.estimate.path.late > 0.2
    assert over < 3.0
    assert replay(log).identical


def test_a_path_that_is_as_filed_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    boat, _ = turned(0.0)
    path = boat.pilot.state.estimate.path
    assert path.delay < 0.1
    assert path_words(path, 0.05) == f"path delay measured {path.delay:.2f} s, filed 0.05 s"
    assert path_words(NOT_ECHOED, 0.05) == ""
    monkeypatch.setattr("autopilot.estimation.estimator.path_step", lambda *_: NOT_ECHOED)
    without, _ = turned(0.0)
    assert [tick.command for tick in without.ticks] == [tick.command for tick in boat.ticks]
