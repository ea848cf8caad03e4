"""The way back after a push, as benchmarks/steady_wind.py has it: the rows that used to be the worst."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def steady_wind(monkeypatch: pytest.MonkeyPatch) -> Any:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("steady_wind")


@pytest.mark.parametrize("seed", [8, 10, 18, 43])
def test_a_ship_that_turns_better_than_its_model_comes_back_without_a_second_overshoot(
    steady_wind: Any, seed: int
) -> None:
    """With a fifth of the model error supposed it swung by 2 to 3 deg with these seeds."""
    held = steady_wind.held(steady_wind.BOATS["esso"], 1.4, seed, True, steady_wind.sailed_compiled)
    assert held.off > 10.0
    assert held.second < 1.0
    assert abs(held.mean) < 0.1


@pytest.mark.parametrize(("name", "over_deg"), [("coaster", 2.0), ("ferry", 1.0), ("lanxin", 2.0)])
def test_after_an_early_push_the_boat_comes_back_without_second_overshoot(
    steady_wind: Any, name: str, over_deg: float
) -> None:
    push = steady_wind.Pushed(60.0, 60.0, over_deg)
    for factor in steady_wind.FACTORS:
        past, second, _ = steady_wind.pushed(steady_wind.PUSHED_BOATS[name], factor, 0.3, False, push)
        assert second < 1.0
        assert past < 15.0
