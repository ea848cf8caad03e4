"""JSON that every reader takes, whatever the numbers are."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from autopilot.cli.gains import _tuned_text
from autopilot.files.printable import json_text


def refused(constant: str) -> Any:
    raise AssertionError(f"{constant} is not JSON")


@pytest.mark.parametrize("indent", [2, None])
def test_a_number_that_is_not_finite_is_null_wherever_it_stands(indent: int | None) -> None:
    found = {"a": math.nan, "b": [1.5, -math.inf, (math.inf, 2)], "c": {"d": math.nan, "e": True}, "f": "nan"}
    text = json_text(found, indent)
    assert json.loads(text, parse_constant=refused) == {
        "a": None,
        "b": [1.5, None, [None, 2]],
        "c": {"d": None, "e": True},
        "f": "nan",
    }
    assert ("\n" in text) is (indent is not None)


def test_gains_of_the_file_that_a_campaign_refuses_are_said_to_be_refused() -> None:
    sailed = {"cost": 1.2, "heading_rms_deg": 0.7, "travel_deg_s": 0.5}
    refused_gains = {"cost": 1.0e6, "heading_rms_deg": math.nan, "travel_deg_s": math.nan}
    found = {"gains": {"kp": 2.0}, "candidates": 9, "held_out": {"tuned": sailed, "before": refused_gains}}
    lines = _tuned_text(json.loads(json_text(found)), "pid").splitlines()
    assert "0.700" in lines[-2] and "refused: no margins" in lines[-1]
