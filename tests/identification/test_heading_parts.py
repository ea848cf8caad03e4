"""The cube of the rate from the means of headings: exact for slow turns, and free of what noise adds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.identification.integral_fit import IntegralFit
from autopilot.identification.integral_window import HeadingParts, cubed
from autopilot.models.norrbin import Norrbin

DT = 0.1


def over_two_blocks(noise: float, seed: int = 0) -> tuple[float, float]:
    """A turn r = 0.1 cos 0.5 t [rad/s] in blocks of 3 s, from headings with noise [rad]."""
    random = np.random.default_rng(seed)
    parts, means, before = HeadingParts(3.0), [], 0.2 * math.sin(-6.0)
    # a first stretch for the noise to show itself
    for k in range(-120, 60):
        if k in (-30, 0, 30):
            means.append(parts.means())
            parts.begin()
        now = 0.2 * math.sin(0.5 * (k + 1) * DT) + noise * random.normal()
        parts.take((k % 30) * DT, DT, before, now - before)
        before = now
    means.append(parts.means())
    return cubed(means[-2], means[-1], 6.0, parts.roughness)


def test_cubes_of_a_turn_are_those_of_its_rate() -> None:
    t = np.linspace(0.0, 6.0, 6001)
    rate = 0.1 * np.cos(0.5 * t)
    running = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] ** 3 + rate[:-1] ** 3) * 1.0e-3)])
    weight = np.minimum(t, 6.0 - t)
    added, mean = over_two_blocks(0.0)
    size = float(np.max(np.abs(running)))
    assert added == pytest.approx(running[4500] - running[1500], abs=0.03 * size)
    assert mean == pytest.approx(np.sum(weight * running) / np.sum(weight) - running[1500], abs=0.03 * size)


def test_noise_does_not_make_cubes_larger() -> None:
    clean = over_two_blocks(0.0)
    noisy = np.mean([over_two_blocks(math.radians(0.6), seed) for seed in range(200)], axis=0)
    # uncorrected it would be more by a third
    size = abs(over_two_blocks(0.0)[0])
    np.testing.assert_allclose(noisy, clean, atol=0.15 * size)


def test_a_course_unstable_boat_is_learnt_from_headings_alone() -> None:
    """From twice the truth, where windows are twice as long as they should be; taking each block's mean rate for all
    of it ended 20 % off."""
    boat = Norrbin(0.2, 5.0, 200.0, n1=-1.0)
    fit = IntegralFit(boat._replace(gain=0.4, time_constant=10.0, n3=400.0))
    rate = heading = 0.0
    order = 0.26
    for k in range(10_000):
        if k % 10 == 0:
            fit.update(0.01 * k, order, 1.0, heading, None)
        if heading * math.copysign(1.0, order) >= 0.26:
            order = -order
        before = rate
        rate += 0.01 * (0.2 * order + rate - 200.0 * rate**3) / 5.0
        heading += 0.005 * (before + rate)
    assert fit.model.gain == pytest.approx(0.2, rel=0.08)
    assert fit.model.time_constant == pytest.approx(5.0, rel=0.08)
