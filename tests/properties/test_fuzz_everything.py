"""The fuzzer of the whole pilot and of every reader of files, as its command line, on a sample of its inputs."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from autopilot.runtime.build import build_pilot
from autopilot.signals import (
    HeadingSample,
    HelmSample,
    Mode,
    Order,
    OrderKind,
    RudderCommand,
    SupervisorState,
)
from autopilot.vessel.file import load_vessel

ROOT = Path(__file__).parents[2]


def test_pilot_and_readers_survive_a_sample_of_the_fuzzer_s_inputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fuzz_everything import names

    command = [sys.executable, str(ROOT / "benchmarks" / "fuzz_everything.py"), "--inputs", "30", "--seed", "7"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=300, check=False, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    rows = [[cell.strip() for cell in line.split("|")] for line in run.stdout.splitlines()[2:]]
    assert [row[1] for row in rows] == names()
    taken = sum(int(row[3]) for row in rows)
    assert taken > 50, "damage that leaves nothing readable tries nothing but the refusals"
    assert all(int(row[2]) >= 30 for row in rows)


def test_every_reader_takes_something_that_is_sound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Damage to inputs that a reader refuses all the same tries one refusal and nothing behind it."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fuzz_everything import REFUSALS
    from fuzz_file_targets import Target, targets

    def is_taken(target: Target, data: bytes) -> bool:
        try:
            target.take(data)
        except REFUSALS:
            return False
        return True

    deaf = [name for name, each in targets().items() if not any(is_taken(each, data) for data in each.seeds)]
    assert deaf == []


def test_a_run_that_was_cut_goes_on_with_other_inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fuzz_everything import Kept

    path, name = tmp_path / "parts.jsonl", "pilot, pid"
    first = Kept(path, 1)
    first.run_part(name, 60)
    done = first.inputs(name)
    assert done >= 60
    again = Kept(path, 1)
    assert again.inputs(name) == done
    again.run_part(name, done + 60)
    assert again.inputs(name) >= done + 60
    one, two = (json.loads(line) for line in path.read_text().splitlines())
    assert (one["taken"], one["inputs"]) != (two["taken"], two["inputs"]), "the same inputs again"
    assert Kept(path, 2).inputs(name) == 0


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"order": Order()}, "Order"),
        ({"supervisor": SupervisorState.TRIAL}, "TRIAL"),
        ({"samples": (HelmSample(0.0, False, "hands on", "here"),)}, "but"),
        ({"mode": Mode.FAULT, "supervisor": SupervisorState.FAULT, "alarms": ()}, "without a word"),
        ({"command": RudderCommand(0.0, math.nan, True)}, "nan"),
        ({"command": RudderCommand(0.0, 0.6, True)}, "0.6"),
        ({"command": RudderCommand(0.0, 0.0, False)}, "ENGAGED"),
    ],
)
def test_a_tick_that_is_not_legal_is_found(
    change: dict[str, Any], complaint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from fuzz_pilot_target import PilotTarget

    pilot = build_pilot(load_vessel("lanxin"))
    order = Order(OrderKind.HEADING, 0.2, serial=1)
    for number in range(4):
        tick = pilot.step(0.05 * number, (HeadingSample(0.05 * number, 0.1, 0.0),), order)
    assert tick.mode is Mode.ENGAGED
    target = PilotTarget("pid")
    target.judge(tick, None)
    with pytest.raises(AssertionError, match=complaint):
        target.judge(tick._replace(**change), None)
