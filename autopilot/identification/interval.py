"""The 95 % intervals of what was identified, and how wide they may be for a boat that is to be steered."""

from __future__ import annotations

import math

SURE_OF_IT = 1.96
"""Standard errors to either side that hold the truth in 95 of 100 cases."""
GOOD, ENOUGH = 0.3, 0.6
"""How far the 95 % interval of K or T may reach to either side, as a share of it: so that gains bear it, and so that a
first design may be tried."""
GRADES = ("not enough", "start", "good")
"""What a model or a trial is good for, the least first."""


BY_INVERSE = ("gain", "time_constant", "race")
"""What a recording tells by its inverse: that has errors alike to both sides."""


def interval_of(name: str, value: float, error: float) -> tuple[float, float]:
    """Return the 95 % interval of a parameter by its name in the model, its value and its standard error.

    What a recording tells of T with errors alike to both sides is n1/T, and K = (K/T) T errs as T does: their intervals
    are those of their inverses and reach further up than down, without end where the inverse may be 0. So is that of
    the race, from records of known boats; where it cannot be parted from 0 it reaches alike to both sides.
    """
    reach = SURE_OF_IT * error
    if name not in BY_INVERSE or value <= 0.0 or (name == "race" and reach >= value):
        return value - reach, value + reach
    return value / (1.0 + reach / value), value / (1.0 - reach / value) if reach < value else math.inf


def off_by(name: str, value: float, error: float) -> tuple[float, float]:
    """Return how far below and above its value the 95 % interval of a parameter that is not 0 reaches, as shares."""
    low, high = interval_of(name, value, error)
    return (value - low) / abs(value), (high - value) / abs(value)


def serves(grade: str, least: str | None) -> bool:
    """Return whether a grade is at least that one; None asks for nothing."""
    return least is None or GRADES.index(grade) >= GRADES.index(least)
