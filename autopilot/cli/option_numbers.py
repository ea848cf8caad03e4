"""Options that take a number: read strictly, refused in one sentence that says what is allowed."""

from __future__ import annotations

import argparse
import math
import re
from typing import Any

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, typed_number
from autopilot.files.printable import printable

WHOLE = re.compile(r"[+-]?[0-9]{1,20}")


class NumberOption(argparse.Action):
    """An option with a finite number from `low` to `high`, also whole where `is_whole`."""

    low = -math.inf
    high = math.inf
    is_whole = False

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Set the number; raises InputError, which argparse passes on."""
        is_given = isinstance(values, str)  # else it is the const of an option without a value
        setattr(namespace, self.dest, self._read(values) if is_given else values)

    def _read(self, text: str) -> float:
        try:
            value = int(text) if self.is_whole and WHOLE.fullmatch(text) else typed_number(text)
        except InputError:
            value = math.nan
        if not self.low <= value <= self.high or (self.is_whole and not isinstance(value, int)):
            shown = printable(text, SHOWN) or repr(text)
            raise InputError(f"{self.option_strings[0]} {shown}: allowed is {self.allowed}")
        return value

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        if self.is_whole:
            return f"a whole number from {self.low} to {self.high}"
        return "a number" if math.isinf(self.high) else f"{self.low:.10g} to {self.high:.10g}"


def number(low: float, high: float) -> type[NumberOption]:
    """Return the action of an option with a number; one without bounds, NumberOption itself, is looked at later."""
    return type("Number", (NumberOption,), {"low": low, "high": high})


def whole_number(low: int, high: int) -> type[NumberOption]:
    """Return the action of an option with a whole number."""
    return type("WholeNumber", (NumberOption,), {"low": low, "high": high, "is_whole": True})


SECONDS = number(0.001, 1.0e9)
"""Of a duration: up to thirty years."""
WAITING = number(0.0, 1.0e6)
SPEEDUP = number(0.001, 1.0e6)
SYSTEM_ID = whole_number(1, 255)
SEED = whole_number(0, 2**63 - 1)
