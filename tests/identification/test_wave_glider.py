"""The worked example of a wave glider: equations of motion, and both bodies identified against the simulated truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from wave_glider import Setting, TwoBodies, equivalent_rudder, identified, sail, step

CRAFT = Setting().craft
QUIET = Setting(back_pull=0.0, wave_speed=0.0, shake=0.0)


def test_the_float_follows_the_glider_and_comes_to_rest_behind_it() -> None:
    bodies = TwoBodies(glider_heading=1.0)
    for _ in range(6000):
        bodies = step(CRAFT, bodies, 0.0, 0.02)
    assert bodies.surface_heading == pytest.approx(1.0, abs=1.0e-3)
    assert bodies.surface_rate == pytest.approx(0.0, abs=1.0e-4)
    assert bodies.glider_heading == 1.0


@given(st.floats(-0.6, 0.6), st.floats(-3.0, 3.0))
def test_a_step_is_that_of_another_integrator(rudder: float, apart: float) -> None:
    def slope(_: float, x: np.ndarray) -> list[float]:
        psi_f, r_f, psi_g, r_g = x
        surface, glider = CRAFT.surface, CRAFT.glider
        pull = surface.gain * CRAFT.fixed_angle * math.sin(psi_g - psi_f)
        return [
            r_f,
            (pull - r_f - surface.n3 * r_f**3) / surface.time_constant,
            r_g,
            (glider.gain * rudder - r_g - glider.n3 * r_g**3) / glider.time_constant,
        ]

    there = solve_ivp(slope, (0.0, 0.1), [0.0, 0.1, apart, -0.1], rtol=1e-10, atol=1e-12).y[:, -1]
    here = step(CRAFT, TwoBodies(0.0, 0.1, apart, -0.1), rudder, 0.1)
    assert here == pytest.approx(tuple(there), abs=1.0e-7)


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_the_equivalent_rudder_turns_the_float_towards_the_glider(glider: float, surface: float) -> None:
    angle = equivalent_rudder(0.5, glider, surface)
    assert abs(angle) <= 0.5
    assert angle * math.sin(glider - surface) >= 0.0
    assert equivalent_rudder(0.5, glider + 2.0 * math.pi, surface) == pytest.approx(angle, abs=1.0e-9)


@pytest.mark.parametrize("method", ["integral", "output-error"])
def test_k_and_t_of_float_and_glider_are_identified_within_five_percent(method: str) -> None:
    found = identified(QUIET, sail(QUIET, 200.0, 3), method)
    for name, truth in (("float", CRAFT.surface), ("glider", CRAFT.glider)):
        assert found[name].gain == pytest.approx(truth.gain, rel=0.05), name
        assert found[name].time_constant == pytest.approx(truth.time_constant, rel=0.05), name
